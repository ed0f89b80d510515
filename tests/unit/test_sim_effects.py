"""All effects off: the simulated car is the nominal one. Each effect on: it is not, and the right channel shows it.

The nominal model is written here a second time, from the outside's contract: a linear single-track car, driven by the
steering angle and wheel speeds that are on the bus.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from dsz_daemon.errors import ConfigError
from dsz_daemon.sim.bus import database
from dsz_daemon.sim.car import TUCSON
from dsz_daemon.sim.coding import EPOCH_S, can_frames
from dsz_daemon.sim.drive import Columns, drive
from dsz_daemon.sim.driver import Programme, SineSteer, SpeedChange
from dsz_daemon.sim.effects import EFFECTS, with_effect
from dsz_daemon.sim.effects_of_surroundings import random_profile
from dsz_daemon.sim.road import FLAT
from dsz_daemon.sim.sensors import SensorErrors
from dsz_daemon.sim.vehicle import TwoTrackCar
from dsz_daemon.sim.world import World, nominal

Array = NDArray[np.float64]
G, RATIO, DEG = 9.80665, 15.7, math.pi / 180.0
MASS, YAW_INERTIA, LF, LR, CF, CR = 1673.0, 2850.0, 1.149, 1.491, 62000.0, 68000.0
WHEELS = {"fl": (LF, 0.7925), "fr": (LF, -0.7925), "rl": (-LR, 0.793), "rr": (-LR, -0.793)}

# To 15 m/s, sines to 3 m/s^2 both ways, and a brake in a bend.
PROGRAMME = Programme(
    40.0,
    (SpeedChange(1.0, 10.0, 15.0), SpeedChange(30.0, 36.0, -8.0)),
    (
        SineSteer(12.0, 0.3, 2, 30.0 * DEG),
        SineSteer(22.0, 0.5, 2, -40.0 * DEG),
        SineSteer(31.0, 0.25, 1, 30.0 * DEG),
    ),
)
NOMINAL = nominal(World(TUCSON, FLAT, PROGRAMME, SensorErrors(noisy=False)))


def driven(world: World) -> Columns:
    return drive(TwoTrackCar(world.car, world.road), world.programme)


def predicted(time_s: Array, speed_mps: Array, steer_rad: Array) -> dict[str, Array]:
    """The nominal simulation on an even grid: Heun's method."""
    dt_s, n = float(time_s[1] - time_s[0]), len(time_s)
    yaw_rate, aside, force = np.zeros(n), np.zeros(n), np.zeros(n)

    def rates(vy: float, r: float, v: float, delta: float) -> tuple[float, float, float]:
        v = max(v, 1.0)
        front = 2.0 * CF * (delta - (vy + LF * r) / v)
        rear = -2.0 * CR * (vy - LR * r) / v
        return (front + rear) / MASS - r * v, (LF * front - LR * rear) / YAW_INERTIA, (front + rear) / MASS

    for i in range(n):
        now = rates(aside[i], yaw_rate[i], speed_mps[i], steer_rad[i])
        force[i] = now[2]
        if i + 1 < n:
            then = rates(aside[i] + dt_s * now[0], yaw_rate[i] + dt_s * now[1], speed_mps[i + 1], steer_rad[i + 1])
            aside[i + 1] = aside[i] + dt_s * (now[0] + then[0]) / 2.0
            yaw_rate[i + 1] = yaw_rate[i] + dt_s * (now[1] + then[1]) / 2.0
    zero = np.zeros(n)
    found = {
        "gyro_x": zero,
        "gyro_y": zero,
        "gyro_z": yaw_rate,
        "accel_x": np.gradient(speed_mps, dt_s) - yaw_rate * aside,
        "accel_y": force,
        "accel_z": zero + G,
    }
    for wheel, (x, y) in WHEELS.items():
        delta = steer_rad if wheel[0] == "f" else zero
        vx, vy = speed_mps - y * yaw_rate, aside + x * yaw_rate
        found[f"wheel_speed_{wheel}"] = vx * np.cos(delta) + vy * np.sin(delta)
    return found


def test_with_all_effects_off_the_car_is_the_nominal_one() -> None:
    """What is left: sines of angles up to 2.5 deg, slips that take 2 ms to build up."""
    columns = driven(NOMINAL)
    speed = (columns["wheel_speed_rl_mps"] + columns["wheel_speed_rr_mps"]) / 2.0
    model = predicted(columns["time_s"], speed, columns["steering_wheel_angle_rad"] / RATIO)
    moving = columns["speed_mps"] > 5.0
    assert np.abs(columns["gyro_z_radps"][moving]).max() > 0.2
    assert np.abs(columns["accel_y_mps2"][moving]).max() > 2.5
    for name, most in (
        ("gyro_x", 1e-9), ("gyro_y", 1e-9), ("gyro_z", 3e-3), ("accel_x", 1e-3), ("accel_y", 0.04), ("accel_z", 1e-6),
        *((f"wheel_speed_{wheel}", 3e-3) for wheel in WHEELS),
    ):  # fmt: skip
        unit = {"g": "radps", "a": "mps2", "w": "mps"}[name[0]]
        assert np.abs(columns[f"{name}_{unit}"] - model[name])[moving].max() < most, name


