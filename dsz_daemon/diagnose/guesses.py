"""Where to begin with what has no slope at 0: a limit that readings clip at, a slippery stretch."""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.comparison import ROW_S, Rows
from dsz_daemon.diagnose.effects import INDEX
from dsz_daemon.diagnose.prediction import Drive, Floats, flat, predicted
from dsz_daemon.diagnose.recording import DT_S
from dsz_daemon.signals import STANDARD_GRAVITY_MPS2

# The simulation goes so much beyond the furthest reading, for so many rows: then readings may clip.
_BEYOND, _FOR_ROWS = 1.02, 5
# A slippery stretch: so long at least, and so much of what is left in it.
_SHORTEST_S = 2.0
_YAW, _ACROSS = 2, 4
# Grip is used up to this share where it is felt first.
_USED = 0.8
# Not 0, so that it is fitted.
_SOME_SHARPNESS = 0.01


def guesses(drive: Drive, rows: Rows, x: Floats, left: Floats) -> list[tuple[str, Floats]]:
    """Effects with parameters (as `x`) to begin from; `left` (k, 13) is what x leaves of the rows that are compared."""
    return [*_clipped(drive, rows, x), *_slippery(rows, x, left)]


def _clipped(drive: Drive, rows: Rows, x: Floats) -> list[tuple[str, Floats]]:
    found = predicted(drive, x, flat(len(drive.steer)))[rows.at]
    start = x.copy()
    for first, name in ((0, "gyro_limit_radps"), (3, "accel_limit_mps2")):
        limits = []
        for c in range(first, first + 3):
            used = rows.used[:, c]
            if np.count_nonzero(used) < 100:
                continue
            furthest = float(np.max(np.abs(rows.measured[used, c])))
            if np.count_nonzero(np.abs(found[used, c]) > _BEYOND * furthest) >= _FOR_ROWS:
                limits.append(furthest)
        if limits:
            start[INDEX[f"sensor_saturation.{name}"]] = max(limits)
    return [] if np.array_equal(start, x) else [("sensor_saturation", start)]


def _slippery(rows: Rows, x: Floats, left: Floats) -> list[tuple[str, Floats]]:
    """The stretch in which most is left of yaw rate and lateral acceleration, over what is usual."""
    each = np.zeros(len(rows.at))
    for c in (_YAW, _ACROSS):
        used = rows.used[:, c]
        if np.count_nonzero(used) > 100:
            power = left[:, c] ** 2
            usual = float(np.median(power[used]))
            each += np.where(used, power / max(usual, 1e-12), 0.0)
    if not each.any():
        return []
    smooth = np.convolve(each, np.ones(25) / 25.0, "same")
    threshold = max(4.0 * float(np.median(smooth)), 0.05 * float(np.max(smooth)))
    # The stretch with the largest sum of what is beyond the threshold (Kadane).
    worth = np.minimum(smooth, 20.0 * threshold) - threshold
    best, best_sum, begun, total = (0, 0), 0.0, 0, 0.0
    for k, value in enumerate(worth.tolist()):
        if total <= 0.0:
            begun, total = k, 0.0
        total += value
        if total > best_sum:
            best, best_sum = (begun, k + 1), total
    first, last = best
    if (last - first) * ROW_S < _SHORTEST_S:
        return []
    across = rows.measured[first:last, _ACROSS][rows.used[first:last, _ACROSS]]
    if len(across) == 0:
        return []
    friction = max(float(np.quantile(np.abs(across), 0.98)) / _USED / STANDARD_GRAVITY_MPS2, 0.05)
    start = x.copy()
    start[INDEX["low_friction.inverse_square"]] = friction**-2
    start[INDEX["low_friction.sharpness"]] = _SOME_SHARPNESS
    start[INDEX["low_friction.start_s"]] = rows.at[first] * DT_S
    start[INDEX["low_friction.end_s"]] = rows.at[last - 1] * DT_S
    return [("low_friction", start)]
