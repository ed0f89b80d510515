"""The lateness histogram against numpy's percentiles of the same values."""

from __future__ import annotations

import numpy as np
import pytest

from dsz_daemon.pipeline.lateness import Lateness


@pytest.mark.parametrize("percent", [1.0, 50.0, 99.0, 100.0])
def test_percentiles_are_those_of_the_values_within_a_bin(percent: float) -> None:
    values = np.random.default_rng(3).lognormal(4.0, 1.5, 5000)
    late = Lateness()
    for value in values:
        late.add(float(value))
    exact = np.percentile(values, percent, method="inverted_cdf")
    assert exact <= late.percentile_us(percent) * (1 + 1e-12) <= exact * 10**0.1 * (1 + 1e-9)
    assert late.total == 5000
    assert late.max_us == values.max()
    assert late.sum_us == pytest.approx(values.sum())
    assert sum(count for _, count in late.bins()) == 5000


def test_early_is_on_time_and_nothing_is_zero() -> None:
    late = Lateness()
    assert late.percentile_us(50.0) == 0.0
    late.add(-30.0)
    assert (late.max_us, late.percentile_us(100.0), late.total) == (0.0, 0.0, 1)


def test_what_is_beyond_all_bins_is_the_maximum() -> None:
    late = Lateness()
    late.add(3e9)
    assert late.percentile_us(50.0) == 3e9
