"""Whether what a sensor leaves is its own: noise with a colour, which is there however the car is driven."""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import BLOCK_S, STILL_MPS, Bools, Ints, Rows
from dsz_daemon.diagnose.residuals.flexible import flexible_rms
from dsz_daemon.diagnose.simulation.drive import Drive, Floats

# What is so many times more where a car is driven hard than where it is not has to do with how it is driven.
_LIVELIER, _STEADIER = 1.6, 3.0
_LEAST_BLOCKS = 8
# Noise is not told by the course of motion: of its power a model that fits nearly anything leaves most, on unseen data.
_UNTOLD = 0.5
# What has so many times the power while a car drives is not there while it stands, if it stands for so many rows: four
# seconds. Of what is slower than a block neither says much.
_QUIETER, _LEAST_STANDING = 4.0, 100
# Noise is the sum of many things: its fourth moment is three times the square of its second, and was 2.7 to 3.2 times
# in 40 channels. Words that are torn had 5, people who get into a car that stands 104.
_FAR_READINGS = 4.5
# What correlates by so much with what another sensor has left, beside means of blocks, is no sensor's own; of so many
# rows at least.
_ALIKE, _LEAST_SHARED = 0.5, 300


def is_its_own(drive: Drive, rows: Rows, left: Floats, c: int) -> bool:
    """Whether what channel c has left (k,) is no more in the livelier half of the drive's blocks than in the other.

    A sensor's flicker is several times its white noise, which is all that second differences tell of it. It is there
    while the car stands, too, and has no readings that are far from all others.
    """
    v = np.mean(drive.wheels, axis=1)
    lively = (np.gradient(v, DT_S) ** 2 + (drive.steer / drive.car.wheelbase_m * v * v) ** 2)[rows.at]
    used, blocks = rows.used[:, c], (rows.at * DT_S / BLOCK_S).astype(np.int64)
    count = np.maximum(np.bincount(blocks, used), 1.0)
    full = count > 0.5 * np.max(count)
    if np.count_nonzero(full) < _LEAST_BLOCKS:
        return False
    if _is_quiet_while_standing(v[rows.at], left, used, blocks) or _has_far_readings(left, used, blocks):
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


def is_shared(rows: Rows, left: Floats, c: int, channels: int) -> bool:
    """Whether another of the first so many channels has left (k, 13) the same as channel c: no two sensors' own is.

    Beside each block's mean: what is slow goes up and down together by chance.
    """
    blocks = (rows.at * DT_S / BLOCK_S).astype(np.int64)

    def is_alike(other: int) -> bool:
        used = rows.used[:, c] & rows.used[:, other]
        if np.count_nonzero(used) < _LEAST_SHARED:
            return False
        mine, its = (_beside_means(left[:, i], used, blocks) for i in (c, other))
        power = float(mine @ mine) * float(its @ its)
        return power > 0.0 and abs(float(mine @ its)) > _ALIKE * math.sqrt(power)

    return any(is_alike(other) for other in range(channels) if other != c)


def _is_quiet_while_standing(v_mps: Floats, left: Floats, used: Bools, blocks: Ints) -> bool:
    """Whether of what changes within blocks little is there while the car stands."""
    stands = v_mps < STILL_MPS
    resting, driving = used & stands, used & ~stands
    if np.count_nonzero(resting) < _LEAST_STANDING or not driving.any():
        return False
    return _QUIETER * _within(left, resting, blocks) < _within(left, driving, blocks)


def _has_far_readings(left: Floats, used: Bools, blocks: Ints) -> bool:
    """Whether few rows have more of the power than they would of noise."""
    beside = _beside_means(left, used, blocks)[used]
    return float(np.mean(beside**4)) > _FAR_READINGS * float(np.mean(beside**2)) ** 2


def _within(left: Floats, used: Bools, blocks: Ints) -> float:
    """The power of these rows beside the mean of each block's."""
    return float(np.mean(_beside_means(left, used, blocks)[used] ** 2))


def _beside_means(left: Floats, used: Bools, blocks: Ints) -> Floats:
    """What these rows have beside the mean of each block's; 0 in others (k,)."""
    mine = np.where(used, left, 0.0)
    mean = np.bincount(blocks, mine) / np.maximum(np.bincount(blocks, used), 1.0)
    return np.where(used, mine - mean[blocks], 0.0)
