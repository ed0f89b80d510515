"""What a residual is like: its spectrum, and how long it remembers. Pure; SI throughout."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dsz_daemon.report.diagnosis_channels import step_s
from dsz_daemon.report.display import Floats

# As the comparison's: the low-pass has left nothing above.
_ROW_S = 0.04
# 10 s: slower than what a driver does is the offset's business. Shorter drives have shorter ones.
_SEGMENT_ROWS, _SHORTEST_SEGMENT_ROWS = 256, 64
_LONGEST_LAG_S = 4.0
# Two-sided, of a normal distribution.
_IN_95 = 1.96


def _rows(time_s: Floats, values: Floats) -> tuple[Floats, float]:
    """Every so manyth value, as it is compared, and the time between two."""
    between_s = step_s(time_s)
    every = max(round(_ROW_S / between_s), 1)
    return values[::every], every * between_s


class Spectrum(NamedTuple):
    """Amplitude density (unit per root Hz), one-sided, at `frequency_hz`; both of shape (frequencies,)."""

    frequency_hz: Floats
    density: Floats


def spectrum(time_s: Floats, values: Floats) -> Spectrum | None:
    """Of a residual with holes (NaN), after Welch (1967): mean of windowed stretches without a hole.

    Hann's window, half overlapping, each stretch's mean taken off; None when none is long enough.
    """
    rows, row_s = _rows(time_s, values)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.isfinite(rows).astype(np.int64), [0]]))).reshape(-1, 2)
    longest = int(np.max(edges[:, 1] - edges[:, 0])) if len(edges) else 0
    size = _SEGMENT_ROWS
    while size > longest and size > _SHORTEST_SEGMENT_ROWS:
        size //= 2
    if size > longest:
        return None
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(size) / size)
    starts = [at for start, end in edges.tolist() for at in range(start, end - size + 1, size // 2)]
    cut = np.stack([rows[at : at + size] for at in starts])
    cut = (cut - cut.mean(axis=1, keepdims=True)) * window
    power = 2.0 * row_s / float(np.sum(window**2)) * np.mean(np.abs(np.fft.rfft(cut, axis=1)) ** 2, axis=0)
    frequency_hz = np.asarray(np.fft.rfftfreq(size, row_s), dtype=np.float64)
    return Spectrum(frequency_hz[1:-1], np.asarray(np.sqrt(power[1:-1]), dtype=np.float64))


def noise_density(frequency_hz: Floats, rms: float, filter_s: float) -> Floats:
    """Amplitude density of white noise behind a Gaussian low-pass of width `filter_s`, of `rms` altogether.

    The low-pass passes exp(-(2 pi f s)^2 / 2) of an amplitude, so 1/(4 sqrt(pi) s) Hz of white power.
    """
    at_zero = rms * math.sqrt(4.0 * math.sqrt(math.pi) * filter_s)
    return np.asarray(at_zero * np.exp(-0.5 * (2.0 * np.pi * frequency_hz * filter_s) ** 2), dtype=np.float64)


class Memory(NamedTuple):
    """Autocorrelation at `lag_s`, what white noise behind the low-pass has, and the 95 % band about that.

    All of shape (lags,) but `band`, which is one number: Bartlett's (1946) for lags beyond the filter's reach.
    """

    lag_s: Floats
    found: Floats
    white: Floats
    band: float


def memory(time_s: Floats, values: Floats, filter_s: float) -> Memory | None:
    """How a residual with holes (NaN) goes on from one moment to a later one; None when there is too little of it."""
    rows, row_s = _rows(time_s, values)
    known = np.isfinite(rows)
    count = int(np.count_nonzero(known))
    lags = min(round(_LONGEST_LAG_S / row_s), len(rows) // 4)
    if lags < 2 or count < 4 * lags:
        return None
    centred = np.where(known, rows - np.mean(rows[known]), 0.0)
    power = float(np.sum(centred**2)) / count
    if power <= 0.0:
        return None
    found = np.empty(lags)
    for lag in range(1, lags + 1):
        pairs = int(np.count_nonzero(known[lag:] & known[:-lag]))
        found[lag - 1] = float(np.sum(centred[lag:] * centred[:-lag])) / max(pairs, 1) / power
    lag_s = np.asarray(row_s * np.arange(1, lags + 1), dtype=np.float64)
    white = np.exp(-0.25 * (lag_s / filter_s) ** 2)
    band = _IN_95 * math.sqrt((1.0 + 2.0 * float(np.sum(white**2))) / count)
    return Memory(lag_s, found, np.asarray(white, dtype=np.float64), band)
