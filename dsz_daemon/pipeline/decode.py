"""CAN frames to samples in SI, by the DBC and the mapping; bad frames are counted, never fatal."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cantools.database.can import Message

from dsz_daemon.pipeline.bit_fields import physical, unsigned_raw
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.mapping import Sample, Source
from dsz_daemon.pipeline.source_plan import SourcePlan, message_plans


@dataclass(slots=True)
class RoleCounts:
    """What became of one role's frames; each frame meant for the role is in exactly one count.

    `short`: too few bytes for the role's signals. `not_present`: the multiplexer carried other
    signals (no fault). `flagged`: its valid signal did not vouch. `not_a_number`: NaN or infinite.
    `out_of_range`: outside the bounds of its source (which are inclusive).
    """

    samples: int = 0
    short: int = 0
    not_present: int = 0
    flagged: int = 0
    not_a_number: int = 0
    out_of_range: int = 0

    @property
    def rejected(self) -> int:
        """Values that came but were not used."""
        return self.short + self.flagged + self.not_a_number + self.out_of_range


@dataclass(slots=True)
class MessageCounts:
    """One wanted message: frames used, how many were shorter or longer than the DBC says, last stamp.

    `channel` is the first channel it came from: sources that name no channel are bound to it.
    """

    frames: int = 0
    wrong_length: int = 0
    last_t_ns: int | None = None
    channel: str | None = None


@dataclass(slots=True)
class DecodeCounters:
    """All that a decoder remembers; plain values, so that it can be saved and handed back.

    `frames` counts every frame; `unwanted` those of ids or channels that nothing is mapped to,
    `own` those of ids that this daemon publishes, `ambiguous` those of a wanted id on a second
    channel although their source names none.
    """

    frames: int = 0
    unwanted: int = 0
    own: int = 0
    remote: int = 0
    error_frames: int = 0
    ambiguous: int = 0
    roles: dict[str, RoleCounts] = field(default_factory=dict)
    messages: dict[str, MessageCounts] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        """Samples of all roles."""
        return sum(counts.samples for counts in self.roles.values())

    @property
    def rejected(self) -> int:
        """Values of all roles that came but were not used."""
        return sum(counts.rejected for counts in self.roles.values())

    def copy(self) -> DecodeCounters:
        """Return an equal value that shares nothing with this one."""
        return replace(
            self,
            roles={role: replace(counts) for role, counts in self.roles.items()},
            messages={name: replace(counts) for name, counts in self.messages.items()},
        )


class Decoder:
    """Decodes the wanted signals of each frame into samples.

    `messages` are the DBC's by the name that `Source.message` uses. Frames of `excluded_ids`, as
    (CAN id, is extended), never become samples: the ids that we publish ourselves. `counters` are
    those of an earlier decoder of the same mapping: resuming from them equals never having stopped.

    A source that names no channel takes its message from the first channel that it is seen on. The
    same id on another channel is most likely another device: those frames are counted as ambiguous
    and not used.

    Raises ConfigError, with every fault, where a message or signal of a source is not in the DBC.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        messages: Mapping[str, Message],
        excluded_ids: Collection[tuple[int, bool]] = (),
        counters: DecodeCounters | None = None,
    ) -> None:
        self._excluded = frozenset(excluded_ids)
        self._plans = message_plans(sources, messages)
        self._channels = frozenset(s.channel for s in sources if s.channel is not None)
        self._counters = counters.copy() if counters is not None else DecodeCounters()
        for source in sources:
            self._counters.roles.setdefault(source.role, RoleCounts())
            self._counters.messages.setdefault(source.message, MessageCounts())

    @property
    def counters(self) -> DecodeCounters:
        """What has been seen so far: a copy, which later frames don't change."""
        return self._counters.copy()

    @property
    def channels(self) -> frozenset[str]:
        """The channels that sources name; empty where none does."""
        return self._channels

    @property
    def rejected(self) -> int:
        """Values that came but were not used, of all roles; quicker than a copy of the counters."""
        return self._counters.rejected

    def wanted_ids(self) -> frozenset[tuple[int, bool]]:
        """(CAN id, is extended) of every frame that can become a sample: a bus filter's list."""
        return frozenset(self._plans) - self._excluded

    def decode(self, frame: Frame) -> Sequence[Sample]:
        """Samples of one frame, at most one per role; empty for a frame that is not wanted."""
        counters = self._counters
        counters.frames += 1
        if frame.is_error:
            counters.error_frames += 1
            return ()
        if frame.is_remote:
            counters.remote += 1
            return ()
        address = (frame.can_id, frame.is_extended)
        if address in self._excluded:
            counters.own += 1
            return ()
        return self._wanted_samples(frame, address)

    def _wanted_samples(self, frame: Frame, address: tuple[int, bool]) -> Sequence[Sample]:
        samples: list[Sample] = []
        is_used = is_ambiguous = False
        for plan in self._plans.get(address, ()):
            seen = self._counters.messages[plan.name]
            wanted = plan.by_channel.get(frame.channel, ())
            if plan.anywhere:
                if seen.channel is None:
                    seen.channel = frame.channel
                if seen.channel == frame.channel:
                    wanted += plan.anywhere
                else:
                    is_ambiguous = True
            if not wanted:
                continue
            is_used = True
            seen.frames += 1
            seen.wrong_length += len(frame.data) != plan.length_bytes
            seen.last_t_ns = frame.t_ns
            for source_plan in wanted:
                role = source_plan.source.role
                value = _accepted_value(source_plan, frame.data, self._counters.roles[role])
                if value is not None:
                    samples.append(Sample(frame.t_ns, role, value))
        self._counters.ambiguous += is_ambiguous
        self._counters.unwanted += not (is_used or is_ambiguous)
        return samples


def _accepted_value(plan: SourcePlan, data: bytes, counts: RoleCounts) -> float | None:
    """SI value of one source in one payload, or None; the outcome is added to `counts`."""
    source = plan.source
    length = len(data)
    # The selectors first: the other pages of a multiplexed message may well be shorter.
    if length < plan.selector_bytes:
        counts.short += 1
        return None
    for selector, values in plan.selectors:
        if unsigned_raw(selector, data) not in values:
            counts.not_present += 1
            return None
    if length < plan.needed_bytes:
        counts.short += 1
        return None
    if plan.valid is not None and not _is_on(physical(plan.valid, data), source.valid_values):
        counts.flagged += 1
        return None
    total = 0.0
    for bits, sign in plan.parts:
        total += sign * physical(bits, data)
    value = _si_value(plan, total)
    if not math.isfinite(value):
        counts.not_a_number += 1
        return None
    if not source.low <= value <= source.high:
        counts.out_of_range += 1
        return None
    counts.samples += 1
    return value


def _si_value(plan: SourcePlan, total: float) -> float:
    """SI value of a source's sum in the DBC's unit; a switch gives 1 (on) or 0."""
    source = plan.source
    if source.is_switch and math.isfinite(total):
        return 1.0 if _is_on(total, source.on_values) else 0.0
    if source.volts_per_count is not None:
        total = (total * source.volts_per_count - source.null_volts) / source.volts_per_unit
    return plan.si_factor * total


def _is_on(value: float, on_values: tuple[float, ...]) -> bool:
    """Whether `value` is one of `on_values` (to rounding), or simply not zero where none are given."""
    if not on_values:
        return value != 0.0
    return any(math.isclose(value, on, rel_tol=1e-9, abs_tol=1e-9) for on in on_values)
