"""A whole recording onto the loop's grid at once: what `align.Aligner` does sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.pipeline.align import SWITCH_PATIENCE, SWITCHES
from dsz_daemon.signals import IMU_CHANNELS

Floats = np.ndarray[Any, np.dtype[np.float64]]
Stamps = np.ndarray[Any, np.dtype[np.int64]]


class Signal(NamedTuple):
    """All samples of one role: stamps (n,) in ns, not falling, and values (n,) in SI."""

    t_ns: Stamps
    values: Floats


def ticks_between(first_ns: int, last_ns: int, period_ns: int) -> Stamps:
    """The loop's ticks (n,) of a recording without gaps: whole periods, from its first sample to its last."""
    first = -(-first_ns // period_ns) * period_ns
    return np.arange(first, last_ns + 1, period_ns, dtype=np.int64)


def gridded(signals: Mapping[str, Signal], ticks_ns: Stamps, stale_after_ns: int) -> dict[str, Floats]:
    """Each role's values (n,) at the ticks: an IMU's mean since the tick before, else the last; NaN when stale."""
    return {role: _gridded(role, signal, ticks_ns, stale_after_ns) for role, signal in signals.items()}


def _gridded(role: str, signal: Signal, ticks_ns: Stamps, stale_after_ns: int) -> Floats:
    t_ns, values = signal
    seen = np.searchsorted(t_ns, ticks_ns, side="right")
    last = np.maximum(seen - 1, 0)
    found = values[last]
    if role in IMU_CHANNELS:
        before = np.concatenate(([0], seen[:-1]))
        for i in np.flatnonzero(seen - before > 1).tolist():
            found[i] = np.mean(values[before[i] : seen[i]])
        # Ticks without a new sample keep the mean of the last ones.
        found = found[np.maximum.accumulate(np.where(seen > before, np.arange(len(seen)), 0))]
    patience = SWITCH_PATIENCE if role in SWITCHES else 1.0
    stale = (seen == 0) | (ticks_ns - t_ns[last] > patience * stale_after_ns)
    found[stale] = np.nan
    return found
