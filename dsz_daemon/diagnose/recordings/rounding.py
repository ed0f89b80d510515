"""What rounding and noise leave of a signal: how far off it is, and for how long it stays so, as it moves on a drive.

A steering that is told in steps of half a degree is wrong by up to a quarter of one. A hand that is never still carries
it over several steps a second, which averages out like noise; in a long bend it stands between two steps all the time.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dsz_daemon.pipeline.grid import Signal

Floats = np.ndarray[Any, np.dtype[np.float64]]

# Where a step may begin, in steps.
_BEGINNINGS = (0.0, 0.25, 0.5, 0.75)
# A hand does not move more quickly: what is left of steps behind this is taken for the course that was rounded.
_SMOOTH_S = 0.1
# Which noise it is makes no difference.
_RNG_SEED = 0
# Noise may hide coarse steps: such are so many times as large, as large as each other to within so much, there are so
# many at least, of smaller moves that are no noise there are fewer by this share, and else a signal stands.
_HIDDEN, _NOISE, _ALIKE, _FEWEST, _FEWER, _STANDS = 40.0, 5.0, 0.05, 20, 0.2, 0.9


def rounded_anew(signal: Signal, step: float, white: float = 0.0) -> list[Signal]:
    """What rounding to this step may leave of the signal's smooth course, if steps begin elsewhere; without its mean.

    A mean is a matter of where zero is. `white`: the deviation of what is white in the signal, in which rounding has
    its part already; what it has more comes on top, each time another.
    """
    period_s = max(float(np.median(np.diff(signal.t_ns))) * 1e-9, 1e-4)
    reach = math.ceil(4.0 * _SMOOTH_S / period_s)
    weights = np.exp(-0.5 * (period_s * np.arange(-reach, reach + 1) / _SMOOTH_S) ** 2)
    smooth = np.convolve(np.pad(signal.values, reach, mode="edge"), weights / weights.sum(), mode="valid")
    noise = math.sqrt(max(white**2 - step**2 / 12.0, 0.0)) if math.isfinite(white) else 0.0
    found, rng = [], np.random.default_rng(_RNG_SEED)
    for beginning in _BEGINNINGS:
        left = step * (np.round(smooth / step + beginning) - beginning) - smooth + noise * rng.normal(size=len(smooth))
        found.append(Signal(signal.t_ns, left - np.mean(left)))
    return found


def coarse_step(signal: Signal) -> float:
    """The steps in which a signal moves, where noise on top of them hides these; 0 where it has none."""
    moves = np.abs(np.diff(signal.values))
    noise = 1.4826 * float(np.median(np.abs(np.diff(signal.values, 2)))) / math.sqrt(6.0) if len(moves) > 1 else 0.0
    steps = moves[moves > _HIDDEN * noise]
    if not noise > 0.0 or len(steps) < _FEWEST:
        return 0.0
    step = float(np.median(steps))
    width = 1.4826 * float(np.median(np.abs(steps - step)))
    between = np.count_nonzero((moves > _NOISE * noise) & (moves < 0.6 * step))
    are_steps = width < _ALIKE * step and between < _FEWER * len(steps)
    return step if are_steps and np.mean(moves < _NOISE * noise) > _STANDS else 0.0
