"""The generated readers against cantools: every place, width, order and kind, and multiplexed ones of any layout."""

from __future__ import annotations

import math
import random

import pytest
from cantools.database.can import Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import given
from hypothesis import strategies as st

from dsz_daemon.pipeline.bit_fields import bit_field, raw_reader, reader
from dsz_daemon.pipeline.decode import Decoder
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.mapping import Part, Source
from tests.property.test_codec_property import bits_of, raw_values, signals, unhurried

SCALINGS = [(1, 0), (0.01, -67.67), (-0.5, 3), (2, 0.125)]


def fits(signal: Signal, length_bytes: int) -> bool:
    return max(byte for byte, _ in bits_of(signal)) < length_bytes


def message_of(*wanted: Signal, length_bytes: int = 9) -> Message:
    return Message(0x100, "M", length_bytes, list(wanted))


@pytest.mark.parametrize("order", ["little_endian", "big_endian"])
@pytest.mark.parametrize("is_signed", [False, True])
def test_every_width_at_every_place(order: str, is_signed: bool) -> None:
    """All 1 to 64 bits from each of the first 8 bits of two bytes, on random payloads; all ones and zeros as well."""
    chance = random.Random(f"{order} {is_signed}")
    tried = 0
    for length in range(1, 65):
        for start in (*range(8), *range(8, 16)):
            scale, offset = SCALINGS[(length + start) % len(SCALINGS)]
            conversion = BaseConversion.factory(scale=scale, offset=offset, is_float=False)
            signal = Signal("S", start, length, order, is_signed=is_signed, conversion=conversion)
            if not fits(signal, 10):
                continue
            message, field, tried = message_of(signal, length_bytes=10), bit_field(signal), tried + 1
            read, turned = reader(field), reader(field, -0.25)
            for payload in (chance.randbytes(10), chance.randbytes(10), b"\xff" * 10, bytes(10)):
                theirs = float(message.decode_simple(payload)["S"])
                assert read(payload) == theirs, (length, start, payload.hex())
                assert turned(payload) == -0.25 * theirs
                raw = message.decode_simple(payload, scaling=False)["S"]
                assert raw_reader(field)(payload) == raw % (1 << length)
    assert tried > 900


@pytest.mark.parametrize("order", ["little_endian", "big_endian"])
@pytest.mark.parametrize("length", [16, 32, 64])
def test_floats_at_every_place(order: str, length: int) -> None:
    """Aligned or not, numbers, infinities and NaN."""
    for start in range(16):
        conversion = BaseConversion.factory(scale=-2, offset=0.5, is_float=True)
        signal = Signal("S", start, length, order, conversion=conversion)
        if not fits(signal, 10):
            continue
        for value in (0.0, 1.5, -3.25, 2.0**-24, math.inf, -math.inf, math.nan):
            payload = message_of(signal, length_bytes=10).encode({"S": value}, scaling=False)
            got = reader(bit_field(signal))(payload)
            assert got == -2 * value + 0.5 or (math.isnan(got) and math.isnan(value))


@st.composite
def pages(draw: st.DrawFn) -> list[Signal]:
    """A multiplexer somewhere, and behind each of its pages a signal of any kind that lies elsewhere."""
    selector = Signal(
        "PAGE",
        draw(st.integers(0, 63)),
        draw(st.integers(1, 4)),
        draw(st.sampled_from(["little_endian", "big_endian"])),
        is_multiplexer=True,
    )
    if not fits(selector, 8):
        selector = Signal("PAGE", 0, 2, is_multiplexer=True)
    kept = [selector]
    for page in range(min(4, 1 << selector.length)):
        signal = draw(signals(f"S{page}", 8))
        if signal is None or bits_of(signal) & bits_of(selector):
            continue
        signal.multiplexer_ids, signal.multiplexer_signal = [page], "PAGE"
        kept.append(signal)
    return kept


@unhurried
@given(data=st.data(), layout=pages())
def test_multiplexed_signals_of_any_kind(data: st.DataObject, layout: list[Signal]) -> None:
    """The page that is sent is read as cantools reads it, and of the others none is."""
    selector, behind = layout[0], layout[1:]
    message = Message(0x100, "M", 8, layout)
    sources = [Source(s.name, "M", (Part(s.name),), 1.0, -math.inf, math.inf) for s in layout]
    for sent in behind:
        page = sent.multiplexer_ids[0]
        raw = {selector.name: page, sent.name: data.draw(raw_values(sent))}
        payload = message.encode(raw, scaling=False)
        decoder = Decoder(sources, {"M": message})
        ours = {s.role: s.value for s in decoder.decode(Frame(1, "can0", 0x100, payload))}
        theirs = message.decode_simple(payload)
        assert ours == {name: float(value) for name, value in theirs.items() if math.isfinite(value)}
        for other in behind:
            assert decoder.counters.roles[other.name].not_present == (other is not sent)


@unhurried
@given(
    payload=st.binary(min_size=8, max_size=8), factors=st.lists(st.sampled_from([1.0, -1.0]), min_size=3, max_size=3)
)
def test_sums_are_those_of_cantools_values(payload: bytes, factors: list[float]) -> None:
    """One, two and three parts, each with its sign, as a wide and a fine signal make a steering angle."""
    parts = [
        Signal("COARSE", 3, 12, "big_endian", is_signed=True, conversion=BaseConversion.factory(scale=1.5)),
        Signal("FINE", 39, 4, "big_endian", is_signed=True, conversion=BaseConversion.factory(scale=0.1)),
        Signal("THIRD", 42, 13, conversion=BaseConversion.factory(scale=0.03125, offset=-40)),
    ]
    message = Message(0x100, "M", 8, parts)
    values = message.decode_simple(payload)
    for count in (1, 2, 3):
        chosen = tuple(Part(s.name, f) for s, f in zip(parts[:count], factors, strict=False))
        wanted = Source("steering_wheel_angle", "M", chosen, 0.017, -math.inf, math.inf, sign=-1.0)
        (sample,) = Decoder([wanted], {"M": message}).decode(Frame(1, "can0", 0x100, payload))
        total = 0.0
        for part in chosen:
            total += part.sign * values[part.signal]
        assert sample.value == -0.017 * total
