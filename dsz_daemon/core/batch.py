"""Many steps at once over arrays, for whoever has all of a drive's inputs: the same `step`, compiled where numba is.

The functions of this room stay plain Python for whoever calls them; numba compiles the same ones for its own use.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dsz_daemon.compiled import compiled_with
from dsz_daemon.core import (
    attitude,
    bicycle,
    curve,
    doubt,
    gates,
    kinematics,
    linear,
    motion,
    parameters,
    speed,
    stiffness,
    zeroing,
)
from dsz_daemon.core import step as stepping
from dsz_daemon.core.outputs import ChannelOutput
from dsz_daemon.core.parameters import Car, Inputs, Tuning
from dsz_daemon.core.state import EstimatorState
from dsz_daemon.core.step import advanced, channel_output

Floats = np.ndarray[Any, np.dtype[np.float64]]

# The columns of a run: six each of these, in the order of `signals.IMU_CHANNELS`; then EXTRAS.
OFFSET, STD, STATE, GATE, REASON = range(0, 30, 6)
EXTRAS = ("speed_mps", "sideslip_rad", "yaw_rate_model_radps", "standstill")
COLUMNS = 30 + len(EXTRAS)


def _put(row: Floats, axis: int, channel: ChannelOutput) -> None:
    row[OFFSET + axis] = channel.offset
    row[STD + axis] = channel.offset_std
    row[STATE + axis] = channel.state.value
    row[GATE + axis] = 1.0 if channel.gate else 0.0
    row[REASON + axis] = channel.reason.value


def _run(car: Car, tuning: Tuning, state: EstimatorState, inputs: Floats, dt_s: float, rows: Floats) -> EstimatorState:
    for i in range(len(inputs)):
        x, row = inputs[i], rows[i]
        now = Inputs(x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11], x[12], x[13])
        state, seen = advanced(car, tuning, state, now, dt_s)
        _put(row, 0, channel_output(seen.inputs.gyro_x, state.gyro_x, tuning.gyro_x, seen.reasons[0]))
        _put(row, 1, channel_output(seen.inputs.gyro_y, state.gyro_y, tuning.gyro_y, seen.reasons[1]))
        _put(row, 2, channel_output(seen.inputs.gyro_z, state.gyro_z, tuning.gyro_z, seen.reasons[2]))
        _put(row, 3, channel_output(seen.inputs.accel_x, state.accel_x, tuning.accel_x, seen.reasons[3]))
        _put(row, 4, channel_output(seen.inputs.accel_y, state.accel_y, tuning.accel_y, seen.reasons[4]))
        _put(row, 5, channel_output(seen.inputs.accel_z, state.accel_z, tuning.accel_z, seen.reasons[5]))
        row[30] = seen.motion.v if seen.motion.speed_valid else math.nan
        row[31] = state.observer.sideslip_rad if seen.motion.speed_valid else math.nan
        row[32] = state.observer.yaw_rate_radps if seen.motion.speed_valid else math.nan
        row[33] = 1.0 if seen.motion.standstill else 0.0
    return state


_ROOM = (
    attitude,
    bicycle,
    curve,
    doubt,
    gates,
    kinematics,
    linear,
    motion,
    parameters,
    speed,
    stiffness,
    stepping,
    zeroing,
)
_compiled_run = compiled_with(_run, (_put,), _ROOM)


def run(car: Car, tuning: Tuning, state: EstimatorState, inputs: Floats, dt_s: float) -> tuple[EstimatorState, Floats]:
    """Step through `inputs` (n, 14: the fields of `Inputs` in their order), dt_s apart.

    Returns the last state and the rows (n, COLUMNS): per channel offset, spread, state, gate and reason (the last
    three as numbers), then EXTRAS; SI. One call of `step` after the other gives the same.
    """
    rows = np.full((len(inputs), COLUMNS), math.nan)
    return _compiled_run(car, tuning, state, np.ascontiguousarray(inputs, dtype=np.float64), dt_s, rows), rows
