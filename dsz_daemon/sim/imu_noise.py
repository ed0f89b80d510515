"""Noise of an IMU channel: white at the data sheet's density, and 1/f below a corner."""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.sim.sensors import Triad

Array = NDArray[np.float64]

# Chosen: a period of 17 minutes; slower than that, drift and temperature have fields of their own.
FLICKER_LOWEST_HZ = 1.0e-3


def white_noise(triad: Triad, gain: float, size: int, rate_hz: float, rng: np.random.Generator) -> Array:
    """Return size x 3 values in SI, sampled at `rate_hz`: `gain` times the data sheet's density.

    White up to half the sampling rate, as behind an ideal anti-aliasing filter.
    """
    rms = gain * triad.noise_per_root_hz * math.sqrt(rate_hz / 2.0) * triad.unit
    return np.column_stack([rms * rng.normal(size=size) for _ in range(3)])


def flicker_noise(level: float, size: int, rate_hz: float, rng: np.random.Generator) -> Array:
    """Return size x 3 values of one-sided power density level^2 / f, from `FLICKER_LOWEST_HZ` on.

    A sum of first-order Gauss-Markov processes, one per octave, all of the same variance:
    the sum over poles f_i of (2 s^2 / pi) f_i / (f_i^2 + f^2) is s^2 / (f ln 2) in the middle of
    many octaves. Below the lowest pole it is flat. Each starts as it goes on: settled.
    """
    octaves = math.ceil(math.log2(rate_hz / 2.0 / FLICKER_LOWEST_HZ))
    rms = level * math.sqrt(math.log(2.0))
    total = np.zeros((size, 3), dtype=np.float64)
    for octave in range(octaves):
        kept = math.exp(-2.0 * math.pi * FLICKER_LOWEST_HZ * 2.0**octave / rate_hz)
        fresh = rms * math.sqrt(1.0 - kept * kept)
        for axis in range(3):
            driven = fresh * rng.normal(size=size)
            driven[:1] *= rms / fresh
            total[:, axis] += _recursion(kept, driven)
    return total


def _recursion(kept: float, driven: Array) -> list[float]:
    """Return y with y = kept x the y before + driven, from 0."""
    values: list[float] = driven.tolist()
    return list(accumulate(values, lambda y, w: kept * y + w))
