"""Where a DBC signal's bits lie in a payload, and readers made for one signal each, once, before the first frame.

cantools describes the signal (DBC or any other format it loads); the bits are taken here and not by
`Message.decode` for three reasons, each met in DBCs that people really use:

- signals that overlap, or stick out of the message, make cantools refuse the whole message;
- an unknown multiplexer value makes it refuse the plain signals of the message too;
- a car's message has dozens of signals of which one or two are wanted.

`tests/property/test_codec_property.py` compares the two wherever cantools can read.
"""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct
from typing import Literal, NamedTuple

from cantools.database.can import Signal

Reader = Callable[[bytes], float]
RawReader = Callable[[bytes], int]

# IEEE 754 by number of bits, as the DBC's SIG_VALTYPE_ allows (16: other formats).
_FLOAT_FORMATS = {16: "e", 32: "f", 64: "d"}
# What the C library reads in one go, by number of bytes; lower case is signed.
_WHOLE_FORMATS = {1: "B", 2: "H", 4: "I", 8: "Q"}

# A CAN FD frame's 64 bytes.
_WIDEST_BITS = 512


class BitField(NamedTuple):
    """One signal's place and scaling: physical = raw * `scale` + `offset`.

    The raw value is `mask` bits wide in bytes `first_byte` up to (not with) `end_byte`, read in
    `order` and shifted right by `shift`. Only for integers does `sign_bit` count, 0 for unsigned.
    """

    first_byte: int
    end_byte: int
    order: Literal["big", "little"]
    shift: int
    mask: int
    sign_bit: int
    is_float: bool
    scale: float
    offset: float

    @property
    def bits(self) -> int:
        """Width in bits."""
        return self.mask.bit_length()


def bit_field(signal: Signal) -> BitField:
    """Place of `signal` in its message.

    ValueError for a float that is not 16, 32 or 64 bits wide, and for what is in no CAN frame at all.

    DBC bit numbering: a little-endian signal starts at its least significant bit, a big-endian one
    at its most significant bit, and bits count from 0 = least significant within each byte.
    """
    is_float = signal.conversion.is_float
    if is_float and signal.length not in _FLOAT_FORMATS:
        raise ValueError(f"a float of {signal.length} bits (expected 16, 32 or 64)")
    if not (signal.start >= 0 and 1 <= signal.length <= _WIDEST_BITS):
        raise ValueError(f"{signal.length} bits from bit {signal.start} on (expected 1 to {_WIDEST_BITS}, from 0 on)")
    first_byte = signal.start // 8
    if signal.byte_order == "little_endian":
        end_bit = signal.start + signal.length
        end_byte = -(-end_bit // 8)
        shift = signal.start - 8 * first_byte
    else:
        end_bit = 8 * first_byte + (7 - signal.start % 8) + signal.length
        end_byte = -(-end_bit // 8)
        shift = 8 * end_byte - end_bit
    return BitField(
        first_byte=first_byte,
        end_byte=end_byte,
        order="little" if signal.byte_order == "little_endian" else "big",
        shift=shift,
        mask=(1 << signal.length) - 1,
        sign_bit=1 << (signal.length - 1) if signal.is_signed else 0,
        is_float=is_float,
        scale=signal.conversion.scale,
        offset=signal.conversion.offset,
    )


def raw_reader(field: BitField) -> RawReader:
    """A reader of the field's bits as an unsigned number: a multiplexer, a counter, a checksum.

    Like every reader it is given payloads that reach `end_byte`.
    """
    first, end, order, shift, mask = field.first_byte, field.end_byte, field.order, field.shift, field.mask
    if end - first == 1:
        return lambda data: (data[first] >> shift) & mask
    from_bytes = int.from_bytes
    return lambda data: (from_bytes(data[first:end], order) >> shift) & mask


def reader(field: BitField, factor: float = 1.0) -> Reader:
    """A reader of `factor` times the field's value in the DBC's unit; of a float that may be NaN or infinite.

    A number that fills its bytes is read in one go; one that lies across them is cut out of the
    smallest such number around it, or where there is none (3, 5, 6, 7 or 9 bytes) out of a slice.
    """
    if field.is_float:
        return _float_reader(field, factor)
    first, shift, mask, sign = field.first_byte, field.shift, field.mask, field.sign_bit
    scale, offset = field.scale, field.offset
    bytes_spanned = field.end_byte - first
    whole = _WHOLE_FORMATS.get(bytes_spanned)
    if whole is None:
        from_bytes, end, order = int.from_bytes, field.end_byte, field.order
        return lambda data: (
            factor * (((((from_bytes(data[first:end], order) >> shift) & mask) ^ sign) - sign) * scale + offset)
        )
    byte_order = ">" if field.order == "big" else "<"
    if field.bits == 8 * bytes_spanned:
        read = Struct(byte_order + (whole.lower() if sign else whole)).unpack_from
        return lambda data: factor * (read(data, first)[0] * scale + offset)
    if bytes_spanned == 1:
        return lambda data: factor * (((((data[first] >> shift) & mask) ^ sign) - sign) * scale + offset)
    read = Struct(byte_order + whole).unpack_from
    return lambda data: factor * (((((read(data, first)[0] >> shift) & mask) ^ sign) - sign) * scale + offset)


def _float_reader(field: BitField, factor: float) -> Reader:
    scale, offset, first, width_bytes = field.scale, field.offset, field.first_byte, field.bits // 8
    letter = _FLOAT_FORMATS[field.bits]
    if field.shift == 0 and field.end_byte - first == width_bytes:
        read = Struct((">" if field.order == "big" else "<") + letter).unpack_from
        return lambda data: factor * (read(data, first)[0] * scale + offset)
    raw, unpack = raw_reader(field), Struct(">" + letter).unpack
    return lambda data: factor * (unpack(raw(data).to_bytes(width_bytes, "big"))[0] * scale + offset)
