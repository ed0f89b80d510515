"""The table of a tyre's curve against the curve itself, and against what a limit of grip is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsz_daemon.diagnose.simulation.tyre_curve import bent, curve_of, limited


@pytest.mark.parametrize("brush", [-0.6, 0.0, 0.4, 1.0])
@pytest.mark.parametrize("sharpness", [1.7, 2.5, 4.0, 11.5, 20.5])
def test_the_table_is_the_curve(sharpness: float, brush: float) -> None:
    curve = curve_of(sharpness, brush)
    for x in np.linspace(1e-5, 6.0, 4001).tolist():
        force = x * (1.0 + x**sharpness) ** (-1.0 / sharpness)
        # As it is written of slip angles: theta alpha = x / 3, and all of it slides from 1 on.
        slid = 1.0 - (1.0 - min(x / 3.0, 1.0)) ** 3
        expected = (1.0 - brush) * force + brush * slid
        assert limited(x, 1.0, curve) == pytest.approx(expected, rel=0.0, abs=1e-7)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_force_ends_at_its_limit(sign: float) -> None:
    curve = curve_of(2.5, 0.0)
    for linear_n in (1e3, 1e4, 1e5, 1e9, 1e12):
        force_n = limited(sign * linear_n, 1.0 / 4000.0, curve)
        assert 0.0 < sign * force_n <= min(linear_n, 4000.0) * (1.0 + 1e-9)
    assert sign * limited(sign * 1e9, 1.0 / 4000.0, curve) == pytest.approx(4000.0)


def test_a_clamp_stays_straight_for_longer() -> None:
    early, late = (limited(3000.0, 1.0 / 4000.0, curve_of(n, 0.0)) for n in (2.0, 9.0))
    # F_0 / sqrt(1 + 0.75^2) = 4/5 of it, and next to all of it.
    assert early == pytest.approx(2400.0, rel=1e-9)
    assert 2950.0 < late < 3000.0


def test_without_an_end_a_tyre_is_linear() -> None:
    assert limited(1e5, 0.0, curve_of(2.5, 0.0)) == 1e5


def test_far_beyond_nothing_overflows() -> None:
    assert math.isclose(bent(1e200, 11.5, 0.0), 1e-200)
    assert math.isclose(bent(1e200, 11.5, 1.0), 1e-200)


def test_a_brush_bends_at_once_and_slides() -> None:
    """Half of the limit away 1 - 1/6 + 1/108 of it is left; from three times the limit on, all that there is."""
    brush = curve_of(2.5, 1.0)
    assert limited(2000.0, 1.0 / 4000.0, brush) == pytest.approx(2000.0 * (1.0 - 1.0 / 6.0 + 1.0 / 108.0))
    for linear_n in (12e3, 12.5e3, 1e6):
        assert limited(-linear_n, 1.0 / 4000.0, brush) == pytest.approx(-4000.0)


def test_what_is_no_number_stays_none() -> None:
    assert math.isnan(limited(math.nan, 1.0 / 4000.0, curve_of(2.5, 0.0)))
    assert limited(math.inf, 1.0 / 4000.0, curve_of(2.5, 0.0)) != 0.0
