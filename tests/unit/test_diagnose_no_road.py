"""diagnose: what tips an IMU as a road would, and moves the car itself as none does; loads that weigh nothing."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.recordings.recording import filter_kernel
from dsz_daemon.diagnose.residuals.comparison import residual, rows_of
from dsz_daemon.diagnose.selection import swaps as swaps_module
from dsz_daemon.diagnose.selection import tilts
from dsz_daemon.diagnose.selection.plausible import is_implausible, weighs_nothing
from dsz_daemon.diagnose.selection.swaps import in_its_place
from dsz_daemon.diagnose.selection.tilts import (
    goes_to_and_fro,
    is_a_tilt_alone,
    pulls_nothing,
    shows_the_drive,
    tips_only_what_stands_on_it,
)
from dsz_daemon.diagnose.selection.trials import ODD_LOAD, Step, rank_by
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.motion import AY
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.surroundings.winds import follows_the_car

TILT_RAD = 0.04 * np.sin(0.45 * T) + 0.02 * np.sin(1.1 * T + 1.0)
# Up with the speed on some of the way, which what a car does follows to 0.75 where it is fitted to all of it.
MUCH_LIKE_THE_SPEED = 0.004 * (CITY_V - np.mean(CITY_V)) * np.interp(T, [0.0, 20.0, 40.0, 60.0], [1.0, -0.2, 0.6, 1.0])
AHEAD = {"road_grade": "grade_rad", "road_bank": "bank_rad"}
# What a road does to the car itself.
MOVES = {"road_grade": 5, "road_bank": 2}
TRACKS = [INDEX["track_width.front"], INDEX["track_width.rear"]]
WEIGHT = INDEX["mass_loading.added_mass_kg"]
FLAT_ROADS = INDEX["flat_roads"]


def tilted(road: str, of_the_car: float) -> Drive:
    """A drive whose IMU is tilted as by this road, which moves the car by such a share of what it would."""
    level = drive({}, CITY_V, CITY_STEER)
    noise = level.measured - predicted(level, nothing(), flat(N))
    shown = predicted(level, nothing(), flat(N)._replace(**{AHEAD[road]: TILT_RAD}))
    even = predicted(level, nothing(), flat(N))
    c = MOVES[road]
    shown[:, c] = even[:, c] + of_the_car * (shown[:, c] - even[:, c])
    return level._replace(measured=shown + noise)


def its_road(one: Drive, road: str) -> Fit:
    """As if a car followed it, whether it does or not."""
    rows, fit = rows_of(one), as_drawn(one, road)
    x = fit.x.copy()
    x[FLAT_ROADS] = 0.0
    return fit._replace(x=x, left=residual(rows, predicted(one, x, fit.road)))


def as_drawn(one: Drive, road: str) -> Fit:
    return fitted(one, rows_of(one), nothing(), (road,), TOLERANCE)


@pytest.mark.parametrize("road", sorted(AHEAD))
@pytest.mark.parametrize(("of_the_car", "is_none"), [(1.0, False), (0.8, False), (0.0, True), (-1.0, False)])
def test_what_tips_the_imu_and_does_not_move_the_car_is_no_road(road: str, of_the_car: float, is_none: bool) -> None:
    """As much the other way is something else, that is found or not: not the road's to say."""
    one = tilted(road, of_the_car)
    fit = its_road(one, road)
    assert tips_only_what_stands_on_it(one, rows_of(one), fit, road) is is_none
    if of_the_car > 0.0:
        assert not is_implausible(one, rows_of(one), fit, road)


def test_turns_are_counted_by_what_a_course_goes_back() -> None:
    zigzag = np.array([0.0, 3.0, 1.0, 2.0, -2.0, 5.0, 5.0])
    for course in (zigzag, -zigzag, zigzag + 7.0):
        assert [tilts._turns(course, least) for least in (1.0, 2.0, 2.5, 5.0, 6.0, 8.0)] == [4, 2, 2, 1, 0, 0]
    assert tilts._turns(np.zeros(5), 0.1) == 0


