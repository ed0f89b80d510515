"""Checksums by hand, by a CRC written out bit by bit, and by opendbc where it is installed."""

from __future__ import annotations

import importlib.util
import random

import pytest
from e2e.p01 import e2e_p01_protect
from e2e.p02 import e2e_p02_protect
from e2e.p05 import e2e_p05_protect
from e2e.p11 import e2e_p11_protect

from dsz_daemon.pipeline.checksums import (
    E2E_PROFILES,
    METHOD_BITS,
    METHODS,
    checksum_check,
    crc8_sae_j1850,
    e2e_check,
    honda,
    sum8,
    toyota,
    xor8,
)

needs_opendbc = pytest.mark.skipif(
    importlib.util.find_spec("opendbc") is None, reason="opendbc is not installed (it needs Python below 3.13)"
)


def crc(data: bytes, bits: int, polynomial: int, start: int, final: int) -> int:
    """Most significant bit first, one bit at a time, as in every text book."""
    register, top = start, 1 << (bits - 1)
    for byte in data:
        register ^= byte << (bits - 8)
        for _ in range(8):
            register = (register << 1) ^ (polynomial if register & top else 0)
            register &= (1 << bits) - 1
    return register ^ final


def test_sums_by_hand() -> None:
    # Toyota: 8 bytes + 0x00 + 0x25 + (1 + 2 + ... + 7 = 28) = 8 + 37 + 28 = 73.
    assert toyota(0x25, bytes([1, 2, 3, 4, 5, 6, 7, 200]), 7) == 73
    # Both bytes of an id: 0x1D2 = 0x01 + 0xD2; 2 bytes: 2 + 1 + 210 + 255 = 468 = 256 + 212.
    assert toyota(0x1D2, bytes([255, 0]), 1) == 212
    # Honda: nibbles of 0x158 (1 + 5 + 8) and of 0x12 0x30 (1 + 2 + 3): 8 - 20 = -12 = 4 modulo 16.
    assert honda(0x158, bytes([0x12, 0x3F]), 1) == 4
    # 29 bits: 0x18DA (1 + 8 + 13 + 10 = 32); 8 - 32 - 0 + 3 = -21 = 11 modulo 16.
    assert honda(0x18DA, bytes([0x00]), 0) == 11
    assert sum8(0x123, bytes([200, 99, 100]), 1) == 44
    assert xor8(0x123, bytes([0b1100, 0xFF, 0b1010]), 1) == 0b0110


def test_crc8_is_sae_j1850s() -> None:
    assert crc8_sae_j1850(0, b"\xaa123456789", 0) == 0x4B  # the standard's check value
    data = random.Random(1).randbytes(12)
    for at in range(12):
        others = data[:at] + data[at + 1 :]
        assert crc8_sae_j1850(0, data, at) == crc(others, 8, 0x1D, 0xFF, 0xFF)


