"""Whether what a sensor leaves is its own: noise with a colour, which is there however the car is driven."""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import BLOCK_S, Rows
from dsz_daemon.diagnose.residuals.flexible import flexible_rms
from dsz_daemon.diagnose.simulation.drive import Drive, Floats

# What is so many times more where a car is driven hard than where it is not has to do with how it is driven.
_LIVELIER, _STEADIER = 1.6, 3.0
_LEAST_BLOCKS = 8
# Noise is not told by the course of motion: of its power a model that fits nearly anything leaves most, on unseen data.
_UNTOLD = 0.5


def is_its_own(drive: Drive, rows: Rows, left: Floats, c: int) -> bool:
    """Whether what channel c has left (k,) is no more in the livelier half of the drive's blocks than in the other.

    A sensor's flicker is several times its white noise, which is all that second differences tell of it.
    """
    v = np.mean(drive.wheels, axis=1)
    lively = (np.gradient(v, DT_S) ** 2 + (drive.steer / drive.car.wheelbase_m * v * v) ** 2)[rows.at]
    used, blocks = rows.used[:, c], (rows.at * DT_S / BLOCK_S).astype(np.int64)
    count = np.maximum(np.bincount(blocks, used), 1.0)
    full = count > 0.5 * np.max(count)
    if np.count_nonzero(full) < _LEAST_BLOCKS:
        return False
    power = (np.bincount(blocks, np.where(used, left**2, 0.0)) / count)[full]
    motion = (np.bincount(blocks, np.where(used, lively, 0.0)) / count)[full]
    # Nor is it noise if it is there now and then.
    if float(np.mean(power)) > _STEADIER * float(np.median(power)):
        return False
    hard = motion > np.median(motion)
    if float(np.mean(power[hard])) >= _LIVELIER * float(np.mean(power[~hard])):
        return False
    alone = rows._replace(used=rows.used & (np.arange(rows.used.shape[1]) == c))
    whole = np.where(alone.used, left[:, np.newaxis], 0.0)
    rest = flexible_rms(drive, alone, whole)[c]
    return not rest**2 < _UNTOLD * float(np.mean(left[used] ** 2))
