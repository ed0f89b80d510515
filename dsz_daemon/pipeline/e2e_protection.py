"""AUTOSAR end-to-end protection, profile 2, of one 8 byte message; why: docs/decisions/0005-e2e-profile.md.

Byte 0 is a CRC-8H2F over the other bytes and one byte that is not sent, the Data ID; the low nibble
of byte 1 counts 0..15 and round again. Every message has a Data ID of its own: a message under
another's id fails its CRC.
"""

from __future__ import annotations

from e2e.p02 import e2e_p02_check, e2e_p02_protect

COUNTER_START_BIT = 8
COUNTER_VALUES = 16


def data_id_list(e2e_data_id: int, message_index: int) -> bytes:
    """Profile 2's 16 Data IDs (one for each counter value) of message `message_index`.

    All are the same, (`e2e_data_id` + `message_index`) modulo 256: with a list that varies, a flipped
    counter bit flips the Data ID too and two or three flipped bits can cancel out in the CRC.

    >>> data_id_list(0x40, 1).hex()
    '41414141414141414141414141414141'
    """
    return bytes([(e2e_data_id + message_index) % 256]) * COUNTER_VALUES


def next_counter(counter: int) -> int:
    """Alive counter after `counter`: 15 is followed by 0."""
    return (counter + 1) % COUNTER_VALUES


def protected(payload_bits: int, counter: int, data_ids: bytes) -> bytes:
    """The 8 bytes of `payload_bits` (little endian, CRC and counter bits zero) with both filled in."""
    data = bytearray((payload_bits | counter << COUNTER_START_BIT).to_bytes(8, "little"))
    e2e_p02_protect(data, data_ids, increment_counter=False)
    return bytes(data)


def is_intact(data: bytes, data_ids: bytes) -> bool:
    """Whether the CRC of a received message fits; what its counter says is the receiver's to judge."""
    return len(data) >= 2 and e2e_p02_check(data, data_ids)
