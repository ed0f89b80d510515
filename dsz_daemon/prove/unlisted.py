"""Physics that the vocabulary has no name for, put between the true motion, the sensors and the steering wheel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.sim.drive import Columns

Array = NDArray[np.float64]


_STEERING = "steering_wheel_angle_rad"


class Unlisted(NamedTuple):
    """What it is in words, the column that has it, what it does to it, and how large it is at size 1.

    `shown(columns, size, exponent)` (n,) is added to the column. `channel` shows it: a steering that is recorded
    otherwise than it steers, in the yaw rate.
    """

    words: str
    column: str
    shown: Callable[[Mapping[str, Array], float, float], Array]
    size: float
    exponents: tuple[float, float]

    @property
    def channel(self) -> str:
        """The channel that shows it."""
        return "gyro_z" if self.column == _STEERING else self.column.rpartition("_")[0]


def _signed(values: Array, exponent: float) -> Array:
    return np.asarray(np.sign(values) * np.abs(values) ** exponent, dtype=np.float64)


def _across(columns: Mapping[str, Array]) -> Array:
    return columns["gyro_z_radps"] * columns["speed_mps"]


def _speed(columns: Mapping[str, Array]) -> Array:
    """Over 20 m/s; a car that stands may roll back by a hair."""
    return np.maximum(columns["speed_mps"], 0.0) / 20.0


# None that is one of the vocabulary: an axle that steers out of a bend does what a tyre near its limit does.
# Exponents are drawn between two: a quadratic law is as good as one with 1.8.
UNLISTED = {
    "vibration": Unlisted(
        "vibration that a sensor rectifies: it grows with the speed",
        "accel_x_mps2",
        lambda c, size, n: size * _speed(c) ** n,
        0.2,
        (1.7, 2.8),
    ),
    "shaking": Unlisted(
        "vibration that a sensor rectifies, upwards",
        "accel_z_mps2",
        lambda c, size, n: size * _speed(c) ** n,
        0.3,
        (1.7, 2.8),
    ),
    "trailer": Unlisted(
        "a trailer that pushes the car further round in hard bends",
        "gyro_z_radps",
        lambda c, size, n: size * _signed(_across(c) / 3.0, n),
        0.012,
        (2.5, 3.5),
    ),
    "magnet": Unlisted(
        "a wheel's sensor whose field grows with the speed",
        "wheel_speed_rl_mps",
        lambda c, size, n: size * _speed(c) ** n,
        0.3,
        (1.8, 2.2),
    ),
    "squat": Unlisted(
        "an accelerometer that is pulled along with what turns it, by the square",
        "accel_y_mps2",
        lambda c, size, n: size * np.abs(_across(c) / 3.0) ** n,
        0.25,
        (1.8, 2.2),
    ),
    "air": Unlisted(
        "air that pushes the nose aside as the car goes faster, which its driver holds against",
        _STEERING,
        lambda c, size, n: size * _speed(c) ** n,
        0.08,
        (1.7, 2.3),
    ),
    "kinematics": Unlisted(
        "an axle that steers further round as the body leans, little at first",
        _STEERING,
        lambda c, size, n: -size * _signed(_across(c) / 3.0, n),
        0.15,
        (1.8, 2.4),
    ),
}


def with_unlisted(columns: Columns, name: str, size: float, exponent: float) -> Columns:
    """The columns with one of these in them."""
    row = UNLISTED[name]
    return columns | {row.column: columns[row.column] + row.shown(columns, size * row.size, exponent)}
