"""CAN frames to samples in SI, by the DBC and the mapping; bad frames are counted, never fatal.

A wanted frame passes three gates, the cheapest first: the rate bound of its id, the checksum and alive
counter of its message where the configuration has them, and the bounds of each value in it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from cantools.database.can import Message

from dsz_daemon.errors import ConfigError, Fault
from dsz_daemon.pipeline.bit_fields import Reader
from dsz_daemon.pipeline.decode_counters import DecodeCounters, MessageCounts, RoleCounts, Sender
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.mapping import Sample, Source
from dsz_daemon.pipeline.protection import MessageCheck, Protection, Status, judged, message_check
from dsz_daemon.pipeline.rate_bound import RateBound
from dsz_daemon.pipeline.source_plan import MessagePlan, SourcePlan, is_on, message_plans

__all__ = ["DecodeCounters", "Decoder", "MessageCounts", "RoleCounts"]

DEFAULT_RESYNC_NS = 500_000_000
_LARGEST = sys.float_info.max
# Sample(...) without the detour through its Python constructor: there is one for every value on the bus.
_sample = partial(tuple.__new__, Sample)

# Role, its reader where the value needs no other signal's word, its bounds, its counts, and all of its plan.
_Entry = tuple[str, Reader | None, float, float, RoleCounts, SourcePlan]


@dataclass(slots=True)
class _Lane:
    """What is wanted of one message on one channel, and what is remembered of it.

    `entries` are for payloads of `needed_bytes` and more; for others `careful`, which look at each signal's length.
    """

    counts: MessageCounts
    sender: Sender
    check: MessageCheck | None
    length_bytes: int
    needed_bytes: int
    entries: tuple[_Entry, ...]
    careful: tuple[_Entry, ...]


class Decoder:
    """Decodes the wanted signals of each frame into samples.

    `messages` are the DBC's by the name that `Source.message` uses. Frames of `excluded_ids`, as
    (CAN id, is extended), never become samples: the ids that we publish ourselves. `counters` are
    those of an earlier decoder of the same mapping: resuming from them equals never having stopped.
    `protections` say which messages carry a checksum or a counter, each message at most once; after a
    silence of `resync_ns` any counter is taken. `rate_bound` holds for each message and channel.

    A source that names no channel takes its message from the first channel that it is seen on. The
    same id on another channel is most likely another device: those frames are counted as ambiguous
    and not used.

    Raises ConfigError, with every fault, where a message or signal of a source or a protection is not
    in the DBC.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        messages: Mapping[str, Message],
        excluded_ids: Collection[tuple[int, bool]] = (),
        counters: DecodeCounters | None = None,
        protections: Sequence[Protection] = (),
        rate_bound: RateBound | None = None,
        resync_ns: int = DEFAULT_RESYNC_NS,
    ) -> None:
        self._excluded = frozenset(excluded_ids)
        plans = message_plans(sources, messages)
        self._plans = {address: plan for address, plan in plans.items() if address not in self._excluded}
        self._checks = _checks(protections, messages, resync_ns)
        self._rate_bound = rate_bound
        self._channels = frozenset(s.channel for s in sources if s.channel is not None)
        self._counters = counters.copy() if counters is not None else DecodeCounters()
        for source in sources:
            self._counters.roles.setdefault(source.role, RoleCounts())
            self._counters.messages.setdefault(source.message, MessageCounts())
        self._rejected = self._counters.rejected
        # By channel, id and whether that is extended; the flag: another message of that id is bound elsewhere.
        self._lanes: dict[tuple[str, int, bool], tuple[tuple[_Lane, ...], bool]] = {}

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
        """What came but was not used: `counters.rejected`, at no cost."""
        return self._rejected

    def wanted_ids(self) -> frozenset[tuple[int, bool]]:
        """(CAN id, is extended) of every frame that can become a sample: a bus filter's list."""
        return frozenset(self._plans)

    def decode(self, frame: Frame) -> Sequence[Sample]:
        """Samples of one frame, at most one per role; empty for a frame that is not wanted."""
        t_ns, channel, can_id, data, is_extended, _, is_remote, is_error, _, _ = frame
        counters = self._counters
        counters.frames += 1
        if is_error:
            counters.error_frames += 1
            return ()
        if is_remote:
            counters.remote += 1
            return ()
        lanes, is_ambiguous = self._lanes.get((channel, can_id, is_extended)) or self._opened(
            channel, (can_id, is_extended)
        )
        counters.ambiguous += is_ambiguous
        samples: list[Sample] = []
        for lane in lanes:
            if self._is_admitted(lane, t_ns, data):
                self._read(lane, t_ns, data, samples)
        return samples

    def _opened(self, channel: str, address: tuple[int, bool]) -> tuple[tuple[_Lane, ...], bool]:
        """The lanes of an address on a channel, and whether one of its messages is bound to another channel.

        Only where there are any are they kept: the number of channels that a log can name has no end.
        """
        lanes, is_ambiguous = [], False
        for plan in self._plans.get(address, ()):
            counts = self._counters.messages[plan.name]
            wanted = plan.by_channel.get(channel, ())
            if plan.anywhere:
                if counts.channel is None:
                    counts.channel = channel
                if counts.channel == channel:
                    wanted += plan.anywhere
                else:
                    is_ambiguous = True
            if wanted:
                sender = counts.senders.setdefault(channel, Sender())
                lanes.append(self._lane(plan, wanted, counts, sender))
        if lanes:
            self._lanes[channel, *address] = tuple(lanes), is_ambiguous
        elif address in self._excluded:
            self._counters.own += 1
        elif not is_ambiguous:
            self._counters.unwanted += 1
            self._near_miss(channel, address)
        return tuple(lanes), is_ambiguous

    def _near_miss(self, channel: str, address: tuple[int, bool]) -> None:
        """Counts a frame that nothing is mapped to and that looks like one which is."""
        can_id, is_extended = address
        for plan in self._plans.get((can_id, not is_extended), ()):
            self._counters.messages[plan.name].other_width += 1
        for plan in self._plans.get(address, ()):
            counts = self._counters.messages[plan.name]
            counts.elsewhere += 1
            counts.elsewhere_on = counts.elsewhere_on or channel

    def _lane(self, plan: MessagePlan, wanted: Sequence[SourcePlan], counts: MessageCounts, sender: Sender) -> _Lane:
        plain = [not source_plan.selectors and source_plan.valid is None for source_plan in wanted]
        careful: list[_Entry] = [
            # Infinite bounds let everything pass but infinity itself.
            (p.source.role, None, max(p.source.low, -_LARGEST), min(p.source.high, _LARGEST),
             self._counters.roles[p.source.role], p)
            for p in wanted
        ]  # fmt: skip
        entries = [
            (role, p.read if is_plain else None, low, high, role_counts, p)
            for is_plain, (role, _, low, high, role_counts, p) in zip(plain, careful, strict=True)
        ]
        return _Lane(
            counts=counts,
            sender=sender,
            check=self._checks.get(plan.name),
            length_bytes=plan.length_bytes,
            needed_bytes=max(
                (p.needed_bytes for is_plain, p in zip(plain, wanted, strict=True) if is_plain), default=0
            ),
            entries=tuple(entries),
            careful=tuple(careful),
        )

    def _is_admitted(self, lane: _Lane, t_ns: int, data: bytes) -> bool:
        """Whether the frame as a whole may be used; it is counted either way."""
        counts = lane.counts
        if self._rate_bound is not None and not self._rate_bound.admits(lane.sender, t_ns):
            counts.babbling += 1
            lane.sender.unread += 1
            self._rejected += 1
            return False
        if len(data) != lane.length_bytes:
            counts.wrong_length += 1
        if lane.check is not None:
            status, lost = judged(lane.check, lane.sender, t_ns, data)
            if status in _REFUSED:
                name = _REFUSED[status]
                setattr(counts, name, getattr(counts, name) + 1)
                self._rejected += 1
                return False
            counts.lost += lost
        counts.frames += 1
        counts.last_t_ns = t_ns
        return True

    def _read(self, lane: _Lane, t_ns: int, data: bytes, samples: list[Sample]) -> None:
        """The values of an admitted frame, added to `samples` where they can be used."""
        for role, read, low, high, counts, plan in lane.entries if len(data) >= lane.needed_bytes else lane.careful:
            value: float | None
            if read is not None and low <= (value := read(data)) <= high:
                counts.samples += 1
            else:
                value = self._accepted_value(plan, data, counts)
                if value is None:
                    continue
            samples.append(_sample((t_ns, role, value)))

    def _accepted_value(self, plan: SourcePlan, data: bytes, counts: RoleCounts) -> float | None:
        """SI value of one source in one payload, or None; the outcome is added to `counts`."""
        length = len(data)
        # The selectors first: the other pages of a multiplexed message may well be shorter.
        if length >= plan.selector_bytes:
            for selector, values in plan.selectors:
                if selector(data) not in values:
                    counts.not_present += 1
                    return None
        if length < plan.needed_bytes:
            counts.short += 1
        elif plan.valid is not None and not is_on(plan.valid(data), plan.source.valid_values):
            counts.flagged += 1
        else:
            value = plan.read(data)
            if not math.isfinite(value):
                counts.not_a_number += 1
            elif not plan.source.low <= value <= plan.source.high:
                counts.out_of_range += 1
            else:
                counts.samples += 1
                return value
        self._rejected += 1
        return None


# The count of each verdict that costs a frame.
_REFUSED = {
    Status.WRONG_CHECKSUM: "wrong_checksum",
    Status.REPEATED: "repeated",
    Status.WRONG_SEQUENCE: "wrong_sequence",
}


def _checks(
    protections: Sequence[Protection], messages: Mapping[str, Message], resync_ns: int
) -> dict[str, MessageCheck]:
    checks: dict[str, MessageCheck] = {}
    faults: list[Fault] = []
    for protection in protections:
        where, message = f"protection.{protection.message}", messages.get(protection.message)
        if message is None:
            faults.append(Fault(where, "is not a mapped message"))
            continue
        try:
            checks[protection.message] = message_check(protection, message, resync_ns)
        except ValueError as error:
            faults.append(Fault(where, str(error)))
    if faults:
        raise ConfigError("the protection of messages does not fit the DBC", faults)
    return checks
