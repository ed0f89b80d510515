"""The road under the car: its tilt along the way, in the direction the car heads.

A road is a function of the distance driven. The first scenario is flat; bank and grade are
here so that gravity and the road's own turning already enter the equations of motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

Vector = tuple[float, float, float]


class RoadPoint(NamedTuple):
    """The road plane at one distance.

    `bank_rad` > 0 has its left side high, `grade_up_rad` > 0 goes uphill; the `_per_m` are
    their changes per metre driven.
    """

    bank_rad: float = 0.0
    grade_up_rad: float = 0.0
    bank_per_m: float = 0.0
    grade_up_per_m: float = 0.0


Road = Callable[[float], RoadPoint]

LEVEL = RoadPoint()
UPWARDS: Vector = (0.0, 0.0, 1.0)
STILL: Vector = (0.0, 0.0, 0.0)


def flat_road(_distance_m: float) -> RoadPoint:
    """Return level ground everywhere."""
    return LEVEL


def constant_road(bank_rad: float, grade_up_rad: float) -> Road:
    """Return a plane that keeps its tilt relative to the car's heading."""
    point = RoadPoint(bank_rad, grade_up_rad)
    return lambda _distance_m: point


def upwards(point: RoadPoint) -> Vector:
    """Return the vertical as seen in road axes (x along the heading, z normal to the road)."""
    if point is LEVEL:
        return UPWARDS
    cos_grade = math.cos(point.grade_up_rad)
    return (
        math.sin(point.grade_up_rad),
        math.sin(point.bank_rad) * cos_grade,
        math.cos(point.bank_rad) * cos_grade,
    )


def tilting_rate_radps(point: RoadPoint, speed_mps: float) -> Vector:
    """Return the rate at which the road axes turn because the tilt changes along the way.

    In road axes. Yaw about the vertical comes on top of it and is not part of this.
    """
    if point is LEVEL:
        return STILL
    bank_rate_radps = point.bank_per_m * speed_mps
    # The pitch axis points left: uphill turns against it.
    pitch_rate_radps = -point.grade_up_per_m * speed_mps
    return (
        bank_rate_radps,
        pitch_rate_radps * math.cos(point.bank_rad),
        -pitch_rate_radps * math.sin(point.bank_rad),
    )
