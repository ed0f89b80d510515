"""One axle: two springs with dampers, a bar between them, two wheels on the road.

Roll and pitch centres are at road level, without anti-dive: the point at road level below
the C.G. stays with the body, lateral and vertical forces act there, forces ahead at the
hubs, and the shafts' torque comes back on the body. The tyres' speeds are those of the same
points, so that the forces' power is exactly what the body loses.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.compiled import compiled
from dsz_daemon.sim.car import Car
from dsz_daemon.sim.pose import Pose, cross, in_body
from dsz_daemon.sim.road import Vector
from dsz_daemon.sim.tyres import Tyre, tyre_force, tyres, wheel

# Spin in rad/s, longitudinal and lateral slip, how far the brake is wound up (-1 to 1).
WheelState = tuple[float, float, float, float]


class Axle(NamedTuple):
    """The constants of one axle."""

    tyre: Tyre
    ahead_m: float
    half_track_m: float
    cg_height_m: float
    spring_n_per_m: float
    damper_ns_per_m: float
    bar_n_per_m: float


class AxleLoad(NamedTuple):
    """What one axle does to the body, in body axes; rates of its wheels, and the speed of their hubs ahead."""

    force_n: Vector
    moment_nm: Vector
    left: WheelState
    right: WheelState
    left_mps: float
    right_mps: float


def axles(car: Car) -> tuple[Axle, Axle]:
    """Return the front and the rear axle of a car."""
    front, rear = tyres(car)
    return (
        Axle(
            front,
            car.cg_to_front_axle_m,
            car.front_track_m / 2.0,
            car.cg_height_m,
            car.front_spring_n_per_m,
            car.front_damper_ns_per_m,
            car.front_bar_nm_per_rad / car.front_track_m**2,
        ),
        Axle(
            rear,
            -car.cg_to_rear_axle_m,
            car.rear_track_m / 2.0,
            car.cg_height_m,
            car.rear_spring_n_per_m,
            car.rear_damper_ns_per_m,
            car.rear_bar_nm_per_rad / car.rear_track_m**2,
        ),
    )


@compiled
def loads_n(axle: Axle, pose: Pose, rough_m: tuple[float, float, float, float]) -> tuple[float, float]:
    """Return the left and the right wheel's load: the springs' and dampers' force.

    `rough_m`: how far the road lifts the left and the right wheel, and how much more per metre ahead.
    """
    left_m, right_m, left_slope, right_slope = rough_m
    under_m, under_mps = 0.5 * (left_m + right_m), 0.5 * (left_slope + right_slope) * pose.along_mps
    lift_m = pose.lift_m - axle.ahead_m * pose.dive - under_m
    lift_mps = pose.lift_mps - axle.ahead_m * pose.dive_per_s - under_mps
    lean = pose.lean - 0.5 * (left_m - right_m) / axle.half_track_m
    lean_per_s = pose.lean_per_s - 0.5 * (left_slope - right_slope) * pose.along_mps / axle.half_track_m
    both_n = axle.tyre.static_load_n - axle.spring_n_per_m * lift_m - axle.damper_ns_per_m * lift_mps
    stiffness = axle.spring_n_per_m + 2.0 * axle.bar_n_per_m
    transfer_n = (stiffness * lean + axle.damper_ns_per_m * lean_per_s) * axle.half_track_m
    return both_n - transfer_n, both_n + transfer_n


@compiled
def side_force_n(
    axle: Axle, loads: tuple[float, float], left: WheelState, right: WheelState, friction_limit: float
) -> float:
    """Return the axle's lateral force as the slips stand, in the wheels' axes."""
    return (
        tyre_force(axle.tyre, left[1], left[2], loads[0], friction_limit)[1]
        + tyre_force(axle.tyre, right[1], right[2], loads[1], friction_limit)[1]
    )


@compiled
def axle_load(
    axle: Axle,
    pose: Pose,
    loads: tuple[float, float],
    left: WheelState,
    right: WheelState,
    steer_rad: float,
    drive_nm: float,
    brake_nm: float,
    friction_limit: float,
) -> AxleLoad:
    """Return the two wheels' resultant; both steer alike and share the torques (per wheel)."""
    tyre, x, y = axle.tyre, axle.ahead_m, axle.half_track_m
    ground_m, hub_m = -axle.cg_height_m, tyre.radius_m - axle.cg_height_m
    p, q, r = pose.turn_radps
    a0, a1, a2 = pose.axes.ahead
    b1, b2 = pose.axes.aside[1], pose.axes.aside[2]
    # At the middle of the axle: the hubs' speed ahead, the contact points' speed aside; each
    # with what it gains per metre to the left.
    along = pose.along_mps + q * hub_m * a0 + (r * x - p * hub_m) * a1 - q * x * a2
    across = pose.across_mps + (r * x - p * ground_m) * b1 - q * x * b2
    along_per_m, across_per_m = p * a2 - r * a0, p * b2
    c, s = math.cos(steer_rad), math.sin(steer_rad)
    vx, vy = along + y * along_per_m, across + y * across_per_m
    fx, fy, left_rates, left_nm = wheel(
        tyre, vx * c + vy * s, vy * c - vx * s, left, loads[0], drive_nm, brake_nm, friction_limit
    )
    left_ahead_n, left_aside_n = fx * c - fy * s, fx * s + fy * c
    vx, vy = along - y * along_per_m, across - y * across_per_m
    fx, fy, right_rates, right_nm = wheel(
        tyre, vx * c + vy * s, vy * c - vx * s, right, loads[1], drive_nm, brake_nm, friction_limit
    )
    right_ahead_n, right_aside_n = fx * c - fy * s, fx * s + fy * c
    ahead, aside, up = left_ahead_n + right_ahead_n, left_aside_n + right_aside_n, loads[0] + loads[1]
    by_ahead = cross((x * ahead, y * (left_ahead_n - right_ahead_n), hub_m * ahead), pose.axes.ahead)
    by_aside = cross((x * aside, y * (left_aside_n - right_aside_n), ground_m * aside), pose.axes.aside)
    by_up = cross((x * up, y * (loads[0] - loads[1]), ground_m * up), pose.axes.normal)
    return AxleLoad(
        in_body(pose.axes, (ahead, aside, up)),
        (
            by_ahead[0] + by_aside[0] + by_up[0],
            by_ahead[1] + by_aside[1] + by_up[1] - left_nm - right_nm,
            by_ahead[2] + by_aside[2] + by_up[2],
        ),
        left_rates,
        right_rates,
        (along + y * along_per_m) * c + (across + y * across_per_m) * s,
        (along - y * along_per_m) * c + (across - y * across_per_m) * s,
    )
