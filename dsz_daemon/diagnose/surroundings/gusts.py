"""What a wind has in gusts that are too quick to be told: those that an accelerometer's noise hides.

A wind is felt up to some 0.8 Hz. The power of turbulence falls with the square of the frequency (H. L. Dryden's form,
as in MIL-F-8785C): what it is below tells what is above.
"""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.simulation.drive import Floats

# Where a spectrum is read, Hz; each of its pieces, half of which the next one shares; and how far it is followed.
_FROM_HZ, _TO_HZ, _PIECE_S, _LAST_HZ = 0.5, 0.75, 40.0, 50.0


def power_above_n2(side_n: Floats, noise_n: Floats, kernel: Floats) -> float:
    """The power, N^2, that a wind (n,) has in what its low-pass took, by its spectrum below that, less the noise's."""
    hz, wind = _spectrum(side_n)
    there = (hz >= _FROM_HZ) & (hz <= _TO_HZ)
    if np.count_nonzero(there) < 2:
        return 0.0
    told = (wind - _spectrum(noise_n)[1])[there] / _passed(kernel, hz[there])
    level = max(float(np.mean(told * hz[there] ** 2)), 0.0)
    above_hz = np.geomspace(_FROM_HZ, _LAST_HZ, 400)
    taken = (1.0 - _passed(kernel, above_hz)) / above_hz**2
    return level * float(np.sum(0.5 * (taken[1:] + taken[:-1]) * np.diff(above_hz)))


def _passed(kernel: Floats, hz: Floats) -> Floats:
    """The share (k,) of the power that a symmetric low-pass leaves at these frequencies."""
    at_s = DT_S * (np.arange(len(kernel)) - len(kernel) // 2)
    return np.asarray((np.cos(2.0 * math.pi * np.outer(hz, at_s)) @ kernel) ** 2)


def _spectrum(values: Floats) -> tuple[Floats, Floats]:
    """Frequencies, Hz, and one-sided power density of the values (n,): P. D. Welch's, of Hann's windows."""
    n = min(round(_PIECE_S / DT_S), len(values))
    window = np.hanning(n)
    starts = range(0, len(values) - n + 1, max(n // 2, 1))
    power = np.mean([np.abs(np.fft.rfft(window * values[i : i + n])) ** 2 for i in starts], axis=0)
    return np.asarray(np.fft.rfftfreq(n, DT_S)), np.asarray(2.0 * DT_S * power / np.sum(window**2))
