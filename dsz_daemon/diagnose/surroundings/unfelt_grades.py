"""A grade where no pitch gyro is to feel it: what the longitudinal accelerometer shows more, as a function of place.

reading_x = a_x + g gamma, and the wheels tell a_x. Nothing else shows this road; but a road is a function of place, and
rises and falls over tens of metres: what is seen of it before and behind tells what is between. So it is a smooth
function of the way driven (a Gaussian process, Matern 5/2; Rasmussen and Williams, Gaussian Processes for Machine
Learning, chapters 2 and 4), and judged on stretches of 5 s that it has not seen. What a sensor shows wrongly is one of
how the car moves, and nothing of where it is: neither what is quick nor what changes while the car stands follows.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from copy import copy
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import BLOCK_S, Bools, Ints, Rows
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.prediction import ALONG

ROLL_GYRO, PITCH_GYRO = 0, 1
# What a road that climbs all the way shows: a car that turns on it rolls by as much of its turn, r gamma.
_ROLLS_BY_THE_TURN = INDEX["gyro_cross_axis.xz"]
# So far apart are the roads of two recordings.
_ELSEWHERE_M = 1e6
# What is averaged; no more of them than a matrix may have rows.
_CELL_S, _MOST_CELLS = 0.48, 400
# How far a road looks alike, and the noise over what the road does: whichever leaves the least on unseen blocks.
_REACH_M = (20.0, 40.0, 80.0, 160.0, 320.0)
_NOISE = (0.03, 0.1, 0.3, 1.0)
# A road that is one turns so often from up to down or back, by this share of its rms; what warms up or drifts does not.
_TURNS, _TURN = 3, 0.5
# Knots of a course over the speed, and how many rows each is nothing by itself.
_KNOT_MPS, _KNOTS_MOST, _KNOT_ROWS = 1.5, 40, 5.0


def climbs_unfelt(drive: Drive) -> bool:
    """Whether there is no pitch gyro, but an accelerometer that shows something as the car rolls."""
    return bool(np.isnan(drive.measured[:, PITCH_GYRO]).all() and _shows_on_the_way(drive).any())


def evenly_by(drive: Drive, effects: Collection[str]) -> int | None:
    """The column of what a grade that no pitch gyro feels is all the way, where a roll gyro tells that; else None.

    The profile is the accelerometer's, without what is an offset's as well.
    """
    is_told = "road_grade" in effects and climbs_unfelt(drive) and np.isfinite(drive.measured[:, ROLL_GYRO]).any()
    return _ROLLS_BY_THE_TURN if is_told else None


def _shows_on_the_way(drive: Drive) -> Bools:
    rolls = np.mean(drive.wheels, axis=1) > motion.ROLLING_MPS
    return np.asarray(np.isfinite(drive.measured[:, ALONG]) & rolls)


class Way(NamedTuple):
    """The way driven (n,), m, and its cells: of each row (n,), -1 for none, where they are (c,), and their blocks.

    `piece` (c,): whose recording a cell is of. Two are of roads that know nothing of each other, and IMUs that have
    offsets of their own.
    """

    at_m: Floats
    cell: Ints
    cells_m: Floats
    block: Ints
    piece: Ints


class ByPlace(NamedTuple):
    """What makes a smooth road of the cells' means: (c, c); and of them what blocks of 5 s show beyond all others."""

    smooth: Floats
    unseen: Floats


def way_of(drive: Drive) -> Way:
    """Cells of half a second in which the car rolls and the accelerometer shows something."""
    v = np.nan_to_num(np.mean(drive.wheels, axis=1))
    piece = np.zeros(len(v), dtype=np.int64) if drive.recording.piece is None else drive.recording.piece
    at_m: Floats = np.cumsum(np.maximum(v, 0.0)) * DT_S + _ELSEWHERE_M * piece
    time_s: Floats = DT_S * np.arange(len(v), dtype=np.float64)
    there = _shows_on_the_way(drive)
    size_s = max(_CELL_S, float(time_s[-1]) / _MOST_CELLS)
    cell = np.full(len(v), -1, dtype=np.int64)
    # None is of two recordings.
    _, first, cell[there] = np.unique(
        (time_s[there] / size_s).astype(np.int64) + piece[there] * len(v), return_index=True, return_inverse=True
    )
    middle_s, cells_m = _means_of(cell[there], time_s[there]), _means_of(cell[there], at_m[there])
    return Way(at_m, cell, cells_m, (middle_s / BLOCK_S).astype(np.int64), piece[there][first])


def cell_means(way: Way, values: Floats) -> Floats:
    """Of values (n,) the means of each cell (c,), the mean of its recording taken off: that is an offset's."""
    there = way.cell >= 0
    means = _means_of(way.cell[there], values[there])
    return means - _means_of(way.piece, means)[way.piece]


def _means_of(group: Ints, values: Floats) -> Floats:
    """The mean of the values of each group."""
    return np.asarray(np.bincount(group, values) / np.maximum(np.bincount(group), 1))


