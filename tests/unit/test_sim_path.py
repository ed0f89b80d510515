"""The way over the ground: circles, slopes and banks by geometry, and a scenario's height by its road."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from dsz_daemon.sim.catalogue import SCENARIOS
from dsz_daemon.sim.path import path
from dsz_daemon.sim.scenario import drawn_errors, simulate_scenario

ROWS = 2001


def held(value: float) -> NDArray[np.float64]:
    return np.full(ROWS, value)


def test_a_lap_of_a_circle_ends_where_it_began_a_diameter_from_its_half() -> None:
    """10 m/s and a turn of 20 s: a radius of 100 / pi, to the left of the first heading."""
    yaw = np.linspace(0.0, 2.0 * math.pi, ROWS)
    found = path(held(10.0), held(0.0), yaw, held(0.0), held(0.0), 0.01)
    assert found["east_m"][-1] == pytest.approx(0.0, abs=1e-3)
    assert found["north_m"][-1] == pytest.approx(0.0, abs=1e-3)
    assert found["north_m"][ROWS // 2] == pytest.approx(200.0 / math.pi, abs=1e-3)
    assert found["east_m"].max() == pytest.approx(100.0 / math.pi, abs=1e-3)
    assert np.all(found["height_m"] == 0.0)


def test_a_slope_lifts_by_its_sine_and_shortens_by_its_cosine() -> None:
    found = path(held(10.0), held(0.0), held(math.pi / 2.0), held(0.3), held(0.1), 0.01)
    assert found["height_m"][-1] == pytest.approx(200.0 * math.sin(0.1))
    assert found["north_m"][-1] == pytest.approx(200.0 * math.cos(0.1))
    assert found["east_m"][-1] == pytest.approx(0.0, abs=1e-9)


def test_slipping_to_the_left_climbs_a_bank_whose_left_is_high() -> None:
    found = path(held(0.0), held(1.0), held(0.0), held(0.2), held(0.0), 0.01)
    assert found["height_m"][-1] == pytest.approx(20.0 * math.sin(0.2))
    assert found["north_m"][-1] == pytest.approx(20.0 * math.cos(0.2))
    assert found["east_m"][-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("bank", "grade"), [(0.0, 0.0), (0.2, 0.1), (-0.3, 0.2), (0.25, -0.3)])
def test_the_way_is_as_long_as_the_speed_says_whatever_the_tilt(bank: float, grade: float) -> None:
    found = path(held(3.0), held(4.0), held(1.0), held(bank), held(grade), 0.01)
    end = [found[name][-1] for name in ("east_m", "north_m", "height_m")]
    assert math.hypot(*end) == pytest.approx(5.0 * 20.0)


def test_speed_that_grows_evenly_is_summed_exactly() -> None:
    found = path(np.linspace(0.0, 20.0, ROWS), held(0.0), held(0.0), held(0.0), held(0.0), 0.01)
    assert found["east_m"][0] == 0.0
    assert found["east_m"][-1] == pytest.approx(200.0)


def test_the_papers_hill_is_as_deep_as_its_road() -> None:
    """6.5 deg between the middles of two smooth steps, 131 m and 420 m along the road."""
    truth = simulate_scenario("hill", SCENARIOS["bank_and_incline"], 1, drawn_errors(1)).truth
    assert truth["height_m"][-1] == pytest.approx(-math.sin(math.radians(6.5)) * (420.0 - 131.0), abs=0.2)
    steps = [np.diff(truth[name]) for name in ("east_m", "north_m", "height_m")]
    assert np.sqrt(np.sum(np.square(steps), axis=0)).sum() == pytest.approx(truth["distance_m"][-1], rel=1e-3)
