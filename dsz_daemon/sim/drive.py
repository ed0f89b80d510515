"""Drive: integrate a car through a scenario and keep what truly happened.

The columns are what a perfect instrument would have written; sensors and truth file are both
made from them.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.compiled import compiled
from dsz_daemon.signals import IMU_CHANNELS, WHEELS
from dsz_daemon.sim.axle import Axle
from dsz_daemon.sim.driver import Hands, Plan, Programme, driver_inputs, hands, plan
from dsz_daemon.sim.road import Road, Vector, road_point
from dsz_daemon.sim.vehicle import (
    Body,
    Inputs,
    Motion,
    State,
    TwoTrackCar,
    car_motion,
    next_state,
    rolling,
    specific_force,
)

Columns = dict[str, NDArray[np.float64]]
Wheels = tuple[float, float, float, float]  # front left, front right, rear left, rear right

# Chosen: 1 kHz. Halving it moves no column of the sine steer by more than the bound that
# tests/unit/test_sim_drive.py states, far below one count of any sensor.
STEP_S = 0.001
# Every other step is kept.
STEPS_A_ROW = 2
ROW_S = STEP_S * STEPS_A_ROW
_ROWS_AT_ONCE = 250

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
    "steering_wheel_angle_rad",
    "distance_m",
    "off_middle_m",
    "side_wind_n",
    "friction",
)


def drive(
    car: TwoTrackCar,
    programme: Programme,
    step_s: float = STEP_S,
    start: State | None = None,
    progress: Callable[[float], None] | None = None,
) -> Columns:
    """Return what happens from 0 to the programme's end, a row every other step, both ends included.

    `start` is the car at rest where not given; `progress` is told the share done, 0 to 1.
    """
    described = plan(programme, step_s)
    table = np.zeros((len(described.friction_limit) // 2 // STEPS_A_ROW + 1, len(COLUMNS)))
    state = start if start is not None else rolling(car.car)
    place_m = (car.car.imu_x_m, car.car.imu_y_m, car.car.imu_z_m)
    front_m, rear_m = car.car.front_wheel_radius_m, car.car.rear_wheel_radius_m
    radii_m = (front_m, front_m, rear_m, rear_m)
    driver, column_rad = hands(programme, car.car), 0.0
    for first in range(0, len(table), _ROWS_AT_ONCE):
        if progress is not None:
            progress(first / len(table))
        rows = table[first : first + _ROWS_AT_ONCE]
        state, column_rad = _driven(
            car.body, car.front, car.rear, car.road, driver, described, first * STEPS_A_ROW, step_s, state, column_rad,
            place_m, radii_m, car.car.wheel_radius_scale, car.car.slips, rows,
        )  # fmt: skip
    if progress is not None:
        progress(1.0)
    return {name: table[:, i].copy() for i, name in enumerate(COLUMNS)}


@compiled
def _driven(
    body: Body,
    front: Axle,
    rear: Axle,
    road: Road,
    hands: Hands,
    plan: Plan,
    first: int,
    step_s: float,
    state: State,
    column_rad: float,
    place_m: Vector,
    radii_m: Wheels,
    scales: Wheels,
    slips: bool,
    table: NDArray[np.float64],
) -> tuple[State, float]:
    """Fills `table` from step `first` on; returns the state, and where the column's play is, after the last row.

    What the driver sees within a step is what the step's beginning lets expect.
    """
    still, last = State(*STILL), (len(plan.friction_limit) - 1) // 2
    for row in range(len(table)):
        for substep in range(STEPS_A_ROW):
            step = first + row * STEPS_A_ROW + substep
            inputs, column_rad, wheel_rad = driver_inputs(hands, plan, road, 2 * step, state, still, 0.0, column_rad)
            now = car_motion(body, front, rear, road, state, inputs)
            if substep == 0:
                _fill(
                    table[row], step * step_s, road, state, inputs, now, place_m, radii_m, scales, slips, wheel_rad,
                    front.tyre.friction,
                )  # fmt: skip
            if step >= last:
                return state, column_rad
            halfway, _, _ = driver_inputs(hands, plan, road, 2 * step + 1, state, now.rates, 0.5 * step_s, column_rad)
            then, _, _ = driver_inputs(hands, plan, road, 2 * step + 2, state, now.rates, step_s, column_rad)
            state = next_state(body, front, rear, road, state, now, halfway, then, step_s)
    return state, column_rad


STILL = (0.0,) * len(State._fields)


@compiled
def _fill(
    row: NDArray[np.float64],
    t_s: float,
    road: Road,
    state: State,
    inputs: Inputs,
    motion: Motion,
    place_m: Vector,
    radii_m: Wheels,
    scales: Wheels,
    slips: bool,
    wheel_rad: float,
    friction: float,
) -> None:
    """Fills one row in the order of `COLUMNS`."""
    stance = motion.pose
    along_mps, across_mps = stance.along_mps, stance.across_mps
    point = road_point(road, state.distance_m)
    # Attitude from the vertical alone: whatever road and suspension each contribute.
    up = stance.vertical
    turn, felt = stance.turn_radps, specific_force(state, motion, place_m)
    row[0] = t_s
    row[1], row[2], row[3] = turn
    row[4], row[5], row[6] = felt
    row[7], row[8] = along_mps, across_mps
    row[9] = math.atan2(across_mps, along_mps) if along_mps > SIDESLIP_ABOVE_MPS else 0.0
    row[10], row[11], row[12] = math.atan2(up[1], up[2]), -math.asin(up[0]), state.yaw_rad
    row[13], row[14] = point.bank_rad, point.grade_up_rad
    row[15] = motion.road_wheel_angle_rad
    speeds = motion.hubs_mps
    if slips:
        speeds = (
            state.spin_fl_radps * radii_m[0],
            state.spin_fr_radps * radii_m[1],
            state.spin_rl_radps * radii_m[2],
            state.spin_rr_radps * radii_m[3],
        )
    for wheel in range(4):
        row[16 + wheel] = speeds[wheel] / scales[wheel]
    row[20] = 2.0 * (inputs.front_drive_nm + inputs.rear_drive_nm)
    row[21] = 2.0 * (inputs.front_brake_nm + inputs.rear_brake_nm)
    row[22] = wheel_rad
    row[23], row[24] = state.distance_m, state.off_middle_m
    row[25], row[26] = inputs.side_wind_n, min(friction, inputs.friction_limit)
