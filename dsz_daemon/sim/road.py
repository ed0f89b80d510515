"""The road under the car: its tilt, its bends and its roughness along the way.

A road is a table over the distance driven, in the direction the car heads. Between two rows
everything runs as a cubic with the rows' values and slopes, so that angles and their changes
per metre fit together exactly. Before the first row and after the last it goes on level with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.compiled import compiled

Vector = tuple[float, float, float]
Profile = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # of the distance in m


class RoadPoint(NamedTuple):
    """The road plane at one distance.

    `bank_rad` > 0 has its left side high, `grade_up_rad` > 0 goes uphill; the `_per_m` are
    their changes per metre driven.
    """

    bank_rad: float = 0.0
    grade_up_rad: float = 0.0
    bank_per_m: float = 0.0
    grade_up_per_m: float = 0.0


class Road(NamedTuple):
    """A table of n rows, `step_m` apart, beginning at distance 0.

    `tilt` is n x 4, a `RoadPoint` a row; `bend_per_m` (n) the curvature of its middle, left positive;
    `rough` is n x 4: height of the left and of the right track over the plane (m), and their slopes.
    """

    step_m: float
    tilt: NDArray[np.float64]
    bend_per_m: NDArray[np.float64]
    rough: NDArray[np.float64]


def constant_road(bank_rad: float = 0.0, grade_up_rad: float = 0.0, bend_per_m: float = 0.0) -> Road:
    """Return a plane that keeps its tilt relative to the car's heading."""
    tilt = np.array([[bank_rad, grade_up_rad, 0.0, 0.0]] * 2)
    return Road(1.0, tilt, np.full(2, bend_per_m), np.zeros((2, 4)))


FLAT = constant_road()


def tabled_road(
    length_m: float,
    bank_rad: Profile | None = None,
    grade_up_rad: Profile | None = None,
    bend_per_m: Profile | None = None,
    rough_m: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
    step_m: float = 0.5,
) -> Road:
    """Return the table of a road whose profiles are functions of the distance; none: level, straight.

    Slopes are the profiles' own central differences (over a hundredth of the step), so that a smooth profile stays
    as smooth. `rough_m`: heights of left and right track at the table's rows, whose slopes are differences of rows.
    """
    rows = math.ceil(length_m / step_m) + 1
    at_m: NDArray[np.float64] = np.arange(rows, dtype=np.float64) * step_m
    near_m = 0.01 * step_m

    def values(profile: Profile | None) -> NDArray[np.float64]:
        return np.zeros(rows) if profile is None else profile(at_m)

    def slopes(profile: Profile | None) -> NDArray[np.float64]:
        if profile is None:
            return np.zeros(rows)
        return (profile(at_m + near_m) - profile(at_m - near_m)) / (2.0 * near_m)

    tilt = np.column_stack([values(bank_rad), values(grade_up_rad), slopes(bank_rad), slopes(grade_up_rad)])
    rough = np.zeros((rows, 4))
    if rough_m is not None:
        for i in (0, 1):
            rough[:, i], rough[:, 2 + i] = rough_m[i], np.gradient(rough_m[i], step_m)
    return Road(step_m, tilt, values(bend_per_m), rough)


@compiled
def _between(first: float, last: float, first_slope: float, last_slope: float, x: float, step: float) -> float:
    """The cubic through two rows, at the share x of the way."""
    a, b = first_slope * step, last_slope * step
    rise = last - first
    return first + x * (a + x * (3.0 * rise - 2.0 * a - b + x * (a + b - 2.0 * rise)))


@compiled
def _slope_between(first: float, last: float, first_slope: float, last_slope: float, x: float, step: float) -> float:
    """Its slope there."""
    a, b = first_slope * step, last_slope * step
    rise = last - first
    return (a + x * (2.0 * (3.0 * rise - 2.0 * a - b) + 3.0 * x * (a + b - 2.0 * rise))) / step


@compiled
def _row(step_m: float, rows: int, distance_m: float) -> tuple[int, float]:
    """The table's row before the distance, and the share of the way to the next; the last one: -1."""
    # Turned round, so that a car that has flown apart (not a number) meets no row that isn't there.
    if not distance_m > 0.0:
        return -1, 0.0
    place = distance_m / step_m
    if place >= rows - 1:
        return -1, 1.0
    row = int(place)
    return row, place - row


@compiled
def road_point(road: Road, distance_m: float) -> RoadPoint:
    """Return the plane at this distance."""
    tilt = road.tilt
    row, x = _row(road.step_m, len(tilt), distance_m)
    if row < 0:
        end = 0 if x == 0.0 else len(tilt) - 1
        return RoadPoint(tilt[end, 0], tilt[end, 1], 0.0, 0.0)
    step = road.step_m
    b0, g0, bs0, gs0 = tilt[row, 0], tilt[row, 1], tilt[row, 2], tilt[row, 3]
    b1, g1, bs1, gs1 = tilt[row + 1, 0], tilt[row + 1, 1], tilt[row + 1, 2], tilt[row + 1, 3]
    return RoadPoint(
        _between(b0, b1, bs0, bs1, x, step),
        _between(g0, g1, gs0, gs1, x, step),
        _slope_between(b0, b1, bs0, bs1, x, step),
        _slope_between(g0, g1, gs0, gs1, x, step),
    )


@compiled
def road_bend_per_m(road: Road, distance_m: float) -> float:
    """Return the curvature of the road's middle, 1/m, left positive; straight between the rows."""
    bend = road.bend_per_m
    row, x = _row(road.step_m, len(bend), distance_m)
    if row < 0:
        return float(bend[0] if x == 0.0 else bend[len(bend) - 1])
    return float(bend[row] + x * (bend[row + 1] - bend[row]))


@compiled
def road_rough_m(road: Road, distance_m: float) -> tuple[float, float, float, float]:
    """Return the height of the left and the right track over the plane, m, and their slopes."""
    rough = road.rough
    row, x = _row(road.step_m, len(rough), distance_m)
    if row < 0:
        return 0.0, 0.0, 0.0, 0.0
    step = road.step_m
    l0, r0, ls0, rs0 = rough[row, 0], rough[row, 1], rough[row, 2], rough[row, 3]
    l1, r1, ls1, rs1 = rough[row + 1, 0], rough[row + 1, 1], rough[row + 1, 2], rough[row + 1, 3]
    return (
        _between(l0, l1, ls0, ls1, x, step),
        _between(r0, r1, rs0, rs1, x, step),
        _slope_between(l0, l1, ls0, ls1, x, step),
        _slope_between(r0, r1, rs0, rs1, x, step),
    )


@compiled
def upwards(point: RoadPoint) -> Vector:
    """Return the vertical as seen in road axes (x along the heading, z normal to the road)."""
    cos_grade = math.cos(point.grade_up_rad)
    return (
        math.sin(point.grade_up_rad),
        math.sin(point.bank_rad) * cos_grade,
        math.cos(point.bank_rad) * cos_grade,
    )


@compiled
def tilting_rate_radps(point: RoadPoint, speed_mps: float) -> Vector:
    """Return the rate at which the road axes turn because the tilt changes along the way.

    In road axes. Yaw about the vertical comes on top of it and is not part of this.
    """
    bank_rate_radps = point.bank_per_m * speed_mps
    # The pitch axis points left: uphill turns against it.
    pitch_rate_radps = -point.grade_up_per_m * speed_mps
    return (
        bank_rate_radps,
        pitch_rate_radps * math.cos(point.bank_rad),
        -pitch_rate_radps * math.sin(point.bank_rad),
    )
