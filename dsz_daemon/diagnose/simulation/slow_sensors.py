"""Sensors that follow slowly, and are late: what they show of what there is, and what there was of what they tell."""

from __future__ import annotations

from typing import Any

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.simulation.instruments import delayed, followed, swung
from dsz_daemon.diagnose.simulation.rolling import earlier

Floats = np.ndarray[Any, np.dtype[np.float64]]

_FOLLOWS, _LATE = INDEX["sensor_bandwidth.time_constant_s"], INDEX["imu_delay.delay_s"]
_SWINGS = tuple(INDEX[f"soft_mount.{name}"] for name in ("per_w2_s2", "damping", "carried"))
# Of gyros and accelerometers, and of nothing that is no IMU's.
_SHOWN = [INDEX[f"soft_mount.{name}"] for name in ("gyros", "gyros", "gyros", "accel_x", "accel_y", "accel_z")]
_CLOCK, _LATER = INDEX["imu_clock.late_s"], INDEX["imu_clock.per_s"]


def smoothed(reads: Floats, x: Floats) -> Floats:
    """Readings (n, c) of sensors that follow slowly, and are late: from the middle of the time on by more, or less."""
    per_w2_s2, damping, carried = x[list(_SWINGS)].tolist()
    if per_w2_s2 > 0.0:
        swings = swung(reads, per_w2_s2**-0.5, damping, DT_S, carried)
        reads = reads + x[_SHOWN] * (swings - reads)
    if x[_FOLLOWS] > 0.0:
        reads = followed(reads, float(x[_FOLLOWS]), DT_S)
    late_s, later = float(x[_LATE] + x[_CLOCK]), float(x[_LATER])
    return delayed(reads, late_s, DT_S, later) if late_s != 0.0 or later != 0.0 else reads


def in_time(told: Floats, x: Floats) -> Floats:
    """What there was (n,), of what an IMU told that is late and follows slowly: T y' = x - y."""
    slowly_s = float(x[_FOLLOWS])
    there = told + slowly_s * np.gradient(told, DT_S) if slowly_s > 0.0 else told
    return earlier(there, float(x[_LATE]))
