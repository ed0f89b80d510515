"""diagnose: a name that explains only a part of its own channel is none."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, T, drive, found

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.shown_by import shown_by
from dsz_daemon.diagnose.residuals.comparison import noises, rows_of
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict import answer, in_part
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.in_part import explains_a_part, is_of_a_lean, leaves_its_own

QUICK = np.sin(2.0 * np.pi * T / 0.7)
# Louder and louder within ten seconds, again and again.
LOUD = (T % 10.0) / 10.0


@pytest.mark.parametrize(
    ("share", "course", "unexplained", "is_none"),
    [
        (0.0, LOUD, {"gyro_x"}, False),
        (0.25, LOUD, {"gyro_x", "accel_y"}, True),
        (0.25, LOUD, {"accel_y"}, False),
        # As much that comes when there is least of it, or all the time.
        (0.25, 1.0 - LOUD, {"gyro_x"}, False),
        (0.25, np.full(len(T), 0.577), {"gyro_x"}, False),
        (0.10, LOUD, {"gyro_x"}, False),
        (1.8, 1.0 - LOUD, {"gyro_x"}, False),
        (2.2, 1.0 - LOUD, {"gyro_x"}, True),
    ],
)
def test_much_that_is_left_where_a_name_shows_most_is_not_its_own(
    monkeypatch: pytest.MonkeyPatch, share: float, course: np.ndarray, unexplained: set[str], is_none: bool
) -> None:
    """So much of the power that the name shows, in the channel that it shows most in, is left, with such a course."""
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    expected = np.hypot(noises(one), fit.form)
    shown = np.zeros((len(T), 13))
    shown[:, 0], shown[:, 4] = 100.0 * expected[0] * LOUD * QUICK, 50.0 * expected[4] * LOUD * QUICK
    monkeypatch.setattr(in_part, "shown_by", lambda *_: shown)
    left = expected * np.random.default_rng(3).normal(size=fit.left.shape)
    left[:, 0] += np.sqrt(share) * 100.0 * expected[0] * (course * np.cos(2.0 * np.pi * T / 0.7))[rows.at]
    assert explains_a_part(one, rows, fit._replace(left=left), "road_bank", unexplained) is is_none


@pytest.mark.parametrize(
    ("effect", "share", "off", "beside", "is_none"),
    [
        ("gyro_scale", 0.0, "its own", (), False),
        ("gyro_scale", 0.25, "its own", (), True),
        ("gyro_scale", 0.10, "its own", (), False),
        # What is off elsewhere, or by noise of its own, is nothing of its.
        ("gyro_scale", 0.25, "accel_z", (), False),
        ("gyro_scale", 0.25, "none", (), False),
        # A road is but sketched, and a shape is no name.
        ("road_bank", 0.25, "its own", (), False),
        ("gyro_x: k*r", 0.25, "its own", (), False),
        # What a wind leaves is in the channels of a turn alone.
        ("gyro_scale", 0.25, "its own", ("side_wind",), True),
    ],
)
def test_what_has_a_formula_leaves_little_of_what_it_shows(
    monkeypatch: pytest.MonkeyPatch, effect: str, share: float, off: str, beside: tuple[str, ...], is_none: bool
) -> None:
    """Whenever that is left: all the time, here."""
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)._replace(effects=(effect, *beside))
    expected = np.hypot(noises(one), fit.form)
    left = expected * np.random.default_rng(3).normal(size=fit.left.shape)
    for c, channel, is_none_there in ((0, "gyro_x", is_none), (4, "accel_y", is_none and not beside)):
        shown, more = np.zeros((len(T), 13)), left.copy()
        shown[:, c] = 100.0 * expected[c] * QUICK
        monkeypatch.setattr(in_part, "shown_by", lambda *_, shown=shown: shown)
        more[:, c] += np.sqrt(share) * 100.0 * expected[c] * np.cos(2.0 * np.pi * T / 0.7)[rows.at]
        there = {channel if off == "its own" else off}
        assert leaves_its_own(one, rows, fit._replace(left=more), effect, there) is is_none_there


def test_a_name_that_leaves_its_own_channel_off_is_not_said(monkeypatch: pytest.MonkeyPatch) -> None:
    search = found(drive({"gyro_scale.z": 0.05}, CITY_V, CITY_STEER))
    monkeypatch.setattr(answer, "unexplained_of", lambda _, __, by=3.0: ["gyro_z"] if by == answer.TURNED else [])
    assert [cause.effect for cause in answered(search).causes] == ["gyro_scale"]
    shown = shown_by(search.drive, search.best, "gyro_scale")[search.rows.at, 2]
    left = search.best.left.copy()
    left[:, 2] += np.std(shown) * QUICK[search.rows.at]
    assert answered(search._replace(best=search.best._replace(left=left))).causes == []


def test_noise_is_not_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what shows less than its channel's noise that noise is no part that it does not explain."""
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    expected = np.hypot(noises(one), fit.form)
    shown = np.zeros((len(T), 13))
    shown[:, 0] = 0.5 * expected[0] * LOUD * QUICK
    monkeypatch.setattr(in_part, "shown_by", lambda *_: shown)
    left = expected * np.random.default_rng(3).normal(size=fit.left.shape)
    assert not explains_a_part(one, rows, fit._replace(left=left), "road_bank", {"gyro_x"})


