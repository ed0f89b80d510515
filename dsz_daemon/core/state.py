"""The estimator's whole memory: saving it and resuming equals never stopping."""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core import attitude, bicycle, gates, speed, stiffness, zeroing
from dsz_daemon.core.parameters import Tuning, ZeroingTuning
from dsz_daemon.core.zeroing import ZeroingState


class EstimatorState(NamedTuple):
    """Everything that the estimator remembers between two ticks."""

    gyro_x: ZeroingState
    gyro_y: ZeroingState
    gyro_z: ZeroingState
    accel_x: ZeroingState
    accel_y: ZeroingState
    accel_z: ZeroingState
    speed: speed.SpeedState
    observer: bicycle.ObserverState
    attitude: attitude.AttitudeState
    transient: gates.TransientState
    stiffness: stiffness.StiffnessState


def initial_state(tuning: Tuning) -> EstimatorState:
    """Nothing learnt yet. As printed, gamma is constant from the start: the window counts as full."""

    def fresh(law: ZeroingTuning) -> ZeroingState:
        return ZeroingState(learned_s=law.window_s if tuning.as_printed else 0.0)

    return EstimatorState(
        gyro_x=fresh(tuning.gyro_x),
        gyro_y=fresh(tuning.gyro_y),
        gyro_z=fresh(tuning.gyro_z),
        accel_x=fresh(tuning.accel_x),
        accel_y=fresh(tuning.accel_y),
        accel_z=fresh(tuning.accel_z),
        speed=speed.SpeedState(),
        observer=bicycle.ObserverState(),
        attitude=attitude.AttitudeState(),
        transient=gates.TransientState(),
        stiffness=stiffness.initial_stiffness(tuning),
    )


def resumed(state: EstimatorState, tuning: Tuning, away_s: float) -> EstimatorState:
    """The state after `away_s` without data: what was learnt stays (less sure), motion starts afresh."""
    fresh = initial_state(tuning)
    return fresh._replace(
        gyro_x=zeroing.held(state.gyro_x, tuning.gyro_x, away_s),
        gyro_y=zeroing.held(state.gyro_y, tuning.gyro_y, away_s),
        gyro_z=zeroing.held(state.gyro_z, tuning.gyro_z, away_s),
        accel_x=zeroing.held(state.accel_x, tuning.accel_x, away_s),
        accel_y=zeroing.held(state.accel_y, tuning.accel_y, away_s),
        accel_z=zeroing.held(state.accel_z, tuning.accel_z, away_s),
        stiffness=state.stiffness._replace(smoothed_yaw_radps=math.nan),
    )
