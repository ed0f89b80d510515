"""How much of a sensor's drift may be its own slow noise, which no drive of some minutes averages out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import Rows

Floats = np.ndarray[Any, np.dtype[np.float64]]

# Half waves over the whole drive that are no straight line.
_WAVES = (2, 3, 4, 5)
# What a straight line of slope s has of one half wave: 4 s T / pi^2.
_SLOPE = math.pi**2 / 4.0


def slope_of_slow_noise(rows: Rows, left: Floats, per_row: Floats, channels: int) -> Floats:
    """Spread (channels,) of each channel's slope, unit/s, from what is left (k, 13) beside a straight line.

    Slow noise has as much power in each octave (flicker), so that the waves that are slower than others tell of the
    slowest. What white noise has in a wave is taken off; `per_row` (13,): how many rows count as one.
    """
    at_s = DT_S * rows.at.astype(np.float64)
    lasts_s = max(float(at_s[-1] - at_s[0]), DT_S)
    phase = math.pi * (at_s - at_s[0]) / lasts_s
    table = np.column_stack([np.ones(len(at_s)), at_s - at_s[0], *(np.cos(k * phase) for k in _WAVES)])
    found = np.zeros(channels)
    for c in range(channels):
        used = rows.used[:, c]
        if np.count_nonzero(used) < 10 * table.shape[1]:
            continue
        waves = np.linalg.lstsq(table[used], left[used, c], rcond=None)[0][2:]
        beside = left[used, c] - table[used][:, 2:] @ waves
        white = 2.0 * float(np.var(beside)) * float(per_row[c]) / float(np.count_nonzero(used))
        slowest = float(np.mean(np.array(_WAVES) * np.maximum(waves**2 - white, 0.0)))
        found[c] = _SLOPE * math.sqrt(slowest) / lasts_s
    return found
