"""diagnose: noise of the inputs that is in every prediction, and what smooths it; slow messages are no slow sensors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_cases import TUCSON

from dsz_daemon.diagnose.effects.vocabulary import INDEX, vocabulary
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained
from dsz_daemon.diagnose.recordings.recording import DT_S, FILTER_S, Recording, recorded
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.residuals.inputs import smoothed_away
from dsz_daemon.diagnose.shapes.unlisted import as_effect
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

N, RATIO, NOISE_MPS = 6000, 16.0, 0.05
T = DT_S * np.arange(N)
T_NS = (1e9 * T).astype(np.int64)
INSIDE = slice(200, -200)
TOLERANCE = {"front_cornering_stiffness_n_per_rad": 0.1, "rear_cornering_stiffness_n_per_rad": 0.1}


def noisy(seed: int | None, *, rear: float = 1.0, wheels_mps: float = 15.0) -> Drive:
    """A city's bends and speeds, with noise on each wheel."""
    rng = np.random.default_rng(0 if seed is None else seed)
    speed = wheels_mps + 0.2 * wheels_mps * np.sin(0.3 * T)
    white = np.zeros((4, N)) if seed is None else NOISE_MPS * rng.standard_normal((4, N))
    signals = {wheel: Signal(T_NS, speed + one) for wheel, one in zip(WHEEL_SPEEDS, white, strict=True)}
    signals["steering_wheel_angle"] = Signal(T_NS, 0.8 * np.sin(0.5 * T))
    signals |= {name: Signal(T_NS, np.zeros(N)) for name in IMU_CHANNELS}
    car = TUCSON._replace(rear_cornering_stiffness_n_per_rad=rear * TUCSON.rear_cornering_stiffness_n_per_rad)
    return drive_of(recorded(signals, RATIO), car, RATIO)


def with_(**changed: float) -> np.ndarray:
    x = nothing()
    for name, value in changed.items():
        x[INDEX[name.replace("__", ".")]] = value
    return x


@pytest.mark.parametrize("slow_s", [0.08, 0.2])
def test_what_a_slow_sensor_takes_off_is_what_it_takes_off_other_noise(slow_s: float) -> None:
    """Counted on a prediction with noise less the same one without."""
    clean, one = noisy(None), noisy(3)
    slow = with_(sensor_bandwidth__time_constant_s=slow_s)
    power = [np.var((predicted(one, x, flat(N)) - predicted(clean, x, flat(N)))[INSIDE, 3]) for x in (nothing(), slow)]
    found = smoothed_away(one, slow)
    assert power[0] > 1.2 * power[1]
    assert found[3] == pytest.approx(power[0] - power[1], rel=0.2)
    assert not found[6:].any()


def test_what_is_late_has_as_much_noise_as_before() -> None:
    one = noisy(3)
    slow, late = (
        smoothed_away(one, with_(**{name: 0.06}))[3]
        for name in ("sensor_bandwidth__time_constant_s", "imu_delay__delay_s")
    )
    assert abs(late) < 0.05 * slow
    assert not smoothed_away(one, nothing()).any()
    nothing_is_noise = smoothed_away(noisy(None), with_(sensor_bandwidth__time_constant_s=0.06))
    assert abs(nothing_is_noise[3]) < 1e-3 * slow


def test_a_car_that_spins_or_stands_tells_nothing_of_noise() -> None:
    assert noisy(3).noise is not None
    assert noisy(3, rear=0.1, wheels_mps=30.0).noise is None
    assert noisy(None, wheels_mps=0.0).noise is None


def test_a_steerings_steps_are_noise_too() -> None:
    """Wheels without noise and a hand in steps of two degrees: the yaw rate has what rounding does to it."""
    step = math.radians(2.0)
    speed, hand = np.full(N, 15.0), 0.8 * np.sin(0.5 * T)
    signals = {wheel: Signal(T_NS, speed) for wheel in WHEEL_SPEEDS}
    signals |= {name: Signal(T_NS, np.zeros(N)) for name in IMU_CHANNELS}
    coarse = Signal(T_NS, step * np.round(hand / step))
    one = drive_of(recorded(signals | {"steering_wheel_angle": coarse}, RATIO), TUCSON, RATIO)
    assert one.noise is not None
    # One of the ways in which steps may begin.
    assert 0.2 * one.steps[2] < np.std(one.noise[INSIDE, 2]) < 1.5 * one.steps[2]


