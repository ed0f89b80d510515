"""diagnose: where a fit begins, what can't be told apart, and what to drive next."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from core_cases import TUCSON

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting import spreads
from dsz_daemon.diagnose.fitting.fit import exactly, fitted
from dsz_daemon.diagnose.fitting.model import Slopes, values_of
from dsz_daemon.diagnose.fitting.moments import in_the_middle, moments_of, with_best_moments
from dsz_daemon.diagnose.recordings.recording import DT_S, Recording
from dsz_daemon.diagnose.residuals.comparison import residual, rows_of, sensitivities
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.residuals.evidence import gain
from dsz_daemon.diagnose.residuals.flexible import flexible_rms
from dsz_daemon.diagnose.residuals.locate import located
from dsz_daemon.diagnose.selection.guesses import guesses
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.selection.search import Search, gained, searched
from dsz_daemon.diagnose.selection.starts import starts_of
from dsz_daemon.diagnose.selection.trials import Step, Trial, judged_steps
from dsz_daemon.diagnose.shapes.unlisted import unlisted
from dsz_daemon.diagnose.simulation import moving as moving_module
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict import answer as answer_module
from dsz_daemon.diagnose.verdict import numbers
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.grip import over_shapes
from dsz_daemon.diagnose.verdict.manoeuvres import MANOEUVRES, driven, next_manoeuvre

N = 6000
T = DT_S * np.arange(N)
NOISE = (0.0008, 0.0008, 0.0008, 0.004, 0.004, 0.004)
TOLERANCE = {"front_cornering_stiffness_n_per_rad": 0.1, "rear_cornering_stiffness_n_per_rad": 0.1}


def drive(
    left_out: dict[str, float],
    v: np.ndarray,
    steer: np.ndarray,
    seed: int = 1,
    change: Callable[[Drive], None] | None = None,
) -> Drive:
    """What the kernel itself predicts with `left_out` in it, and noise: for what does not depend on who made it."""
    rng = np.random.default_rng(seed)
    floor = np.array([*NOISE, *[2e-3] * 4])
    made = drive_of(Recording(T, steer, np.tile(v[:, None], (1, 4)), np.zeros((N, 6)), floor), TUCSON, 16.0)
    x = nothing()
    for name, value in left_out.items():
        x[INDEX[name]] = value
    made.measured[:, :9] = predicted(made, x, flat(N))[:, :9]
    for c in range(6):
        made.measured[:, c] += np.convolve(rng.normal(size=N), np.ones(15) / 15**0.5, "same") * NOISE[c]
    made.measured[:, 6:9] += rng.normal(size=(N, 3)) * 2e-3
    if change is not None:
        change(made)
    return made


CITY_V = 12.0 + 4.0 * np.sin(0.3 * T)
CITY_STEER = 0.04 * np.sin(0.9 * T) + 0.02 * np.sin(2.3 * T)


def found(one: Drive) -> Search:
    return searched(one, rows_of(one), TOLERANCE)


def test_a_clipped_sensor_is_guessed_at_its_furthest_reading() -> None:
    one = drive({"sensor_saturation.accel_limit_mps2": 1.5}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    start = dict(guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)))["sensor_saturation"]
    assert start[INDEX["sensor_saturation.accel_limit_mps2"]] == pytest.approx(1.5, abs=0.05)
    assert start[INDEX["sensor_saturation.gyro_limit_radps"]] == 0.0


def test_an_accelerometer_that_gravity_holds_at_its_limit_judges_nothing() -> None:
    def clipped(one: Drive) -> None:
        np.clip(one.measured[:, 3:6], -1.5, 1.5, out=one.measured[:, 3:6])

    held = drive({}, CITY_V, CITY_STEER, change=clipped)
    assert np.ptp(held.measured[:, 5]) == 0.0
    used = rows_of(held).used
    assert not used[:, 5].any()
    assert used[:, 3].any()
    assert used[:, 4].any()

    # One that is dead is compared, whatever it reads: no limit of its neighbours explains it.
    for reading in (0.0, 0.5, 9.81):

        def dead(one: Drive, reading: float = reading) -> None:
            one.measured[:, 5] = reading

        assert rows_of(drive({}, CITY_V, CITY_STEER, change=dead)).used[:, 5].any()


@pytest.mark.filterwarnings("error")
def test_a_body_that_leans_is_found_by_a_gyro_alone() -> None:
    """Without a lateral accelerometer nothing is known of forces that are in no simulation."""

    def without(one: Drive) -> None:
        one.measured[:, 4] = np.nan

    leans = {"suspension_roll.roll_gradient_rad_per_mps2": 0.01}
    search = found(drive(leans, CITY_V, CITY_STEER, change=without))
    assert search.best.effects == ("suspension_roll",)
    assert search.best.x[INDEX["suspension_roll.roll_gradient_rad_per_mps2"]] == pytest.approx(0.01, rel=0.05)


def test_what_had_to_go_may_come_back_beside_what_came_later(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first that is named can't be what it is, until another is beside it."""
    looked: list[tuple[str, ...]] = []

    def is_implausible_at_first(_drive: Drive, _rows: Any, fit: Any, effect: str) -> bool:
        if effect != "wheel_radius" or len(fit.effects) > 1:
            return False
        looked.append(fit.effects)
        return len(looked) == 2

    for room in ("trials", "smaller"):
        monkeypatch.setattr(f"dsz_daemon.diagnose.selection.{room}.is_implausible", is_implausible_at_first)
    search = found(drive({"wheel_radius.rl": -0.01, "gyro_scale.y": 0.0, "accel_scale.y": 0.05}, CITY_V, CITY_STEER))
    assert len(looked) > 1
    assert {"wheel_radius", "accel_scale"} <= set(search.best.effects)


