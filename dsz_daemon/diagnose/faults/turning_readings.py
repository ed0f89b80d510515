"""What comes round with the wheels tells before any simulation: a ring that is uneven, a wheel out of balance.

Too quick for what the simulation is held against, it would count as noise. Over the distance that is driven it is a
line in the spectrum, whatever the speed (order tracking).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.diagnose.recordings.recording import LONGEST_GAP_S, white_std
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

Floats = np.ndarray[Any, np.dtype[np.float64]]
Bools = np.ndarray[Any, np.dtype[np.bool_]]

# So many points of each metre; so many metres at a time, of which the next begin in the middle.
_POINTS, _METRES = 8, 48
_LENGTH = _POINTS * _METRES
# Wheels of cars have these radii, m; and so quick is what has a time of its own, as if it were a wheel's.
_RADII_M, _ANY_M = (0.2, 0.5), (0.06, 1.0)
# A line is as wide as so many places of the spectrum to each side; between these from it is what there is without it.
_WIDE, _BESIDE = 2, (4, 8)
# What comes back more seldom, Hz, may be a driver's; of readings' rate a line is below this part, for it has an image
# as far below the rate; and so many of a stretch's readings are there.
_SELDOM_HZ, _OF_RATE, _THERE = 3.0, 0.35, 0.8
# There are so many stretches at least. A line is so many spreads of their mean, and so many times what is beside it;
# over time there is none of which it is less than this part. Its rms is so much of the readings' white noise at least,
# and of a wheel's speed, whose ring is never quite even.
_FEWEST, _SURE, _ABOVE, _OF_A_TONE = 8, 6.0, 1.5, 0.8
_OF_NOISE, _UNEVEN = 0.3, 0.003
# What a sine's power is of that of its highest place, all places of a Hann window together.
_HANN = 1.5
# So far off, as a share, straight lines between readings and a speed that changes meanwhile leave k.
_FORM = 0.02
# With which power of speed the line's amplitude may grow, and what the unit of k is per.
_GROWTH = (("", ""), ("vx*", "/(m/s)"), ("vx^2*", "/(m2/s2)"))


# The gyros that feel these roads.
_FELT_BY = {"gyro_x": "road_bank", "gyro_y": "road_grade"}


class _Line(NamedTuple):
    """Of stretches (m,) the mean speed, m/s, the square of the line's amplitude, and what there is beside it."""

    radius_m: float
    speed_mps: Floats
    square: Floats
    beside: Floats


def of_wheels(lines: Sequence[Shape], effects: Collection[str]) -> list[Shape]:
    """The lines without those of a road that is in the model: of slabs, or drawn from one metre to the next.

    A wheel shows in more than in the gyro that feels the road.
    """
    others = {line.channel for line in lines} - set(_FELT_BY)
    return [line for line in lines if others or _FELT_BY.get(line.channel) not in effects]


def uneven_rings(lines: Iterable[Shape]) -> set[str]:
    """Wheels (`fl`, ...) whose own speed shows a line once a turn."""
    names = {name: name.removeprefix("wheel_speed_") for name in WHEEL_SPEEDS}
    return {names[line.channel] for line in lines if line.channel in names and "sin(s/" in line.shape}


def told_by_turning(signals: Mapping[str, Signal]) -> list[Shape]:
    """What a channel shows once for each turn of a wheel, of which radius, and how that grows with speed.

    `s` is the distance that was driven: what is written comes back after 2 pi times the radius.
    """
    wheels = [signals[name] for name in WHEEL_SPEEDS if name in signals]
    if not wheels or not all(map(_is_known, wheels)):
        return []
    first_ns = int(wheels[0].t_ns[0])
    grid_s = _evenly_driven(wheels, first_ns)
    shapes = []
    for name in (*IMU_CHANNELS, *WHEEL_SPEEDS):
        signal = signals.get(name)
        if signal is None or not _is_known(signal):
            continue
        noise = white_std(signal.values)
        at_s = np.asarray((signal.t_ns - first_ns) * 1e-9, dtype=np.float64)
        line = _line(at_s, signal.values, grid_s, _RADII_M)
        if line is None or not _is_much(name, line, noise):
            continue
        tone = _line(at_s, signal.values, np.linspace(grid_s[0], grid_s[-1], len(grid_s)), _ANY_M)
        if tone is None or np.mean(line.square) > _OF_A_TONE * np.mean(tone.square):
            shapes.append(_as_shape(name, line, noise))
    return shapes


def _is_known(signal: Signal) -> bool:
    return len(signal.t_ns) >= _FEWEST and bool(np.isfinite(signal.values).all())