@pytest.mark.parametrize("of_the_car", [0.0, 1.0])
def test_a_road_that_is_drawn_as_a_tilt_alone_lifts_no_car(of_the_car: float) -> None:
    """How it is drawn is found, says the same of whether a car follows it, and a hill and a dale are a road."""
    one = tilted("road_grade", of_the_car)
    rows, fit = rows_of(one), as_drawn(one, "road_grade")
    assert fit.x[FLAT_ROADS] == pytest.approx(1.0 - of_the_car, abs=0.05)
    assert FLAT_ROADS in fit.columns
    assert FLAT_ROADS not in fitted(one, rows, nothing(), (), TOLERANCE).columns
    assert tips_only_what_stands_on_it(one, rows, fit, "road_grade") is (of_the_car == 0.0)
    assert not is_implausible(one, rows, fit, "road_grade")


@pytest.mark.parametrize(
    ("tilt_rad", "is_a_road"),
    [
        (TILT_RAD, True),
        (0.002 * (CITY_V - np.mean(CITY_V)), False),
        (0.005 * np.gradient(CITY_V, T), False),
        (0.02 * np.tanh((T - 60.0) / 5.0), False),
        (0.02 * np.exp(-(((T - 60.0) / 6.0) ** 2)), False),
        (0.02 * np.exp(-(((T - 31.0) / 2.5) ** 2)), False),
        # Up, down and up again by no more than the car does is one; by as much besides what it does it takes once more.
        (0.02 * np.cos(2.5 * np.pi * T / T[-1]), True),
        (0.02 * np.cos(2.5 * np.pi * T / T[-1]) + 0.0035 * (CITY_V - np.mean(CITY_V)), False),
        # Nor is it a body that goes by 5 degrees, and back and forth, though it climbs as the car slows.
        (0.008 * (CITY_V - np.mean(CITY_V)) + 0.018 * np.sin(12.0 * np.pi * T / T[-1]), True),
        (0.011 * (CITY_V - np.mean(CITY_V)) + 0.001 * np.sin(12.0 * np.pi * T / T[-1]), False),
        (0.004 * (CITY_V - np.mean(CITY_V)) + 0.009 * np.sin(12.0 * np.pi * T / T[-1]), False),
        # Of a road what a car does tells most where it is fitted to it, and nothing of the next part of the way.
        (MUCH_LIKE_THE_SPEED, True),
    ],
    ids=[
        "hills",
        "as fast",
        "as it speeds up",
        "once",
        "a hump",
        "a short one",
        "a dale",
        "as fast, too",
        "far",
        "as fast as far",
        "less far",
        "by chance",
    ],
)
def test_what_levels_a_body_follows_the_car_or_does_so_once(tilt_rad: np.ndarray, is_a_road: bool) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    fit: Any = SimpleNamespace(x=nothing(), road=flat(N)._replace(grade_rad=tilt_rad))
    assert goes_to_and_fro(one, fit) is is_a_road
    there_and_back = 0.02 * np.cos(2.5 * np.pi * T / T[-1])
    assert goes_to_and_fro(one, fit, more=True) is (is_a_road and not np.array_equal(tilt_rad, there_and_back))
    assert not goes_to_and_fro(one._replace(wheels=np.zeros((N, 4))), fit)


@pytest.mark.parametrize("goes", [False, True])
def test_a_climb_that_lifts_no_car_is_a_road_as_it_comes_and_goes(monkeypatch: pytest.MonkeyPatch, goes: bool) -> None:
    """A bank that turns none never is."""
    monkeypatch.setattr("dsz_daemon.diagnose.selection.tilts.goes_to_and_fro", lambda *_, **__: goes)
    for road in AHEAD:
        one = tilted(road, 0.0)
        is_none = is_implausible(one, rows_of(one), its_road(one, road), road)
        assert is_none is (road == "road_bank" or not goes)


def goes_more_often(is_more: bool, _: object, __: object, more: bool = False) -> bool:
    return is_more or not more


