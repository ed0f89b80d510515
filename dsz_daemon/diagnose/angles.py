"""Sines, cosines and arctangents of the angles that a car has: small ones, of which a short series is exact.

A drive's simulation takes some twenty of them a row. Below a tenth of a radian the series that are cut off here are
off by less than a rounding of the last digit or two; beyond, the library's own are called.
"""

from __future__ import annotations

import math

from dsz_daemon.compiled import compiled

SMALL_RAD = 0.1


@compiled
def sin_of(angle_rad: float) -> float:
    """The sine: x - x^3/3! + x^5/5! - x^7/7! + x^9/9!."""
    if abs(angle_rad) > SMALL_RAD:
        return math.sin(angle_rad)
    y = angle_rad * angle_rad
    return angle_rad * (1.0 - y * (1.0 / 6.0 - y * (1.0 / 120.0 - y * (1.0 / 5040.0 - y * (1.0 / 362880.0)))))


@compiled
def cos_of(angle_rad: float) -> float:
    """The cosine: 1 - x^2/2! + x^4/4! - x^6/6! + x^8/8!."""
    if abs(angle_rad) > SMALL_RAD:
        return math.cos(angle_rad)
    y = angle_rad * angle_rad
    return 1.0 - y * (0.5 - y * (1.0 / 24.0 - y * (1.0 / 720.0 - y * (1.0 / 40320.0))))


@compiled
def drawn(angle_rad: float, small: float, unturned: float) -> tuple[float, float]:
    """Cosine and sine, or, as far as `small`, what they are of small angles: 1, and the angle.

    Of a wheel that is drawn as if it were turned by less: by the share `unturned`.
    """
    angle_rad *= 1.0 - unturned
    cos, sin = cos_of(angle_rad), sin_of(angle_rad)
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
def atan_of(ratio: float) -> float:
    """The arctangent: x - x^3/3 + x^5/5 - ... + x^13/13, summed in pairs, so that no term waits for all others."""
    if abs(ratio) > SMALL_RAD:
        return math.atan(ratio)
    y = ratio * ratio
    y2 = y * y
    first, second, third = 1.0 - y * (1.0 / 3.0), 0.2 - y * (1.0 / 7.0), 1.0 / 9.0 - y * (1.0 / 11.0)
    return ratio * ((first + y2 * second) + (y2 * y2) * (third + y2 * (1.0 / 13.0)))
