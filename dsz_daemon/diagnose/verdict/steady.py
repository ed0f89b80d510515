"""Whether an effect's number is the same all the way: what changes from one part of a drive to the next is none."""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.fitting.model import OWN_CHANNEL, Fit
from dsz_daemon.diagnose.residuals.evidence import inverse_of_told
from dsz_daemon.diagnose.simulation.drive import Drive

# So many blocks make a part. What a number changes by (rms) over itself: right names of two simulators by other
# authors, and of the proof's two cars at size 1, changed by 0.25 of themselves at most, but for one compliance that was
# hardly told (0.48, which noise may do); a gyro's scale beside a product that is not quite what the gyro shows by 0.58.
_BLOCKS, _OF_ITSELF = 3, 0.5
# Parts scatter by so many times what noise makes them, or that is all that it is.
_SURELY = 4.0


def changes_all_the_way(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether the best told number of an effect is another one in each part of the drive, by much of itself.

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
    part = np.arange(len(fit.sums.squares)) // _BLOCKS
    # By part: what it tells of the number, the same as often as its noise hangs together, and which way it pulls.
    by_channel = np.einsum("i,bcij,j->bc", alone, fit.sums.squares, alone)
    told = np.bincount(part, by_channel.sum(axis=1))
    lasting = np.bincount(part, by_channel @ np.maximum(fit.per_row, 1.0))
    pulls = np.bincount(part, fit.sums.cross.sum(axis=1) @ alone)
    whole = float(np.sum(told))
    pulls = pulls - told * float(np.sum(pulls)) / max(whole, 1e-300)
    there = told > 1e-3 * whole
    scatters = float(np.sum(pulls[there] ** 2 / told[there]))
    by_noise = float(np.sum(lasting[there] / told[there]))
    if not scatters > _SURELY * by_noise:
        return False
    return math.sqrt((scatters - by_noise) / whole) > _OF_ITSELF * abs(float(fit.x[i]))
