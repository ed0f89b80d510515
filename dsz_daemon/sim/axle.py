"""One axle: two springs with dampers, a bar between them, two wheels on the road.

Roll and pitch centres are at road level, without anti-dive: the point at road level below
the C.G. stays with the body, lateral and vertical forces act there, forces ahead at the
hubs, and the shafts' torque comes back on the body. The tyres' speeds are those of the same
points, so that the forces' power is exactly what the body loses.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.sim.car import Car
from dsz_daemon.sim.pose import Pose, cross
from dsz_daemon.sim.road import Vector
from dsz_daemon.sim.tyres import Tyre, tyres, wheel

WheelState = tuple[float, float, float]  # spin in rad/s, longitudinal and lateral slip


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
    """What one axle does to the body, in body axes; rates of the wheels; loads in N."""

    force_n: Vector
    moment_nm: Vector
    left: WheelState
    right: WheelState
    left_load_n: float
    right_load_n: float


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


def _loads_n(axle: Axle, pose: Pose) -> tuple[float, float]:
    """Return the left and the right wheel's load: the springs' and dampers' force."""
    lift_m = pose.lift_m - axle.ahead_m * pose.dive
    lift_mps = pose.lift_mps - axle.ahead_m * pose.dive_per_s
    both_n = axle.tyre.static_load_n - axle.spring_n_per_m * lift_m - axle.damper_ns_per_m * lift_mps
    stiffness = axle.spring_n_per_m + 2.0 * axle.bar_n_per_m
    transfer_n = (stiffness * pose.lean + axle.damper_ns_per_m * pose.lean_per_s) * axle.half_track_m
    return both_n - transfer_n, both_n + transfer_n


def axle_load(
    axle: Axle,
    pose: Pose,
    left: WheelState,
    right: WheelState,
    steer_rad: float,
    drive_nm: float,
    brake_nm: float,
) -> AxleLoad:
    """Return the two wheels' resultant; both steer alike and share the torques (per wheel)."""
    tyre, x, y = axle.tyre, axle.ahead_m, axle.half_track_m
    ground_m, hub_m = -axle.cg_height_m, tyre.radius_m - axle.cg_height_m
    p, q, r = pose.turn_radps
    (a0, a1, a2), (_, b1, b2), _ = pose.axes
    # At the middle of the axle: the hubs' speed ahead, the contact points' speed aside; each
    # with what it gains per metre to the left.
    along = pose.along_mps + q * hub_m * a0 + (r * x - p * hub_m) * a1 - q * x * a2
    across = pose.across_mps + (r * x - p * ground_m) * b1 - q * x * b2
    along_per_m, across_per_m = p * a2 - r * a0, p * b2
    cos_steer, sin_steer = math.cos(steer_rad), math.sin(steer_rad)
    loads = _loads_n(axle, pose)
    ahead_n, aside_n, shafts_nm = [0.0, 0.0], [0.0, 0.0], 0.0
    rates = []
    for i, (to_left, wheel_state) in enumerate(((y, left), (-y, right))):
        vx, vy = along + to_left * along_per_m, across + to_left * across_per_m
        fx, fy, spin_rate, kappa_rate, slip_rate, shaft_nm = wheel(
            tyre,
            vx * cos_steer + vy * sin_steer,
            vy * cos_steer - vx * sin_steer,
            *wheel_state,
            loads[i],
            drive_nm,
            brake_nm,
        )
        ahead_n[i] = fx * cos_steer - fy * sin_steer
        aside_n[i] = fx * sin_steer + fy * cos_steer
        shafts_nm += shaft_nm
        rates.append((spin_rate, kappa_rate, slip_rate))
    f, s, n = sum(ahead_n), sum(aside_n), sum(loads)
    by_f = cross((x * f, y * (ahead_n[0] - ahead_n[1]), hub_m * f), pose.axes.ahead)
    by_s = cross((x * s, y * (aside_n[0] - aside_n[1]), ground_m * s), pose.axes.aside)
    by_n = cross((x * n, y * (loads[0] - loads[1]), ground_m * n), pose.axes.normal)
    return AxleLoad(
        pose.axes.in_body((f, s, n)),
        (by_f[0] + by_s[0] + by_n[0], by_f[1] + by_s[1] + by_n[1] - shafts_nm, by_f[2] + by_s[2] + by_n[2]),
        rates[0],
        rates[1],
        *loads,
    )
