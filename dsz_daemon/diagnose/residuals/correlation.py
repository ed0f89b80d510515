"""How far what is left hangs together, by numpy's Fourier transform: importing scipy's takes a sixth of a second."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

Floats = np.ndarray[Any, np.dtype[np.float64]]
Bools = np.ndarray[Any, np.dtype[np.bool_]]

LONGEST_ROWS = 250


def correlated_rows(left: Floats, used: Bools) -> Floats:
    """How many rows of each channel (c,) tell as much as one that is independent of the others."""
    found, there = np.ones(left.shape[1]), np.flatnonzero(used.any(axis=0))
    mine = np.ascontiguousarray(np.where(used, left, 0.0).T[there])
    # Filled up with zeros, so that no end meets the beginning within these lags.
    reach = min(len(left), LONGEST_ROWS)
    n = quick_length(len(left) + reach)
    spectrum = np.fft.rfft(mine, n)
    lags = np.fft.irfft(spectrum.real**2 + spectrum.imag**2, n)[:, :reach]
    for c, own in zip(there, lags, strict=True):
        if own[0] <= 0.0:
            continue
        ratio = own[1:] / own[0]
        ends = np.flatnonzero(ratio < 0.05)
        found[c] = 1.0 + 2.0 * float(np.sum(ratio[: ends[0] if len(ends) else len(ratio)]))
    return found


@functools.cache
def quick_length(n: int) -> int:
    """The next length, 1 at least, of which a Fourier transform is quick: of no other factors than 2, 3 and 5."""
    while not _is_quick(n):
        n += 1
    return n


def _is_quick(n: int) -> bool:
    for factor in (2, 3, 5):
        while n > 1 and n % factor == 0:
            n //= factor
    return n == 1
