"""A road bends no more where the car does: what tells a body's lean from a bank, and its dive from a climb.

A gyro feels both as one, and the accelerometer shows g times both. But a body leans with the bend, within half a
second, and what a road does has nothing to do with that: of all leans the right one leaves the smoothest road.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np

from dsz_daemon.diagnose.correlation import correlated_rows
from dsz_daemon.diagnose.effects import INDEX
from dsz_daemon.diagnose.inputs import rolling_rows
from dsz_daemon.diagnose.prediction import Drive, Floats, Ints, Profiles, on_road
from dsz_daemon.diagnose.profiles import leans_too
from dsz_daemon.diagnose.recording import DT_S

# What each road takes along of a body on springs, and by which of its numbers.
LEANS_WITH = {"road_bank": "suspension_roll", "road_grade": "suspension_pitch"}
_COLUMNS = {
    "road_bank": [
        INDEX[f"suspension_roll.{name}"] for name in ("roll_gradient_rad_per_mps2", "frequency_share", "damping")
    ],
    "road_grade": [
        INDEX[f"suspension_pitch.{name}"] for name in ("pitch_gradient_rad_per_mps2", "frequency_share", "damping")
    ],
}
# What a fit's other channels seem to tell of such a lean is less than what a simulation gets wrong: how smooth the road
# is counts so many times.
SURER = 10.0
# How long a body takes to lean; rad: smoother is no road that a gyro has felt.
_REACH, _SMOOTHEST_RAD = round(0.5 / DT_S), 1e-4


def with_their_lean(effects: Collection[str]) -> tuple[str, ...]:
    """The roads in a model that has their lean, too."""
    return tuple(road for road, lean in LEANS_WITH.items() if road in effects and lean in effects)


def bends(drive: Drive, road: Profiles, x: Floats, roads: Sequence[str]) -> Floats:
    """Second differences (k, len(roads)), rad, over half a second each way, of what roads turn the body by as it rolls.

    Of what they turn the body, not of what they are: else a body that leans more to a bank had a smoother one.
    """
    at, there = _rows(drive), on_road(road, x)
    of_bank, of_climb = leans_too(x, road.lean_share)
    tilts = {"road_bank": of_bank * there.bank_rad, "road_grade": of_climb * there.grade_rad}
    found = np.zeros((len(at), len(roads)))
    for i, name in enumerate(roads):
        found[:, i] = tilts[name][at + _REACH] - 2.0 * tilts[name][at] + tilts[name][at - _REACH]
    return found


def roughness(bent: Floats) -> Floats:
    """How much roads bend, rms (len(roads),), rad; none is smoother than can be felt."""
    return np.asarray(np.maximum(np.sqrt(np.mean(bent**2, axis=0)), _SMOOTHEST_RAD))


def unevenness(bent: Floats, usual: Floats) -> float:
    """What a fit loses by how much roads bend (k, roads), over their `usual` roughness (roads,): half of squares."""
    return 0.5 * SURER * float(np.sum((bent / usual) ** 2))


def normal_equations(
    drive: Drive, felt: Callable[[Floats], Profiles], x: Floats, bent: Floats, roads: Sequence[str]
) -> tuple[list[int], Floats, Floats]:
    """The leans' columns, and the normal equations (p, p), (p,) of what roads bend over these, scaled."""
    columns = [column for road in roads for column in _COLUMNS[road]]
    squares, cross, first = np.zeros((len(columns), len(columns))), np.zeros(len(columns)), 0
    for i, road in enumerate(roads):
        slopes = np.column_stack([_per_step(drive, felt, x, bent[:, i], road, column) for column in _COLUMNS[road]])
        weight, its = SURER / float(roughness(bent[:, i])) ** 2, slice(first, first + slopes.shape[1])
        squares[its, its] = weight * (slopes.T @ slopes)
        cross[its] = -weight * (slopes.T @ bent[:, i])
        first += slopes.shape[1]
    return columns, squares, cross


def _per_step(
    drive: Drive, felt: Callable[[Floats], Profiles], x: Floats, bent: Floats, road: str, column: int
) -> Floats:
    parameter, moved = drive.vocabulary.columns[column][1], x.copy()
    step = 0.1 * parameter.step if x[column] + parameter.step <= parameter.high else -0.1 * parameter.step
    moved[column] += step
    return np.asarray((bends(drive, felt(moved), moved, (road,))[:, 0] - bent) / step)


def hang_together(bent: Floats) -> Floats:
    """How many rows (k, roads) of what roads bend tell as much as one that is independent."""
    return correlated_rows(bent, np.ones(bent.shape, dtype=np.bool_))


def smoother(before: Floats, after: Floats) -> float:
    """Log likelihood that roads gain by bending less, (k, roads) each."""
    if not before.size:
        return 0.0
    return float(np.sum(len(after) / hang_together(after) * np.log(roughness(before) / roughness(after))))


def _rows(drive: Drive) -> Ints:
    at = rolling_rows(drive)
    return at[(at >= _REACH) & (at < len(drive.steer) - _REACH)]
