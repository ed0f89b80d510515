"""The estimator's whole memory: saving it and resuming equals never stopping."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple, get_type_hints

from dsz_daemon.core import attitude, bicycle, curve, doubt, gates, speed, stiffness, zeroing
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
    curve: curve.CurveState


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
        curve=curve.CurveState(),
    )


def resumed(state: EstimatorState, tuning: Tuning, away_s: float) -> EstimatorState:
    """The state after `away_s` without data: what was learnt stays (less sure), motion starts afresh."""
    fresh = initial_state(tuning)
    return fresh._replace(
        gyro_x=zeroing.held(doubt.unlooked(state.gyro_x), tuning.gyro_x, away_s),
        gyro_y=zeroing.held(doubt.unlooked(state.gyro_y), tuning.gyro_y, away_s),
        gyro_z=zeroing.held(doubt.unlooked(state.gyro_z), tuning.gyro_z, away_s),
        accel_x=zeroing.held(doubt.unlooked(state.accel_x), tuning.accel_x, away_s),
        accel_y=zeroing.held(doubt.unlooked(state.accel_y), tuning.accel_y, away_s),
        accel_z=zeroing.held(doubt.unlooked(state.accel_z), tuning.accel_z, away_s),
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


@cache
def _hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)


def _built(kind: Any, plain: Any, where: str) -> Any:
    if not hasattr(kind, "_fields"):
        return _number(plain, where) if kind is float else _numbers(plain, where)
    if not isinstance(plain, dict) or set(plain) != set(kind._fields):
        raise ValueError(f"{where}: expected the fields {', '.join(kind._fields)}")
    hints = _hints(kind)
    return kind(**{name: _built(hints[name], plain[name], f"{where}.{name}") for name in kind._fields})


def _numbers(plain: Any, where: str) -> tuple[float, ...]:
    """A list of one number a signal: the only kind of list that there is."""
    if not isinstance(plain, list) or len(plain) != gates.SIGNALS + 1:
        raise ValueError(f"{where}: expected {gates.SIGNALS + 1} numbers")
    return tuple(_number(item, where) for item in plain)


def _number(plain: Any, where: str) -> float:
    if isinstance(plain, bool) or not isinstance(plain, int | float):
        raise ValueError(f"{where}: {_shown(plain)} is not a number")  # noqa: TRY004 - bad data, whatever its type
    try:
        return float(plain)
    except OverflowError:
        raise ValueError(f"{where}: a whole number of {plain.bit_length()} bits is too large") from None  # type: ignore[union-attr]


def _shown(value: Any) -> str:
    """What it is in few characters; what is nested may be nested so deeply that it can't be written out."""
    return repr(value[:40]) if isinstance(value, str) else str(value) if value is None else type(value).__name__
