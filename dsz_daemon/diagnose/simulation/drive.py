"""One recording with the car as configured: what the simulation is driven by, and held against."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, Vocabulary
from dsz_daemon.diagnose.recordings.recording import REFERENCE, Recording
from dsz_daemon.signals import IMU_CHANNELS

Floats = np.ndarray[Any, np.dtype[np.float64]]
# What is compared: the IMU, the wheels that don't give the speed, the difference (right less left) of the others, and
# what a reference brings.
CHANNELS = (
    *IMU_CHANNELS,
    "wheel_other_left",
    "wheel_other_right",
    "wheel_difference",
    *(f"reference_{name}" for name in REFERENCE),
)
_NONE = np.zeros(len(CHANNELS))


class Drive(NamedTuple):
    """One recording with the car as configured; `steer`, `wheels`, `measured` (n, 13) are the recording's own.

    `theirs` (n, 13): what the user's simulation has more than the nominal one, taken off `measured`. `steps` (13,):
    what the steering's resolution leaves in each channel, rms, which is the same for `steps_rows` (13,). `noise`
    (n, 6): what more noise on wheel speeds and steering, as much as they have, does to the IMU's channels. `told_steer`
    (n,): `steer` before its low-pass.
    """

    car: Car
    steering_ratio: float
    recording: Recording
    steer: Floats
    wheels: Floats
    measured: Floats
    front_gives_speed: bool
    vocabulary: Vocabulary = BUILT_IN
    theirs: Floats | None = None
    steps: Floats = _NONE
    steps_rows: Floats = _NONE
    noise: Floats | None = None
    told_steer: Floats = np.zeros(0)


def nothing(vocabulary: Vocabulary = BUILT_IN) -> Floats:
    """All parameters at 0: the nominal simulation."""
    return np.zeros(len(vocabulary.columns))
