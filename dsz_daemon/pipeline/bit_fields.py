"""Where a DBC signal's bits lie in a payload, and how to read them one signal at a time.

cantools describes the signal (DBC or any other format it loads); the bits are taken here and not by
`Message.decode` for three reasons, each met in DBCs that people really use:

- signals that overlap, or stick out of the message, make cantools refuse the whole message;
- an unknown multiplexer value makes it refuse the plain signals of the message too;
- a car's message has dozens of signals of which one or two are wanted.

`tests/property/test_codec_property.py` compares the two wherever cantools can read.
"""

from __future__ import annotations

import struct
from typing import Literal, NamedTuple

from cantools.database.can import Signal

# IEEE 754 by number of bits, as the DBC's SIG_VALTYPE_ allows (16: other formats).
_FLOAT_FORMATS = {16: ">e", 32: ">f", 64: ">d"}


class BitField(NamedTuple):
    """One signal's place and scaling: physical = raw * `scale` + `offset`.

    The raw value is `mask` bits wide in bytes `first_byte` up to (not with) `end_byte`, read in
    `order` and shifted right by `shift`. `float_format` is empty for integers; only for those does
    `sign_bit` count, 0 for unsigned.
    """

    first_byte: int
    end_byte: int
    order: Literal["big", "little"]
    shift: int
    mask: int
    sign_bit: int
    float_format: str
    scale: float
    offset: float


def bit_field(signal: Signal) -> BitField:
    """Place of `signal` in its message; ValueError for a float that is not 16, 32 or 64 bits wide.

    DBC bit numbering: a little-endian signal starts at its least significant bit, a big-endian one
    at its most significant bit, and bits count from 0 = least significant within each byte.
    """
    is_float = signal.conversion.is_float
    if is_float and signal.length not in _FLOAT_FORMATS:
        raise ValueError(f"a float of {signal.length} bits (expected 16, 32 or 64)")
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
        float_format=_FLOAT_FORMATS[signal.length] if is_float else "",
        scale=signal.conversion.scale,
        offset=signal.conversion.offset,
    )


def unsigned_raw(field: BitField, data: bytes) -> int:
    """Return the field's bits as they are, e.g. a multiplexer's value; `data` reaches `end_byte`."""
    return (int.from_bytes(data[field.first_byte : field.end_byte], field.order) >> field.shift) & field.mask


def physical(field: BitField, data: bytes) -> float:
    """Return the field's value in the DBC's unit; `data` reaches `end_byte`. A float may be NaN or inf."""
    raw: float = (int.from_bytes(data[field.first_byte : field.end_byte], field.order) >> field.shift) & field.mask
    if field.float_format:
        width_bytes = field.mask.bit_length() // 8
        raw = struct.unpack(field.float_format, int(raw).to_bytes(width_bytes, "big"))[0]
    elif field.sign_bit and int(raw) & field.sign_bit:
        raw -= field.mask + 1
    return raw * field.scale + field.offset
