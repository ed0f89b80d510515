"""When a stretch begins and ends: a valley with many bends, which is looked through by trying."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from dsz_daemon.diagnose.comparison import Rows, residual
from dsz_daemon.diagnose.descent import loss_of
from dsz_daemon.diagnose.fit import MOMENTS, Fit
from dsz_daemon.diagnose.prediction import Drive, Floats, predicted
from dsz_daemon.diagnose.recording import DT_S

# Log likelihood by which a moment has to be worse than the best to be none: rows that hang together count as one.
_AS_GOOD, _STEP_S = 2.0, 1.0


def moments_of(drive: Drive) -> list[int]:
    """The columns in which a stretch begins and ends."""
    return [i for i, column in enumerate(drive.vocabulary.columns) if column in MOMENTS]


def with_best_moments(drive: Drive, rows: Rows, fit: Fit) -> Floats:
    """The parameters with the moments in which a stretch begins and ends moved to where least is left.

    Where little tells (the car goes straight), each is in the middle of where it may as well be.
    """
    x, least = fit.x.copy(), loss_of(fit.left, rows, fit.scatter)

    def left_by(trial: Floats) -> float:
        return loss_of(residual(rows, predicted(drive, trial, fit.road)), rows, fit.scatter)

    moments = moments_of(drive)
    last_s, as_good = float(len(drive.steer) * DT_S), _AS_GOOD * float(np.max(fit.per_row))
    for by_s in (16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 8.0, 4.0, 2.0, 1.0, 0.5):
        for i in moments:
            for sign in (-1.0, 1.0):
                trial = x.copy()
                trial[i] = min(max(trial[i] + sign * by_s, 0.0), last_s)
                loss = left_by(trial)
                if loss < least:
                    x, least = trial, loss
    found = x.copy()
    for i in moments:
        is_as_good = partial(_is_less, least + as_good, left_by, x, i)
        found[i] = 0.5 * sum(_as_far_as(is_as_good, float(x[i]), to_s) for to_s in (0.0, last_s))
    return found if left_by(found) < least + 2.0 * as_good else x


def _is_less(most: float, left_by: Callable[[Floats], float], x: Floats, i: int, moment_s: float) -> bool:
    there = x.copy()
    there[i] = moment_s
    return left_by(there) < most


def _as_far_as(is_as_good: Callable[[float], bool], from_s: float, to_s: float) -> float:
    """The last moment on the way, in steps, up to which all are as good."""
    step_s = math.copysign(_STEP_S, to_s - from_s)
    found_s = from_s
    while abs(to_s - found_s) >= _STEP_S and is_as_good(found_s + step_s):
        found_s += step_s
    return found_s
