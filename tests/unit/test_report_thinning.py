"""Thinning for the pictures: extremes and gaps stay, nothing is invented."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dsz_daemon.report.thinning import band, buckets, line, runs

NAN = math.nan


@given(
    arrays(np.float64, st.integers(1, 400), elements=st.floats(-1e3, 1e3) | st.just(NAN)),
    st.integers(4, 60),
)
def test_thinning_keeps_extremes_ends_and_invents_no_point(values: np.ndarray, points: int) -> None:
    time_s = np.arange(len(values)) * 0.25
    x, y = line(time_s, values, points)
    finite = np.flatnonzero(np.isfinite(values))
    drawn = np.isfinite(y)
    known = set(zip(time_s[finite].tolist(), values[finite].astype(np.float32).tolist(), strict=True))
    assert set(zip(x[drawn].astype(float).tolist(), y[drawn].tolist(), strict=True)) <= known
    assert np.count_nonzero(drawn) <= 1.5 * points + 4
    if len(finite):
        assert x[drawn][0] == time_s[finite[0]]
        assert x[drawn][-1] == time_s[finite[-1]]
        assert y[drawn].min() == np.float32(values[finite].min())
        assert y[drawn].max() == np.float32(values[finite].max())


@pytest.mark.parametrize("points", [4000, 40])
def test_a_gap_is_not_bridged_whether_rows_or_values_are_missing(points: int) -> None:
    time_s = np.arange(1000) * 0.01
    without_values = np.where((time_s > 3.0) & (time_s < 5.0), NAN, time_s)
    present = np.isfinite(without_values)
    for t, v in ((time_s, without_values), (time_s[present], time_s[present])):
        x, y = line(t, v, points)
        at = np.flatnonzero(np.isnan(y))
        assert len(at) == 1
        assert x[at[0] - 1] == pytest.approx(3.0)
        assert x[at[0] + 1] == pytest.approx(5.0)


def test_a_clock_that_steps_back_breaks_the_line() -> None:
    _, y = line(np.array([0.0, 1.0, 2.0, 1.5, 2.5, 3.5]), np.arange(6.0))
    np.testing.assert_array_equal(y, [0.0, 1.0, 2.0, NAN, 3.0, 4.0, 5.0])


def test_a_band_encloses_every_row_and_has_a_polygon_per_section() -> None:
    rng = np.random.default_rng(5)
    time_s = np.arange(5000) * 0.01
    low, high = -rng.random(5000), rng.random(5000)
    low[2000:2500] = NAN
    x, y = band(time_s, low, high, points=400)
    assert np.count_nonzero(np.isnan(x)) == 1
    assert len(x) < 900
    assert (np.nanmin(y), np.nanmax(y)) == (np.float32(np.nanmin(low)), np.float32(np.nanmax(high)))
    # A closed outline: there in time and back, over each section's whole length.
    there_and_back = np.split(x, np.flatnonzero(np.isnan(x)))
    ends = [(np.nanmin(part), np.nanmax(part)) for part in there_and_back]
    np.testing.assert_allclose(ends, [(0.0, 19.99), (25.0, 49.99)], rtol=1e-6)


def test_buckets_agree_with_a_plain_loop() -> None:
    rng = np.random.default_rng(6)
    time_s, values = np.sort(rng.random(300)) * 20.0, rng.standard_normal(300)
    values[50:90] = NAN
    found = buckets(time_s, values, 0.7)
    expected = []
    for k in range(29):
        inside = [v for t, v in zip(time_s, values, strict=True) if 0.7 * k <= t < 0.7 * (k + 1) and not math.isnan(v)]
        if inside:
            expected.append(((k + 0.5) * 0.7, min(inside), sum(inside) / len(inside), max(inside)))
    np.testing.assert_allclose(np.transpose(found), expected)


def test_runs_end_at_gaps_and_many_are_drawn_by_majority() -> None:
    gap = runs(np.array([0.0, 1.0, 2.0, 9.0, 10.0]), np.array([1, 1, 1, 1, 0]))
    assert [column.tolist() for column in gap] == [[0.0, 9.0, 10.0], [3.0, 1.0, 1.0], [1, 1, 0]]
    # 30,000 alternations, two thirds of each ten rows being 4: all 4 when drawn in 10 buckets.
    codes = np.tile([4, 2, 4], 10_000)
    many = runs(np.arange(30_000) * 0.01, codes, most=10)
    assert many.code.tolist() == [4]
    np.testing.assert_allclose([many.start_s[0], many.length_s[0]], [0.0, 300.0])
