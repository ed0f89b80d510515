"""Verdicts on frames by counter and checksum: sequences written by hand, and the decoder's counts."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict

import cantools
import pytest

from dsz_daemon.errors import ConfigError
from dsz_daemon.pipeline.decode import Decoder
from dsz_daemon.pipeline.decode_counters import MessageCounts, Sender
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.mapping import Part, Source
from dsz_daemon.pipeline.protection import Checksum, Counter, E2e, Protection, Status, judged, message_check, problems
from dsz_daemon.pipeline.rate_bound import RateBound

MS = 1_000_000
RESYNC_NS = 500 * MS
TEXT = """\
VERSION ""
NS_ :
BS_:
BU_: X
BO_ 37 M: 8 X
 SG_ VALUE : 0|16@1- (0.01,0) [0|0] "" X
 SG_ COUNTER : 43|4@0+ (1,0) [0|0] "" X
 SG_ TWO_BITS : 45|2@0+ (1,0) [0|0] "" X
 SG_ FLAG : 46|1@0+ (1,0) [0|0] "" X
 SG_ WIDE : 16|16@1+ (1,0) [0|0] "" X
 SG_ MUX M : 32|4@1+ (1,0) [0|0] "" X
 SG_ ON_A_PAGE m1 : 36|4@1+ (1,0) [0|0] "" X
 SG_ NIBBLE : 51|4@0+ (1,0) [0|0] "" X
 SG_ CHECKSUM : 63|8@0+ (1,0) [0|0] "" X
BO_ 38 FD: 2 X
 SG_ VALUE : 0|8@1+ (1,0) [0|0] "" X
BO_ 39 ONE: 1 X
 SG_ VALUE : 0|8@1+ (1,0) [0|0] "" X
BO_ 40 F: 8 X
 SG_ FLOAT : 0|32@1- (1,0) [0|0] "" X
SIG_VALTYPE_ 40 FLOAT : 1;
"""
MESSAGES = {m.name: m for m in cantools.database.load_string(TEXT, strict=False).messages}
O, I, L, C, R, W = (
    Status.OK, Status.INITIAL, Status.SOME_LOST, Status.WRONG_CHECKSUM, Status.REPEATED, Status.WRONG_SEQUENCE,
)  # fmt: skip


def payload(counter: int, value: int = 0) -> bytes:
    """Value, counter (low nibble of byte 5) and Toyota's checksum, put together by hand."""
    body = value.to_bytes(2, "little", signed=True) + bytes([0, 0, 0, counter, 0])
    return body + bytes([(8 + 37 + sum(body)) % 256])


def verdicts(counter: Counter, values: Iterable[int | None], period_ns: int = 10 * MS) -> tuple[list[Status], int]:
    """Of frames with these counters, a period apart (None: nothing came); and how many were counted as lost."""
    check = message_check(Protection("M", counter), MESSAGES["M"], RESYNC_NS)
    sender, found, total = Sender(), [], 0
    for n, value in enumerate(values):
        if value is not None:
            status, lost = judged(check, sender, n * period_ns, payload(value))
            found.append(status)
            total += lost
    return found, total


FOUR_BITS = Counter("COUNTER")


