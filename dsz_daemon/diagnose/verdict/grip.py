"""How sure a friction coefficient is that was read off a curve: other curves read another one off the same forces.

Mostly the beginning of the limit is seen, and how far the end is from there is a matter of the curve. The forces that
were fitted with one sharpness are fitted again with others; what these read is the spread over shapes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from dsz_daemon.diagnose.simulation.drive import Floats

_LIMITS = np.geomspace(0.5, 2.5, 81)
# The stiffness is found together with the limit.
_SLOPES = np.linspace(0.9, 1.1, 11)
_MOST_ROWS = 500
# Of the limit, from where on a curve is bent at all.
_BENT = 0.3
# A tyre has none of these: of two whose curves are Dugoff's, hard at their limits, frictions came out 6.5 and 5.6 %
# low, where the shapes below differ by 4.3 and 3.4 %. Set with these two in view.
_NONE_OF_THESE = 0.03
# So far beyond the limit all curves are flat.
_DEMANDS = np.geomspace(0.1, 20.0, 2000)


def shape(x: Floats, sharpness: float, brush: float) -> Floats:
    """A tyre's force over its limit, of a linear tyre's over the limit x: as `tyre_curve` has it, for many at once."""
    slid = np.minimum(x, 3.0)
    return np.asarray(
        (1.0 - brush) * x / (1.0 + x**sharpness) ** (1.0 / sharpness) + brush * (slid - slid**2 / 3.0 + slid**3 / 27.0)
    )


def dugoff(x: Floats) -> Floats:
    """Linear up to half of the limit, which is never reached (Dugoff, Fancher and Segel, 1970)."""
    return np.asarray(np.where(x < 0.5, x, 1.0 - 0.25 / np.maximum(x, 0.5)))


# From curves that bend early to a clamp; a brush, which ends; and one that does not.
_SHAPES: tuple[Callable[[Floats], Floats], ...] = (
    *(partial(shape, sharpness=sharpness, brush=0.0) for sharpness in (1.7, 2.5, 4.0, 9.0)),
    partial(shape, sharpness=2.5, brush=1.0),
    dugoff,
)


def over_shapes(force_share: Floats, sharpness: float, brush: float = 0.0) -> tuple[float, float]:
    """Limits (mean and spread over shapes, in units of the one that was found) of an axle's forces (k,) over it."""
    used = np.minimum(np.abs(force_share), 0.999)
    used = np.sort(used[used > _BENT])
    if len(used) == 0:
        return 1.0, 1.0
    used = used[:: max(len(used) // _MOST_ROWS, 1)]
    # A curve rises all the way.
    linear = np.interp(used, np.maximum.accumulate(shape(_DEMANDS, sharpness, brush)), _DEMANDS)
    found = [1.0]
    for other in _SHAPES:
        x = linear * _SLOPES[:, np.newaxis, np.newaxis] / _LIMITS[:, np.newaxis]
        force = _LIMITS[:, np.newaxis] * other(x)
        worst = np.mean((force - used) ** 2, axis=2)
        found.append(float(_LIMITS[np.unravel_index(int(np.argmin(worst)), worst.shape)[1]]))
    return float(np.mean(found)), math.hypot(float(np.std(found)), _NONE_OF_THESE)
