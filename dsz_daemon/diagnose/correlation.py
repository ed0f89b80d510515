"""How far what is left hangs together."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.fft import next_fast_len

Floats = np.ndarray[Any, np.dtype[np.float64]]
Bools = np.ndarray[Any, np.dtype[np.bool_]]

LONGEST_ROWS = 250


def correlated_rows(left: Floats, used: Bools) -> Floats:
    """How many rows of each channel (c,) tell as much as one that is independent of the others."""
    found = np.ones(left.shape[1])
    for c in np.flatnonzero(used.any(axis=0)):
        mine = np.where(used[:, c], left[:, c], 0.0)
        # Filled up with zeros, so that no end meets the beginning within these lags.
        reach = min(len(mine), LONGEST_ROWS)
        n = next_fast_len(len(mine) + reach, real=True)
        lags = np.fft.irfft(np.abs(np.fft.rfft(mine, n)) ** 2, n)[:reach]
        if lags[0] <= 0.0:
            continue
        ratio = lags[1:] / lags[0]
        ends = np.flatnonzero(ratio < 0.05)
        found[c] = 1.0 + 2.0 * float(np.sum(ratio[: ends[0] if len(ends) else len(ratio)]))
    return found
