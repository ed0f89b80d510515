"""The driver: follows a speed profile with the pedals, the road or a steering program with the wheel.

Speed and steering are sums of smooth pieces over time, so that a scenario is a short table. The driver sees
the true speed and the road and knows the car's weight; nothing is measured or estimated here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.compiled import compiled
from dsz_daemon.signals import STANDARD_GRAVITY_MPS2
from dsz_daemon.sim.car import Car
from dsz_daemon.sim.road import Road, road_bend_per_m, road_point
from dsz_daemon.sim.vehicle import AIR_KG_PER_M3, Inputs, State

Course = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # of the time in s

# Chosen: closes a speed error within about a second, as a calm driver does.
SPEED_GAIN_PER_S = 1.0
# Chosen: each wheel is held by this much at a stop, as by a pressed pedal, fading in over the
# last 0.5 m/s; enough for a grade of 25 %.
HOLD_NM = 400.0
HOLD_BELOW_MPS = 0.5
# Chosen: the speed of a car in first gear at idle.
LET_GO_BELOW_MPS = 2.0
# Chosen: a driver looks so far ahead, and comes back to the middle of the lane within some seconds.
PREVIEW_S = 0.2
FOLLOW_RADPS = 1.0
FOLLOW_DAMPING = 0.8
SLOWEST_FOLLOWED_MPS = 3.0
LARGEST_ANGLE_RAD = 0.6


Times = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SpeedChange:
    """One change of the wanted speed, S-shaped between two times."""

    start_s: float
    end_s: float
    change_mps: float

    def wanted(self, t_s: Times) -> tuple[Times, Times]:
        """Return its share of the wanted speed (m/s) and acceleration (m/s^2)."""
        duration_s = self.end_s - self.start_s
        x = np.clip((t_s - self.start_s) / duration_s, 0.0, 1.0)
        return self.change_mps * x * x * (3.0 - 2.0 * x), self.change_mps * 6.0 * x * (1.0 - x) / duration_s


@dataclass(frozen=True, slots=True)
class SineSteer:
    """Whole periods of a sine at the steering wheel; positive amplitude begins to the left."""

    start_s: float
    frequency_hz: float
    periods: int
    amplitude_rad: float

    def angle_rad(self, t_s: Times) -> Times:
        """Return the steering wheel angle."""
        phase = (t_s - self.start_s) * self.frequency_hz
        runs = (phase > 0.0) & (phase < self.periods)
        return np.where(runs, self.amplitude_rad * np.sin(2.0 * math.pi * phase), 0.0)


@dataclass(frozen=True, slots=True)
class Programme:
    """What the driver of one scenario does, start to end; and what else comes with time.

    With `follows_road` the steering pieces come on top of what keeps to the road's middle.
    """

    duration_s: float
    speed_changes: tuple[SpeedChange, ...]
    steering: tuple[SineSteer, ...] = ()
    follows_road: bool = False
    side_wind_n: Course | None = None
    friction_limit: Course | None = None

    def wanted(self, t_s: Times) -> tuple[Times, Times]:
        """Return wanted speed (m/s) and acceleration (m/s^2)."""
        speed_mps, acceleration_mps2 = np.zeros(len(t_s)), np.zeros(len(t_s))
        for change in self.speed_changes:
            speed, acceleration = change.wanted(t_s)
            speed_mps += speed
            acceleration_mps2 += acceleration
        return speed_mps, acceleration_mps2

    def steering_wheel_rad(self, t_s: Times) -> Times:
        """Return the steering wheel angle."""
        total = np.zeros(len(t_s))
        for steer in self.steering:
            total += steer.angle_rad(t_s)
        return total


class Plan(NamedTuple):
    """What driver and surroundings are to do, at every half step: arrays of equal length, from time 0."""

    wanted_mps: NDArray[np.float64]
    wanted_mps2: NDArray[np.float64]
    steering_wheel_rad: NDArray[np.float64]
    side_wind_n: NDArray[np.float64]
    friction_limit: NDArray[np.float64]


class Hands(NamedTuple):
    """The constants of the driver in the car: pedals and steering."""

    follows_road: bool
    steering_ratio: float
    ratio_per_rad: float
    offset_rad: float
    half_play_rad: float
    wheelbase_m: float
    understeer_s2_per_m: float
    cg_to_rear_m: float
    rear_drift_s2_per_m: float
    moved_kg: float
    rolling_n: float
    drag_kg_per_m: float
    radius_m: float
    front_drive_share: float
    front_brake_share: float
    engine_braking_n: float


def plan(programme: Programme, step_s: float) -> Plan:
    """Return the programme at every half step."""
    halves = np.arange(2 * round(programme.duration_s / step_s) + 1, dtype=np.float64)
    times: NDArray[np.float64] = 0.5 * step_s * halves
    wanted_mps, wanted_mps2 = programme.wanted(times)
    # Dust of the sum: the last piece ends a drive at a standstill.
    wanted_mps[wanted_mps < 1e-9] = 0.0
    wind = np.zeros(len(times)) if programme.side_wind_n is None else programme.side_wind_n(times)
    limit = np.full(len(times), math.inf) if programme.friction_limit is None else programme.friction_limit(times)
    return Plan(wanted_mps, wanted_mps2, programme.steering_wheel_rad(times), wind, limit)


def hands(programme: Programme, car: Car) -> Hands:
    """Return the driver of a programme in a car."""
    spin_kg = 2.0 * car.wheel_inertia_kgm2 * (car.front_wheel_radius_m**-2 + car.rear_wheel_radius_m**-2)
    front_n, rear_n = car.front_static_load_n, car.rear_static_load_n
    give_way = front_n / car.front_cornering_stiffness_n_per_rad - rear_n / car.rear_cornering_stiffness_n_per_rad
    return Hands(
        programme.follows_road,
        car.steering_ratio * car.steering_ratio_scale,
        car.steering_ratio_per_rad,
        car.steering_offset_rad,
        0.5 * car.steering_backlash_rad,
        car.wheelbase_m,
        give_way / STANDARD_GRAVITY_MPS2,
        car.cg_to_rear_axle_m,
        rear_n / car.rear_cornering_stiffness_n_per_rad / STANDARD_GRAVITY_MPS2,
        car.mass_kg + spin_kg,
        car.rolling_resistance * car.mass_kg * STANDARD_GRAVITY_MPS2,
        0.5 * AIR_KG_PER_M3 * car.drag_area_m2,
        car.front_wheel_radius_m,
        car.front_drive_share,
        car.front_brake_share,
        car.engine_braking_mps2 * (car.mass_kg + spin_kg),
    )


@compiled
def wheel_angle_on_road_rad(hands: Hands, road: Road, state: State, rates: State, by_s: float) -> float:
    """Return the road wheel angle that keeps to the road's middle, `by_s` after `state`.

    What the bend ahead takes in a steady turn, and what brings a car that only follows its wheels back
    like a damped spring.
    """
    speed_mps = max(state.forward_mps, SLOWEST_FOLLOWED_MPS)
    bend_per_m = road_bend_per_m(road, state.distance_m + PREVIEW_S * state.forward_mps)
    off_m = state.off_middle_m + by_s * rates.off_middle_m
    off_rad = state.off_heading_rad + by_s * rates.off_heading_rad
    steady_rad = bend_per_m * (hands.wheelbase_m + hands.understeer_s2_per_m * speed_mps * speed_mps)
    # In a bend the car's middle drifts: its axis points that much off the road's direction.
    off_rad += bend_per_m * (hands.cg_to_rear_m - hands.rear_drift_s2_per_m * speed_mps * speed_mps)
    back_per_m = FOLLOW_RADPS * FOLLOW_RADPS / (speed_mps * speed_mps) * off_m
    turn_per_m = 2.0 * FOLLOW_DAMPING * FOLLOW_RADPS / speed_mps * off_rad
    wanted_rad = steady_rad - hands.wheelbase_m * (back_per_m + turn_per_m)
    return max(-LARGEST_ANGLE_RAD, min(LARGEST_ANGLE_RAD, wanted_rad))


@compiled
def played_rad(hands: Hands, before_rad: float, wanted_rad: float) -> float:
    """Return where the road wheels are when the column comes from wanting `wanted_rad`: play keeps them back."""
    return min(max(before_rad, wanted_rad - hands.half_play_rad), wanted_rad + hands.half_play_rad)


@compiled
def driver_inputs(
    hands: Hands, plan: Plan, road: Road, at: int, state: State, rates: State, by_s: float, column_rad: float
) -> tuple[Inputs, float, float]:
    """Return what the driver does `by_s` after `state`, the row `at` of the plan.

    And the column's angle at the road wheels, and the steering wheel's. `column_rad` is where the column's play
    stood at `state`.
    """
    speed_mps = state.forward_mps + by_s * rates.forward_mps
    wheel_rad = plan.steering_wheel_rad[at]
    if hands.follows_road:
        wheel_rad += hands.steering_ratio * wheel_angle_on_road_rad(hands, road, state, rates, by_s)
    ratio = hands.steering_ratio * (1.0 + hands.ratio_per_rad * abs(wheel_rad))
    column_rad = played_rad(hands, column_rad, wheel_rad / ratio)
    wanted_mps, wanted_mps2 = plan.wanted_mps[at], plan.wanted_mps2[at]
    acceleration_mps2 = wanted_mps2 + SPEED_GAIN_PER_S * (wanted_mps - speed_mps)
    # The road's pull is felt in the back, and held against at once.
    pull_mps2 = STANDARD_GRAVITY_MPS2 * math.sin(road_point(road, state.distance_m).grade_up_rad)
    force_n = hands.moved_kg * acceleration_mps2 + hands.drag_kg_per_m * speed_mps * abs(speed_mps)
    force_n += hands.moved_kg * pull_mps2 + hands.rolling_n * math.tanh(speed_mps / HOLD_BELOW_MPS)
    torque_nm, hold_nm = force_n * hands.radius_m, 0.0
    if wanted_mps <= 0.0:
        hold_nm = HOLD_NM * max(0.0, 1.0 - abs(speed_mps) / HOLD_BELOW_MPS)
        torque_nm = min(torque_nm, 0.0)
    # An engine that is about to stall is let go.
    engine_nm = hands.engine_braking_n * hands.radius_m * math.tanh(max(speed_mps, 0.0) / LET_GO_BELOW_MPS)
    drive_nm = 0.5 * max(torque_nm, -engine_nm)
    brake_nm = 0.5 * max(-torque_nm - engine_nm, 0.0)
    inputs = Inputs(
        column_rad + hands.offset_rad,
        hands.front_drive_share * drive_nm,
        hold_nm + hands.front_brake_share * brake_nm,
        hold_nm + (1.0 - hands.front_brake_share) * brake_nm,
        (1.0 - hands.front_drive_share) * drive_nm,
        plan.side_wind_n[at],
        plan.friction_limit[at],
    )
    return inputs, column_rad, wheel_rad
