"""Sources resolved against the DBC: everything that can be looked up before the first frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from cantools.database.can import Message, Signal

from dsz_daemon.errors import ConfigError, Fault
from dsz_daemon.pipeline.bit_fields import BitField, bit_field
from dsz_daemon.pipeline.mapping import Source


class SourcePlan(NamedTuple):
    """One role's source with its bits.

    `parts` are (field, sign). `selectors` are the multiplexers that must have one of their values
    for the source to be in the frame. `selector_bytes` and `needed_bytes` are the shortest payloads
    that hold the selectors and everything.
    """

    source: Source
    parts: tuple[tuple[BitField, float], ...]
    valid: BitField | None
    selectors: tuple[tuple[BitField, frozenset[int]], ...]
    selector_bytes: int
    needed_bytes: int
    si_factor: float


class MessagePlan(NamedTuple):
    """The wanted sources of one message, by the channel they ask for; `anywhere`: those that ask for none."""

    name: str
    length_bytes: int
    by_channel: dict[str, tuple[SourcePlan, ...]]
    anywhere: tuple[SourcePlan, ...]


def message_plans(
    sources: Sequence[Source], messages: Mapping[str, Message]
) -> dict[tuple[int, bool], tuple[MessagePlan, ...]]:
    """Plans by (CAN id, is extended); several where two DBCs describe the same id.

    Raises ConfigError with every fault: a role mapped twice, a message or signal that is not there.
    """
    faults: list[Fault] = []
    by_message: dict[str, list[SourcePlan]] = {}
    roles: set[str] = set()
    for source in sources:
        where = f"signals.{source.role}"
        if source.role in roles:
            faults.append(Fault(where, "mapped twice; a role has one source"))
        roles.add(source.role)
        message = messages.get(source.message)
        if message is None:
            faults.append(Fault(where, f"message {source.message!r} is not in the DBC"))
            continue
        try:
            by_message.setdefault(source.message, []).append(_source_plan(source, message))
        except ValueError as error:
            faults.append(Fault(where, str(error)))
    if faults:
        raise ConfigError("the signal mapping does not fit the DBC", faults)

    plans: dict[tuple[int, bool], tuple[MessagePlan, ...]] = {}
    for name, wanted in by_message.items():
        message = messages[name]
        address = (message.frame_id, message.is_extended_frame)
        plans[address] = (*plans.get(address, ()), _message_plan(name, message, wanted))
    return plans


def _message_plan(name: str, message: Message, wanted: Sequence[SourcePlan]) -> MessagePlan:
    channels = dict.fromkeys(plan.source.channel for plan in wanted if plan.source.channel is not None)
    return MessagePlan(
        name=name,
        length_bytes=message.length,
        by_channel={c: tuple(p for p in wanted if p.source.channel == c) for c in channels},
        anywhere=tuple(p for p in wanted if p.source.channel is None),
    )


def _source_plan(source: Source, message: Message) -> SourcePlan:
    """Resolve one source; ValueError says which signal is missing or can't be read."""
    by_name = {signal.name: signal for signal in message.signals}
    names = [part.signal for part in source.parts]
    if source.valid_signal is not None:
        names.append(source.valid_signal)
    missing = [name for name in names if name not in by_name]
    if missing:
        raise ValueError(f"message {source.message!r} has no signal {', '.join(map(repr, missing))}")
    fields = {name: _field(by_name[name]) for name in names}
    selectors = tuple(dict.fromkeys(selector for name in names for selector in _selectors(by_name[name], by_name)))
    selector_bytes = max((field.end_byte for field, _ in selectors), default=0)
    return SourcePlan(
        source=source,
        parts=tuple((fields[part.signal], part.sign) for part in source.parts),
        valid=fields[source.valid_signal] if source.valid_signal is not None else None,
        selectors=selectors,
        selector_bytes=selector_bytes,
        needed_bytes=max([selector_bytes, *(field.end_byte for field in fields.values())]),
        si_factor=source.sign * source.to_si,
    )


def _selectors(signal: Signal, by_name: Mapping[str, Signal]) -> list[tuple[BitField, frozenset[int]]]:
    """Multiplexers above `signal`, all of which must agree (extended multiplexing nests them)."""
    chain: list[tuple[BitField, frozenset[int]]] = []
    below = signal
    for _ in by_name:  # a nesting is no deeper than there are signals; a circle in a bad DBC ends here
        if below.multiplexer_ids is None or below.multiplexer_signal is None:
            break
        selector = by_name[below.multiplexer_signal]
        chain.append((_field(selector), frozenset(below.multiplexer_ids)))
        below = selector
    return chain


def _field(signal: Signal) -> BitField:
    try:
        return bit_field(signal)
    except ValueError as error:
        raise ValueError(f"signal {signal.name!r} is {error}") from None
