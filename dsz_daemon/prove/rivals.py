"""Who else could answer: gradient boosting that fits and names nothing, and sparse regression that names its terms.

Both see what the refitted nominal simulation leaves (fit.parquet: measured less nominal) and that simulation's motion.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Mapping
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.errors import MachineError
from dsz_daemon.signals import IMU_CHANNELS

Array = NDArray[np.float64]

# Rows at 25 Hz; blocks of 5 s, of which every second one is unseen, and then the others.
_EVERY, _BLOCK_ROWS = 4, 125
_LAGS_ROWS = (0, 8)
_ROUNDS = 40
# Of a term with variance 1, in the channel's noise: what is less is no term.
_THRESHOLD = 0.3
# Of a term's power: speed and its square go together on any drive.
_RIDGE = 0.05
# What a term of a channel is taken for; pysindy knows terms, an engineer names them.
_NAMES = {
    "gyro_x": {"r": "gyro_cross_axis", "ay'": "suspension_roll"} | dict.fromkeys(("ax", "ay"), "gyro_g_sensitivity"),
    "gyro_y": {"r": "gyro_cross_axis", "ax'": "suspension_pitch"} | dict.fromkeys(("ax", "ay"), "gyro_g_sensitivity"),
    "gyro_z": {"r": "gyro_scale", "r'": "steering_delay", "v": "steering_offset", "ay": "steering_ratio"},
    "accel_x": {"ax": "accel_scale", "ay": "imu_misalignment", "r^2": "imu_lever_arm", "ax'": "wheel_speed_delay"},
    "accel_y": {"ay": "accel_scale", "ax": "imu_misalignment", "r'": "imu_lever_arm", "ay'": "steering_delay"},
    "accel_z": {"ay": "accel_cross_axis", "ax": "accel_cross_axis"},
    "wheel_other_left": {"v": "wheel_radius", "ax": "wheel_slip"},
    "wheel_other_right": {"v": "wheel_radius", "ax": "wheel_slip"},
}


class Rivals(NamedTuple):
    """What unseen rows lose by boosting, of all but the noise (None: nothing to lose); what sparse regression names."""

    boosted: float | None
    sparse: str


UNASKED = Rivals(None, "nothing")


def rivals(fitted: Mapping[str, Any], fit: Mapping[str, Mapping[str, Any]]) -> Rivals:
    """`fitted`: columns of fit.parquet; `fit`: that of diagnosis.json, which has the channels' noise.

    MachineError: the extra is not installed.
    """
    ensemble, sindy = boosting_and_regression()
    terms = _terms(fitted)
    left = {
        channel: (fitted[f"{channel}_measured"] - fitted[f"{channel}_nominal"])[::_EVERY]
        for channel in _NAMES
        if f"{channel}_measured" in fitted
    }
    moving = terms["v"] > 3.0
    used = {channel: moving & np.isfinite(course) for channel, course in left.items()}
    return Rivals(_boosted(ensemble, terms, left, used, fit), _sparse(sindy, terms, left, used, fit))


def boosting_and_regression() -> tuple[ModuleType, ModuleType]:
    """scikit-learn's ensembles and pysindy. MachineError where they are not installed."""
    try:
        return importlib.import_module("sklearn.ensemble"), importlib.import_module("pysindy")
    except ImportError:
        raise MachineError("the rivals need scikit-learn and pysindy: pip install dsz-daemon[prove]") from None


def _terms(fitted: Mapping[str, Any]) -> dict[str, Array]:
    """The nominal simulation's motion, at 25 Hz, and its rates."""
    v = np.nan_to_num(fitted["wheel_other_left_measured"])
    r, ax, ay = (np.nan_to_num(fitted[f"{name}_nominal"]) for name in ("gyro_z", "accel_x", "accel_y"))
    time_s = fitted["time_s"]
    found = {"v": v, "r": r, "ax": ax, "ay": ay, "r'": np.gradient(r, time_s), "ax'": np.gradient(ax, time_s)}
    found |= {"ay'": np.gradient(ay, time_s), "r^2": r * r, "v^2": v * v, "ay^3": ay**3, "t": time_s - time_s[0]}
    return {name: np.asarray(course[::_EVERY], dtype=np.float64) for name, course in found.items()}


def _noise(fit: Mapping[str, Mapping[str, Any]], channel: str) -> float:
    return float(fit[channel]["noise_floor"] or 0.0) if channel in fit else 0.0


def _boosted(
    ensemble: Any,
    terms: Mapping[str, Array],
    left: Mapping[str, Array],
    used: Mapping[str, NDArray[np.bool_]],
    fit: Mapping[str, Mapping[str, Any]],
) -> float | None:
    limits = importlib.import_module("threadpoolctl").threadpool_limits
    table = np.column_stack([np.roll(course, lag) for course in terms.values() for lag in _LAGS_ROWS])
    seen = (np.arange(len(table)) // _BLOCK_ROWS) % 2 == 0
    before, after = 0.0, 0.0
    for channel in IMU_CHANNELS:
        noise = _noise(fit, channel)
        if channel not in left or noise == 0.0 or np.count_nonzero(used[channel]) < 4 * _BLOCK_ROWS:
            continue
        mine, rest = used[channel], np.zeros(len(table))
        for half in (seen, ~seen):
            model = ensemble.HistGradientBoostingRegressor(max_iter=_ROUNDS, random_state=0)
            # Several trials are scored side by side: a thread each.
            with limits(1):
                model.fit(table[mine & half], left[channel][mine & half])
                rest[mine & ~half] = left[channel][mine & ~half] - model.predict(table[mine & ~half])
        before += max(float(np.mean(left[channel][mine] ** 2)) / noise**2 - 1.0, 0.0)
        after += max(float(np.mean(rest[mine] ** 2)) / noise**2 - 1.0, 0.0)
    return 1.0 - after / before if before > 1.0 else None


def _sparse(
    sindy: Any,
    terms: Mapping[str, Array],
    left: Mapping[str, Array],
    used: Mapping[str, NDArray[np.bool_]],
    fit: Mapping[str, Mapping[str, Any]],
) -> str:
    """The name of the term that explains most, over a channel's noise; "nothing" without one."""
    best, said = 0.0, "nothing"
    names, courses = list(terms), np.column_stack(list(terms.values()))
    for channel, course in left.items():
        # Wheels have their noise only in counts.
        mine, noise = used[channel], _noise(fit, channel) or 0.003
        if np.count_nonzero(mine) < 4 * _BLOCK_ROWS:
            continue
        table = courses[mine] - courses[mine].mean(axis=0)
        spread = np.maximum(table.std(axis=0), 1e-12)
        optimizer = sindy.STLSQ(threshold=_THRESHOLD, alpha=_RIDGE * len(table))
        target = ((course[mine] - course[mine].mean()) / noise).reshape(-1, 1)
        with warnings.catch_warnings():
            # Where all that is left is noise, no term is an answer.
            warnings.simplefilter("ignore", UserWarning)
            found = np.ravel(optimizer.fit(table / spread, target).coef_)
        place = int(np.argmax(np.abs(found)))
        if abs(found[place]) > best:
            best, said = abs(float(found[place])), _NAMES[channel].get(names[place], f"{channel} {names[place]}")
    return said
