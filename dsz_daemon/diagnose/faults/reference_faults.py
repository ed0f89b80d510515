"""A reference in another unit, of another sign or clock would be one more thing to explain: it is refused, by name."""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.recordings.recording import DT_S, REFERENCE, Recording
from dsz_daemon.diagnose.simulation.drive import Floats
from dsz_daemon.errors import InputError

# Wheels that turn quicker tell a speed, and a car that turns by so much (rms) a rate, rad/s.
_MOVING_MPS, _TURNING_RADPS = 2.5, 0.01
# No sensor of cars is off by more than this, either way; and what follows does so by no less.
_FACTOR, _FOLLOWS, _STANDS = 1.3, 0.7, 0.01
# Another clock: as far as it is looked for, from when on it is one, and by how much nearer that comes.
_FARTHEST_S, _LATE_S, _STEP_S, _NEARER = 5.0, 0.3, 0.1, 0.1
_UNITS = {"vx_mps": {3.6: "km/h", 2.237: "mph"}, "yaw_rate_radps": {57.3: "deg/s"}}
_ALIKE = 0.05


def require_same_car(recording: Recording) -> None:
    """InputError: all columns of the reference that are not of this car, in their units, on this clock."""
    if recording.reference is None:
        return
    wheels_mps = np.mean(recording.wheels_mps, axis=1)
    pairs = {
        "vx_mps": (np.where(wheels_mps > _MOVING_MPS, wheels_mps, np.nan), "the wheels' speed"),
        "yaw_rate_radps": (recording.imu[:, 2], "the yaw gyro"),
    }
    faults = []
    for name, (known, what) in pairs.items():
        told = recording.reference[:, REFERENCE.index(name)]
        both = np.isfinite(told) & np.isfinite(known)
        if np.count_nonzero(both) * DT_S < 1.0:
            continue
        fault = _speed_fault(known[both], told[both]) if name == "vx_mps" else _rate_fault(known, told, both)
        if fault:
            faults.append(f"reference {name} {fault} {what}{_unit_of(name, known[both], told[both])}")
    if faults:
        raise InputError(f"{'; '.join(faults)}; expected m/s and rad/s, x forward and z up, on the log's clock")


def _speed_fault(known: Floats, told: Floats) -> str:
    factor = float(np.median(told / known))
    return "" if 1.0 / _FACTOR < factor < _FACTOR else f"is {factor:.3g} times"


def _rate_fault(known: Floats, told: Floats, both: np.ndarray) -> str:
    if np.std(known[both]) < _TURNING_RADPS:
        return ""
    if np.std(told[both]) < _STANDS * np.std(known[both]):
        return "stands still beside"
    follows, factor = _alike(known, told)
    lags = np.arange(-_FARTHEST_S, _FARTHEST_S + _STEP_S, _STEP_S)
    later = [_alike(known, np.roll(told, -round(lag / DT_S)))[0] for lag in lags]
    best = int(np.argmax(later))
    if abs(lags[best]) >= _LATE_S and later[best] > max(follows + _NEARER, _FOLLOWS):
        return f"is {abs(lags[best]):.1f} s {'behind' if lags[best] > 0.0 else 'ahead of'}"
    if follows < -_FOLLOWS:
        return "has another sign than"
    if follows > _FOLLOWS and not 1.0 / _FACTOR < factor < _FACTOR:
        return f"is {factor:.3g} times"
    return ""


def _alike(known: Floats, told: Floats) -> tuple[float, float]:
    """How far one follows the other (a correlation), and by which factor."""
    both = np.isfinite(known) & np.isfinite(told)
    x, y = known[both] - np.mean(known[both]), told[both] - np.mean(told[both])
    if len(x) == 0 or not (np.any(x) and np.any(y)):
        return 0.0, 0.0
    return float(x @ y / np.sqrt((x @ x) * (y @ y))), float(x @ y / (x @ x))


def _unit_of(name: str, known: Floats, told: Floats) -> str:
    x, y = known - np.mean(known), told - np.mean(told)
    factor = float(np.median(told / known)) if name == "vx_mps" else float(x @ y / max(float(x @ x), 1e-12))
    near = [unit for times, unit in _UNITS[name].items() if abs(factor / times - 1.0) < _ALIKE]
    return f" ({near[0]}?)" if near else ""
