"""diagnose: a drift that is a sensor's own slow noise is uncertain by as much as such noise makes of slopes."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import values_of
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import EVERY, Rows, rows_of
from dsz_daemon.diagnose.residuals.slow_noise import slope_of_slow_noise
from dsz_daemon.diagnose.simulation.drive import nothing

K = 3500
AT = np.arange(100, 100 + EVERY * K, EVERY)
T = DT_S * AT


def rows(used: np.ndarray | None = None) -> Rows:
    used = np.ones((K, 13), np.bool_) if used is None else used
    return Rows(AT, used, (T / 5.0).astype(np.int64), np.zeros((K, 13)), np.zeros(13))


def noise(rng: np.random.Generator, power: float) -> np.ndarray:
    """Noise whose power falls with this power of the frequency, of many times the drive's length."""
    n = 16 * K
    spectrum = np.fft.rfft(rng.standard_normal(n))
    spectrum[1:] *= np.arange(1, len(spectrum)) ** (-0.5 * power)
    spectrum[0] = 0.0
    return np.fft.irfft(spectrum, n)[:K]


@pytest.mark.parametrize(("power", "low", "high"), [(1.0, 0.6, 1.6), (2.0, 0.4, 1.3)])
def test_slow_noise_makes_slopes_of_that_spread(power: float, low: float, high: float) -> None:
    """Flicker and random walk: the slope that least squares take out of each, against what the rest tells of it."""
    rng, slopes, told = np.random.default_rng(4), [], []
    for _ in range(150):
        one = noise(rng, power)
        line = np.polyfit(T, one, 1)
        left = np.tile((one - np.polyval(line, T))[:, np.newaxis], (1, 13))
        slopes.append(line[0])
        told.append(slope_of_slow_noise(rows(), left, np.full(13, 5.0), 1)[0])
    ratio = np.sqrt(np.mean(np.square(told))) / np.sqrt(np.mean(np.square(slopes)))
    assert low < ratio < high


@pytest.mark.parametrize("hangs", [1, 5, 20])
def test_noise_that_hangs_together_for_some_rows_is_not_slow(hangs: int) -> None:
    rng, told, slopes = np.random.default_rng(5), [], []
    for _ in range(100):
        one = np.convolve(rng.standard_normal(K), np.ones(hangs), "same")
        slopes.append(np.polyfit(T, one, 1)[0])
        left = np.tile(one[:, np.newaxis], (1, 13))
        told.append(slope_of_slow_noise(rows(), left, np.full(13, float(hangs)), 1)[0])
    assert np.mean(np.square(told)) < 1.7 * np.mean(np.square(slopes))


def test_a_channel_that_is_not_there_has_none() -> None:
    used = np.ones((K, 13), np.bool_)
    used[:, 1] = False
    left = np.tile(np.sin(2.0 * np.pi * T / 140.0)[:, np.newaxis], (1, 13))
    found = slope_of_slow_noise(rows(used), left, np.ones(13), 6)
    assert found[1] == 0.0
    assert found[0] > 0.0
    assert found.shape == (6,)


def test_a_drift_beside_slow_noise_is_told_less_surely() -> None:
    """Three half waves of 0.002 rad/s in the roll gyro; the pitch gyro has none."""
    plain = drive({"bias_drift.gyro_x": 2e-5, "bias_drift.gyro_y": 2e-5}, CITY_V, CITY_STEER)
    n = len(plain.steer)
    slow = plain.measured.copy()
    slow[:, 0] += 0.002 * np.cos(3.0 * np.pi * np.arange(n) / n)
    spreads = []
    for one in (plain, plain._replace(measured=slow)):
        fit = fitted(one, rows_of(one), nothing(), ("bias_drift",), TOLERANCE)
        spreads.append({name: std for name, (_, std) in values_of(one, fit, "bias_drift").items()})
    lasts_s = DT_S * n
    assert spreads[1]["gyro_x"] > 0.8 * np.pi**2 / 4.0 * np.sqrt(3.0 / 4.0) * 0.002 / lasts_s
    assert spreads[0]["gyro_x"] < 0.3 * spreads[1]["gyro_x"]
    assert spreads[1]["gyro_y"] < 1.2 * spreads[0]["gyro_y"]