@pytest.mark.parametrize(("scale", "radius", "stays"), [(0.2, 0.0005, "accel_scale"), (0.01, 0.03, "wheel_radius")])
def test_of_two_that_can_not_be_beside_each_other_the_one_stays_that_explains_more(
    monkeypatch: pytest.MonkeyPatch, scale: float, radius: float, stays: str
) -> None:
    """Beside a wheel's radius the accelerometer's scale wants to be what it can't be."""

    def is_implausible_beside(_drive: Drive, _rows: Any, fit: Any, effect: str) -> bool:
        return effect == "accel_scale" and "wheel_radius" in fit.effects

    for room in ("trials", "smaller"):
        monkeypatch.setattr(f"dsz_daemon.diagnose.selection.{room}.is_implausible", is_implausible_beside)
    search = found(drive({"accel_scale.y": scale, "wheel_radius.rl": -radius}, CITY_V, CITY_STEER))
    assert search.best.effects[0] == stays
    assert not {"accel_scale", "wheel_radius"} <= set(search.best.effects)
    assert search.gains[stays] > 100.0


def test_what_had_to_go_is_not_tried_again_beside_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever comes in second has to go itself: each once."""

    def alone(_drive: Drive, _rows: Any, before: Any, best: Any, *_: Any) -> tuple[Any, set[str]]:
        return (before, {best.effects[-1]}) if before.effects else (best, set())

    monkeypatch.setattr("dsz_daemon.diagnose.selection.search.plausible", alone)
    said: list[str] = []
    one = drive({"accel_scale.y": 0.2, "wheel_radius.rl": -0.003, "gyro_scale.z": 0.05}, CITY_V, CITY_STEER)
    search = searched(one, rows_of(one), TOLERANCE, said.append)
    # Where no name may stay, a shape may.
    assert len([effect for effect in search.best.effects if ":" not in effect]) == 1
    assert 4 <= sum(words.startswith("screening") for words in said) <= 8


@pytest.mark.parametrize(("road", "effect"), [("road_bank", "suspension_roll"), ("road_grade", "suspension_pitch")])
def test_beside_a_road_the_body_may_lean_from_the_start_on(
    monkeypatch: pytest.MonkeyPatch, road: str, effect: str
) -> None:
    """What a gyro has felt has the lean in it, so that no linear step shows it."""
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    plain = fitted(one, rows, nothing(), (), TOLERANCE)
    monkeypatch.setattr("dsz_daemon.diagnose.selection.starts.feels", lambda *_: False)
    column = INDEX[f"{effect}.{'roll' if road == 'road_bank' else 'pitch'}_gradient_rad_per_mps2"]

    def starts(*effects: str) -> list[tuple[str, float]]:
        found = starts_of(one, rows, plain._replace(effects=effects), ["gyro_scale", effect])
        return [(name, float(x[column])) for (name,), x in found]

    assert starts("wheel_slip") == [("gyro_scale", 0.0), (effect, 0.0)]
    assert starts("wheel_slip", road) == [("gyro_scale", 0.0), (effect, 0.008)]
    assert (effect, 0.008) not in starts(road, effect)


def test_nothing_is_guessed_where_nothing_is_left() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    assert guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)) == []


def test_a_slippery_stretch_is_guessed_from_where_it_begins_to_its_end() -> None:
    ice = {"low_friction.inverse_square": 0.3**-2, "low_friction.start_s": 22.0, "low_friction.end_s": 40.0}
    one = drive(ice, CITY_V, CITY_STEER)
    rows = rows_of(one)
    start = dict(guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)))["low_friction"]
    assert start[INDEX["low_friction.inverse_square"]] ** -0.5 == pytest.approx(0.3, rel=0.15)
    assert start[INDEX["low_friction.start_s"]] == pytest.approx(22.0, abs=1.0)
    assert start[INDEX["low_friction.end_s"]] == pytest.approx(40.0, abs=1.0)


@pytest.mark.parametrize("ellipse", [0.01, 1.0])
def test_whether_drive_and_brakes_take_of_the_grip_is_guessed(ellipse: float) -> None:
    ice = {"inverse_square": 0.3**-2, "ellipse": ellipse, "start_s": 22.0, "end_s": 40.0}
    one = drive({f"low_friction.{name}": value for name, value in ice.items()}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    start = dict(guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)))["low_friction"]
    assert start[INDEX["low_friction.ellipse"]] == ellipse


def test_the_share_of_the_limit_is_of_what_drive_and_brakes_leave() -> None:
    """On ice at 1.2 m/s2 of drive more than half of the front axle's side force is gone; the rest is used up."""
    ice = {"inverse_square": 0.25**-2, "ellipse": 1.0, "start_s": 0.0, "end_s": 99.0}
    left_out = {f"low_friction.{name}": value for name, value in ice.items()}
    one = drive(left_out, CITY_V, 3.0 * CITY_STEER)
    x = nothing()
    for name, value in left_out.items():
        x[INDEX[name]] = value
    best = SimpleNamespace(x=x, road=flat(N))
    search: Any = SimpleNamespace(drive=one, best=best, rows=rows_of(one))
    share, *_ = numbers._front_share(search, "low_friction")
    moving = moving_module.driven(one, x, flat(N))
    pulled = moving.rolling.front_free[search.rows.at] < 0.6
    assert pulled.any()
    assert 0.8 < np.abs(share[pulled]).max() < 1.0


