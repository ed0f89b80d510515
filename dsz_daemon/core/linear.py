"""Exact steps of small linear systems with inputs held over the step.

Held-input solutions compose: one step of 2 dt equals two of dt, whatever dt is.
"""

from __future__ import annotations

import math


def relaxed(x: float, target: float, time_constant_s: float, dt_s: float) -> float:
    """x after dt_s of x' = (target - x) / time_constant_s.

    >>> round(relaxed(0.0, 1.0, 2.0, 2.0), 6)
    0.632121
    """
    return target + (x - target) * math.exp(-dt_s / time_constant_s)


def exponential_2x2(a: float, b: float, c: float, d: float, t: float) -> tuple[float, float, float, float]:
    """exp([[a, b], [c, d]] * t), row by row, by Cayley-Hamilton.

    With s half the trace and q^2 = s^2 - det: exp(Mt) = e^(st) (cosh(qt) I + sinh(qt)/q (M - sI)).
    """
    s = 0.5 * (a + d)
    q2 = 0.25 * (a - d) ** 2 + b * c
    z = q2 * t * t
    if abs(z) < 1e-6:
        cosh, sinhc = 1.0 + z / 2.0 + z * z / 24.0, t * (1.0 + z / 6.0 + z * z / 120.0)
    elif q2 > 0.0:
        q = math.sqrt(q2)
        cosh, sinhc = math.cosh(q * t), math.sinh(q * t) / q
    else:
        q = math.sqrt(-q2)
        cosh, sinhc = math.cos(q * t), math.sin(q * t) / q
    e = math.exp(s * t)
    return (
        e * (cosh + sinhc * (a - s)),
        e * sinhc * b,
        e * sinhc * c,
        e * (cosh + sinhc * (d - s)),
    )


def stepped_2x2(
    a: float, b: float, c: float, d: float, u: float, w: float, x: float, y: float, t: float
) -> tuple[float, float]:
    """(x, y) after t of x' = a x + b y + u, y' = c x + d y + w, with u and w held.

    The matrix must be regular: the solution moves the origin to the equilibrium.
    """
    det = a * d - b * c
    if det == 0.0:
        raise ZeroDivisionError("stepped_2x2 needs a regular matrix")
    xe = -(d * u - b * w) / det
    ye = -(a * w - c * u) / det
    m11, m12, m21, m22 = exponential_2x2(a, b, c, d, t)
    dx, dy = x - xe, y - ye
    return xe + m11 * dx + m12 * dy, ye + m21 * dx + m22 * dy
