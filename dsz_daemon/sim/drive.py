"""Drive: integrate a car through a scenario and keep what truly happened.

The columns are what a perfect instrument would have written; sensors and truth file are both
made from them.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.signals import IMU_CHANNELS, WHEELS
from dsz_daemon.sim.road import Vector
from dsz_daemon.sim.vehicle import Driver, Inputs, Motion, State, TwoTrackCar, next_state, rolling, specific_force

Columns = dict[str, NDArray[np.float64]]

# Chosen: 500 Hz. Halving it moves no column of the sine steer by more than the bound that
# tests/unit/test_sim_drive.py states, far below one count of any sensor.
STEP_S = 0.002
PROGRESS_EVERY_STEPS = 500

# Below this speed the direction of the C.G. is that of numerical dust: sideslip is called 0.
SIDESLIP_ABOVE_MPS = 0.1

COLUMNS = (
    "time_s",
    *(f"{channel}_{'radps' if channel.startswith('gyro') else 'mps2'}" for channel in IMU_CHANNELS),
    "speed_mps",
    "lateral_velocity_mps",
    "sideslip_rad",
    "roll_rad",
    "pitch_rad",
    "yaw_rad",
    "road_bank_rad",
    "road_grade_up_rad",
    "road_wheel_angle_rad",
    *(f"wheel_speed_{wheel}_mps" for wheel in WHEELS),
    "drive_torque_nm",
    "brake_torque_nm",
)


def drive(
    car: TwoTrackCar,
    driver: Driver,
    duration_s: float,
    step_s: float = STEP_S,
    start: State | None = None,
    progress: Callable[[float], None] | None = None,
) -> Columns:
    """Return what happens from 0 to `duration_s`, one row per step, both ends included.

    `start` is the car at rest where not given; `progress` is told the share done, 0 to 1.
    """
    steps = round(duration_s / step_s)
    state = start if start is not None else rolling(car.car)
    place_m = (car.car.imu_x_m, car.car.imu_y_m, car.car.imu_z_m)
    rows = []
    for step in range(steps + 1):
        t_s = step * step_s
        inputs = driver(t_s, state.forward_mps)
        motion = car.motion(state, inputs)
        rows.append(_row(t_s, car, state, inputs, motion, place_m))
        if step < steps:
            state = next_state(car, driver, t_s, state, step_s, motion)
        if progress is not None and step % PROGRESS_EVERY_STEPS == 0:
            progress(step / steps)
    table = np.array(rows, dtype=np.float64)
    return {name: table[:, i].copy() for i, name in enumerate(COLUMNS)}


def _row(
    t_s: float, car: TwoTrackCar, state: State, inputs: Inputs, motion: Motion, place_m: Vector
) -> tuple[float, ...]:
    """Return one row in the order of `COLUMNS`."""
    stance = motion.pose
    along_mps, across_mps = stance.along_mps, stance.across_mps
    front_m, rear_m = car.car.front_wheel_radius_m, car.car.rear_wheel_radius_m
    point = car.road(state.distance_m)
    # Attitude from the vertical alone: whatever road and suspension each contribute.
    up = stance.vertical
    return (
        t_s,
        *stance.turn_radps,
        *specific_force(state, motion, place_m),
        along_mps,
        across_mps,
        math.atan2(across_mps, along_mps) if along_mps > SIDESLIP_ABOVE_MPS else 0.0,
        math.atan2(up[1], up[2]),
        -math.asin(up[0]),
        state.yaw_rad,
        point.bank_rad,
        point.grade_up_rad,
        inputs.road_wheel_angle_rad,
        state.spin_fl_radps * front_m,
        state.spin_fr_radps * front_m,
        state.spin_rl_radps * rear_m,
        state.spin_rr_radps * rear_m,
        2.0 * inputs.front_drive_nm,
        2.0 * (inputs.front_brake_nm + inputs.rear_brake_nm),
    )