@pytest.mark.parametrize("by_s", [-9.0, 0.0, 4.0])
def test_where_nothing_tells_a_stretch_ends_in_the_middle(by_s: float) -> None:
    """Straight ahead from 14 to 26 s and from 36 to 48 s: begin and end may be anywhere in these."""
    ice = {"low_friction.inverse_square": 0.3**-2, "low_friction.start_s": 20.0, "low_friction.end_s": 42.0}
    steer = np.where((T > 14.0) & (T < 26.0) | (T > 36.0) & (T < 48.0), 0.0, CITY_STEER)
    one = drive(ice, CITY_V, steer)
    rows, x = rows_of(one), nothing()
    for name, value in ice.items():
        x[INDEX[name]] = value
    fit = fitted(one, rows, x, ("low_friction",), TOLERANCE)
    moments = moments_of(one)
    fit.x[moments] += by_s
    moved = fit._replace(left=residual(rows, predicted(one, fit.x, fit.road)))
    best = with_best_moments(one, rows, moved)
    settled = moved._replace(x=best, left=residual(rows, predicted(one, best, fit.road)))
    begin_s, end_s = in_the_middle(one, rows, settled, TOLERANCE).x[moments]
    assert begin_s == pytest.approx(20.0, abs=1.2)
    assert end_s == pytest.approx(42.0, abs=1.2)


def test_a_slippery_stretch_is_found_with_its_beginning_and_end() -> None:
    ice = {"low_friction.inverse_square": 0.4**-2, "low_friction.start_s": 20.0, "low_friction.end_s": 40.0}
    search = found(drive(ice, CITY_V, CITY_STEER))
    assert search.best.effects == ("low_friction",)
    best = {name: search.best.x[i] for name, i in INDEX.items() if name.startswith("low_friction")}
    assert best["low_friction.inverse_square"] ** -0.5 == pytest.approx(0.4, rel=0.05)
    # From 20 s on the car bends by less than 0.8 m/s2, of which even ice takes nothing, until 21.5 s.
    assert 19.5 < best["low_friction.start_s"] < 21.5
    assert best["low_friction.end_s"] == pytest.approx(40.0, abs=0.5)


def test_wheels_slip_that_an_engine_brakes() -> None:
    """Brakes that take from there on what they do otherwise leave of a slip without an engine much that is left."""
    slips = {"wheel_slip.slip_per_force": 0.05, "wheel_slip.engine_brakes_mps2": 1.5}
    search = found(drive(slips, CITY_V + 3.0 * np.sin(0.8 * T), CITY_STEER))
    assert search.best.effects == ("wheel_slip",)
    assert search.best.x[INDEX["wheel_slip.slip_per_force"]] == pytest.approx(0.05, rel=0.05)
    assert search.best.x[INDEX["wheel_slip.engine_brakes_mps2"]] == pytest.approx(1.5, rel=0.25)


def test_slip_is_fitted_from_wheels_that_slip_a_little() -> None:
    """Of those that do not nothing tells how brakes share it, and what an engine has of them."""
    one = drive({}, CITY_V, CITY_STEER)
    best = fitted(one, rows_of(one), nothing(), (), TOLERANCE)
    starts = dict(starts_of(one, rows_of(one), best, ["wheel_slip", "gyro_scale"]))
    changed = starts["wheel_slip",] - best.x
    assert np.flatnonzero(changed).tolist() == [INDEX["wheel_slip.slip_per_force"]]
    assert np.max(changed) > 0.0
    assert np.array_equal(starts["gyro_scale",], best.x)
    assert ("wheel_slip",) not in dict(starts_of(one, rows_of(one), best, ["gyro_scale"]))


@pytest.mark.parametrize("axle", [0, 1])
def test_wheels_that_are_far_off_may_slip_whatever_one_linear_step_says(
    monkeypatch: pytest.MonkeyPatch, axle: int
) -> None:
    """Beside a climb a slip's slope has the force's jumps in it, which the slip itself has not."""
    one = drive({}, CITY_V, CITY_STEER)
    best = fitted(one, rows_of(one), nothing(), (), TOLERANCE)
    monkeypatch.setattr("dsz_daemon.diagnose.selection.starts.far_off", lambda *_: np.arange(13) == 6 + axle)
    assert ("wheel_slip",) in dict(starts_of(one, rows_of(one), best, ["gyro_scale"]))
    slips = best._replace(effects=("wheel_slip",))
    assert ("wheel_slip",) not in dict(starts_of(one, rows_of(one), slips, ["gyro_scale"]))
    monkeypatch.setattr("dsz_daemon.diagnose.selection.starts.far_off", lambda *_: np.arange(13) == 5)
    assert ("wheel_slip",) not in dict(starts_of(one, rows_of(one), best, ["gyro_scale"]))


