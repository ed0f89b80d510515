"""What is uncertain about the signals that drive the simulation, and what the car as configured makes of that.

Steps of the steering leave something in every channel. Noise of wheel speeds and steering is in every prediction, and
an effect that smooths a prediction takes it off again: it makes what is left smaller and tells nothing of the car. A
sensor that follows slowly does so, one that is late does not, so that of the two the slow one would always leave less.
"""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import filter_kernel, filtered
from dsz_daemon.diagnose.residuals.comparison import EVERY, noises
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats, nothing
from dsz_daemon.diagnose.simulation.prediction import Ints, predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.simulation.slow_sensors import smoothed
from dsz_daemon.signals import IMU_CHANNELS

# A stable car turns no more than so many times as much as one that steers neutrally, v/L: more is a car that spins.
_YAW, _MOST_TURNS = 2, 3.0
_SHOW_A_TURN = [_YAW, 4]
# What makes a car answer its steering more slowly; where rounding is so much of the yaw rate's noise (power), that is
# less of it: a hand wheel in steps of 1.5 degrees, ten times a second, was twice the yaw inertia.
_SLOWER = [
    INDEX[name] for name in ("yaw_inertia.share", "tyre_relaxation.relaxation_length_m", "steering_lag.time_constant_s")
]
_COARSE = 0.25
_IMU = len(IMU_CHANNELS)
# Which noise it is makes no difference.
_RNG_SEED = 0


# A car that is unstable as it is configured makes anything of it, which tells nothing.
@np.errstate(over="ignore", invalid="ignore")
def with_steps(drive: Drive) -> Drive:
    """The same with what the car as configured makes of what rounding may have done to the steering."""
    rounding_rad, level = drive.recording.rounding_rad, flat(len(drive.steer))
    rows = rolling_rows(drive)
    if rounding_rad is None or not len(rows):
        return drive
    right = predicted(drive, nothing(drive.vocabulary), level)[rows]
    every = np.ones((len(rows), len(CHANNELS)), np.bool_)
    power, lasts = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS))
    for left_rad in np.nan_to_num(rounding_rad):
        rounded = drive._replace(steer=drive.steer + left_rad)
        off = predicted(rounded, nothing(drive.vocabulary), level)[rows] - right
        power += np.mean(off**2, axis=0) / len(rounding_rad)
        lasts += correlated_rows(off, every) / len(rounding_rad)
    turns = np.hypot.reduce([_neutral(drive, drive, rows, left_rad) for left_rad in np.nan_to_num(rounding_rad)])
    if not math.sqrt(power[_YAW]) <= _MOST_TURNS * turns / math.sqrt(len(rounding_rad)):
        return drive
    return drive._replace(steps=np.sqrt(power), steps_rows=lasts)


def _neutral(drive: Drive, other: Drive, rows: Ints, left_rad: Floats) -> float:
    """How much more a car turns that steers neutrally, v steer / L, by other wheels and steering; rms, rad/s."""
    more = np.mean(other.wheels, axis=1) * (drive.steer + left_rad) - np.mean(drive.wheels, axis=1) * drive.steer
    return float(np.sqrt(np.mean(more[rows] ** 2))) / drive.car.wheelbase_m


@np.errstate(over="ignore", invalid="ignore")
def with_noise(drive: Drive) -> Drive:
    """The same with what as much noise again on wheel speeds and steering does to the IMU's channels."""
    rows = rolling_rows(drive)
    if not len(rows):
        return drive
    kernel, (n, wheels) = filter_kernel(), drive.wheels.shape
    white = np.random.default_rng(_RNG_SEED).standard_normal((wheels, n))
    noise = np.column_stack([filtered(one, kernel) for one in white]) / math.sqrt(float(np.sum(kernel**2)))
    rounding_rad = drive.recording.rounding_rad
    left_rad = np.zeros(n) if rounding_rad is None else np.nan_to_num(rounding_rad[0])
    more_mps = np.nan_to_num(drive.recording.floor[-wheels:]) * noise
    noisier = drive._replace(wheels=drive.wheels + more_mps, steer=drive.steer + left_rad)
    x, level = nothing(drive.vocabulary), flat(n)
    more = predicted(noisier, x, level) - predicted(drive, x, level)
    if not np.sqrt(np.mean(more[rows, _YAW] ** 2)) <= _MOST_TURNS * _neutral(drive, noisier, rows, left_rad):
        return drive
    return drive._replace(noise=np.nan_to_num(more[:, :_IMU]))


def smoothed_away(drive: Drive, x: Floats) -> Floats:
    """Power (13,) of the inputs' noise that the IMU's delay and bandwidth take off a prediction, and a slower car.

    What swings adds to it: that is not taken off what is left, which has less of it than it is thought to have.
    """
    taken = _by_a_slower_car(drive, x)
    if drive.noise is not None and (after := smoothed(drive.noise, x)) is not drive.noise:
        rows = rolling_rows(drive)
        taken[:_IMU] += np.maximum(np.mean(drive.noise[rows] ** 2 - after[rows] ** 2, axis=0), 0.0)
    return taken


@np.errstate(over="ignore", invalid="ignore")
def _by_a_slower_car(drive: Drive, x: Floats) -> Floats:
    """Power (13,) of what rounding the steering does that a car takes off which answers it more slowly."""
    rounding_rad, taken = drive.recording.rounding_rad, np.zeros(len(CHANNELS))
    is_coarse = drive.steps[_YAW] ** 2 > _COARSE * np.nan_to_num(noises(drive)[_YAW]) ** 2
    if rounding_rad is None or not is_coarse or not x[_SLOWER].any():
        return taken
    # A smaller model has no numbers of the shapes that a larger one's vocabulary has.
    x = np.pad(x, (0, len(drive.vocabulary.columns) - len(x)))
    as_quick, level = x.copy(), flat(len(drive.steer))
    as_quick[_SLOWER] = 0.0
    rounded = drive._replace(steer=drive.steer + np.nan_to_num(rounding_rad[0]))
    rows = rolling_rows(drive)
    quick, slow = (
        np.mean((predicted(rounded, one, level)[rows] - predicted(drive, one, level)[rows]) ** 2, axis=0)
        for one in (as_quick, x)
    )
    taken[_SHOW_A_TURN] = np.nan_to_num(np.maximum(quick - slow, 0.0))[_SHOW_A_TURN]
    return taken


def rolling_rows(drive: Drive) -> Ints:
    """Every row that is compared while the car rolls."""
    return np.flatnonzero(np.mean(drive.wheels, axis=1) > motion.ROLLING_MPS)[::EVERY]