@pytest.mark.parametrize(
    ("share", "noise", "is_shown"),
    [(1.0, 0.1, True), (0.7, 0.1, True), (0.7, 8.0, False), (0.4, 0.1, False), (0.0, 0.1, False), (-1.0, 0.1, False)],
)
def test_a_body_that_is_pitched_against_its_way_shows_what_speeds_it_up(
    monkeypatch: pytest.MonkeyPatch, share: float, noise: float, is_shown: bool
) -> None:
    """a_z = g cos(theta) - theta v' of an IMU that is nose up on a level road: a climb turns v' with it."""
    one = tilted("road_grade", 0.0)
    fit, rows = its_road(one, "road_grade"), rows_of(one)
    # The car of these tests speeds up and slows by a sine; its mean tilt is the offset's.
    felt = -(TILT_RAD - np.mean(TILT_RAD)) * np.convolve(np.gradient(CITY_V, T), filter_kernel(), mode="same")
    left = fit.left.copy()
    size = float(np.std(felt))
    left[:, 5] = (share * felt + noise * size * np.random.default_rng(7).normal(size=N))[rows.at]
    fit = fit._replace(left=left)
    assert shows_the_drive(one, rows, fit) is is_shown
    for is_more in (True, False):
        # Of what comes and goes more often it is how the road is drawn.
        goes = partial(goes_more_often, is_more)
        monkeypatch.setattr("dsz_daemon.diagnose.selection.tilts.goes_to_and_fro", goes)
        assert is_a_tilt_alone(one, rows, fit) is (is_more or not is_shown)
    monkeypatch.setattr("dsz_daemon.diagnose.selection.plausible.tips_only_what_stands_on_it", lambda *_: True)
    monkeypatch.setattr("dsz_daemon.diagnose.selection.plausible.pulls_nothing", lambda *_: False)
    assert is_implausible(one, rows, fit, "road_grade") is is_shown
    one.measured[:, 5] = np.nan
    assert not shows_the_drive(one, rows_of(one), fit)


@pytest.mark.parametrize(
    ("share", "beside", "period_s", "is_none"),
    [(0.3, 0.8, 1.3, True), (0.45, 0.8, 1.3, False), (0.3, 0.3, 1.3, True), (0.3, 0.3, 25.0, False)],
)
def test_a_share_is_less_than_half_by_two_spreads_and_what_lasts_makes_these_wide(
    share: float, beside: float, period_s: float, is_none: bool
) -> None:
    """So much is left `beside` it that is quick, or the same for ten seconds and more."""
    one = tilted("road_grade", 0.0)
    fit, rows = its_road(one, "road_grade"), rows_of(one)
    level = fit.road._replace(grade_rad=np.zeros(N))
    moved = (predicted(one, fit.x, fit.road) - predicted(one, fit.x, level))[rows.at]
    left = fit.left.copy()
    left[:, 5] = (share - 1.0) * moved[:, 5] + beside * np.std(moved[:, 5]) * np.sin(
        2.0 * np.pi * T[rows.at] / period_s
    )
    assert tips_only_what_stands_on_it(one, rows, fit._replace(left=left), "road_grade") is is_none


@pytest.mark.parametrize(
    ("share", "of_noise", "is_none"),
    [(0.4, 0.0, True), (0.4, 0.1, True), (0.4, 0.25, False), (0.3, 0.25, True), (0.1, 0.45, True), (0.1, 0.55, False)],
)
def test_what_a_gyro_makes_up_of_a_road_lifts_no_car(share: float, of_noise: float, is_none: bool) -> None:
    """Of a rate with so much noise in its power a road of share 1 shows 1 - noise; of half noise nothing is said."""
    one = tilted("road_grade", 0.0)
    fit, rows = its_road(one, "road_grade"), rows_of(one)
    level = fit.road._replace(grade_rad=np.zeros(N))
    moved = (predicted(one, fit.x, fit.road) - predicted(one, fit.x, level))[rows.at]
    left = fit.left.copy()
    left[:, 5] = (share - 1.0) * moved[:, 5]
    # White noise of a row, of which 200 are in two seconds, at the speed of the car, is so much of what lifts it.
    means = np.array([np.mean(part) for part in np.array_split(moved[:, 5] - np.mean(moved[:, 5]), 30)])
    speeds = np.array([np.mean(part) for part in np.array_split(CITY_V[rows.at], 30)])
    radps = np.sqrt(of_noise * 200.0 * np.sum(means**2) / np.sum(speeds**2))
    floor = one.recording.floor.copy()
    floor[1] = radps * np.sqrt(np.sum(filter_kernel() ** 2))
    noisy = one._replace(recording=one.recording._replace(floor=floor))
    assert tips_only_what_stands_on_it(noisy, rows, fit._replace(left=left), "road_grade") is is_none


