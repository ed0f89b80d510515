"""Encode: hand values, saturation, "not available", schedule, and E2E against a CRC written here."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from itertools import combinations
from pathlib import Path

import cantools
import pytest

from dsz_daemon.core.outputs import ChannelOutput, ChannelState, Reason, StepOutput
from dsz_daemon.errors import ConfigError
from dsz_daemon.pipeline.e2e_protection import data_id_list, is_intact
from dsz_daemon.pipeline.encode import Encoder
from dsz_daemon.pipeline.rows import Counters, Row
from dsz_daemon.shipped import shipped
from dsz_daemon.signals import IMU_CHANNELS

DEG = math.pi / 180.0
NAN = math.nan
DATABASE = cantools.database.load_file(shipped("dbc/dsz.dbc"))


def channel(compensated: float = 0.0, **more) -> ChannelOutput:
    usual = {
        "raw": NAN,
        "offset": 0.0,
        "offset_std": 0.0,
        "state": ChannelState.HOLDING,
        "gate": False,
        "reason": Reason.NONE,
    }
    return ChannelOutput(compensated=compensated, **(usual | more))


def row_of(t_ns: int = 5, ages_s: dict | None = None, counters: Counters | None = None, **output) -> Row:
    numbers = dict.fromkeys(StepOutput._fields, 0.0) | {"standstill": False}
    channels = {name: channel() for name in IMU_CHANNELS}
    step = StepOutput(**(numbers | channels | output))
    return Row(t_ns, step, {}, ages_s or {}, counters or Counters())


def encoded(row: Row, **settings) -> dict[str, bytes]:
    """Every message of one row by name."""
    frames = Encoder(DATABASE, status_period_ticks=1, **settings).encode(row)
    assert len(frames) == len(DATABASE.messages)
    return {DATABASE.get_message_by_frame_id(f.can_id).name: f.data for f in frames}


def decoded(row: Row) -> dict[str, dict]:
    return {name: DATABASE.decode_message(name, data) for name, data in encoded(row).items()}


# --- values ---


def test_rates_bit_by_bit() -> None:
    """0.1 rad/s = 5.7296 deg/s = 573 LSB = 0x023D; -1 deg/s = -100 LSB = 0xFF9C; Intel: low byte first."""
    data = encoded(row_of(gyro_x=channel(0.1), gyro_y=channel(-DEG), gyro_z=channel(0.0)))["DSZ_RATES"]
    assert data[2:].hex(" ") == "3d 02 9c ff 00 00"
    assert data[1] == 0x01  # no flag, first counter


def test_accelerations_bit_by_bit() -> None:
    """9.80665 m/s^2 / 0.002 = 4903.3 = 0x1327; -1 m/s^2 = -500 LSB = 0xFE0C."""
    data = encoded(row_of(accel_x=channel(-1.0), accel_z=channel(9.80665)))["DSZ_ACCEL"]
    assert data[2:].hex(" ") == "0c fe 00 00 27 13"


def test_each_axis_has_its_own_place() -> None:
    """Six different values in each of the axis messages, read back by cantools."""
    outputs = {
        name: channel(
            k * DEG if k <= 3 else float(k),
            offset=-k * DEG / 10 if k <= 3 else -k / 10,
            offset_std=k * DEG / 100 if k <= 3 else k / 100,
            state=ChannelState(k % 4),
            gate=k % 2 == 0,
            reason=Reason(2 * k),
        )
        for k, name in enumerate(IMU_CHANNELS, start=1)
    }
    messages = decoded(row_of(**outputs))
    everything = {name: value for message in messages.values() for name, value in message.items()}
    states = {0: "invalid", 1: "holding", 2: "learning", 3: "converged"}
    reasons = {
        1: "stale", 2: "speed_varies", 3: "steering_large", 4: "turning", 5: "no_steering", 6: "wheels_slip"
    }  # fmt: skip
    for k, axis in enumerate(("P", "Q", "R", "AX", "AY", "AZ"), start=1):
        assert everything[axis] == pytest.approx(k)
        assert everything[f"{axis}_OFFSET"] == pytest.approx(-k / 10)
        assert everything[f"{axis}_STD"] == pytest.approx(k / 100)
        assert everything[f"STATE_{axis}"] == states[k % 4]
        assert everything[f"GATE_{axis}"] == (k % 2 == 0)
        assert everything[f"REASON_{axis}"] == reasons[k]


def test_motion_ages_and_counters() -> None:
    row = row_of(
        speed_mps=-2.5,
        sideslip_rad=0.02,
        road_wheel_angle_rad=-0.3,
        standstill=True,
        ages_s={"gyro_z": 0.004, "accel_x": 0.0213, "wheel_speed_rl": 0.5, "road_wheel_angle": 0.012, "brake": 9.0},
        counters=Counters(frames=70000, rejected=3, missed_ticks=4, gaps=5, clock_steps=6),
    )
    messages = decoded(row)
    speed = messages["DSZ_SPEED"]
    assert speed["SPEED"] == pytest.approx(-9.0)
    assert speed["SIDESLIP"] == pytest.approx(math.degrees(0.02), abs=0.0025)
    assert speed["ROAD_WHEEL_ANGLE"] == pytest.approx(math.degrees(-0.3), abs=0.0025)
    assert messages["DSZ_STATUS"]["STANDSTILL"] == 1
    inputs = messages["DSZ_INPUTS"]
    assert [inputs[f"AGE_{g}"] for g in ("IMU", "WHEELS", "STEERING")] == pytest.approx([21.3, 500.0, 12.0])
    counters, timing = messages["DSZ_COUNTERS"], messages["DSZ_TIMING"]
    assert (counters["FRAMES"], counters["REJECTED"]) == (70000, 3)
    assert (timing["MISSED_TICKS"], timing["GAPS"], timing["CLOCK_STEPS"]) == (4, 5, 6)


# --- what can't be given, what does not fit ---


def test_nan_is_not_available_and_no_fault() -> None:
    lost = channel(NAN, offset=NAN, offset_std=NAN, state=ChannelState.INVALID, reason=Reason.NOT_MAPPED)
    row = row_of(gyro_y=lost, accel_z=lost, speed_mps=NAN, sideslip_rad=NAN, road_wheel_angle_rad=NAN)
    messages = decoded(row)
    everything = {name: value for message in messages.values() for name, value in message.items()}
    lost_names = {f"{axis}{part}" for axis in ("Q", "AZ") for part in ("", "_OFFSET", "_STD")}
    lost_names |= {"SPEED", "SIDESLIP", "ROAD_WHEEL_ANGLE", "AGE_IMU", "AGE_WHEELS", "AGE_STEERING"}
    assert {name for name, value in everything.items() if value == "not_available"} == lost_names
    assert not any(value for name, value in everything.items() if name.startswith("SATURATED"))
    # The reserved values that the DBC and the documentation promise.
    assert encoded(row)["DSZ_RATES"][4:6] == b"\x00\x80"
    assert encoded(row)["DSZ_RATE_SPREADS"][4:6] == b"\xff\xff"


@pytest.mark.parametrize(
    ("rate_degps", "shown", "flag"),
    [
        (327.67, 327.67, 0),
        (327.674, 327.67, 0),  # rounding, nothing cut off
        (327.68, 327.67, 1),
        (1e9, 327.67, 1),
        (math.inf, 327.67, 1),
        (-327.67, -327.67, 0),
        (-327.674, -327.67, 0),
        (-327.676, -327.67, 1),  # rounding it would give -32768, which means "not available"
        (-327.68, -327.67, 1),
        (-math.inf, -327.67, 1),
    ],
)
def test_saturation_shows_the_end_of_the_range_and_a_flag(rate_degps: float, shown: float, flag: int) -> None:
    row = row_of(gyro_x=channel(1 * DEG), gyro_y=channel(rate_degps * DEG), gyro_z=channel(-2 * DEG))
    rates = decoded(row)["DSZ_RATES"]
    assert rates["Q"] == pytest.approx(shown)
    # Its neighbours don't notice.
    assert (rates["P"], rates["R"]) == pytest.approx((1.0, -2.0))
    assert [rates[f"SATURATED_{axis}"] for axis in "PQR"] == [0, flag, 0]
    assert decoded(row)["DSZ_STATUS"]["SATURATED_Q"] == flag


def test_the_status_gathers_the_flags_of_an_axis() -> None:
    row = row_of(gyro_x=channel(offset=40 * DEG), accel_y=channel(offset_std=math.inf), accel_z=channel(-70.0))
    messages = decoded(row)
    status = messages["DSZ_STATUS"]
    assert [status[f"SATURATED_{a}"] for a in ("P", "Q", "R", "AX", "AY", "AZ")] == [1, 0, 0, 0, 1, 1]
    assert messages["DSZ_RATE_OFFSETS"]["SATURATED_P_OFFSET"] == 1
    assert messages["DSZ_RATES"]["SATURATED_P"] == 0


def test_counters_and_ages_stay_at_their_end() -> None:
    row = row_of(
        ages_s={"gyro_x": 60.0, "wheel_speed_fl": -0.5},
        counters=Counters(frames=2**33, rejected=65535, missed_ticks=65536, gaps=0, clock_steps=10**12),
    )
    messages = decoded(row)
    counters, timing, inputs = messages["DSZ_COUNTERS"], messages["DSZ_TIMING"], messages["DSZ_INPUTS"]
    assert (counters["FRAMES"], counters["SATURATED_FRAMES"]) == (2**32 - 1, 1)
    assert (counters["REJECTED"], counters["SATURATED_REJECTED"]) == (65535, 0)
    assert (timing["MISSED_TICKS"], timing["SATURATED_MISSED_TICKS"]) == (65535, 1)
    assert (timing["CLOCK_STEPS"], timing["SATURATED_CLOCK_STEPS"]) == (65535, 1)
    assert (inputs["AGE_IMU"], inputs["SATURATED_AGE_IMU"]) == (pytest.approx(6553.4), 1)
    assert (inputs["AGE_WHEELS"], inputs["SATURATED_AGE_WHEELS"]) == (0.0, 1)


def test_saturated_values_are_counted_by_signal() -> None:
    encoder = Encoder(DATABASE)
    for rate in (400 * DEG, 0.0, -400 * DEG):
        encoder.encode(row_of(gyro_x=channel(rate)))
    assert encoder.counters == {"DSZ_RATES.P": 2}


# --- when, where, under which id ---


def test_frames_carry_the_rows_time_the_channel_and_the_ids() -> None:
    encoder = Encoder(DATABASE, channel="vehicle", status_period_ticks=1)
    frames = encoder.encode(row_of(t_ns=1234))
    assert {(f.t_ns, f.channel, len(f.data), f.is_extended) for f in frames} == {(1234, "vehicle", 8, False)}
    assert [f.can_id for f in frames] == list(range(0x6D0, 0x6DC))
    assert encoder.published_ids == {(i, False) for i in range(0x6D0, 0x6DC)}


def test_another_base_id_moves_all_messages() -> None:
    encoder = Encoder(DATABASE, base_id=0x18FF0000, extended=True)
    assert encoder.published_ids == {(0x18FF0000 + k, True) for k in range(12)}
    assert {(f.can_id, f.is_extended) for f in encoder.encode(row_of())} <= encoder.published_ids


def test_rates_every_period_and_the_status_messages_one_by_one() -> None:
    encoder = Encoder(DATABASE, period_ticks=2, status_period_ticks=10)
    sent = [[f.can_id - 0x6D0 for f in encoder.encode(row_of())] for _ in range(20)]
    assert [0 in ids and 1 in ids for ids in sent] == [True, False] * 10
    status = [[k for k in ids if k >= 2] for ids in sent]
    assert status == [[2 + k] for k in range(10)] * 2


def test_settings_out_of_range_are_all_named_at_once() -> None:
    with pytest.raises(ConfigError) as caught:
        Encoder(DATABASE, base_id=0x7F8, e2e_data_id=300, period_ticks=0, status_period_ticks=0)
    where = [fault.where for fault in caught.value.faults]
    assert where == ["output.base_id", "output.e2e_data_id", "output.period_ticks", "output.status_period_ticks"]
    assert "0x7F8..0x803" in str(caught.value)
    assert "0..0x7FF" in str(caught.value)


# --- end-to-end protection ---


def crc8_h2f(data: bytes) -> int:
    """AUTOSAR CRC library: CRC-8 0x2F, polynomial 0x2F, start 0xFF, final XOR 0xFF, not reflected."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ 0x2F if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


