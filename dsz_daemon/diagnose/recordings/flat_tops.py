"""Readings that stand at the end of what a sensor can say, whatever the simulation makes of the drive.

A reading has noise of more than its resolution, so that the next one is hardly ever the same. Where it is the same
again and again, and nothing goes beyond it, the sensor clips: that is seen in the recording itself.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.signals import STANDARD_GRAVITY_MPS2

Floats = np.ndarray[Any, np.dtype[np.float64]]

# Two readings in a row are alike by chance: so rarely at best, whatever was counted, and so often at most. Above, the
# noise is finer than the resolution, and any gentle peak stands still.
_RARELY, _OFTEN = 0.01, 0.2
# A vertical accelerometer that shows less than this of gravity all the way stands there; or is stuck, which is rarer.
_OF_GRAVITY, _ALL_THE_WAY = 0.95, 150.0
_UPRIGHT = 5
# Log odds of what the furthest of many readings may do by chance.
_LEAST = 10.0


class FlatTop(NamedTuple):
    """One channel's readings at `limit`, SI: the log odds that they clip, and when they do, s after `first_ns`."""

    channel: int
    limit: float
    log_odds: float
    at_s: Floats


def flat_top(channel: int, at_s: Floats, values: Floats, step: float, noise: float) -> FlatTop | None:
    """What a channel's furthest readings tell, unfiltered values (n,); None where they tell nothing.

    `step` is their resolution, `noise` the standard deviation of what is white in them: two of the same value are alike
    with a chance of step / (2 sqrt(pi) noise).
    """
    if channel == _UPRIGHT and np.ptp(values) == 0.0 and 0.0 < values[0] < _OF_GRAVITY * STANDARD_GRAVITY_MPS2:
        return FlatTop(channel, float(values[0]), _ALL_THE_WAY, at_s)
    if step <= 0.0 or not noise > 0.0 or not np.isfinite(values).all():
        return None
    furthest = float(np.max(np.abs(values)))
    at_end = np.abs(values) > furthest - 0.5 * step
    alike = np.abs(np.diff(values)) < 0.5 * step
    both, neither = at_end[1:] & at_end[:-1], ~(at_end[1:] | at_end[:-1])
    repeated = alike & both
    if not repeated.any() or not neither.any():
        return None
    by_chance = max(float(np.mean(alike[neither])), step / (2.0 * math.sqrt(math.pi) * noise), _RARELY)
    odds = -float(np.count_nonzero(repeated)) * math.log(by_chance)
    return FlatTop(channel, furthest, odds, at_s[1:][repeated]) if by_chance < _OFTEN and odds > _LEAST else None
