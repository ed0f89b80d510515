"""One signal at a time cut, spiked, frozen, late or out of order: what is published and said, what offsets do.

The stated bound: no fault moves an offset by more than 0.05 deg/s or 0.05 m/s^2 (or a third of the
spread published beside it: accelerometers have learnt for 4 s when faults begin) from what the same
drive gives without it. A channel that merely stops to learn has not moved. Where a channel has no
valid reading, its offset does not move at all.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cantools
import pytest
import short_drive as sd
import signal_faults as faults
from scenario_results import Called, Replayed, moved, read_results
from short_drive import ACCELS, CONFIG, PEDALS, RATES, START_S, STEER, WHEELS, edited
from signal_faults import Fault, Frames

from dsz_daemon.shipped import shipped

Dsz = Callable[..., Called]
Span = tuple[tuple[str, ...], float, float]
pytestmark = pytest.mark.usefixtures("without_report")

ALL = tuple(sd.OFFSETS)
GYROS, ACCELEROMETERS = ALL[:3], ALL[3:]
BOUND = {channel: 0.05 * sd.DEG if channel in GYROS else 0.05 for channel in ALL}
# Half the rate of the other scenarios: the faults are those of single frames, the steps are many.
SLOW = edited(CONFIG, ("rate_hz: 50", "rate_hz: 25"))


class Case(NamedTuple):
    """A fault, when it begins, and what is true of the run.

    `said`: patterns, each of which a warning must match; and there must be no other warning.
    `invalid`: (channels, from, until) when they are invalid, and their offsets don't move at all.
    """

    fault: Fault
    start_s: float
    said: tuple[str, ...] = ()
    invalid: tuple[Span, ...] = ()
    gaps: int = 0
    clock_steps: int = 0


def spiked(role: str) -> Case:
    """Single samples at the end of the range are refused one by one."""
    return Case(faults.spiked(role), 12.0, (f"{role}: 14 values not used: single samples that jump off and back",))


def still(fault: Fault, role: str, start_s: float, until_s: float = 26.0) -> Case:
    """Noticed within 3 s (gyros) or 1 s (accelerometers) of driving, stale 0.5 s later."""
    said = [f"{role}: [0-9]+ values not used: it repeated itself while the wheels' speed changed: a frozen sensor"]
    if until_s == 26.0:
        said.append(gone(start_s + (3.0 if role in GYROS else 1.0), role))
    return Case(fault, start_s, tuple(said), (((role,), start_s + (3.6 if role in GYROS else 1.6), until_s),))


def gone(since_s: float, *roles: str) -> str:
    return f"{', '.join(roles)}: no value in the last {26.0 - since_s:.1f} s of the run"


WHEEL_ROLES = tuple(f"wheel_speed_{wheel}" for wheel in ("fl", "fr", "rl", "rr"))
REFUSED = "14 of 1300 values refused .*out of range 14"
CASES = {
    "gyro_x spiked": spiked("gyro_x"),
    "gyro_z spiked": spiked("gyro_z"),
    "accel_x spiked": spiked("accel_x"),
    "accel_y spiked": spiked("accel_y"),
    "gyro_z frozen in a bend": still(faults.frozen("gyro_z", 14.2), "gyro_z", 14.2),
    "gyro_z frozen for 5 s": still(faults.frozen("gyro_z", 13.0, 18.0), "gyro_z", 13.0, 17.9),
    "accel_y frozen in a bend": still(faults.frozen("accel_y", 14.2), "accel_y", 14.2),
    "accel_x frozen while braking": still(faults.frozen("accel_x", 19.2), "accel_x", 19.2),
    "gyro_x zero": still(faults.constant("gyro_x", 0, 12.0), "gyro_x", 12.0),
    "gyro_z all bits set": still(faults.constant("gyro_z", -1, 12.0), "gyro_z", 12.0),
    "accel_x zero": still(faults.constant("accel_x", 0, 12.0), "accel_x", 12.0),
    "accel_y all bits set": still(faults.constant("accel_y", -1, 12.0), "accel_y", 12.0),
    "accel_z zero": still(faults.constant("accel_z", 0, 12.0), "accel_z", 12.0),
    "one wheel spiked": Case(faults.spiked("wheel_speed_rl"), 12.0, (f"wheel_speed_rl: {REFUSED}",)),
    "one wheel spiked within its range": Case(faults.spiked("wheel_speed_rl", 43_000), 12.0),
    "one wheel frozen": Case(faults.frozen("wheel_speed_rl", 14.2), 14.2),
    "one wheel zero": Case(faults.constant("wheel_speed_rl", 0, 12.0), 12.0),
    "one wheel all bits set": Case(
        faults.constant("wheel_speed_rl", 65_535, 12.0),
        12.0,
        ("wheel_speed_rl: 700 of 1300 values refused", gone(12.0, "wheel_speed_rl")),
    ),
    "wheels cut for 3 s": Case(faults.cut([WHEELS], 12.0, 15.0), 12.0, (r"can0 0AA: 150 frames .*gap 3\.02 s",)),
    "wheels cut for good": Case(faults.cut([WHEELS], 12.0), 12.0, (gone(12.0, *WHEEL_ROLES),)),
    "wheels all bits set": Case(
        faults.all_bits_set([WHEELS], 12.0), 12.0, ("wheel_speed_..: 700 of 1300", gone(12.0, *WHEEL_ROLES))
    ),
    "wheels frozen in a bend": Case(
        faults.message_frozen(WHEELS, 14.2),
        14.2,
        ("wheel_speed_..: 538 values not used: all wheels repeated themselves", gone(15.2, *WHEEL_ROLES)),
    ),
    "wheels 100 ms late": Case(faults.delayed([WHEELS], 0.1), 0.0),
    "steering spiked": Case(faults.spiked("steering_wheel_angle"), 12.0, (f"steering_wheel_angle: {REFUSED}",)),
    "steering spiked within its range": Case(faults.spiked("steering_wheel_angle", 3000), 12.0),
    "steering frozen in a bend": Case(faults.frozen("steering_wheel_angle", 14.2), 14.2),
    "steering zero": Case(faults.constant("steering_wheel_angle", 0, 12.0), 12.0),
    "steering cut for 3 s": Case(faults.cut([STEER], 12.0, 15.0), 12.0, (r"can0 025: 150 frames .*gap 3\.02 s",)),
    "steering cut for good": Case(faults.cut([STEER], 12.0), 12.0, (gone(12.0, "steering_wheel_angle"),)),
    "steering 100 ms late": Case(faults.delayed([STEER], 0.1), 0.0),
    "brake on for good": Case(faults.constant("brake", 1, 12.0), 12.0),
    "brake cut for good": Case(faults.cut([PEDALS], 12.0), 12.0, (gone(12.0, "brake"),)),
    "gyros cut for 3 s": Case(
        faults.cut([RATES], 12.0, 15.0), 12.0, (r"can1 310: 300 frames .*gap 3\.01 s",), ((GYROS, 12.6, 14.9),)
    ),
    "IMU cut for good": Case(
        faults.cut([RATES, ACCELS], 12.0), 12.0, (gone(12.0, *sorted(ALL)),), ((ALL, 12.6, 26.0),)
    ),
    "IMU all zero": Case(
        faults.all_zero([RATES, ACCELS], 12.0),
        12.0,
        (".*: .*a frozen sensor", gone(13.0, *sorted(ACCELEROMETERS)), gone(15.0, *sorted(GYROS))),
        ((GYROS, 15.6, 26.0), (ACCELEROMETERS, 13.6, 26.0)),
    ),
    "IMU at half its rate": Case(faults.half_rate, 0.0),
    "IMU 100 ms late": Case(faults.delayed([RATES, ACCELS], 0.1), 0.0),
    "all frames twice": Case(faults.twice, 0.0),
    "all frames up to 20 ms out of order": Case(
        faults.reordered, 0.0, (r"stamps go backwards [0-9]+ times, .* 0\.01",)
    ),
    "all silent for 0.5 s": Case(faults.cut(range(2048), 21.0, 21.5), 21.0, (r"can. ...: [125]+0? frames \(1\.9 %\)",)),
    "all silent for 5 s": Case(
        faults.cut(range(2048), 20.0, 25.0), 20.0, (r"can. ...: [125]+00? frames \(19\.2 %\)",), gaps=1
    ),
    "clock put forward by an hour": Case(faults.clock_stepped(3600.0), 21.0, (".*gap 3600",), gaps=1),
    "clock put back by an hour": Case(
        faults.clock_stepped(-3600.0), 21.0, (r"stamps go backwards 1 times, by up to 3599\.99",), clock_steps=1
    ),
    "one stamp far ahead": Case(
        faults.one_far_ahead,
        21.0,
        ("gyro_.: 1 values not used: their time is far ahead", "stamps go backwards 1 times, by up to 1000000"),
    ),
}


def run(dsz: Dsz, folder: Path, sent: Frames, config: str = SLOW) -> Replayed:
    log, path = sd.write(folder, sent, config)
    called = dsz("replay", log, "-c", path, "-o", folder / "out", "--json")
    assert called.code == 0, called.err
    return read_results(folder / "out")


def poisoned(faulty: Replayed, faultless: Replayed, start_s: float) -> dict[str, float]:
    """The offsets that were moved further than the bound, and how far."""

    def bound(channel: str) -> float:
        return max(BOUND[channel], float(faulty.summary["channels"][channel]["offset_std"]) / 3.0)

    return {c: distance for c, distance in moved(faulty, faultless, start_s).items() if distance > bound(c)}


@pytest.fixture(scope="module")
def faultless(drive: Frames, tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    from dsz_daemon.runs.replay import replay

    folder = tmp_path_factory.mktemp("faultless")
    log, config = sd.write(folder, drive, SLOW)
    replay([log], config, folder)
    return read_results(folder)


def test_the_drive_is_fit_for_the_question(faultless: Replayed) -> None:
    """Before faults begin there is something to lose, and afterwards something to poison."""
    for channel, true in sd.OFFSETS.items():
        known = faultless.offsets(channel, 11.9)[0]
        assert abs(known - true) < 0.6 * abs(true), channel
        gates = faultless.between(f"{channel}_gate", 20.0, 26.0)
        assert sum(gates) > 0.5 * len(gates), channel


@pytest.mark.parametrize("name", CASES)
def test_one_fault(dsz: Dsz, drive: Frames, faultless: Replayed, tmp_path: Path, name: str) -> None:
    case = CASES[name]
    faulty = run(dsz, tmp_path, case.fault(drive))
    assert not poisoned(faulty, faultless, case.start_s)
    warnings = faulty.summary["warnings"]
    for pattern in case.said:
        assert any(re.match(pattern, warning) for warning in warnings), warnings
    assert [w for w in warnings if not any(re.match(pattern, w) for pattern in case.said)] == []
    for channels, start_s, end_s in case.invalid:
        for channel in channels:
            assert faulty.states(channel, start_s, end_s) == {"invalid"}, channel
            assert "none" not in faulty.reasons(channel, start_s, end_s), channel
            assert len({x for t, x in timed_offsets(faulty, channel) if start_s <= t < end_s}) == 1, channel
    counts = faulty.summary["counts"]
    assert (counts["gaps"], counts["clock_steps"]) == (case.gaps, case.clock_steps)
    # Frames count as lost where they were cut out, and only there.
    assert (counts["lost_on_the_way"] > 0) == any("gap" in words or "frames" in words for words in case.said)


def timed_offsets(results: Replayed, channel: str) -> list[tuple[float, float]]:
    unit = "radps" if channel in GYROS else "mps2"
    return [
        (t_s - START_S, x)
        for t_s, x in zip(results.samples["time_s"], results.samples[f"{channel}_offset_{unit}"], strict=True)
    ]


def test_what_is_published_while_the_gyros_are_away(dsz: Dsz, drive: Frames, tmp_path: Path) -> None:
    """Rates "not available", accelerations as before, the state "invalid", and the age of the oldest IMU value."""
    run(dsz, tmp_path, faults.cut([RATES], 12.0, 15.0)(drive))
    database = cantools.database.load_file(shipped("dbc/dsz.dbc"))
    seen: dict[str, list[Any]] = {}
    for line in (tmp_path / "out" / "compensated.log").read_text().splitlines():
        stamp, _, frame = line.split()
        can_id, data = frame.split("#")
        if 13.0 <= float(stamp.strip("()")) - START_S < 14.9:
            for name, value in database.decode_message(int(can_id, 16), bytes.fromhex(data)).items():
                seen.setdefault(name, []).append(value)
    for axis in ("P", "Q", "R"):
        assert {str(value) for value in seen[axis]} == {"not_available"}
        assert {str(value) for value in seen[f"STATE_{axis}"]} == {"invalid"}
    assert all(9.0 < value < 10.6 for value in seen["AZ"])
    assert 950.0 < min(seen["AGE_IMU"]) < max(seen["AGE_IMU"]) < 3000.0


def test_a_float_that_is_no_number(dsz: Dsz, faultless: Replayed, tmp_path: Path) -> None:
    """NaN and infinity from 12 to 15 s: refused and counted, the channels invalid meanwhile."""

    def change(t_s: float, r: float, ay: float) -> tuple[float, float]:
        return (float("nan"), float("inf")) if 12.0 <= t_s < 15.0 else (r, ay)

    config = edited(
        SLOW,
        ("message: IMU_RATES, signal: R,", "message: IMU_FLOATS, signal: R_FLOAT,"),
        ("message: IMU_ACCELS, signal: AY,", "message: IMU_FLOATS, signal: AY_FLOAT,"),
    )
    faulty = run(dsz, tmp_path, sd.words_changed(sd.frames(floats=True), sd.FLOATS, "<2f", change), config)
    roles = faulty.summary["counts"]["roles"]
    assert roles["gyro_z"]["not_a_number"] == roles["accel_y"]["not_a_number"] == 300
    assert faulty.states("gyro_z", 12.6, 14.9) == faulty.states("accel_y", 12.6, 14.9) == {"invalid"}
    assert any(word.startswith("gyro_z: 300 of 2600 values refused") for word in faulty.summary["warnings"])
    assert not poisoned(faulty, faultless, 12.0)


def test_a_payload_that_is_too_short(dsz: Dsz, drive: Frames, faultless: Replayed, tmp_path: Path) -> None:
    """Two bytes of six: gyro_x is in them and goes on, the others are counted as short."""
    sent = [f._replace(data=f.data[:2]) if f.can_id == RATES and f.t_s >= 12.0 else f for f in drive]
    faulty = run(dsz, tmp_path, sent)
    roles = faulty.summary["counts"]["roles"]
    assert (roles["gyro_x"]["short"], roles["gyro_y"]["short"], roles["gyro_z"]["short"]) == (0, 1400, 1400)
    assert faulty.states("gyro_z", 12.6, 26.0) == {"invalid"}
    assert "invalid" not in faulty.states("gyro_x", 12.6, 26.0)
    assert not poisoned(faulty, faultless, 12.0)


def test_a_recording_stopped_and_started_again(dsz: Dsz, drive: Frames, faultless: Replayed, tmp_path: Path) -> None:
    """Two pieces with 10 s between them: one gap, and what was learnt in the first goes on in the second."""
    later = [f._replace(t_s=f.t_s + 10.0) for f in drive if f.t_s >= 20.0]
    pieces = {"a": [f for f in drive if f.t_s < 20.0], "b": later}
    _, config = sd.write(tmp_path, drive[:1], SLOW)
    for name, sent in pieces.items():
        (tmp_path / f"{name}.log").write_text(sd.candump(sent))
    called = dsz("replay", tmp_path / "a.log", tmp_path / "b.log", "-c", config, "-o", tmp_path / "out")
    assert called.code == 0
    resumed = read_results(tmp_path / "out")
    assert [event["event"] for event in resumed.summary["events"]] == ["gap"]
    assert resumed.summary["events"][0]["time_s"] == pytest.approx(START_S + 30.0, abs=0.1)
    assert resumed.summary["counts"]["gaps"] == 1
    assert not poisoned(resumed, faultless, 19.9)
    # Nothing is made up in between: rows end at most a gap's second after the first piece.
    assert resumed.between("time_s", 21.1, 29.9) == []


def test_all_wheels_zero_while_the_car_drives(dsz: Dsz, drive: Frames, faultless: Replayed, tmp_path: Path) -> None:
    faulty = run(dsz, tmp_path, faults.all_zero([WHEELS], 12.0)(drive))
    assert not poisoned(faulty, faultless, 12.0)


def test_a_dead_axis_does_not_keep_the_others_from_learning(dsz: Dsz, drive: Frames, tmp_path: Path) -> None:
    faulty = run(dsz, tmp_path, faults.constant("accel_z", 0, 12.0)(drive))
    assert any(faulty.between("accel_x_gate", 22.0, 26.0))


def test_refused_values_are_published(dsz: Dsz, drive: Frames, tmp_path: Path) -> None:
    run(dsz, tmp_path, faults.spiked("wheel_speed_rl")(drive))
    database = cantools.database.load_file(shipped("dbc/dsz.dbc"))
    message = next(message for message in database.messages if any(s.name == "REJECTED" for s in message.signals))
    lines = (tmp_path / "out" / "compensated.log").read_text().splitlines()
    last = [line for line in lines if f" {message.frame_id:03X}#" in line][-1]
    assert message.decode(bytes.fromhex(last.split("#")[1]))["REJECTED"] == 14