def _evenly_driven(wheels: list[Signal], first_ns: int) -> Floats:
    """When the car has come another step (n,), s; where wheel speeds are missing it stands."""
    t_ns = wheels[0].t_ns
    speed = np.mean([np.interp(t_ns, wheel.t_ns, np.abs(wheel.values)) for wheel in wheels], axis=0)
    time_s = (t_ns - first_ns) * 1e-9
    steps_s = np.diff(time_s, prepend=time_s[0])
    driven = np.cumsum(np.where(steps_s < LONGEST_GAP_S, steps_s * speed, 0.0))
    rises = np.diff(driven, prepend=-1.0) > 0.0
    return np.asarray(np.interp(np.arange(0.0, driven[-1], 1.0 / _POINTS), driven[rises], time_s[rises]))


def _line(at_s: Floats, values: Floats, grid_s: Floats, radii_m: tuple[float, float]) -> _Line | None:
    """The strongest line that wheels of such radii could have, of those that stand out; None where none does."""
    starts = range(0, len(grid_s) - _LENGTH + 1, _LENGTH // 2)
    stretches = np.array([grid_s[i : i + _LENGTH] for i in starts]).reshape(-1, _LENGTH)
    # Of readings whose stamps stand still nobody knows how often they come.
    period_s = float(np.median(np.diff(at_s)))
    if not period_s > 0.0:
        return None
    stretches = stretches[_is_whole(stretches, at_s, period_s)]
    shown = np.interp(stretches, at_s, values)
    window = np.hanning(_LENGTH + 1)[:-1]
    power = np.abs(np.fft.rfft((shown - shown.mean(axis=1, keepdims=True)) * window, axis=1)) ** 2
    power *= 4.0 / (_HANN * window.sum() ** 2)
    steps_s, speed = np.diff(stretches, axis=1), _METRES / (stretches[:, -1] - stretches[:, 0])
    least_s, most_s = _POINTS * steps_s.min(axis=1, initial=math.inf), _POINTS * steps_s.max(axis=1, initial=0.0)
    best, places = None, np.arange(power.shape[1])
    for place in range(*(round(_METRES / (2.0 * math.pi * radius_m)) for radius_m in reversed(radii_m))):
        per_m, away = place / _METRES, np.abs(places - place)
        seen = (per_m / most_s > _SELDOM_HZ) & (per_m / least_s < _OF_RATE / period_s)
        # A straight line between readings takes so much off.
        kept = np.sinc(per_m * speed[seen] * period_s) ** 4
        of_line = power[np.ix_(seen, away <= _WIDE)]
        beside = power[np.ix_(seen, (away >= _BESIDE[0]) & (away <= _BESIDE[1]))].mean(axis=1) * (2 * _WIDE + 1)
        middle = float(of_line.sum(axis=0) @ places[away <= _WIDE]) / max(float(of_line.sum()), 1e-300)
        line = _Line(
            _METRES / (2.0 * math.pi * max(middle, 1.0)),
            speed[seen],
            (of_line.sum(axis=1) - beside) / kept,
            beside / kept,
        )
        if _stands_out(line) and (best is None or np.mean(line.square) > np.mean(best.square)):
            best = line
    return best


def _is_whole(stretches: Floats, at_s: Floats, period_s: float) -> Bools:
    """Whether as many readings are there as there should be (m,)."""
    begin_s, end_s = stretches[:, 0], stretches[:, -1]
    readings = np.searchsorted(at_s, end_s) - np.searchsorted(at_s, begin_s)
    return np.asarray(readings * period_s > _THERE * (end_s - begin_s))


def _stands_out(line: _Line) -> bool:
    m = len(line.square)
    if m < _FEWEST:
        return False
    mean, spread = float(np.mean(line.square)), float(np.std(line.square)) / math.sqrt(m)
    return mean > _SURE * spread and mean > _ABOVE * float(np.mean(line.beside))


def _is_much(name: str, line: _Line, noise: float) -> bool:
    rms = math.sqrt(float(np.mean(line.square)) / 2.0)
    uneven = _UNEVEN * float(np.mean(line.speed_mps)) if name in WHEEL_SPEEDS else 0.0
    return rms > max(_OF_NOISE * noise, uneven / math.sqrt(2.0))


def _as_shape(name: str, line: _Line, noise: float) -> Shape:
    """The growth with speed that fits best, and k with its spread by how stretches differ.

    The share is of what is quick, at least: white noise is not known without the line.
    """
    fits = []
    for growth in range(len(_GROWTH)):
        course = line.speed_mps ** (2 * growth)
        square = float(course @ line.square) / float(course @ course)
        left = line.square - square * course
        spread = math.sqrt(float(np.sum((course * left) ** 2))) / float(course @ course)
        fits.append((float(left @ left), growth, square, spread))
    _, growth, square, spread = min(fits)
    written, per = _GROWTH[growth]
    unit = "m/s" if name in WHEEL_SPEEDS else "rad/s" if name.startswith("gyro") else "m/s2"
    k = math.sqrt(square)
    power = 0.5 * float(np.mean(line.square))
    return Shape(
        name,
        f"k*{written}sin(s/{line.radius_m:.2f} m)",
        Coefficient(k, math.hypot(spread / (2.0 * k), _FORM * k), f"({unit}){per}" if per else unit),
        power / (power + noise**2),
    )
