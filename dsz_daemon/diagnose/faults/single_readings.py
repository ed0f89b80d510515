"""What single readings tell before any simulation: spikes, every other reading another sensor's, coarse steps.

A reading that is far from both of its neighbours, which agree, is no motion: nothing that moves is back within two
samples. Hits on a line look so, and torn words (one half of a number old), if they are few and far from the noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.diagnose.recordings.recording import least_step, step_of, white_std
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

Floats = np.ndarray[Any, np.dtype[np.float64]]
Ints = np.ndarray[Any, np.dtype[np.int64]]

_FEWEST = 100
# A spike is so many times the white noise away from the mean of its neighbours, which differ by less than so much of
# that. There are so many at least, as large as each other to within so much; and of what is smaller, between these
# parts of their size, there are fewer by this share: what shakes a car has all sizes.
_FAR, _NEIGHBOURS, _SPIKES, _ALIKE, _SMALLER, _FEWER = 8.0, 0.5, 10, 0.15, (0.5, 0.7), 0.1
# What drives the simulation has spikes of any size, from this on: no wheel and no hand is there and back in two
# samples. So many are some, so many none.
_OF_INPUTS = {
    **dict.fromkeys(WHEEL_SPEEDS, (1.0, "m/s")),
    "steering_wheel_angle": (math.radians(20.0), "rad"),
    "road_wheel_angle": (math.radians(2.0), "rad"),
}
_SOME, _NO_SPIKES = 5, 0.05
# A value that comes in between again and again, to the last digit, in runs of no more than so many readings: a second
# sender's, or what a gateway puts for one that is late. So many, no other value as often but for this share of that,
# and no more than so much of all, for then it is the rest.
_RUN, _TIMES, _ANOTHER, _OFTEN = 25, 20, 0.2, 0.6
# Every other reading is another sensor's by so many spreads, and by so much of all that readings differ by.
_SURELY, _MOST = 50.0, 0.3
EVERY_OTHER = "in every other reading"
# A hand wheel whose angle is known no better than by such steps leaves open how it moves: the coarsest in cars are of
# 1.5 degrees.
_COARSE_RAD, STEPS = np.radians(4.0), "steps of k"
# What such steps look like: something that is late, or loose, or lasts.
_BY_THE_HAND = frozenset(
    {"steering_delay", "steering_backlash", "steering_compliance", "tyre_relaxation", "yaw_inertia"}
)
# Nor do wheel speeds that are known no better than by such steps say what comes with them, or with how they change: the
# coarsest of dashboards are of 1 km/h. An analog IMU behind ten bits has 0.7 deg/s and 0.16 m/s2.
_COARSE = {"gyro": (math.radians(1.0), "rad/s"), "accel": (0.25, "m/s^2"), "wheel": (0.5, "m/s")}
_BY_THE_WHEELS = frozenset(
    {
        *("accel_scale", "gyro_scale", "imu_lever_arm", "road_grade", "suspension_pitch", "track_width"),
        *("wheel_radius", "wheel_slip", "wheel_speed_delay", "steering_ratio", "tyre_relaxation", "yaw_inertia"),
        *("steering_compliance", "cornering_stiffness", "mass_loading"),
    }
)
IN_BETWEEN = "k in between"
OWN = dict(zip(IMU_CHANNELS, ("p", "q", "r", "ax", "ay", "az"), strict=True))


class Readings(NamedTuple):
    """The signals without what single readings say for themselves, and what that is."""

    signals: dict[str, Signal]
    shapes: list[Shape]


def readings_of_imu(signals: Mapping[str, Signal]) -> Iterator[tuple[str, Signal]]:
    """The IMU's channels that have enough readings to tell something by themselves, and none missing."""
    for name in IMU_CHANNELS:
        signal = signals.get(name)
        if signal is not None and len(signal.values) >= _FEWEST and np.isfinite(signal.values).all():
            yield name, signal


