"""A car that goes to one side by much as it is driven, or braked: by what its speed does, or by force at its wheels."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.shapes.unlisted import pull_shapes
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.simulation.pulls import BY_FORCE, PULLS, by_force, pulled_rad
from dsz_daemon.diagnose.simulation.rolling import Slip, rolling


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
    # By as much as a name would have to gain.
    assert gained(one, by_rate, right) > LEAST_GAIN


@pytest.mark.parametrize(("grade_rad", "of"), [(0.0, 1e-3), (0.02, 1e-3), (-0.05, 2e-3)])
def test_at_even_speed_force_is_what_rolling_air_and_a_climb_take(grade_rad: float, of: float) -> None:
    """0.12 m/s2 and 2.6e-4 v^2 and g gamma; down a hill of five per cent at 20 m/s it is braked."""
    n, car = 500, drive({}, CITY_V, CITY_STEER).car
    none, v = np.zeros(n), np.full(n, 20.0)
    slip = Slip(0.0, 0.0, 0.0, 0.0)
    found = rolling(car, none, v, False, slip, none, np.full(n, grade_rad), (1e-3, 2e-3, 1.0))
    force_mps2 = 0.12 + 2.6e-4 * 20.0**2 + 9.80665 * grade_rad
    assert (force_mps2 > 0.0) == (of == 1e-3)
    np.testing.assert_allclose(found.steer_rad, of * force_mps2, atol=1e-12)
    assert not rolling(car, none, v, False, slip, none, np.full(n, grade_rad), (1e-3, 2e-3, 0.0)).steer_rad.any()


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


def test_a_pull_turns_the_wheels_by_what_drives_and_by_what_brakes() -> None:
    x = nothing()
    x[list(PULLS)] = 2e-3, 5e-4
    np.testing.assert_allclose(pulled_rad(x, np.array([1.5, 0.0, -4.0])), [3e-3, 0.0, -2e-3], rtol=1e-12)