@pytest.mark.parametrize(
    ("counter", "values", "expected", "lost"),
    [
        # One after the other, round the end.
        (FOUR_BITS, [13, 14, 15, 0, 1], [I, O, O, O, O], 0),
        # A counter that stops: the first of them is used.
        (FOUR_BITS, [5, 6, 6, 6, 7], [I, O, R, R, O], 0),
        # One, two and three lost; four are too many, and cost two frames.
        (FOUR_BITS, [1, 3, 6, 10], [I, L, L, L], 1 + 2 + 3),
        (FOUR_BITS, [1, 6, 7, 8], [I, W, W, O], 0),
        # A frame sent again later, and what comes after it.
        (FOUR_BITS, [4, 5, 6, 4, 7, 8, 9], [I, O, O, W, W, O, O], 0),
        # Two senders in turn, whether far apart or close together: nothing but the first is used.
        (FOUR_BITS, [1, 9, 2, 10, 3, 11, 4], [I, W, W, W, W, W, W], 0),
        (FOUR_BITS, [1, 4, 2, 5, 3, 6, 4], [I, L, W, W, W, W, W], 2),
        # More may be let pass.
        (Counter("COUNTER", max_lost=14), [1, 6, 5], [I, L, L], 4 + 14),
        (Counter("COUNTER", max_lost=0), [1, 2, 4, 5, 6], [I, O, W, W, O], 0),
        # AUTOSAR's: 14 is followed by 0, 15 is no value.
        (Counter("COUNTER", last=14), [13, 14, 0, 1, 15, 2, 3], [I, O, O, O, W, W, O], 0),
        (Counter("COUNTER", last=14), [15, 15, 3, 4], [W, W, I, O], 0),
        # Two bits: one lost is told, two are a step back. One bit: only whether it moves.
        (Counter("TWO_BITS"), [0, 16, 48, 0, 16, 16, 0], [I, O, L, O, O, R, W], 1),
        (Counter("FLAG"), [0, 64, 0, 0, 64], [I, O, O, R, O], 0),
    ],
)
def test_sequences(counter: Counter, values: list[int], expected: list[Status], lost: int) -> None:
    assert verdicts(counter, values) == (expected, lost)


def test_after_a_silence_any_counter_will_do() -> None:
    """0.5 s of it, by the stamps: also when the clock has stepped back."""
    assert verdicts(FOUR_BITS, [1, 2, *[None] * 48, 9, 10]) == ([I, O, W, W], 0)
    assert verdicts(FOUR_BITS, [1, 2, *[None] * 49, 9, 10])[0] == [I, O, W, W]
    assert verdicts(FOUR_BITS, [1, 2, *[None] * 50, 9, 10]) == ([I, O, I, O], 0)
    check, sender = message_check(Protection("M", FOUR_BITS), MESSAGES["M"], RESYNC_NS), Sender()
    assert judged(check, sender, 5_000 * MS, payload(3))[0] == I
    assert judged(check, sender, 4_000 * MS, payload(3))[0] == I


def test_a_sender_that_is_stuck_stays_refused() -> None:
    """For longer than the silence: each of its frames keeps the old one fresh."""
    found, _ = verdicts(FOUR_BITS, [1, *[7] * 200])
    assert found == [I, W, *[R] * 199]


def test_corrupt_frames_are_not_lost_ones() -> None:
    """Of 1 2 X X 5 X 8 the X came: lost is the 6 or the 7 alone."""
    check = message_check(Protection("M", FOUR_BITS, Checksum("toyota")), MESSAGES["M"], RESYNC_NS)
    sender, found, total = Sender(), [], 0
    for n, data in enumerate([payload(1), payload(2), b"\1" * 8, b"\2" * 8, payload(5), payload(6)[:7], payload(8)]):
        status, lost = judged(check, sender, n * MS, data)
        found.append(status)
        total += lost
    assert found == [I, O, C, C, O, C, L]
    assert total == 1


def test_a_corrupt_frames_counter_is_not_believed() -> None:
    check = message_check(Protection("M", FOUR_BITS, Checksum("toyota")), MESSAGES["M"], RESYNC_NS)
    sender = Sender()
    bad = bytearray(payload(9))
    bad[7] ^= 1
    found = [judged(check, sender, n * MS, data)[0] for n, data in enumerate([payload(1), bytes(bad), payload(2)])]
    assert found == [I, C, O]


@pytest.mark.parametrize("cut", range(8))
def test_a_cut_payload_can_not_be_right(cut: int) -> None:
    """Even where its own last byte happens to be the sum of the others."""
    check = message_check(Protection("M", None, Checksum("toyota")), MESSAGES["M"], RESYNC_NS)
    body = bytes(max(0, cut - 1))
    data = (body + bytes([(cut + 37) % 256]))[:cut]
    assert judged(check, Sender(), 0, data) == (C, 0)


