"""Whether an effect's number is the same all the way: what changes from one part of a drive to the next is none."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from dsz_daemon.diagnose.fitting.model import OWN_CHANNEL, Fit, values_of
from dsz_daemon.diagnose.residuals.comparison import Ints, Rows
from dsz_daemon.diagnose.residuals.evidence import inverse_of_told
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

# So many blocks make a part. What a number changes by (rms) over itself: right names of two simulators by other
# authors, and of the proof's two cars at size 1, changed by 0.25 of themselves at most, but for one compliance that was
# hardly told (0.48, which noise may do); a gyro's scale beside a product that is not quite what the gyro shows by 0.58.
_BLOCKS, _OF_ITSELF = 3, 0.5
# Parts scatter by so many times what noise makes them, or that is all that it is.
_SURELY = 4.0
# A time is a time: right ones of two simulators by other authors changed by 0.01 of themselves at most, over the drive
# and by the speed; one that was a way by 0.16, on a motorway.
_LATE = frozenset({"imu_delay", "steering_delay", "wheel_speed_delay"})
_SPEEDS, _OF_A_TIME, _SURELY_NO_TIME = 6, 0.1, 8.0


def changes_all_the_way(drive: Drive, rows: Rows, fit: Fit, effect: str) -> bool:
    """Whether the best told number of an effect is another one in each part of the drive, by much of itself.

    What is late by a time is that at each speed as well, and by less of itself.

    Each part's own estimate, all else as it is (the score of a part over its information, of what no other parameter
    of the model does), against how far noise that hangs together throws it. Roads and winds have no such numbers.
    """
    own = [i for i in drive.vocabulary.columns_of(effect) if i in fit.columns]
    if effect in OWN_CHANNEL or not own:
        return False
    spreads = [abs(fit.x[i]) / max(fit.std[fit.columns.index(i)], 1e-300) for i in own]
    i = own[int(np.argmax(spreads))]
    at = fit.columns.index(i)
    bread, _ = inverse_of_told(fit.sums.squares.sum(axis=(0, 1)), np.full(len(fit.columns), 1e-12))
    if not bread[at, at] > 0.0:
        return False
    alone = bread[:, at] / bread[at, at]
    blocks = len(fit.sums.squares)
    parts = [np.arange(blocks) // _BLOCKS]
    of_itself, surely = (_OF_A_TIME, _SURELY_NO_TIME) if effect in _LATE else (_OF_ITSELF, _SURELY)
    if effect in _LATE:
        rolled = np.bincount(rows.block, np.mean(drive.wheels[rows.at], axis=1), blocks)
        v_mps = rolled / np.maximum(np.bincount(rows.block, minlength=blocks), 1)
        parts.append(np.argsort(np.argsort(v_mps)) * _SPEEDS // blocks)
    # By block: what it tells of the number, the same as often as its noise hangs together, and which way it pulls.
    by_channel = np.einsum("i,bcij,j->bc", alone, fit.sums.squares, alone)
    told, lasting = by_channel.sum(axis=1), by_channel @ np.maximum(fit.per_row, 1.0)
    pulls = fit.sums.cross.sum(axis=1) @ alone
    of_blocks = told, lasting, pulls
    return any(_changes_by(part, of_blocks, surely) > of_itself * abs(float(fit.x[i])) for part in parts)


def times_that_change(drive: Drive, fit: Fit, effects: Collection[str]) -> list[Shape]:
    """What is told of delays among these effects that are another time from part to part."""
    found = list[Shape]()
    for effect in sorted(_LATE.intersection(effects)):
        late = Coefficient(*values_of(drive, fit, effect)["delay_s"], "s, another at another speed or time")
        heard = [channel for c, channel in enumerate(IMU_CHANNELS) if np.isfinite(drive.measured[:, c]).any()]
        channels = {"imu_delay": heard, "wheel_speed_delay": list(WHEEL_SPEEDS)}.get(effect, ["gyro_z"])
        found += [Shape(channel, "later by k", late, 1.0) for channel in channels]
    return found


def _changes_by(part: Ints, own: tuple[Floats, Floats, Floats], surely: float) -> float:
    """How much a number differs from part to part (rms), beyond what noise does; 0 where that may be all."""
    told, lasting, pulls = (np.bincount(part, one).astype(np.float64) for one in own)
    whole = float(np.sum(told))
    pulls = pulls - told * float(np.sum(pulls)) / max(whole, 1e-300)
    there = told > 1e-3 * whole
    scatters = float(np.sum(pulls[there] ** 2 / told[there]))
    by_noise = float(np.sum(lasting[there] / told[there]))
    return math.sqrt((scatters - by_noise) / whole) if scatters > surely * by_noise else 0.0
