"""What else takes offsets out of an IMU, for comparison: nothing, a mean at standstill, a high-pass.

All get the same readings (n, 6) on the loop's grid (gyros rad/s, accelerometers m/s^2, NaN where missing), know that
z reads g, and return the offset (n, 6) that they would take off at each tick.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dsz_daemon.signals import STANDARD_GRAVITY_MPS2

Floats = np.ndarray[Any, np.dtype[np.float64]]

# A car is known to stand once its wheels have been silent for a second; below their least speed all wheels are.
STILL_BELOW_MPS = 0.1
STILL_FOR_S = 1.0
# Chosen: slower than bends and slopes last, quicker than a drive.
HIGH_PASS_S = 60.0

_LEVEL = np.array([0.0, 0.0, 0.0, 0.0, 0.0, STANDARD_GRAVITY_MPS2])


def raw(readings: Floats, wheels_mps: Floats, dt_s: float) -> Floats:  # noqa: ARG001 - as the others are called
    """Nothing is taken off."""
    return np.zeros_like(readings)


def zero_at_standstill(readings: Floats, wheels_mps: Floats, dt_s: float) -> Floats:
    """The mean over the standstill so far, or over the last one; wheels (n, 4). Before the first: nothing."""
    standing = np.all(np.abs(wheels_mps) < STILL_BELOW_MPS, axis=1)
    offset, wait = np.zeros_like(readings), round(STILL_FOR_S / dt_s)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], standing, [False]))))
    for start, end in edges.reshape(-1, 2).tolist():
        if end - start <= wait:
            continue
        departure = readings[start + wait : end] - _LEVEL
        known = np.maximum(np.cumsum(~np.isnan(departure), axis=0), 1)
        mean = np.nancumsum(departure, axis=0) / known
        offset[start + wait : end] = mean
        offset[end:] = mean[-1]
    return offset


def high_pass(readings: Floats, wheels_mps: Floats, dt_s: float) -> Floats:  # noqa: ARG001
    """A first-order low-pass is taken off; a plain mean until it has seen its own time constant."""
    offset, now = np.zeros_like(readings), np.zeros(readings.shape[1])
    departure = np.nan_to_num(readings - _LEVEL)
    for i in range(len(readings)):
        now += max(1.0 / (i + 1.0), dt_s / HIGH_PASS_S) * (departure[i] - now)
        offset[i] = now
    return offset