def test_a_stretch_may_begin_with_the_recording() -> None:
    """Where it begins is a number, though it is 0 at first."""
    ice = {"low_friction.inverse_square": 0.4**-2, "low_friction.start_s": 0.0, "low_friction.end_s": 40.0}
    one = drive(ice, CITY_V, CITY_STEER)
    rows, x = rows_of(one), nothing()
    for name, value in ice.items():
        x[INDEX[name]] = value
    fit = fitted(one, rows, x, ("low_friction",), TOLERANCE)
    assert set(values_of(one, fit, "low_friction")) >= {"start_s", "end_s"}


def test_a_stretch_is_located_to_the_second() -> None:
    """Two seconds are less than what is left of the low-pass at either end; near stretches are one."""

    def bump(one: Drive) -> None:
        one.measured[:, 5] += 0.2 * ((T > 15.0) & (T < 22.0)) + 0.2 * ((T > 24.0) & (T < 30.0)) + 0.2 * (T > 50.0)

    one = drive({}, CITY_V, CITY_STEER, change=bump)
    rows = rows_of(one)
    left = residual(rows, predicted(one, nothing(), flat(N)))
    places = [place for place in located(one, rows, left, np.full(13, 0.01), np.ones(13)) if place.channel == "accel_z"]
    assert [(place.start_s, place.end_s) for place in sorted(places, key=lambda place: place.start_s)] == [
        (pytest.approx(15.0, abs=1.0), pytest.approx(30.0, abs=1.0)),
        (pytest.approx(50.0, abs=1.0), pytest.approx(59.0, abs=1.0)),
    ]
    assert sum(place.share for place in places) == pytest.approx(1.0, abs=0.02)


def test_where_nothing_stands_out_nobody_asks_for_scipy(monkeypatch: pytest.MonkeyPatch) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    left = np.where(rows.used, 0.01 * np.random.default_rng(3).standard_normal(rows.used.shape), 0.0)
    monkeypatch.setitem(sys.modules, "scipy.special", None)
    assert located(one, rows, left, np.full(13, 0.01), np.ones(13)) == []
    left[100:200, 0] *= 10.0
    with pytest.raises(ModuleNotFoundError):
        located(one, rows, left, np.full(13, 0.01), np.ones(13))


def test_a_second_that_chance_alone_makes_loud_is_not_located() -> None:
    """Where forty rows count as one, a fivefold second is one draw of many; where each counts, it is not."""
    rng = np.random.default_rng(3)
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    left = 0.01 * rng.standard_normal((len(rows.at), 13))
    at_s = rows.at * DT_S
    left[(at_s >= 20.0) & (at_s < 22.0), 5] *= 5.0**0.5
    left[(at_s >= 30.0) & (at_s < 33.0), 3] *= 10.0
    loud = [located(one, rows, left, np.full(13, 0.01), np.full(13, per_row)) for per_row in (1.0, 40.0)]
    places = [{(place.channel, place.start_s, place.end_s) for place in found} for found in loud]
    assert places == [{("accel_x", 30.0, 33.0), ("accel_z", 20.0, 22.0)}, {("accel_x", 30.0, 33.0)}]


def test_a_flexible_model_finds_what_has_no_name_and_nothing_in_noise() -> None:
    rng = np.random.default_rng(8)
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    left = np.where(rows.used, 0.01 * rng.standard_normal((len(rows.at), 13)), 0.0)
    v = CITY_V[rows.at]
    left[:, 5] += 1e-3 * (v - v.mean()) * one.steer[rows.at] / 0.04 * 10.0
    rms = flexible_rms(one, rows, left)
    assert rms[5] == pytest.approx(0.01, rel=0.1)
    assert rms[3] == pytest.approx(0.01, rel=0.05)
    assert float(np.std(left[:, 5])) > 0.015
    assert np.isnan(rms[9:]).all()


@pytest.mark.parametrize("curve", [np.tanh, lambda x: np.sin(1.3 * np.arctan(x / 1.3))])
@pytest.mark.parametrize("furthest", [0.7, 1.0, 2.0, 4.0])
def test_other_curves_read_another_limit_off_the_same_forces(
    curve: Callable[[np.ndarray], np.ndarray], furthest: float
) -> None:
    """Of a curve that ends at 1 only a beginning is seen; what is read off it is 1 within the spread over shapes."""
    demand = np.linspace(0.0, furthest, 400)

    def ours(limit: float, n: float) -> np.ndarray:
        return (demand / limit) / (1.0 + (demand / limit) ** n) ** (1.0 / n)

    limits = [(limit, n) for limit in np.geomspace(0.5, 2.0, 60) for n in (1.7, 2.0, 2.5, 3.0, 4.0)]
    limit, n = min(limits, key=lambda one: float(np.sum((one[0] * ours(*one) - curve(demand)) ** 2)))
    mean, spread = over_shapes(ours(limit, n), n)
    assert abs(limit * mean - 1.0) < 2.0 * limit * spread
    # The mean over shapes is nearer than the one that was fitted.
    assert furthest > 0.7 or abs(limit * mean - 1.0) < 0.5 * abs(limit - 1.0)
    assert spread < (0.4 if furthest < 1.5 else 0.15 if furthest < 3.0 else 0.06)


