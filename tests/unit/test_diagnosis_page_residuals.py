"""Spectra and memories on the page of `dsz diagnose`: against sines and noise of which both are known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from dsz_daemon.diagnose.recordings.recording import FILTER_S, filter_kernel, filtered
from dsz_daemon.report.diagnosis_residuals import memory, noise_density, spectrum

NAN = math.nan
Floats = np.ndarray[Any, np.dtype[np.float64]]
ROW_S = 0.04


def grid_s(seconds: float) -> Floats:
    return np.arange(round(seconds / 0.01)) * 0.01


def test_a_sine_has_its_peak_at_its_frequency_and_of_its_height() -> None:
    # On the 10th line of 256 rows of 0.04 s; Hann's window spreads its power over 1.5 lines: A^2/2 / (1.5 df).
    line_hz = 1.0 / (256 * ROW_S)
    time_s = grid_s(150.0)
    found = spectrum(time_s, 0.3 * np.sin(2.0 * np.pi * 10.0 * line_hz * time_s))
    assert found is not None
    peak = int(np.argmax(found.density))
    assert found.frequency_hz[peak] == pytest.approx(10.0 * line_hz)
    assert found.density[peak] == pytest.approx(0.3 / math.sqrt(2.0 * 1.5 * line_hz), rel=1e-3)


def test_the_spectrum_of_noise_holds_its_variance_holes_or_not() -> None:
    time_s = grid_s(600.0)
    values = 0.7 * np.random.default_rng(3).standard_normal(len(time_s))
    values[20000:22000] = NAN
    found = spectrum(time_s, values)
    assert found is not None
    power = float(np.sum(found.density**2)) * float(found.frequency_hz[1] - found.frequency_hz[0])
    assert power == pytest.approx(0.49, rel=0.05)


def test_short_pieces_have_no_spectrum() -> None:
    time_s = grid_s(20.0)
    values = np.ones(len(time_s))
    values[::200] = NAN
    assert spectrum(time_s, values) is None


def test_the_noise_density_is_that_of_noise_behind_the_low_pass() -> None:
    # The second route: white noise through the diagnosis' own filter, its spectrum measured.
    time_s = grid_s(1500.0)
    noise = filtered(np.random.default_rng(5).standard_normal(len(time_s)), filter_kernel())
    found = spectrum(time_s, noise)
    assert found is not None
    heard = found.frequency_hz < 5.0
    expected = noise_density(found.frequency_hz[heard], float(np.std(noise)), FILTER_S)
    assert found.density[heard] == pytest.approx(expected, rel=0.2)
    assert float(np.mean(found.density[heard] / expected)) == pytest.approx(1.0, abs=0.03)


def test_noise_behind_the_low_pass_stays_within_the_band_19_times_in_20() -> None:
    inside = []
    for seed in range(20):
        time_s = grid_s(150.0)
        noise = filtered(np.random.default_rng(seed).standard_normal(len(time_s)), filter_kernel())
        noise[6000:7000] = NAN
        found = memory(time_s, noise, FILTER_S)
        assert found is not None
        assert found.lag_s[0] == pytest.approx(ROW_S)
        inside.append(np.abs(found.found - found.white) < found.band)
    # Neighbours go together, so 20 runs of 100 lags are some 500 independent ones: +- 2 %.
    assert float(np.mean(inside)) == pytest.approx(0.95, abs=0.03)


def test_a_swing_goes_on_as_a_cosine_and_leaves_the_band() -> None:
    time_s = grid_s(150.0)
    found = memory(time_s, 0.2 * np.sin(2.0 * np.pi * time_s) + 3.0, FILTER_S)
    assert found is not None
    assert found.found == pytest.approx(np.cos(2.0 * np.pi * found.lag_s), abs=0.01)
    assert float(np.mean(np.abs(found.found - found.white) > found.band)) > 0.8


def test_nothing_left_has_no_memory() -> None:
    assert memory(grid_s(60.0), np.zeros(6000), FILTER_S) is None
    assert memory(grid_s(60.0), np.full(6000, NAN), FILTER_S) is None
