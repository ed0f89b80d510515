"""Sources resolved against the DBC: everything that can be looked up before the first frame."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from cantools.database.can import Message, Signal

from dsz_daemon.errors import ConfigError, Fault
from dsz_daemon.pipeline.bit_fields import BitField, RawReader, Reader, bit_field, raw_reader, reader
from dsz_daemon.pipeline.mapping import Source


class SourcePlan(NamedTuple):
    """One role's source with its readers.

    `source` has the bounds that count; `read` gives the SI value of a payload; `valid` what its valid
    signal says, where it has one.
    `selectors` are the multiplexers that must have one of their values for the source to be in the
    frame. `selector_bytes` and `needed_bytes` are the shortest payloads that hold the selectors and
    everything.
    """

    source: Source
    read: Reader
    valid: Reader | None
    selectors: tuple[tuple[RawReader, frozenset[int]], ...]
    selector_bytes: int
    needed_bytes: int


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
        source=_between_rails(source, fields[source.parts[0].signal]),
        read=_si_reader(source, fields),
        valid=reader(fields[source.valid_signal]) if source.valid_signal is not None else None,
        selectors=tuple((raw_reader(field), values) for field, values in selectors),
        selector_bytes=selector_bytes,
        needed_bytes=max([selector_bytes, *(field.end_byte for field in fields.values())]),
    )


def _between_rails(source: Source, field: BitField) -> Source:
    """An analog source's bounds, drawn in to exclude the ADC's first and last code.

    There the sensor is beyond what the ADC can tell, torn off or shorted: the true value is anything from there on.
    A converter with fewer bits than its signal has in the frame is not seen through.
    """
    if source.volts_per_count is None or len(source.parts) > 1 or field.is_float:
        return source
    lowest = -field.sign_bit
    inner = (lowest + 0.5, lowest + field.mask - 0.5)
    ends = sorted(
        source.sign
        * source.to_si
        * ((source.parts[0].sign * (raw * field.scale + field.offset)) * source.volts_per_count - source.null_volts)
        / source.volts_per_unit
        for raw in inner
    )
    return source._replace(low=max(source.low, ends[0]), high=min(source.high, ends[1]))


def _si_reader(source: Source, fields: Mapping[str, BitField]) -> Reader:
    """The source's SI value of a payload: of a sum, behind an ADC, or 1 (on) or 0 of a switch."""
    si_factor = source.sign * source.to_si
    plain = not source.is_switch and source.volts_per_count is None
    factor = si_factor if plain else 1.0
    if len(source.parts) == 1:
        part = source.parts[0]
        total = reader(fields[part.signal], factor * part.sign)
    else:
        total = _sum(tuple(reader(fields[part.signal], part.sign) for part in source.parts), factor)
    if source.is_switch:
        on_values = source.on_values
        return lambda data: _switched(total(data), on_values)
    if source.volts_per_count is None:
        return total
    volts_per_count, null_volts, volts_per_unit = source.volts_per_count, source.null_volts, source.volts_per_unit
    return lambda data: si_factor * ((total(data) * volts_per_count - null_volts) / volts_per_unit)


def _sum(readers: Sequence[Reader], factor: float) -> Reader:
    if len(readers) == 2:  # as steering wheel angles come: whole steps, and tenths beside them
        first, second = readers
        return lambda data: factor * (first(data) + second(data))

    def read_sum(data: bytes) -> float:
        total = 0.0
        for read in readers:  # not sum(): it rounds otherwise from Python 3.12 on
            total += read(data)
        return factor * total

    return read_sum


def _switched(value: float, on_values: tuple[float, ...]) -> float:
    """1.0 for on, 0.0 for off; what is no number stays none."""
    return (1.0 if is_on(value, on_values) else 0.0) if math.isfinite(value) else math.nan


def is_on(value: float, on_values: tuple[float, ...]) -> bool:
    """Whether `value` is one of `on_values` (to rounding), or simply not zero where none are given."""
    if not on_values:
        return value != 0.0
    return value in on_values or any(math.isclose(value, on, rel_tol=1e-9, abs_tol=1e-9) for on in on_values)


def _selectors(signal: Signal, by_name: Mapping[str, Signal]) -> list[tuple[BitField, frozenset[int]]]:
    """Multiplexers above `signal`, all of which must agree (extended multiplexing nests them)."""
    chain: list[tuple[BitField, frozenset[int]]] = []
    below = signal
    for _ in by_name:  # a nesting is no deeper than there are signals; a circle in a bad DBC ends here
        if below.multiplexer_ids is None or below.multiplexer_signal is None:
            break
        selector = by_name.get(below.multiplexer_signal)
        if selector is None:
            raise ValueError(f"signal {below.name!r} is on a page of {below.multiplexer_signal!r}, which is no signal")
        chain.append((_field(selector), frozenset(below.multiplexer_ids)))
        below = selector
    return chain


def _field(signal: Signal) -> BitField:
    try:
        return bit_field(signal)
    except ValueError as error:
        raise ValueError(f"signal {signal.name!r} is {error}") from None