def test_the_crc_of_this_test_is_autosars() -> None:
    # The check values that the specification of the CRC routines lists for 0x2F.
    assert crc8_h2f(b"123456789") == 0xDF
    assert crc8_h2f(bytes(4)) == 0x12
    assert crc8_h2f(bytes.fromhex("f20183")) == 0xC2


def test_profile_2_of_every_message() -> None:
    """CRC over bytes 1..7 and the message's Data ID; the counter starts at 1 and wraps after 15."""
    encoder = Encoder(DATABASE, status_period_ticks=1, e2e_data_id=0xFA)
    for n in range(40):
        frames = encoder.encode(row_of(gyro_x=channel(0.01 * n)))
        for k, frame in enumerate(frames):
            assert frame.data[1] & 0x0F == (n + 1) % 16
            assert frame.data[0] == crc8_h2f(frame.data[1:] + bytes([(0xFA + k) % 256]))


def test_a_message_under_anothers_id_is_not_intact() -> None:
    messages = encoded(row_of())
    for k, data in enumerate(messages.values()):
        assert [j for j in range(12) if is_intact(data, data_id_list(0x40, j))] == [k]
    assert not is_intact(b"\x00", data_id_list(0x40, 0))


def test_up_to_three_flipped_bits_never_pass() -> None:
    """All 43,744 of them, as docs/decisions/0005 claims for a Data ID that does not vary."""
    data_ids = data_id_list(0x40, 0)
    data = int.from_bytes(encoded(row_of(gyro_x=channel(0.123)))["DSZ_RATES"], "little")
    for width in (1, 2, 3):
        for bits in combinations(range(64), width):
            broken = data
            for bit in bits:
                broken ^= 1 << bit
            assert not is_intact(broken.to_bytes(8, "little"), data_ids), bits