def test_wind_is_named_by_what_it_does_to_the_yaw_rate() -> None:
    rng = np.random.default_rng(4)
    gusts = 500.0 * np.convolve(rng.normal(size=N), np.exp(-0.5 * (np.arange(-300, 301) / 80.0) ** 2), "same") / 12.0

    def blow(one: Drive) -> None:
        x = nothing()
        x[INDEX["side_wind.ahead_m"]] = 0.3
        change = predicted(one, x, flat(N)._replace(side_n=gusts)) - predicted(one, nothing(), flat(N))
        one.measured[:] += change

    search = found(drive({}, CITY_V, CITY_STEER, change=blow))
    assert search.best.effects == ("side_wind",)
    assert np.corrcoef(search.best.road.side_n[500:-500], gusts[500:-500])[0, 1] > 0.9

    def shake(one: Drive) -> None:
        # What the accelerometer alone feels is no wind.
        one.measured[:, 4] += gusts / TUCSON.mass_kg

    assert "side_wind" not in found(drive({}, CITY_V, CITY_STEER, change=shake)).best.effects


def test_permuted_in_time_nothing_is_named() -> None:
    """What is left of a lever arm, its rows shuffled, is noise of the same size."""

    def shuffle(one: Drive) -> None:
        nominal = predicted(one, nothing(), flat(N))[:, :6]
        order = np.random.default_rng(3).permutation(N)
        one.measured[:, :6] = nominal + (one.measured[:, :6] - nominal)[order]

    arm = {"imu_lever_arm.x_m": 0.8, "imu_lever_arm.y_m": 0.4}
    assert found(drive(arm, CITY_V, CITY_STEER)).best.effects == ("imu_lever_arm",)
    assert found(drive(arm, CITY_V, CITY_STEER, change=shuffle)).best.effects == ()


def test_what_is_only_explained_by_the_implausible_is_not_explained() -> None:
    """A yaw rate that reads 2.5 times too much: no gyro's sensitivity is off by more than 25 %."""

    def stretch(one: Drive) -> None:
        one.measured[:, 2] *= 2.5

    assert found(drive({"gyro_scale.z": 0.2}, CITY_V, CITY_STEER)).best.effects == ("gyro_scale",)
    assert "gyro_scale" not in found(drive({}, CITY_V, CITY_STEER, change=stretch)).best.effects


def test_dropouts_name_nothing() -> None:
    """One reading in twenty is missing, each channel its own."""

    def drop(one: Drive) -> None:
        one.measured[:, :6][np.random.default_rng(5).random((N, 6)) < 0.05] = np.nan

    assert found(drive({}, CITY_V, CITY_STEER, change=drop)).best.effects == ()


def test_a_quiet_channel_has_nothing_to_gain_and_may_lose() -> None:
    before, count = np.array([[100.0, 100.0]]), np.array([[100.0, 100.0]])
    better, worse = before / 4.0, before * 4.0
    ones, none = np.ones(2), np.zeros(2)
    loud = np.array([False, False])
    assert gain(before, better, count, ones, none, loud) == pytest.approx(2 * 50.0 * np.log(4.0))
    assert gain(before, better, count, ones, none, np.array([True, False])) == pytest.approx(50.0 * np.log(4.0))
    assert gain(before, worse, count, ones, none, np.array([True, True])) == pytest.approx(-2 * 50.0 * np.log(4.0))


def test_manoeuvres_are_drives_that_a_car_can_do() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    for manoeuvre in MANOEUVRES:
        made = driven(one, manoeuvre)
        # The simulation begins with the wheels turned: after that.
        assert np.nanmax(np.abs(made.measured[200:, 4])) < 8.0, manoeuvre.words
        assert np.max(np.abs(np.gradient(made.wheels[:, 0], DT_S))) < 8.0, manoeuvre.words
        assert np.min(made.wheels) > 0.0


def test_what_splits_explanations_is_driven_next() -> None:
    """No steering and braking on a flat road rolls the nominal car; a dive shows where it brakes."""
    one = drive({}, CITY_V, CITY_STEER)
    x = nothing()
    x[INDEX["gyro_scale.x"]] = 0.1
    assert next_manoeuvre(one, x, "gyro_scale", ["gyro_cross_axis"]) is None
    x[INDEX["suspension_pitch.pitch_gradient_rad_per_mps2"]] = 0.01
    words = next_manoeuvre(one, x, "suspension_pitch", ["accel_scale"])
    assert words is not None
    assert "brak" in words
    x[INDEX["steering_ratio.scale"]] = 0.1
    assert next_manoeuvre(one, x, "steering_ratio", ["cornering_stiffness"]) is not None


