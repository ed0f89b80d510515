"""A road that tilts, told from what tilts on it: a body, or a bracket, does so with no road below.

Both turn the IMU, and gravity comes in. But a car follows its road: where that climbs more and more the car is lifted,
-q v is in a_z; and on a bank it is pushed aside by what its tyres then hold, and turns by it. A body that is pitched by
its springs, or by air, goes straight on.
"""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.comparison import Rows
from dsz_daemon.diagnose.fit import Fit
from dsz_daemon.diagnose.prediction import Drive, Floats, Ints
from dsz_daemon.diagnose.recording import DT_S, filter_kernel
from dsz_daemon.diagnose.shown_by import shown_by

# By what a road moves the car itself: a_z, and the yaw rate; and where its gravity is.
_MOVED, _PITCH_RATE, _PULLED = {"road_grade": 5, "road_bank": 2}, 1, {"road_grade": 3, "road_bank": 4}
# A profile has its gyro's noise, of whose rate means over so long have little: no more than so much of all.
_OVER_S, _OF_NOISE = 2.0, 0.5
# Of what a road does less than half is none of it, by so many spreads; more than that the other way is something else
# that happens to look alike. What is left may last, but not for ever.
_HALF, _SURELY, _MOST = 0.5, 2.0, 0.9


def tips_only_what_stands_on_it(drive: Drive, rows: Rows, fit: Fit, effect: str) -> bool:
    """Whether what this road would do to the car itself is surely not there: less than half of it, either way.

    That share is one number: by least squares on means, with a spread by what each then leaves, and for how long. Of
    a grade's rate some is the pitch gyro's noise, which lifts no car: without that the share would come out too small
    (errors in variables).
    """
    c = _MOVED[effect]
    used = rows.used[:, c]
    if not used.any():
        return False
    moved = shown_by(drive, fit, effect)[rows.at[used], c]
    weight, at = fit.scatter[rows.block[used], c] ** -2.0, (rows.at[used] * DT_S // _OVER_S).astype(np.int64)
    weights = np.bincount(at, weight)
    there = weights > 0.0
    of_road, left = (np.bincount(at, weight * values)[there] / weights[there] for values in (moved, fit.left[used, c]))
    weights = weights[there]
    of_road -= np.average(of_road, weights=weights)
    power = float(np.sum(weights * of_road**2))
    lifted_mps2 = _lifted_by_noise_mps2(drive, rows.at[used], at)[there]
    noise = float(np.sum(weights * lifted_mps2**2)) if effect == "road_grade" else 0.0
    if noise >= _OF_NOISE * power:
        return False
    beyond = float(np.sum(weights * of_road * left)) / power
    rest = left - np.average(left, weights=weights) - beyond * of_road
    lasts = float(np.clip(np.sum(rest[1:] * rest[:-1]) / max(float(np.sum(rest**2)), 1e-30), 0.0, _MOST))
    std = math.sqrt(float(np.sum((weights * of_road * rest) ** 2)) * (1.0 + lasts) / (1.0 - lasts)) / power
    return (abs(1.0 + beyond) + _SURELY * std) * power / (power - noise) < _HALF


def pulls_nothing(drive: Drive, rows: Rows, fit: Fit, effect: str) -> bool:
    """Whether the accelerometer along or across is no better with this road than it would be without it.

    What its gyro feels is no road then: gravity would be there.
    """
    c = _PULLED[effect]
    used = rows.used[:, c]
    if not used.any():
        return False
    left = fit.left[used, c]
    without = left + shown_by(drive, fit, effect)[rows.at[used], c]
    return bool(np.std(left) >= np.std(without))


def _lifted_by_noise_mps2(drive: Drive, rows: Ints, at: Ints) -> Floats:
    """By what means `at` (k,) these rows (k,) the noise of the pitch gyro seems to lift the car, rms."""
    low_pass = math.sqrt(float(np.sum(filter_kernel() ** 2)))
    per_row_radps = float(np.nan_to_num(drive.recording.floor[_PITCH_RATE])) / low_pass
    v_mps = np.bincount(at, np.mean(drive.wheels, axis=1)[rows]) / np.maximum(np.bincount(at), 1)
    return np.asarray(v_mps * per_row_radps * math.sqrt(DT_S / _OVER_S))