# --- state, and the documents ---


def test_looking_at_the_state_changes_nothing() -> None:
    encoder = Encoder(DATABASE)
    encoder.encode(row_of())
    state = encoder.state
    state.e2e_counters["DSZ_RATES"] = 9
    encoder.counters["X"] = 1
    assert encoder.state.e2e_counters["DSZ_RATES"] == 1
    assert encoder.counters == {}
    assert json.loads(json.dumps(asdict(encoder.state)))["rows"] == 1


def test_value_tables_are_the_enumerations() -> None:
    def table(message: str, signal: str) -> dict[int, str]:
        choices = DATABASE.get_message_by_name(message).get_signal_by_name(signal).choices
        return {int(raw): str(name) for raw, name in choices.items()}

    for axis in ("P", "Q", "R", "AX", "AY", "AZ"):
        assert table("DSZ_STATUS", f"STATE_{axis}") == {s.value: s.name.lower() for s in ChannelState}
        assert table("DSZ_REASONS", f"REASON_{axis}") == {r.value: r.name.lower() for r in Reason}


def test_every_signal_is_explained_and_every_measure_can_be_missing() -> None:
    for message in DATABASE.messages:
        assert message.length == 8
        assert message.comment
        assert message.cycle_time in (10, 100)
        for signal in message.signals:
            assert signal.comment, signal.name
            if signal.unit:
                names = {str(name) for name in signal.choices.values()}
                assert names == {"not_available"}, signal.name


def test_the_tables_of_the_documentation_are_the_dbc() -> None:
    document = Path(__file__).parents[2] / "docs" / "output_messages.md"
    lines = document.read_text(encoding="utf-8").splitlines()
    for k, message in enumerate(sorted(DATABASE.messages, key=lambda m: m.frame_id)):
        assert message.frame_id == 0x6D0 + k
        assert any(line.startswith(f"### `{message.name}` (0x{message.frame_id:X}") for line in lines)
        for s in message.signals:
            if s.name.startswith(("E2E_", "SATURATED_", "STATE_", "GATE_", "REASON_", "STANDSTILL")):
                continue
            span = f"{s.minimum:.10g} .. {s.maximum:.10g}"
            expected = f"| `{s.name}` | {s.start}, {s.length} | {s.scale:g} | {s.unit or ''} | {span} |"
            assert any(line.startswith(expected) for line in lines), expected
