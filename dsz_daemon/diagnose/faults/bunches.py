"""Samples that come in bunches: a gateway or a logger held them back, and their stamps say when they were let go."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from dsz_daemon.diagnose.faults.single_readings import Readings
from dsz_daemon.diagnose.recordings.recording import Recording
from dsz_daemon.diagnose.residuals.comparison import Bools
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.simulation.drive import Floats
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

IN_BUNCHES = "up to k late, in bunches"
_DELAYS = {
    "imu_delay": IMU_CHANNELS,
    "wheel_speed_delay": WHEEL_SPEEDS,
    "steering_delay": ("steering_wheel_angle", "road_wheel_angle"),
}
_ROLES = tuple(name for channels in _DELAYS.values() for name in channels)
# Of so many samples, a tenth of them so late, and so many periods.
_FEWEST, _LATE_S, _LATE_PERIODS = 500, 0.05, 5.0
# What is late by nothing, once in so long a time, comes a period after another: by so much of one, or so many seconds.
_ONCE_IN_S, _STRAIGHT_PERIODS, _STRAIGHT_S, _LEAST_WINDOWS = 5.0, 1.0, 0.003, 5
_AT_ONCE_PERIODS, _OFTEN, _MOST, _MOST_OF_THE_TIME = 0.2, 0.1, 0.99, 0.5


def told_by_stamps(signals: Mapping[str, Signal]) -> Readings:
    """What came in bunches at the times at which it was due, where none of it is lost; and that it did."""
    found = Readings(dict(signals), [])
    for name in _ROLES:
        signal = signals.get(name)
        if signal is None or len(signal.t_ns) < _FEWEST:
            continue
        due_s = _due_s(np.asarray((signal.t_ns - signal.t_ns[0]) * 1e-9, dtype=np.float64))
        if due_s is None:
            continue
        late_s = (signal.t_ns - signal.t_ns[0]) * 1e-9 - due_s
        period_s = float(np.mean(np.diff(due_s)))
        told = Coefficient(float(np.quantile(late_s, _MOST)), period_s, "s")
        found.shapes.append(Shape(name, IN_BUNCHES, told, float(np.mean(late_s > period_s))))
        due_ns = signal.t_ns[0] + np.round(due_s * 1e9).astype(np.int64)
        found.signals[name] = Signal(due_ns, signal.values)
    return found


def hardly_there(recording: Recording, signals: Iterable[str]) -> list[Shape]:
    """What is said of `signals` that are not there most of the time: of these hardly anything was compared."""
    columns = np.column_stack([recording.imu, recording.wheels_mps])
    gone = dict(zip((*IMU_CHANNELS, *WHEEL_SPEEDS), np.mean(~np.isfinite(columns), axis=0).tolist(), strict=True))
    there, n = set(signals), len(recording.time_s)
    return [
        Shape(name, "not there for k of the time", Coefficient(share, 1.0 / n, "1"), share)
        for name, share in gone.items()
        if name in there and share > _MOST_OF_THE_TIME
    ]


def delays_of(shapes: Iterable[Shape]) -> set[str]:
    """Delays that nobody knows: of what comes in bunches the least late is taken to come at once.

    All are against the IMU, and a low-pass is a delay, too.
    """
    there = {shape.channel for shape in shapes if shape.shape == IN_BUNCHES}
    slow = {"sensor_bandwidth"} if there & set(IMU_CHANNELS) else set()
    return {d for d, channels in _DELAYS.items() if there & {*channels, *IMU_CHANNELS}} | slow


def _due_s(at_s: Floats) -> Floats | None:
    """When samples (n,) were due, s: a straight line below their stamps; None where they come as they are due.

    Nor where the earliest of each few seconds are no straight line: then some are lost, and which one is which is not
    known.
    """
    if at_s[-1] < _LEAST_WINDOWS * _ONCE_IN_S:
        return None
    i = np.arange(len(at_s), dtype=np.float64)
    period_s = float(at_s[-1]) / (len(at_s) - 1)
    windows = int(at_s[-1] / _ONCE_IN_S)
    window = np.minimum(at_s / at_s[-1] * windows, windows - 1).astype(np.int64)
    # A bus takes one after another: all of a bunch are let go when the first of it comes, and the last is late by that.
    begins = np.concatenate(([True], np.diff(at_s) > _AT_ONCE_PERIODS * period_s))
    let_go_s = at_s[np.maximum.accumulate(np.where(begins, np.arange(len(at_s)), 0))]
    beyond = at_s - period_s * i
    first = np.lexsort((beyond, window))
    first = first[np.concatenate(([True], np.diff(window[first]) > 0))]
    period_s, begin_s = (float(one) for one in np.polyfit(i[first], at_s[first], 1))
    due_s = np.asarray(begin_s + period_s * i, dtype=np.float64)
    off_s = at_s[first] - due_s[first]
    if not np.max(np.abs(off_s)) < max(_STRAIGHT_PERIODS * period_s, _STRAIGHT_S):
        return None
    late: Bools = at_s - due_s > max(_LATE_S, _LATE_PERIODS * period_s)
    return due_s - float(np.median(at_s[first] - let_go_s[first])) if float(np.mean(late)) > _OFTEN else None
