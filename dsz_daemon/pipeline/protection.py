"""Checksums and alive counters of input messages: which frames are what their sender sent, each once, in order.

Verdicts are AUTOSAR's (E2E Protocol Specification, the states of its check functions), for makers' own
checksums and counters alike. An intact frame is used when it is the first, the next, or comes after a
few that were lost. A counter that stands still is a stuck sender or a frame sent again; one that leaps
is a second sender, or a long loss: then nothing is used until two frames follow each other again. After
a silence any counter will do.
"""

from __future__ import annotations

from enum import Enum, auto
from typing import NamedTuple

from cantools.database.can import Message, Signal

from dsz_daemon.pipeline.bit_fields import RawReader, bit_field, raw_reader
from dsz_daemon.pipeline.checksums import E2E_PROFILES, METHOD_BITS, Intact, checksum_check, e2e_check
from dsz_daemon.pipeline.decode_counters import Sender

# Where in an entry of the configuration, and what is wrong there.
Problem = tuple[tuple[str, ...], str]

# Up to this many lost frames in a row are let pass; more looks like another sender. On recordings of real
# cars no frame is missing, or single ones; a logger that drops more may be given more by `max_lost`.
_MAX_LOST = 3


class Counter(NamedTuple):
    """An alive counter: 0 .. `last` and round again (None: all of its bits), and how many may be lost at once."""

    signal: str
    last: int | None = None
    max_lost: int | None = None


class Checksum(NamedTuple):
    """A checksum by one of `checksums.METHODS`, in `signal` or, without one, in the message's last byte."""

    method: str
    signal: str | None = None


class E2e(NamedTuple):
    """AUTOSAR end-to-end protection: counter and CRC at the start of the message."""

    profile: int
    data_ids: tuple[int, ...]
    data_id_mode: str = "both"
    max_lost: int | None = None


class Protection(NamedTuple):
    """How the sender of `message` protects it: by a counter, a checksum, both, or AUTOSAR E2E."""

    message: str
    counter: Counter | None = None
    checksum: Checksum | None = None
    e2e: E2e | None = None


class Status(Enum):
    """What a frame is, by its checksum and its counter; the first three are used."""

    OK = auto()
    INITIAL = auto()
    SOME_LOST = auto()
    WRONG_CHECKSUM = auto()
    REPEATED = auto()
    WRONG_SEQUENCE = auto()


class MessageCheck(NamedTuple):
    """A message's protection resolved against the DBC.

    `needed_bytes`: shorter frames can't be checked, and are as good as corrupt; what comes behind
    `checked_bytes` (the padding of CAN FD) is no part of the message.
    """

    needed_bytes: int
    checked_bytes: int
    is_intact: Intact | None
    read_counter: RawReader | None
    counter_values: int
    max_lost: int
    resync_ns: int


def problems(protection: Protection, message: Message) -> list[Problem]:
    """Everything that keeps `protection` from being checked on `message`."""
    found: list[Problem] = []
    if protection.counter is not None:
        found += _counter_problems(protection.counter, message)
    if protection.checksum is not None:
        found += _checksum_problems(protection.checksum, message)
    if protection.e2e is not None:
        profile = E2E_PROFILES[protection.e2e.profile]
        if message.length < profile.header_bytes:
            found.append((
                ("e2e", "profile"),
                f"profile {protection.e2e.profile} has a header of {profile.header_bytes} bytes, message "
                f"{message.name!r} {message.length}",
            ))  # fmt: skip
        found += _max_lost_problems(("e2e",), protection.e2e.max_lost, profile.counter_values)
    return found


def _counter_problems(counter: Counter, message: Message) -> list[Problem]:
    place = ("counter", "signal")
    signal = _signal(counter.signal, message)
    if signal is None:
        return [(place, f"message {message.name!r} has no signal {counter.signal!r}")]
    if signal.conversion.is_float or signal.multiplexer_ids is not None or not 1 <= signal.length <= 32:
        return [(place, f"{counter.signal!r} can't count: expected a whole number of 1 to 32 bits in every frame")]
    most = (1 << signal.length) - 1
    if counter.last is not None and not 1 <= counter.last <= most:
        return [(("counter", "last"), f"{counter.last} is no value of {counter.signal!r}; expected 1 to {most}")]
    return _max_lost_problems(("counter",), counter.max_lost, (counter.last or most) + 1)


