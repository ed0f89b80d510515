"""What lost the last time waits beside a few effects, until of the others none gains enough."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, INDEX
from dsz_daemon.diagnose.selection import trials as trials_module
from dsz_daemon.diagnose.selection.plausible import is_rather_something
from dsz_daemon.diagnose.selection.trials import Step, Trial, all_tried, enough_first, rank_by
from dsz_daemon.diagnose.simulation.drive import nothing

_X = np.zeros(1)


def _trial(
    fitted: list[str], gains: dict[str, list[float]], effects: tuple[str, ...], leaders: list[float] | None = None
) -> Any:
    """A trial in which candidates gain what is said, start by start; `fitted` hears which were tried, beside whom."""
    leaders = [] if leaders is None else leaders
    left = {effect: list(each) for effect, each in gains.items()}

    def fit(start: Any, _each: Any = map, leader: float = 0.0) -> Step:
        fitted.append(start[0][-1])
        leaders.append(leader)
        return Step(start[0][-1], left[start[0][-1]].pop(0), None)  # type: ignore[arg-type]

    return SimpleNamespace(fit=fit, judge=lambda step, _each: step, drive=None, best=SimpleNamespace(effects=effects))


@pytest.fixture(autouse=True)
def ranked_by_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trials_module, "_ranked", lambda _, __, steps: sorted(steps, key=lambda one: -one.gain))


def _enough(steps: list[Step]) -> list[Step]:
    return [step for step in steps if step.gain > 10.0]


@pytest.mark.parametrize(
    ("gain", "effects", "tried", "best", "waits"),
    [
        (50.0, ("a", "b"), ["gyro_scale"], "gyro_scale", {"road_bank"}),
        (5.0, ("a", "b"), ["gyro_scale", "road_bank"], "road_bank", set()),
        (-5.0, ("a", "b"), ["gyro_scale", "road_bank"], "road_bank", {"gyro_scale"}),
        (50.0, ("a",), ["gyro_scale", "road_bank"], "gyro_scale", set()),
    ],
)
def test_what_lost_waits_until_of_the_others_none_gains_enough(
    gain: float, effects: tuple[str, ...], tried: list[str], best: str, waits: set[str]
) -> None:
    fitted: list[str] = []
    trial = _trial(fitted, {"road_bank": [30.0], "gyro_scale": [gain]}, effects)
    starts = [(("road_bank",), _X), (("gyro_scale",), _X)]
    steps, waiting = all_tried(trial, starts, {"road_bank"}, _enough, map)
    assert (fitted, steps[0].effect, waiting) == (tried, best, waits)


def test_what_takes_long_comes_last_and_knows_what_the_others_came_to() -> None:
    fitted: list[str] = []
    leaders: list[float] = []
    gains = {"side_wind": [30.0], "gyro_scale": [50.0], "low_friction": [30.0], "road_bank": [30.0]}
    starts = [((name,), _X) for name in ("side_wind", "low_friction", "gyro_scale", "road_bank")]
    steps, _ = all_tried(_trial(fitted, gains, (), leaders), starts, (), _enough, map)
    assert fitted == ["side_wind", "gyro_scale", "road_bank", "low_friction"]
    assert leaders == [0.0, 0.0, 50.0, 50.0]
    # Of those that gain alike the first is the first.
    assert [step.effect for step in steps] == ["gyro_scale", "side_wind", "low_friction", "road_bank"]


@pytest.mark.parametrize(
    ("effect", "leader", "gains", "asked"),
    [
        # Far behind, and no further: the first time nothing is known of that.
        ("road_bank", 400.0, [37.0, 38.0, 39.0], 2),
        ("road_bank", 400.0, [6.0, 50.0, 52.0], 3),
        ("road_bank", 400.0, [6.0, 150.0, 151.0], 3),
        ("sensor_saturation", 400.0, [37.0, 38.0, 39.0], 2),
        # A leader that gains little is none.
        ("road_bank", 50.0, [3.0, 3.0, 3.0], 3),
        ("road_bank", 400.0, [70.0, 70.0, 70.0], 3),
        # What a profile has lost twice no rounds bring back, whoever leads.
        ("road_bank", 0.0, [-50.0, 800.0], 2),
        ("road_bank", 0.0, [-50.0, -30.0, 800.0], 2),
        ("side_wind imu_delay", 0.0, [-50.0, -30.0, 800.0], 2),
        ("gyro_scale road_bank", 0.0, [-50.0, -19.0, 800.0], 3),
    ],
)
def test_what_stands_still_far_behind_a_leader_is_left_there(
    monkeypatch: pytest.MonkeyPatch, effect: str, leader: float, gains: list[float], asked: int
) -> None:
    left = list(gains)
    monkeypatch.setattr(trials_module, "gained", lambda *_: left.pop(0) if left else 0.0)
    monkeypatch.setattr(trials_module, "is_implausible", lambda *_: False)
    monkeypatch.setattr(trials_module, "does_nothing", lambda *_: False)
    monkeypatch.setattr(trials_module, "exactly", lambda *_: None)
    rounds: list[int] = []

    def fitted(*_: Any, is_hopeless: Any, **__: Any) -> None:
        for k in range(1, len(gains) + 1):
            rounds.append(k)
            if is_hopeless(None):
                break

    monkeypatch.setattr(trials_module, "fitted", fitted)
    none: Any = None
    trial = Trial(none, none, SimpleNamespace(effects=(), felt=None), {}, none)  # type: ignore[arg-type]
    trial.fit((tuple(effect.split()), _X), map, leader)
    assert len(rounds) == asked


@pytest.mark.parametrize(("new", "asked"), [(("side_wind", "imu_lever_arm"), 1), (("gyro_scale", "imu_lever_arm"), 0)])
def test_two_of_which_one_can_not_be_what_it_is_are_left_where_the_other_takes_long(
    monkeypatch: pytest.MonkeyPatch, new: tuple[str, ...], asked: int
) -> None:
    monkeypatch.setattr(trials_module, "gained", lambda *_: 0.0)
    monkeypatch.setattr(trials_module, "is_implausible", lambda _, __, ___, effect: effect == "imu_lever_arm")
    monkeypatch.setattr(trials_module, "does_nothing", lambda *_: False)
    rounds: list[bool] = []

    def fitted(*_: Any, is_hopeless: Any, **__: Any) -> None:
        if is_hopeless is not None:
            rounds.append(is_hopeless(None))

    monkeypatch.setattr(trials_module, "fitted", fitted)
    none: Any = None
    best: Any = SimpleNamespace(effects=("gyro_g_sensitivity",), felt=None)
    step = Trial(none, none, best, {}, none).fit((new, _X))
    assert step.gain == -math.inf
    assert rounds == [True] * asked


@pytest.mark.parametrize(
    ("leader", "gain", "is_moved"), [(0.0, 1.0, True), (0.0, -1.0, False), (400.0, 59.0, False), (400.0, 61.0, True)]
)
def test_where_a_stretch_begins_is_looked_for_where_it_is_worth_it(
    monkeypatch: pytest.MonkeyPatch, leader: float, gain: float, is_moved: bool
) -> None:
    moved: list[int] = []

    def with_best_moments(*_: Any) -> np.ndarray:
        moved.append(1)
        return _X

    monkeypatch.setattr(trials_module, "gained", lambda *_: gain)
    for never in ("is_implausible", "does_nothing"):
        monkeypatch.setattr(trials_module, never, lambda *_: False)
    monkeypatch.setattr(trials_module, "with_best_moments", with_best_moments)
    monkeypatch.setattr(trials_module, "moments_of", lambda _: [0])
    fit: Any = SimpleNamespace(x=_X)
    monkeypatch.setattr(trials_module, "fitted", lambda *_, **__: fit)
    monkeypatch.setattr(trials_module, "exactly", lambda *_: fit)
    none: Any = None
    trial = Trial(none, none, SimpleNamespace(effects=(), felt=None), {}, none)  # type: ignore[arg-type]
    trial.fit((("low_friction",), _X), map, leader)
    assert bool(moved) is is_moved


def test_what_has_no_profile_is_not_asked_without_a_leader(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(trials_module, "gained", lambda *_: 0.0)
    monkeypatch.setattr(trials_module, "is_implausible", lambda *_: False)
    monkeypatch.setattr(trials_module, "does_nothing", lambda *_: False)
    monkeypatch.setattr(trials_module, "fitted", lambda *_, is_hopeless, **__: asked.append(is_hopeless))
    none: Any = None
    trial = Trial(none, none, SimpleNamespace(effects=(), felt=None), {}, none)  # type: ignore[arg-type]
    trial.fit((("tyre_saturation",), _X), map, 30.0)
    trial.fit((("tyre_saturation",), _X), map, 300.0)
    assert asked[0] is None
    assert asked[1] is not None


def test_what_gains_from_one_of_its_starts_does_not_wait() -> None:
    trial = _trial([], {"side_wind": [-20.0, 0.5], "road_bank": [-20.0, -3.0], "imu_delay": [0.0]}, ())
    starts = [((name,), _X) for name in ("side_wind", "side_wind", "road_bank", "road_bank", "imu_delay")]
    assert all_tried(trial, starts, (), _enough, map)[1] == {"road_bank", "imu_delay"}


@pytest.mark.parametrize(
    ("wind", "bank", "asked", "order"),
    [
        (100.0, 61.0, 5.0, ["road_bank", "gyro_scale", "side_wind"]),
        # A bank that gains too little to be told may be what it is, too.
        (100.0, 61.0, 50.0, ["gyro_scale", "side_wind", "road_bank"]),
        (100.0, 59.0, 50.0, ["side_wind", "gyro_scale", "road_bank"]),
        # What may be chance is no bank.
        (12.0, 9.0, 5.0, ["side_wind", "gyro_scale", "road_bank"]),
    ],
)
def test_a_wind_waits_for_a_bank_that_gains_about_as_much(
    monkeypatch: pytest.MonkeyPatch, wind: float, bank: float, asked: float, order: list[str]
) -> None:
    """Those that gain enough first: of a profile that is twice what is asked."""
    monkeypatch.setattr(trials_module, "is_beyond_form", lambda *_: False)
    monkeypatch.setattr(trials_module, "is_told", lambda *_: True)
    none: Any = None
    gains = {"side_wind": wind, "road_bank": bank, "gyro_scale": 11.0}
    ranked = [Step(name, gain, none) for name, gain in sorted(gains.items(), key=lambda one: -one[1])]
    found = enough_first(none, none, ranked, lambda effect: asked if effect == "road_bank" else 5.0)
    assert [step.effect for step in found] == order


@pytest.mark.parametrize(("vague", "first"), [(56.2, "told"), (84.0, "vague")])
def test_of_two_starts_that_gain_alike_the_one_that_is_told_comes_first(
    monkeypatch: pytest.MonkeyPatch, vague: float, first: str
) -> None:
    monkeypatch.setattr(trials_module, "is_told", lambda _, fit, __: fit != "vague")
    none: Any = None
    ranked = [
        Step("mass_loading", vague, "vague"),  # type: ignore[arg-type]
        Step("mass_loading", 53.4, "told"),  # type: ignore[arg-type]
        Step("gyro_scale", 50.0, "other"),  # type: ignore[arg-type]
    ]
    assert enough_first(none, none, ranked, lambda _: 5.0)[0].fit == first


@pytest.mark.parametrize(
    ("load", "tyres", "compliance", "first"),
    [
        (592.0, 575.0, None, "mass_loading"),
        # So little more is none: a hundredth of what they gain, and no less than what a candidate has to gain.
        (584.0, 575.0, None, "cornering_stiffness"),
        (5060.0, 5011.0, None, "cornering_stiffness"),
        (5062.0, 5011.0, None, "mass_loading"),
        # Nor is more than of one of them.
        (592.0, 575.0, 590.0, "cornering_stiffness"),
        # Alone it has none to be more than.
        (592.0, None, None, "gyro_scale"),
    ],
)
def test_a_load_that_gains_clearly_more_than_what_turns_a_car_alike_comes_before_it(
    monkeypatch: pytest.MonkeyPatch, load: float, tyres: float | None, compliance: float | None, first: str
) -> None:
    """However little is told of how much it weighs."""
    monkeypatch.setattr(trials_module, "is_told", lambda _, fit, __: fit != "vague")
    monkeypatch.setattr(trials_module, "is_rather_something", lambda *_: False)
    monkeypatch.setattr(trials_module, "rank_by", lambda *_: lambda step: step.gain)
    none: Any = None
    gains = {"mass_loading": load, "cornering_stiffness": tyres, "steering_compliance": compliance, "gyro_scale": 30.0}
    vague: Any = "vague"
    ranked = [
        Step(name, gain, vague if name in {"mass_loading", "steering_compliance"} else none)
        for name, gain in gains.items()
        if gain is not None
    ]
    ranked.sort(key=lambda step: -step.gain)
    assert enough_first(none, none, ranked, lambda _: 5.0)[0].effect == first


@pytest.mark.parametrize(
    ("compliance", "tyres", "may_be_none", "first"),
    [
        # The first of those that turn a car alike by what it gains, however little is told of how much of it there is.
        (506.0, 500.0, False, "steering_compliance"),
        (494.0, 500.0, False, "cornering_stiffness"),
        # But not where it is as likely as not to be nothing, nor where what turns the car is not sure itself.
        (506.0, 500.0, True, "cornering_stiffness"),
        (99.0, 95.0, False, "cornering_stiffness"),
        (101.0, 95.0, False, "steering_compliance"),
    ],
)
def test_of_what_turns_a_car_alike_the_first_is_what_it_gains(
    monkeypatch: pytest.MonkeyPatch, compliance: float, tyres: float, may_be_none: bool, first: str
) -> None:
    monkeypatch.setattr(trials_module, "is_told", lambda _, __, effect: effect == "cornering_stiffness")
    monkeypatch.setattr(trials_module, "is_rather_something", lambda *_: not may_be_none)
    monkeypatch.setattr(trials_module, "rank_by", lambda *_: lambda step: step.gain)
    none: Any = None
    ranked = [
        Step("gyro_scale", 900.0, none),
        Step("steering_compliance", compliance, none),
        Step("cornering_stiffness", tyres, none),
    ]
    ranked.sort(key=lambda step: -step.gain)
    found = enough_first(none, none, ranked, lambda _: 5.0)
    # What is none of them and not told stays behind, however much it gains.
    assert found[0].effect == first


@pytest.mark.parametrize(
    ("own", "first"), [(203.6, "steering_ratio"), (299.0, "steering_ratio"), (301.0, "wheels_more")]
)
def test_what_all_wheels_read_less_has_to_gain_the_most_both_ways(
    monkeypatch: pytest.MonkeyPatch, own: float, first: str
) -> None:
    """Another car's ratio gained more by what it left, and less by what both did."""
    alike = {"wheels_more": 192.0, "steering_ratio": 75.0}
    monkeypatch.setattr(trials_module, "gained", lambda _, __, fit, ___: alike[fit.effects[-1]])
    none: Any = None
    steps = [
        Step(effect, gain, SimpleNamespace(effects=(effect,), per_row=np.ones(13)))  # type: ignore[arg-type]
        for effect, gain in (("wheels_more", own), ("steering_ratio", 300.0))
    ]
    assert max(steps, key=rank_by(none, none, steps)).effect == first


