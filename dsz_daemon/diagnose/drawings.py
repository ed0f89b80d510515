"""How a car's front wheels roll: by cosine and sine of their angle, by 1 and the angle, or as if never turned.

And both by the same angle, or each by that of a wheel that rolls about where the car turns (Ackermann). Which it is, is
told before anything else is: a number in between would take from a ratio, a compliance or a load what these wheels tell
of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dsz_daemon.diagnose.effects import INDEX

Floats = np.ndarray[Any, np.dtype[np.float64]]

_TURNED, _APART = (INDEX["small_wheels"], INDEX["unturned_wheels"]), INDEX["wheels_apart"]
WHEELS = (*_TURNED, _APART)
_DRAWINGS, _ALIKE_OR_NOT = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), (0.0, 1.0)
# Of wheels turned by less all are the same to a thousandth or two; and two of an axle to as much of what they roll.
_FROM_RAD, _APART_FROM_RAD = 0.08, 0.15
# What a car has besides, and what is left out of it, moves the first two numbers by less.
_NEAR = 0.25
_UNTOLD = 0.5


def untold(x: Floats, steer_rad: Floats) -> Floats:
    """The parameters with front wheels of which nothing is told yet, where they are turned (n,) so far as to matter."""
    found, most_rad = x.copy(), float(np.max(np.abs(steer_rad)))
    if most_rad > _FROM_RAD:
        found[list(_TURNED)] = _UNTOLD, 0.0
    if most_rad > _APART_FROM_RAD:
        found[_APART] = _UNTOLD
    return found


def told(x: Floats) -> set[int]:
    """Of these numbers those that are one drawing's: they are none to be fitted."""
    turned = set(_TURNED) if tuple(x[list(_TURNED)].tolist()) in _DRAWINGS else set[int]()
    return turned | ({_APART} if x[_APART] in _ALIKE_OR_NOT else set())


def as_drawn(x: Floats) -> Floats | None:
    """The parameters with the front wheels drawn the way that they are near to; None where they are near to none."""
    found = x.copy()
    # It is little, and whatever is left out moves it by much: what it is nearer to.
    found[_APART] = min(_ALIKE_OR_NOT, key=lambda one: abs(float(x[_APART]) - one))
    small, unturned = x[list(_TURNED)].tolist()
    for drawing in _DRAWINGS:
        # An angle of 0 is no smaller for small ones.
        if abs(unturned - drawing[1]) < _NEAR and (drawing[1] == 1.0 or abs(small - drawing[0]) < _NEAR):
            found[list(_TURNED)] = drawing
    return None if told(x) == told(found) else found
