"""A car that goes backwards while its wheel speeds have no sign: yaw gyro and accelerometer show it the other way."""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.recordings.recording import DT_S, Recording, without_steering
from dsz_daemon.diagnose.residuals.comparison import Bools
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.simulation.drive import Floats
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

# From one stop to the next; in less time nothing is told, and no car goes backwards faster.
_STANDS_MPS, _LEAST_S, _FASTEST_MPS = 0.15, 1.0, 8.0
# How far a gyro or an accelerometer goes with what wheels and steering say, -1 to 1: of 33 runs of eight drives an
# accelerometer had 0.63 to 1.0 forwards, and both -0.99 to -1.0 backwards. What these hardly say is not asked.
_THE_OTHER_WAY, _LEAST_RADPS, _LEAST_MPS2 = -0.8, 0.02, 0.2
# Standing rows that tell a gyro's offset.
_FEWEST = 50
# As far as filters reach, before and after.
_FILTERED_S = 0.3
_YAW, _ALONG = IMU_CHANNELS.index("gyro_z"), IMU_CHANNELS.index("accel_x")


def backwards(recording: Recording, wheelbase_m: float) -> list[tuple[float, float]]:
    """When the car goes backwards, s, from a stop to a stop each; none where all of it would be backwards.

    Of a run from stop to stop the yaw rate is v tan(delta)/L and the acceleration v', both the other way round. The one
    that the run hardly has is not asked. A gyro or an accelerometer that is the other way in every run is reversed.
    """
    wheels = np.mean(recording.wheels_mps, axis=1)
    v = np.nan_to_num(wheels)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], v > _STANDS_MPS, [0])).astype(np.int64))).reshape(-1, 2)
    resting = np.isfinite(wheels) & (v <= _STANDS_MPS)
    turns, speeds_up = wheels * np.tan(recording.road_wheel_angle_rad) / wheelbase_m, np.gradient(wheels, DT_S)
    gyro, along = recording.imu[:, _YAW] - _at_rest(recording.imu[:, _YAW], resting), recording.imu[:, _ALONG]

    def agree(first: int, after: int) -> list[float]:
        run, said = slice(first, after), list[float]()
        both = np.isfinite(turns[run]) & np.isfinite(gyro[run])
        if _rms(turns[run][both]) > _LEAST_RADPS:
            said.append(_agree(turns[run][both], gyro[run][both]))
        both = np.isfinite(speeds_up[run]) & np.isfinite(along[run])
        if _rms(speeds_up[run][both]) > _LEAST_MPS2:
            said.append(_agree(*(one[run][both] - np.mean(one[run][both]) for one in (speeds_up, along))))
        return said

    found, forwards = [], False
    for first, after in edges.tolist():
        if (after - first) * DT_S < _LEAST_S:
            continue
        agreed = agree(first, after)
        if not agreed:
            continue
        if max(agreed) < _THE_OTHER_WAY and np.max(v[first:after]) < _FASTEST_MPS:
            found.append((float(recording.time_s[first]), float(recording.time_s[after - 1])))
        elif min(agreed) > 0.0:
            forwards = True
    return found if forwards else []


def without_them(recording: Recording, stretches: list[tuple[float, float]]) -> Recording:
    """The recording with no steering while the car goes backwards: what the simulation is driven by is not known there.

    Its wheel speeds stay: they say that it moves.
    """
    there = np.zeros(len(recording.time_s), dtype=np.bool_)
    for begin_s, end_s in stretches:
        there |= (recording.time_s > begin_s - _FILTERED_S) & (recording.time_s < end_s + _FILTERED_S)
    return without_steering(recording, there)


def as_shapes(recording: Recording, stretches: list[tuple[float, float]]) -> list[Shape]:
    """What is said of one or more: each wheel reads -1 times its speed, which is -2 of it more."""
    when = " and ".join(f"from {begin_s:.1f} to {end_s:.1f} s" for begin_s, end_s in stretches)
    share = sum(end_s - begin_s for begin_s, end_s in stretches) / (DT_S * len(recording.time_s))
    wheels = zip(WHEEL_SPEEDS, recording.floor[len(IMU_CHANNELS) :], strict=True)
    fastest = max(float(np.nanmax(np.mean(recording.wheels_mps, axis=1)[_rows(recording, one)])) for one in stretches)
    return [Shape(w, f"k*vx {when}", Coefficient(-2.0, noise / fastest, "(m/s)/(m/s)"), share) for w, noise in wheels]


def _rows(recording: Recording, stretch: tuple[float, float]) -> slice:
    return slice(*np.searchsorted(recording.time_s, stretch).tolist())


def _at_rest(gyro: Floats, resting: Bools) -> float:
    """A gyro's offset: its middle at rest, or of all there is where it hardly rests."""
    there = resting & np.isfinite(gyro)
    if np.count_nonzero(there) < _FEWEST:
        there = np.isfinite(gyro)
    return float(np.median(gyro[there])) if there.any() else math.nan


def _agree(said: Floats, felt: Floats) -> float:
    """How far one goes with the other, -1 to 1; 0 where nothing is felt."""
    power = float(said @ said) * float(felt @ felt)
    return float(said @ felt) / math.sqrt(power) if power > 0.0 else 0.0


def _rms(values: Floats) -> float:
    return math.sqrt(float(np.mean(values**2))) if len(values) else 0.0