def test_a_shape_that_explains_more_than_any_name_is_told_without_one() -> None:
    """A yaw rate with a_y^3 in it is better explained by that than by a scale; what else there is is found."""
    across = predicted(drive({}, CITY_V, CITY_STEER), nothing(), flat(N))[:, 4]

    def trailer(one: Drive) -> None:
        one.measured[:, 2] += 1e-4 * across**3

    search = found(drive({"accel_scale.y": 0.05}, CITY_V, CITY_STEER, change=trailer))
    said = answered(search)
    assert [cause.effect for cause in said.causes] == ["accel_scale"]
    [shape] = said.unlisted
    assert (shape.channel, shape.shape) == ("gyro_z", "k*ay^3")
    assert shape.coefficient.value == pytest.approx(1e-4, rel=0.1)
    assert shape.coefficient.unit == "(rad/s)/(m3/s6)"
    assert said.verdict == "partly_explained"


def test_a_wheel_that_shows_the_square_of_its_speed_too_has_no_name() -> None:
    def magnet(one: Drive) -> None:
        one.wheels[:, 2] += 1e-3 * one.wheels[:, 2] ** 2
        one.measured[:, 8] -= 1e-3 * CITY_V**2

    one = drive({}, CITY_V, CITY_STEER, change=magnet)
    said = answered(found(one))
    assert said.causes == []
    [shape] = said.unlisted
    assert (shape.channel, shape.shape) == ("wheel_speed_rl", "k*vx^2")
    assert shape.coefficient.value == pytest.approx(1e-3, rel=0.05)


def test_blocks_of_one_manoeuvre_are_known_by_braking_and_bending() -> None:
    """20 s each: straight on, braking and speeding up, a bend of some 1.4 m/s2, a bend of some 3."""
    v = 12.0 + np.where((T > 20.0) & (T < 40.0), 2.0 * np.sin(T), 0.0)
    steer = 2.637 / 12.0**2 * (1.4 * (T > 40.0) * (T < 50.0) + 3.0 * (T > 50.0))
    rows = rows_of(drive({}, v, steer))
    kinds = rows.together["manoeuvres"]
    middle = {
        name: int(kinds[rows.block[np.searchsorted(rows.at * DT_S, at_s)]])
        for name, at_s in (
            ("straight", 10.0),
            ("braking", 32.0),
            ("bend", 46.0),
            ("hard", 56.0),
        )
    }
    assert middle == {"straight": 0, "braking": 1, "bend": 2, "hard": 3}
    assert "recordings" not in rows.together


def test_a_shape_that_is_left_over_has_the_spread_of_its_regression() -> None:
    """White noise of 0.01 on n rows: the spread of k is 0.01 / (std(v^3) sqrt(n))."""
    rng = np.random.default_rng(2)
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    left = np.where(rows.used, fit.left, 0.0)
    cubed = CITY_V[rows.at] ** 3
    left[:, 5] = 0.01 * rng.standard_normal(len(left)) + 2e-5 * (cubed - cubed.mean())
    [shape] = [one for one in unlisted(one, rows, fit._replace(left=left)) if one.channel == "accel_z"]
    assert (shape.shape, shape.coefficient.value) == ("k*vx^3", pytest.approx(2e-5, rel=0.02))
    assert shape.coefficient.std == pytest.approx(0.01 / (float(np.std(cubed)) * len(left) ** 0.5), rel=0.3)


@pytest.mark.parametrize(
    ("gained_besides", "unexplained", "is_said"), [(0.0, [], True), (1e6, [], False), (1e6, ["accel_z"], True)]
)
def test_what_is_left_of_a_channel_that_is_explained_has_to_gain_its_share(
    monkeypatch: pytest.MonkeyPatch, gained_besides: float, unexplained: list[str], is_said: bool
) -> None:
    """A square of the speed in a_z, of its noise's size, beside a scale; where that channel is far off it is said."""
    rng = np.random.default_rng(2)
    search = found(drive({"gyro_scale.z": -0.03}, CITY_V, CITY_STEER))
    assert search.best.effects == ("gyro_scale",)
    left, squared = search.best.left.copy(), CITY_V[search.rows.at] ** 2
    course = squared - squared.mean()
    left[:, 5] = 0.01 * (rng.standard_normal(len(left)) + course / course.std())
    search = search._replace(
        best=search.best._replace(left=left), gains={"gyro_scale": search.gains["gyro_scale"] + gained_besides}
    )
    monkeypatch.setattr(answer_module, "unexplained_of", lambda *_: unexplained)
    shapes = [(one.channel, one.shape) for one in answered(search).unlisted]
    assert shapes == ([("accel_z", "k*vx^2")] if is_said else [])


def test_what_other_manoeuvres_deny_is_not_named() -> None:
    """Turned by 2 % more in hard bends and by 2 % less in gentle ones is no scale error."""
    v, steer = np.full(N, 12.0), 0.05 * np.sin(0.5 * T) * (np.sin(0.2 * T) > 0.0) + 0.012 * np.sin(0.5 * T)
    across = np.abs(predicted(drive({}, v, steer), nothing(), flat(N))[:, 4])

    def odd(one: Drive) -> None:
        one.measured[:, 2] *= np.where(across > 1.5, 1.08, 0.88)

    one = drive({}, v, steer, change=odd)
    nominal = fitted(one, rows_of(one), nothing(), (), TOLERANCE)
    trial = Trial(one, rows_of(one), nominal, TOLERANCE, Slopes(nothing(), (), (), np.zeros((0, 13, 0))))
    step = trial.judge(trial.fit((("gyro_scale",), nothing())))
    assert gained(one, trial.best, step.fit) > 15.0
    assert gained(one, trial.best, step.fit, kind="manoeuvres") < -15.0
    assert step.gain == -np.inf