def test_the_padding_of_a_longer_frame_is_no_part_of_the_message() -> None:
    check = message_check(Protection("FD", None, Checksum("sum8")), MESSAGES["FD"], RESYNC_NS)
    assert judged(check, Sender(), 0, b"\x07\x07" + b"\xcc" * 6)[0] is O
    assert judged(check, Sender(), 0, b"\x07\x08" + b"\xcc" * 6)[0] is C


def test_a_counter_alone_needs_only_its_own_byte() -> None:
    check = message_check(Protection("M", FOUR_BITS), MESSAGES["M"], RESYNC_NS)
    assert judged(check, Sender(), 0, payload(1)[:6])[0] is I
    assert judged(check, Sender(), 0, payload(1)[:5])[0] is C


@pytest.mark.parametrize(
    ("protection", "expected"),
    [
        (Protection("M", Counter("COUNT")), "counter.signal: message 'M' has no signal 'COUNT'"),
        (Protection("F", Counter("FLOAT")), "counter.signal: 'FLOAT' can't count"),
        (Protection("M", Counter("ON_A_PAGE")), "counter.signal: 'ON_A_PAGE' can't count"),
        (Protection("M", Counter("COUNTER", last=16)), "counter.last: 16 is no value of 'COUNTER'; expected 1 to 15"),
        (Protection("M", Counter("TWO_BITS", max_lost=3)), "counter.max_lost: 3 can't be told by 4 counter values"),
        (Protection("M", Counter("COUNTER", 14, 14)), "counter.max_lost: 14 can't be told by 15 counter values"),
        (Protection("M", None, Checksum("toyota", "SUM")), "checksum.signal: message 'M' has no signal 'SUM'"),
        (Protection("M", None, Checksum("xor", "WIDE")), "checksum.signal: 'WIDE' is not one whole byte"),
        (Protection("M", None, Checksum("honda", "CHECKSUM")), "'CHECKSUM' is not the low nibble of a byte"),
        (Protection("F", None, Checksum("sum8", "FLOAT")), "checksum.signal: 'FLOAT' is not one whole byte"),
        (Protection("ONE", None, Checksum("sum8")), "checksum: message 'ONE' is too short"),
        (Protection("FD", e2e=E2e(5, (1,))), "e2e.profile: profile 5 has a header of 3 bytes, message 'FD' 2"),
        (Protection("M", e2e=E2e(2, (1,), max_lost=15)), "e2e.max_lost: 15 can't be told by 16 counter values"),
    ],
)
def test_what_can_not_be_checked_is_said(protection: Protection, expected: str) -> None:
    message = MESSAGES[protection.message]
    assert [f"{'.'.join(place)}: {what}" for place, what in problems(protection, message) if expected in
            f"{'.'.join(place)}: {what}"]  # fmt: skip
    with pytest.raises(ValueError, match=r"^(counter|checksum|e2e)"):
        message_check(protection, message, RESYNC_NS)


@pytest.mark.parametrize(
    "protection",
    [
        Protection("M", Counter("TWO_BITS", max_lost=2), Checksum("honda", "NIBBLE")),
        Protection("M", Counter("WIDE"), Checksum("crc8_sae_j1850", "CHECKSUM")),
        Protection("FD", e2e=E2e(2, tuple(range(16)))),
    ],
)
def test_what_can_be_checked_is_let_be(protection: Protection) -> None:
    assert problems(protection, MESSAGES[protection.message]) == []


# --- in the decoder ---


def decoder(*protections: Protection, bound: RateBound | None = None, channel: str | None = None) -> Decoder:
    source = Source("gyro_z", "M", (Part("VALUE"),), 1.0, -100.0, 100.0, channel=channel)
    return Decoder([source], MESSAGES, protections=protections, rate_bound=bound)


def frame(t_ms: float, data: bytes, channel: str = "can0") -> Frame:
    return Frame(round(t_ms * MS), channel, 37, data)


BOTH = Protection("M", FOUR_BITS, Checksum("toyota"))


