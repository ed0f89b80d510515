"""When a stretch begins and ends: a valley with many bends, which is looked through by trying."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from dsz_daemon.diagnose.fitting.descent import loss_of
from dsz_daemon.diagnose.fitting.fit import exactly
from dsz_daemon.diagnose.fitting.model import MOMENTS, Fit
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import Each, Rows, residual
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.prediction import predicted

# So long is a slippery stretch at least.
SHORTEST_S = 2.0
# Log likelihood by which a moment has to be worse than the best to be none: rows that hang together count as one.
_AS_GOOD, _STEP_S = 2.0, 2.0


def moments_of(drive: Drive) -> list[int]:
    """The columns in which a stretch begins and ends."""
    return [i for i, column in enumerate(drive.vocabulary.columns) if column in MOMENTS]


def with_best_moments(drive: Drive, rows: Rows, fit: Fit) -> Floats:
    """The parameters with the moments in which a stretch begins and ends moved to where least is left.

    Where nothing tells (the car goes straight), the shortest stretch is taken.
    """
    x, least = fit.x.copy(), loss_of(fit.left, rows, fit.scatter)
    left_by = partial(_left_by, drive, rows, fit)
    moments = moments_of(drive)
    last_s = float(len(drive.steer) * DT_S)
    for by_s in (16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 8.0, 4.0, 2.0, 1.0, 0.5):
        for i in moments:
            for sign in (-1.0, 1.0):
                trial = x.copy()
                trial[i] = min(max(trial[i] + sign * by_s, 0.0), last_s)
                loss = left_by(trial)
                if loss < least:
                    x, least = trial, loss
    for i, inwards in zip(moments, (1.0, -1.0), strict=True):
        for by_s in (4.0, 2.0, 1.0, 0.5, 0.2):
            trial = x.copy()
            trial[i] += inwards * by_s
            if trial[moments[0]] < trial[moments[1]] and left_by(trial) < least + 0.5:
                x = trial
    return x


def in_the_middle(drive: Drive, rows: Rows, fit: Fit, tolerance: Mapping[str, float], each: Each = map) -> Fit:
    """The fit with each end of its slippery stretch, if it has one, in the middle of where it may as well be.

    Once, of what is to be told: along a straight that is many simulations. Each is told with the spread of what is
    anywhere there.
    """
    if "low_friction" not in fit.effects:
        return fit
    left_by = partial(_left_by, drive, rows, fit)
    least, as_good = loss_of(fit.left, rows, fit.scatter), _AS_GOOD * float(np.max(fit.per_row))
    x, last_s = fit.x.copy(), float(len(drive.steer) * DT_S)
    x[moments_of(drive)] = np.clip(x[moments_of(drive)], 0.0, last_s)
    begun, bounds_s = x.copy(), dict[int, tuple[float, float]]()
    begins_s, ends_s = begun[moments_of(drive)].tolist()
    for i, way_s in zip(moments_of(drive), ((0.0, ends_s), (begins_s, last_s)), strict=True):
        is_as_good = partial(_is_less, least + as_good, left_by, begun, i)
        first_s, end_s = (_as_far_as(is_as_good, float(begun[i]), to_s) for to_s in way_s)
        x[i], bounds_s[i] = 0.5 * (first_s + end_s), (first_s, end_s)
    if left_by(x) <= least + 2.0 * as_good:
        left = residual(rows, predicted(drive, x, fit.road))
        fit = exactly(drive, rows, fit._replace(x=x, left=left), tolerance, each)
    # Its slopes tell of a moment what it costs to leave it, which on a plateau is next to nothing.
    std = fit.std.copy()
    values, spreads = (fit.x[list(fit.columns)], std.copy()) if fit.told is None else fit.told
    for i, (first_s, end_s) in bounds_s.items():
        at = fit.columns.index(i)
        std[at] = spreads[at] = _spread_s(first_s - fit.x[i], end_s - fit.x[i])
    return fit._replace(std=std, told=(values, spreads))


def _spread_s(first_s: float, end_s: float) -> float:
    """The rms of what is anywhere between these two, looked for in steps."""
    return math.hypot(math.sqrt((first_s**2 + first_s * end_s + end_s**2) / 3.0), 0.5 * _STEP_S)


def _left_by(drive: Drive, rows: Rows, fit: Fit, trial: Floats) -> float:
    return loss_of(residual(rows, predicted(drive, trial, fit.road)), rows, fit.scatter)


def _is_less(most: float, left_by: Callable[[Floats], float], x: Floats, i: int, moment_s: float) -> bool:
    there = x.copy()
    there[i] = moment_s
    return left_by(there) < most


def _as_far_as(is_as_good: Callable[[float], bool], from_s: float, to_s: float) -> float:
    """The last moment on the way, in steps, then in half of one, up to which all are as good."""
    found_s = from_s
    for by_s in (_STEP_S, 0.5 * _STEP_S):
        step_s = math.copysign(by_s, to_s - from_s)
        while abs(to_s - found_s) >= by_s and is_as_good(found_s + step_s):
            found_s += step_s
    return found_s
