"""How a car's front wheels roll: by cosine and sine of their angle, by 1 and the angle, or as if never turned.

And both by the same angle, or each by that of a wheel that rolls about where the car turns (Ackermann). Which it is, is
told before anything else is: a number in between would take from a ratio, a compliance or a load what these wheels tell
of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX

Floats = np.ndarray[Any, np.dtype[np.float64]]

_TURNED, _APART = (INDEX["small_wheels"], INDEX["unturned_wheels"]), INDEX["wheels_apart"]
WHEELS = (*_TURNED, _APART)
_DRAWINGS, _ALIKE_OR_NOT = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), (0.0, 1.0)
# Of wheels turned by less all are the same to a thousandth or two; and two of an axle to as much of what they roll.
_FROM_RAD, _APART_FROM_RAD = 0.08, 0.15
# What a car has besides, and what is left out of it, moves the first two numbers by less.
_NEAR, _SURE_OF_TWO = 0.25, 0.5
# Of how a car is drawn nothing is told at first.
UNTOLD = 0.5


def untold(x: Floats, steer_rad: Floats) -> Floats:
    """The parameters with front wheels of which nothing is told yet, where they are turned (n,) so far as to matter."""
    found, most_rad = x.copy(), float(np.max(np.abs(steer_rad)))
    if most_rad > _FROM_RAD:
        found[list(_TURNED)] = UNTOLD, 0.0
    if most_rad > _APART_FROM_RAD:
        found[_APART] = UNTOLD
    return found


def told(x: Floats) -> set[int]:
    """Of these numbers those that are one drawing's: they are none to be fitted."""
    turned = set(_TURNED) if tuple(x[list(_TURNED)].tolist()) in _DRAWINGS else set[int]()
    return turned | ({_APART} if x[_APART] in _ALIKE_OR_NOT else set())


def as_drawn(x: Floats, std: Floats, columns: Sequence[int]) -> Floats | None:
    """The parameters with the front wheels drawn the way that they surely are near to; None where that tells no more.

    `std` (p,): the spreads of the `columns`. Beside much that is still left out they may be near to none.
    """
    spread = {i: float(std[list(columns).index(i)]) for i in WHEELS if i in columns}
    found = x.copy()
    # Two apart are little, and whatever is left out moves that number by much: what it is nearer to.
    if spread.get(_APART, math.inf) < _SURE_OF_TWO:
        found[_APART] = min(_ALIKE_OR_NOT, key=lambda one: abs(float(x[_APART]) - one))
    small, unturned = x[list(_TURNED)].tolist()
    for drawing in _DRAWINGS:
        # An angle of 0 is no smaller for small ones.
        is_near = abs(unturned - drawing[1]) < _NEAR and (drawing[1] == 1.0 or abs(small - drawing[0]) < _NEAR)
        told_by = _TURNED[1:] if drawing[1] == 1.0 else _TURNED
        if is_near and all(spread.get(i, math.inf) < _NEAR for i in told_by):
            found[list(_TURNED)] = drawing
            # Two that are not turned are turned alike.
            found[_APART] *= 1.0 - drawing[1]
    return None if told(x) == told(found) else found