def test_refused_frames_give_no_samples_and_are_counted_once() -> None:
    stream = [payload(1), payload(2), payload(2), b"\xff" * 8, payload(5), payload(9), payload(10), payload(11)]
    tested = decoder(BOTH)
    used = [bool(tested.decode(frame(10 * n, data))) for n, data in enumerate(stream)]
    # 1, 2, 2 again, corrupt, 5 (two away, one of which came corrupt), 9: three lost, 10, 11.
    assert used == [True, True, False, False, True, True, True, True]
    seen = tested.counters.messages["M"]
    assert (seen.frames, seen.repeated, seen.wrong_checksum, seen.wrong_sequence, seen.lost) == (6, 1, 1, 0, 1 + 3)
    assert tested.counters.roles["gyro_z"].samples == 6
    assert tested.rejected == tested.counters.rejected == 2


def test_a_value_in_a_refused_frame_is_not_judged_as_well() -> None:
    """32767 * 0.01 is out of range; with a wrong checksum that is all that is said of it."""
    tested = decoder(BOTH)
    bad = bytearray(payload(1, 32767))
    tested.decode(frame(0, bytes(bad)))
    bad[7] ^= 0x80
    tested.decode(frame(1, bytes(bad)))
    assert tested.counters.roles["gyro_z"].out_of_range == 1
    assert tested.counters.messages["M"].wrong_checksum == 1
    assert tested.rejected == 2


def test_each_channel_has_a_counter_of_its_own() -> None:
    sources = [
        Source("gyro_z", "M", (Part("VALUE"),), 1.0, -100.0, 100.0, channel="can0"),
        Source("yaw_rate_reference", "M", (Part("VALUE"),), 1.0, -100.0, 100.0, channel="can1"),
    ]
    tested = Decoder(sources, MESSAGES, protections=(BOTH,))
    for n in range(20):
        assert tested.decode(frame(10 * n, payload(n % 16), "can0"))
        assert tested.decode(frame(10 * n, payload((n + 7) % 16), "can1"))
    assert tested.counters.messages["M"].frames == 40
    assert tested.rejected == 0


def test_frames_of_another_channel_do_not_disturb_the_counter() -> None:
    tested = decoder(BOTH)
    for n in range(20):
        assert tested.decode(frame(10 * n, payload(n % 16), "can0"))
        assert not tested.decode(frame(10 * n, payload(9), "can1"))
    assert tested.counters.ambiguous == 20


def test_the_rate_bound_comes_first() -> None:
    """Beyond it nothing is looked at, not even the checksum."""
    tested = decoder(BOTH, bound=RateBound.of(100.0, 0.0, 1.0))
    stamps = [0, 1, 2, 3, 10, 11, 20]
    used = [bool(tested.decode(frame(t_ms, payload(n % 16)))) for n, t_ms in enumerate(stamps)]
    # Counters 0, 4 and 6 are let in. What lay between has come, and is not counted as lost as well.
    assert used == [True, False, False, False, True, False, True]
    seen = tested.counters.messages["M"]
    assert (seen.babbling, seen.frames, seen.lost, seen.wrong_checksum) == (4, 3, 0, 0)
    assert tested.rejected == 4
    assert decoder(BOTH, bound=RateBound.of(100.0, 0.0, 1.0)).decode(frame(1, payload(0)))


def test_counters_can_be_written_down_and_share_nothing() -> None:
    tested = decoder(BOTH, bound=RateBound.of(100.0, 0.0, 1.0))
    tested.decode(frame(0, payload(3)))
    before = tested.counters
    assert json.loads(json.dumps(asdict(before)))["messages"]["M"]["senders"]["can0"]["counter"] == 3
    before.messages["M"].senders["can0"].counter = 9
    tested.decode(frame(10, payload(4)))
    assert tested.counters.messages["M"].repeated == 0
    assert before.messages["M"].frames == 1
    assert MessageCounts().copy() == MessageCounts()


def test_protections_that_do_not_fit_are_all_said() -> None:
    with pytest.raises(ConfigError) as caught:
        decoder(Protection("M", Counter("NOPE")), Protection("OTHER", FOUR_BITS))
    text = str(caught.value)
    assert "protection.M: counter.signal: message 'M' has no signal 'NOPE'" in text
    assert "protection.OTHER: is not a mapped message" in text
