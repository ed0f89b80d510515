"""When a stretch begins and ends: a valley with many bends, which is looked through by trying."""

from __future__ import annotations

from dsz_daemon.diagnose.comparison import Rows, residual
from dsz_daemon.diagnose.descent import loss_of
from dsz_daemon.diagnose.fit import MOMENTS, Fit
from dsz_daemon.diagnose.prediction import Drive, Floats, predicted
from dsz_daemon.diagnose.recording import DT_S


def moments_of(drive: Drive) -> list[int]:
    """The columns in which a stretch begins and ends."""
    return [i for i, column in enumerate(drive.vocabulary.columns) if column in MOMENTS]


def with_best_moments(drive: Drive, rows: Rows, fit: Fit) -> Floats:
    """The parameters with the moments in which a stretch begins and ends moved to where least is left.

    Where nothing tells (the car goes straight), the shortest stretch is taken.
    """
    x, least = fit.x.copy(), loss_of(fit.left, rows, fit.scatter)

    def left_by(trial: Floats) -> float:
        return loss_of(residual(rows, predicted(drive, trial, fit.road)), rows, fit.scatter)

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
