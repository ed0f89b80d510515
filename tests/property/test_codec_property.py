"""The codec against cantools, both ways, for layouts and values that nobody thought of."""

from __future__ import annotations

import math
import struct
from dataclasses import asdict

import cantools
from cantools.database.can import Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dsz_daemon.core.outputs import ChannelOutput, ChannelState, Reason, StepOutput
from dsz_daemon.pipeline.bit_fields import bit_field, reader
from dsz_daemon.pipeline.decode import Decoder
from dsz_daemon.pipeline.encode import Encoder
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.mapping import Part, Source
from dsz_daemon.pipeline.rows import Counters, Row
from dsz_daemon.shipped import shipped
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

DATABASE = cantools.database.load_file(shipped("dbc/dsz.dbc"))

# Drawing whole messages and rows takes longer than running the code; a busy machine must not fail a test.
unhurried = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])

# --- decode: any layout ---


def bits_of(signal: Signal) -> set[tuple[int, int]]:
    """(byte, bit) of every bit of a signal, counted one by one."""
    bits = set()
    position = signal.start
    for _ in range(signal.length):
        bits.add((position // 8, position % 8))
        if signal.byte_order == "little_endian":
            position += 1
        else:  # down to bit 0, then to bit 7 of the next byte
            position += -1 if position % 8 else 15
    return bits


@st.composite
def signals(draw: st.DrawFn, name: str, length_bytes: int) -> Signal | None:
    """A signal somewhere in a message; None where it would stick out."""
    is_float = draw(st.integers(0, 4)) == 0
    length = draw(st.sampled_from([16, 32, 64]) if is_float else st.integers(1, 64))
    conversion = BaseConversion.factory(
        scale=draw(st.sampled_from([1, 2, -1, 0.1, 0.01, 7.63e-5, 0.03125, -0.5])),
        offset=draw(st.sampled_from([0, 0, 5, -40, 0.125, -327.68])),
        choices=None,
        is_float=is_float,
    )
    signal = Signal(
        name,
        start=draw(st.integers(0, 8 * length_bytes - 1)),
        length=length,
        byte_order=draw(st.sampled_from(["little_endian", "big_endian"])),
        is_signed=draw(st.booleans()),
        conversion=conversion,
    )
    return signal if max(byte for byte, _ in bits_of(signal)) < length_bytes else None


@st.composite
def layouts(draw: st.DrawFn) -> Message:
    """A message of signals that do not overlap (cantools can't do those that do)."""
    length_bytes = draw(st.sampled_from([2, 3, 8, 8, 8, 64]))
    taken: set[tuple[int, int]] = set()
    kept = []
    for n in range(draw(st.integers(1, 8))):
        signal = draw(signals(f"S{n}", length_bytes))
        if signal is not None and not taken & bits_of(signal):
            taken |= bits_of(signal)
            kept.append(signal)
    if not kept:
        kept = [Signal("S0", 0, 8)]
    return Message(0x100, "M", length_bytes, kept)


def raw_values(signal: Signal) -> st.SearchStrategy[float]:
    if signal.conversion.is_float:
        return st.floats(width=signal.length, allow_nan=False, allow_infinity=False)
    span = 1 << signal.length
    return st.integers(-span // 2, span // 2 - 1) if signal.is_signed else st.integers(0, span - 1)


def decoder_of(message: Message) -> Decoder:
    """One role per signal; roles are only names to the decoder."""
    sources = [Source(s.name, "M", (Part(s.name),), 1.0, -math.inf, math.inf) for s in message.signals]
    return Decoder(sources, {"M": message})


@unhurried
@given(data=st.data(), message=layouts())
def test_what_cantools_encodes_is_what_we_decode(data: st.DataObject, message: Message) -> None:
    raw = {s.name: data.draw(raw_values(s)) for s in message.signals}
    payload = message.encode(raw, scaling=False)
    got = {s.role: s.value for s in decoder_of(message).decode(Frame(1, "can0", 0x100, payload))}
    for signal in message.signals:
        expected = float(raw[signal.name] * signal.conversion.scale + signal.conversion.offset)
        if math.isfinite(expected):
            assert got[signal.name] == expected
        else:
            assert signal.name not in got


@unhurried
@given(data=st.data(), message=layouts())
def test_physical_values_come_back_within_half_an_lsb(data: st.DataObject, message: Message) -> None:
    """Physical value -> cantools -> bits -> ours -> physical value, for values between the steps."""
    values = {}
    for s in message.signals:
        raw = data.draw(raw_values(s))
        if s.conversion.is_float or s.length > 40:  # beyond it a double can't tell steps apart
            raw = 0
        between = data.draw(st.floats(-0.49, 0.49))
        values[s.name] = (raw + (0 if s.conversion.is_float else between)) * s.scale + s.offset
    payload = message.encode(values, strict=False)
    for signal in message.signals:
        lsb = abs(signal.scale)
        error = abs(reader(bit_field(signal))(payload) - values[signal.name])
        assert error <= 0.5 * lsb + 1e-9 * abs(values[signal.name])


@unhurried
@given(message=layouts(), payload=st.binary(min_size=64, max_size=64), length=st.integers(0, 64))
def test_any_bytes_decode_as_cantools_does(message: Message, payload: bytes, length: int) -> None:
    """Short and long frames too: the signals that fit, and no others."""
    payload = payload[:length]
    theirs = message.decode_simple(payload, decode_choices=False, allow_truncated=True)
    decoder = decoder_of(message)
    ours = {s.role: s.value for s in decoder.decode(Frame(1, "can0", 0x100, payload))}
    # A sample is a double: integers beyond 2^53 are rounded.
    assert ours == {name: float(value) for name, value in theirs.items() if math.isfinite(value)}
    seen = decoder.counters
    for signal in message.signals:
        role = seen.roles[signal.name]
        assert role.short == (signal.name not in theirs)
        assert role.samples + role.short + role.not_a_number == 1
    assert seen.messages["M"].wrong_length == (length != message.length)


@unhurried
@given(
    ids=st.lists(st.sets(st.integers(0, 15), min_size=1), min_size=2, max_size=2),
    nested=st.booleans(),
    payload=st.binary(min_size=8, max_size=8),
)
def test_multiplexing_as_cantools_does_it(ids: list[set[int]], nested: bool, payload: bytes) -> None:
    """Two levels, the second below the first or beside it, each with any set of pages."""
    second_above = {"multiplexer_ids": sorted(ids[0]), "multiplexer_signal": "OUTER"} if nested else {}
    message = Message(
        0x100,
        "M",
        8,
        [
            Signal("OUTER", 0, 4, is_multiplexer=True),
            Signal("INNER", 4, 4, is_multiplexer=True, **second_above),
            Signal("PLAIN", 8, 8),
            Signal("FIRST", 16, 8, multiplexer_ids=sorted(ids[0]), multiplexer_signal="OUTER"),
            Signal("SECOND", 24, 8, multiplexer_ids=sorted(ids[1]), multiplexer_signal="INNER"),
        ],
    )
    outer, inner = payload[0] & 15, payload[0] >> 4
    has_first = outer in ids[0]
    has_second = inner in ids[1] and (has_first or not nested)
    got = {s.role: s.value for s in decoder_of(message).decode(Frame(1, "can0", 0x100, payload))}
    assert got.get("PLAIN") == payload[1]
    assert got.get("FIRST") == (payload[2] if has_first else None)
    assert got.get("SECOND") == (payload[3] if has_second else None)
    if has_first and has_second:  # elsewhere cantools refuses the whole message
        assert message.decode_simple(payload) == got


frames = st.builds(
    Frame,
    t_ns=st.integers(),
    channel=st.sampled_from(["can0", "can1"]),
    can_id=st.sampled_from([0x100, 0x101, 0x6D0, 0x7FF]),
    data=st.binary(max_size=9),
    is_extended=st.booleans(),
    is_fd=st.booleans(),
    is_remote=st.sampled_from([False, False, False, True]),
    is_error=st.sampled_from([False, False, False, True]),
)


def fuzzed_decoder(counters: object = None) -> Decoder:
    first = Message(
        0x100,
        "A",
        8,
        [
            Signal("MUX", 0, 2, is_multiplexer=True),
            Signal("OK", 2, 1),
            Signal("X", 23, 16, "big_endian", is_signed=True, multiplexer_ids=[1], multiplexer_signal="MUX"),
            Signal("F", 32, 32, conversion=BaseConversion.factory(is_float=True)),
        ],
    )
    second = Message(0x101, "B", 4, [Signal("W", 0, 16)])
    sources = [
        Source("gyro_z", "A", (Part("X"),), 0.01, -35.0, 35.0),
        Source("accel_y", "A", (Part("F"), Part("X", -1.0)), 1.0, -160.0, 160.0, valid_signal="OK"),
        Source("wheel_speed_fl", "B", (Part("W"),), 0.01, -30.0, 120.0, channel="can1"),
        Source("brake", "B", (Part("W"),), 1.0, -math.inf, math.inf, is_switch=True),
    ]
    return Decoder(sources, {"A": first, "B": second}, {(0x6D0, False)}, counters)  # type: ignore[arg-type]


@unhurried
@given(st.lists(frames, max_size=40))
def test_no_frame_is_fatal_and_every_one_is_accounted_for(stream: list[Frame]) -> None:
    decoder = fuzzed_decoder()
    bounds = {"gyro_z": 35.0, "accel_y": 160.0, "wheel_speed_fl": 120.0, "brake": 1.0}
    got = [(frame, sample) for frame in stream for sample in decoder.decode(frame)]
    for frame, sample in got:
        assert abs(sample.value) <= bounds[sample.role]
        assert sample.t_ns == frame.t_ns
        assert not any((frame.is_error, frame.is_remote, frame.is_extended))
    seen = decoder.counters
    assert seen.frames == len(stream)
    assert seen.samples == len(got)
    # A is used by sources without a channel only: each of its frames is used or ambiguous.
    used_a = sum(asdict(seen.roles["gyro_z"]).values())
    assert used_a == sum(asdict(seen.roles["accel_y"]).values()) == seen.messages["A"].frames
    plain = [f for f in stream if not (f.is_error or f.is_remote)]
    assert seen.error_frames + seen.remote + len(plain) == len(stream)
    assert seen.own == sum(f.can_id == 0x6D0 and not f.is_extended for f in plain)


@unhurried
@given(st.lists(frames, max_size=30), st.integers(0, 30))
def test_a_decoder_that_resumes_equals_one_that_never_stopped(stream: list[Frame], cut: int) -> None:
    whole, first = fuzzed_decoder(), fuzzed_decoder()
    expected = [tuple(whole.decode(f)) for f in stream]
    got = [tuple(first.decode(f)) for f in stream[:cut]]
    second = fuzzed_decoder(first.counters)
    got += [tuple(second.decode(f)) for f in stream[cut:]]
    assert got == expected
    assert second.counters == whole.counters


# --- encode: any row ---

# Up to well beyond every range, and what is no number.
values = st.one_of(st.floats(-7.0, 7.0), st.floats(-300.0, 300.0), st.floats(), st.just(math.nan))

channels = st.builds(
    ChannelOutput,
    raw=st.just(math.nan),
    compensated=values,
    offset=values,
    offset_std=values,
    state=st.sampled_from(ChannelState),
    gate=st.booleans(),
    reason=st.sampled_from(Reason),
)


@st.composite
def rows(draw: st.DrawFn) -> Row:
    numbers = {name: draw(values) for name in ("speed_mps", "sideslip_rad", "road_wheel_angle_rad")}
    unused = dict.fromkeys(StepOutput._fields, math.nan)
    output = StepOutput(
        **(unused | numbers | {n: draw(channels) for n in IMU_CHANNELS} | {"standstill": draw(st.booleans())})
    )
    roles = st.sampled_from(IMU_CHANNELS + WHEEL_SPEEDS + ("steering_wheel_angle", "brake"))
    ages = draw(st.dictionaries(roles, st.floats(-1.0, 30.0), max_size=8))
    counters = Counters(*(draw(st.integers(0, 2**34)) for _ in Counters._fields))
    return Row(draw(st.integers(0, 2**62)), output, {}, ages, counters)


def expected_of(row: Row) -> dict[str, float]:
    """What each signal should say, in the unit that docs/output_messages.md promises."""
    out = row.output

    def oldest(*roles: str) -> float:
        return 1e3 * max((row.ages_s[r] for r in roles if r in row.ages_s), default=math.nan)

    expected = {
        "STANDSTILL": float(out.standstill),
        "SPEED": out.speed_mps * 3600 / 1000,
        "SIDESLIP": out.sideslip_rad * 180 / math.pi,
        "ROAD_WHEEL_ANGLE": out.road_wheel_angle_rad * 180 / math.pi,
        "AGE_IMU": oldest("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"),
        "AGE_WHEELS": oldest("wheel_speed_fl", "wheel_speed_fr", "wheel_speed_rl", "wheel_speed_rr"),
        "AGE_STEERING": oldest("steering_wheel_angle"),
        "FRAMES": row.counters.frames,
        "REJECTED": row.counters.rejected,
        "MISSED_TICKS": row.counters.missed_ticks,
        "GAPS": row.counters.gaps,
        "CLOCK_STEPS": row.counters.clock_steps,
    }
    by_axis = {"P": out.gyro_x, "Q": out.gyro_y, "R": out.gyro_z}
    by_axis |= {"AX": out.accel_x, "AY": out.accel_y, "AZ": out.accel_z}
    for axis, of in by_axis.items():
        factor = 180 / math.pi if axis in "PQR" else 1.0
        expected |= {
            axis: factor * of.compensated,
            f"{axis}_OFFSET": factor * of.offset,
            f"{axis}_STD": factor * of.offset_std,
            f"STATE_{axis}": of.state.value,
            f"GATE_{axis}": float(of.gate),
            f"REASON_{axis}": of.reason.value,
        }
    return expected


@unhurried
@given(rows())
def test_every_signal_comes_back_within_half_an_lsb(row: Row) -> None:
    expected = expected_of(row)
    for frame in Encoder(DATABASE, status_period_ticks=1).encode(row):
        message = DATABASE.get_message_by_frame_id(frame.can_id)
        numbers = message.decode_simple(frame.data, decode_choices=False)
        named = message.decode_simple(frame.data, decode_choices=True)
        for signal in message.signals:
            if signal.name.startswith(("E2E_", "SATURATED_")):
                continue
            value = expected[signal.name]
            flag = numbers.get(f"SATURATED_{signal.name}", 0)
            if math.isnan(value):
                assert str(named[signal.name]) == "not_available"
                assert not flag
                continue
            inside = min(max(value, signal.minimum), signal.maximum)
            assert abs(numbers[signal.name] - inside) <= signal.scale * 0.500001
            assert str(named[signal.name]) != "not_available"
            cut_off = abs(value - inside) / signal.scale
            assert flag == (cut_off > 0.5) or math.isclose(cut_off, 0.5, rel_tol=1e-6)


@unhurried
@given(rows())
def test_our_bits_are_cantools_bits(row: Row) -> None:
    """cantools encodes what it decoded: any stray bit, in a gap or in a neighbour, would show."""
    for frame in Encoder(DATABASE, status_period_ticks=1).encode(row):
        message = DATABASE.get_message_by_frame_id(frame.can_id)
        assert message.encode(message.decode_simple(frame.data)) == frame.data


@settings(unhurried, max_examples=30)
@given(st.lists(rows(), min_size=1, max_size=25), st.integers(0, 25), st.integers(1, 4), st.integers(1, 12))
def test_an_encoder_that_resumes_equals_one_that_never_stopped(
    stream: list[Row], cut: int, period: int, status_period: int
) -> None:
    settings = {"period_ticks": period, "status_period_ticks": status_period}
    whole, first = Encoder(DATABASE, **settings), Encoder(DATABASE, **settings)
    expected = [whole.encode(row) for row in stream]
    got = [first.encode(row) for row in stream[:cut]]
    second = Encoder(DATABASE, **settings, state=first.state)
    got += [second.encode(row) for row in stream[cut:]]
    assert got == expected
    assert second.state == whole.state


# --- there and back ---


@unhurried
@given(rows())
def test_our_output_is_readable_by_our_decoder(row: Row) -> None:
    """DSZ_RATES as another daemon's input: within half an LSB, in SI."""
    message = DATABASE.get_message_by_name("DSZ_RATES")
    roles = {"gyro_x": "P", "gyro_y": "Q", "gyro_z": "R"}
    sources = [
        Source(role, "DSZ_RATES", (Part(name),), math.pi / 180, -327.675 * math.pi / 180, math.inf)
        for role, name in roles.items()
    ]
    decoder = Decoder(sources, {"DSZ_RATES": message})
    got = {s.role: s.value for s in decoder.decode(Encoder(DATABASE).encode(row)[0])}
    limit, half_lsb = 327.67 * math.pi / 180, 0.005 * math.pi / 180
    for role, channel in zip(roles, row.output.channels[:3], strict=True):
        if math.isnan(channel.compensated):
            assert role not in got  # -327.68 deg/s is below the bound
        else:
            assert abs(got[role] - min(max(channel.compensated, -limit), limit)) <= half_lsb * 1.00001


@unhurried
@given(st.floats(width=32), st.sampled_from(["<f", ">f"]))
def test_floats_as_the_struct_module_packs_them(value: float, packing: str) -> None:
    order, start = ("little_endian", 0) if packing == "<f" else ("big_endian", 7)
    signal = Signal("F", start, 32, order, conversion=BaseConversion.factory(is_float=True))
    got = reader(bit_field(signal))(struct.pack(packing, value))
    assert got == value or (math.isnan(got) and math.isnan(value))