def stepped(step_rad: float, gyro_rps: float = 0.0) -> Drive:
    """A hand that sways twice a second as it turns, told in such steps, and a yaw gyro with so much noise."""
    speed, hand = np.full(N, 15.0), 0.8 * np.sin(0.5 * T) + 0.1 * np.sin(9.0 * T)
    signals = {wheel: Signal(T_NS, speed) for wheel in WHEEL_SPEEDS}
    signals |= {name: Signal(T_NS, np.zeros(N)) for name in IMU_CHANNELS}
    signals["gyro_z"] = Signal(T_NS, gyro_rps * np.random.default_rng(5).standard_normal(N))
    told = step_rad * np.round(hand / step_rad) if step_rad > 0.0 else hand
    return drive_of(recorded(signals | {"steering_wheel_angle": Signal(T_NS, told)}, RATIO), TUCSON, RATIO)


@pytest.mark.parametrize(("name", "value"), [("yaw_inertia__share", 1.0), ("steering_lag__time_constant_s", 0.2)])
def test_what_a_slower_car_takes_off_coarse_steps_is_no_gain(name: str, value: float) -> None:
    """Counted on a prediction by a hand in steps of three degrees less that by the hand itself."""
    coarse, fine = stepped(math.radians(3.0)), stepped(0.0)
    slow = with_(**{name: value})
    power = [
        np.var((predicted(coarse, x, flat(N)) - predicted(fine, x, flat(N)))[INSIDE, 2]) for x in (nothing(), slow)
    ]
    taken = smoothed_away(coarse, slow)
    assert power[0] > 1.1 * power[1]
    # Another rounding, of the same size.
    assert 0.3 * (power[0] - power[1]) < taken[2] < 3.0 * (power[0] - power[1])
    assert not np.delete(taken, [2, 4]).any()
    # What answers at once, or more quickly, takes nothing off.
    assert not smoothed_away(coarse, nothing()).any()
    assert not smoothed_away(coarse, with_(steering_ratio__scale=0.1)).any()
    if name == "yaw_inertia__share":
        assert smoothed_away(coarse, with_(yaw_inertia__share=-0.5))[2] == 0.0
    # Nor is it asked where other noise is what counts.
    assert not smoothed_away(stepped(math.radians(3.0), 0.1), slow).any()
    assert np.all(smoothed_away(fine, slow) <= 1e-3 * taken)
    assert not smoothed_away(fine._replace(recording=fine.recording._replace(rounding_rad=None)), slow).any()


def test_a_model_without_the_shapes_of_a_larger_one_is_asked_as_well() -> None:
    """It is held against one whose drive knows a shape more: frames in any order of a car whose steering is coarse."""
    one, slow = stepped(math.radians(3.0)), with_(yaw_inertia__share=1.0)
    shape = as_effect("gyro_z", "k*r*|r|", np.ones(N), "s/rad", 1.0)
    larger = one._replace(vocabulary=vocabulary((shape,)))
    assert len(larger.vocabulary.columns) > len(slow)
    np.testing.assert_array_equal(smoothed_away(larger, slow), smoothed_away(one, slow))


def test_a_slow_sensor_of_a_slower_car_takes_off_what_both_do() -> None:
    one, slow = stepped(math.radians(3.0)), {"sensor_bandwidth__time_constant_s": 0.1}
    car, sensor = smoothed_away(one, with_(yaw_inertia__share=1.0)), smoothed_away(one, with_(**slow))
    assert min(car[2], sensor[2]) > 0.0
    both = smoothed_away(one, with_(yaw_inertia__share=1.0, **slow))
    # Behind a slow sensor there is less for the car to take off.
    assert np.all(both[[2, 4]] > sensor[[2, 4]])
    assert np.all(both[[2, 4]] < (car + sensor)[[2, 4]])


