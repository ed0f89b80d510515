"""diagnose: grip that ends all the way, told from grip that ends for a while."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting import moments as moments_module
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import Fit, values_of
from dsz_daemon.diagnose.fitting.moments import in_the_middle, moments_of
from dsz_daemon.diagnose.residuals.comparison import residual, rows_of
from dsz_daemon.diagnose.selection import trials as trials_module
from dsz_daemon.diagnose.selection.guesses import guesses
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.selection.starts import starts_of
from dsz_daemon.diagnose.selection.trials import Step, Trial, all_tried, enough_first, rank_by
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted

LIMITS = {"tyre_saturation.inverse_square": 0.35**-2, "tyre_saturation.ellipse": 1.0}
TURNS = ("steering_ratio", "gyro_scale")
LAST_S = len(T) * 0.01


def worn() -> Drive:
    return drive(LIMITS, CITY_V, 1.3 * CITY_STEER)


def test_tyres_whose_grip_ends_are_guessed_by_the_friction_that_explains_the_most() -> None:
    """From no limit at all the slope leads to one that is too high, and there the fit stays."""
    one = worn()
    rows = rows_of(one)
    before = fitted(one, rows, nothing(), (), TOLERANCE)
    start = dict(guesses(one, rows, before))["tyre_saturation"]
    # Stiffnesses that have room have taken some of it already.
    assert 0.3 < start[INDEX["tyre_saturation.inverse_square"]] ** -0.5 < 0.6
    assert start[INDEX["tyre_saturation.sharpness"]] != 0.0
    # As those of the model so far, but for this.
    others = [i for name, i in INDEX.items() if not name.startswith("tyre_saturation.")]
    np.testing.assert_array_equal(start[others], before.x[others])
    mine = [
        x
        for effects, x in starts_of(one, rows, before, ["tyre_saturation", "gyro_scale"])
        if "tyre_saturation" in effects
    ]
    assert len(mine) == 1
    np.testing.assert_array_equal(mine[0], start)


def test_an_ellipse_is_guessed_with_it() -> None:
    for ellipse in (0.01, 1.0):
        one = drive(LIMITS | {"tyre_saturation.ellipse": ellipse}, CITY_V, 1.3 * CITY_STEER)
        rows = rows_of(one)
        start = dict(guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)))["tyre_saturation"]
        assert start[INDEX["tyre_saturation.ellipse"]] == ellipse


def test_grip_that_ends_all_the_way_is_no_stretch() -> None:
    one = worn()
    assert searched(one, rows_of(one), TOLERANCE).best.effects == ("tyre_saturation",)


def test_a_stretch_has_to_explain_more_than_tyres_do() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    fit = fitted(one, rows_of(one), nothing(), (), TOLERANCE)

    def first(stretch: float) -> str:
        # `gained` of a fit over itself is none: by rank they are what their gains are, where no two are rivals.
        steps = [Step("low_friction", stretch, fit), Step("tyre_saturation", 100.0, fit), Step("wheel_slip", 1e4, fit)]
        rank = rank_by(one, fit, steps)
        return max(steps[:2], key=rank).effect

    assert first(104.0) == "tyre_saturation"
    assert first(106.0) == "low_friction"


def slippery(end_s: float) -> tuple[Drive, Any, Fit]:
    ice = {"low_friction.inverse_square": 0.3**-2, "low_friction.start_s": 20.0, "low_friction.end_s": LAST_S}
    one = drive(ice, CITY_V, CITY_STEER)
    rows, x = rows_of(one), nothing()
    for name, value in ice.items():
        x[INDEX[name]] = value
    fit = fitted(one, rows, x, ("low_friction",), TOLERANCE)
    fit.x[moments_of(one)[1]] = end_s
    return one, rows, fit._replace(left=residual(rows, predicted(one, fit.x, fit.road)))


def test_a_stretch_that_ends_after_the_recording_is_not_looked_through_to_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A step of two seconds at a time, of a simulation each, would be a day's."""
    one, rows, fit = slippery(86660.3)
    tried: list[float] = []

    def left_by(*arguments: Any) -> float:
        tried.append(float(arguments[-1][moments_of(one)[1]]))
        assert len(tried) < 200
        return original(*arguments)

    original = moments_module._left_by
    monkeypatch.setattr(moments_module, "_left_by", left_by)
    end_s = in_the_middle(one, rows, fit, TOLERANCE).x[moments_of(one)[1]]
    assert tried
    assert LAST_S - 5.0 < end_s <= LAST_S


