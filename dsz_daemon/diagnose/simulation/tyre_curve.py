"""How a tyre's side force bends to its limit: F = F_0 / (1 + x^n)^(1/n), x = F_0 over the limit.

n = 2 bends early, the larger n the longer it stays linear. A simulation asks four times a row, of one n: two powers
each would be three quarters of its time. So it reads off a cubic between nodes, which is off by less than 1e-7 of the
limit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dsz_daemon.compiled import compiled

Floats = np.ndarray[Any, np.dtype[np.float64]]

# Nodes so close that the sharpest corner is hit; where all curves are flat powers do.
_PER_LIMIT, _LAST = 128, 3
# Below, nothing is bent; far beyond the limit x^n would overflow.
_STRAIGHT, _FLAT = 1e-9, 1e6


@compiled
def bent(x: float, sharpness: float) -> float:
    """The share of a linear tyre's force F_0 that is left at x = F_0 over the limit."""
    return 1.0 / x if x > _FLAT else (1.0 + x**sharpness) ** (-1.0 / sharpness)


@compiled
def curve_of(sharpness: float) -> Floats:
    """Nodes (m, 2) of what `bent` is over x: the share, and how it changes from one node to the next."""
    curve = np.empty((_PER_LIMIT * _LAST + 1, 2))
    curve[0, 0], curve[0, 1] = 1.0, 0.0
    for i in range(1, len(curve)):
        x = i / _PER_LIMIT
        power = x**sharpness
        share = (1.0 + power) ** (-1.0 / sharpness)
        curve[i, 0], curve[i, 1] = share, -share * power / (x * (1.0 + power)) / _PER_LIMIT
    return curve


@compiled
def limited(force: float, per_limit: float, sharpness: float, curve: Floats) -> float:
    """A linear tyre's force, bent down to its limit 1 / `per_limit`, 0 where it has none; `curve` is of `sharpness`."""
    x = abs(force) * per_limit
    if x < _STRAIGHT:
        return force
    # What is no number is none afterwards, and no place in a table.
    if not x < _LAST:
        return force * bent(x, sharpness)
    place = x * _PER_LIMIT
    i = int(place)
    t = place - i
    at, by, to, then = curve[i, 0], curve[i, 1], curve[i + 1, 0], curve[i + 1, 1]
    rise = to - at
    share: float = at + t * (by + t * (3.0 * rise - 2.0 * by - then + t * (by + then - 2.0 * rise)))
    return force * share
