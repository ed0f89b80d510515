"""Sines, cosines and arctangents of the angles that a car has: small ones, of which a short series is exact.

A drive's simulation takes some twenty of them a row. Below a tenth of a radian the series that are cut off here are
off by less than a rounding of the last digit or two; beyond, the library's own are called.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dsz_daemon.compiled import compiled

Floats = np.ndarray[Any, np.dtype[np.float64]]

SMALL_RAD = 0.1


@compiled
def _sin_of_small(angle_rad: float) -> float:
    """The sine: x - x^3/3! + x^5/5! - x^7/7! + x^9/9!."""
    y = angle_rad * angle_rad
    return angle_rad * (1.0 - y * (1.0 / 6.0 - y * (1.0 / 120.0 - y * (1.0 / 5040.0 - y * (1.0 / 362880.0)))))


@compiled
def _cos_of_small(angle_rad: float) -> float:
    """The cosine: 1 - x^2/2! + x^4/4! - x^6/6! + x^8/8!."""
    y = angle_rad * angle_rad
    return 1.0 - y * (0.5 - y * (1.0 / 24.0 - y * (1.0 / 720.0 - y * (1.0 / 40320.0))))


@compiled
def sin_of(angle_rad: float) -> float:
    """The sine of an angle."""
    return math.sin(angle_rad) if abs(angle_rad) > SMALL_RAD else _sin_of_small(angle_rad)


@compiled
def cos_of(angle_rad: float) -> float:
    """The cosine of an angle."""
    return math.cos(angle_rad) if abs(angle_rad) > SMALL_RAD else _cos_of_small(angle_rad)


@compiled
def cos_sin_of(angles_rad: Floats) -> tuple[Floats, Floats]:
    """Cosines and sines (n,) of angles (n,). Where all are small nothing is asked of each: several are done at once."""
    cos, sin, most = np.empty(len(angles_rad)), np.empty(len(angles_rad)), 0.0
    for i in range(len(angles_rad)):
        most = max(most, abs(angles_rad[i]))
    if most > SMALL_RAD:
        for i in range(len(angles_rad)):
            cos[i], sin[i] = cos_of(angles_rad[i]), sin_of(angles_rad[i])
    else:
        for i in range(len(angles_rad)):
            cos[i] = _cos_of_small(angles_rad[i])
        for i in range(len(angles_rad)):
            sin[i] = _sin_of_small(angles_rad[i])
    return cos, sin


@compiled
def drawn(angle_rad: float, small: float, unturned: float) -> tuple[float, float]:
    """Cosine and sine, or, as far as `small`, what they are of small angles: 1, and the angle.

    Of a wheel that is drawn as if it were turned by less: by the share `unturned`.
    """
    angle_rad *= 1.0 - unturned
    return _drawn_small(cos_of(angle_rad), sin_of(angle_rad), angle_rad, small)


@compiled
def all_drawn(angles_rad: Floats, small: float, unturned: float) -> tuple[Floats, Floats]:
    """`drawn` of each of the angles (n,)."""
    turned = angles_rad * (1.0 - unturned)
    cos, sin = cos_sin_of(turned)
    for i in range(len(turned)):
        cos[i], sin[i] = _drawn_small(cos[i], sin[i], turned[i], small)
    return cos, sin


@compiled
def _drawn_small(cos: float, sin: float, angle_rad: float, small: float) -> tuple[float, float]:
    return cos + small * (1.0 - cos), sin + small * (angle_rad - sin)


@compiled
def at_a_side(cos: float, sin: float, nearer: float) -> tuple[float, float]:
    """Cosine and sine of a wheel beside the middle that rolls about the same point: cot = cot of the middle - `nearer`.

    Ackermann's: how far it is to the left, over the wheelbase.
    """
    if nearer == 0.0:
        return cos, sin
    along = cos - nearer * sin
    by = math.sqrt((cos * cos + sin * sin) / (along * along + sin * sin))
    return along * by, sin * by


@compiled
def all_at_a_side(cos: Floats, sin: Floats, nearer: float) -> tuple[Floats, Floats]:
    """`at_a_side` of each cosine and sine (n,)."""
    if nearer == 0.0:
        return cos, sin
    along, across = np.empty(len(cos)), np.empty(len(cos))
    for i in range(len(cos)):
        along[i], across[i] = at_a_side(cos[i], sin[i], nearer)
    return along, across


@compiled
def atan_of(ratio: float) -> float:
    """The arctangent: x - x^3/3 + x^5/5 - ... + x^13/13, summed in pairs, so that no term waits for all others."""
    if abs(ratio) > SMALL_RAD:
        return math.atan(ratio)
    y = ratio * ratio
    y2 = y * y
    first, second, third = 1.0 - y * (1.0 / 3.0), 0.2 - y * (1.0 / 7.0), 1.0 / 9.0 - y * (1.0 / 11.0)
    return ratio * ((first + y2 * second) + (y2 * y2) * (third + y2 * (1.0 / 13.0)))
