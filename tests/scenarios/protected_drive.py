"""The short drive sent by units that count and sign their frames: Toyota's way, AUTOSAR's profile 2, a CRC8."""

from __future__ import annotations

from collections.abc import Sequence

import short_drive as sd
from e2e.p02 import e2e_p02_protect
from short_drive import ACCELS, CONFIG, DBC, RATES, STEER, Sent, edited

DATA_ID = 0x40
PROTECTED_DBC = edited(
    DBC,
    ("IMU_RATES: 6 IMU", "IMU_RATES: 8 IMU"),
    (
        ' SG_ R : 32|16@1- (0.01,0) [-327.68|327.67] "deg/s" CAR\n',
        ' SG_ R : 32|16@1- (0.01,0) [-327.68|327.67] "deg/s" CAR\n'
        ' SG_ COUNTER : 48|4@1+ (1,0) [0|15] "" CAR\n SG_ CHECKSUM : 63|8@0+ (1,0) [0|255] "" CAR\n',
    ),
    ("IMU_ACCELS: 6 IMU", "IMU_ACCELS: 8 IMU"),
    ("AX : 0|16@1-", "AX : 16|16@1-"),
    ("AY : 16|16@1-", "AY : 32|16@1-"),
    ("AZ : 32|16@1-", "AZ : 48|16@1-"),
    ("STEERING: 2 CAR", "STEERING: 4 CAR"),
    ('[-3276.8|3276.7] "deg" IMU\n', '[-3276.8|3276.7] "deg" IMU\n SG_ ALIVE : 16|8@1+ (1,0) [0|255] "" IMU\n'),
)
PROTECTION = f"""\
protection:
  IMU_RATES: {{counter: {{signal: COUNTER}}, checksum: {{method: toyota, signal: CHECKSUM}}}}
  IMU_ACCELS: {{e2e: {{profile: 2, data_id: {DATA_ID}}}}}
  STEERING: {{counter: {{signal: ALIVE, last: 14}}, checksum: {{method: crc8_sae_j1850}}}}
"""
PROTECTED_CONFIG = edited(CONFIG, ("rate_hz: 50", "rate_hz: 25")) + PROTECTION


class Sender:
    """What one unit adds to its frames; each has a counter of its own."""

    def __init__(self, first: int = 0) -> None:
        self.rates = self.steering = first
        self.accels = bytearray([0, first, *bytes(6)])

    def sign(self, frame: Sent) -> Sent:
        """The same frame, counted and signed."""
        if frame.can_id == RATES:
            self.rates = (self.rates + 1) % 16
            return frame._replace(data=toyota(frame.data + bytes([self.rates])))
        if frame.can_id == ACCELS:
            self.accels[2:] = frame.data
            e2e_p02_protect(self.accels, bytes([DATA_ID]) * 16)
            return frame._replace(data=bytes(self.accels))
        if frame.can_id == STEER:
            self.steering = (self.steering + 1) % 15
            body = frame.data + bytes([self.steering])
            return frame._replace(data=body + bytes([crc8(body)]))
        return frame


def toyota(body: bytes) -> bytes:
    """An IMU_RATES payload with its checksum: 8 bytes, both bytes of the id, all others."""
    return body + bytes([(8 + (RATES >> 8) + (RATES & 0xFF) + sum(body)) % 256])


def crc8(body: bytes) -> int:
    """SAE J1850, bit by bit."""
    register = 0xFF
    for byte in body:
        register ^= byte
        for _ in range(8):
            register = (register << 1 ^ (0x1D if register & 0x80 else 0)) & 0xFF
    return register ^ 0xFF


def signed(sent: Sequence[Sent], first: int = 0) -> list[Sent]:
    """All frames of one car, each unit's in order."""
    sender = Sender(first)
    return [sender.sign(frame) for frame in sent]


def merged(*streams: Sequence[Sent]) -> list[Sent]:
    """Several streams on one bus, by time."""
    return sorted((frame for stream in streams for frame in stream), key=lambda frame: frame.t_s)


__all__ = ["DATA_ID", "PROTECTED_CONFIG", "PROTECTED_DBC", "Sender", "crc8", "merged", "sd", "signed", "toyota"]
