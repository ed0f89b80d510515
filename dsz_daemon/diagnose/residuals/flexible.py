"""How much less could be left: a model that fits nearly anything and names nothing, held against unseen data.

Ridge regression of what each channel has left on products of motion and their course just before and after. It is the
yardstick for what named physics could still gain: where it gains nothing either, what is left is noise.
"""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import FOLDS, Rows
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats

# The course of motion: now, and so long before and after.
_LAGS_S = (-0.3, 0.0, 0.3)
_RIDGES = (1e-4, 1e-2, 1.0)


def flexible_rms(drive: Drive, rows: Rows, left: Floats) -> Floats:
    """Per channel (13,), the rms that the flexible model leaves on blocks of `left` (k, 13) that it has not seen.

    Never more than what is left without it; NaN where a channel has too few rows.
    """
    table, found = _products(drive, rows), np.full(len(CHANNELS), np.nan)
    for c in range(len(CHANNELS)):
        used = rows.used[:, c]
        if np.count_nonzero(used) < 2 * table.shape[1]:
            continue
        mine, seen_by = left[used, c], rows.block[used] % FOLDS
        least = float(np.sum(mine**2))
        features = table[used]
        squares = [features[seen_by == k].T @ features[seen_by == k] for k in range(FOLDS)]
        cross = [features[seen_by == k].T @ mine[seen_by == k] for k in range(FOLDS)]
        for ridge in _RIDGES:
            total = 0.0
            for k in range(FOLDS):
                square, seen = sum(squares) - squares[k], len(mine)
                weight = np.eye(len(square)) * (ridge * seen)
                step = np.linalg.solve(square + weight, sum(cross) - cross[k])
                total += float(np.sum((mine[seen_by == k] - features[seen_by == k] @ step) ** 2))
            least = min(least, total)
        found[c] = float(np.sqrt(least / len(mine)))
    return found


def _products(drive: Drive, rows: Rows) -> Floats:
    """Features (k, f) of size 1: motion around each row, and its products of two."""
    v = np.mean(drive.wheels, axis=1)
    measured = np.nan_to_num(drive.measured)
    r = measured[:, 2]
    courses = [v, np.gradient(v, DT_S), r * v, r, drive.steer, np.gradient(drive.steer, DT_S)]
    n, columns = len(v), []
    for course in courses:
        for lag_s in _LAGS_S:
            place = np.clip(rows.at + round(lag_s / DT_S), 0, n - 1)
            columns.append(course[place])
    now = [course[rows.at] for course in courses]
    columns += [now[i] * now[j] for i in range(len(now)) for j in range(i, len(now))]
    table = np.column_stack(columns)
    spread = np.std(table, axis=0)
    table = (table - np.mean(table, axis=0)) / np.where(spread > 1e-12, spread, 1.0)
    return np.column_stack([np.ones(len(table)), table])
