"""What a load does that its mass and the shifted C.G. do not tell: it turns with the car, too."""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.comparison import Rows, sensitivities
from dsz_daemon.diagnose.descent import Place
from dsz_daemon.diagnose.effects import INDEX
from dsz_daemon.diagnose.evidence import Sums, inverse_of_told
from dsz_daemon.diagnose.prediction import Drive, Floats

LOAD = "mass_loading"
_ADDED, _SHIFT = INDEX[f"{LOAD}.added_mass_kg"], INDEX[f"{LOAD}.cg_shift_m"]
_INERTIA = INDEX["yaw_inertia_kgm2"]
# Where people and luggage are at least, from the C.G.: the simulation leaves the yaw inertia as it is configured. What
# moves the C.G. further than that would stands further out, but between the axles.
_FROM_THE_CG_M = 0.8


def spread_by_inertia(drive: Drive, rows: Rows, here: Place, slopes: Floats, found: Sums, weight: Floats) -> Floats:
    """How far a fit's parameters (p,) go with a yaw inertia that is by as much larger as the load's may be.

    m M / (m + M) d^2 about the common C.G. (parallel axes). `slopes`: sensitivities (k, 13, p) at the place; `weight`:
    of the box's prior (p,).
    """
    mass_kg, added_kg = drive.car.mass_kg, abs(float(here.x[_ADDED]))
    moved_kgm = abs(float(here.x[_SHIFT])) * (mass_kg + added_kg)
    out_m = min(max(moved_kgm / max(added_kg, 1.0), _FROM_THE_CG_M), 0.5 * drive.car.wheelbase_m)
    share = mass_kg * added_kg / (mass_kg + added_kg) * out_m**2 / drive.car.yaw_inertia_kgm2
    turns = sensitivities(drive, rows, here.x, here.road, here.base, (_INERTIA,), here.felt)[:, :, 0]
    scatter = here.scatter[rows.block]
    pull = np.einsum("kcp,kc->p", slopes, turns / scatter**2)
    bread, _ = inverse_of_told(found.squares.sum(axis=(0, 1)), np.maximum(weight, 1e-12))
    return np.asarray(share * np.abs(bread @ pull))