@pytest.mark.parametrize("road", sorted(AHEAD))
def test_where_it_is_not_told_or_not_measured_what_the_car_does_no_road_is_denied(road: str) -> None:
    one = tilted(road, 0.0)
    fit, rows = its_road(one, road), rows_of(one)
    assert tips_only_what_stands_on_it(one, rows, fit, road)
    vague = fit.left + 3.0 * np.random.default_rng(2).normal(size=fit.left.shape)
    assert not tips_only_what_stands_on_it(one, rows, fit._replace(left=vague), road)
    used = rows.used.copy()
    used[:, MOVES[road]] = False
    assert not tips_only_what_stands_on_it(one, rows._replace(used=used), fit, road)
    assert not tips_only_what_stands_on_it(one, rows, fit._replace(road=flat(N)), road)


@pytest.mark.parametrize(("grows", "follows"), [(1.0, True), (-1.0, True), (0.0, False)])
def test_a_wind_that_follows_the_car_more_and_more_is_none(grows: float, follows: bool) -> None:
    """As tyres that warm up push against what the simulation has of them."""
    one = drive({}, CITY_V, CITY_STEER)
    side = driven(one, nothing(), flat(N)).moved[:, AY]
    noise = np.convolve(np.random.default_rng(5).normal(size=N), np.ones(300) / 300.0, "same")
    pushes = 600.0 * grows * np.linspace(-1.0, 1.0, N) * side / np.std(side) + 150.0 * noise / np.std(noise)
    assert follows_the_car(one, nothing(), flat(N)._replace(side_n=pushes)) is follows


def loaded(added_kg: float, std_kg: float) -> Any:
    x = nothing()
    x[WEIGHT] = added_kg
    return SimpleNamespace(
        x=x, std=np.array([0.1, std_kg]), columns=(0, WEIGHT), effects=("mass_loading",), per_row=np.ones(13), form=None
    )


@pytest.mark.parametrize(
    ("added_kg", "std_kg", "nothing_is_there"),
    [(300.0, 100.0, False), (160.0, 100.0, False), (140.0, 100.0, True), (190.0, 260.0, True), (-300.0, 20.0, True)],
)
def test_a_load_weighs_something(added_kg: float, std_kg: float, nothing_is_there: bool) -> None:
    assert weighs_nothing(loaded(added_kg, std_kg)) is nothing_is_there


def test_what_is_no_load_is_not_asked_for_its_weight() -> None:
    other: Any = SimpleNamespace(x=nothing(), std=np.ones(1), columns=(0,), effects=("steering_compliance",))
    assert not weighs_nothing(other)


@pytest.mark.parametrize(
    ("added_kg", "first"), [(300.0, "mass_loading"), (50.0, "steering_compliance"), (-300.0, "steering_compliance")]
)
def test_a_load_that_weighs_nothing_stands_behind_what_turns_a_car_as_it_does(
    monkeypatch: pytest.MonkeyPatch, added_kg: float, first: str
) -> None:
    gains = {"mass_loading": 504.0, "steering_compliance": 500.0}
    monkeypatch.setattr("dsz_daemon.diagnose.selection.trials.gained", lambda *given: gains[given[2].effects[-1]])
    steering = loaded(0.0, 1.0)
    steering.effects, steering.columns = ("steering_compliance",), (0,)
    steps = [Step("mass_loading", 504.0, loaded(added_kg, 100.0)), Step("steering_compliance", 500.0, steering)]
    rank = rank_by(None, None, steps)  # type: ignore[arg-type]
    assert max(steps, key=rank).effect == first
    # Three spreads of what may be missing: a hundredth as likely as nothing.
    missing = {-300.0: 4.5}.get(added_kg, 0.0)
    assert rank(steps[0]) == pytest.approx(504.0 - ODD_LOAD * (added_kg < 100.0) - missing)