@pytest.mark.parametrize(("most_rad", "is_fitted"), [(0.09, False), (0.11, True)])
def test_whether_an_angle_is_a_sine_is_asked_where_angles_are_large(most_rad: float, is_fitted: bool) -> None:
    one = drive({}, CITY_V, CITY_STEER * most_rad / np.max(np.abs(CITY_STEER)))
    fit = fitted(one, rows_of(one), nothing(), (), TOLERANCE)
    assert (INDEX["large_angles"] in fit.columns) is is_fitted


def test_a_load_is_found_along_a_valley_from_the_corner_of_what_stiffnesses_may_be() -> None:
    """There a load a tenth of a metre further ahead turns the car nearly alike."""
    planted = {"added_mass_kg": 300.0, "cg_shift_m": -0.17, "turns": 1.0}
    steer = (0.02 * np.sin(0.9 * T) + 0.008 * np.sin(2.3 * T)) * 12.0 / 28.0
    left_out = {f"mass_loading.{name}": value for name, value in planted.items()}
    one = drive(left_out, 28.0 + 2.0 * np.sin(0.3 * T), steer)
    start = nothing()
    start[[INDEX[name] for name in left_out]] = 300.0, -0.03, 1.0
    corner = [INDEX[f"{axle}_cornering_stiffness_n_per_rad"] for axle in ("front", "rear")]
    start[corner] = 0.099, -0.099
    fit = fitted(one, rows_of(one), start, ("mass_loading",), TOLERANCE)
    assert fit.x[INDEX["mass_loading.cg_shift_m"]] == pytest.approx(-0.17, abs=0.05)
    assert np.all(np.abs(fit.x[corner]) < 0.06)


