"""A road bends no more where the car does: what tells a body's lean from a bank, and its dive from a climb.

A gyro feels both as one, and the accelerometer shows g times both. But a body leans with the bend, within half a
second, and what a road does has nothing to do with that: of all leans the right one leaves the smoothest road.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np

from dsz_daemon.diagnose.correlation import correlated_rows
from dsz_daemon.diagnose.inputs import rolling_rows
from dsz_daemon.diagnose.prediction import Drive, Floats, Profiles, on_road
from dsz_daemon.diagnose.recording import DT_S

# What each road takes along of a body on springs.
LEANS_WITH = {"road_bank": "suspension_roll", "road_grade": "suspension_pitch"}
# How long a body takes to lean; rad: smoother is no road that a gyro has felt.
_REACH, _SMOOTHEST_RAD = round(0.5 / DT_S), 1e-4


def with_their_lean(effects: Collection[str]) -> tuple[str, ...]:
    """The roads in a model that has their lean, too."""
    return tuple(road for road, lean in LEANS_WITH.items() if road in effects and lean in effects)


def bends(drive: Drive, road: Profiles, x: Floats, roads: Sequence[str]) -> Floats:
    """Second differences (k, len(roads)) over half a second each way, while the car rolls, of the roads' tilts, rad."""
    at, there = rolling_rows(drive), on_road(road, x)
    at = at[(at >= _REACH) & (at < len(drive.steer) - _REACH)]
    tilts = {"road_bank": there.bank_rad, "road_grade": there.grade_rad}
    found = np.zeros((len(at), len(roads)))
    for i, name in enumerate(roads):
        found[:, i] = tilts[name][at + _REACH] - 2.0 * tilts[name][at] + tilts[name][at - _REACH]
    return found


def roughness(bent: Floats) -> Floats:
    """How much roads bend, rms (len(roads),), rad; none is smoother than can be felt."""
    return np.asarray(np.maximum(np.sqrt(np.mean(bent**2, axis=0)), _SMOOTHEST_RAD))


def bends_per_lean(
    drive: Drive, felt: Callable[[Floats], Profiles], x: Floats, bent: Floats, roads: Sequence[str]
) -> tuple[list[int], Floats]:
    """The leans' columns, and secants (k, len(roads)) of what each road bends over its own."""
    columns, slopes = [], np.zeros_like(bent)
    for i, road in enumerate(roads):
        column = drive.vocabulary.columns_of(LEANS_WITH[road])[0]
        parameter, moved = drive.vocabulary.columns[column][1], x.copy()
        step = 0.1 * parameter.step if x[column] + parameter.step <= parameter.high else -0.1 * parameter.step
        moved[column] += step
        slopes[:, i] = (bends(drive, felt(moved), moved, (road,))[:, 0] - bent[:, i]) / step
        columns.append(column)
    return columns, slopes


def smoother(before: Floats, after: Floats) -> float:
    """Log likelihood that roads gain by bending less, (k, roads) each: what is left hangs together."""
    if not before.size:
        return 0.0
    independent = len(after) / correlated_rows(after, np.ones(after.shape, dtype=np.bool_))
    return float(np.sum(independent * np.log(roughness(before) / roughness(after))))