def _max_lost_problems(above: tuple[str, ...], max_lost: int | None, counter_values: int) -> list[Problem]:
    # With one more, no counter but the last one's own would be out of sequence.
    if max_lost is None or max_lost <= counter_values - 2:
        return []
    most = counter_values - 2
    return [
        ((*above, "max_lost"), f"{max_lost} can't be told by {counter_values} counter values; expected 0 to {most}")
    ]


def _checksum_problems(checksum: Checksum, message: Message) -> list[Problem]:
    bits = METHOD_BITS[checksum.method]
    if checksum.signal is None:
        short = message.length < 2
        return [(("checksum",), f"message {message.name!r} is too short for one")] if short else []
    signal = _signal(checksum.signal, message)
    place = ("checksum", "signal")
    if signal is None:
        return [(place, f"message {message.name!r} has no signal {checksum.signal!r}")]
    field = bit_field(signal) if not signal.conversion.is_float else None
    if field is None or (field.bits, field.shift, field.end_byte - field.first_byte) != (bits, 0, 1):
        what = "the low nibble of a byte" if bits == 4 else "one whole byte"
        return [(place, f"{checksum.signal!r} is not {what}, where {checksum.method} has its checksum")]
    return []


def _signal(name: str, message: Message) -> Signal | None:
    return next((signal for signal in message.signals if signal.name == name), None)


def message_check(protection: Protection, message: Message, resync_ns: int) -> MessageCheck:
    """`protection` resolved; ValueError with the first of its `problems`."""
    for place, what in problems(protection, message):
        raise ValueError(f"{'.'.join(place)}: {what}")
    intact: Intact | None = None
    read: RawReader | None = None
    needed_bytes, values, max_lost = 0, 1, None
    if protection.counter is not None:
        signal = message.get_signal_by_name(protection.counter.signal)
        field = bit_field(signal)
        read, needed_bytes = raw_reader(field), field.end_byte
        values, max_lost = (protection.counter.last or field.mask) + 1, protection.counter.max_lost
    if protection.checksum is not None:
        name, at = protection.checksum.signal, message.length - 1
        if name is not None:
            at = bit_field(message.get_signal_by_name(name)).first_byte
        intact, needed_bytes = checksum_check(protection.checksum.method, message.frame_id, at), message.length
    if protection.e2e is not None:
        profile = E2E_PROFILES[protection.e2e.profile]
        intact = e2e_check(protection.e2e.profile, protection.e2e.data_ids, protection.e2e.data_id_mode)
        byte, mask = profile.counter_byte, (1 << profile.counter_bits) - 1
        read, needed_bytes = (lambda data: data[byte] & mask), message.length
        values, max_lost = profile.counter_values, protection.e2e.max_lost
    if max_lost is None:
        # Never more than half of the counter's circle: a step back must not look like a loss.
        max_lost = max(0, min(_MAX_LOST, values // 2 - 1))
    return MessageCheck(needed_bytes, message.length, intact, read, values, max_lost, resync_ns)


def judged(check: MessageCheck, sender: Sender, t_ns: int, data: bytes) -> tuple[Status, int]:
    """What a frame is, and how many were lost before it; `sender` remembers it."""
    if len(data) < check.needed_bytes:
        sender.unread += 1
        return Status.WRONG_CHECKSUM, 0
    if len(data) > check.checked_bytes:
        data = data[: check.checked_bytes]
    if check.is_intact is not None and not check.is_intact(data):
        sender.unread += 1
        return Status.WRONG_CHECKSUM, 0
    if check.read_counter is None:
        return Status.OK, 0
    return _in_order(check, sender, t_ns, check.read_counter(data))


def _in_order(check: MessageCheck, sender: Sender, t_ns: int, counter: int) -> tuple[Status, int]:
    if counter >= check.counter_values:  # AUTOSAR's 15: "not valid"
        sender.out_of_step = True
        return Status.WRONG_SEQUENCE, 0
    last, is_recent = sender.counter, abs(t_ns - sender.counter_ns) <= check.resync_ns
    sender.counter, sender.counter_ns = counter, t_ns
    if last == counter and is_recent:
        return Status.REPEATED, 0
    unread, sender.unread = sender.unread, 0
    if last is None or not is_recent:
        sender.out_of_step = False
        return Status.INITIAL, 0
    skipped = (counter - last) % check.counter_values - 1
    if skipped > check.max_lost:
        sender.out_of_step = True
        return Status.WRONG_SEQUENCE, 0
    if sender.out_of_step:
        sender.out_of_step = False
        return Status.WRONG_SEQUENCE, 0
    # Frames that came and could not be read are counted as what they were.
    lost = max(0, skipped - unread)
    return (Status.SOME_LOST, lost) if lost else (Status.OK, 0)