def test_a_fit_keeps_a_stretch_on_the_way() -> None:
    one, rows, fit = slippery(LAST_S + 40.0)
    again = fitted(one, rows, fit.x, ("low_friction",), TOLERANCE)
    begin_s, end_s = again.x[moments_of(one)]
    assert begin_s == pytest.approx(20.0, abs=2.0)
    assert end_s <= LAST_S + 1e-9


def test_a_moment_is_as_sure_as_the_car_is_steered_there() -> None:
    """A straight tells nothing of grip: where a stretch begins on it could be anywhere."""
    begins_s, moment = 20.0, moments_of(worn())[0]
    straight_s = (12.0, 26.0)
    told = []
    for steer in (CITY_STEER, np.where((straight_s[0] < T) & (straight_s[1] > T), 0.0, CITY_STEER)):
        ice = {"low_friction.inverse_square": 0.3**-2, "low_friction.start_s": begins_s, "low_friction.end_s": 60.0}
        one = drive(ice, CITY_V, 1.3 * steer)
        rows, x = rows_of(one), nothing()
        for name, value in ice.items():
            x[INDEX[name]] = value
        fit = fitted(one, rows, x, ("low_friction",), TOLERANCE)
        fit = in_the_middle(one, rows, fit, TOLERANCE)
        told.append((fit.x[moment], fit.std[fit.columns.index(moment)]))
        # That is what is told, too.
        assert values_of(one, fit, "low_friction")["start_s"] == told[-1]
    (steered, surely), (straight, hardly) = told
    assert abs(steered - begins_s) < 1.0 < surely + 1e-9 < 2.0
    # Uniform over the straight, or all but its ends.
    assert straight == pytest.approx(np.mean(straight_s), abs=2.0)
    assert hardly == pytest.approx(np.ptp(straight_s) / math.sqrt(12.0), rel=0.35)
    assert abs(straight - begins_s) < 2.0 * hardly


@pytest.mark.parametrize(
    ("begins_s", "ends_s", "is_none"),
    [(20.0, 21.9, True), (20.0, 22.1, False), (20.0, 15.0, True), (10.0, 45.9, False), (10.0, 46.1, True)],
)
def test_a_stretch_is_none_that_is_over_before_a_car_shows_it_or_has_no_end(
    begins_s: float, ends_s: float, is_none: bool
) -> None:
    """Six tenths of a minute at most."""
    one, rows, fit = slippery(ends_s)
    fit.x[moments_of(one)] = begins_s, ends_s
    assert is_implausible(one, rows, fit, "low_friction") is is_none


@pytest.mark.parametrize(
    ("slips_s", "is_none"), [(17.9, False), (18.1, True), (21.9, True), (30.0, False), (38.1, True), (42.1, False)]
)
def test_a_stretch_is_none_that_begins_or_ends_as_a_steering_sensor_slips(slips_s: float, is_none: bool) -> None:
    """From 20 to 40 s; what does not slip all at once does so for a while."""
    one, rows, fit = slippery(40.0)
    fit.x[moments_of(one)] = 20.0, 40.0
    fit.x[INDEX["steering_slip.at_s"]] = slips_s
    assert is_implausible(one, rows, fit._replace(effects=("steering_slip", "low_friction")), "low_friction") is is_none
    assert not is_implausible(one, rows, fit, "low_friction")