@pytest.mark.parametrize(("times", "is_told"), [(2.0, True), (4.5, False)])
def test_a_car_that_turns_much_more_than_a_neutral_one_tells_nothing(times: float, is_told: bool) -> None:
    """Close to the speed at which it spins a car turns 1/(1 - (v/v_c)^2) as much."""
    v = 15.0
    lf, lr = TUCSON.cg_to_front_axle_m, TUCSON.cg_to_rear_axle_m
    # With this softness in the rear, over a front axle as it is: K v^2 / L = 1/times - 1.
    front = lr / TUCSON.front_cornering_stiffness_n_per_rad
    softness = (1.0 / times - 1.0) * (lf + lr) ** 2 / (0.5 * TUCSON.mass_kg * v**2)
    rear = lf / (front - softness)
    car = TUCSON._replace(rear_cornering_stiffness_n_per_rad=rear)
    e = 2e-4 * np.sin(2.0 * np.pi * T / 30.0)
    recording = Recording(
        T, np.zeros(N), np.full((N, 4), v), np.zeros((N, 6)), np.zeros(10), rounding_rad=np.array([e, -e, e, -e])
    )
    one = drive_of(recording, car, RATIO)
    assert bool(one.steps.any()) is is_told
    assert (one.noise is not None) is is_told


def test_less_noise_is_no_gain() -> None:
    """An IMU that shows what a noisy simulation shows, but for noise of its own: a slow one would leave less."""
    clean, one = noisy(None), noisy(3)
    at = predicted(clean, nothing(), flat(N))
    rng = np.random.default_rng(8)
    shown = at + 0.01 * rng.standard_normal(at.shape)
    one = one._replace(measured=np.where(np.isfinite(one.measured), shown, np.nan))
    rows = rows_of(one)
    plain = fitted(one, rows, nothing(), (), TOLERANCE)
    slow = fitted(one, rows, with_(sensor_bandwidth__time_constant_s=0.05), ("sensor_bandwidth",), TOLERANCE)
    x = slow.x.copy()
    x[INDEX["sensor_bandwidth.time_constant_s"]] = 0.05
    taken = smoothed_away(one, x)
    assert taken[3] > 0.0
    before = gained(one._replace(noise=None), plain, slow._replace(x=x))
    assert gained(one, plain, slow._replace(x=x)) < before


@pytest.mark.parametrize("period_s", [0.03, 0.05, 0.08])
def test_what_comes_seldom_is_no_smoother_than_what_comes_often(period_s: float) -> None:
    """A wave of 1.5 Hz: lines between samples 50 ms apart would take 2 % off it."""
    hz = 1.5
    at_s = np.arange(0.0, 60.0, period_s)
    seldom = Signal((1e9 * at_s).astype(np.int64), np.sin(2.0 * np.pi * hz * at_s))
    often = Signal(T_NS, np.sin(2.0 * np.pi * hz * T))
    signals = dict.fromkeys(WHEEL_SPEEDS, often) | {"gyro_z": seldom, "gyro_x": often}
    signals |= {"steering_wheel_angle": Signal(seldom.t_ns, RATIO * seldom.values)}
    found = recorded(signals, RATIO)
    left = math.exp(-0.5 * (2.0 * np.pi * hz * FILTER_S) ** 2)

    def amplitude(values: np.ndarray) -> float:
        return float(np.sqrt(2.0 * np.mean(values[INSIDE] ** 2)))

    for values in (found.imu[:, 0], found.imu[:, 2], found.road_wheel_angle_rad):
        assert amplitude(values) == pytest.approx(left, rel=4e-3)


def test_what_comes_five_times_a_second_is_smoothed_all_the_same() -> None:
    at_s = np.arange(0.0, 60.0, 0.2)
    signals = {"gyro_z": Signal((1e9 * at_s).astype(np.int64), np.where(at_s > 30.0, 1.0, 0.0))}
    signals |= {name: Signal(T_NS, np.ones(N)) for name in WHEEL_SPEEDS}
    found = recorded(signals, RATIO).imu[INSIDE, 2]
    # Between two samples a line, and no corner.
    assert np.max(np.abs(np.diff(found, 2))) < 0.5 * DT_S / 0.2
