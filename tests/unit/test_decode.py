"""Decode: every value by hand from bits and the formula of `mapping.Source`."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import asdict

import cantools
import pytest

from dsz_daemon.errors import ConfigError
from dsz_daemon.pipeline.decode import Decoder, RoleCounts
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.mapping import Part, Source

DEG = math.pi / 180.0
MESSAGE_ID = 0x123

HEADER = 'VERSION ""\nNS_ :\nBS_:\nBU_: X\n'


def messages_of(signals: str, tail: str = "", can_id: int = MESSAGE_ID, length: int = 8) -> dict:
    lines = "".join(f" SG_ {line.strip()} X\n" for line in signals.strip().splitlines())
    text = f"{HEADER}BO_ {can_id} M: {length} X\n{lines}\n{tail}\n"
    # Not strict, as for real DBCs: overlapping signals are common in them.
    return {m.name: m for m in cantools.database.load_string(text, strict=False).messages}


def source(*signals: str, role: str = "gyro_z", **more) -> Source:
    bounds = {"to_si": 1.0, "low": -math.inf, "high": math.inf} | more
    return Source(role, "M", tuple(Part(s) for s in signals), **bounds)


def frame(data: bytes, t_ns: int = 7, channel: str = "can0", can_id: int = MESSAGE_ID, **more) -> Frame:
    return Frame(t_ns, channel, can_id, data, **more)


def value_of(signals: str, data: bytes, wanted: Source, tail: str = "") -> float:
    (sample,) = Decoder([wanted], messages_of(signals, tail)).decode(frame(data))
    assert (sample.t_ns, sample.role) == (7, wanted.role)
    return sample.value


def counts_of(decoder: Decoder, role: str = "gyro_z") -> dict[str, int]:
    return {name: n for name, n in asdict(decoder.counters.roles[role]).items() if n}


# --- bits ---


@pytest.mark.parametrize(
    ("layout", "data", "expected"),
    [
        # Motorola, whole bytes: 0xFF38 = -200.
        ("7|16@0- (0.01,0)", "ff38", -2.0),
        ("7|16@0+ (0.01,0)", "ff38", 653.36),
        # Intel, whole bytes, the low byte first.
        ("0|16@1- (0.01,0)", "38ff", -2.0),
        # Intel, 12 bits from bit 4: -3 = 0xFFD, so the bytes are 0xD? 0xFF.
        ("4|12@1- (0.5,10)", "d7ff", 8.5),
        # Motorola, bits 5..0 of byte 0 and 7..4 of byte 1: 0b10_0000_0001 = 513 or 513 - 1024.
        ("5|10@0+ (1,0)", "e01f", 513.0),
        ("5|10@0- (1,0)", "e01f", -511.0),
        # One bit in the last byte.
        ("63|1@0+ (1,0)", "0000000000000080", 1.0),
        ("56|1@1+ (1,0)", "0000000000000001", 1.0),
        # All 64 bits.
        ("0|64@1- (1,0)", "feffffffffffffff", -2.0),
        ("7|64@0- (1,0)", "fffffffffffffffe", -2.0),
    ],
)
def test_bits_signs_and_byte_orders(layout: str, data: str, expected: float) -> None:
    payload = bytes.fromhex(data).ljust(8, b"\x00")
    assert value_of(f'S : {layout} [0|0] ""', payload, source("S")) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("layout", "kind", "packing"),
    [("0|32@1-", 1, "<f"), ("7|32@0-", 1, ">f"), ("0|64@1-", 2, "<d"), ("7|64@0-", 2, ">d")],
)
def test_ieee_floats_in_both_byte_orders(layout: str, kind: int, packing: str) -> None:
    tail = f"SIG_VALTYPE_ {MESSAGE_ID} S : {kind};"
    payload = struct.pack(packing, -1.5).ljust(8, b"\x00")
    assert value_of(f'S : {layout} (2,1) [0|0] ""', payload, source("S"), tail) == -2.0


def test_a_value_table_gives_numbers() -> None:
    tail = f'VAL_ {MESSAGE_ID} S 3 "Three" ;'
    assert value_of('S : 0|8@1+ (2,0) [0|0] ""', b"\x03".ljust(8), source("S"), tail) == 6.0


def test_overlapping_signals_are_read_each_on_its_own() -> None:
    signals = 'A : 0|16@1+ (1,0) [0|0] ""\nB : 8|16@1+ (1,0) [0|0] ""\nC : 15|16@0+ (1,0) [0|0] ""'
    data = bytes([1, 2, 3, 4, 5, 6, 7, 8])
    assert value_of(signals, data, source("A")) == 0x0201
    assert value_of(signals, data, source("B")) == 0x0302
    assert value_of(signals, data, source("C")) == 0x0203


# --- conversion ---


def test_adc_counts_of_the_papers_gyro() -> None:
    # ADW22307: 33683 counts * 76.3 uV = 2.5700129 V; (2.5700129 - 2.5) / 0.007 = 10.0018429 deg/s.
    wanted = source("ADC", volts_per_count=7.63e-5, null_volts=2.5, volts_per_unit=0.007, to_si=DEG)
    value = value_of('ADC : 7|16@0+ (1,0) [0|0] ""', struct.pack(">H", 33683).ljust(8), wanted)
    assert value == pytest.approx(10.0018429 * DEG, abs=1e-8)
    # At the null the reading is zero to half a count (0.0109 deg/s a count).
    null = value_of('ADC : 7|16@0+ (1,0) [0|0] ""', struct.pack(">H", 32765).ljust(8), wanted)
    assert abs(null) < 0.0055 * DEG


def test_the_sign_turns_the_whole_reading_of_an_adc() -> None:
    wanted = source("ADC", volts_per_count=0.001, null_volts=2.5, volts_per_unit=0.01, sign=-1.0)
    # 2600 mV: +10 units in the sensor's sense, so -10 in ours; the null is not turned.
    assert value_of('ADC : 7|16@0+ (1,0) [0|0] ""', struct.pack(">H", 2600).ljust(8), wanted) == (
        pytest.approx(-10.0, rel=1e-12)
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("layout", "packing", "first", "last"),
    [
        ('ADC : 7|16@0+ (1,0) [0|0] ""', ">H", 0, 0xFFFF),
        ('ADC : 0|16@1- (-2,5) [0|0] ""', "<h", -0x8000, 0x7FFF),
    ],
)
def test_an_adc_at_the_end_of_its_range_tells_nothing(
    layout: str, packing: str, first: int, last: int, sign: float
) -> None:
    """Clipped, torn off or shorted; the codes next to the ends are readings."""
    wanted = source("ADC", volts_per_count=7.63e-5, null_volts=2.5, volts_per_unit=0.007, sign=sign)
    decoder = Decoder([wanted], messages_of(layout))
    for counts, samples in ((first, 0), (last, 0), (first + 1, 1), (last - 1, 1)):
        assert len(decoder.decode(frame(struct.pack(packing, counts).ljust(8)))) == samples
    assert counts_of(decoder) == {"samples": 2, "out_of_range": 2}


def test_a_reading_in_si_has_no_rails() -> None:
    assert value_of('S : 7|16@0+ (1,0) [0|0] ""', b"\xff\xff".ljust(8), source("S")) == 65535.0


def test_a_sum_of_signals_like_toyotas_steering_wheel() -> None:
    signals = 'STEER_ANGLE : 3|12@0- (1.5,0) [0|0] ""\nSTEER_FRACTION : 39|4@0- (0.1,0) [0|0] ""'
    wanted = source("STEER_ANGLE", "STEER_FRACTION", role="steering_wheel_angle", to_si=DEG)
    # -20 * 1.5 + (-3) * 0.1 = -30.3 deg; -20 = 0xFEC, -3 = 0xD.
    assert value_of(signals, bytes.fromhex("0fec0000d0000000"), wanted) == pytest.approx(-30.3 * DEG)


def test_each_part_of_a_sum_has_its_sign() -> None:
    signals = 'A : 0|8@1+ (1,0) [0|0] ""\nB : 8|8@1+ (1,0) [0|0] ""'
    wanted = source()._replace(parts=(Part("A"), Part("B", -1.0)), sign=-1.0, to_si=2.0)
    assert value_of(signals, bytes([10, 3]).ljust(8), wanted) == -14.0


def test_a_wheel_in_rad_per_s_becomes_the_speed_of_its_rim() -> None:
    wanted = source("W", role="wheel_speed_fl", to_si=0.337)
    assert value_of('W : 0|16@1+ (0.01,0) [0|0] ""', struct.pack("<H", 5000).ljust(8), wanted) == (pytest.approx(16.85))


def test_a_forward_right_down_imu_is_turned_by_signs() -> None:
    """At rest such an IMU reads z = -1 g (down is along gravity); a left turn is negative to it."""
    signals = 'Y : 0|16@1- (0.001,0) [0|0] "g"\nZ : 16|16@1- (0.001,0) [0|0] "g"\nR : 32|16@1- (0.01,0) [0|0] ""'
    g = 9.80665
    sources = [
        source("Y", role="accel_y", to_si=g, sign=-1.0),
        source("Z", role="accel_z", to_si=g, sign=-1.0),
        source("R", role="gyro_z", to_si=DEG, sign=-1.0),
    ]
    # A left turn at +0.3 g to the left and 12 deg/s to the left, as the turned unit reports it.
    data = struct.pack("<hhh", -300, -1000, -1200).ljust(8)
    values = {s.role: s.value for s in Decoder(sources, messages_of(signals)).decode(frame(data))}
    assert values == pytest.approx({"accel_y": 0.3 * g, "accel_z": g, "gyro_z": 12.0 * DEG})


@pytest.mark.parametrize(
    ("raw", "on_values", "expected"), [(0, (), 0.0), (2, (), 1.0), (2, (2.0, 3.0), 1.0), (1, (2.0, 3.0), 0.0)]
)
def test_a_switch_is_one_or_zero(raw: int, on_values: tuple[float, ...], expected: float) -> None:
    wanted = source("S", role="brake", is_switch=True, on_values=on_values)
    assert value_of('S : 0|8@1+ (1,0) [0|0] ""', bytes([raw]).ljust(8), wanted) == expected


# --- multiplexing ---

SIMPLE_MUX = 'MUX M : 0|8@1+ (1,0) [0|0] ""\nA m1 : 8|8@1+ (1,0) [0|0] ""\nB m2 : 8|8@1+ (1,0) [0|0] ""'


def test_a_multiplexed_signal_is_taken_from_its_pages_only() -> None:
    decoder = Decoder([source("B")], messages_of(SIMPLE_MUX))
    assert [s.value for s in decoder.decode(frame(bytes([2, 55]).ljust(8)))] == [55.0]
    assert not decoder.decode(frame(bytes([1, 55]).ljust(8)))
    assert not decoder.decode(frame(bytes([9, 55]).ljust(8)))
    assert counts_of(decoder) == {"samples": 1, "not_present": 2}
    assert decoder.counters.rejected == 0


def test_an_unknown_page_does_not_cost_the_plain_signals() -> None:
    signals = SIMPLE_MUX + '\nPLAIN : 16|8@1+ (1,0) [0|0] ""'
    assert value_of(signals, bytes([77, 0, 42]).ljust(8), source("PLAIN")) == 42.0


def test_a_short_page_without_the_signal_is_no_fault() -> None:
    signals = SIMPLE_MUX + '\nLONG m3 : 48|16@1+ (1,0) [0|0] ""'
    decoder = Decoder([source("LONG")], messages_of(signals))
    decoder.decode(frame(bytes([1, 0])))
    decoder.decode(frame(bytes([3, 0])))
    decoder.decode(frame(b""))
    assert counts_of(decoder) == {"not_present": 1, "short": 2}


def test_extended_multiplexing_needs_every_level() -> None:
    signals = """
        OUTER M : 0|4@1+ (1,0) [0|0] ""
        INNER m1M : 4|4@1+ (1,0) [0|0] ""
        DEEP m3 : 8|8@1+ (1,0) [0|0] ""
    """
    tail = f"SG_MUL_VAL_ {MESSAGE_ID} INNER OUTER 1-1;\nSG_MUL_VAL_ {MESSAGE_ID} DEEP INNER 3-3, 5-6;"
    decoder = Decoder([source("DEEP")], messages_of(signals, tail))
    # Low nibble: OUTER, high nibble: INNER.
    for first, present in ((0x31, True), (0x51, True), (0x61, True), (0x41, False), (0x32, False)):
        assert bool(decoder.decode(frame(bytes([first, 9]).ljust(8)))) is present
    assert counts_of(decoder) == {"samples": 3, "not_present": 2}


# --- what is not used, and is counted ---


def test_a_short_frame_still_gives_the_signals_that_fit() -> None:
    signals = 'A : 0|16@1+ (1,0) [0|0] ""\nB : 16|16@1+ (1,0) [0|0] ""\nC : 23|16@0+ (1,0) [0|0] ""'
    sources = [source("A", role="accel_x"), source("B", role="accel_y"), source("C", role="accel_z")]
    decoder = Decoder(sources, messages_of(signals))
    assert [(s.role, s.value) for s in decoder.decode(frame(b"\x01\x02\x03"))] == [("accel_x", 0x0201)]
    assert counts_of(decoder, "accel_y") == counts_of(decoder, "accel_z") == {"short": 1}
    assert decoder.counters.messages["M"].wrong_length == 1
    assert decoder.counters.rejected == 2
    assert len(decoder.decode(frame(b"\x01\x02\x03\x04"))) == 3


def test_bytes_beyond_the_message_are_ignored() -> None:
    decoder = Decoder([source("S")], messages_of('S : 7|16@0+ (1,0) [0|0] ""', length=2))
    (sample,) = decoder.decode(frame(bytes([1, 2]) + b"\xff" * 62, is_fd=True))
    assert sample.value == 0x0102
    assert decoder.counters.messages["M"].wrong_length == 1


def test_bounds_are_inclusive() -> None:
    decoder = Decoder([source("S", low=-2.0, high=5.0)], messages_of('S : 0|8@1- (1,0) [0|0] ""'))
    given = [-3, -2, 0, 5, 6]
    got = [s.value for v in given for s in decoder.decode(frame(struct.pack("b", v).ljust(8)))]
    assert got == [-2.0, 0.0, 5.0]
    assert counts_of(decoder) == {"samples": 3, "out_of_range": 2}


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("is_switch", [False, True])
def test_nan_and_infinity_never_pass(bad: float, is_switch: bool) -> None:
    tail = f"SIG_VALTYPE_ {MESSAGE_ID} S : 1;"
    decoder = Decoder([source("S", is_switch=is_switch)], messages_of('S : 0|32@1- (1,0) [0|0] ""', tail))
    assert not decoder.decode(frame(struct.pack("<f", bad).ljust(8)))
    assert counts_of(decoder) == {"not_a_number": 1}


def test_an_overflow_of_the_scaling_is_no_number() -> None:
    tail = f"SIG_VALTYPE_ {MESSAGE_ID} S : 2;"
    decoder = Decoder([source("S")], messages_of('S : 0|64@1- (1000,0) [0|0] ""', tail))
    assert not decoder.decode(frame(struct.pack("<d", 1e307)))
    assert counts_of(decoder) == {"not_a_number": 1}


def test_a_value_that_is_not_vouched_for_is_flagged() -> None:
    signals = 'S : 0|8@1+ (1,0) [0|0] ""\nOK : 8|2@1+ (1,0) [0|0] ""'
    wanted = source("S", valid_signal="OK", valid_values=(1.0, 3.0))
    decoder = Decoder([wanted], messages_of(signals))
    used = [bool(decoder.decode(frame(bytes([7, ok]).ljust(8)))) for ok in range(4)]
    assert used == [False, True, False, True]
    assert counts_of(decoder) == {"samples": 2, "flagged": 2}
    decoder.decode(frame(bytes([7])))
    assert counts_of(decoder)["short"] == 1


# --- frames that are not ours to read ---

ONE_SIGNAL = 'S : 0|8@1+ (1,0) [0|0] ""'


def test_standard_and_extended_ids_of_the_same_number_are_different() -> None:
    extended = messages_of(ONE_SIGNAL, can_id=MESSAGE_ID | 0x80000000)
    decoder = Decoder([source("S")], extended)
    assert decoder.wanted_ids() == {(MESSAGE_ID, True)}
    assert not decoder.decode(frame(bytes(8)))
    assert len(decoder.decode(frame(bytes(8), is_extended=True))) == 1
    assert decoder.counters.unwanted == 1


def test_frames_that_look_like_those_of_a_message_are_counted_beside_it() -> None:
    decoder = Decoder([source("A", channel="can0")], messages_of('A : 0|8@1+ (1,0) [0|0] ""'))
    wide = {"is_extended": True}
    for n, more in enumerate([wide, wide, wide, {"channel": "can3"}, {"channel": "can4"}]):
        assert not decoder.decode(frame(b"\1", n, **more))
    decoder.decode(frame(b"\1", 9, can_id=MESSAGE_ID + 1))
    counts = decoder.counters.messages["M"]
    assert (counts.frames, counts.other_width, counts.elsewhere, counts.elsewhere_on) == (0, 3, 2, "can3")
    assert decoder.counters.unwanted == 6
    assert counts.near_misses(is_extended=False) == [
        "3 frames have its id as extended (29 bit), the DBC as standard (11 bit)",
        "2 frames of it came on can3, where it is not looked for",
    ]
    assert "as standard (11 bit), the DBC as extended" in counts.near_misses(is_extended=True)[0]


def test_remote_error_and_unknown_frames_are_counted() -> None:
    decoder = Decoder([source("S")], messages_of(ONE_SIGNAL))
    assert not decoder.decode(frame(b"", is_remote=True, remote_length=8))
    assert not decoder.decode(frame(bytes(8), is_error=True))
    assert not decoder.decode(frame(bytes(8), can_id=0x124))
    seen = decoder.counters
    assert (seen.frames, seen.remote, seen.error_frames, seen.unwanted) == (3, 1, 1, 1)
    assert seen.messages["M"].frames == 0
    assert seen.samples == seen.rejected == 0


def test_our_own_frames_never_become_samples() -> None:
    decoder = Decoder([source("S")], messages_of(ONE_SIGNAL), excluded_ids={(MESSAGE_ID, False)})
    assert not decoder.decode(frame(bytes(8)))
    assert decoder.counters.own == 1
    assert decoder.wanted_ids() == frozenset()


def test_a_channel_filter() -> None:
    decoder = Decoder([source("S", channel="can1")], messages_of(ONE_SIGNAL))
    assert decoder.channels == {"can1"}
    assert not decoder.decode(frame(bytes(8), channel="can0"))
    assert len(decoder.decode(frame(bytes(8), channel="can1"))) == 1
    assert (decoder.counters.unwanted, decoder.counters.ambiguous) == (1, 0)


def test_the_same_id_on_two_channels_can_feed_two_roles() -> None:
    sources = [
        source("S", role="gyro_z", channel="can0"),
        source("S", role="yaw_rate_reference", channel="can1"),
    ]
    decoder = Decoder(sources, messages_of(ONE_SIGNAL))
    got = [s for c in ("can0", "can1") for s in decoder.decode(frame(bytes([len(c)]).ljust(8), channel=c))]
    assert [s.role for s in got] == ["gyro_z", "yaw_rate_reference"]


def test_without_a_channel_the_first_one_seen_is_kept() -> None:
    decoder = Decoder([source("S")], messages_of(ONE_SIGNAL))
    used = [bool(decoder.decode(frame(bytes(8), channel=c))) for c in ("can2", "can0", "can2")]
    assert used == [True, False, True]
    assert decoder.counters.ambiguous == 1
    assert decoder.counters.messages["M"].channel == "can2"
    assert decoder.channels == frozenset()


def test_two_dbcs_may_describe_the_same_id_on_different_channels() -> None:
    first = messages_of('A : 0|8@1+ (1,0) [0|0] ""')["M"]
    second = messages_of('B : 8|8@1+ (1,0) [0|0] ""')["M"]
    sources = [
        source("A", role="gyro_x", channel="can0"),
        source("B", role="gyro_y", channel="can1")._replace(message="N"),
    ]
    decoder = Decoder(sources, {"M": first, "N": second})
    got = [s for c in ("can0", "can1") for s in decoder.decode(frame(bytes([5, 6]).ljust(8), channel=c))]
    assert [(s.role, s.value) for s in got] == [("gyro_x", 5.0), ("gyro_y", 6.0)]


# --- counters and faults ---


def test_counters_are_a_value_that_looking_does_not_change() -> None:
    decoder = Decoder([source("S")], messages_of(ONE_SIGNAL))
    decoder.decode(frame(bytes(8), t_ns=11))
    before = decoder.counters
    decoder.counters.roles["gyro_z"].samples = 99
    decoder.decode(frame(bytes(8), t_ns=12))
    assert before.roles["gyro_z"] == RoleCounts(samples=1)
    assert before.messages["M"].last_t_ns == 11
    assert decoder.counters.roles["gyro_z"].samples == 2
    assert decoder.counters.messages["M"].last_t_ns == 12
    assert json.loads(json.dumps(asdict(before)))["roles"]["gyro_z"]["samples"] == 1


def test_all_faults_of_a_mapping_at_once() -> None:
    sources = [
        source("NOPE", role="gyro_x"),
        source("S", role="gyro_y")._replace(message="OTHER"),
        source("S", role="gyro_z", valid_signal="OK"),
        source("S", role="accel_x"),
        source("S", role="accel_x"),
    ]
    with pytest.raises(ConfigError) as caught:
        Decoder(sources, messages_of(ONE_SIGNAL))
    text = str(caught.value)
    assert len(caught.value.faults) == 4
    for part in (
        "gyro_x: message 'M' has no signal 'NOPE'",
        "'OTHER' is not in the DBC",
        "'OK'",
        "mapped twice",
    ):
        assert part in text
