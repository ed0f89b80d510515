"""Samples that a gateway holds back and lets go at once: when they were due is known as long as none is lost."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from core_cases import TUCSON
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive
from test_diagnose_steering_stops import HAND, RATIO, STAMPS, made

from dsz_daemon.diagnose import diagnose
from dsz_daemon.diagnose.faults.bunches import delays_of, hardly_there, told_by_stamps
from dsz_daemon.diagnose.recordings.recording import recorded
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import IMU_CHANNELS

N, PERIOD_NS = 6000, 10_000_000


def _due_ns(seed: int = 1, jitter_s: float = 0.0002, n: int = N) -> Any:
    rng = np.random.default_rng(seed)
    return 10**18 + PERIOD_NS * np.arange(n) + np.round(rng.random(n) * jitter_s * 1e9).astype(np.int64)


def _let_go(due_ns: Any, every: int, apart_ns: int = 200_000) -> Any:
    """So many at once, one after the other as the bus takes them, when the last is there."""
    i = np.arange(len(due_ns))
    last = np.minimum(i // every * every + every - 1, len(i) - 1)
    return due_ns[last] + apart_ns * (i % every)


def _blocked(due_ns: Any, seed: int, blocked_s: float) -> Any:
    """A queue that stops now and then, for up to so long."""
    rng, out, until = np.random.default_rng(seed), [], 0
    for due in due_ns.tolist():
        if due > until and rng.random() < 0.01:
            until = due + int(rng.uniform(0.5, 1.0) * blocked_s * 1e9)
        out.append(max(due, until, out[-1] + 200_000 if out else 0))
    return np.array(out, dtype=np.int64)


def _told(stamps: Any) -> tuple[list[str], Any]:
    found = told_by_stamps({"gyro_z": Signal(stamps, np.arange(len(stamps), dtype=float))})
    return [shape.shape for shape in found.shapes], found


@pytest.mark.parametrize(("every", "late_s"), [(40, 0.39), (12, 0.11)])
def test_what_comes_in_bunches_is_put_where_it_was_due(every: int, late_s: float) -> None:
    due = _due_ns()
    told, found = _told(_let_go(due, every))
    assert told == ["up to k late, in bunches"]
    [shape] = found.shapes
    assert (shape.channel, shape.coefficient.unit) == ("gyro_z", "s")
    assert shape.coefficient.value == pytest.approx(late_s, abs=0.012)
    put = found.signals["gyro_z"]
    assert np.max(np.abs(put.t_ns - due)) * 1e-9 < 0.001
    np.testing.assert_array_equal(put.values, np.arange(N))


def test_a_queue_that_stops_at_random_is_told_too() -> None:
    due = _due_ns()
    told, found = _told(_blocked(due, 4, 0.6))
    assert told == ["up to k late, in bunches"]
    assert np.ptp((found.signals["gyro_z"].t_ns - due) * 1e-9) < 0.002


def test_a_long_stall_at_the_end_makes_no_other_period() -> None:
    due = _due_ns(n=3000)
    late = _let_go(due, 40)
    late[-150:] = due[-1] + 1_500_000_000 + 200_000 * np.arange(150)
    told, found = _told(late)
    assert told == ["up to k late, in bunches"]
    assert np.max(np.abs(found.signals["gyro_z"].t_ns - due)) * 1e-9 < 0.001


def test_stamps_that_are_in_order_stay_as_they_are() -> None:
    due = _due_ns()
    lost = np.delete(due, np.arange(1000, 1040))
    dropped = due[np.random.default_rng(2).random(N) > 0.05]
    once = due.copy()
    once[3000:3040] = due[3039] + 200_000 * np.arange(40)
    pause = due + np.where(np.arange(N) > 3000, 5 * 10**9, 0)
    pairs = _let_go(due, 2)
    for stamps in (due, _due_ns(3, 0.009), lost, dropped, once, pause, pairs, due[:400], np.full(N, due[0])):
        told, found = _told(stamps)
        assert told == []
        np.testing.assert_array_equal(found.signals["gyro_z"].t_ns, stamps)


def test_of_bunches_of_which_some_are_lost_nobody_knows_when_the_others_were_due() -> None:
    late = _let_go(_due_ns(), 40)
    kept = np.random.default_rng(6).random(N) > 0.05
    told, _ = _told(late[kept])
    assert told == []


def test_what_has_gaps_most_of_the_time_is_said_and_a_pause_between_two_recordings_is_none() -> None:
    """Between bunches of which some are lost nothing is there: hardly a row is compared."""
    signals = made(HAND, HAND)
    late = np.asarray(_let_go(np.asarray(STAMPS), 40))
    kept = np.random.default_rng(6).random(len(late)) > 0.05
    holed = signals | {"gyro_z": Signal(late[kept], signals["gyro_z"].values[kept])}
    [shape] = hardly_there(recorded(holed, RATIO), holed)
    assert (shape.channel, shape.shape) == ("gyro_z", "not there for k of the time")
    assert shape.coefficient.value == pytest.approx(1.0, abs=0.02)
    told = diagnose(holed, TUCSON, RATIO, tolerance=TOLERANCE).said
    assert told.verdict == "unexplained"
    assert [one.channel for one in told.unlisted] == ["gyro_z"]
    # The next day; and a channel that nobody has is not missed.
    twice = {
        name: Signal(np.concatenate([one.t_ns, one.t_ns + 86400 * 10**9]), np.tile(one.values, 2))
        for name, one in signals.items()
        if name != "accel_z"
    }
    assert hardly_there(recorded(twice, RATIO), twice) == []


def test_how_late_all_is_that_comes_in_bunches_is_not_told() -> None:
    def shape(channel: str, text: str = "up to k late, in bunches") -> Shape:
        return Shape(channel, text, Coefficient(0.4, 0.01, "s"), 0.9)

    assert delays_of([]) == set()
    every = {"imu_delay", "sensor_bandwidth", "wheel_speed_delay", "steering_delay"}
    assert delays_of([shape("gyro_x"), shape("wheel_speed_rl", "0 where vx < k")]) == every
    assert delays_of([shape("gyro_x", "0 where vx < k"), shape("wheel_speed_rl")]) == {"wheel_speed_delay"}
    assert delays_of([shape("wheel_speed_fl"), shape("road_wheel_angle")]) == {"wheel_speed_delay", "steering_delay"}


def test_of_an_imu_in_bunches_a_delay_has_no_name() -> None:
    one = drive({"imu_delay.delay_s": 0.02}, CITY_V, CITY_STEER)
    search = searched(one, rows_of(one), TOLERANCE)
    bunches = Shape("gyro_x", "up to k late, in bunches", Coefficient(0.4, 0.01, "s"), 0.9)
    assert [cause.effect for cause in answered(search).causes] == ["imu_delay"]
    assert answered(search, beside=[bunches]).causes == []


def test_a_diagnosis_of_an_imu_in_bunches_says_so_and_compares_it() -> None:
    signals = made(HAND, HAND)
    assert {*IMU_CHANNELS} & {*signals}
    late = np.asarray(_let_go(np.asarray(STAMPS), 40))
    bunched = {
        name: Signal(late[: len(one.t_ns)], one.values) if name in IMU_CHANNELS else one
        for name, one in signals.items()
    }
    said = diagnose(bunched, TUCSON, RATIO, tolerance=TOLERANCE).said
    assert {shape.shape for shape in said.unlisted} == {"up to k late, in bunches"}
    assert said.verdict == "unexplained"
    assert not said.causes
    there = [name for name in IMU_CHANNELS if name in bunched]
    assert all(said.level[name] < 1.5 for name in there)
