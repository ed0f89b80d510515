"""diagnose: what a wind has in gusts that are too quick to be told, by spectra that are known."""

from __future__ import annotations

import numpy as np
import pytest

from dsz_daemon.diagnose.recordings.recording import DT_S, filtered
from dsz_daemon.diagnose.surroundings.gusts import power_above_n2
from dsz_daemon.diagnose.surroundings.winds import GUSTS

N = 60000
NONE = np.zeros(N)
RNG = np.random.default_rng(8)


def gusts(corner_hz: float, steep: float, seed: int) -> np.ndarray:
    """A wind of 300 N (rms) whose power is even up to a corner and falls by 2 `steep` powers of the frequency."""
    hz = np.fft.rfftfreq(N, DT_S)
    white = np.fft.rfft(np.random.default_rng(seed).normal(size=N))
    values = np.fft.irfft(white / (1.0 + (hz / corner_hz) ** (2.0 * steep)) ** 0.5, N)
    return np.asarray(300.0 * values / np.std(values))


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("corner_hz", "off"), [(0.1, 0.15), (0.3, 0.25)])
def test_of_turbulence_what_the_low_pass_takes_comes_back(corner_hz: float, off: float, seed: int) -> None:
    """As much as the same wind has lost behind it, but for less where it has hardly begun to fall."""
    wind = gusts(corner_hz, 1.0, seed)
    told = filtered(wind, GUSTS)
    lost = np.mean(wind**2) - np.mean(told**2)
    assert lost > 0.04 * 300.0**2
    assert power_above_n2(told, NONE, GUSTS) == pytest.approx(lost, rel=off)


def test_a_wind_that_has_no_quick_gusts_gets_none() -> None:
    told = filtered(gusts(0.1, 4.0, 1), GUSTS)
    assert power_above_n2(told, NONE, GUSTS) < 0.01 * np.mean(told**2)


def test_what_is_the_noises_is_no_gust() -> None:
    """Of a wind that is nothing but noise, another draw of as much leaves next to nothing."""
    one, other = (filtered(100.0 * RNG.normal(size=N), GUSTS) for _ in range(2))
    assert power_above_n2(one, other, GUSTS) < 0.25 * power_above_n2(one, NONE, GUSTS)


def test_a_short_recording_tells_nothing_of_it() -> None:
    assert power_above_n2(np.ones(40), np.zeros(40), GUSTS) == 0.0
