"""The output messages as dbc/dsz.dbc lays them out, resolved: how a row's values become bits.

The layout, the factors, the ranges and the raw value for "can't be given" are read from the DBC; only
the meaning of each signal is ours (output_signals).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from cantools.database.can import Message, Signal

from dsz_daemon.pipeline.e2e_protection import data_id_list
from dsz_daemon.pipeline.output_signals import AXES, SIGNALS, UNIT_FACTORS
from dsz_daemon.pipeline.rows import Row

NOT_AVAILABLE = "not_available"
# What a controller needs at the loop's rate; everything else is status.
_FAST_MESSAGES = frozenset({"DSZ_RATES", "DSZ_ACCEL"})
_E2E_SIGNALS = frozenset({"E2E_CRC", "E2E_COUNTER"})
_FLAG_PREFIX = "SATURATED_"


class OutputField(NamedTuple):
    """One signal: its value of a row in SI, and how that becomes bits.

    raw = round((value * unit_factor - offset) / scale), kept in [raw_low, raw_high]; `flag_bits` are
    set in the message where that cut something off.
    """

    name: str
    value: Callable[[Row], float]
    unit_factor: float
    scale: float
    offset: float
    raw_low: int
    raw_high: int
    not_available: int
    start_bit: int
    mask: int
    flag_bits: int

    def raw(self, row: Row) -> tuple[int, bool]:
        """Raw value and whether it was cut off by more than rounding."""
        scaled = (self.value(row) * self.unit_factor - self.offset) / self.scale
        if math.isnan(scaled):
            return self.not_available, False
        if scaled >= self.raw_high:
            return self.raw_high, scaled > self.raw_high + 0.5
        if scaled <= self.raw_low:
            return self.raw_low, scaled < self.raw_low - 0.5
        return round(scaled), False


class OutputMessage(NamedTuple):
    """One message; `axis_flags` are the bits of DSZ_STATUS that gather an axis' other flags."""

    name: str
    can_id: int
    data_ids: bytes
    period_rows: int
    phase_rows: int
    fields: tuple[OutputField, ...]
    axis_flags: tuple[tuple[int, tuple[OutputField, ...]], ...]


def output_messages(
    messages: Sequence[Message], id_shift: int, e2e_data_id: int, period_ticks: int, status_period_ticks: int
) -> tuple[OutputMessage, ...]:
    """Plans of all messages, in the order of their ids, which is that of their priority on the bus."""
    plans: list[OutputMessage] = []
    by_signal: dict[str, OutputField] = {}
    status_count = 0
    for index, message in enumerate(messages):
        if message.name in _FAST_MESSAGES:
            period, phase = period_ticks, 0
        else:
            period, phase = status_period_ticks, status_count % status_period_ticks
            status_count += 1
        fields = _output_fields(message)
        by_signal |= {output.name: output for output in fields}
        can_id, data_ids = message.frame_id + id_shift, data_id_list(e2e_data_id, index)
        plans.append(OutputMessage(message.name, can_id, data_ids, period, phase, fields, ()))
    return tuple(
        plan._replace(axis_flags=_axis_flags(message, by_signal)) for plan, message in zip(plans, messages, strict=True)
    )


def _axis_flags(message: Message, by_signal: dict[str, OutputField]) -> tuple[tuple[int, tuple[OutputField, ...]], ...]:
    """Flags of DSZ_STATUS: an axis whose value, offset or spread is cut off in its own message."""
    if message.name != "DSZ_STATUS":
        return ()
    start = {signal.name: signal.start for signal in message.signals}
    return tuple(
        (1 << start[_FLAG_PREFIX + axis], tuple(by_signal[axis + part] for part in ("", "_OFFSET", "_STD")))
        for axis in AXES
    )


def _output_fields(message: Message) -> tuple[OutputField, ...]:
    flags = {s.name: 1 << s.start for s in message.signals if s.name.startswith(_FLAG_PREFIX)}
    return tuple(
        _output_field(signal, flags.get(_FLAG_PREFIX + signal.name, 0))
        for signal in message.signals
        if signal.name not in _E2E_SIGNALS and signal.name not in flags
    )


def _output_field(signal: Signal, flag_bits: int) -> OutputField:
    if signal.byte_order != "little_endian" or signal.minimum is None or signal.maximum is None:
        raise ValueError(f"signal {signal.name} must be Intel and have a range")
    named = {str(name): int(raw) for raw, name in (signal.choices or {}).items()}
    scale, offset = signal.conversion.scale, signal.conversion.offset
    raw_low = round((signal.minimum - offset) / scale)
    return OutputField(
        name=signal.name,
        value=SIGNALS[signal.name],
        unit_factor=UNIT_FACTORS[signal.unit or ""],
        scale=scale,
        offset=offset,
        raw_low=raw_low,
        raw_high=round((signal.maximum - offset) / scale),
        # Counters and enumerations can always be given: theirs is never used.
        not_available=named.get(NOT_AVAILABLE, raw_low),
        start_bit=signal.start,
        mask=(1 << signal.length) - 1,
        flag_bits=flag_bits,
    )