def read(world: World) -> tuple[Array, dict[str, Array]]:
    """What stands on the bus, decoded by cantools, on the IMU's stamps; SI."""
    car = TUCSON
    radii = (car.front_wheel_radius_m,) * 2 + (car.rear_wheel_radius_m,) * 2
    frames = can_frames(driven(world), car.steering_ratio, radii, world.errors, np.random.default_rng(1))
    decoder = {message.frame_id: message for message in database().messages}
    times: dict[str, list[float]] = {}
    values: dict[str, list[float]] = {}
    for frame in frames:
        if frame.can_id not in decoder or frame.is_extended:
            continue
        for name, value in decoder[frame.can_id].decode(frame.data).items():
            times.setdefault(name, []).append(frame.t_ns * 1e-9 - EPOCH_S)
            values.setdefault(name, []).append(float(value))
    at = np.array(times["YAW_ADC"])

    def channel(name: str, factor: float, null: float = 0.0) -> Array:
        return (np.interp(at, times[name], values[name]) - null) * factor

    null = 2.5 / 7.63e-5
    found = {"steer": channel("STEER_ANGLE", DEG / RATIO)}
    for name, signal in (("gyro_x", "ROLL_ADC"), ("gyro_y", "PITCH_ADC"), ("gyro_z", "YAW_ADC")):
        found[name] = channel(signal, 7.63e-5 / 0.007 * DEG, null)
    for name, signal in (("accel_x", "LONG_ADC"), ("accel_y", "LAT_ADC"), ("accel_z", "VERT_ADC")):
        found[name] = channel(signal, 7.63e-5 * G, null)
    for wheel in WHEELS:
        found[f"wheel_speed_{wheel}"] = channel(f"WHEEL_SPEED_{wheel.upper()}", 1.0 / 3.6)
    return at, found


def smooth(values: Array) -> Array:
    """A third of a second's mean: wheel speeds come in steps of 9 mm/s."""
    return np.convolve(values, np.full(33, 1.0 / 33.0), mode="same")


def mismatch(world: World) -> dict[str, float]:
    """RMS of recorded minus nominal while the car moves, per channel."""
    time_s, seen = read(world)
    speed = (seen["wheel_speed_rl"] + seen["wheel_speed_rr"]) / 2.0
    model = predicted(time_s, smooth(speed), seen["steer"])
    moving = (speed > 5.0) & (time_s < 39.0)
    return {name: float(np.sqrt(np.mean(smooth(seen[name] - values)[moving] ** 2))) for name, values in model.items()}


@cache
def floor() -> dict[str, float]:
    return mismatch(NOMINAL)


def test_the_floor_of_a_recording_is_low() -> None:
    for name, most in {"gyro": 1e-3, "accel": 0.05, "wheel": 0.01}.items():
        assert max(value for channel, value in floor().items() if channel.startswith(name)) < most


# Where each one must show, by mechanics.
SHOWS = {
    "imu_lever_arm": {"accel_x", "accel_y"},
    "imu_misalignment": {"accel_x", "accel_y", "gyro_x"},
    "axis_fault": {"accel_y"},
    "gyro_scale": {"gyro_z"},
    "accel_scale": {"accel_y", "accel_z"},
    "gyro_cross_axis": {"gyro_x", "gyro_y"},
    "accel_cross_axis": {"accel_x", "accel_y"},
    "gyro_g_sensitivity": {"gyro_x", "gyro_y", "gyro_z"},
    "bias_drift": {"accel_x", "accel_y", "accel_z"},
    "imu_delay": {"gyro_z", "accel_y"},
    "steering_delay": {"gyro_z", "accel_y"},
    "wheel_speed_delay": {"accel_x"},
    "sensor_bandwidth": {"gyro_z", "accel_y"},
    "sensor_saturation": {"accel_z"},
    "road_bank": {"gyro_x", "accel_y"},
    "road_grade": {"gyro_y", "accel_x"},
    "suspension_roll": {"gyro_x", "accel_y"},
    "suspension_pitch": {"gyro_y", "accel_x"},
    "tyre_saturation": {"accel_y"},
    "low_friction": {"gyro_z", "accel_y"},
    "tyre_relaxation": {"gyro_z", "accel_y"},
    "wheel_slip": {"wheel_speed_fl", "wheel_speed_fr"},
    "wheel_radius": {"wheel_speed_fl"},
    "steering_offset": {"gyro_z", "accel_y"},
    "steering_ratio": {"gyro_z", "accel_y"},
    "steering_compliance": {"gyro_z", "accel_y"},
    "steering_backlash": {"gyro_z", "accel_y"},
    "side_wind": {"gyro_z", "accel_y"},
    "mass_loading": {"gyro_z", "accel_y"},
    "cornering_stiffness": {"gyro_z", "accel_y"},
}