@pytest.mark.parametrize("weighs", [True, False])
def test_nor_does_it_take_their_place(monkeypatch: pytest.MonkeyPatch, weighs: bool) -> None:
    """In the place of a stiffness that gains as much."""
    one = drive({"front_cornering_stiffness_n_per_rad": -0.3}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    best = fitted(one, rows, nothing(), ("cornering_stiffness", "wheel_radius"), TOLERANCE)
    monkeypatch.setattr(swaps_module, "is_told", lambda *_: True)
    monkeypatch.setattr(swaps_module, "is_implausible", lambda *_: False)
    monkeypatch.setattr(swaps_module, "weighs_nothing", lambda fit: "mass_loading" in fit.effects and not weighs)
    monkeypatch.setattr(
        swaps_module, "fitted", lambda _, __, ___, effects, *____, **_____: best._replace(effects=effects)
    )
    steps = [Step("cornering_stiffness", 100.0, best)]
    found = in_its_place(one, rows, best, best, "cornering_stiffness", steps, TOLERANCE, map)
    gains = {step.effect: step.gain for step in found}
    assert gains["steering_compliance"] == pytest.approx(0.0, abs=1e-9)
    assert gains["mass_loading"] == pytest.approx(0.0 if weighs else -ODD_LOAD)
    monkeypatch.setattr(swaps_module, "odds_against_less", lambda fit: 2.0 * ("mass_loading" in fit.effects))
    found = in_its_place(one, rows, best, best, "cornering_stiffness", steps, TOLERANCE, map)
    gains = {step.effect: step.gain for step in found}
    assert gains["mass_loading"] == pytest.approx(-2.0 if weighs else -2.0 - ODD_LOAD)
    # Nor keeps it its own.
    monkeypatch.setattr(swaps_module, "odds_against_less", lambda _: 0.0)
    loaded_best = best._replace(effects=("mass_loading", "wheel_radius"))
    steps = [Step("mass_loading", 100.0, loaded_best)]
    found = in_its_place(one, rows, best, loaded_best, "mass_loading", steps, TOLERANCE, map)
    assert {step.effect for step in found} == {"cornering_stiffness", "steering_compliance"}
    assert [step.gain for step in found] == pytest.approx([0.0 if weighs else ODD_LOAD] * 2)


def test_a_mounts_roll_is_fitted_where_a_road_climbs_that_no_gyro_feels() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    one.measured[:, [0, 1, 5]] = np.nan
    rows, roll = rows_of(one), INDEX["imu_misalignment.roll_rad"]
    for effects, is_told in ((("imu_misalignment",), False), (("imu_misalignment", "road_grade"), True)):
        assert (roll in fitted(one, rows, nothing(), effects, TOLERANCE).columns) is is_told


@pytest.mark.parametrize(("road", "c"), [("road_grade", 3), ("road_bank", 4)])
def test_what_a_gyro_feels_and_no_gravity_shows_is_no_road(road: str, c: int) -> None:
    one = tilted(road, 1.0)
    rows, fit = rows_of(one), its_road(one, road)
    assert not pulls_nothing(one, rows, fit, road)
    # As if the accelerometer had shown what it would on a level road.
    shown = (predicted(one, fit.x, fit.road) - predicted(one, fit.x, flat(N)))[rows.at, c]
    left = fit.left.copy()
    left[:, c] -= shown
    level = fit._replace(left=left)
    assert pulls_nothing(one, rows, level, road)
    assert is_implausible(one, rows, level, road)
    # Half of it is more than nothing; and where nothing is measured nothing is said.
    left[:, c] += 0.6 * shown
    assert not pulls_nothing(one, rows, level, road)
    left[:, c] -= 0.6 * shown
    unused = rows.used.copy()
    unused[:, c] = False
    assert not pulls_nothing(one, rows._replace(used=unused), level, road)


@pytest.mark.parametrize(
    ("front", "rear", "is_none"),
    [(-0.2, 0.0, True), (-0.08, 0.0, False), (-0.2, -0.2, False), (0.0, -0.2, False), (0.2, 0.0, False)],
)
def test_a_driven_axle_that_alone_is_narrow_has_no_other_track(front: float, rear: float, is_none: bool) -> None:
    """Its wheels turn alike by what a differential holds; of a car that is driven behind it is the rear ones."""
    one = drive({"track_width.front": front, "track_width.rear": rear}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), ("track_width",), TOLERANCE)
    assert one.car.front_driven
    assert is_implausible(one, rows, fit, "track_width") is is_none
    x = fit.x.copy()
    x[TRACKS] = x[TRACKS[::-1]]
    other = one._replace(car=one.car._replace(front_driven=False, rear_driven=True))
    assert is_implausible(other, rows, fit._replace(x=x), "track_width") is is_none
