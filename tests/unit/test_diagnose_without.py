"""A model with an effect less: roughly where it is sure that the effect stays, exactly where it may have to go."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained
from dsz_daemon.diagnose.fitting.without import slopes_at, surely_without, without
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.simulation.drive import nothing

ONE = drive({"gyro_scale.z": 0.05, "steering_ratio.scale": 0.04}, CITY_V, CITY_STEER)
ROWS = rows_of(ONE)


@pytest.fixture(scope="module")
def both() -> Any:
    return fitted(ONE, ROWS, nothing(), ("gyro_scale", "steering_ratio"), TOLERANCE)


def test_roughly_it_is_worth_what_it_is_worth_exactly(both: Any) -> None:
    known = slopes_at(ONE, ROWS, both)
    roughly = without(ONE, ROWS, both, TOLERANCE, ("steering_ratio",), known=known)
    exact = without(ONE, ROWS, both, TOLERANCE, ("steering_ratio",))
    assert (roughly.is_exact, exact.is_exact) == (False, True)
    assert roughly.effects == exact.effects == ("gyro_scale",)
    assert not roughly.x[list(ONE.vocabulary.columns_of("steering_ratio"))].any()
    assert gained(ONE, roughly, both) == pytest.approx(gained(ONE, exact, both), rel=0.02)


@pytest.mark.parametrize(("worth", "is_exact"), [(30.1, False), (29.9, True)])
def test_what_may_have_to_go_is_gone_exactly(both: Any, worth: float, is_exact: bool) -> None:
    known = slopes_at(ONE, ROWS, both)
    rest = surely_without(ONE, ROWS, both, TOLERANCE, "steering_ratio", known, lambda _: worth)
    assert rest.is_exact is is_exact


def test_slopes_that_lead_nowhere_fit_nothing(both: Any) -> None:
    known = slopes_at(ONE, ROWS, both)
    nowhere = known._replace(values=np.zeros_like(known.values))
    rest = surely_without(ONE, ROWS, both, TOLERANCE, "steering_ratio", nowhere, lambda _: 1e4)
    exact = without(ONE, ROWS, both, TOLERANCE, ("steering_ratio",))
    np.testing.assert_array_equal(rest.x, exact.x)


def test_on_another_road_slopes_are_others() -> None:
    start = nothing()
    tilted = fitted(ONE, ROWS, start, ("gyro_scale", "steering_ratio", "road_bank"), TOLERANCE)
    known = slopes_at(ONE, ROWS, tilted)
    assert without(ONE, ROWS, tilted, TOLERANCE, ("road_bank",), known=known).is_exact
    assert not without(ONE, ROWS, tilted, TOLERANCE, ("gyro_scale",), known=known).is_exact


def test_slopes_that_are_known_are_those_that_a_screening_takes(both: Any) -> None:
    alone = screened(ONE, ROWS, both, TOLERANCE, map)
    beside = screened(ONE, ROWS, both, TOLERANCE, map, slopes_at(ONE, ROWS, both))
    assert set(beside.known.columns) == set(alone.known.columns)
    np.testing.assert_array_equal(beside.known.at(alone.known.columns), alone.known.values)
    # Known ones come first.
    assert beside.known.columns[: len(both.columns)] == both.columns
    assert beside.names == alone.names


def test_slopes_of_another_place_are_taken_again(both: Any) -> None:
    known = slopes_at(ONE, ROWS, both)
    elsewhere = both._replace(x=1.001 * both.x)
    taken = screened(ONE, ROWS, elsewhere, TOLERANCE, map, known)
    alone = screened(ONE, ROWS, elsewhere, TOLERANCE, map)
    np.testing.assert_array_equal(taken.known.at(alone.known.columns), alone.known.values)
