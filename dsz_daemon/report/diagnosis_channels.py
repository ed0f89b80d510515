"""What was compared, channel by channel, out of a diagnosis and its columns. Pure; SI throughout."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.diagnose.recordings.recording import ALONG_FILTER_S, DT_S, FILTER_S
from dsz_daemon.diagnose.residuals.comparison import GUARD_S, SLOW_MPS
from dsz_daemon.report.diagnosis_units import real, shown_as
from dsz_daemon.report.display import CHANNEL_NAMES, MINUS, SPEED, Floats, Unit, channel_unit
from dsz_daemon.report.results import mapping
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

Bools = NDArray[np.bool_]

_WHEEL_NAMES = dict(
    zip(
        WHEEL_SPEEDS,
        (f"{side} wheel speed" for side in ("front left", "front right", "rear left", "rear right")),
        strict=True,
    )
)


class Channel(NamedTuple):
    """One compared channel: arrays of shape (rows,), SI; `used` tells which rows residuals are taken of.

    `name` is the vocabulary's, as in the diagnosis; `fit` what the diagnosis says of it, maybe nothing. `is_changed`:
    whether there is a fitted simulation to show beside the nominal one, alike for all channels of a page.
    """

    name: str
    title: str
    unit: Unit
    time_s: Floats
    measured: Floats
    nominal: Floats
    fitted: Floats
    used: Bools
    fit: Mapping[str, Any]
    is_changed: bool = True

    @property
    def before(self) -> Floats:
        """Measured less nominal simulation; NaN in rows that are not compared."""
        return np.where(self.used, self.measured - self.nominal, np.nan)

    @property
    def after(self) -> Floats:
        """Measured less fitted simulation; NaN in rows that are not compared."""
        return np.where(self.used, self.measured - self.fitted, np.nan)

    @property
    def floor(self) -> float:
        """RMS that the sensor's white noise leaves behind the low-pass; NaN where it is not known."""
        return real(self.fit.get("noise_floor"))

    @property
    def filter_s(self) -> float:
        """Width (standard deviation) of the Gaussian low-pass that the channel has passed."""
        return math.hypot(FILTER_S, ALONG_FILTER_S) if self.name == "accel_x" else FILTER_S

    def rms(self, side: str, when: str) -> float:
        """What the diagnosis says: `side` is train or held_out, `when` before or after; NaN where it says nothing."""
        return real(mapping(self.fit.get(side)).get(when))


def channels_of(result: Mapping[str, Any], columns: Mapping[str, Floats]) -> list[Channel]:
    """All channels with a measurement and a simulation, in the order of the columns."""
    time_s = _seconds(columns)
    if time_s is None:
        return []
    speed = _speed(columns)
    found = []
    for key in columns:
        stem = key.removesuffix("_measured")
        trio = [_numbers(columns, f"{stem}_{what}", len(time_s)) for what in ("measured", "nominal", "fitted")]
        if stem == key or trio[0] is None or trio[1] is None or not np.any(np.isfinite(trio[0])):
            continue
        measured, nominal = trio[0], trio[1]
        fitted = nominal if trio[2] is None else trio[2]
        name = _name(stem, result)
        fit = mapping(mapping(result.get("fit")).get(name))
        used = np.isfinite(measured) & np.isfinite(nominal) & np.isfinite(fitted) & _driving(time_s, speed)
        title = _title(stem, name)
        found.append(Channel(name, title, _unit(name, fit), time_s, measured, nominal, fitted, used, fit))
    # Where nothing is missing, what a fit has done without being given a name is no news.
    is_calm = result.get("verdict") == "consistent"
    is_changed = not is_calm and any(_is_apart(channel.nominal, channel.fitted) for channel in found)
    return [channel._replace(is_changed=is_changed) for channel in found]


def title_of(name: str, result: Mapping[str, Any]) -> str:
    """A channel of the diagnosis in words; one wheel's name stands for the difference of its axle."""
    stems = {_name(stem, result): stem for stem in ("wheel_other_left", "wheel_other_right", "wheel_difference")}
    return _title(stems.get(name, name), name)


def unit_of(name: str, result: Mapping[str, Any]) -> Unit:
    """Unit in which a channel of the diagnosis is shown."""
    return _unit(name, mapping(mapping(result.get("fit")).get(name)))


def _is_apart(nominal: Floats, fitted: Floats) -> bool:
    """Whether they differ by more than rounding."""
    apart, size = np.abs(nominal - fitted), np.abs(nominal)
    return bool(np.nanmax(apart, initial=0.0) > 1e-9 * np.nanmax(size, initial=0.0))


def _seconds(columns: Mapping[str, Floats]) -> Floats | None:
    time_s = np.asarray(columns.get("time_s", ()), dtype=np.float64)
    finite = time_s[np.isfinite(time_s)]
    return np.asarray(time_s - finite[0], dtype=np.float64) if len(finite) > 1 else None


def _numbers(columns: Mapping[str, Floats], key: str, rows: int) -> Floats | None:
    values = np.asarray(columns.get(key, ()), dtype=np.float64)
    return values if values.shape == (rows,) else None


def _name(stem: str, result: Mapping[str, Any]) -> str:
    """The vocabulary's name of a column: which axle gives the speed is what the driven axle says."""
    front = mapping(mapping(result.get("settings")).get("vehicle")).get("driven_axle") == "rear"
    front = front or "wheel_speed_rl" in mapping(result.get("fit"))
    wheels = ("rl", "rr", "fr") if front else ("fl", "fr", "rr")
    stems = dict(zip(("wheel_other_left", "wheel_other_right", "wheel_difference"), wheels, strict=True))
    return f"wheel_speed_{stems[stem]}" if stem in stems else stem


def _title(stem: str, name: str) -> str:
    if stem == "wheel_difference":
        return f"{'front' if name.endswith('fr') else 'rear'} wheel speeds, right {MINUS} left"
    return CHANNEL_NAMES.get(name) or _WHEEL_NAMES.get(name) or name


def _unit(name: str, fit: Mapping[str, Any]) -> Unit:
    if name in IMU_CHANNELS:
        return channel_unit(name)
    return SPEED if name in WHEEL_SPEEDS else shown_as("", "", str(fit.get("unit", "1"))).unit


def _speed(columns: Mapping[str, Floats]) -> Floats | None:
    """How fast the car goes, by the wheels that were recorded (simulated, where those have a hole)."""
    for what in ("measured", "nominal"):
        pair = [columns.get(f"wheel_other_{side}_{what}") for side in ("left", "right")]
        known = [np.asarray(values, dtype=np.float64) for values in pair if values is not None]
        if len(known) == 2 and known[0].shape == known[1].shape:
            return np.nan_to_num(0.5 * (known[0] + known[1]))
    return None


def _driving(time_s: Floats, speed_mps: Floats | None) -> Bools:
    """Rows of driving: slow ones, a guard around these and at both ends left out; all where speed is not known."""
    driving = np.ones(len(time_s), dtype=bool)
    if speed_mps is None or len(speed_mps) != len(time_s):
        return driving
    guard = max(round(GUARD_S / step_s(time_s)), 1)
    slow = np.concatenate([[0], np.cumsum(np.pad(speed_mps < SLOW_MPS, guard, constant_values=True))])
    driving[:] = slow[2 * guard + 1 :] == slow[: -2 * guard - 1]
    return driving


def step_s(time_s: Floats) -> float:
    """Time between two rows; the diagnosis' own where there are not two."""
    steps = np.diff(time_s[np.isfinite(time_s)])
    return float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else DT_S
