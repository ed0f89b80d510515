"""A yaw inertia that is another, front wheels that lag, an accelerometer that feels a turn: each is what it is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from core_cases import TUCSON
from scipy.signal import lfilter
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive, found

from dsz_daemon.diagnose.effects.row import CAR, Effect, Parameter
from dsz_daemon.diagnose.effects.vocabulary import INDEX, vocabulary
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.shapes.unlisted import is_named, library
from dsz_daemon.diagnose.simulation.car import car_of
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.motion import AY, R
from dsz_daemon.diagnose.simulation.moving import driven, rolls_of
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.surroundings.winds import follows_the_car
from dsz_daemon.diagnose.verdict.another_car import NUMBERS
from dsz_daemon.diagnose.verdict.answer import answered

# Round tight bends.
SLOW_V, SHARP_STEER = 6.0 + 2.0 * np.sin(0.3 * T), 0.25 * np.sin(0.5 * T)
# Quick enough that inertia shows.
QUICK_STEER = CITY_STEER + 0.01 * np.sin(2.0 * np.pi * 0.9 * T)


@pytest.mark.parametrize("share", [0.4, -0.25])
def test_a_yaw_inertia_that_is_another_is_said_as_that(share: float) -> None:
    """Of a drive whose car was configured with it, and is diagnosed as if it had the usual one."""
    one = drive({}, CITY_V, QUICK_STEER)
    heavy = one.car._replace(yaw_inertia_kgm2=one.car.yaw_inertia_kgm2 * (1.0 + share))
    made = drive_of(one.recording, heavy, 16.0)
    change = predicted(made, nothing(), flat(N)) - predicted(one, nothing(), flat(N))
    told = answered(found(one._replace(measured=one.measured + change)))
    assert told.causes == []
    [shape] = told.unlisted
    assert (shape.channel, shape.shape, shape.coefficient.unit) == ("gyro_z", "k*r'", "kg m2 of yaw inertia")
    assert shape.coefficient.value == pytest.approx(share * one.car.yaw_inertia_kgm2, rel=0.1)
    [error] = [error for error in told.parameter_errors if error.parameter == "yaw_inertia_kgm2"]
    assert error.fitted == pytest.approx(heavy.yaw_inertia_kgm2, rel=0.05)
    assert error.configured == one.car.yaw_inertia_kgm2


def test_a_yaw_inertia_is_one_number_however_it_is_free() -> None:
    """With a tolerance of its own beside it there is one of the two."""
    one = drive({"yaw_inertia.share": 0.3}, CITY_V, QUICK_STEER)
    start = nothing()
    start[INDEX["yaw_inertia_kgm2"]] = 0.2
    fit = fitted(one, rows_of(one), start, ("yaw_inertia",), {**TOLERANCE, "yaw_inertia_kgm2": 0.5})
    assert INDEX["yaw_inertia_kgm2"] not in fit.columns
    assert fit.x[INDEX["yaw_inertia_kgm2"]] == 0.0
    assert fit.x[INDEX["yaw_inertia.share"]] == pytest.approx(0.3, abs=0.03)
    assert "yaw_inertia" in NUMBERS
    x = nothing()
    x[INDEX["yaw_inertia.share"]] = 0.5
    assert car_of(one, x).yaw_inertia_kgm2 == pytest.approx(1.5 * one.car.yaw_inertia_kgm2)


def lagging(time_constant_s: float) -> Drive:
    """A car whose front wheels follow by a first order (scipy's filter), and a recording of the hand wheel."""
    keep = np.exp(-DT_S / time_constant_s)
    wheels = lfilter([1.0 - keep], [1.0, -keep], QUICK_STEER, zi=[keep * QUICK_STEER[0]])[0]
    return drive({}, CITY_V, wheels)._replace(steer=QUICK_STEER)


def test_front_wheels_that_lag_are_neither_a_slow_imu_nor_late_wheels() -> None:
    told = answered(found(lagging(0.06)))
    assert told.causes == []
    [shape] = told.unlisted
    assert (shape.channel, shape.shape, shape.coefficient.unit) == (
        "gyro_z",
        "k*delta'",
        "rad/(rad/s) of the front wheels",
    )
    # The filter above holds each value for a row, which is half a row more.
    assert shape.coefficient.value == pytest.approx(-0.06, abs=0.006)


def test_what_lags_is_known_before_the_car_moves() -> None:
    one = drive({}, CITY_V, QUICK_STEER)
    x = nothing()
    x[INDEX["steering_lag.time_constant_s"]] = 0.1
    steer = rolls_of(one, x, flat(N)).steer_rad
    # T delta' + delta = hand, in the middle of the drive.
    inside = slice(200, N - 200)
    back = steer + 0.1 * np.gradient(steer, DT_S)
    np.testing.assert_allclose(back[inside], QUICK_STEER[inside], atol=2e-4)
    assert np.max(np.abs(steer - QUICK_STEER)) > 2e-3


@pytest.mark.parametrize("by_front", [False, True])
def test_an_axle_that_is_locked_turns_its_wheels_alike_and_the_car_less(by_front: bool) -> None:
    """Both wheels of the driven axle at their mean speed, and what they drag: of slip in a bend, and no ratio."""
    car = TUCSON._replace(front_driven=not by_front, rear_driven=by_front)
    level = drive({}, SLOW_V, SHARP_STEER)
    one = drive_of(level.recording, car, 16.0)
    moving = driven(one, nothing(), flat(N))
    slip = 0.5 * 1.6 * moving.moved[:, R] / moving.v_mps
    drags = Effect("drags", "", "", CAR, (Parameter("k", "1", 1.0, -9.0, 9.0, 0.0),))
    drags = drags._replace(pushes=np.column_stack([np.zeros(N), -900.0 * np.tanh(slip / 0.02)]))
    made = one._replace(vocabulary=vocabulary((drags,)))
    shown = predicted(made, np.append(nothing(), 1.0), flat(N))
    # The driven axle's are those that do not give the speed.
    assert one.front_gives_speed is by_front
    shown[:, 6:8] = np.mean(shown[:, 6:8], axis=1, keepdims=True)
    noise = level.measured - predicted(level, nothing(), flat(N))
    there = found(one._replace(measured=shown + noise))
    assert there.best.effects == ("locked_axle", "yaw moment: k*sign(r/vx)")
    told = answered(there)
    assert told.causes == []
    shapes = {shape.channel: shape for shape in told.unlisted}
    axle, track_m = ("r", car.rear_track_m) if by_front else ("f", car.front_track_m)
    assert set(shapes) == {"gyro_z", f"wheel_speed_{axle}l", f"wheel_speed_{axle}r"}
    # What the left one, which is the inner one of a left turn, has more.
    assert shapes[f"wheel_speed_{axle}l"].coefficient.value == pytest.approx(0.5 * track_m, rel=0.02)
    assert shapes[f"wheel_speed_{axle}r"].coefficient.value == pytest.approx(-0.5 * track_m, rel=0.02)
    assert shapes["gyro_z"].coefficient.value == pytest.approx(-900.0, rel=0.1)


@pytest.mark.parametrize(("share", "shapes"), [(0.04, 0), (0.06, 2)])
def test_of_what_is_small_no_shape_is_told(share: float, shapes: int) -> None:
    """However much it gains: of a locked axle a twentieth, which drawings of wheels may be."""
    one = drive({"locked_axle.share": share}, SLOW_V, SHARP_STEER)
    rows = rows_of(one)
    x = nothing()
    x[INDEX["locked_axle.share"]] = share
    there = found(one)
    best = fitted(one, rows, x, ("locked_axle",), TOLERANCE)
    told = answered(there._replace(best=best, gains={"locked_axle": 500.0}, rivals={}, elsewhere={}, shapes=()))
    assert len(told.unlisted) == shapes


def test_a_track_that_is_another_is_no_locked_axle() -> None:
    assert found(drive({"track_width.front": -0.06}, CITY_V, CITY_STEER)).best.effects == ("track_width",)


def test_an_accelerometer_that_feels_a_turn_is_told_by_that() -> None:
    def feels(one: Drive) -> None:
        one.measured[:, 4] += 0.5 * driven(one, nothing(), flat(N)).moved[:, R]

    told = answered(found(drive({}, CITY_V, CITY_STEER, change=feels)))
    assert told.causes == []
    [shape] = told.unlisted
    assert (shape.channel, shape.shape) == ("accel_y", "k*r")
    assert shape.coefficient.value == pytest.approx(0.5, rel=0.05)
    # What one gyro shows of another is a leak.
    assert is_named("r", "gyro_x")
    assert not is_named("r", "accel_x")
    one = drive({}, CITY_V, CITY_STEER)
    moving = driven(one, nothing(), flat(N))
    np.testing.assert_array_equal(library(moving, one)["r"][0], moving.moved[:, R])


def slow_noise_n(seed: int) -> np.ndarray:
    """500 N rms that change over seconds."""
    kernel = np.exp(-0.5 * (np.arange(-300, 301) * DT_S / 1.0) ** 2)
    noise = np.convolve(np.random.default_rng(seed).normal(size=N), kernel, "same")
    return np.asarray(500.0 * noise / np.std(noise))


@pytest.mark.parametrize("seed", range(5))
def test_a_wind_does_not_follow_the_car(seed: int) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    wind = flat(N)._replace(side_n=slow_noise_n(seed))
    assert not follows_the_car(one, nothing(), wind)


@pytest.mark.parametrize(("late_s", "share", "follows"), [(0.0, 0.8, True), (1.5, 0.8, True), (1.0, 0.2, False)])
def test_what_goes_to_and_fro_in_a_car_does(late_s: float, share: float, follows: bool) -> None:
    """A force that is the car's lateral acceleration some time before, by a `share` of its power."""
    one = drive({}, CITY_V, CITY_STEER)
    side = driven(one, nothing(), flat(N)).moved[:, AY]
    late = np.interp(T - late_s, T, side)
    pushes = np.sqrt(share) * 500.0 * late / np.std(late) + np.sqrt(1.0 - share) * slow_noise_n(7)
    assert follows_the_car(one, nothing(), flat(N)._replace(side_n=pushes)) is follows


@pytest.mark.parametrize(("late_s", "share", "follows"), [(1.5, 0.8, True), (1.5, 0.35, False), (-4.0, 0.8, False)])
def test_what_follows_comes_after_and_is_most_of_it(late_s: float, share: float, follows: bool) -> None:
    """On a drive that repeats nothing: what a car does seconds later tells no more of a wind than chance."""
    steer = 0.04 * slow_noise_n(3) / 500.0
    one = drive({}, np.full(N, 12.0), steer)
    side = driven(one, nothing(), flat(N)).moved[:, AY]
    late = np.interp(T - late_s, T, side)
    force_n = np.sqrt(share) * 500.0 * late / np.std(late) + np.sqrt(1.0 - share) * slow_noise_n(7)
    assert follows_the_car(one, nothing(), flat(N)._replace(side_n=force_n)) is follows


@pytest.mark.parametrize("share", [0.0, 0.9])
def test_a_wind_that_follows_the_car_is_implausible(share: float) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    side = driven(one, nothing(), flat(N)).moved[:, AY]
    force_n = np.sqrt(share) * 500.0 * side / np.std(side) + np.sqrt(1.0 - share) * slow_noise_n(7)
    fit = SimpleNamespace(x=nothing(), columns=(), effects=("side_wind",), road=flat(N)._replace(side_n=force_n))
    told: Any = fit
    assert is_implausible(one, rows_of(one), told, "side_wind") is (share > 0.5)
