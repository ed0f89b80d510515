"""diagnose: what tips at once, follows the drive, comes on board or slips on its shaft is no road and no wind."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive, found

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection import plausible, tilts
from dsz_daemon.diagnose.selection.guesses import guesses
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.selection.tilts import follows_the_drive, tips_at_once, tips_once, tips_standing
from dsz_daemon.diagnose.shapes import unlisted
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.motion import AY
from dsz_daemon.diagnose.simulation.moving import driven, since
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.surroundings.winds import changes_once, follows_the_car
from dsz_daemon.diagnose.verdict import unnamed
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.unnamed import not_named

PULL_MPS2 = np.gradient(CITY_V, T)
SIDE = driven(drive({}, CITY_V, CITY_STEER), nothing(), flat(N)).moved[:, AY]
AHEAD = {"road_bank": "bank_rad", "road_grade": "grade_rad"}


def over(course: np.ndarray, road: str = "road_bank") -> Any:
    return SimpleNamespace(x=nothing(), road=flat(N)._replace(**{AHEAD[road]: course}), effects=(road,), columns=())


@pytest.mark.parametrize("road", sorted(AHEAD))
@pytest.mark.parametrize(
    ("tilt_rad", "is_loose"),
    [
        (0.02 * np.sign(np.sin(0.9 * T)), True),
        # As much, within two seconds or more; a stretch that goes up and down again; two tips only.
        (0.02 * np.sin(0.9 * T), False),
        (0.02 * np.clip(3.0 * np.sin(0.3 * T), -1.0, 1.0), False),
        (0.02 * np.exp(-(((T - 30.0) / 3.0) ** 2)), False),
        (0.02 * np.sign(np.sin(0.15 * T)), False),
        # What goes on and on besides is no bracket at rest.
        (0.02 * np.sign(np.sin(0.9 * T)) + 0.01 * np.sin(5.0 * T), False),
        # What is quick and small is a gyro's noise.
        (0.02 * np.sin(0.9 * T) + 0.002 * np.sin(40.0 * T), False),
    ],
)
def test_what_tips_at_once_time_and_again_is_a_bracket(tilt_rad: np.ndarray, is_loose: bool, road: str) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    assert tips_at_once(one, over(tilt_rad, road), road) is is_loose
    assert not tips_at_once(one._replace(wheels=np.zeros((N, 4))), over(tilt_rad, road), road)


@pytest.mark.parametrize(
    ("bank_rad", "follows"),
    [
        (0.02 * PULL_MPS2, True),
        (-0.02 * np.maximum(PULL_MPS2, 0.0), True),
        (0.02 * np.minimum(PULL_MPS2, 0.0), True),
        # A tenth of it is noise; half of it is something else; a road that has about its period.
        (0.02 * PULL_MPS2 + 0.005 * np.sin(0.77 * T), True),
        (0.02 * PULL_MPS2 + 0.017 * np.sin(0.77 * T), False),
        (0.02 * np.sin(0.4 * T + 0.4), False),
    ],
)
def test_a_bank_that_drive_or_brakes_tell_is_a_body_that_rolls_by_its_engine(
    bank_rad: np.ndarray, follows: bool
) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    assert follows_the_drive(one, over(bank_rad), "road_bank") is follows
    assert not follows_the_drive(one._replace(wheels=np.zeros((N, 4))), over(bank_rad), "road_bank")


@pytest.mark.parametrize(
    ("grade_rad", "follows"),
    [
        (0.002 * SIDE**2, True),
        (-0.004 * np.abs(SIDE), True),
        # A quarter of a second after.
        (0.002 * np.interp(T - 0.25, T, SIDE) ** 2, True),
        # Half of it is something else; a road; and what a bank would be of.
        (0.002 * SIDE**2 + 0.004 * np.sin(0.53 * T), False),
        (0.02 * np.sin(0.4 * T + 0.4), False),
        (0.02 * PULL_MPS2, False),
    ],
)
def test_a_grade_that_bends_tell_is_a_body_that_axles_lift(grade_rad: np.ndarray, follows: bool) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    assert follows_the_drive(one, over(grade_rad, "road_grade"), "road_grade") is follows


STANDS = np.where((T > 20.0) & (T < 30.0), 0.0, CITY_V)


@pytest.mark.parametrize("road", sorted(AHEAD))
@pytest.mark.parametrize(
    ("tilt_rad", "rocks"),
    [
        (0.02 * np.sin(8.0 * T) * (STANDS == 0.0), True),
        # As much again on the way, less than half of all then; on a road; at rest.
        (0.02 * np.sin(8.0 * T) * (STANDS == 0.0) + 0.02 * np.sin(1.0 * T) * (STANDS > 0.0), True),
        (0.02 * np.sin(2.0 * T), False),
        (0.02 * np.sin(2.0 * T) * (STANDS > 0.0), False),
        (np.zeros(N), False),
    ],
)
def test_what_tips_while_a_car_stands_is_a_body_that_rocks(tilt_rad: np.ndarray, rocks: bool, road: str) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    one = one._replace(wheels=np.repeat(STANDS[:, np.newaxis], 4, axis=1))
    assert tips_standing(one, over(tilt_rad, road), road) is rocks


FAR_M = np.cumsum(CITY_V) * DT_S


def over_way(length_m: float) -> np.ndarray:
    """A tilt of 0.02 rad that comes within so many metres, half way, and stays."""
    return 0.02 * np.clip((FAR_M - 0.5 * FAR_M[-1]) / length_m + 0.5, 0.0, 1.0)


@pytest.mark.parametrize("road", sorted(AHEAD))
@pytest.mark.parametrize(
    ("tilt_rad", "once"),
    [
        (over_way(3.0), True),
        (-over_way(3.0) + 0.001 * np.sin(3.0 * T), True),
        (over_way(3.0) + 0.005 * np.sin(3.0 * T), False),  # rest of the road: 0.11 of the power of all
        (over_way(60.0), False),  # a road that begins to lean
        (over_way(3.0) - np.roll(over_way(3.0), 1500), False),  # there and back
        (np.zeros(N), False),
    ],
)
def test_what_tips_once_and_stays_is_who_got_in(tilt_rad: np.ndarray, once: bool, road: str) -> None:
    assert tips_once(drive({}, CITY_V, CITY_STEER), over(tilt_rad, road), road) is once


@pytest.mark.parametrize("rule", ["tips_at_once", "tips_once", "follows_the_drive", "tips_standing"])
def test_such_a_tilt_is_implausible(monkeypatch: pytest.MonkeyPatch, rule: str) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    for name in ("_is_denied_by_its_gyro", "_bounces", "pulls_nothing", "tips_only_what_stands_on_it"):
        monkeypatch.setattr(plausible, name, lambda *_: False)
    monkeypatch.setattr(tilts, "shows_the_drive", lambda *_: False)
    for road in AHEAD:
        fit = over(0.02 * np.sin(0.77 * T), road)
        for there in (False, True):
            monkeypatch.setattr(tilts, rule, lambda *_, there=there: there)
            assert is_implausible(one, rows_of(one), fit, road) is there


@pytest.mark.parametrize(("at_share", "share", "follows"), [(0.5, 0.8, True), (0.8, 0.8, True), (0.5, 0.2, False)])
def test_what_pushes_with_the_car_from_some_time_on_came_on_board(at_share: float, share: float, follows: bool) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    side = driven(one, nothing(), flat(N)).moved[:, AY] * (at_share * N < np.arange(N))
    gusts = np.sin(0.53 * T + 1.0) + np.sin(1.31 * T)
    force_n = 500.0 * (np.sqrt(share) * side / np.std(side) + np.sqrt(1.0 - share) * gusts / np.std(gusts))
    assert follows_the_car(one, nothing(), flat(N)._replace(side_n=force_n)) is follows


@pytest.mark.parametrize(
    ("side_n", "is_once"),
    [
        (np.where(T < 20.0, 400.0, -900.0) + 50.0 * np.sin(2.0 * T), True),
        (np.where((T > 20.0) & (T < 40.0), 400.0, -900.0), False),
        (500.0 * np.sin(0.2 * T), False),
    ],
)
def test_a_wind_that_changes_once_is_none(monkeypatch: pytest.MonkeyPatch, side_n: np.ndarray, is_once: bool) -> None:
    one = drive({}, np.full(N, 15.0), CITY_STEER)
    road = flat(N)._replace(side_n=side_n)
    assert changes_once(one, road) is is_once
    fit: Any = SimpleNamespace(x=nothing(), columns=(), effects=("side_wind",), road=road)
    for name in ("_lulls", "_pushes_an_axle", "_is_a_bank_unfelt"):
        monkeypatch.setattr(plausible, name, lambda *_: False)
    assert is_implausible(one, rows_of(one), fit, "side_wind") is is_once
    # At a walk nothing is said of it.
    assert not changes_once(one._replace(wheels=np.full((N, 4), 3.0)), road)


BACK = np.where((T > 20.0) & (T < 40.0), 400.0, -900.0)


@pytest.mark.parametrize(
    ("side_n", "share_ahead", "is_none"),
    [
        (BACK, 0.35, True),
        (BACK + 200.0 * np.sin(2.0 * T), 0.35, True),
        # As a push of the air is: near the C.G.; or not in two steps.
        (BACK, 0.25, False),
        (BACK, -0.35, False),
        (500.0 * np.sin(0.5 * T), 0.35, False),
        (np.zeros(N), 0.35, False),
    ],
)
def test_a_push_far_ahead_that_changes_twice_is_a_sensor_that_slips_back(
    side_n: np.ndarray, share_ahead: float, is_none: bool
) -> None:
    one = drive({}, np.full(N, 15.0), CITY_STEER)
    x = nothing()
    x[INDEX["side_wind.ahead_m"]] = share_ahead * one.car.cg_to_front_axle_m
    fit: Any = SimpleNamespace(x=x, columns=(), effects=("side_wind",), road=flat(N)._replace(side_n=side_n))
    assert plausible._pushes_an_axle(one, fit) is is_none
    assert not plausible._pushes_an_axle(one._replace(wheels=np.full((N, 4), 3.0)), fit)


def slipped(jump_rad: float, at_s: float) -> Drive:
    """A drive whose steering sensor tells less, from a moment on, than the front wheels turn."""
    one = drive({}, CITY_V, CITY_STEER + jump_rad * (at_s < T))
    steer = one.steer - jump_rad * (at_s < T)
    return one._replace(steer=steer, told_steer=steer)


@pytest.mark.parametrize(("jump_rad", "at_s"), [(0.01, 24.0), (-0.004, 41.0)])
def test_a_steering_sensor_that_slips_is_told_with_when(jump_rad: float, at_s: float) -> None:
    told = answered(found(slipped(jump_rad, at_s)))
    assert told.causes == []
    assert [shape.channel for shape in told.unlisted] == ["gyro_z"]
    shape = told.unlisted[0]
    since_s = float(shape.shape.split(" ")[2])
    assert shape.shape == f"k from {since_s:.1f} s on"
    assert abs(since_s - at_s) < 0.5
    assert abs(shape.coefficient.value - jump_rad) < 3.0 * shape.coefficient.std + 2e-4


@pytest.mark.parametrize("left_out", [{}, {"steering_offset.offset_rad": 0.01}, {"steering_ratio.scale": 0.1}])
def test_nothing_slips_where_one_zero_tells_as_much(left_out: dict[str, float]) -> None:
    one = drive(left_out, CITY_V, CITY_STEER)
    rows = rows_of(one)
    assert "steering_slip" not in dict(guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)))


@pytest.mark.parametrize(("zeros_rad", "slips"), [((0.01, 0.01), False), ((0.0, 0.01), True), ((-0.005, 0.005), True)])
def test_one_zero_all_the_way_is_no_slip(zeros_rad: tuple[float, float], slips: bool) -> None:
    """Of what is left in the yaw rate, all of it by one zero of the steering, or by two."""
    one = drive({}, CITY_V, CITY_STEER)
    rows, x = rows_of(one), nothing()
    fit = fitted(one, rows, x, (), TOLERANCE)
    x[INDEX["steering_offset.offset_rad"]] = 0.01
    of_zero = (predicted(one, x, flat(N)) - predicted(one, nothing(), flat(N)))[rows.at, 2] / 0.01
    left = fit.left.copy()
    left[:, 2] = np.where(rows.at * DT_S < 30.0, *zeros_rad) * of_zero
    far = fit._replace(left=left, unseen=fit.unseen + 1.0)
    assert ("steering_slip" in dict(guesses(one, rows, far))) is slips


def test_what_jumps_is_half_there_at_its_moment() -> None:
    step = since(3.0, 1000)
    middle = round(3.0 / DT_S)
    assert step[0] == 0.0
    assert step[-1] == 1.0
    assert step[middle] == pytest.approx(0.5)
    np.testing.assert_allclose(step[: middle - 20], 0.0)
    np.testing.assert_allclose(step[middle + 20 :], 1.0)


def test_what_hardly_swings_is_not_said_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """A share of a tenth or less, or no more than its spread."""
    shares = {"gyros": (0.05, 0.01), "accel_x": (0.6, 0.1), "accel_y": (0.11, 0.01), "accel_z": (0.6, 0.7)}
    monkeypatch.setattr(unlisted, "values_of", lambda *_: {"per_w2_s2": (0.007, 1e-4), "damping": (0.1, 0.01)} | shares)
    fit: Any = None
    told = unlisted.shapes_of_all(drive({}, CITY_V, CITY_STEER), fit, {"soft_mount"})
    assert [(shape.channel, shape.shape) for shape in told] == [("accel_x", "swings"), ("accel_y", "swings")]


@pytest.mark.parametrize(
    ("grown", "off", "is_named"),
    [(("rl", "rr"), "rl", False), (("rl", "rr"), "fl", True), ((), "rl", True), (("rl",), "rr", True)],
)
def test_a_wheel_that_grows_with_the_speed_is_no_smaller_one(
    monkeypatch: pytest.MonkeyPatch, grown: tuple[str, ...], off: str, is_named: bool
) -> None:
    monkeypatch.setattr(unnamed, "wheel_squares", lambda *_: dict.fromkeys(grown, (-1e-3, 1e-5)))
    monkeypatch.setattr(unnamed, "is_unfelt", lambda _: False)
    wheel = INDEX[f"wheel_radius.{off}"]
    monkeypatch.setattr(unnamed, "are_apart", lambda _drive, _fit, *pair: wheel in pair)
    one: Any = SimpleNamespace(recording=SimpleNamespace(floor=np.full(13, 0.01)))
    fit: Any = SimpleNamespace(effects=("wheel_radius", "wheel_square"))
    assert ("wheel_radius" not in not_named(one, fit, fit.effects)) is is_named