def test_slopes_that_are_known_need_not_be_taken_again() -> None:
    """The fit is the same, up to where it is left as converged, and so is its judgement by its own slopes."""
    one = drive({"gyro_scale.z": 0.03}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    nominal = fitted(one, rows, nothing(), (), TOLERANCE)
    columns = (*nominal.columns, *one.vocabulary.columns_of("gyro_scale"))
    base = predicted(one, nominal.x, nominal.road)
    there = sensitivities(one, rows, nominal.x, nominal.road, base, columns)
    alone = fitted(one, rows, nominal.x, ("gyro_scale",), TOLERANCE, 1e-5)
    known = Slopes(nominal.x, (), columns, there)
    beside = fitted(one, rows, nominal.x, ("gyro_scale",), TOLERANCE, 1e-5, known=known)
    assert np.max(np.abs(beside.x - alone.x)[list(alone.columns)] / alone.std) < 0.03
    judged = exactly(one, rows, beside, TOLERANCE)
    np.testing.assert_allclose(judged.unseen, alone.unseen, rtol=2e-3)
    # Of what stands at its bound a secant is longer than of what stands beside it.
    np.testing.assert_allclose(judged.std, alone.std, rtol=1e-2)
    assert known.of(nominal.x, ("gyro_scale", "road_bank"), columns) is None
    assert known.of(nominal.x + 1e-9, ("gyro_scale",), columns) is None
    assert known.of(nominal.x, ("gyro_scale",), (*columns, 99)) is None


def test_a_spread_is_no_less_than_what_the_steerings_steps_leave_open() -> None:
    """An error of f that holds for 250 rows: spread >= f sqrt(250 / n) / rms of the slope."""
    one = drive({"accel_scale.y": 0.03}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    steps = np.zeros(13)
    steps[4] = 0.05
    one = one._replace(steps=steps, steps_rows=np.full(13, 250.0))
    fit = fitted(one, rows, nothing(), ("accel_scale",), TOLERANCE)
    i = INDEX["accel_scale.y"]
    used = rows.used[:, 4]
    across = rows.measured[used, 4]
    least = 0.05 * np.sqrt(250.0 / used.sum()) / np.std(across)
    assert least < fit.std[fit.columns.index(i)] < 1.5 * least


def test_where_a_simulation_fits_its_noise_is_no_way_to_be_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spreads are what they would be with any number of ways to be wrong; those of a misfit are not."""
    right = drive({"accel_scale.y": 0.03}, CITY_V, CITY_STEER)
    wrong = drive({"accel_scale.y": 0.03, "imu_delay.delay_s": 0.1}, CITY_V, CITY_STEER)

    def spread(one: Drive) -> float:
        fit = fitted(one, rows_of(one), nothing(), ("accel_scale",), TOLERANCE)
        at = fit.columns.index(INDEX["accel_scale.y"])
        return float(fit.std[at] ** 2 - (0.02 * fit.x[fit.columns[at]]) ** 2) ** 0.5

    usual = [spread(one) for one in (right, wrong)]
    monkeypatch.setattr(spreads, "_WAYS_TO_BE_WRONG", 1e9)
    alike = [spread(one) for one in (right, wrong)]
    assert usual[0] == pytest.approx(alike[0], rel=0.3)
    assert usual[1] > 1.5 * alike[1]


def test_what_lasts_all_the_way_makes_no_form_coarse() -> None:
    """A cross axis of g is an offset: of 1 m/s2 that never changes nothing is the simulation's coarseness."""
    one = drive({"accel_cross_axis.yz": 0.1}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    start = nothing()
    start[INDEX["accel_cross_axis.yz"]] = 0.1
    fit = fitted(one, rows, start, ("accel_cross_axis",), TOLERANCE)
    assert fit.x[INDEX["accel_cross_axis.yz"]] > 0.05
    assert fit.form[4] < 2.0 * rows.form[4]


def test_what_two_parameters_share_is_in_their_covariance() -> None:
    """Radii of a wheel pair in a straight drive: their difference is told by the wheels, their sum by a_x alone."""
    v = 12.0 + 4.0 * np.sin(0.3 * T)
    one = drive({"wheel_radius.rl": 0.01, "wheel_radius.rr": -0.01}, v, CITY_STEER)
    fit = fitted(one, rows_of(one), nothing(), ("wheel_radius",), TOLERANCE)
    place = [fit.columns.index(INDEX[f"wheel_radius.{wheel}"]) for wheel in ("rl", "rr")]
    assert fit.covariance is not None
    [[rl, both], [_, rr]] = fit.covariance[np.ix_(place, place)]
    assert rl + rr - 2.0 * both < 0.5 * (rl + rr + 2.0 * both)
    # Beside it a spread has 2 % of the number, and a quarter of what is worth a name.
    more = (0.02 * fit.x[INDEX["wheel_radius.rl"]]) ** 2 + (0.25 * 8e-4) ** 2
    assert np.sqrt(rl) == pytest.approx(np.sqrt(fit.std[place[0]] ** 2 - more))


def test_where_the_best_is_denied_the_next_is_judged() -> None:
    """By slopes that are a step old: 1000, 300, 5, -40; the first is denied, the last is hopeless."""
    asked: list[str] = []

    def judge(step: Step, _each: Any) -> Step:
        asked.append(step.effect)
        return step._replace(gain=-np.inf if step.effect == "first" else step.gain)

    none: Any = None
    steps = [
        Step(name, gain, none) for name, gain in (("last", -40.0), ("first", 1000.0), ("third", 5.0), ("second", 300.0))
    ]
    trial: Any = SimpleNamespace(judge=judge)
    assert [step.effect for step in judged_steps(trial, steps, map)] == ["first", "second"]
    assert asked == ["first", "second"]
    assert [step.effect for step in judged_steps(trial, steps[::3], map)] == ["second"]
    assert judged_steps(trial, steps[:1], map) == []
    assert [step.effect for step in judged_steps(trial, steps[::2], map)] == ["third"]


def test_a_tyres_limit_is_drawn_more_coarsely_than_all_else() -> None:
    """A tenth of what the limit does to a channel, but for its mean, may be the curve's own shape."""
    steer = 0.10 * np.sin(0.9 * T)
    one = drive({"tyre_saturation.inverse_square": 2.0}, np.full(N, 14.0), steer)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), ("tyre_saturation",), TOLERANCE)
    without = fit.x.copy()
    without[list(one.vocabulary.columns_of("tyre_saturation"))] = 0.0
    change = (predicted(one, fit.x, fit.road) - predicted(one, without, flat(N)))[rows.at, 4][rows.used[:, 4]]
    assert fit.form[4] == pytest.approx(np.hypot(rows.form[4], 0.1 * np.sqrt(np.mean((change - np.mean(change)) ** 2))))


def test_tracks_that_are_configured_wrongly_are_said_as_such() -> None:
    """A front track that is 6 % wider than configured: no scale error of a gyro, and told in metres."""
    one = drive({"track_width.front": 0.06}, CITY_V, CITY_STEER)
    said = answered(found(one))
    [cause] = said.causes
    assert cause.effect == "track_width"
    assert cause.parameters["front"].value == pytest.approx(1.06, abs=0.01)
    [error] = said.parameter_errors
    assert (error.parameter, error.configured) == ("front_track_m", TUCSON.front_track_m)
    assert error.fitted == pytest.approx(1.06 * TUCSON.front_track_m, rel=0.01)


def test_no_limit_is_below_what_is_read() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    x = nothing()
    x[INDEX["sensor_saturation.accel_limit_mps2"]] = furthest = float(np.max(np.abs(one.measured[:, 3:5])))
    left = np.zeros(rows_of(one).used.shape)
    fit: Any = SimpleNamespace(x=x, columns=(), effects=("sensor_saturation",), road=flat(N), left=left)
    assert not is_implausible(one, rows_of(one), fit, "sensor_saturation")
    x[INDEX["sensor_saturation.accel_limit_mps2"]] = 0.5 * furthest
    assert is_implausible(one, rows_of(one), fit, "sensor_saturation")
    x[INDEX["sensor_saturation.accel_limit_mps2"]] = 0.0
    x[INDEX["sensor_saturation.gyro_limit_radps"]] = 0.5 * float(np.max(np.abs(one.measured[:, 2])))
    assert is_implausible(one, rows_of(one), fit, "sensor_saturation")
