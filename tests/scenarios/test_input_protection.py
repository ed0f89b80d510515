"""Senders that stop counting, corrupt, repeat, lose, babble, or are not who they seem to be.

Counts are those of the faults that were planted; no offset moves by more than the bound of
`test_signal_faults`, and where a message is refused for good its channels are invalid.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import protected_drive as pd
import pytest
import short_drive as sd
import signal_faults as faults
from protected_drive import PROTECTED_CONFIG, PROTECTED_DBC, merged, signed
from scenario_results import Called, Replayed, read_results
from short_drive import ACCELS, RATES, STEER, Sent, edited
from test_signal_faults import ACCELEROMETERS, ALL, GYROS, poisoned

Dsz = Callable[..., Called]
Frames = Sequence[Sent]
pytestmark = pytest.mark.usefixtures("without_report")

NAMES = {RATES: "IMU_RATES", ACCELS: "IMU_ACCELS", STEER: "STEERING"}
COUNTS = ("wrong_checksum", "repeated", "wrong_sequence", "babbling", "lost")


def run(dsz: Dsz, folder: Path, sent: Frames, config: str = PROTECTED_CONFIG) -> Replayed:
    log, path = sd.write(folder, sent, config, PROTECTED_DBC)
    called = dsz("replay", log, "-c", path, "-o", folder / "out", "--json")
    assert called.code == 0, called.err
    return read_results(folder / "out")


def counted(results: Replayed, can_id: int) -> dict[str, int]:
    message = results.summary["counts"]["messages"][NAMES[can_id]]
    return {name: message[name] for name in COUNTS if message[name]}


@pytest.fixture(scope="module")
def faultless(drive: Frames, tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    from dsz_daemon.runs.replay import replay

    folder = tmp_path_factory.mktemp("protected")
    log, config = sd.write(folder, signed(drive), PROTECTED_CONFIG, PROTECTED_DBC)
    replay([log], config, folder)
    return read_results(folder)


def test_a_faultless_drive_is_the_same_with_and_without_protection(
    dsz: Dsz, drive: Frames, faultless: Replayed, tmp_path: Path
) -> None:
    unchecked = edited(PROTECTED_CONFIG, (PROTECTED_CONFIG[PROTECTED_CONFIG.index("protection:") :], ""))
    plain = run(dsz, tmp_path, signed(drive), unchecked)
    assert repr(plain.samples) == repr(faultless.samples)
    for can_id in NAMES:
        assert counted(faultless, can_id) == {}
    assert faultless.summary["counts"]["rejected"] == 0
    assert faultless.summary["warnings"] == []


class Case(NamedTuple):
    """What is planted, in which message what is counted, who is invalid when, what is said."""

    plant: Callable[[Frames], Frames]
    counts: dict[int, dict[str, int]]
    invalid: tuple[tuple[str, ...], float, float] | None = None
    said: tuple[str, ...] = ()


def between(frame: Sent, can_id: int, start_s: float, end_s: float = 100.0) -> bool:
    return frame.can_id == can_id and start_s <= frame.t_s < end_s


def counter_stops(drive: Frames) -> Frames:
    """Fresh values and right sums, but the counter stays where it was at 12 s."""
    last, found = 0, []
    for frame in signed(drive):
        if between(frame, RATES, 12.0):
            found.append(frame._replace(data=pd.toyota(frame.data[:6] + bytes([last]))))
            continue
        last = frame.data[6] if frame.can_id == RATES else last
        found.append(frame)
    return found


def one_in_ten_corrupt(drive: Frames) -> Frames:
    """From 12 s on every tenth acceleration has one bit flipped, whichever."""
    chance, n, found = random.Random(4), 0, []
    for frame in signed(drive):
        if between(frame, ACCELS, 12.0):
            n += 1
            if n % 10 == 0:
                data = bytearray(frame.data)
                bit = chance.randrange(64)
                data[bit // 8] ^= 1 << bit % 8
                found.append(frame._replace(data=bytes(data)))
                continue
        found.append(frame)
    return found


def every_fifth_twice(drive: Frames) -> Frames:
    """As a gateway does that sends its last frame again: each repetition is a millisecond late."""
    sent = signed(drive)
    rates = [frame for frame in sent if between(frame, RATES, 12.0)]
    return merged(sent, [frame._replace(t_s=frame.t_s + 0.001) for frame in rates[::5]])


def played_back(drive: Frames) -> Frames:
    """All that was sent from 6.5 to 9.5 s (speeding up) is sent again from 20 s on, between the true frames."""
    sent = signed(drive)
    wanted = (RATES, ACCELS, STEER)
    recorded = [frame for frame in sent if frame.can_id in wanted and 6.5 <= frame.t_s < 9.5]
    return merged(sent, [frame._replace(t_s=frame.t_s + 13.5013) for frame in recorded])


def second_sender(drive: Frames) -> Frames:
    """From 20 to 24 s somebody else sends the same ids in turn, well signed, turning and braking hard."""
    lies = sd.words_changed(drive, RATES, "<3h", lambda _t, *_r: (1000, -1000, 2000))
    lies = sd.words_changed(lies, ACCELS, "<3h", lambda _t, *_a: (-2000, 2000, 4000))
    lies = [f._replace(t_s=f.t_s + 0.005) for f in lies if f.can_id in {RATES, ACCELS} and 20.0 <= f.t_s < 24.0]
    return merged(signed(drive), signed(lies, first=9))


def some_lost(drive: Frames) -> Frames:
    """One, two and three rates in a row never come, a second apart."""
    sent, n = [], 0
    for frame in signed(drive):
        if between(frame, RATES, 12.0):
            n += 1
            if n % 300 in {0, 100, 101, 200, 201, 202}:
                continue
        sent.append(frame)
    return sent


def cut_short(drive: Frames) -> Frames:
    return [f._replace(data=f.data[:4]) if between(f, RATES, 12.0) else f for f in signed(drive)]


def all_bits_flipped(drive: Frames) -> Frames:
    """From 12 to 15 s, of all three messages."""
    return [
        f._replace(data=bytes(byte ^ 0xFF for byte in f.data)) if f.can_id in NAMES and 12.0 <= f.t_s < 15.0 else f
        for f in signed(drive)
    ]


def wrong_data_id(drive: Frames) -> Frames:
    """Another message's frames under this one's id: right in every way but for whose they are."""
    return [
        f._replace(data=bytes([f.data[0] ^ 0x1D, *f.data[1:]])) if between(f, ACCELS, 12.0) else f
        for f in signed(drive)
    ]


CASES = {
    # The first frame with the old counter is the first that is refused.
    "a counter that stops": Case(
        counter_stops, {RATES: {"repeated": 1400}}, (GYROS, 12.6, 26.0),
        ("IMU_RATES: 1400 of 2600 frames refused", "gyro_x, gyro_y, gyro_z: no value in the last 14.0 s"),
    ),
    "one frame in ten corrupt": Case(
        one_in_ten_corrupt, {ACCELS: {"wrong_checksum": 140}}, None, ("IMU_ACCELS: 140 of 2600 frames refused",)
    ),
    "frames sent twice": Case(
        every_fifth_twice, {RATES: {"repeated": 280}}, None, ("IMU_RATES: 280 of 2880 frames refused",)
    ),
    "some frames lost": Case(
        # Of 1400: 100, 101; 200, 201, 202; 300; four times round, then 1300 and 1301. (A missing 1400 shows nowhere.)
        some_lost, {RATES: {"lost": 4 * 6 + 2}}, None, ("IMU_RATES: 26 frames lost", "can1 310: 26 frames"),
    ),
    "payloads cut to four bytes": Case(
        cut_short, {RATES: {"wrong_checksum": 1400}}, (GYROS, 12.6, 26.0),
        ("IMU_RATES: 1400 of 2600 frames refused", "gyro_x, gyro_y, gyro_z: no value in the last 14.0 s"),
    ),
    "all bits flipped for 3 s": Case(
        all_bits_flipped,
        {RATES: {"wrong_checksum": 300}, ACCELS: {"wrong_checksum": 300}, STEER: {"wrong_checksum": 150}},
        (ALL, 12.6, 14.9),
        ("IMU_RATES: 300 of", "IMU_ACCELS: 300 of", "STEERING: 150 of"),
    ),
    "another message under this one's id": Case(
        wrong_data_id, {ACCELS: {"wrong_checksum": 1400}}, (ACCELEROMETERS, 12.6, 26.0),
        ("IMU_ACCELS: 1400 of 2600 frames refused", "accel_x, accel_y, accel_z: no value in the last 14.0 s"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_one_fault(dsz: Dsz, drive: Frames, faultless: Replayed, tmp_path: Path, name: str) -> None:
    case = CASES[name]
    faulty = run(dsz, tmp_path, case.plant(drive))
    assert not poisoned(faulty, faultless, 12.0)
    assert {can_id: counted(faulty, can_id) for can_id in NAMES} == {key: {} for key in NAMES} | case.counts
    refused = sum(n for counts in case.counts.values() for kind, n in counts.items() if kind != "lost")
    assert faulty.summary["counts"]["rejected"] == refused
    said_or_not(faulty, case.said)
    channels, start_s, end_s = case.invalid or ((), 0.0, 0.0)
    for channel in channels:
        assert faulty.states(channel, start_s, end_s) == {"invalid"}, channel
    for channel in set(ALL) - set(channels):
        assert "invalid" not in faulty.states(channel, 12.0, 26.0), channel


def said_or_not(faulty: Replayed, patterns: Sequence[str]) -> None:
    warnings = faulty.summary["warnings"]
    for pattern in patterns:
        assert any(warning.startswith(pattern) for warning in warnings), (pattern, warnings)
    assert [w for w in warnings if not any(w.startswith(pattern) for pattern in patterns)] == []


def test_a_recording_played_back_between_the_true_frames(
    dsz: Dsz, drive: Frames, faultless: Replayed, tmp_path: Path
) -> None:
    """Right sums and counters that count: they and the true ones refuse each other, and nothing is learnt."""
    faulty = run(dsz, tmp_path, played_back(drive))
    assert not poisoned(faulty, faultless, 20.0)
    for can_id in (RATES, ACCELS):
        refused = sum(counted(faulty, can_id).values())
        # Of both senders all but the very first; and two at the end, until the true one is believed again.
        assert 2 * 300 - 2 <= refused <= 2 * 300 + 2
    # 13.5 s are 675 of its frames, 45 times round its 15: each false one comes as the true one did just before it.
    assert counted(faulty, STEER) == {"repeated": 150}
    for channel in ALL:
        assert faulty.states(channel, 20.6, 22.9) == {"invalid"}
        assert "invalid" not in faulty.states(channel, 23.2, 26.0)


def test_a_second_sender_in_turn(dsz: Dsz, drive: Frames, faultless: Replayed, tmp_path: Path) -> None:
    """It can silence the sensor, but not teach it anything."""
    faulty = run(dsz, tmp_path, second_sender(drive))
    assert not poisoned(faulty, faultless, 20.0)
    for can_id in (RATES, ACCELS):
        assert counted(faulty, can_id).keys() <= {"wrong_sequence", "lost"}
        assert counted(faulty, can_id)["wrong_sequence"] >= 2 * 400 - 4
    for channel in ALL:
        assert faulty.states(channel, 20.6, 23.9) == {"invalid"}
        assert "invalid" not in faulty.states(channel, 24.2, 26.0)


# --- babbling: no counter and no checksum to help ---

LIMIT_HZ, BURST_S = 2000, Fraction(1, 2)


def babbled(can_id: int, value: int, rate_hz: int, start_s: float, end_s: float) -> Frames:
    count = round((end_s - start_s) * rate_hz)
    data = value.to_bytes(2, "little", signed=True) * 3
    return [Sent(start_s + (n + 0.5) / rate_hz, "can1", can_id, data) for n in range(count)]


def beyond_the_bound(sent: Frames, can_id: int) -> int:
    """Frames that a bucket of tokens, counted in fractions, has none for; stamps as the log has them."""
    most = LIMIT_HZ * BURST_S + 1
    tokens, last_us, refused = most, None, 0
    for frame in sent:
        if frame.can_id != can_id:
            continue
        t_us = round(frame.t_s * 1e6)
        tokens = min(most, tokens + Fraction(LIMIT_HZ * (t_us - (t_us if last_us is None else last_us)), 10**6))
        last_us = t_us
        if tokens >= 1:
            tokens -= 1
        else:
            refused += 1
    return refused


def babble_results(dsz: Dsz, folder: Path, sent: Frames) -> dict[str, Any]:
    log, path = sd.write(folder, sent, edited(sd.CONFIG, ("rate_hz: 50", "rate_hz: 25")))
    called = dsz("replay", log, "-c", path, "-o", folder / "out", "--json")
    assert called.code == 0, called.err
    return read_results(folder / "out").summary


def test_a_babbling_id_at_a_hundredfold_rate(dsz: Dsz, drive: Frames, tmp_path: Path) -> None:
    """A stuck yaw rate unit: its own last value 10 000 times a second, from 21 s to 22.5 s."""
    last = [frame for frame in drive if frame.can_id == RATES and frame.t_s < 21.0][-1]
    value = int.from_bytes(last.data[:2], "little", signed=True)
    sent = merged(drive, babbled(RATES, value, 10_000, 21.0, 22.5))
    summary = babble_results(dsz, tmp_path, sent)
    counts, expected = summary["counts"]["messages"]["IMU_RATES"], beyond_the_bound(sent, RATES)
    assert expected > 0.7 * 15_000
    assert counts["babbling"] == expected
    assert counts["frames"] == 2600 + 15_000 - expected
    assert summary["counts"]["messages"]["IMU_ACCELS"]["babbling"] == 0
    (warning,) = summary["warnings"]
    assert warning.startswith("IMU_RATES: ")
    assert f"beyond loop.input_rate_limit_hz {expected})" in warning


@pytest.mark.parametrize("lie", [200, 2000])
def test_what_a_babbling_liar_can_do_is_bounded(dsz: Dsz, drive: Frames, tmp_path: Path, lie: int) -> None:
    """No counter, no checksum: of the samples that pass nearly all are his, 2 or 20 deg/s about every axis.

    Within the rate bound only the gates and the slow laws stand against him: in 1.5 s he moves no gyro's offset
    by more than 0.1 deg/s, and the accelerometers' by nothing beside their spread.
    """
    summary = babble_results(dsz, tmp_path, merged(drive, babbled(RATES, lie, 10_000, 21.0, 22.5)))
    for channel, row in summary["channels"].items():
        bound = 0.1 * sd.DEG if channel in GYROS else 0.5 * row["offset_std"]
        assert abs(row["offset"] - sd.OFFSETS[channel]) < bound, channel


def test_a_hitch_of_the_bus_is_no_babbling(dsz: Dsz, drive: Frames, tmp_path: Path) -> None:
    """Everything of half a second handed over at once."""
    sent = [f._replace(t_s=21.5) if 21.0 <= f.t_s < 21.5 else f for f in drive]
    summary = babble_results(dsz, tmp_path, sent)
    assert all(message["babbling"] == 0 for message in summary["counts"]["messages"].values())
    assert summary["counts"]["rejected"] == 0


def test_wheels_frozen_on_a_straight_road(dsz: Dsz, drive: Frames, tmp_path: Path) -> None:
    """They agree with everything else there; only that they repeat themselves gives them away."""
    summary = babble_results(dsz, tmp_path, faults.message_frozen(sd.WHEELS, 9.0)(drive))
    assert any(warning.startswith("wheel_speed_fl:") and "frozen unit" in warning for warning in summary["warnings"])