@pytest.mark.parametrize(
    ("limit", "may_be_none", "first"),
    # A wind took what tyres left that hold no more, by half of what their limit gained, since that was 1.9 spreads.
    [(118.0, False, "tyre_saturation"), (118.0, True, "side_wind"), (99.0, False, "side_wind")],
)
def test_a_limit_of_grip_that_surely_gains_the_most_comes_first_however_low_it_is(
    monkeypatch: pytest.MonkeyPatch, limit: float, may_be_none: bool, first: str
) -> None:
    monkeypatch.setattr(trials_module, "is_told", lambda _, __, effect: effect == "side_wind")
    monkeypatch.setattr(trials_module, "is_rather_something", lambda *_: not may_be_none)
    none: Any = None
    ranked = [Step("tyre_saturation", limit, none), Step("side_wind", 55.9, none)]
    assert enough_first(none, none, ranked, lambda _: 5.0)[0].effect == first


@pytest.mark.parametrize(
    ("gains", "effects", "tried"),
    [
        ({"low_friction": [60.0], "tyre_saturation": [700.0]}, (), ["low_friction", "tyre_saturation"]),
        ({"low_friction": [9.0], "tyre_saturation": [700.0]}, (), ["low_friction"]),
        ({"low_friction": [60.0], "tyre_saturation": [700.0]}, ("tyre_saturation",), ["low_friction"]),
        ({"low_friction": [60.0], "gyro_scale": [61.0]}, (), ["gyro_scale", "low_friction"]),
        ({"low_friction": [60.0], "tyre_saturation": [50.0, 1.0]}, (), ["low_friction", "tyre_saturation"]),
    ],
)
def test_grip_that_ends_all_the_way_is_thought_of_where_a_stretch_gains_the_most(
    gains: dict[str, list[float]], effects: tuple[str, ...], tried: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trials_module, "as_everywhere", lambda _, slippery: slippery)
    fitted: list[str] = []
    trial = _trial(fitted, gains, effects)
    trial.best.x = _X
    fit = trial.fit
    trial.fit = lambda *given: fit(*given)._replace(fit=SimpleNamespace(x=_X))
    names = [name for name in gains if name != "tyre_saturation" or len(gains[name]) > 1]
    steps, _ = all_tried(trial, [((name,), _X) for name in names], (), _enough, map)
    assert sorted(fitted) == tried
    gain = {name: each[0] for name, each in gains.items()}
    assert [step.effect for step in steps] == sorted(tried, key=lambda name: -gain[name])


@pytest.mark.parametrize(("rear", "expected"), [(0.06, True), (0.07, False), (-0.07, False)])
def test_front_wheels_that_give_way_leave_the_rear_ones_as_they_are(rear: float, expected: bool) -> None:
    """Where tyres tell that the rear ones are others, by two spreads, it is no compliance, however large it may be."""
    columns = tuple(INDEX[f"cornering_stiffness.{axle}_scale"] for axle in ("front", "rear"))
    x = nothing()
    x[list(columns)] = -0.2, rear
    tyres: Any = SimpleNamespace(columns=columns, x=x, std=np.array([0.01, 0.033]))
    one: Any = SimpleNamespace(vocabulary=BUILT_IN)
    place = INDEX["steering_compliance.rad_per_n"]
    y = nothing()
    y[place] = 1.0e-6
    for spread, is_rather in ((1.9e-6, True), (2.1e-6, False)):
        gives: Any = SimpleNamespace(columns=(place,), x=y, std=np.array([spread]))
        assert is_rather_something(one, gives, "steering_compliance") is is_rather
        assert is_rather_something(one, gives, "steering_compliance", tyres) is (is_rather and expected)
        # A load turns both.
        assert is_rather_something(one, tyres, "cornering_stiffness", tyres)
