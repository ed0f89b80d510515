"""diagnose: tyres whose grip ends as a brush's does, and how sure it is that it ends at all."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, drive, found

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.spreads import spread_of
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.guesses import guesses
from dsz_daemon.diagnose.selection.plausible import is_told
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.car import car_of
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.simulation.tyre_curve import bent
from dsz_daemon.diagnose.verdict import numbers
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.grip import _SHAPES, over_shapes, shape

FRICTION = 0.4
LIMIT, SHARPNESS, BRUSH = (INDEX[f"tyre_saturation.{name}"] for name in ("inverse_square", "sharpness", "brush"))
BRUSHES = {"tyre_saturation.inverse_square": FRICTION**-2, "tyre_saturation.brush": 1.0}


def test_an_axle_of_brushes_pushes_as_one() -> None:
    """F = mu F_z (1 - (1 - theta alpha)^3), theta = C / (3 mu F_z)."""
    one, x = drive({}, CITY_V, 2.0 * CITY_STEER), nothing()
    x[[LIMIT, BRUSH]] = FRICTION**-2, 1.0
    moving, car = driven(one, x, flat(N)), car_of(one, x)
    rolls = moving.v_mps > 3.0
    ahead = np.arctan((moving.moved[:, motion.VY] + car.cg_to_front_axle_m * moving.moved[:, motion.R]) / moving.v_mps)
    slip = (moving.moved[:, motion.DELTA] - ahead)[rolls]
    wheelbase_m = car.cg_to_front_axle_m + car.cg_to_rear_axle_m
    most_n = FRICTION * car.mass_kg * 9.80665 * car.cg_to_rear_axle_m / wheelbase_m
    slides = np.minimum(car.front_stiffness * np.abs(slip) / (3.0 * most_n), 1.0)
    expected = np.sign(slip) * most_n * (1.0 - (1.0 - slides) ** 3)
    assert np.max(slides) > 0.6
    np.testing.assert_allclose(moving.moved[rolls, motion.FRONT_N], expected, rtol=0.0, atol=1e-3 * most_n)


def test_brushes_are_named_and_tyres_within_their_tolerance_are_not_blamed() -> None:
    """Without their curve stiffnesses gave way to the end of their tolerance, and the friction with them."""
    search = found(drive(BRUSHES, CITY_V, 1.3 * CITY_STEER))
    assert 0.5 < search.best.x[BRUSH] <= 1.0
    told = answered(search)
    assert (told.verdict, [cause.effect for cause in told.causes]) == ("explained", ["tyre_saturation"])
    friction = told.causes[0].parameters["friction_coefficient"]
    assert isinstance(friction.value, float)
    assert friction.std is not None
    assert abs(friction.value - FRICTION) < 1.96 * friction.std < 0.25
    assert told.parameter_errors == []


@pytest.mark.parametrize("brush", [0.0, 0.5, 1.0])
def test_a_limit_is_read_off_the_curve_that_was_fitted(brush: float) -> None:
    """What the forces are over is the same whatever bends them; a brush is one of the shapes it may have been."""
    demand = np.linspace(0.05, 4.0, 300)
    mean, spread = over_shapes(shape(demand, 2.5, brush), 2.5, brush)
    assert abs(mean - 1.0) < 2.0 * spread < 0.3
    # Another curve than that of the forces reads another demand off them, and all limits with it.
    other = 1.0 if brush < 1.0 else 0.0
    assert over_shapes(shape(demand, 2.5, brush), 2.5, other)[0] != pytest.approx(mean, abs=1e-3)


def test_the_shapes_are_those_of_the_simulation() -> None:
    slid = 1.0 - (1.0 - np.minimum(np.array([0.3, 1.5, 2.9, 3.5, 40.0]) / 3.0, 1.0)) ** 3
    np.testing.assert_allclose(shape(np.array([0.3, 1.5, 2.9, 3.5, 40.0]), 2.5, 1.0), slid, rtol=1e-12)
    assert shape(np.array([1.0]), 2.0, 0.0)[0] == pytest.approx(2.0**-0.5)
    # Of many at once it is what the simulation has of one.
    x = np.linspace(0.05, 12.0, 100)
    for sharpness, brush in ((1.7, -0.6), (2.5, 0.0), (4.0, 0.4), (9.0, 1.0)):
        each = [one * bent(one, sharpness, brush) for one in x.tolist()]
        np.testing.assert_allclose(shape(x, sharpness, brush), each, rtol=1e-12)


def test_a_brush_and_what_never_gets_to_its_limit_are_among_the_shapes() -> None:
    x = np.array([0.2, 0.5, 1.0, 2.5, 10.0])
    brush, slow = 1.0 - (1.0 - np.minimum(x / 3.0, 1.0)) ** 3, np.array([0.2, 0.5, 0.75, 0.9, 0.975])
    for expected in (brush, slow):
        assert sum(np.allclose(one(x), expected) for one in _SHAPES) == 1


def test_a_limit_is_as_sure_as_its_curve_has_it() -> None:
    """Of numbers of one curve, with which a limit hangs together by 0.6 and 0.48: 1 - 0.36 - 0.2304 = 0.64^2."""
    columns = (LIMIT, SHARPNESS, BRUSH, INDEX["gyro_scale.z"])
    covariance = np.diag([4.0, 9.0, 1.0, 1.0])
    covariance[0, 1] = covariance[1, 0] = 0.6 * 2.0 * 3.0
    covariance[0, 2] = covariance[2, 0] = 0.48 * 2.0 * 1.0
    # What other numbers share with it is no matter of a curve.
    covariance[0, 3] = covariance[3, 0] = 1.5
    fit: Any = SimpleNamespace(columns=columns, covariance=covariance, std=np.array([2.2, 3.0, 1.0, 1.0]))
    assert spread_of(fit, LIMIT) == pytest.approx(2.2 * 0.64)
    assert spread_of(fit, SHARPNESS) == 3.0
    assert spread_of(fit, INDEX["gyro_scale.z"]) == 1.0


def test_whether_grip_ends_is_told_whatever_bends_it() -> None:
    one = drive({"tyre_saturation.inverse_square": 0.62**-2}, CITY_V, CITY_STEER)
    rows, x = rows_of(one), nothing()
    x[[LIMIT, SHARPNESS, BRUSH]] = 0.62**-2, 0.01, 0.01
    fit = fitted(one, rows, x, ("tyre_saturation",), TOLERANCE)
    at = fit.columns.index(LIMIT)
    assert spread_of(fit, LIMIT) < 0.5 * fit.std[at]
    # As wide as that over all curves, and as narrow for each.
    wide = fit._replace(std=fit.std * (0.6 * fit.x[LIMIT] / fit.std[at]))
    assert wide.x[LIMIT] < 2.0 * wide.std[at]
    assert is_told(one, wide, "tyre_saturation")


def test_both_limits_begin_as_a_brush_in_part() -> None:
    """What a guess has none of is not fitted."""
    ice = {"low_friction.inverse_square": FRICTION**-2, "low_friction.brush": 1.0}
    ice |= {"low_friction.start_s": 20.0, "low_friction.end_s": 40.0}
    for left_out in (BRUSHES, ice):
        effect = next(iter(left_out)).partition(".")[0]
        one = drive(left_out, CITY_V, 1.3 * CITY_STEER)
        rows = rows_of(one)
        start = dict(guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)))[effect]
        assert 0.0 < start[INDEX[f"{effect}.brush"]] < 0.1


def test_a_share_comes_with_the_curve_that_it_was_fitted_with() -> None:
    one, x = drive({}, CITY_V, CITY_STEER), nothing()
    x[[LIMIT, SHARPNESS, BRUSH]] = FRICTION**-2, -0.5, 0.7
    search: Any = SimpleNamespace(drive=one, best=SimpleNamespace(x=x, road=flat(N)), rows=rows_of(one))
    _, sharpness, brush = numbers._front_share(search, "tyre_saturation")
    assert (sharpness, brush) == pytest.approx((2.0, 0.7))


def test_no_limit_is_told_better_than_tyres_have_curves() -> None:
    """Far beyond the limit all shapes agree to a percent; a tyre has none of them."""
    mean, spread = over_shapes(shape(np.linspace(6.0, 12.0, 200), 2.5, 0.0), 2.5)
    assert mean == pytest.approx(1.0, abs=0.03)
    assert 0.03 <= spread < 0.05