def told_by_readings(signals: Mapping[str, Signal]) -> Readings:
    """Spikes are left out, two sensors in turn are their mean; what is said of each has its share of the readings."""
    found = Readings(dict(signals), [])
    for name in (*IMU_CHANNELS, *_OF_INPUTS):
        if name in signals and len(between := _in_between(name, signals[name].values)):
            _take_out(found, name, between)
    for name, signal in readings_of_imu(found.signals):
        unit = "rad/s" if name.startswith("gyro") else "m/s^2"
        if others := _every_other(name, signal, unit):
            # In pairs, so that what is white in them stays so.
            even = len(signal.values) // 2 * 2
            first_ns, second_ns = signal.t_ns[:even:2], signal.t_ns[1:even:2]
            values = 0.5 * (signal.values[:even:2] + signal.values[1:even:2])
            found.signals[name] = Signal(first_ns + (second_ns - first_ns) // 2, values)
            found.shapes.extend(others)
            continue
        spikes = _spikes(signal.values)
        if len(spikes):
            _leave_out(found, name, spikes, unit)
    for name, (least, unit) in _OF_INPUTS.items():
        values = found.signals[name].values if name in found.signals else np.zeros(0)
        if len(values) >= _FEWEST and np.isfinite(values).all():
            spikes = _spikes_of_any_size(values, least)
            if _SOME <= len(spikes) < _NO_SPIKES * len(values):
                _leave_out(found, name, spikes, unit)
    return found


def _take_out(found: Readings, name: str, between: Ints) -> None:
    signal = found.signals[name]
    unit = _OF_INPUTS[name][1] if name in _OF_INPUTS else "rad/s" if name.startswith("gyro") else "m/s^2"
    told = Coefficient(float(signal.values[between[0]]), white_std(np.delete(signal.values, between)), unit)
    found.shapes.append(Shape(name, IN_BETWEEN, told, len(between) / len(signal.values)))
    found.signals[name] = Signal(np.delete(signal.t_ns, between), np.delete(signal.values, between))


def _in_between(name: str, values: Floats) -> Ints:
    """Which readings are the same value, to the last digit, far from those before and after, which agree.

    Of an IMU also those where the others come near it: of what is noisy hardly any other is the same to the last digit.
    """
    if len(values) < _FEWEST or not np.isfinite(values).all():
        return np.zeros(0, dtype=np.int64)
    starts = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    ends = np.append(starts[1:], len(values))
    inner = (starts > 0) & (ends < len(values)) & (ends - starts <= _RUN)
    starts, ends = starts[inner], ends[inner]
    before, value, after = values[starts - 1], values[starts], values[ends]
    away = np.abs(value - 0.5 * (before + after))
    steps = np.diff(np.unique(values))
    least = _OF_INPUTS[name][0] if name in _OF_INPUTS else _FAR * float(steps.min(initial=np.inf))
    is_away = (np.abs(after - before) < _NEIGHBOURS * away) & (away > least)
    each, times = np.unique(value[is_away], return_counts=True)
    if not len(each) or (len(each) > 1 and np.sort(times)[-2] > _ANOTHER * times.max()):
        return np.zeros(0, dtype=np.int64)
    same = value == each[np.argmax(times)]
    mine = same & is_away if name in _OF_INPUTS else same
    there = np.concatenate([np.arange(start, end) for start, end in zip(starts[mine], ends[mine], strict=True)])
    far = is_away & same & (away > _FAR * white_std(np.delete(values, there)))
    if len(there) > _OFTEN * len(values) or np.count_nonzero(far) < _TIMES:
        return np.zeros(0, dtype=np.int64)
    return there


def _leave_out(found: Readings, name: str, spikes: Ints, unit: str) -> None:
    signal = found.signals[name]
    sizes = np.abs(_away(signal.values)[spikes - 1])
    told = Coefficient(float(np.median(sizes)), float(np.std(sizes) / np.sqrt(len(sizes))), unit)
    found.shapes.append(Shape(name, "+-k in single readings", told, len(spikes) / len(signal.values)))
    found.signals[name] = Signal(np.delete(signal.t_ns, spikes), np.delete(signal.values, spikes))


def coarse_steering(signals: Mapping[str, Signal], steering_ratio: float) -> list[Shape]:
    """What is said of a steering angle that is told in coarse steps of the hand wheel, rad."""
    found = []
    for name, ratio in (("steering_wheel_angle", 1.0), ("road_wheel_angle", steering_ratio)):
        step_rad = step_of(signals.get(name))
        if step_rad * ratio > _COARSE_RAD:
            found.append(Shape(name, STEPS, Coefficient(step_rad, white_std(signals[name].values), "rad"), 1.0))
    return found


def coarse_readings(signals: Mapping[str, Signal]) -> list[Shape]:
    """What is said of IMU readings and wheel speeds, SI, that are told in coarse steps."""
    found = []
    for name in (*IMU_CHANNELS, *WHEEL_SPEEDS):
        step, (least, unit) = least_step(signals.get(name)), _COARSE[name.partition("_")[0]]
        if step > least:
            found.append(Shape(name, STEPS, Coefficient(step, white_std(signals[name].values), unit), 1.0))
    return found


def hidden_by_steps(shapes: Sequence[Shape]) -> frozenset[str]:
    """What coarse steps of what drives the simulation look like."""
    stepped = {shape.channel for shape in shapes if shape.shape == STEPS} - set(IMU_CHANNELS)
    by_wheels = _BY_THE_WHEELS if stepped & set(WHEEL_SPEEDS) else frozenset[str]()
    return by_wheels | (_BY_THE_HAND if stepped - set(WHEEL_SPEEDS) else frozenset[str]())


def _away(values: Floats) -> Floats:
    """How far each reading (n - 2,) but the first and the last is from the mean of its neighbours."""
    return values[1:-1] - 0.5 * (values[2:] + values[:-2])


def _spikes_of_any_size(values: Floats, least: float) -> Ints:
    """Which readings are at least so far, and far beyond noise, from both neighbours, which agree."""
    away = np.abs(_away(values))
    far = away > max(least, _FAR * white_std(values))
    return np.asarray(np.flatnonzero(far & (np.abs(values[2:] - values[:-2]) < _NEIGHBOURS * away)) + 1)


def _spikes(values: Floats) -> Ints:
    """Which readings are spikes; none where these are not of one kind."""
    away, noise = np.abs(_away(values)), white_std(values)
    if not noise > 0.0:
        return np.zeros(0, dtype=np.int64)
    is_one = (away > _FAR * noise) & (np.abs(values[2:] - values[:-2]) < _NEIGHBOURS * away)
    if np.count_nonzero(is_one) < _SPIKES:
        return np.zeros(0, dtype=np.int64)
    size = float(np.median(away[is_one]))
    width = 1.4826 * float(np.median(np.abs(away[is_one] - size)))
    # The neighbours of a spike are half of it away from theirs.
    beside = np.convolve(is_one, [1, 0, 1], mode="same") > 0
    smaller = np.count_nonzero((away > _SMALLER[0] * size) & (away < _SMALLER[1] * size) & ~beside)
    if width > _ALIKE * size or smaller > _FEWER * np.count_nonzero(is_one):
        return np.zeros(0, dtype=np.int64)
    return np.asarray(np.flatnonzero(is_one) + 1)


def _every_other(name: str, signal: Signal, unit: str) -> list[Shape]:
    """What every other reading shows more than the one before: a constant, a share of the mean of both, or both.

    Half of that, with one sign and the other in turn, is how far each is from its neighbours' mean.
    """
    away = 0.5 * _away(signal.values)
    away = np.where(np.arange(len(away)) % 2 == 0, away, -away)
    smooth = 0.25 * (signal.values[2:] + signal.values[:-2]) + 0.5 * signal.values[1:-1]
    table = np.column_stack([np.ones(len(away)), smooth])
    if not np.ptp(smooth) > 0.0:
        return []
    k, *_ = np.linalg.lstsq(table, away, rcond=None)
    left = away - table @ k
    std = np.std(left) * np.sqrt(np.diag(np.linalg.pinv(table.T @ table)))
    if not np.sum(left**2) < (1.0 - _MOST) * np.sum(away**2):
        return []
    terms = ((f"k {EVERY_OTHER}", unit), (f"k*{OWN[name]} {EVERY_OTHER}", "1"))
    return [
        Shape(name, shape, Coefficient(abs(2.0 * float(k[i])), 2.0 * float(std[i]), of), 0.5)
        for i, (shape, of) in enumerate(terms)
        if abs(k[i]) > _SURELY * std[i]
    ]
