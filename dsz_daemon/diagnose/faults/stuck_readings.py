"""What stands still tells before any simulation: an output that freezes, one that is dead near nothing, wheels cut off.

A reading that has noise is never the same as the last one for long. Where it is, no sensor was asked; and where one
value comes far more often than any other, it is what the sensor says instead of what it feels.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.diagnose.faults.single_readings import OWN, Readings, readings_of_imu
from dsz_daemon.diagnose.recordings.recording import least_step, white_std
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import WHEEL_SPEEDS

Floats = np.ndarray[Any, np.dtype[np.float64]]
Bools = np.ndarray[Any, np.dtype[np.bool_]]
Ints = np.ndarray[Any, np.dtype[np.int64]]

# So often may readings of this many stand as long by chance, where as many as did in short stretches are like the one
# before; no less than so many, and so long. Stretches of a sensor that is asked no more differ in where they stand.
_BY_CHANCE, _SHORT, _SHORTEST_S, _APART = 1e-6, 10, 0.1, 0.7
# What a sensor says instead of little is so much of all readings; others begin so many steps, and so many times the
# noise, away from it: but for this share of them.
_MUCH, _STEPS_AWAY, _NOISE_AWAY = 0.1, 10.0, 3.0
_NEAREST, _NEAR = 0.002, 0.02
# Wheels of cars are read from 3 km/h or so on. Where they begin is the same each time but for so much, and one that is
# not read shows no more than this.
_CUT_OFF_MPS, _SAME_CUT, _NOT_READ_MPS, _TWICE = 1.0, 0.8, 0.1, 2
# A bit that stays: the lowest of which that is asked, in how many of its periods most of a half is there, what of that
# half is there in any, and of how many readings.
_LOWEST_BIT, _ROUNDS, _FILLED, _ENOUGH = 4, 3, 0.8, 2000
STAYS = "k or 0, by a bit that stays"


class _Stretches(NamedTuple):
    """Readings that are like the one before: from `begin` to `end`, both included."""

    begin: Ints
    end: Ints


def told_by_standing(signals: Mapping[str, Signal]) -> Readings:
    """Readings that are none are left out; what is said of a channel has its share of the readings."""
    found = Readings(dict(signals), [])
    for name, signal in readings_of_imu(signals):
        told = _dead_band(name, signal) or _frozen(name, signal)
        if told is not None:
            shape, stands = told
            found.shapes.append(shape)
            found.signals[name] = Signal(signal.t_ns[~stands], signal.values[~stands])
        elif (bit := _stuck_bit(name, signal)) is not None:
            found.shapes.append(bit)
    for name in WHEEL_SPEEDS:
        wheel = signals.get(name)
        if wheel is not None and (cut := _cut_off(wheel)) is not None:
            share = float(np.mean(np.abs(wheel.values) < _NOT_READ_MPS))
            found.shapes.append(Shape(name, "0 where vx < k", cut, share))
    return found


def _dead_band(name: str, signal: Signal) -> tuple[Shape, Bools] | None:
    """What is said of a sensor that shows one value instead of all that are near it, and where it does."""
    values = signal.values
    said, counts = np.unique(values, return_counts=True)
    most = float(said[np.argmax(counts)])
    stands = values == most
    others, step = np.abs(values[~stands] - most), least_step(signal)
    # What stands at an end is at the end of its range.
    if not _MUCH < np.mean(stands) < 1.0 - _MUCH or most in (said[0], said[-1]):
        return None
    moving = ~stands[2:] & ~stands[1:-1] & ~stands[:-2]
    noise = 1.4826 * float(np.median(np.abs(np.diff(values, 2)[moving]))) / math.sqrt(6.0) if moving.any() else 0.0
    nearest, near = np.quantile(others, [_NEAREST, _NEAR])
    if nearest < max(_STEPS_AWAY * step, _NOISE_AWAY * noise):
        return None
    unit = "rad/s" if name.startswith("gyro") else "m/s^2"
    width = Coefficient(float(nearest), float(max(near - nearest, noise)), unit)
    return Shape(name, f"0 where |{OWN[name]}| < k", width, float(np.mean(stands))), stands


def _frozen(name: str, signal: Signal) -> tuple[Shape, Bools] | None:
    """What is said of an output that freezes for a while, again and again, and which readings are none."""
    values, stands = signal.values, np.zeros(len(signal.values), dtype=np.bool_)
    noise, step = white_std(values), least_step(signal)
    # A sensor whose steps are coarser than its noise stands still by itself.
    if not noise > step:
        return None
    stretches = _stretches(values)
    times = stretches.end - stretches.begin
    short = times < _SHORT
    share = float(times[short].sum()) / max(len(values) - float(times[~short].sum()), 1.0)
    by_chance = math.log(_BY_CHANCE / len(values)) / math.log(min(max(share, 0.05), 0.95))
    period_s = max(float(np.median(np.diff(signal.t_ns))) * 1e-9, 1e-4)
    at = values[stretches.begin]
    is_end = (at == np.min(values)) | (at == np.max(values))
    stood = times >= max(_SHORT, by_chance, _SHORTEST_S / period_s)
    long = stood & ~is_end
    if not long.any() or len(np.unique(at[long])) < _APART * np.count_nonzero(long):
        return None
    # Where others do, one that froze as far as it ever was is no limit: there a sensor is time and again.
    long |= stood & np.isin(at, [end for end in (np.min(values), np.max(values)) if np.count_nonzero(at == end) == 1])
    for begin, end in zip(stretches.begin[long], stretches.end[long], strict=True):
        stands[begin + 1 : end + 1] = True
    long_s = times[long] * period_s
    lasts = Coefficient(float(np.median(long_s)), float(np.std(long_s)), "s")
    return Shape(name, "the same for k", lasts, float(np.mean(stands))), stands


def _stretches(values: Floats) -> _Stretches:
    same = np.concatenate(([False], np.diff(values) == 0.0, [False]))
    change = np.diff(same.astype(np.int8))
    return _Stretches(np.flatnonzero(change == 1), np.flatnonzero(change == -1))


def _cut_off(signal: Signal) -> Coefficient | None:
    """Below which speed, m/s, a wheel is not read, in the car's motion and not by its resolution; None where it is."""
    speed = np.abs(signal.values)
    is_read = (speed > _NOT_READ_MPS).astype(np.int8)
    change = np.diff(is_read)
    edges = speed[np.concatenate([np.flatnonzero(change == 1) + 1, np.flatnonzero(change == -1)])]
    if len(edges) < _TWICE:
        return None
    cut = float(np.median(edges))
    slower = speed[is_read == 1] < _SAME_CUT * cut
    if cut < max(_CUT_OFF_MPS, 2.0 * least_step(signal)) or slower.any():
        return None
    return Coefficient(cut, float(np.std(edges)), "m/s")


