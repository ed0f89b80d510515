"""The estimator's whole memory: saving it and resuming equals never stopping."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, get_type_hints

from dsz_daemon.core import attitude, bicycle, gates, speed, stiffness, zeroing
from dsz_daemon.core.parameters import Tuning
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
    """Nothing learnt yet."""
    return EstimatorState(
        gyro_x=zeroing.unlearnt(tuning.gyro_x),
        gyro_y=zeroing.unlearnt(tuning.gyro_y),
        gyro_z=zeroing.unlearnt(tuning.gyro_z),
        accel_x=zeroing.unlearnt(tuning.accel_x),
        accel_y=zeroing.unlearnt(tuning.accel_y),
        accel_z=zeroing.unlearnt(tuning.accel_z),
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


Plain = dict[str, Any]


def as_plain(state: EstimatorState) -> Plain:
    """The state as nested dictionaries of numbers, by field name: what JSON or any store can hold."""
    return _plain(state)  # type: ignore[no-any-return]


def _plain(value: Any) -> Any:
    if hasattr(value, "_asdict"):
        return {name: _plain(item) for name, item in value._asdict().items()}
    return list(value) if isinstance(value, tuple) else value


def from_plain(plain: Plain) -> EstimatorState:
    """The state that `as_plain` gave. Raises ValueError where a field is missing, unknown or no number."""
    return _built(EstimatorState, plain, "state")  # type: ignore[no-any-return]


def _built(kind: Any, plain: Any, where: str) -> Any:
    if not hasattr(kind, "_fields"):
        return _number_or_numbers(plain, where)
    if not isinstance(plain, dict) or set(plain) != set(kind._fields):
        raise ValueError(f"{where}: expected the fields {', '.join(kind._fields)}")
    hints = get_type_hints(kind)
    return kind(**{name: _built(hints[name], plain[name], f"{where}.{name}") for name in kind._fields})


def _number_or_numbers(plain: Any, where: str) -> float | tuple[float, ...]:
    if isinstance(plain, list):
        return tuple(float(_number_or_numbers(item, where)) for item in plain)  # type: ignore[arg-type]
    if isinstance(plain, bool) or not isinstance(plain, int | float):
        raise ValueError(f"{where}: {plain!r} is not a number")  # noqa: TRY004 - bad data, whatever its type
    return float(plain)