@pytest.mark.parametrize("effect", ["gyro_scale", "road_bank", "road_grade", "side_wind"])
def test_what_an_effect_shows_is_what_the_others_do_not(effect: str) -> None:
    """A profile and its parameters, of two effects that are there."""
    one = drive({}, CITY_V, CITY_STEER)
    fit = fitted(one, rows_of(one), nothing(), (), TOLERANCE)
    names = {"road_bank": "bank_rad", "road_grade": "grade_rad", "side_wind": "side_n"}
    course = (100.0 if effect == "side_wind" else 0.02) * np.sin(0.5 * T)
    x, road = fit.x.copy(), fit.road
    x[INDEX["accel_scale.y"]] = 0.1
    without = predicted(one, x, road)
    if effect in names:
        road = road._replace(**{names[effect]: course})
    else:
        x[INDEX["gyro_scale.z"]] = 0.1
    there = fit._replace(x=x, road=road, effects=(effect, "accel_scale"))
    shown = shown_by(one, there, effect)
    assert np.abs(shown).max() > 1e-3
    assert shown == pytest.approx(predicted(one, x, road) - without)
    assert shown_by(one, there._replace(road=flat(len(T)), x=nothing()), effect) == pytest.approx(0.0)


def test_what_is_given_no_name_has_no_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stiffness beyond its tolerance is a cause and two numbers of the car; withheld it is neither."""
    search = found(drive({"cornering_stiffness.front_scale": -0.3}, CITY_V, CITY_STEER))
    told = answered(search)
    assert [cause.effect for cause in told.causes] == ["cornering_stiffness"]
    assert "front_cornering_stiffness_n_per_rad" in {error.parameter for error in told.parameter_errors}
    asked = []
    monkeypatch.setattr(answer, "explains_a_part", lambda *given: bool(asked.append(given[3:])) or True)
    # Where all is explained nothing is asked.
    assert answered(search) == told
    assert asked == []
    monkeypatch.setattr(answer, "unexplained_of", lambda *_: ["gyro_z"])
    withheld = answered(search)
    assert (withheld.causes, withheld.parameter_errors, withheld.verdict) == ([], [], "unexplained")
    assert asked == [("cornering_stiffness", ["gyro_z"])]
    monkeypatch.setattr(answer, "explains_a_part", lambda *_: False)
    assert [cause.effect for cause in answered(search).causes] == ["cornering_stiffness"]
    monkeypatch.setattr(answer, "not_named", lambda *_: {"cornering_stiffness"})
    assert (answered(search).causes, answered(search).parameter_errors) == ([], [])


@pytest.mark.parametrize(
    ("shape", "gain", "there"),
    [("steering: k*ay*|ay|", 100.0, False), ("steering: k*ay*|ay|", 15.0, True), ("gyro_z: k*ay", 100.0, True)],
)
def test_within_their_tolerance_tyres_have_no_numbers_beside_what_turns_a_car_without_a_name(
    monkeypatch: pytest.MonkeyPatch, shape: str, gain: float, there: bool
) -> None:
    """They make up for how that is drawn; beside a sensor, or what is not said, they are what they are."""
    key = "front_cornering_stiffness_n_per_rad"
    search = found(drive({key: -0.08}, CITY_V, CITY_STEER))
    assert [error.parameter for error in answered(search).parameter_errors] == [key]
    monkeypatch.setattr(answer, "unlisted", lambda *_: [])
    monkeypatch.setattr(answer, "shapes_of_all", lambda *_: [])
    told = answered(search._replace(gains={**search.gains, shape: gain}))
    assert [error.parameter for error in told.parameter_errors] == ([key] if there else [])
    # Beyond it they are a cause, which has its numbers.
    soft = found(drive({"cornering_stiffness.front_scale": -0.3}, CITY_V, CITY_STEER))
    told = answered(soft._replace(gains={**soft.gains, shape: gain}))
    assert key in {error.parameter for error in told.parameter_errors}


def test_wheel_speeds_that_are_a_few_milliseconds_late_are_a_cause() -> None:
    """Of 5 ms a drive in town is sure; of what a message takes nothing is said."""
    assert [cause.effect for cause in answered(found(late_by(0.0055))).causes] == ["wheel_speed_delay"]
    assert answered(found(late_by(0.003))).causes == []


def late_by(delay_s: float) -> Drive:
    return drive({"wheel_speed_delay.delay_s": delay_s}, CITY_V + 3.0 * np.sin(0.8 * T), CITY_STEER)


@pytest.mark.parametrize(
    ("effect", "gain", "unexplained", "is_one"),
    [
        ("accel_scale", 18.0, {"gyro_x"}, True),
        ("accel_scale", 18.0, {"accel_y", "gyro_y"}, True),
        ("accel_scale", 18.0, {"gyro_z", "accel_y"}, False),
        ("accel_scale", 400.0, {"gyro_x"}, False),
        ("gyro_scale", 18.0, {"gyro_x"}, False),
        ("accel_scale", 18.0, set(), False),
    ],
)
def test_a_small_scale_beside_a_lean_is_a_part_of_it(
    effect: str, gain: float, unexplained: set[str], is_one: bool
) -> None:
    assert is_of_a_lean(effect, gain, unexplained) == is_one


def test_beside_a_lean_a_small_scale_is_given_no_name(monkeypatch: pytest.MonkeyPatch) -> None:
    search = found(drive({"accel_scale.y": 0.03}, CITY_V, CITY_STEER))
    small = search._replace(gains={"accel_scale": 40.0})
    assert [cause.effect for cause in answered(small).causes] == ["accel_scale"]
    monkeypatch.setattr(answer, "explains_a_part", lambda *_: False)
    for unexplained, gain, there in (("gyro_z", 40.0, True), ("gyro_x", 400.0, True), ("gyro_x", 40.0, False)):
        monkeypatch.setattr(answer, "unexplained_of", lambda *_, c=unexplained: [c])
        said = answered(search._replace(gains={"accel_scale": gain}))
        assert [cause.effect for cause in said.causes] == ["accel_scale"] * there


def test_a_mount_that_tips_to_either_side_is_no_scale() -> None:
    """By 0.15 degrees, once as far as it goes: the gyro that turns with it shows each time."""
    side = predicted(drive({}, CITY_V, CITY_STEER), nothing(), flat(len(T)))[:, 4]
    leans, at = np.zeros(len(T)), 0.0
    for i, pull in enumerate(side):
        at = np.sign(pull) if abs(pull) > 0.8 else at
        leans[i] = 0.0026 * at
    smooth = np.convolve(leans, np.hanning(41) / np.sum(np.hanning(41)), mode="same")

    def add(one: Drive) -> None:
        one.measured[:, 4] -= 9.81 * smooth
        one.measured[:, 0] += np.gradient(smooth, 0.01)

    assert answered(found(drive({}, CITY_V, CITY_STEER, change=add))).causes == []


@pytest.mark.parametrize(("length_m", "is_a_tyres"), [(2.0, True), (3.5, False)])
def test_no_tyre_builds_its_force_up_over_metres(length_m: float, is_a_tyres: bool) -> None:
    """What does (a trailer that swings looked so, simulator 67) is something else."""
    said = answered(found(drive({"tyre_relaxation.relaxation_length_m": length_m}, CITY_V, CITY_STEER)))
    assert [cause.effect for cause in said.causes] == ["tyre_relaxation"] * is_a_tyres
    assert said.verdict == ("explained" if is_a_tyres else "unexplained")
