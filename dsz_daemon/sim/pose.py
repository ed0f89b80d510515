"""How the body stands and moves over the road: small vectors and one frame change.

Road axes have the body's heading and the road's normal; roll and pitch here are the body's
against the road, turned in the order pitch, roll.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.compiled import compiled
from dsz_daemon.sim.road import RoadPoint, Vector, tilting_rate_radps, upwards


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


class Axes(NamedTuple):
    """The road's axes as the body sees them; unit vectors."""

    ahead: Vector
    aside: Vector
    normal: Vector


@compiled
def in_body(axes: Axes, road: Vector) -> Vector:
    """Turn a vector from road into body axes."""
    x, y, z = road
    a, b, c = axes
    return (
        x * a[0] + y * b[0] + z * c[0],
        x * a[1] + y * b[1] + z * c[1],
        x * a[2] + y * b[2] + z * c[2],
    )


class Pose(NamedTuple):
    """The body over the road at one instant.

    `lift` is that of the point at road level below the C.G., against its place at rest;
    `lean` lifts the left by so much per metre, `dive` lowers the front.
    """

    axes: Axes
    vertical: Vector  # in body axes
    along_mps: float  # velocity of the C.G. in road axes
    across_mps: float
    rising_mps: float
    turn_radps: Vector  # in body axes
    angle_rates_radps: Vector  # of the body's roll and pitch against the road, and of yaw
    lift_m: float
    lift_mps: float
    lean: float
    lean_per_s: float
    dive: float
    dive_per_s: float


@compiled
def pose(
    velocity_mps: Vector,
    turn_radps: Vector,
    roll_rad: float,
    pitch_rad: float,
    height_m: float,
    rest_height_m: float,
    point: RoadPoint,
) -> Pose:
    """Return the pose of a body whose velocity and turning are given in its own axes."""
    cos_roll, sin_roll = math.cos(roll_rad), math.sin(roll_rad)
    cos_pitch, sin_pitch = math.cos(pitch_rad), math.sin(pitch_rad)
    axes = Axes(
        (cos_pitch, sin_pitch * sin_roll, sin_pitch * cos_roll),
        (0.0, cos_roll, -sin_roll),
        (-sin_pitch, cos_pitch * sin_roll, cos_pitch * cos_roll),
    )
    along_mps = dot(velocity_mps, axes.ahead)
    rising_mps = dot(velocity_mps, axes.normal)
    vertical = in_body(axes, upwards(point))
    tilting = in_body(axes, tilting_rate_radps(point, along_mps))
    # turning = roll rate (about body x) + pitch rate (about road y) + the road's tilting
    # + yaw rate (about the vertical): three equations for the three rates.
    p, q, r = turn_radps[0] - tilting[0], turn_radps[1] - tilting[1], turn_radps[2] - tilting[2]
    yaw_rate = (q * sin_roll + r * cos_roll) / (vertical[1] * sin_roll + vertical[2] * cos_roll)
    pitch_rate = q * cos_roll - r * sin_roll - yaw_rate * (vertical[1] * cos_roll - vertical[2] * sin_roll)
    roll_rate = p - yaw_rate * vertical[0]
    return Pose(
        axes,
        vertical,
        along_mps,
        dot(velocity_mps, axes.aside),
        rising_mps,
        turn_radps,
        (roll_rate, pitch_rate, yaw_rate),
        height_m - rest_height_m * axes.normal[2],
        rising_mps + rest_height_m * (axes.normal[1] * roll_rate + cos_roll * sin_pitch * pitch_rate),
        axes.normal[1],
        cos_pitch * cos_roll * roll_rate - sin_pitch * sin_roll * pitch_rate,
        sin_pitch,
        cos_pitch * pitch_rate,
    )
