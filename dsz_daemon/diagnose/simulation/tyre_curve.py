"""How a tyre's side force bends to its limit: two curves, in part each, over x, a linear tyre's force over the limit.

F = F_0 / (1 + x^n)^(1/n) is that of many tyres: n = 2 bends early, the larger n the longer it stays linear. A brush
bends at once, and yet gets to its limit, where it slides: F = F_0 (1 - x/3 + x^2/27) up to x = 3 (Pacejka, Tire and
Vehicle Dynamics, section 3.2). No n is near that: the nearest is off by 1.3 % of the limit (rms), and 10 % softer.

A simulation asks four times a row: two powers each would be three quarters of its time. So it reads off a cubic between
nodes, which is off by less than 1e-7 of the limit.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.compiled import compiled

Floats = np.ndarray[Any, np.dtype[np.float64]]

# Nodes so close that the sharpest corner is hit; where all curves are flat powers do. There a brush slides.
_PER_LIMIT, _LAST = 128, 3
_SLIDES = 3.0
# Below, nothing is bent; far beyond the limit x^n would overflow.
_STRAIGHT, _FLAT = 1e-9, 1e6


class Curve(NamedTuple):
    """The share of a linear tyre's force that is left over x, and how it changes from one node to the next (m, 2)."""

    nodes: Floats
    sharpness: float
    brush: float


@compiled
def bent(x: float, sharpness: float, brush: float) -> float:
    """The share of a linear tyre's force F_0 that is left at x = F_0 over the limit; `brush` of it is a brush's."""
    share = 1.0 / x if x > _FLAT else (1.0 + x**sharpness) ** (-1.0 / sharpness)
    slid = 1.0 / x if x > _SLIDES else 1.0 - x / 3.0 + x * x / 27.0
    return (1.0 - brush) * share + brush * slid


@compiled
def curve_of(sharpness: float, brush: float) -> Curve:
    """What `bent` is, to be read off."""
    nodes = np.empty((_PER_LIMIT * _LAST + 1, 2))
    nodes[0, 0], nodes[0, 1] = 1.0, -brush / 3.0 / _PER_LIMIT
    for i in range(1, len(nodes)):
        x = i / _PER_LIMIT
        power = x**sharpness
        share = (1.0 + power) ** (-1.0 / sharpness)
        slope = -(1.0 - brush) * share * power / (x * (1.0 + power)) + brush * (2.0 * x / 27.0 - 1.0 / 3.0)
        nodes[i, 0], nodes[i, 1] = bent(x, sharpness, brush), slope / _PER_LIMIT
    return Curve(nodes, sharpness, brush)


@compiled
def limited(force: float, per_limit: float, curve: Curve) -> float:
    """A linear tyre's force, bent down to its limit 1 / `per_limit`, 0 where it has none."""
    x = abs(force) * per_limit
    if x < _STRAIGHT:
        return force
    # What is no number is none afterwards, and no place in a table.
    if not x < _LAST:
        return force * bent(x, curve.sharpness, curve.brush)
    place = x * _PER_LIMIT
    i = int(place)
    t = place - i
    at, by, to, then = curve.nodes[i, 0], curve.nodes[i, 1], curve.nodes[i + 1, 0], curve.nodes[i + 1, 1]
    rise = to - at
    share: float = at + t * (by + t * (3.0 * rise - 2.0 * by - then + t * (by + then - 2.0 * rise)))
    return force * share
