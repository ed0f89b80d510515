"""A recording and a car, made ready for the simulation, by itself or against a simulation of the user's own."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, Vocabulary
from dsz_daemon.diagnose.recordings.recording import REFERENCE, Recording, filtered
from dsz_daemon.diagnose.residuals.inputs import with_noise, with_steps
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats, nothing
from dsz_daemon.diagnose.simulation.prediction import ALONG, ALONG_KERNEL, predicted
from dsz_daemon.diagnose.simulation.road import flat


def drive_of(recording: Recording, car: Car, steering_ratio: float, vocabulary: Vocabulary = BUILT_IN) -> Drive:
    """A drive; short holes in steering and wheel speeds are bridged for the simulation's sake."""
    front = car.rear_driven and not car.front_driven
    steer = _bridged(recording.road_wheel_angle_rad)
    wheels = np.column_stack([_bridged(recording.wheels_mps[:, i]) for i in range(4)])
    own, other = ((0, 1), (2, 3)) if front else ((2, 3), (0, 1))
    raw = recording.wheels_mps
    beside = recording.reference
    if beside is None:
        beside = np.full((len(raw), len(REFERENCE)), np.nan)
    measured = np.column_stack(
        [recording.imu, raw[:, other[0]], raw[:, other[1]], raw[:, own[1]] - raw[:, own[0]], beside]
    )
    measured[:, ALONG] = filtered(measured[:, ALONG], ALONG_KERNEL)
    told = steer if recording.told_rad is None else _bridged(recording.told_rad)
    drive = Drive(car, steering_ratio, recording, steer, wheels, measured, front, vocabulary, told_steer=told)
    return with_noise(with_steps(drive))


def against(drive: Drive, simulated: Mapping[str, Floats]) -> Drive:
    """The drive held against the user's simulation: channels (n,) by name, SI; no others are compared.

    What an effect does is the difference that it makes in the nominal simulation.
    """
    nominal = predicted(drive, nothing(drive.vocabulary), flat(len(drive.steer)))
    theirs = np.full_like(nominal, np.nan)
    for channel, values in simulated.items():
        c = CHANNELS.index(channel)
        theirs[:, c] = (filtered(values, ALONG_KERNEL) if c == ALONG else values) - nominal[:, c]
    return drive._replace(measured=drive.measured - theirs, theirs=theirs)


def _bridged(values: Floats) -> Floats:
    known = np.flatnonzero(np.isfinite(values))
    if len(known) == 0:
        return np.zeros(len(values))
    return np.asarray(np.interp(np.arange(len(values)), known, values[known]), dtype=np.float64)
