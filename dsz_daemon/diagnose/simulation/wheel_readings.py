"""What wheels show of how fast they roll: a square of it more, less as tyres grow with speed, or a constant more."""

from __future__ import annotations

from typing import Any

import numpy as np

from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose.effects.vocabulary import INDEX

Floats = np.ndarray[Any, np.dtype[np.float64]]

_WHEELS = ("fl", "fr", "rl", "rr")
_SQUARES, _GROWTH = np.array([INDEX[f"wheel_square.{wheel}"] for wheel in _WHEELS]), INDEX["wheel_growth.per_v2"]
_MORE = INDEX["wheels_more.offset_mps"]
# What rolls slower stands, as far as readings go.
_ROLLS_MPS = 0.5


def locks_in_front(car: Car) -> bool:
    """Of which axle a differential may be locked: the driven one, of two the rear one."""
    return car.front_driven and not car.rear_driven


def as_they_read(rolled_mps: Floats, x: Floats) -> Floats:
    """The wheels' readings (n, 4) of what they roll, at the radii that they have at rest."""
    if x[_GROWTH] != 0.0:
        rolled_mps = rolled_mps / (1.0 + x[_GROWTH] * rolled_mps**2)
    if x[_SQUARES].any():
        rolled_mps = rolled_mps + x[_SQUARES] * rolled_mps**2
    return np.where(rolled_mps > _ROLLS_MPS, rolled_mps + x[_MORE], rolled_mps) if x[_MORE] != 0.0 else rolled_mps


def as_they_roll(read_mps: Floats, x: Floats) -> Floats:
    """What the wheels roll (n, 4) by their readings."""
    if x[_MORE] != 0.0:
        read_mps = np.where(read_mps > _ROLLS_MPS, np.maximum(read_mps - x[_MORE], 0.0), read_mps)
    if x[_SQUARES].any():
        read_mps = read_mps - x[_SQUARES] * read_mps**2
    if x[_GROWTH] == 0.0:
        return read_mps
    # Of v = reading (1 + k v^2) the solution that is the reading where nothing grows.
    root: Floats = np.sqrt(np.maximum(1.0 - 4.0 * x[_GROWTH] * read_mps**2, 0.0))
    return 2.0 * read_mps / (1.0 + root)