def test_there_is_a_row_for_each_effect() -> None:
    assert EFFECTS.keys() == SHOWS.keys()


@pytest.mark.parametrize("name", SHOWS)
def test_each_effect_is_seen_where_mechanics_says(name: str) -> None:
    found = mismatch(with_effect(NOMINAL, name))
    for channel in SHOWS[name]:
        assert found[channel] > 2.0 * floor()[channel], (channel, found[channel], floor()[channel])


def test_gradients_are_what_they_say() -> None:
    """Steady turn and steady brake: k = lean or dive per m/s^2, reading = a (1 + g k)."""
    k = 0.01
    world = with_effect(NOMINAL, "suspension_roll", roll_gradient_rad_per_mps2=k)
    turning = replace(PROGRAMME, duration_s=20.0, steering=(SineSteer(12.0, 0.02, 1, 30.0 * DEG),))
    columns = driven(replace(world, programme=turning))
    moving = columns["time_s"] > 16.0
    ay = columns["gyro_z_radps"] * columns["speed_mps"]
    assert columns["roll_rad"][moving] / ay[moving] == pytest.approx(k, rel=0.03)
    assert columns["accel_y_mps2"][moving] / ay[moving] == pytest.approx(1.0 + G * k, rel=0.02)
    k = 0.006
    world = with_effect(NOMINAL, "suspension_pitch", pitch_gradient_rad_per_mps2=k)
    braking = replace(
        PROGRAMME, duration_s=24.0, speed_changes=(SpeedChange(0.5, 8.0, 20.0), SpeedChange(8.0, 24.0, -20.0))
    )
    columns = driven(replace(world, programme=replace(braking, steering=())))
    hardest = (columns["time_s"] > 15.0) & (columns["time_s"] < 17.0)
    ax = np.gradient(columns["speed_mps"], columns["time_s"])
    assert ax[hardest].max() < -1.5
    assert -columns["pitch_rad"][hardest] / ax[hardest] == pytest.approx(k, rel=0.1)
    assert columns["accel_x_mps2"][hardest] / ax[hardest] == pytest.approx(1.0 + G * k, rel=0.02)


def test_play_keeps_the_wheels_back_by_half_of_it_each_way() -> None:
    columns = driven(with_effect(NOMINAL, "steering_backlash", width_rad=0.01))
    behind = columns["steering_wheel_angle_rad"] / RATIO - columns["road_wheel_angle_rad"]
    assert behind.max() == pytest.approx(0.005, abs=1e-9)
    assert behind.min() == pytest.approx(-0.005, abs=1e-9)


def test_compliance_turns_the_wheels_back_by_the_axles_force() -> None:
    columns = driven(with_effect(NOMINAL, "steering_compliance", rad_per_n=1e-6))
    gone = columns["steering_wheel_angle_rad"] / RATIO - columns["road_wheel_angle_rad"]
    moving = columns["speed_mps"] > 5.0
    # The front axle's share of m a_y, and of the yaw moment.
    yaw = np.gradient(columns["gyro_z_radps"], columns["time_s"])
    force = (MASS * columns["accel_y_mps2"] * LR + YAW_INERTIA * yaw) / (LF + LR)
    assert np.abs(gone - 1e-6 * force)[moving].max() < 0.03 * np.abs(gone).max()


def test_effects_can_be_put_on_each_other_in_any_order() -> None:
    """Ice stays as slippery as it is, whatever the tyres' own friction is said to be before or afterwards."""
    once = with_effect(with_effect(NOMINAL, "low_friction", friction_coefficient=0.2), "tyre_saturation")
    other = with_effect(with_effect(NOMINAL, "tyre_saturation"), "low_friction", friction_coefficient=0.2)
    first, second = driven(once), driven(other)
    for name, column in first.items():
        np.testing.assert_array_equal(column, second[name], err_msg=name)
    icy = (first["time_s"] > 12.0) & (first["time_s"] < 30.0)
    assert np.all(first["friction"][icy] == 0.2)
    assert np.all(first["friction"][first["time_s"] < 9.0] == 0.9)
    assert 0.15 * G < np.abs(first["accel_y_mps2"][icy]).max() < 0.21 * G


def test_a_random_profile_has_its_rms_and_scale() -> None:
    at: Array = np.arange(0.0, 200_000.0, 5.0)
    profile = random_profile(0.03, 60.0, 7)(at)
    assert np.sqrt(np.mean(profile**2)) == pytest.approx(0.03, rel=0.15)
    assert random_profile(0.03, 60.0, 7)(at) == pytest.approx(profile)
    assert np.abs(random_profile(0.03, 60.0, 8)(at) - profile).max() > 0.03


@pytest.mark.parametrize(
    ("name", "parameters", "says"),
    [
        ("bad_luck", {}, "unknown effect 'bad_luck'"),
        ("imu_delay", {"delay": 1.0}, "delay: unknown parameter; did you mean 'delay_s'"),
    ],
)
def test_unknown_names_are_said(name: str, parameters: dict[str, float], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        with_effect(NOMINAL, name, **parameters)
