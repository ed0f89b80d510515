"""What a row of the vocabulary is: words, an equation, and parameters with what of them is plausible."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

Floats = np.ndarray[Any, np.dtype[np.float64]]

CAR, SENSORS, WHEELS = "car", "sensors", "wheels"


class Excitation(NamedTuple):
    """What a drive has to have for an effect to show: a quantity of the motion, and its unit."""

    words: str
    unit: str


SPEED, DURATION = Excitation("speed", "m/s"), Excitation("driving", "s")
YAW_RATE, YAW_ACCELERATION = Excitation("yaw rate", "rad/s"), Excitation("yaw acceleration", "rad/s2")
LATERAL, LONGITUDINAL = Excitation("lateral acceleration", "m/s2"), Excitation("longitudinal acceleration", "m/s2")
STEERING_RATE = Excitation("road wheel rate", "rad/s")


class Parameter(NamedTuple):
    """One number of an effect, SI; `low` and `high` are what is plausible."""

    name: str
    unit: str
    step: float
    low: float
    high: float
    least: float


def even(names: str, unit: str, step: float, most: float, least: float = 0.0) -> tuple[Parameter, ...]:
    """One parameter for each of the names, plausible up to `most` either way."""
    return tuple(Parameter(name, unit, step, -most, most, least) for name in names.split())


class Motion(NamedTuple):
    """What the simulated car does, all (n,), for effects of one's own; `lateral_mps2` is v_y' + r v."""

    time_s: Floats
    speed_mps: Floats
    along_mps2: Floats
    sideslip_mps: Floats
    yaw_rate_radps: Floats
    lateral_mps2: Floats
    road_wheel_angle_rad: Floats


# What is added to the channels (by their names) that are compared, of the motion and the parameters' values by name.
Shows = Callable[[Motion, Mapping[str, float]], Mapping[str, Floats]]


class Effect(NamedTuple):
    """One row: `words` is a format of its parameters' values by name, `touches` what has to be computed anew.

    `source` is where the equation is from; `needs`, what has to move for it to show, is what a drive is told to lack;
    `like` are the names of others that show nearly the same, and are always held against it.

    The built-in ones are in the simulation; one of a user's own `shows` what it adds to the channels. What has no name
    may also be a course (n,) by which the front wheels turn further, times its only parameter: `steers`; or a side
    force at the C.G., N, and a yaw moment, N m (n, 2): `pushes`.
    """

    name: str
    words: str
    equation: str
    touches: str
    parameters: tuple[Parameter, ...]
    shows: Shows | None = None
    steers: Floats | None = None
    pushes: Floats | None = None
    source: str = ""
    needs: tuple[Excitation, ...] = ()
    like: tuple[str, ...] = ()
