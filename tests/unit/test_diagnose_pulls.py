"""A car that goes to one side by much as it is driven, or braked: by what its speed does, or by force at its wheels."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.comparison import rows_of
from dsz_daemon.diagnose.fit import fitted
from dsz_daemon.diagnose.prediction import nothing
from dsz_daemon.diagnose.pulls import BY_FORCE, PULLS, by_force
from dsz_daemon.diagnose.search import searched
from dsz_daemon.diagnose.unlisted import pull_shapes


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_car_that_is_steered_by_its_drive_is_told_so_by_what_does_it(share: float) -> None:
    one = drive({"drive_steer": 2e-3, "steers_by_force": share}, CITY_V, CITY_STEER)
    found = searched(one, rows_of(one), TOLERANCE)
    assert found.best.effects == ()
    place = found.best.columns.index(BY_FORCE)
    assert found.best.x[BY_FORCE] == pytest.approx(share, abs=max(3.0 * found.best.std[place], 0.01))
    [shape] = pull_shapes(found.drive, found.best)
    assert (shape.channel, shape.shape) == ("gyro_z", "k*ax where ax > 0")
    assert shape.coefficient.value == pytest.approx(2e-3, abs=3.0 * shape.coefficient.std)


def test_by_how_speed_changes_alone_it_would_be_something_else() -> None:
    one = drive({"drive_steer": 2e-3, "steers_by_force": 1.0}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    by_rate = fitted(one, rows, nothing(), (), TOLERANCE)
    assert BY_FORCE not in by_rate.columns
    start = by_force(by_rate.x, by_rate.std, by_rate.columns)
    assert start is not None
    right = fitted(one, rows, start, (), TOLERANCE)
    assert np.sum(right.left[:, 2] ** 2) < 0.9 * np.sum(by_rate.left[:, 2] ** 2)


@pytest.mark.parametrize(
    ("value", "std", "is_one"), [(4e-4, 7e-5, True), (-4e-4, 7e-5, True), (4e-4, 9e-5, False), (3e-4, 1e-6, False)]
)
@pytest.mark.parametrize("place", [0, 1])
def test_what_is_little_or_not_sure_is_none(place: int, value: float, std: float, is_one: bool) -> None:
    x = nothing()
    x[PULLS[place]] = value
    found = by_force(x, np.array([1e-6, std]), (PULLS[1 - place], PULLS[place]))
    assert (found is not None) == is_one
    if found is not None:
        assert found[BY_FORCE] == 1.0
        assert found[PULLS[place]] == value
    assert by_force(x, np.zeros(0), ()) is None
