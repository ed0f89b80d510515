"""A load turns with the car: from where it stands by what it weighs and moves the C.G., about the common one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from dsz_daemon.core.parameters import Car

Floats = npt.NDArray[np.float64]

LOAD = "mass_loading"
# Where people and luggage are at least, from the C.G.: some stand on the other side of it. What moves the C.G. further
# than that would stands further out, but between the axles.
_FROM_THE_CG_M = 0.8


def inertia_of_a_load_kgm2(car: Car, added_kg: float, shift_m: float) -> float:
    """Yaw inertia of a load, SI, about the common C.G.: m M/(m + M) d^2 (parallel axes), d = |shift| (m + M)/m."""
    whole_kg = car.mass_kg + added_kg
    if added_kg == 0.0 or whole_kg <= 0.0:
        # Nothing is on board, or more is taken off than there is: a trial fit of a light car goes there.
        return 0.0
    out_m = min(max(abs(shift_m * whole_kg / added_kg), _FROM_THE_CG_M), 0.5 * car.wheelbase_m)
    return car.mass_kg * added_kg / whole_kg * out_m**2


def between_ends(x: Floats, covariance: Floats, ends: Mapping[int, tuple[float, float]]) -> tuple[Floats, Floats]:
    """Values and spreads (p,) of parameters of which some, by place, are surely between two ends.

    Slopes and their covariance (p, p) know of no ends, and of what fits alike a fit within them may stop at either.
    What lies evenly between two has their middle for a mean, their distance squared over twelve for a variance; what
    goes with it follows (one step of a Kalman filter each).
    """
    values, known = np.array(x), np.array(covariance)
    for place, (low, high) in ends.items():
        gain = known[place] / (known[place, place] + (high - low) ** 2 / 12.0)
        values -= gain * (values[place] - 0.5 * (low + high))
        known -= np.outer(gain, known[place])
    return values, np.sqrt(np.maximum(np.diag(known), 0.0))