def _stuck_bit(name: str, signal: Signal) -> Shape | None:
    """What is said of a converter of which one bit stays as it is: half of what it could say it never says.

    Of readings in steps of one, whatever the lowest is called, those of one half of each period of that bit are
    missing, and of the other half next to none. The highest bits go round too seldom to tell.
    """
    values, step = signal.values, least_step(signal)
    if not step > 0.0 or len(values) < _ENOUGH:
        return None
    steps, found = np.round((values - np.min(values)) / step).astype(np.int64), None
    for bit in range(_LOWEST_BIT, int(steps.max()).bit_length() - 1):
        half = 1 << bit
        there = np.bincount(steps % (2 * half), minlength=2 * half) > 0
        # The half that is there begins anywhere: what is there of each half a period on from here.
        sums = np.concatenate(([0], np.cumsum(np.concatenate((there, there)))))
        filled = sums[half : 3 * half] - sums[: 2 * half]
        if there.sum() == filled.max() > _FILLED * half:
            seen = np.bincount(np.unique(steps) // (2 * half)) > 0.5 * half
            found = bit if np.count_nonzero(seen) >= _ROUNDS else found
    if found is None:
        return None
    unit = "rad/s" if name.startswith("gyro") else "m/s^2"
    return Shape(name, STAYS, Coefficient(step * 2.0**found, step / math.sqrt(12.0), unit), 0.5)
