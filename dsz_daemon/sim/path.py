"""Where the car went: its way over the ground from speed, heading and the road's tilt. Pure.

Written out with `math` and summed up in order: numpy's vectorised sines and sums may round differently elsewhere,
and the same drive has to give the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def path(
    speed_mps: Array, lateral_mps: Array, yaw_rad: Array, bank_rad: Array, grade_up_rad: Array, step_s: float
) -> dict[str, Array]:
    """Return `east_m`, `north_m` and `height_m` of the C.G. over the ground, from 0 on; shape (rows,) each.

    All inputs of that shape, rows `step_s` apart, summed up by trapezia. `speed_mps` is along the heading in the road's
    plane and `lateral_mps` to its left; yaw 0 heads east and grows to the left.
    """
    rates = [
        _over_ground(*row)
        for row in zip(
            speed_mps.tolist(),
            lateral_mps.tolist(),
            yaw_rad.tolist(),
            bank_rad.tolist(),
            grade_up_rad.tolist(),
            strict=True,
        )
    ]
    names = ("east_m", "north_m", "height_m")
    return {name: _summed((rate[i] for rate in rates), step_s) for i, name in enumerate(names)}


def _over_ground(
    ahead_mps: float, aside_mps: float, yaw_rad: float, bank_rad: float, grade_up_rad: float
) -> tuple[float, float, float]:
    """Velocity to the east, to the north and up, of one in the road's plane."""
    sin_grade, cos_grade = math.sin(grade_up_rad), math.cos(grade_up_rad)
    sin_bank, cos_bank = math.sin(bank_rad), math.cos(bank_rad)
    # In the horizontal frame that has the heading: the road's plane is first banked, then raised in front.
    forward_mps = cos_grade * ahead_mps - sin_grade * sin_bank * aside_mps
    left_mps = cos_bank * aside_mps
    sin_yaw, cos_yaw = math.sin(yaw_rad), math.cos(yaw_rad)
    return (
        forward_mps * cos_yaw - left_mps * sin_yaw,
        forward_mps * sin_yaw + left_mps * cos_yaw,
        sin_grade * ahead_mps + sin_bank * cos_grade * aside_mps,
    )


def _summed(rates: Iterable[float], step_s: float) -> Array:
    """The integral of `rates` from the first row on."""
    steps = (0.5 * step_s * (before + after) for before, after in pairwise(rates))
    return np.array(list(accumulate(steps, initial=0.0)))
