"""Readings that come once more, a while later, in between those that are new: a gateway's buffer.

Noise makes it sure: that all channels of a message are the same again to the last digit happens seldom by itself, and
not always after the same time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import IMU_CHANNELS

Floats = np.ndarray[Any, np.dtype[np.float64]]
Ints = np.ndarray[Any, np.dtype[np.int64]]

AGAIN = "k late, once more in between"
# So many readings tell something; what comes more often than so many times is a second sender's one word, or at rest.
_FEWEST, _TIMES = 500, 20
# So many of all readings, and of those that were there before, come again after one and the same time.
_OF_ALL, _OF_THE_SAME = 0.2, 0.8


def told_by_echoes(signals: Mapping[str, Signal]) -> tuple[dict[str, Signal], list[Shape]]:
    """The signals without the IMU's readings that come once more, and what is said of these."""
    found, shapes = dict(signals), list[Shape]()
    for names in _at_once(signals):
        t_ns = signals[names[0]].t_ns
        again, late_s = echoes(t_ns, np.column_stack([signals[name].values for name in names]))
        if not len(again):
            continue
        told = Coefficient(float(np.median(late_s)), float(np.std(late_s) / np.sqrt(len(late_s))), "s")
        for name in names:
            found[name] = Signal(np.delete(t_ns, again), np.delete(signals[name].values, again))
            shapes.append(Shape(name, AGAIN, told, len(again) / len(t_ns)))
    return found, shapes


def echoes(t_ns: Ints, values: Floats) -> tuple[Ints, Floats]:
    """Which readings, of stamps (n,) and values (n, channels), were there before; how long before (s). None: empty."""
    nothing = np.zeros(0, dtype=np.int64), np.zeros(0)
    if len(t_ns) < _FEWEST or not np.isfinite(values).all():
        return nothing
    _, which, times = np.unique(values, axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    order = np.argsort(which, kind="stable")
    same = (np.diff(which[order]) == 0) & (times[which[order[1:]]] <= _TIMES)
    before, after = order[:-1][same], order[1:][same]
    # What only stays the same is no echo.
    apart = after - before > 1
    before, after = before[apart], after[apart]
    step_ns = float(np.median(np.diff(t_ns)))
    if not (len(after) and step_ns > 0.0):
        return nothing
    late_ns = (t_ns[after] - t_ns[before]).astype(np.float64)
    usual_ns = float(np.median(late_ns))
    mine = np.abs(late_ns - usual_ns) <= step_ns
    if np.count_nonzero(mine) < max(_OF_ALL * len(t_ns), _OF_THE_SAME * len(after)):
        return nothing
    return np.sort(after[mine]), 1e-9 * late_ns[mine]


def _at_once(signals: Mapping[str, Signal]) -> list[list[str]]:
    """The IMU's channels by the messages that they come in: those with one and the same stamps."""
    groups: list[list[str]] = []
    for name in (name for name in IMU_CHANNELS if name in signals):
        mine = (group for group in groups if np.array_equal(signals[group[0]].t_ns, signals[name].t_ns))
        if (group := next(mine, None)) is None:
            groups.append([name])
        else:
            group.append(name)
    return groups
