"""How other cars are driven: speeds and bends by the seed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

Floats = np.ndarray[Any, np.dtype[np.float64]]

DT = 0.002


class _Course:
    """Speed, m/s, and curvature, 1/m, over time at DT, piece by piece."""

    def __init__(self, seconds: float, speed_mps: float) -> None:
        self.speed, self.bend = np.zeros(round(seconds / DT)), np.zeros(round(seconds / DT))
        self.at, self.v = 0, speed_mps

    def go(self, to: float, rate: float) -> None:
        """To another speed, at this rate in the middle of it."""
        steps = max(round(abs(to - self.v) / rate / DT), 1)
        ease = 0.5 - 0.5 * np.cos(np.linspace(0.0, math.pi, steps))
        self._put(self.v + (to - self.v) * ease, np.zeros(steps))
        self.v = to

    def stay(self, lasts_s: float, bend: Floats | None = None) -> None:
        """At this speed, along a bend (of any number of rows)."""
        steps = round(lasts_s / DT)
        shape = np.zeros(2) if bend is None else bend
        part = np.interp(np.linspace(0.0, 1.0, steps), np.linspace(0.0, 1.0, len(shape)), shape)
        self._put(np.full(steps, self.v), part)

    def _put(self, speed: Floats, bend: Floats) -> None:
        room = max(len(self.speed) - self.at, 0)
        self.speed[self.at : self.at + len(speed)] = speed[:room]
        self.bend[self.at : self.at + len(bend)] = bend[:room]
        self.at += len(speed)


def wanted(rng: np.random.Generator, kind: str, seconds: float) -> tuple[Floats, Floats]:
    """Speed, m/s, and curvature, 1/m, over time at DT, of a city or a highway."""
    rolls = kind == "highway" and rng.random() < 0.5
    course = _Course(seconds, rng.uniform(22.0, 30.0) if rolls else 0.0)
    if not rolls:
        course.stay(rng.uniform(3.0, 6.0))
    while course.at < len(course.speed):
        (_city if kind == "city" else _highway)(rng, course)
    return smooth(course.speed, 0.25), smooth(course.bend, 0.2)


def _city(rng: np.random.Generator, course: _Course) -> None:
    side, what = float(rng.choice([-1.0, 1.0])), rng.choice(["cruise", "turn", "turn", "bend", "bend", "stop"])
    if what == "cruise":
        course.go(rng.uniform(8.0, 15.0), rng.uniform(0.8, 2.2))
        course.stay(rng.uniform(2.0, 6.0))
    elif what == "stop":
        course.go(0.0, rng.uniform(1.0, 2.5))
        course.stay(rng.uniform(2.0, 5.0))
    elif what == "turn":
        radius, across = rng.uniform(8.0, 16.0), rng.uniform(1.5, 3.2)
        course.go(math.sqrt(across * radius), rng.uniform(1.0, 2.5))
        course.stay(math.pi / 2.0 * radius / course.v / 0.75, _trapeze(side / radius))
    else:
        course.go(rng.uniform(8.0, 14.0), rng.uniform(0.8, 2.0))
        course.stay(rng.uniform(3.0, 7.0), _trapeze(side * rng.uniform(1.0, 3.3) / course.v**2))


def _highway(rng: np.random.Generator, course: _Course) -> None:
    side, what = float(rng.choice([-1.0, 1.0])), rng.choice(["cruise", "lane", "lane", "bend", "bend", "ramp"])
    if what == "cruise":
        course.go(rng.uniform(23.0, 35.0), rng.uniform(0.5, 1.5))
        course.stay(rng.uniform(2.0, 6.0))
    elif what == "ramp":
        course.go(rng.uniform(12.0, 18.0), rng.uniform(1.2, 2.5))
        course.stay(rng.uniform(5.0, 9.0), _trapeze(side * rng.uniform(2.0, 3.8) / course.v**2))
        course.go(rng.uniform(24.0, 32.0), rng.uniform(1.0, 2.0))
    elif what == "lane":
        wave = np.sin(np.linspace(0.0, 2.0 * math.pi, 200))
        course.stay(rng.uniform(3.0, 5.0), side * rng.uniform(0.7, 2.0) / max(course.v, 10.0) ** 2 * wave)
        course.stay(rng.uniform(1.0, 4.0))
    else:
        course.go(rng.uniform(22.0, 34.0), rng.uniform(0.5, 1.5))
        course.stay(rng.uniform(6.0, 14.0), _trapeze(side * rng.uniform(0.6, 2.4) / course.v**2))


def _trapeze(height: float) -> Floats:
    return height * np.interp(np.linspace(0.0, 1.0, 200), [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, 1.0, 0.0])


def smooth(values: Floats, sigma_s: float) -> Floats:
    """A Gaussian's average."""
    reach = round(4.0 * sigma_s / DT)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) * DT / sigma_s) ** 2)
    padded = np.pad(values, reach, mode="edge")
    size = 1 << (len(padded) + len(weights)).bit_length()
    found = np.fft.irfft(np.fft.rfft(padded, size) * np.fft.rfft(weights / weights.sum(), size), size)
    return np.asarray(found[2 * reach : 2 * reach + len(values)], dtype=np.float64)


def rolling(rng: np.random.Generator, along: Floats, rms: float, scale: float) -> Floats:
    """A random course of this rms over a coordinate that does not fall, smooth at `scale`."""
    found = np.zeros(len(along))
    if rms == 0.0:
        return found
    for _ in range(25):
        wave = 2.0 * math.pi / (scale * rng.uniform(2.0, 10.0))
        found += np.sin(wave * along + rng.uniform(0.0, 2.0 * math.pi))
    moving = np.gradient(along) > 0.0
    return np.asarray(rms * found / math.sqrt(float(np.mean(found[moving] ** 2))), dtype=np.float64)
