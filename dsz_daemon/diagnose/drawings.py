"""How a car's front wheels are drawn: by cosine and sine of their angle, by 1 and the angle, or as if never turned.

It is one of the three, and which is told before anything else is: a number in between would take from a ratio, a
compliance or a load what the front wheels tell of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dsz_daemon.diagnose.effects import INDEX

Floats = np.ndarray[Any, np.dtype[np.float64]]

WHEELS = (INDEX["small_wheels"], INDEX["unturned_wheels"])
_DRAWINGS = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
# Of wheels turned by less all three are the same to a thousandth or two.
_FROM_RAD = 0.08
# What a car has besides, and what is left out of it, moves the two numbers by less.
_NEAR = 0.25


def untold(x: Floats, steer_rad: Floats) -> Floats:
    """The parameters with front wheels of which nothing is told yet, where they are turned (n,) so far as to matter."""
    found = x.copy()
    if float(np.max(np.abs(steer_rad))) > _FROM_RAD:
        found[list(WHEELS)] = 0.5, 0.0
    return found


def are_told(x: Floats) -> bool:
    """Whether the front wheels are drawn one way: then that is no number to be fitted."""
    return tuple(x[list(WHEELS)].tolist()) in _DRAWINGS


def as_drawn(x: Floats) -> Floats | None:
    """The parameters with the front wheels drawn the way that they are near to; None where they are near to none."""
    for drawing in _DRAWINGS:
        if np.max(np.abs(x[list(WHEELS)] - drawing)) < _NEAR:
            found = x.copy()
            found[list(WHEELS)] = drawing
            return found
    return None
