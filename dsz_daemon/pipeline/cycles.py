"""How regularly the wanted messages came: what a logger or a bus has dropped, by their own cycle."""

from __future__ import annotations

from dataclasses import dataclass, field

from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.histogram import Histogram

Address = tuple[str, int, bool]


# A stamp that falls back further than this is a step of the clock, not a late frame.
_LATE_NS = 1_000_000_000


@dataclass
class _Gaps:
    last_ns: int
    before_ns: int | None = None
    frames: int = 1
    # Gap lengths in 0.1 ms: cycles are milliseconds, jitter is a fraction of one.
    gaps: Histogram = field(default_factory=Histogram)
    longest: int = 0

    def add(self, gap_ns: int) -> None:
        """One more gap."""
        length = round(gap_ns * 1e-5)
        self.gaps.add(length)
        self.longest = max(self.longest, length)


@dataclass(frozen=True)
class Cycle:
    """One message: frames seen, median cycle, and frames missing from it."""

    channel: str
    can_id: int
    frames: int
    cycle_s: float
    missing: int
    longest_gap_s: float

    @property
    def missing_share(self) -> float:
        """Missing frames over those that should have come."""
        return self.missing / (self.frames + self.missing)


@dataclass
class CycleWatch:
    """Takes every wanted frame; `cycles` says what was missing.

    A gap of n median cycles means n - 1 frames that did not come. Messages sent on events rather
    than in a cycle have no use for this; their gaps scatter too widely (`steady`) and say nothing.
    """

    wanted: frozenset[tuple[int, bool]]
    seen: dict[Address, _Gaps] = field(default_factory=dict)

    def watch(self, frame: Frame) -> None:
        """Takes one frame into account; frames that nobody wants are passed over."""
        if (frame.can_id, frame.is_extended) not in self.wanted or frame.is_remote or frame.is_error:
            return
        address = (frame.channel, frame.can_id, frame.is_extended)
        gaps = self.seen.get(address)
        if gaps is None:
            self.seen[address] = _Gaps(frame.t_ns)
            return
        gaps.frames += 1
        _take(gaps, frame.t_ns)

    def cycles(self) -> list[Cycle]:
        """All messages with a steady cycle, in the order of their ids."""
        found = [cycle for address, gaps in self.seen.items() if (cycle := _cycle(address, gaps)) is not None]
        return sorted(found, key=lambda cycle: (cycle.channel, cycle.can_id))


def _take(gaps: _Gaps, t_ns: int) -> None:
    """One more stamp. A gap counts once a frame behind it shows that nothing came late into it."""
    before_ns, last_ns = gaps.before_ns, gaps.last_ns
    if before_ns is not None and before_ns <= t_ns < last_ns:
        gaps.add(t_ns - before_ns)
        gaps.before_ns = t_ns
    elif t_ns >= last_ns:
        if before_ns is not None:
            gaps.add(last_ns - before_ns)
        gaps.before_ns, gaps.last_ns = last_ns, t_ns
    elif t_ns < last_ns - _LATE_NS:
        gaps.before_ns, gaps.last_ns = None, t_ns


def _cycle(address: Address, gaps: _Gaps) -> Cycle | None:
    total, median = gaps.gaps.total, gaps.gaps.median()
    if total < 20 or not median:
        return None
    lengths = gaps.gaps.items()
    near = sum(n for length, n in lengths if abs(length - median) <= 0.5 * median)
    if near < 0.6 * total:
        return None
    missing = sum(n * (round(length / median) - 1) for length, n in lengths if length > 1.5 * median)
    return Cycle(address[0], address[1], gaps.frames, median * 1e-4, missing, gaps.longest * 1e-4)
