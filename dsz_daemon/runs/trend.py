"""What `dsz monitor` remembers of the last minute: offsets for a small trend, frame counts for the load of now."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

SPAN_S = 60.0
# The load of now is taken over this long: shorter, single frames show; longer, it is not now.
_LOAD_S = 1.0

BLOCKS = "▁▂▃▄▅▆▇█"
PLAIN_BLOCKS = "_.-=*#"


class Moment(NamedTuple):
    """Of one answer: its time, each channel's offset (None: not there), frames received and sent by bus."""

    time_s: float
    offsets: dict[str, float | None]
    frames: dict[str, tuple[int, int]]


class Trend:
    """Answers of one run of one daemon, `SPAN_S` back from the last; another run begins afresh."""

    def __init__(self) -> None:
        self._moments: deque[Moment] = deque()
        self._run: tuple[Any, Any] | None = None

    def add(self, answer: dict[str, Any]) -> None:
        """Takes one answer into account."""
        run = (answer["pid"], answer["started_s"])
        moment = Moment(
            answer["time_s"],
            {name: channel["offset"] for name, channel in answer["channels"].items()},
            {bus["name"]: (bus["received"], bus["sent"]) for bus in answer["buses"]},
        )
        last = self._moments[-1] if self._moments else None
        goes_on = last is not None and run == self._run and moment.time_s >= last.time_s
        if not goes_on:
            self._moments.clear()
        self._run = run
        self._moments.append(moment)
        while self._moments[0].time_s < moment.time_s - SPAN_S:
            self._moments.popleft()

    def offsets(self, channel: str, columns: int) -> list[float | None]:
        """The channel's offset over the last minute in so many equal times, oldest first; None: not known then."""
        found: list[float | None] = [None] * columns
        for moment in self._moments:
            age_s = self._moments[-1].time_s - moment.time_s
            # The newest lies in the last column, one of SPAN_S ago in the first.
            n = min(columns - 1, int((SPAN_S - age_s) / SPAN_S * columns))
            found[n] = moment.offsets.get(channel)
        return found

    def load(self, bus: str) -> tuple[float, float] | None:
        """Frames per second received and sent over about the last second; None while that is not known."""
        if len(self._moments) < 2:
            return None
        last = self._moments[-1]
        before = next(m for m in reversed(self._moments) if m.time_s <= last.time_s - _LOAD_S or m is self._moments[0])
        over_s = last.time_s - before.time_s
        if over_s <= 0.0 or bus not in last.frames or bus not in before.frames:
            return None
        received, sent = (now - then for now, then in zip(last.frames[bus], before.frames[bus], strict=True))
        return received / over_s, sent / over_s


def bridged(values: Sequence[float | None]) -> list[float | None]:
    """The same with holes between two known values filled by the earlier one (fewer answers than columns).

    >>> bridged([None, 1.0, None, 2.0, None])
    [None, 1.0, 1.0, 2.0, None]
    """
    filled = list(values)
    known = [n for n, value in enumerate(filled) if value is not None]
    for first, second in pairwise(known):
        filled[first + 1 : second] = [filled[first]] * (second - first - 1)
    return filled


def sparkline(values: Sequence[float | None], least_range: float, blocks: str = BLOCKS) -> str:
    """One character a value, a space where there is none.

    The height spans the values, but at least `least_range` (the offset's spread: what moves within it
    is noise, and shall look like it), with the values in its middle.

    >>> sparkline([0.0, None, 1.0], 0.0), sparkline([1.0, 1.001], 1.0)
    ('▁ █', '▅▅')
    """
    known = [value for value in values if value is not None]
    if not known:
        return " " * len(values)
    low, high = min(known), max(known)
    span, middle, levels = max(high - low, least_range), (low + high) / 2.0, len(blocks)

    def block(value: float) -> str:
        # The middle of the range is the middle of a block, not the edge of two.
        steps = math.ceil((value - middle) / span * (levels - 1) - 0.5) if span > 0.0 else 0
        return blocks[min(levels - 1, max(0, levels // 2 + steps))]

    return "".join(" " if value is None else block(value) for value in values)
