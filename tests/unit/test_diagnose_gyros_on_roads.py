"""diagnose: gyros that show too much, others' axes, or gravity feel another road: what they show of it is taken off."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import residual, rows_of, sensitivities
from dsz_daemon.diagnose.selection import together, trials
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.shapes.unlisted import Found, as_effect
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.surroundings.profiles import Felt
from dsz_daemon.diagnose.verdict.told_roads import told_road

STEER = 0.03 + 0.5 * CITY_STEER
# Waves that knots could follow, and such that they could not.
LONG = {"road_bank": 0.04 * np.sin(2.0 * np.pi * T / 23.0), "road_grade": 0.05 * np.sin(2.0 * np.pi * T / 17.0)}
SHORT = {"road_bank": 0.03 * np.sin(2.0 * np.pi * T / 5.0), "road_grade": 0.03 * np.sin(2.0 * np.pi * T / 4.0)}


def tilted(
    parameters: dict[str, float], roads: tuple[str, ...], waves: dict[str, np.ndarray] = LONG
) -> tuple[Drive, np.ndarray]:
    """A drive without noise on such roads, by such gyros, and the parameters."""
    level = drive({}, CITY_V, STEER)
    x = nothing()
    for name, value in parameters.items():
        x[INDEX[name]] = value
    road = flat(N)._replace(
        bank_rad=waves["road_bank"] if "road_bank" in roads else np.zeros(N),
        grade_rad=waves["road_grade"] if "road_grade" in roads else np.zeros(N),
    )
    return level._replace(measured=predicted(level, x, road)), x


@pytest.mark.parametrize("unheard", [[], [5], [3, 4, 5]])
@pytest.mark.parametrize("roads", [("road_grade",), ("road_bank",), ("road_bank", "road_grade")])
@pytest.mark.parametrize(
    "parameters",
    [
        {"gyro_scale.x": 0.2, "gyro_scale.y": 0.2},
        {"gyro_scale.z": 0.2},
        {"gyro_cross_axis.xy": 0.3, "gyro_cross_axis.yx": -0.3},
        {"gyro_g_sensitivity.xx": 5e-3, "gyro_g_sensitivity.yx": 5e-3},
        {"gyro_g_sensitivity.xx": 5e-3, "gyro_g_sensitivity.yx": 5e-3, "accel_scale.x": 0.9},
        {"gyro_g_sensitivity.xy": 5e-3, "gyro_g_sensitivity.yy": 5e-3},
        {"gyro_g_sensitivity.xz": 5e-3, "gyro_g_sensitivity.yz": 5e-3},
    ],
)
def test_of_gyros_as_they_are_the_road_is_felt_as_it_is(
    parameters: dict[str, float], roads: tuple[str, ...], unheard: list[int]
) -> None:
    """Forces that gyros show are those that accelerometers do; where one is not there, those of the road itself."""
    one, x = tilted(parameters, roads)
    one.measured[:, unheard] = np.nan
    road = Felt(one, x, roads)(x)
    for name, found in (("road_bank", road.bank_rad), ("road_grade", road.grade_rad)):
        if name in roads:
            assert np.std(found - LONG[name]) < 0.0025


def test_what_gravity_does_to_a_gyro_tilts_no_road() -> None:
    """It is the same all the way, as an offset is: 0.003 (rad/s)/(m/s2) would be 4 rad in 150 s."""
    one, _ = tilted({}, ("road_grade",))
    x = nothing()
    felt = Felt(one, x, ("road_grade",))
    x[INDEX["gyro_g_sensitivity.yz"]] = 1e-5
    assert np.ptp(felt(x).grade_rad - felt(nothing()).grade_rad) < 1e-3 * np.ptp(LONG["road_grade"])


@pytest.mark.parametrize("shown", ["gyro_g_sensitivity.yx", "gyro_g_sensitivity.yy"])
def test_slopes_are_those_of_a_road_that_a_gyro_with_forces_in_it_feels(shown: str) -> None:
    """What it shows of gravity along the road goes round: a hill of a knot makes more hill, e times in 40 s."""
    one, x = tilted({shown: 2.5e-3}, ("road_grade",))
    x[INDEX["road_grade.knot_0"]] = 0.01
    felt, rows = Felt(one, x, ("gyro_g_sensitivity", "road_grade")), rows_of(one)
    columns = [
        INDEX[name] for name in ("road_grade.knot_0", "road_grade.knot_6", "front_cornering_stiffness_n_per_rad")
    ]
    road = felt(x)
    slopes = sensitivities(one, rows, x, road, predicted(one, x, road), columns, felt)
    for at, column in enumerate(columns):
        ends = []
        for sign in (1.0, -1.0):
            there = x.copy()
            there[column] += sign * 1e-4
            ends.append(residual(rows, predicted(one, there, felt(there))))
        secant = np.where(rows.used, (ends[1] - ends[0]) / 2e-4, 0.0)
        off = np.where(rows.used, slopes[:, :, at], 0.0) - secant
        assert np.linalg.norm(off) < 0.03 * np.linalg.norm(secant)


def test_a_grade_is_found_beside_a_gyro_that_shows_forces() -> None:
    """By what it was before there was a road the first rounds lead to a worse one."""
    sensitive = {"gyro_g_sensitivity.yx": 3.4e-3, "gyro_g_sensitivity.xy": 2.9e-3, "gyro_g_sensitivity.zy": -3.9e-3}
    one, _ = tilted(sensitive, ("road_grade",), {"road_grade": LONG["road_grade"] + 0.02 * np.sin(T / 25.0)})
    noise = drive({}, CITY_V, STEER).measured - predicted(one, nothing(), flat(N))
    one = one._replace(measured=one.measured + noise)
    rows = rows_of(one)
    best = fitted(one, rows, nothing(), ("gyro_g_sensitivity",), TOLERANCE)
    trial = trials.Trial(one, rows, best, TOLERANCE, screened(one, rows, best, TOLERANCE, map).known)
    step = trial.fit((("road_grade",), best.x))
    assert step.gain > 100.0
    for name, value in sensitive.items():
        assert step.fit.x[INDEX[name]] == pytest.approx(value, abs=3e-4)


@pytest.mark.parametrize("road", ["road_grade", "road_bank"])
def test_a_gyros_scale_is_told_beside_the_road_that_it_feels(road: str) -> None:
    """By the accelerometer, which shows how far the road tilts."""
    axis = "y" if road == "road_grade" else "x"
    one, x = tilted({"gyro_scale.x": 0.05, "gyro_scale.y": 0.05, "gyro_scale.z": 0.05}, (road,), SHORT)
    noise = drive({}, CITY_V, STEER).measured - predicted(one, nothing(), flat(N))
    one = one._replace(measured=one.measured + noise)
    fit = fitted(one, rows_of(one), nothing(), (road, "gyro_scale"), TOLERANCE)
    at = INDEX[f"gyro_scale.{axis}"]
    assert fit.x[at] == pytest.approx(x[at], abs=0.01)
    assert fit.std[fit.columns.index(at)] < 0.01


@pytest.mark.parametrize("at_once", [True, False])
def test_a_bank_and_a_gyro_that_leaks_are_found_at_once(at_once: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """In town a leak of the yaw rate shows as much as a bank: alone neither leaves less that hangs together."""
    if not at_once:
        monkeypatch.setattr(together, "_SHOWS_MORE", ())
    x = nothing()
    x[INDEX["gyro_cross_axis.xz"]], x[INDEX["gyro_cross_axis.yz"]] = -0.05, 0.05
    one = drive({}, CITY_V, CITY_STEER)
    waves = 0.03 * np.sin(2.0 * np.pi * T / 25.0) + 0.015 * np.sin(2.0 * np.pi * T / 9.0)
    one.measured[:] += predicted(one, x, flat(N)._replace(bank_rad=waves)) - predicted(one, nothing(), flat(N))
    rows = rows_of(one)
    nominal = fitted(one, rows, nothing(), (), TOLERANCE)
    screening = screened(one, rows, nominal, TOLERANCE, map)
    trial = trials.Trial(one, rows, nominal, TOLERANCE, screening.known)
    tried = together.two_at_once(trial, screening, [], set(), map)
    assert (bool(tried) and tried[0].fit.effects == ("gyro_cross_axis", "road_bank")) is at_once
    # A shape of that gyro hides both, too; one of another has nothing to do with them.
    for channel, there in (("gyro_x", at_once), ("gyro_y", False)):
        shape = Found(as_effect(channel, "ay*|ay|", CITY_STEER, "1", 1.0), channel, "k*ay*|ay|", 1.0, 50.0, 1.0, 0.1)
        instead = together.two_instead(trial, screening, [], set(), shape, map)
        assert (("gyro_cross_axis", "road_bank") in [step.fit.effects for step in instead]) is there


@pytest.mark.parametrize(("road", "turns"), [("road_grade", True), ("road_grade", False), ("road_bank", True)])
def test_how_much_a_road_tilts_all_the_way_is_told_where_the_car_turns_on_it(road: str, turns: bool) -> None:
    """About the vertical a car that is tilted turns about its own axes, too; straight ahead an offset does as much.

    Without a vertical accelerometer, that is: g cos tilt tells of it, too; and what steers on a bank tells of that.
    """
    even_rad = 0.02
    level = drive({}, CITY_V, STEER if turns else 0.0 * STEER)
    tilt = SHORT[road] + even_rad
    there = flat(N)._replace(**{"grade_rad" if road == "road_grade" else "bank_rad": tilt})
    shown = predicted(level, nothing(), there) - predicted(level, nothing(), flat(N))
    one = level._replace(measured=level.measured + shown)
    one.measured[:, 5] = np.nan
    fit = fitted(one, rows_of(one), nothing(), (road,), TOLERANCE)
    told, taken_off = told_road(one, fit, [road])
    course = told.grade_rad if road == "road_grade" else told.bank_rad
    if turns:
        assert np.mean(course) == pytest.approx(even_rad, abs=0.1 * np.pi / 180.0)
        assert taken_off == (0.0, 0.0)
        assert np.std(course - tilt) < 0.1 * np.pi / 180.0
    else:
        assert np.mean(course) == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("road", ["road_grade", "road_bank"])
def test_where_no_gyro_feels_a_road_nothing_tells_how_much_it_tilts_all_the_way(road: str) -> None:
    level = drive({}, CITY_V, STEER)
    tilt = LONG[road] + 0.02
    there = flat(N)._replace(**{"grade_rad" if road == "road_grade" else "bank_rad": tilt})
    shown = predicted(level, nothing(), there) - predicted(level, nothing(), flat(N))
    one = level._replace(measured=level.measured + shown)
    one.measured[:, [0, 1, 5]] = np.nan
    fit = fitted(one, rows_of(one), nothing(), (road,), TOLERANCE)
    told, taken_off = told_road(one, fit, [road])
    course = told.grade_rad if road == "road_grade" else told.bank_rad
    assert np.std(course) > 0.01
    assert np.mean(course) == pytest.approx(0.0, abs=1e-4)
    assert any(taken_off)
