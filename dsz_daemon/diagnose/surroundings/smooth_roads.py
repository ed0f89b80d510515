"""A road banks no more where the car turns: what tells a body's lean from a bank.

The roll gyro feels both as one, and the accelerometer shows g times both. But a body leans with the bend, within half a
second, and what a road does has nothing to do with that: of all leans the right one leaves the smoothest road.
(A dive is told from a climb by the wheels, which show how the car gathers speed.)
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.residuals.inputs import rolling_rows
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.road import Profiles, on_road
from dsz_daemon.diagnose.surroundings.profiles import leans_too

# What a fit's other channels seem to tell of a lean beside a bank is less than what a simulation gets wrong: how smooth
# the road is counts so many times.
SURER = 10.0
# How long a body takes to lean; rad: smoother is no road that a gyro has felt.
_REACH, _SMOOTHEST_RAD = round(0.5 / DT_S), 1e-4
_BANK, _LEAN = "road_bank", "suspension_roll"
# How high the C.G. sways above the roll axis makes no other bank of what a gyro feels, but of what forces show.
_NUMBERS = tuple(
    INDEX[f"{_LEAN}.{name}"] for name in ("roll_gradient_rad_per_mps2", "frequency_share", "damping", "swings_m")
)


class Leaning(NamedTuple):
    """Normal equations of what a bank bends, over the lean's `columns`: (p, p) and (p,)."""

    columns: list[int]
    squares: Floats
    cross: Floats


def leans_on_a_bank(effects: Collection[str]) -> bool:
    """Whether a model has both."""
    return _BANK in effects and _LEAN in effects


def is_new_on_a_bank(smaller: Collection[str], larger: Collection[str]) -> bool:
    """Whether the larger model has a lean beside a bank that both have."""
    return _BANK in smaller and _LEAN not in smaller and leans_on_a_bank(larger)


def bends(drive: Drive, road: Profiles, x: Floats) -> Floats:
    """Second differences (k,), rad, over half a second each way, of what the bank turns a body by while the car rolls.

    Of what it turns the body, not of what it is: else what leans more to a bank had a smoother one.
    """
    at = rolling_rows(drive)
    at = at[(at >= _REACH) & (at < len(drive.steer) - _REACH)]
    tilt = leans_too(x, road.lean_share)[0] * on_road(road, x).bank_rad
    return np.asarray(tilt[at + _REACH] - 2.0 * tilt[at] + tilt[at - _REACH])


def roughness(bent: Floats) -> float:
    """How much a bank bends (k,), rms, rad; none is smoother than can be felt."""
    return max(float(np.sqrt(np.mean(bent**2))) if len(bent) else 0.0, _SMOOTHEST_RAD)


def unevenness(bent: Floats, usual: float) -> float:
    """What a fit loses by how much a bank bends (k,), over its `usual` roughness: half of squares."""
    return 0.5 * SURER * float(np.sum((bent / usual) ** 2))


def slopes_of_bends(drive: Drive, felt: Callable[[Floats], Profiles], x: Floats, bent: Floats) -> Floats:
    """What another lean makes of how the bank is `bent` (k,): secants (k, 4) over the numbers of a lean."""
    slopes = np.empty((len(bent), len(_NUMBERS)))
    for i, column in enumerate(_NUMBERS):
        parameter, moved = drive.vocabulary.columns[column][1], x.copy()
        step = 0.1 * parameter.step if x[column] + parameter.step <= parameter.high else -0.1 * parameter.step
        moved[column] += step
        slopes[:, i] = (bends(drive, felt(moved), moved) - bent) / step
    return slopes


def leaning(slopes: Floats, bent: Floats) -> Leaning:
    """What a bank that is `bent` (k,) says of the lean that it is felt with; `slopes` as of `slopes_of_bends`."""
    weight = SURER / roughness(bent) ** 2
    return Leaning(list(_NUMBERS), weight * (slopes.T @ slopes), -weight * (slopes.T @ bent))


def rows_as_one(bent: Floats) -> float:
    """How many rows of what a bank bends (k,) tell as much as one that is independent."""
    return float(correlated_rows(bent[:, np.newaxis], np.ones((len(bent), 1), dtype=np.bool_))[0])


def smoother(before: Floats, after: Floats) -> float:
    """Log likelihood that a bank gains by bending less, (k,) each."""
    return len(after) / rows_as_one(after) * float(np.log(roughness(before) / roughness(after)))