def by_place(way: Way, means: Floats) -> ByPlace:
    """The smoothness of a road of which the cells' means are these."""
    apart = np.abs(way.cells_m[:, np.newaxis] - way.cells_m)
    blocks = [np.flatnonzero(way.block == block) for block in np.unique(way.block)]
    best, least = (np.eye(len(means)), np.eye(len(means))), math.inf
    for reach_m in _REACH_M:
        r = math.sqrt(5.0) * apart / reach_m
        alike = (1.0 + r + r * r / 3.0) * np.exp(-r)
        powers, waves = np.linalg.eigh(alike)
        for noise in _NOISE:
            inverse = (waves / (np.maximum(powers, 0.0) + noise**2)) @ waves.T
            pulled = inverse @ means
            left = sum(float(np.sum(np.linalg.solve(inverse[np.ix_(at, at)], pulled[at]) ** 2)) for at in blocks)
            if left < least:
                best, least = (alike, inverse), left
    alike, inverse = best
    unseen = np.empty_like(inverse)
    for at in blocks:
        unseen[at] = np.linalg.solve(inverse[np.ix_(at, at)], inverse[at])
    return ByPlace(alike @ inverse, unseen)


def along_the_way(way: Way, cells: Floats) -> Floats:
    """Values of cells (c,) everywhere (n,): where the car stands, that of the place."""
    return np.interp(way.at_m, way.cells_m, cells)


class Climb:
    """A grade that no pitch gyro feels, as smooth over the way as it was at first."""

    def __init__(self, drive: Drive) -> None:
        self._way = way_of(drive)
        self._place: ByPlace | None = None

    def anew(self) -> Climb:
        """The same way, as smooth as it is at the next look."""
        found = copy(self)
        found._place = None
        return found

    def up_rad(self, left_mps2: Floats, shown_mps2: float) -> Floats:
        """Grade (n,) of what is left on a level road (n,), where a radian shows as so much."""
        means = cell_means(self._way, left_mps2)
        if self._place is None:
            self._place = by_place(self._way, means)
        return along_the_way(self._way, self._place.smooth @ means) / shown_mps2

    def unseen(self, rows: Rows, left_mps2: Floats) -> tuple[Floats, float]:
        """Squares (b,) of what other places do not tell of what is left (n,), and how many rows of it are as one."""
        means = cell_means(self._way, left_mps2)
        place = self._place or by_place(self._way, means)
        told = along_the_way(self._way, means - place.unseen @ means)
        used = rows.used[:, ALONG]
        off = np.where(used, (left_mps2 - told)[rows.at], 0.0)
        piece = np.zeros(len(used), dtype=np.int64) if rows.piece is None else rows.piece
        off[used] -= _means_of(piece[used], off[used])[piece[used]]
        squares: Floats = np.bincount(rows.block, off**2, minlength=int(rows.block[-1]) + 1).astype(np.float64)
        return squares, float(correlated_rows(off[:, np.newaxis], used[:, np.newaxis])[0])


def rises_and_falls(way: Way, grade_rad: Floats) -> bool:
    """Whether a road turns from up to down and back as often as one does, recordings taken together."""
    there = way.cell >= 0
    grade_rad, piece = grade_rad[there], way.piece[way.cell[there]]
    least = _TURN * float(np.std(grade_rad))
    return sum(_turns(grade_rad[piece == k].tolist(), least) for k in np.unique(piece)) >= _TURNS


def goes_by_the_speed(drive: Drive, rows: Rows, left_mps2: Floats, by_place: Floats) -> bool:
    """Whether speed tells more of what the accelerometer shows beyond a level road (k,) than place does.

    A course over the speed, straight between knots, is told on blocks that it has not seen, of which a road leaves
    `by_place` (b,): squares, there over all that are compared. What shakes goes by the speed, and a road does not.
    """
    speed = np.nan_to_num(np.mean(drive.wheels, axis=1))[rows.at]
    used = rows.used[:, ALONG] & (speed > motion.ROLLING_MPS)
    if np.count_nonzero(used) <= _KNOTS_MOST:
        return False
    speed, left, block = speed[used], left_mps2[used] - np.mean(left_mps2[used]), rows.block[used]
    most = float(speed.max()) - motion.ROLLING_MPS
    knots = min(math.ceil(most / _KNOT_MPS) + 1, _KNOTS_MOST)
    at = (speed - motion.ROLLING_MPS) * ((knots - 1) / max(most, 1e-9))
    courses = np.maximum(1.0 - np.abs(at[:, np.newaxis] - np.arange(knots)), 0.0)
    squares, cross = courses.T @ courses + _KNOT_ROWS * np.eye(knots), courses.T @ left
    unseen = 0.0
    for b in np.unique(block):
        mine = block == b
        own = courses[mine]
        k = np.linalg.solve(squares - own.T @ own, cross - own.T @ left[mine])
        unseen += float(np.sum((left[mine] - own @ k) ** 2))
    return bool(unseen / np.count_nonzero(used) < by_place.sum() / np.count_nonzero(rows.used[:, ALONG]))


def _turns(values: Sequence[float], least: float) -> int:
    """How often the values turn from rising to falling or back, each time by `least` or more."""
    turns, rising, low, high = 0, 0, values[0], values[0]
    for value in values:
        low, high = min(low, value), max(high, value)
        if rising <= 0 and value > low + least:
            turns, rising, high = turns + (rising < 0), 1, value
        elif rising >= 0 and value < high - least:
            turns, rising, low = turns + (rising > 0), -1, value
    return turns
