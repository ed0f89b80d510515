"""Numbers for people: deg, deg/s, km/h on this floor only; inside everything is SI."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.signals import GYRO_CHANNELS, QUANTITIES

Samples = dict[str, NDArray[Any]]
Floats = NDArray[np.float64]

MINUS = "\N{MINUS SIGN}"
NOTHING = "\N{EN DASH}"
PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
SIGMA = "\N{GREEK SMALL LETTER SIGMA}"
INTO = "\N{SINGLE RIGHT-POINTING ANGLE QUOTATION MARK}"
ARROW = "\N{RIGHTWARDS ARROW}"

# 95 % of a normal distribution lie within two standard deviations (95.4 %, to be exact).
SPREADS_95 = 2.0


class Unit(NamedTuple):
    """A unit for people: shown value = SI value * `per_si`."""

    label: str
    per_si: float = 1.0


DEGREE = Unit("deg", 180.0 / math.pi)
DEGREE_PER_SECOND = Unit("deg/s", 180.0 / math.pi)
ACCELERATION = Unit("m/s\N{SUPERSCRIPT TWO}")
SPEED = Unit("km/h", 3.6)
METRE_PER_SECOND = Unit("m/s")
STIFFNESS = Unit("kN/rad", 1e-3)
METRE = Unit("m")
FORCE = Unit("N")
CELSIUS = Unit("\N{DEGREE SIGN}C")
BARE = Unit("")

CHANNEL_NAMES = {
    "gyro_x": "roll rate",
    "gyro_y": "pitch rate",
    "gyro_z": "yaw rate",
    "accel_x": "longitudinal acceleration",
    "accel_y": "lateral acceleration",
    "accel_z": "vertical acceleration",
}


CHANNEL_WORDS = {channel: name.removesuffix(" acceleration") for channel, name in CHANNEL_NAMES.items()}


def channel_unit(channel: str) -> Unit:
    """Unit in which an IMU channel is shown."""
    return DEGREE_PER_SECOND if channel in GYRO_CHANNELS else ACCELERATION


def channel_column(channel: str, what: str = "") -> str:
    """Name of an IMU channel's column in SI; `what` is "raw", "offset", "offset_std" or "".

    >>> channel_column("gyro_z", "offset_std"), channel_column("accel_x")
    ('gyro_z_offset_std_radps', 'accel_x_mps2')
    """
    return "_".join(part for part in (channel, what, QUANTITIES[channel].suffix) if part)


def number(value: float, decimals: int = 3, sign: bool = False) -> str:
    """Fixed decimals with a typographic minus; a dash where there is no value.

    >>> number(0.4123), number(0.5, 1, sign=True), number(-0.0001), number(-1.0) == MINUS + "1.000"
    ('0.412', '+0.5', '0.000', True)
    """
    if not math.isfinite(value):
        return NOTHING
    text = f"{abs(value):.{decimals}f}"
    if float(text) == 0.0:
        return text
    return (MINUS if value < 0 else "+" if sign else "") + text


def spread(value: float, decimals: int = 3) -> str:
    """A spread after its sign; one too small for the decimals is said to be, never 0.

    >>> spread(0.0312), spread(0.0001)
    ('± 0.031', '± <0.001')
    """
    small = math.isfinite(value) and 0.0 < value < 0.5 * 10.0**-decimals
    return f"{PLUS_MINUS} <{10.0**-decimals:.{decimals}f}" if small else f"{PLUS_MINUS} {number(value, decimals)}"


def percent(share: float) -> str:
    """A share of time; small but not zero is said so.

    >>> percent(0.42), percent(0.0), percent(0.001), percent(0.9996)
    ('42 %', '0 %', '<1 %', '>99 %')
    """
    if not math.isfinite(share):
        return NOTHING
    if 0.0 < share < 0.005:
        return "<1 %"
    return ">99 %" if 0.995 <= share < 1.0 else f"{100.0 * share:.0f} %"


def duration(seconds: float) -> str:
    """A duration as one reads it aloud.

    >>> duration(42.25), duration(125.0), duration(3723.0)
    ('42.2 s', '2 min 5 s', '1 h 2 min')
    """
    if not math.isfinite(seconds):
        return NOTHING
    if seconds < 100.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min {rest} s"


def words(name: str) -> str:
    """A name of the vocabulary as words.

    >>> words("steering_large")
    'steering large'
    """
    return name.replace("_", " ")
