"""A row of the vocabulary says where it is from, what it needs and what it is like; a drive hears what it lacks."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, drive

from dsz_daemon.diagnose.effects.nameless import NAMELESS
from dsz_daemon.diagnose.effects.row import (
    DURATION,
    LATERAL,
    LONGITUDINAL,
    SPEED,
    STEERING_RATE,
    YAW_ACCELERATION,
    YAW_RATE,
    Effect,
)
from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.search import Search, searched
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict import untested
from dsz_daemon.diagnose.verdict.answer import answered

NAMED = [effect for effect in BUILT_IN.effects if effect not in NAMELESS]
T = np.arange(N) / 100.0


def found(one: Drive) -> Search:
    return searched(one, rows_of(one), TOLERANCE)


@pytest.mark.parametrize("effect", NAMED, ids=lambda effect: effect.name)
def test_a_row_says_where_it_is_from_and_what_it_needs(effect: Effect) -> None:
    assert effect.source
    assert effect.needs
    values = {p.name: 0.0 for p in effect.parameters} | {"friction_coefficient": 0.0, "rms_rad": 0.0, "rms_n": 0.0}
    assert effect.words.format(**values)


@pytest.mark.parametrize("effect", NAMED, ids=lambda effect: effect.name)
def test_what_is_like_another_is_named_by_it_too(effect: Effect) -> None:
    rows = {one.name: one for one in NAMED}
    assert all(effect.name in rows[name].like for name in effect.like)


def test_a_drive_straight_ahead_lacks_bends() -> None:
    """At 15 m/s and a little more, with hardly any steering: r = v delta / L, more with soft rear tyres; a_y = v r."""
    speed = 15.0 + np.sin(0.2 * T)
    one = drive({}, speed, 1e-5 * np.sin(0.5 * T))
    why = {row["effect"]: row["why"] for row in untested.untested(found(one), map)}
    assert why["gyro_scale"].startswith("yaw rate stayed below ")
    most_radps = float(why["gyro_scale"].split("below ")[1].split(" rad/s")[0])
    assert 0.0 < most_radps < 1.5 * 16.0 * 1e-5 / one.car.wheelbase_m
    assert why["steering_compliance"].startswith("lateral acceleration stayed below ")
    most_mps2 = float(why["steering_compliance"].split("below ")[1].split(" m/s2")[0])
    assert most_mps2 == pytest.approx(15.0 * most_radps, rel=0.3)
    assert why["steering_backlash"].startswith("road wheel rate stayed below ")
    assert ": even " in why["gyro_scale"]


def test_the_most_there_was_is_that_of_the_motion() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    search = found(one)
    most = untested._excitation(search)
    at = search.rows.at
    assert most[SPEED] == pytest.approx(np.max(CITY_V[at]), rel=0.1)
    assert most[STEERING_RATE] == pytest.approx(np.max(np.abs(np.gradient(CITY_STEER, 0.01)[at])), rel=0.1)
    # Of a car that answers at once, and holds what it has: v r is what a_y is, but for v_y'.
    assert most[LATERAL] == pytest.approx(np.nanmax(np.abs(one.measured[at, 4])), rel=0.3)
    assert most[YAW_RATE] == pytest.approx(np.nanmax(np.abs(one.measured[at, 2])), rel=0.15)
    assert most[LONGITUDINAL] == pytest.approx(np.max(np.abs(np.gradient(CITY_V, 0.01))), rel=0.3)
    turns = predicted(one, nothing(), flat(N))[:, 2]
    assert most[YAW_ACCELERATION] == pytest.approx(np.max(np.abs(np.gradient(turns, 0.01)[at])), rel=0.1)
    assert most[DURATION] == pytest.approx(N / 100.0, rel=0.1)


@pytest.mark.parametrize(("value", "shown"), [(0.0, 0.0), (2.04, 2.1), (0.0123, 0.013), (15.0, 15.0), (150.1, 160.0)])
def test_what_stayed_below_a_figure_did(value: float, shown: float) -> None:
    assert untested._rounded_up(value) == pytest.approx(shown)


@pytest.mark.parametrize(
    ("effect", "plain"),
    [
        ("tyre_saturation", "friction_coefficient of 1"),
        ("gyro_scale", "x of 0.03"),
        ("imu_delay", "delay_s of 0.02 s"),
    ],
)
def test_a_plain_size_is_told_as_the_outside_knows_it(effect: str, plain: str) -> None:
    assert untested._plain(BUILT_IN.described(effect).parameters[0]) == plain


def test_a_cause_says_where_its_equation_is_from() -> None:
    [cause] = answered(found(drive({"tyre_relaxation.relaxation_length_m": 0.8}, CITY_V, CITY_STEER))).causes
    assert (cause.effect, cause.source) == ("tyre_relaxation", "Pacejka, Tire and Vehicle Dynamics, chapter 7")
