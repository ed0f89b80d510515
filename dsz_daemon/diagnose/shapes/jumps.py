"""An offset that jumps once: a sensor that was knocked, or switched."""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import Ints
from dsz_daemon.diagnose.simulation.drive import Floats

# So far from both ends, and by so many times as much as what is left beside it wanders (rms of blocks' means): a slow
# noise's largest step.
_SHORTEST_S, _FAR_BEYOND = 10.0, 8.0


def jump_in(left: Floats, at: Ints, block: Ints) -> int | None:
    """Where, on the recording's grid, what is left (k,) of a channel jumps; None where it does not.

    `at` (k,): places on that grid; `block` (k,) of the rows. The place is the one that two means explain most by.
    """
    n = len(left)
    sums = np.cumsum(left)
    before = np.arange(1, n)
    means = sums[:-1] / before, (sums[-1] - sums[:-1]) / (n - before)
    taken = (means[1] - means[0]) ** 2 * before * (n - before)
    far = (at[1:] - at[0] > _SHORTEST_S / DT_S) & (at[-1] - at[1:] > _SHORTEST_S / DT_S)
    if not far.any():
        return None
    place = int(np.argmax(np.where(far, taken, -1.0)))
    beside = left - np.where(np.arange(n) > place, means[1][place], means[0][place])
    count = np.bincount(block)
    whole = count > 0.5 * np.max(count)
    wander = float(np.std((np.bincount(block, beside) / np.maximum(count, 1))[whole]))
    jumped = abs(float(means[1][place] - means[0][place]))
    return int(at[place + 1]) if jumped > _FAR_BEYOND * wander and jumped > 0.0 else None
