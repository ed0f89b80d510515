"""diagnose: a road whose tilts stay as they are in a bend; and what instruments alone make of the motion."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import COLUMNS, INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.simulation.prediction import SHOWN, predicted
from dsz_daemon.diagnose.simulation.road import flat, on_road
from dsz_daemon.diagnose.surroundings.profiles import Felt, undrawn

FLAT_ROADS, FLAT_BENDS = INDEX["flat_roads"], INDEX["flat_bends"]
BANK_RAD = 0.03 * np.sin(0.25 * T) + 0.02 * np.sin(0.07 * T)
STEER = 0.02 + 0.7 * CITY_STEER
LEAK = 0.05


def banked(flat_bends: float, leak: float) -> Drive:
    """A drive on a bank, drawn one way or the other, whose pitch gyro shows so much of the yaw rate."""
    level = drive({}, CITY_V, STEER)
    noise = level.measured - predicted(level, nothing(), flat(N))
    x = nothing()
    x[FLAT_BENDS], x[INDEX["gyro_cross_axis.yz"]] = flat_bends, leak
    return level._replace(measured=predicted(level, x, flat(N)._replace(bank_rad=BANK_RAD)) + noise)


@pytest.mark.parametrize("flat_bends", [0.0, 1.0])
def test_a_bank_that_stays_in_a_bend_hides_no_leak_and_needs_no_scale(flat_bends: float) -> None:
    one = banked(flat_bends, LEAK)
    best = searched(one, rows_of(one), TOLERANCE).best
    assert set(best.effects) == {"road_bank", "gyro_cross_axis"}
    assert best.x[INDEX["gyro_cross_axis.yz"]] == pytest.approx(LEAK, abs=0.003)
    assert best.x[FLAT_BENDS] == pytest.approx(flat_bends, abs=0.1)
    assert np.degrees(np.std(on_road(best.road, best.x).bank_rad - BANK_RAD)) < 0.1


def test_how_a_road_is_drawn_is_asked_wherever_it_tilts() -> None:
    assert undrawn(()) == undrawn(("suspension_roll",)) == {FLAT_ROADS, FLAT_BENDS}
    assert undrawn(("road_bank", "gyro_scale")) == undrawn(("road_grade",)) == set()
    assert undrawn(("road_grade", "road_bank")) == set()
    one = banked(1.0, 0.0)
    fit = fitted(one, rows_of(one), nothing(), ("road_bank",), TOLERANCE)
    assert FLAT_BENDS in fit.columns
    assert fit.x[FLAT_BENDS] > 0.8
    # What is not asked any more is as it is of a road.
    without = fitted(one, rows_of(one), fit.x, ("gyro_scale",), TOLERANCE)
    assert FLAT_BENDS not in without.columns
    assert without.x[FLAT_BENDS] == 0.0


@pytest.mark.parametrize("flat_bends", [0.0, 1.0])
def test_a_road_that_climbs_and_banks_is_found_however_it_is_drawn(flat_bends: float) -> None:
    """A climb in bends shows the roll gyro r times itself, or nothing; of two tilts each shows the other's gyro."""
    level = drive({}, CITY_V, STEER)
    noise = level.measured - predicted(level, nothing(), flat(N))
    x, grade_rad = nothing(), 0.04 * np.sin(0.11 * T + 1.0) + 0.02 * np.sin(0.31 * T)
    x[FLAT_BENDS] = flat_bends
    for bank_rad in (0.0 * BANK_RAD, BANK_RAD):
        road = flat(N)._replace(bank_rad=bank_rad, grade_rad=grade_rad)
        one = level._replace(measured=predicted(level, x, road) + noise)
        best = searched(one, rows_of(one), TOLERANCE).best
        assert set(best.effects) == {"road_grade", *(["road_bank"] if bank_rad.any() else [])}
        assert best.x[FLAT_BENDS] == pytest.approx(flat_bends, abs=0.15)
        found = on_road(best.road, best.x)
        assert np.degrees(np.std(found.grade_rad - grade_rad)) < 0.1
        assert np.degrees(np.std(found.bank_rad - bank_rad)) < 0.1


def test_what_a_gyros_scale_does_to_a_tilt_that_turns_is_no_way_to_draw_it() -> None:
    one = banked(1.0, 0.0)
    rows = rows_of(one)
    bank = fitted(one, rows, nothing(), ("road_bank",), TOLERANCE)
    both = fitted(one, rows, bank.x, ("road_bank", "gyro_scale"), TOLERANCE, felt=bank.felt)
    assert FLAT_BENDS not in both.columns
    assert both.x[FLAT_BENDS] == bank.x[FLAT_BENDS] > 0.8
    # A road that is new is asked.
    assert FLAT_BENDS in fitted(one, rows, nothing(), ("road_bank", "gyro_scale"), TOLERANCE).columns


def test_of_two_tilts_that_do_not_turn_into_each_other_neither_is_the_others() -> None:
    """A climb of 0.05 rad in a bend, and a level bank: what the car turns makes no bank of the climb."""
    level = drive({}, CITY_V, STEER)
    x = nothing()
    x[FLAT_BENDS] = 1.0
    x[[INDEX[f"road_grade.knot_{k}"] for k in range(12)]] = 0.05
    grade = flat(N)._replace(grade_rad=np.full(N, 0.05))
    one = level._replace(measured=predicted(level, x, grade))
    road = on_road(Felt(one, x, ("road_bank", "road_grade"))(x), x)
    assert np.std(road.bank_rad) < 1e-3
    x[FLAT_BENDS] = 0.0
    turned = on_road(Felt(one, x, ("road_bank", "road_grade"))(x), x)
    assert np.std(turned.bank_rad) > 1e-2


@pytest.mark.parametrize("column", sorted(SHOWN), ids=lambda column: COLUMNS[column][1].name)
def test_what_instruments_alone_make_of_the_motion_moves_nothing(column: int) -> None:
    one, road, x = drive({}, CITY_V, STEER), flat(N)._replace(bank_rad=BANK_RAD, grade_rad=0.5 * BANK_RAD), nothing()
    for name in ("suspension_roll.roll_gradient_rad_per_mps2", "suspension_pitch.pitch_gradient_rad_per_mps2"):
        x[INDEX[name]] = 0.005
    before, shown_before = driven(one, x, road), predicted(one, x, road)
    x[column] += 0.3
    after = driven(one, x, road)
    np.testing.assert_array_equal(after.moved, before.moved)
    np.testing.assert_array_equal(after.wheels, before.wheels)
    assert not np.array_equal(predicted(one, x, road), shown_before)
