"""Driver and integration: the programme is followed, and the step is small enough."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsz_daemon.sim.car import TUCSON
from dsz_daemon.sim.drive import COLUMNS, STEP_S, Columns, drive
from dsz_daemon.sim.driver import Programme, SineSteer, SpeedChange
from dsz_daemon.sim.road import FLAT
from dsz_daemon.sim.vehicle import TwoTrackCar

SHORT = Programme(
    10.0,
    (SpeedChange(0.5, 5.5, 10.0), SpeedChange(6.5, 9.0, -10.0)),
    (SineSteer(4.0, 0.5, 1, math.radians(70.0)),),
)


def driven(step_s: float) -> Columns:
    return drive(TwoTrackCar(TUCSON, FLAT), SHORT, step_s)


@pytest.fixture(scope="module")
def columns() -> Columns:
    return driven(STEP_S)


def test_halving_the_step_changes_nothing_that_a_sensor_could_see(columns: Columns) -> None:
    finer = driven(STEP_S / 2.0)
    moving = columns["time_s"] < 8.5
    for name in COLUMNS:
        if name.endswith("_nm"):
            continue  # torques follow the speed and are no sensor's input
        apart = np.abs(columns[name] - finer[name][::2])
        # One count is 1.9e-4 rad/s and 7.5e-4 m/s^2.
        assert apart[moving].max() < 5e-5, name
        # The last decimetres: brakes that lock are stiffer than the step; a few ms, 0.05 m/s^2.
        assert apart.max() < 0.05, name


def test_driver_keeps_to_the_programme_and_stops(columns: Columns) -> None:
    wanted, _ = SHORT.wanted(columns["time_s"])
    assert np.abs(columns["speed_mps"] - wanted).max() < 0.4
    assert abs(columns["speed_mps"][-1]) < 1e-3
    assert np.all(columns["speed_mps"][columns["time_s"] <= 0.5] == pytest.approx(0.0, abs=1e-9))


def test_wanted_acceleration_is_the_wanted_speeds_slope() -> None:
    t = np.arange(0.0, 10.0, 0.001)
    speed, acceleration = SHORT.wanted(t)
    assert np.gradient(speed, t) == pytest.approx(acceleration, abs=0.01)


def test_left_first_then_right(columns: Columns) -> None:
    first = (columns["time_s"] > 4.2) & (columns["time_s"] < 4.8)
    assert np.all(columns["road_wheel_angle_rad"][first] > 0.0)
    assert columns["gyro_z_radps"][first].min() > 0.01
    assert columns["accel_y_mps2"][first].min() > 0.1
    assert columns["roll_rad"][first].mean() > 0.0
    second = (columns["time_s"] > 5.3) & (columns["time_s"] < 5.8)
    assert columns["gyro_z_radps"][second].max() < -0.01


def test_driven_front_wheels_run_ahead_and_braked_ones_behind(columns: Columns) -> None:
    pulling = (columns["time_s"] > 1.5) & (columns["time_s"] < 2.5)
    assert np.all(columns["wheel_speed_fl_mps"][pulling] > columns["wheel_speed_rl_mps"][pulling])
    assert columns["pitch_rad"][pulling].mean() < 0.0
    braking = (columns["time_s"] > 7.2) & (columns["time_s"] < 8.2)
    assert np.all(columns["wheel_speed_fl_mps"][braking] < columns["speed_mps"][braking])
    assert columns["pitch_rad"][braking].mean() > 0.0
    assert columns["accel_x_mps2"][braking].max() < -1.0


def test_progress_ends_where_it_should() -> None:
    heard: list[float] = []
    drive(TwoTrackCar(TUCSON, FLAT), SHORT, progress=heard.append)
    assert heard[0] == 0.0
    assert heard[-1] == 1.0
    assert heard == sorted(heard)