@pytest.mark.parametrize("method", METHODS)
def test_a_right_checksum_passes_and_every_flipped_bit_is_noticed(method: str) -> None:
    """Also wherever the byte stands; of Honda's byte the high nibble is data."""
    chance = random.Random(method)
    for at in range(8):
        data = bytearray(chance.randbytes(8))
        mask = (1 << METHOD_BITS[method]) - 1
        data[at] = data[at] & ~mask | METHODS[method](0x158, bytes(data), at)
        intact = checksum_check(method, 0x158, at)
        assert intact(bytes(data))
        for bit in range(64):
            flipped = bytearray(data)
            flipped[bit // 8] ^= 1 << bit % 8
            assert not intact(bytes(flipped)), bit


@needs_opendbc
def test_makers_sums_are_opendbcs() -> None:
    """The parsers of its users' cars: an independent route."""
    from opendbc.car.chrysler.chryslercan import chrysler_checksum
    from opendbc.car.honda.hondacan import honda_checksum
    from opendbc.car.toyota.toyotacan import toyota_checksum

    chance = random.Random(2)
    for _ in range(500):
        length = chance.randint(2, 8)
        can_id = chance.choice([chance.randint(0, 0x7FF), chance.randint(0x800, 0x1FFFFFFF)])
        data = chance.randbytes(length)
        assert toyota(can_id, data, length - 1) == toyota_checksum(can_id, None, bytearray(data))
        assert crc8_sae_j1850(can_id, data, length - 1) == chrysler_checksum(can_id, None, bytearray(data))
        # opendbc's leaves the last byte's low nibble out, as we do.
        assert honda(can_id, data, length - 1) == honda_checksum(can_id, None, bytearray(data))


def p01(data: bytes, data_id: int) -> int:
    return crc(data_id.to_bytes(2, "little") + data[1:], 8, 0x1D, 0x00, 0x00)


def p02(data: bytes, data_id: int) -> int:
    return crc(data[1:] + bytes([data_id]), 8, 0x2F, 0xFF, 0xFF)


def p05(data: bytes, data_id: int) -> int:
    return crc(data[2:] + data_id.to_bytes(2, "little"), 16, 0x1021, 0xFFFF, 0x0000)


@pytest.mark.parametrize("profile", E2E_PROFILES)
def test_e2e_crcs_are_those_of_the_standard(profile: int) -> None:
    """CRC-8 of profiles 1 and 11, CRC-8H2F of 2, CRC-16 of 5, bit by bit; and every flipped bit is noticed."""
    chance = random.Random(profile)
    data_id = chance.randint(1, E2E_PROFILES[profile].largest_data_id)
    data = bytearray(chance.randbytes(8))
    data[1] &= 0x0F  # profiles 1 and 11 in their mode "both" have data in the high nibble: any will do
    if profile == 5:
        data[:2] = p05(data, data_id).to_bytes(2, "little")
    else:
        data[0] = {1: p01, 2: p02, 11: p01}[profile](data, data_id)
    intact = e2e_check(profile, (data_id,), "both")
    assert intact(bytes(data))
    assert not e2e_check(profile, (data_id ^ 1,), "both")(bytes(data))
    for bit in range(64):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        assert not intact(bytes(flipped)), bit


def test_profile_2_takes_a_data_id_for_each_counter_value() -> None:
    ids = tuple(range(7, 23))
    data, intact = bytearray(8), e2e_check(2, ids, "both")
    for _ in range(40):
        e2e_p02_protect(data, bytes(ids))
        assert intact(bytes(data))
        assert data[0] == p02(data, ids[data[1] & 15])
        assert not e2e_check(2, ids[1:] + ids[:1], "both")(bytes(data))


def test_the_counter_is_where_the_profile_has_it() -> None:
    protectors = {
        1: lambda data: e2e_p01_protect(data, 0x123),
        2: lambda data: e2e_p02_protect(data, bytes(16)),
        5: lambda data: e2e_p05_protect(data, 0x123),
        11: lambda data: e2e_p11_protect(data, 0x123),
    }
    for number, protect in protectors.items():
        profile, data, seen = E2E_PROFILES[number], bytearray(8), []
        for _ in range(600):
            protect(data)
            seen.append(data[profile.counter_byte] & ((1 << profile.counter_bits) - 1))
        assert seen == [n % profile.counter_values for n in range(1, 601)]


@pytest.mark.parametrize(("profile", "mode"), [(1, "alternating"), (1, "low"), (1, "nibble"), (11, "nibble")])
def test_modes_differ(profile: int, mode: str) -> None:
    """A payload made in one mode passes in that one, and not in "both"."""
    from e2e import p01 as first
    from e2e import p11 as eleventh

    modes = {"alternating": first.E2E_P01_DATAID_ALT, "low": first.E2E_P01_DATAID_LOW,
             "nibble": first.E2E_P01_DATAID_NIBBLE}  # fmt: skip
    data = bytearray(b"\0\0\3\4\5\6\7\x08")
    if profile == 1:
        e2e_p01_protect(data, 0x523, data_id_mode=modes[mode])
    else:
        e2e_p11_protect(data, 0x523, data_id_mode=eleventh.E2E_P11_DATAID_NIBBLE)
    assert e2e_check(profile, (0x523,), mode)(bytes(data))
    assert not e2e_check(profile, (0x523,), "both")(bytes(data))


def test_a_check_leaves_the_payload_alone() -> None:
    data = bytes(8)
    for profile in E2E_PROFILES:
        e2e_check(profile, (0x12,), "both")(data)
    assert data == bytes(8)


def test_an_unknown_profile_is_refused() -> None:
    with pytest.raises(ValueError, match="E2E profile 3 is not known; expected 1, 2, 5, 11"):
        e2e_check(3, (1,), "both")
