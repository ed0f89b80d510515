"""The steering angle sensor: it sits on the steering wheel, before play and compliance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.sim.sensors import STEERING_QUANTUM_DEG, Counts


def steering_reading_rad(
    steering_wheel_rad: NDArray[np.float64], offset_rad: float, steering_ratio: float
) -> NDArray[np.float64]:
    """Return what the sensor takes the steering wheel's angle for.

    Its zero is wrong by so much that the road wheel stands at reading / ratio + `offset_rad`.
    """
    return steering_wheel_rad - steering_ratio * offset_rad


def steering_counts(reading_rad: NDArray[np.float64], quantum_deg: float = STEERING_QUANTUM_DEG) -> Counts:
    """Return the reading in quanta of the message, left positive, in steps of the sensor's own quantum.

    No more than the message's 16 bits hold, nine turns either way.
    """
    steps = np.rint(np.degrees(reading_rad) / quantum_deg)
    return np.clip(np.rint(steps * quantum_deg / STEERING_QUANTUM_DEG), -(1 << 15), (1 << 15) - 1).astype(np.int64)
