"""Rows to CAN frames, by dbc/dsz.dbc: saturating, with flags, protected end to end.

A value outside of its signal's range is sent as the end of the range and flagged; NaN is sent as the
raw value that the DBC names "not_available". docs/output_messages.md shows the messages.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from cantools.database import Database

from dsz_daemon.errors import ConfigError, Fault
from dsz_daemon.pipeline.e2e_protection import next_counter, protected
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.output_layout import OutputMessage, output_messages
from dsz_daemon.pipeline.rows import Row

DEFAULT_BASE_ID = 0x6D0
DEFAULT_E2E_DATA_ID = 0x40


@dataclass(slots=True)
class EncoderState:
    """All that an encoder remembers; plain values, so that it can be saved and handed back.

    `rows` counts the rows encoded, `e2e_counters` holds the alive counter last sent by message,
    `saturated` counts the values sent as the end of their range by `MESSAGE.SIGNAL`.
    """

    rows: int = 0
    e2e_counters: dict[str, int] = field(default_factory=dict)
    saturated: dict[str, int] = field(default_factory=dict)

    def copy(self) -> EncoderState:
        """Return an equal value that shares nothing with this one."""
        return replace(self, e2e_counters=dict(self.e2e_counters), saturated=dict(self.saturated))


class Encoder:
    """Encodes each row into the messages that are due.

    `database` is that of dbc/dsz.dbc, whose lowest id is moved to `base_id` and the others with it;
    ids are 29 bits wide where `extended`. Rates and accelerations are due every `period_ticks` rows;
    each of the other messages every `status_period_ticks`, one after the other and not all in one
    row, so that they never hold the bus for long. `e2e_data_id` is the Data ID of the
    first message, the others follow. `state` is that of an earlier encoder: resuming from it equals never having
    stopped.

    Raises ConfigError, with every fault, for ids, periods and Data IDs outside of their range.
    """

    def __init__(
        self,
        database: Database,
        base_id: int = DEFAULT_BASE_ID,
        extended: bool = False,
        channel: str = "can0",
        e2e_data_id: int = DEFAULT_E2E_DATA_ID,
        period_ticks: int = 1,
        status_period_ticks: int = 10,
        state: EncoderState | None = None,
    ) -> None:
        messages = sorted(database.messages, key=lambda message: message.frame_id)
        id_shift = base_id - messages[0].frame_id
        last_id = messages[-1].frame_id + id_shift
        _check_settings(base_id, last_id, extended, e2e_data_id, period_ticks, status_period_ticks)
        self._extended = extended
        self._channel = channel
        self._messages = output_messages(messages, id_shift, e2e_data_id, period_ticks, status_period_ticks)
        self._state = state.copy() if state is not None else EncoderState()
        for message in self._messages:
            self._state.e2e_counters.setdefault(message.name, 0)

    @property
    def state(self) -> EncoderState:
        """What the encoder remembers: a copy, which later rows don't change."""
        return self._state.copy()

    @property
    def counters(self) -> dict[str, int]:
        """Values sent as the end of their range, by `MESSAGE.SIGNAL`; a copy."""
        return dict(self._state.saturated)

    @property
    def published_ids(self) -> frozenset[tuple[int, bool]]:
        """(CAN id, is extended) of all messages: what the decoder must never take for input."""
        return frozenset((message.can_id, self._extended) for message in self._messages)

    def encode(self, row: Row) -> list[Frame]:
        """Frames that are due at this row, stamped with its time."""
        rows = self._state.rows
        self._state.rows = rows + 1
        return [
            Frame(row.t_ns, self._channel, message.can_id, self._data(message, row), self._extended)
            for message in self._messages
            if rows % message.period_rows == message.phase_rows
        ]

    def _data(self, message: OutputMessage, row: Row) -> bytes:
        bits = 0
        for output in message.fields:
            raw, is_cut = output.raw(row)
            bits |= (raw & output.mask) << output.start_bit
            if is_cut:
                bits |= output.flag_bits
                key = f"{message.name}.{output.name}"
                self._state.saturated[key] = self._state.saturated.get(key, 0) + 1
        for flag_bits, gathered in message.axis_flags:
            if any(output.raw(row)[1] for output in gathered):
                bits |= flag_bits
        counter = next_counter(self._state.e2e_counters[message.name])
        self._state.e2e_counters[message.name] = counter
        return protected(bits, counter, message.data_ids)


def _check_settings(
    base_id: int, last_id: int, extended: bool, e2e_data_id: int, period_ticks: int, status_period_ticks: int
) -> None:
    highest = 0x1FFFFFFF if extended else 0x7FF
    faults = []
    if base_id < 0 or last_id > highest:
        what = f"0x{base_id:X}..0x{last_id:X} does not fit, expected 0..0x{highest:X}"
        faults.append(Fault("output.base_id", what))
    if not 0 <= e2e_data_id <= 255:
        faults.append(Fault("output.e2e_data_id", f"{e2e_data_id} is out of range, expected 0..255"))
    for key, ticks in (("period_ticks", period_ticks), ("status_period_ticks", status_period_ticks)):
        if ticks < 1:
            faults.append(Fault(f"output.{key}", f"{ticks} is out of range, expected 1 or more"))
    if faults:
        raise ConfigError("the output can't be set up", faults)
