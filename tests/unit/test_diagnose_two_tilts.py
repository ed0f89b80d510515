"""diagnose: a road that banks and climbs at once, which in a bend become each other."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.surroundings import KNOTS
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import rows_of, sensitivities
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import Profiles, flat, on_road
from dsz_daemon.diagnose.surroundings.profiles import Felt

BOTH = ("road_bank", "road_grade")
INCLINE_RAD, G = 0.05, 9.80665


def knots(profile: str) -> list[int]:
    return [INDEX[f"{profile}.knot_{k}"] for k in range(KNOTS)]


def heading_rad(one: Drive) -> np.ndarray:
    """By the yaw rate that the car has, which is a little less than what its steering says."""
    return np.asarray(np.cumsum(driven(one, nothing(), flat(N)).moved[:, 1]) * (T[1] - T[0]))


def inclined(degrees: float, springs: np.ndarray | None = None) -> tuple[Drive, np.ndarray, np.ndarray]:
    """A car, its body on such springs, goes round on a plane that climbs that way from where it began; its tilts."""
    steer = 0.03 + 0.5 * CITY_STEER
    level = drive({}, CITY_V, steer)
    ahead = heading_rad(level) - np.radians(degrees)
    # Turned to the left of what climbs, what climbs is to the right: the left side is lower.
    bank_rad, grade_rad = -INCLINE_RAD * np.sin(ahead), INCLINE_RAD * np.cos(ahead)
    noise = level.measured - predicted(level, nothing(), flat(N))
    road = flat(N)._replace(bank_rad=bank_rad, grade_rad=grade_rad)
    x = nothing() if springs is None else springs
    return level._replace(measured=predicted(level, x, road) + noise), bank_rad, grade_rad


@pytest.mark.parametrize("degrees", [0.0, 90.0])
def test_on_a_plane_gyros_feel_no_tilt_and_what_it_was_at_first_turns_with_the_car(degrees: float) -> None:
    one, bank_rad, grade_rad = inclined(degrees)
    x = nothing()
    x[knots("road_bank")], x[knots("road_grade")] = bank_rad[0], grade_rad[0]
    road = on_road(Felt(one, x, BOTH)(x), x)
    assert np.std(road.bank_rad - bank_rad) < 0.1 * INCLINE_RAD
    assert np.std(road.grade_rad - grade_rad) < 0.1 * INCLINE_RAD


@pytest.mark.parametrize("degrees", [0.0, 45.0, 90.0])
def test_a_body_on_springs_turns_further_with_what_the_plane_was_at_first(degrees: float) -> None:
    """It squats by 20 % more than the plane climbs: so much more is turned into a bank."""
    x = nothing()
    x[INDEX["suspension_pitch.pitch_gradient_rad_per_mps2"]] = 0.2 / G
    one, bank_rad, grade_rad = inclined(degrees, x)
    x[knots("road_bank")], x[knots("road_grade")] = bank_rad[0], grade_rad[0]
    road = on_road(Felt(one, x, (*BOTH, "suspension_pitch"))(x), x)
    assert np.std(road.bank_rad - bank_rad) < 0.06 * INCLINE_RAD
    assert np.std(road.grade_rad - grade_rad) < 0.06 * INCLINE_RAD


@pytest.mark.parametrize("first", ["road_bank", "road_grade"])
def test_one_after_the_other_a_bank_and_a_grade_are_found_as_they_are(first: str) -> None:
    """With gyros that are off by 0.06 deg/s, which carries the one angle away and, in bends, the other."""
    one, bank_rad, grade_rad = inclined(30.0)
    one.measured[:, :2] += (0.001, -0.001)
    rows = rows_of(one)
    alone = fitted(one, rows, nothing(), (first,), TOLERANCE)
    found = fitted(one, rows, alone.x, (first, next(name for name in BOTH if name != first)), TOLERANCE)
    road = on_road(found.road, found.x)
    assert np.degrees(np.std(road.bank_rad - bank_rad)) < 0.1
    assert np.degrees(np.std(road.grade_rad - grade_rad)) < 0.1


def test_slopes_of_a_correction_know_what_it_turns_into() -> None:
    one, *_ = inclined(0.0)
    rows, x = rows_of(one), nothing()
    felt, columns = Felt(one, x, BOTH), [knots("road_bank")[4], knots("road_grade")[7]]
    base, step = predicted(one, x, felt(x)), 0.02
    slopes = sensitivities(one, rows, x, felt(x), base, columns, felt)
    for place, i in enumerate(columns):
        there = x.copy()
        there[i] = step
        expected = (predicted(one, there, felt(there)) - base)[rows.at] / step
        held = (predicted(one, there, felt(x)) - base)[rows.at] / step
        for c in (0, 1, 3, 4):
            used = rows.used[:, c]
            off, lost = (np.std((other - expected)[used, c]) for other in (slopes[:, :, place], held))
            assert off < 1e-6 + 0.1 * lost


@pytest.mark.parametrize("effects", [("road_bank",), ("road_grade",)])
def test_where_a_road_only_banks_or_only_climbs_nothing_turns_into_the_other(effects: tuple[str, ...]) -> None:
    one, *_ = inclined(0.0)
    x = nothing()
    felt, road = Felt(one, x, effects), Felt(one, x, effects)(x)
    x[knots(effects[0])] = 0.1
    assert not felt.changes_with(effects[0])
    same(felt(x), road)


def test_what_was_felt_for_some_parameters_is_not_taken_for_others() -> None:
    one, *_ = inclined(0.0)
    x, other = nothing(), nothing()
    other[INDEX["gyro_cross_axis.xz"]], other[INDEX["gyro_cross_axis.yz"]] = 0.05, -0.1
    felt = Felt(one, x, BOTH)
    first = felt(x)
    same(felt(other), Felt(one, x, BOTH)(other))
    same(felt(x), first)
    assert np.max(np.abs(felt(other).bank_rad - first.bank_rad)) > 1e-4
    # Nor on another road: forces that are in no simulation lean a soft body.
    x[INDEX["suspension_roll.roll_gradient_rad_per_mps2"]] = 0.01
    felt = Felt(one, x, BOTH)
    level = felt(x)
    one.measured[:, 4] += 5.0 * np.sin(2.0 * np.pi * T / 7.0)
    leaning = felt.leaning(x, driven(one, x, level), predicted(one, x, level))
    assert np.max(np.abs(leaning(x).bank_rad - level.bank_rad)) > 1e-3


@pytest.mark.parametrize("part", ["side_n", "lean_mps2", "lean_share"])
def test_the_same_parameters_in_another_air_are_felt_as_another_road(part: str) -> None:
    """A wind that leans a soft body turns the gyro, and what of a bank is told twice depends on the share."""
    one, *_ = inclined(0.0)
    x = nothing()
    x[INDEX["suspension_roll.roll_gradient_rad_per_mps2"]], x[INDEX["side_wind.leans"]] = 0.003, 1.0
    felt = Felt(one, x, (*BOTH, "suspension_roll", "side_wind"))
    calm, blows = felt(x), np.sin(2.0 * np.pi * T / 7.0)
    pushed = {"side_n": 3000.0 * blows, "lean_mps2": blows, "lean_share": 1.0}[part]
    road = felt._first._replace(**{part: pushed})
    fresh = Felt(one, x, (*BOTH, "suspension_roll", "side_wind"))
    fresh._turned = None
    same(felt._tilted(road, x), fresh._tilted(road, x))
    assert np.max(np.abs(felt._tilted(road, x).bank_rad - calm.bank_rad)) > 1e-3


def same(one: Profiles, other: Profiles) -> None:
    np.testing.assert_array_equal(one.bank_rad, other.bank_rad)
    np.testing.assert_array_equal(one.grade_rad, other.grade_rad)
