"""The checksums by which senders protect a message: computed over a payload, compared with what it carries.

Toyota's and Honda's are those of opendbc (opendbc/car/toyota/toyotacan.py, .../honda/hondacan.py), found
by its users in real cars; CRC8 is SAE J1850's (polynomial 0x1D, start and final XOR 0xFF; "123456789"
gives 0x4B). The AUTOSAR profiles are those of the library autosar-e2e.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from operator import xor
from typing import NamedTuple

from e2e.crc import calculate_crc8
from e2e.p01 import (
    E2E_P01_DATAID_ALT,
    E2E_P01_DATAID_BOTH,
    E2E_P01_DATAID_LOW,
    E2E_P01_DATAID_NIBBLE,
    e2e_p01_check,
)
from e2e.p02 import e2e_p02_check
from e2e.p05 import e2e_p05_check
from e2e.p11 import E2E_P11_DATAID_BOTH, E2E_P11_DATAID_NIBBLE, e2e_p11_check

Intact = Callable[[bytes], bool]
# (CAN id, payload, byte that carries the checksum) -> checksum
Method = Callable[[int, bytes, int], int]


def toyota(can_id: int, data: bytes, at: int) -> int:
    """Length, bytes of the id and all bytes but the checksum's own, modulo 256."""
    return (len(data) + sum(can_id.to_bytes(4, "big")) + sum(data) - data[at]) & 0xFF


def honda(can_id: int, data: bytes, at: int) -> int:
    """Eight less the nibbles of id and data, modulo 16; the checksum is the low nibble of its byte.

    29 bit ids add three.
    """
    nibbles = sum((byte >> 4) + (byte & 0xF) for byte in can_id.to_bytes(4, "big") + data) - (data[at] & 0xF)
    return (8 - nibbles + (3 if can_id > 0x7FF else 0)) & 0xF


def sum8(_can_id: int, data: bytes, at: int) -> int:
    """All bytes but the checksum's own, modulo 256."""
    return (sum(data) - data[at]) & 0xFF


def xor8(_can_id: int, data: bytes, at: int) -> int:
    """Exclusive or of all bytes but the checksum's own."""
    return int(reduce(xor, data, data[at]))


def crc8_sae_j1850(_can_id: int, data: bytes, at: int) -> int:
    """CRC-8 SAE J1850 of all bytes but the checksum's own."""
    return calculate_crc8(data[:at] + data[at + 1 :])


METHODS: dict[str, Method] = {
    "toyota": toyota,
    "honda": honda,
    "crc8_sae_j1850": crc8_sae_j1850,
    "xor": xor8,
    "sum8": sum8,
}
# Honda's is a nibble, the others fill a byte.
METHOD_BITS = {name: 4 if name == "honda" else 8 for name in METHODS}


def checksum_check(method: str, can_id: int, at: int) -> Intact:
    """Whether a payload that reaches byte `at` carries there what `method` makes of it."""
    computed, mask = METHODS[method], (1 << METHOD_BITS[method]) - 1
    return lambda data: computed(can_id, data, at) == data[at] & mask


class E2eProfile(NamedTuple):
    """Where an AUTOSAR profile has its header: its length, the counter's byte and bits, and its values.

    The counter begins at the lowest bit of its byte and runs through 0 .. counter_values - 1.
    """

    header_bytes: int
    counter_byte: int
    counter_bits: int
    counter_values: int
    largest_data_id: int
    data_id_modes: tuple[str, ...] = ()


E2E_PROFILES = {
    1: E2eProfile(2, 1, 4, 15, 0xFFFF, ("both", "alternating", "low", "nibble")),
    2: E2eProfile(2, 1, 4, 16, 0xFF),
    5: E2eProfile(3, 2, 8, 256, 0xFFFF),
    11: E2eProfile(2, 1, 4, 15, 0xFFFF, ("both", "nibble")),
}
_P01_MODES = {
    "both": E2E_P01_DATAID_BOTH,
    "alternating": E2E_P01_DATAID_ALT,
    "low": E2E_P01_DATAID_LOW,
    "nibble": E2E_P01_DATAID_NIBBLE,
}
_P11_MODES = {"both": E2E_P11_DATAID_BOTH, "nibble": E2E_P11_DATAID_NIBBLE}


def e2e_check(profile: int, data_ids: Sequence[int], data_id_mode: str) -> Intact:
    """Whether a payload (at least the header long) carries the profile's CRC.

    `data_ids`: one, or for profile 2 also sixteen, one for each counter value.
    """
    data_id = data_ids[0]
    if profile == 1:
        # The library writes the CRC that it finds into the buffer: it gets one of its own.
        mode = _P01_MODES[data_id_mode]
        return lambda data: e2e_p01_check(bytearray(data), data_id, data_id_mode=mode)
    if profile == 2:
        sixteen = bytes(data_ids) if len(data_ids) == 16 else bytes([data_id]) * 16
        return lambda data: e2e_p02_check(data, sixteen)
    if profile == 5:
        return lambda data: e2e_p05_check(data, data_id)
    if profile == 11:
        mode = _P11_MODES[data_id_mode]
        return lambda data: e2e_p11_check(bytearray(data), data_id, data_id_mode=mode)
    raise ValueError(f"E2E profile {profile} is not known; expected {', '.join(map(str, E2E_PROFILES))}")
