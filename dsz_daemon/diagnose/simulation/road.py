"""The road and the air that a simulated car is on: nominal, or with what a fit says of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.surroundings import KNOTS
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.simulation.drive import Floats


class Profiles(NamedTuple):
    """What the road and the air do, on the recording's grid (n,): bank and grade (uphill) in rad, side force in N.

    `lean_mps2`: what leans the body, whatever the simulated tyres do; `lean_share` of what these do is in it. The rest
    is lateral acceleration that is in no simulation, and leans the body all the same.
    """

    bank_rad: Floats
    grade_rad: Floats
    side_n: Floats
    grip: Floats
    lean_mps2: Floats
    lean_share: float = 0.0


def flat(n: int) -> Profiles:
    """The nominal road and air."""
    nothing = np.zeros(n)
    return Profiles(nothing, nothing, nothing, nothing, nothing)


def on_road(road: Profiles, x: Floats) -> Profiles:
    """The road with the corrections that `x` puts on its profiles, and with its slippery stretch."""
    n, tilts = len(road.bank_rad), (("road_bank", road.bank_rad), ("road_grade", road.grade_rad))
    more = [correction(x, name, n) for name, _ in tilts]
    corrected = [tilt + own if len(own) == n else tilt for (_, tilt), own in zip(tilts, more, strict=True)]
    ends = x[INDEX["tyre_saturation.inverse_square"]]
    grip = road.grip + ends if ends != 0.0 else road.grip
    slippery = x[INDEX["low_friction.inverse_square"]]
    if slippery != 0.0:
        start, end = x[INDEX["low_friction.start_s"]] / DT_S, x[INDEX["low_friction.end_s"]] / DT_S
        place = np.arange(n)
        inside = np.clip(place - start + 0.5, 0.0, 1.0) * np.clip(end - place + 0.5, 0.0, 1.0)
        grip = np.maximum(grip, slippery * inside)
    return road._replace(bank_rad=corrected[0], grade_rad=corrected[1], grip=grip)


def correction(x: Floats, profile: str, n: int) -> Floats:
    """What the knots of a road's profile add to it, rad: (n,), or (1,) where that is nothing."""
    first = INDEX[f"{profile}.knot_0"]
    knots = x[first : first + KNOTS]
    return np.interp(np.arange(n), np.linspace(0, n - 1, KNOTS), knots) if knots.any() else np.zeros(1)
