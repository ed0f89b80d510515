"""How sure a friction coefficient is that was read off a curve: other curves read another one off the same forces.

Mostly the beginning of the limit is seen, and how far the end is from there is a matter of the curve. The forces that
were fitted with one sharpness are fitted again with others; what these read is the spread over shapes.
"""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.simulation.drive import Floats

# From a curve that bends early to a clamp, see `motion.SHARPNESS`.
_SHAPES = (1.7, 2.5, 4.0, 9.0)
_LIMITS = np.geomspace(0.5, 2.5, 81)
# The stiffness is found together with the limit.
_SLOPES = np.linspace(0.9, 1.1, 11)
_MOST_ROWS = 500
# Of the limit, from where on a curve is bent at all.
_BENT = 0.3


def over_shapes(force_share: Floats, sharpness: float) -> tuple[float, float]:
    """Limits (mean and spread over shapes, in units of the one that was found) of an axle's forces (k,) over it."""
    used = np.minimum(np.abs(force_share), 0.999)
    used = np.sort(used[used > _BENT])
    if len(used) == 0:
        return 1.0, 1.0
    used = used[:: max(len(used) // _MOST_ROWS, 1)]
    linear = used / (1.0 - used**sharpness) ** (1.0 / sharpness)
    # So far beyond the limit all curves are flat.
    linear = np.minimum(linear, 20.0)
    found = [1.0]
    for shape in _SHAPES:
        x = linear * _SLOPES[:, np.newaxis, np.newaxis] / _LIMITS[:, np.newaxis]
        force = _LIMITS[:, np.newaxis] * x / (1.0 + x**shape) ** (1.0 / shape)
        worst = np.mean((force - used) ** 2, axis=2)
        found.append(float(_LIMITS[np.unravel_index(int(np.argmin(worst)), worst.shape)[1]]))
    return float(np.mean(found)), float(np.std(found))
