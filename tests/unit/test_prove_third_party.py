"""The third party's car: its own equations, compiled; and what sensors on it show, from physics."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("vehiclemodels", reason="commonroad-vehicle-models is not installed (extra: prove)")

from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from dsz_daemon.prove import third_party_model as model
from dsz_daemon.prove.third_party_car import _Course, _felt, _played, simulated
from dsz_daemon.prove.ways import Way
from dsz_daemon.sim.effects import Choice
from dsz_daemon.sim.journey import Leg
from dsz_daemon.sim.sensors import SensorErrors

QUIET = SensorErrors(noisy=False)


def level(seconds: float, steer: float, speed: float, wind_n: float = 0.0, bank: float = 0.0) -> np.ndarray:
    n = round(seconds / model.STEP_S)
    one = np.ones(n)
    numbers = model.as_numbers(model.bmw_320i())
    side = model.G * math.sin(bank) * one
    states, _, _ = model.courses(numbers, steer * one, speed * one, 0 * one, side, wind_n * one, 0.0)
    return np.asarray(states)


def test_compiled_it_is_the_packages_own_to_the_last_bit() -> None:
    parameters, rng = model.bmw_320i(), np.random.default_rng(1)
    numbers, f = model.as_numbers(parameters), model._model()
    rest = level(1.0, 0.01, 15.0)[-1]
    for _ in range(20):
        state = rest + rng.normal(0.0, 1e-3, model.STATES)
        inputs = rng.normal(0.0, 0.3, 2)
        theirs = vehicle_dynamics_mb(list(state), list(inputs), parameters)
        assert list(f(state.copy(), inputs, numbers)) == theirs


@pytest.mark.parametrize(("as_published", "shakes"), [(True, True), (False, False)])
def test_as_published_it_shakes_itself_straight_ahead(as_published: bool, shakes: bool) -> None:
    """Twelve seconds after a gust the steering has stood still all the time: no car goes on by itself."""
    n = round(15.0 / model.STEP_S)
    one, gust = np.ones(n), np.zeros(n)
    gust[500:1000] = 500.0
    states, changes, _ = model.courses(
        model.as_numbers(model.bmw_320i(as_published)), 0 * one, 15.0 * one, 0 * one, 0 * one, gust, 0.0
    )
    across = changes[:, model.ACROSS] + states[:, model.YAW_RATE] * states[:, model.ALONG]
    late = across[-3000:]
    if shakes:
        assert np.std(late) > 0.05
        spectrum = np.abs(np.fft.rfft(late - np.mean(late)))
        assert 1.2 < np.fft.rfftfreq(len(late), model.STEP_S)[int(np.argmax(spectrum))] < 2.1
    else:
        assert np.std(late) < 1e-3


def test_a_steady_turn_is_that_of_a_neutral_car() -> None:
    """Stiffness in proportion to load: r = v delta / L; the body leans out of the bend (to the left: roll < 0)."""
    parameters = model.bmw_320i()
    last = level(6.0, 0.01, 15.0)[-1]
    assert last[model.YAW_RATE] == pytest.approx(15.0 * 0.01 / (parameters.a + parameters.b), rel=0.08)
    assert last[model.ROLL] < -0.003


def test_wind_and_bank_push_it_the_same_way() -> None:
    parameters = model.bmw_320i()
    bank = 0.02
    by_road = level(3.0, 0.0, 15.0, bank=bank)[-1]
    by_wind = level(3.0, 0.0, 15.0, wind_n=parameters.m * model.G * math.sin(bank))[-1]
    assert by_wind == pytest.approx(by_road)
    # Gravity pulls to the low side, the right.
    assert level(0.1, 0.0, 15.0, bank=bank)[-1][model.ACROSS] > 5e-3


def test_uphill_the_driver_pushes_and_the_driven_wheels_slip() -> None:
    n = 4000
    one, numbers = np.ones(n), model.as_numbers(model.bmw_320i())
    states, _, _ = model.courses(numbers, 0 * one, 15.0 * one, 0.5 * one, 0 * one, 0 * one, 0.0)
    assert states[-1, model.ALONG] == pytest.approx(15.0, abs=0.05)
    # Rear-driven: the rear wheels run ahead, by the force over load and slip stiffness.
    p = model.bmw_320i()
    front, rear = (states[-1, model.WHEELS[i]] * p.R_w / states[-1, model.ALONG] - 1.0 for i in (0, 2))
    load = p.m * model.G * p.a / (p.a + p.b)
    assert rear == pytest.approx(0.5 * p.m / (load * p.tire.p_kx1), rel=0.1)
    assert abs(front) < 3e-4


def test_softer_wheels_turn_back() -> None:
    n = 3000
    one, numbers = np.ones(n), model.as_numbers(model.bmw_320i())
    _, _, stiff = model.courses(numbers, 0.02 * one, 15.0 * one, 0 * one, 0 * one, 0 * one, 0.0)
    states, changes, soft = model.courses(numbers, 0.02 * one, 15.0 * one, 0 * one, 0 * one, 0 * one, 2e-6)
    assert stiff[-1] == 0.02
    # In a steady turn the front axle carries its share of m v r.
    p = model.bmw_320i()
    force = p.m * p.b / (p.a + p.b) * states[-1, model.YAW_RATE] * states[-1, model.ALONG]
    assert soft[-1] == pytest.approx(0.02 - 2e-6 * force, abs=2e-5)
    assert abs(changes[-1, model.YAW_RATE]) < 0.01


def course(**state: float) -> _Course:
    """A car that stands still in time, n rows alike."""
    states = np.zeros((5, model.STATES))
    for name, value in state.items():
        states[:, getattr(model, name)] = value
    nothing = np.zeros(5)
    return _Course(states, np.zeros_like(states), nothing, nothing, nothing, nothing)


def felt(one: _Course, turn: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    zero = np.zeros(5)
    rates, force = _felt(one, zero, zero, zero, zero + turn)
    return rates[2], force[2]


def test_a_leaning_body_reads_gravity_along_its_axes() -> None:
    roll, pitch = 0.03, 0.02
    _, force = felt(course(ROLL=roll))
    assert force == pytest.approx([0.0, model.G * math.sin(roll), model.G * math.cos(roll)])
    # Their pitch has the nose up: gravity is felt ahead then, as when speeding up.
    _, force = felt(course(PITCH=pitch))
    assert force == pytest.approx([model.G * math.sin(pitch), 0.0, model.G * math.cos(pitch)])


def test_an_imu_is_level_on_the_car_at_rest() -> None:
    """Its springs hold that body with the nose down by 0.07 degrees; a mount is told against what is level then."""
    resting_rad = model.resting_rad(model.as_numbers(model.bmw_320i()))
    assert -0.003 < resting_rad < -0.001
    _, force = felt(course(PITCH=resting_rad)._replace(resting_rad=resting_rad))
    assert force == pytest.approx([0.0, 0.0, model.G])
    straight = simulated(Way((Leg(400.0, 5.0),), 0.0, 5.0), 3, 20.0, (), QUIET).truth
    late = straight["time_s"] > 10.0
    assert abs(float(np.mean(straight["pitch_rad"][late]))) < 1e-4
    assert abs(float(np.mean(straight["accel_x_mps2"][late]))) < 2e-3


def test_a_banked_and_a_climbing_road_are_read_too() -> None:
    still = course()
    bank, grade = np.full(5, 0.05), np.full(5, 0.04)
    _, force = felt(still._replace(bank_rad=bank))
    assert force == pytest.approx([0.0, model.G * math.sin(0.05), model.G * math.cos(0.05)])
    _, force = felt(still._replace(grade_rad=grade))
    assert force == pytest.approx([model.G * math.sin(0.04), 0.0, model.G * math.cos(0.04)])


def test_a_turn_is_felt_along_the_bodys_axes() -> None:
    """Nose up by theta in a turn r to the left: the roll gyro, ahead and up, reads r sin(theta)."""
    rates, _ = felt(course(PITCH=0.02), turn=0.3)
    assert rates == pytest.approx([0.3 * math.sin(0.02), 0.0, 0.3 * math.cos(0.02)])
    rates, _ = felt(course(ROLL=0.03), turn=0.3)
    assert rates == pytest.approx([0.0, 0.3 * math.sin(0.03), 0.3 * math.cos(0.03)])


BEND = Way((Leg(150.0, 12.0), Leg(150.0, 12.0, 0.015), Leg(240.0, 12.0)), 0.0, 12.0)


def test_to_the_left_all_is_to_the_left() -> None:
    found = simulated(BEND, 3, 20.0, (), QUIET).truth
    bend = (found["time_s"] > 15.0) & (found["time_s"] < 18.0)
    mean = {name: float(np.mean(column[bend])) for name, column in found.items()}
    assert mean["gyro_z_radps"] == pytest.approx(12.0 * 0.015, rel=0.15)
    assert mean["steering_wheel_angle_rad"] > 0.3
    assert mean["roll_rad"] > 0.01
    # v r and what gravity adds to it where the body leans out of the bend.
    leak = model.G * mean["roll_rad"]
    assert mean["accel_y_mps2"] == pytest.approx(mean["speed_mps"] * mean["gyro_z_radps"] + leak, rel=0.02)
    assert mean["wheel_speed_fr_mps"] > mean["wheel_speed_fl_mps"]
    # Of which less is left upwards.
    across = mean["speed_mps"] * mean["gyro_z_radps"]
    assert mean["accel_z_mps2"] == pytest.approx(model.G - across * mean["roll_rad"], abs=0.01)


def test_effects_are_put_into_it() -> None:
    plain = simulated(BEND, 3, 20.0, (), QUIET).truth
    late = simulated(BEND, 3, 20.0, (Choice("steering_offset", {"offset_rad": 0.003}),), QUIET).truth
    more = float(np.mean(late["gyro_z_radps"][3000:]) - np.mean(plain["gyro_z_radps"][3000:]))
    assert more == pytest.approx(12.0 * 0.003 / 2.58, rel=0.15)
    ahead = simulated(BEND, 3, 20.0, (Choice("imu_lever_arm", {"x_m": 1.0}),), QUIET).truth
    pulled = ahead["accel_x_mps2"] - plain["accel_x_mps2"]
    assert pulled == pytest.approx(-(plain["gyro_z_radps"] ** 2 + plain["gyro_y_radps"] ** 2), abs=1e-6)
    small = simulated(BEND, 3, 20.0, (Choice("wheel_radius", {"fl": 1.01}),), replace(QUIET)).truth
    assert small["wheel_speed_fl_mps"] * 1.01 == pytest.approx(plain["wheel_speed_fl_mps"])


def test_over_a_road_that_curves_up_all_is_heavier_and_the_nose_rises() -> None:
    still = course(ALONG=10.0)
    climbing = still._replace(grade_rad=0.1 * model.STEP_S * np.arange(5.0))
    rates, force = felt(climbing)
    # Nose down is positive.
    assert rates == pytest.approx([0.0, -0.1, 0.0])
    assert force[2] == pytest.approx(model.G + 0.1 * 10.0, abs=1e-4)


def test_more_ratio_turns_less_and_wind_from_the_right_pushes_to_the_left() -> None:
    plain = simulated(BEND, 3, 20.0, (), QUIET).truth
    slower = simulated(BEND, 3, 20.0, (Choice("steering_ratio", {"scale": 1.25}),), QUIET).truth
    bend = (plain["time_s"] > 15.0) & (plain["time_s"] < 18.0)
    turns = [float(np.mean(found["gyro_z_radps"][bend])) for found in (plain, slower)]
    assert turns[1] == pytest.approx(turns[0] / 1.25, rel=0.03)
    gusts = (Choice("side_wind", {"rms_n": 600.0, "correlation_s": 2.0}),)
    windy = simulated(BEND, 3, 20.0, gusts, QUIET).truth
    # Tyres hold against it by slipping to the lee.
    slipped = windy["lateral_velocity_mps"] - plain["lateral_velocity_mps"]
    assert np.corrcoef(slipped, windy["side_wind_n"])[0, 1] > 0.5


def test_play_keeps_back_half_of_its_width() -> None:
    wave = np.concatenate([np.linspace(0.0, 0.1, 100), np.linspace(0.1, -0.1, 200)])
    found = _played(wave, 0.02)
    assert found[99] == pytest.approx(0.09)
    assert found[-1] == pytest.approx(-0.09)
    # On the way back it waits until the play is crossed.
    assert found[100:110] == pytest.approx(0.09)


def test_a_road_that_tilts_turns_the_body_with_it() -> None:
    still = course(ALONG=10.0)
    rates, _ = felt(still._replace(bank_rad=0.1 * model.STEP_S * np.arange(5.0)))
    assert rates == pytest.approx([0.1, 0.0, 0.0])
    # In a turn on a grade the heading moves off the slope: what was ahead is beside then.
    rates, _ = felt(still._replace(grade_rad=np.full(5, 0.05)), turn=0.2)
    assert rates[0] == pytest.approx(0.2 * 0.05)
    rates, _ = felt(still._replace(bank_rad=np.full(5, 0.05)), turn=0.2)
    assert rates[1] == pytest.approx(0.2 * 0.05)


def test_a_nose_that_rises_turns_the_pitch_gyro_back() -> None:
    rates, _ = felt(course(PITCH_RATE=0.1, ROLL=0.2))
    assert rates == pytest.approx([0.0, -0.1 * math.cos(0.2), 0.1 * math.sin(0.2)])
    rates, _ = felt(course(ROLL_RATE=0.1))
    assert rates == pytest.approx([0.1, 0.0, 0.0])