def test_a_stretch_ends_after_it_begins_wherever_nothing_tells(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where both ends could be anywhere, neither is told beyond the other."""
    one, rows, fit = slippery(40.0)
    monkeypatch.setattr(moments_module, "_left_by", lambda *_: 0.0)
    begins_s, ends_s = in_the_middle(one, rows, fit, TOLERANCE).x[moments_of(one)]
    assert (begins_s, ends_s) == (pytest.approx(20.0, abs=1.0), pytest.approx(40.0, abs=1.0))


def test_of_two_limits_the_one_that_gains_more_is_named_however_sure_its_friction_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A stretch, which has less to explain, tells its friction better; but what one limit tells, so does the other."""
    one = drive({}, CITY_V, CITY_STEER)
    fit = fitted(one, rows_of(one), nothing(), (), TOLERANCE)
    ranked = [Step(name, gain, fit) for name, gain in (("tyre_saturation", 260.0), ("low_friction", 240.0))]
    ranked += [Step("steering_ratio", 230.0, fit), Step("gyro_scale", 220.0, fit)]
    for sure, order in (
        ({"low_friction"}, ["tyre_saturation", "low_friction", "steering_ratio", "gyro_scale"]),
        ({"gyro_scale"}, ["gyro_scale", "tyre_saturation", "low_friction", "steering_ratio"]),
    ):
        monkeypatch.setattr(trials_module, "is_told", lambda _drive, _fit, effect, sure=sure: effect in sure)
        assert [step.effect for step in enough_first(one, fit, ranked, lambda _: 0.0)] == order


def test_beside_a_limit_of_grip_a_cars_numbers_are_no_surer_than_what_is_worth_a_name() -> None:
    """A tyre's own curve turns a car at large angles as a steering ratio does that varies."""
    one = drive({**LIMITS, "steering_ratio.per_rad": 0.006}, CITY_V, 1.3 * CITY_STEER)
    rows, start = rows_of(one), nothing()
    for name, value in LIMITS.items():
        start[INDEX[name]] = value
    alone, beside = (fitted(one, rows, start, e, TOLERANCE) for e in (("steering_ratio",), ("tyre_saturation", *TURNS)))
    scale, per_rad, gyro = (INDEX[name] for name in ("steering_ratio.scale", "steering_ratio.per_rad", "gyro_scale.z"))
    for column, least, at_least in ((scale, 0.006, 0.0075), (per_rad, 0.004, 0.005)):
        assert one.vocabulary.columns[column][1].least == least
        assert at_least <= beside.std[beside.columns.index(column)] < 1.5 * at_least
        assert alone.std[alone.columns.index(column)] < at_least
    assert beside.std[beside.columns.index(gyro)] < one.vocabulary.columns[gyro][1].least

    def is_refused(fit: Fit, value: float) -> bool:
        x = fit.x.copy()
        x[scale], x[per_rad] = 0.0, value
        return is_implausible(one, rows, fit._replace(x=x), "steering_ratio")

    assert is_refused(beside, 0.009)
    assert not is_refused(beside, 0.02)
    assert not is_refused(alone, 0.0045)
    # What no curve of a tyre is, may be as small as it is.
    assert not is_implausible(one, rows, beside._replace(x=nothing()), "gyro_scale")


def test_a_stretch_that_is_one_stays_beside_the_same_all_the_way() -> None:
    """Nobody has thought of that: it is held against it all the same (decision 0080)."""
    ice = {"low_friction.inverse_square": 0.35**-2, "low_friction.start_s": 20.0, "low_friction.end_s": 50.0}
    one = drive(ice, CITY_V, 1.3 * CITY_STEER)
    rows = rows_of(one)
    nominal = fitted(one, rows, nothing(), (), TOLERANCE)
    stretch = nominal.x.copy()
    for name, value in (ice | {"low_friction.sharpness": 0.01}).items():
        stretch[INDEX[name]] = value
    trial = Trial(one, rows, nominal, TOLERANCE, screened(one, rows, nominal, TOLERANCE, map).known)
    tried, _ = all_tried(trial, [(("low_friction",), stretch)], (), lambda steps: steps, map)
    assert tried[0].effect == "low_friction"
