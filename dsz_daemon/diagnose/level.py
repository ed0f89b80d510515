"""How much is left of each channel, and what that says: the verdict, and how far the numbers are to be trusted."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from dsz_daemon.diagnose.afterwards import gains_by_channel
from dsz_daemon.diagnose.comparison import Each, floors
from dsz_daemon.diagnose.locate import channel_names
from dsz_daemon.diagnose.own_noise import is_its_own
from dsz_daemon.diagnose.prediction import Floats
from dsz_daemon.diagnose.search import Search
from dsz_daemon.signals import IMU_CHANNELS

# A channel that is off by so many times its noise and the simulation's coarseness is not explained.
UNEXPLAINED = 3.0
# So many times more than that a sensor's own noise may be.
_COLOURED = 2.0


def level_of(found: Search) -> dict[str, float]:
    """Per channel: what is left (rms) over what noise and the simulation's own coarseness may leave."""
    n = found.best.sums.counts.sum(axis=0)
    rms = np.sqrt((found.best.sums.left * found.best.scatter**2).sum(axis=0) / np.maximum(n, 1.0))
    expected = np.hypot(floors(found.drive), found.best.form)
    names = channel_names(found.drive)
    return {name: float(rms[c] / expected[c]) for c, name in enumerate(names) if n[c] > 0 and expected[c] > 0.0}


def unexplained_of(found: Search, level: Mapping[str, float]) -> list[str]:
    """Channels that are off by more than noise and coarseness leave, and not by a sensor's own colour of noise."""
    names = channel_names(found.drive)
    return [
        name
        for name, value in level.items()
        if value > UNEXPLAINED
        and (
            name not in IMU_CHANNELS
            or value > _COLOURED * UNEXPLAINED
            or not is_its_own(found.drive, found.rows, found.best.left[:, names.index(name)], names.index(name))
        )
    ]


def verdict(explained: bool, left: bool) -> str:
    """The contract's word for it."""
    if left:
        return "partly_explained" if explained else "unexplained"
    return "explained" if explained else "consistent"


def doubts(found: Search, unexplained: Collection[str]) -> Floats:
    """Of each channel (13,), what is left over what may be, in its usual block: 1, or more where it is not explained.

    The usual one, since blocks in which the simulation is wrong by more say less already.
    """
    names, expected = channel_names(found.drive), np.hypot(floors(found.drive), found.best.form)
    seen, result = found.best.sums.counts > 0, np.ones(len(names))
    for c in (names.index(name) for name in unexplained):
        result[c] = max(1.0, float(np.median(found.best.scatter[seen[:, c], c]) / expected[c]))
    return result


def undoubted(found: Search, effect: str, doubts: Floats, each: Each = map) -> float:
    """What an effect gains where each channel's share says so many times less as the channel is in doubt.

    A simulation that is wrong in one channel may yet be right in another. What is lost is lost.
    """
    by_channel = gains_by_channel(found, effect, each)
    return found.gains[effect] - float(np.sum(np.maximum(by_channel, 0.0) * (1.0 - 1.0 / doubts)))
