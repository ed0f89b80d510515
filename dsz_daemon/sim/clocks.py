"""When senders send: each by its own clock, all stamped by the receiver's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.sim.sensors import UnitClock

Stamps = NDArray[np.int64]


def due_us(clock: UnitClock, period_ms: int, phase_us: int, end_s: float) -> Stamps:
    """Return when a message is due on the receiver's clock: us from the drive's begin, before `end_s`."""
    first_us = phase_us + clock.phase_s * 1e6
    period_us = 1000.0 * period_ms * (1.0 + 1e-6 * clock.period_error_ppm)
    end_us = round(end_s * 1e6)
    most = max(0, int((end_us - first_us) / period_us) + 2)
    due: Stamps = np.rint(first_us + period_us * np.arange(most)).astype(np.int64)
    return due[: int(np.searchsorted(due, end_us))]


def stamped_us(due: Stamps, jitter_s: float, rng: np.random.Generator) -> Stamps:
    """Return the receiver's stamps of frames due at `due`: each evenly 0 to `jitter_s` late.

    One sender's frames keep their order: a frame waits for the one before it.
    """
    if jitter_s == 0.0:
        return due
    late = np.floor(rng.random(len(due)) * (jitter_s * 1e6)).astype(np.int64)
    return np.maximum.accumulate(due + late)
