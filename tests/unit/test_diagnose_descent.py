"""diagnose: a descent takes slopes seldom, and ends where one that takes them all the time does."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX, vocabulary
from dsz_daemon.diagnose.fitting import descent, fit
from dsz_daemon.diagnose.fitting.descent import Learnt, Place, Slope, Step, turned
from dsz_daemon.diagnose.fitting.fit import exactly, fitted
from dsz_daemon.diagnose.fitting.model import Fit, Slopes
from dsz_daemon.diagnose.residuals.comparison import Rows, rows_of, sensitivities
from dsz_daemon.diagnose.shapes.unlisted import as_effect
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.simulation.prediction import predicted, shown
from dsz_daemon.diagnose.simulation.road import flat

RNG = np.random.default_rng(12)


def slopes_of_three() -> np.ndarray:
    """Channel 0 feels the first two of three parameters, channel 1 the last two, the rest nothing."""
    slopes = np.zeros((30, 13, 3))
    slopes[:, 0, :2], slopes[:, 1, 1:] = RNG.normal(size=(30, 2)), RNG.normal(size=(30, 2))
    return slopes


def test_turned_slopes_make_of_the_step_what_it_made() -> None:
    slopes, change, step = slopes_of_three(), RNG.normal(size=(30, 13)), np.array([0.3, -0.1, 0.2])
    found = turned(slopes, change, step, np.array([1.0, 0.5, 2.0]))
    np.testing.assert_allclose((found @ step)[:, :2], change[:, :2])
    assert not found[:, 0, 2].any()
    assert not found[:, 1, 0].any()
    assert not found[:, 2:].any()


def test_slopes_are_turned_along_the_step_and_in_the_units_of_their_parameters() -> None:
    """Of what a step brought more than expected, each parameter is told (step / size)^2 of its share."""
    slopes, step, sizes = slopes_of_three(), np.array([0.3, -0.1, 0.2]), np.array([1.0, 0.5, 2.0])
    change = slopes @ step
    change[:, 0] += 1.0
    by = turned(slopes, change, step, sizes) - slopes
    # 1 of 0.3^2 + (0.1 / 0.5)^2 is 0.13: 0.3 / 0.13 and -0.1 / 0.25 / 0.13.
    np.testing.assert_allclose(by[:, 0], np.tile([0.3 / 0.13, -0.4 / 0.13, 0.0], (30, 1)), atol=1e-12)
    np.testing.assert_allclose(by[:, 1], 0.0, atol=1e-12)


def test_what_is_linear_anyway_is_not_turned() -> None:
    slopes, step = slopes_of_three(), np.array([0.3, -0.1, 0.2])
    found = turned(slopes, RNG.normal(size=(30, 13)), step, np.array([math.inf, 1.0, math.inf]))
    np.testing.assert_array_equal(found[:, 0, 0], slopes[:, 0, 0])
    np.testing.assert_array_equal(found[:, 1, 2], slopes[:, 1, 2])
    still = turned(slopes, RNG.normal(size=(30, 13)), step, np.full(3, math.inf))
    np.testing.assert_array_equal(still, slopes)


class Counted:
    """Sensitivities, and how often they were taken."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.times = 0
        self._real = fit.sensitivities
        monkeypatch.setattr(fit, "sensitivities", self)

    def __call__(self, *given: Any) -> np.ndarray:
        self.times += 1
        return self._real(*given)


def by_slopes_of_its_own(slope: Slope, here: Place, *_: Any, **__: Any) -> tuple[Place, Learnt]:
    """Twelve steps, each by the slopes that there are where it begins."""
    for _round in range(12):
        found = slope.step(here, slope.learnt(here))
        if found is None:
            break
        here = found.there
    return here, slope.learnt(here)


@pytest.mark.parametrize(
    "planted",
    [
        {"wheel_speed_delay.delay_s": 0.1},
        {"tyre_relaxation.relaxation_length_m": 0.8},
        {"gyro_scale.z": 0.05, "imu_delay.delay_s": 0.05},
        {"road_bank.knot_3": 0.02},
    ],
)
def test_slopes_that_are_turned_lead_to_where_those_lead_that_are_taken(
    monkeypatch: pytest.MonkeyPatch, planted: dict[str, float]
) -> None:
    one, effects = drive(planted, CITY_V, CITY_STEER), tuple(name.split(".")[0] for name in planted)
    rows, taken = rows_of(one), Counted(monkeypatch)
    found = fitted(one, rows, nothing(), effects, TOLERANCE, settled=2e-5)
    times, taken.times = taken.times, 0
    monkeypatch.setattr(fit, "descended", by_slopes_of_its_own)
    there = fitted(one, rows, nothing(), effects, TOLERANCE)
    np.testing.assert_allclose((found.x - there.x)[list(found.columns)] / there.std, 0.0, atol=0.1)
    assert times <= 6
    assert 3 * times <= 2 * taken.times


@pytest.mark.parametrize("asked_after", [1, 99])
def test_what_is_hopeless_is_left_after_some_rounds_or_before_slopes_are_taken_again(
    monkeypatch: pytest.MonkeyPatch, asked_after: int
) -> None:
    one = drive({"steering_backlash.width_rad": 0.01, "road_bank.knot_3": 0.02}, CITY_V, CITY_STEER)
    rows, asked, taken = rows_of(one), list[tuple[Fit, int]](), Counted(monkeypatch)

    def fit_that(is_hopeless: bool) -> Fit:
        asked.clear()
        taken.times = 0

        def answer(so_far: Fit) -> bool:
            asked.append((so_far, taken.times))
            return is_hopeless

        return fitted(one, rows, nothing(), ("steering_backlash",), TOLERANCE, is_hopeless=answer)

    monkeypatch.setattr(descent, "_ASKED", asked_after)
    whole = fit_that(is_hopeless=False)
    rounds, times = [at for _, at in asked], taken.times
    left = fit_that(is_hopeless=True)
    # By the slopes that there were at first, and once: where it is left there are no further steps.
    [(there, at)] = asked
    assert at == rounds[0] == 1
    assert len(rounds) > 1
    assert taken.times == 2 < times
    np.testing.assert_array_equal(left.x, there.x)
    assert np.abs(left.x - whole.x).max() > (1e-4 if asked_after == 1 else 0.0)


def test_slopes_that_were_not_turned_are_not_taken_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit that began where it ends is exact; one that was judged by slopes of where it came from is not."""
    one = drive({"gyro_scale.z": 0.05}, CITY_V, CITY_STEER)
    rows, taken = rows_of(one), Counted(monkeypatch)
    found = fitted(one, rows, nothing(), ("gyro_scale",), TOLERANCE, settled=2e-5)
    times = taken.times
    assert found.is_exact
    assert exactly(one, rows, found, TOLERANCE) is found
    assert taken.times == times
    columns = found.columns
    slopes = sensitivities(one, rows, found.x, found.road, predicted(one, found.x, found.road), columns, found.felt)
    known = Slopes(found.x, found.effects, columns, slopes)
    moved = fitted(one, rows, found.x, found.effects, TOLERANCE, known=known)
    again = exactly(one, rows, moved._replace(is_exact=False), TOLERANCE)
    assert again is not moved
    np.testing.assert_allclose(again.std, found.std, rtol=1e-3)


class Falling:
    """A descent of which each step takes a fifth off what is left (100 rows of one channel), whatever the slopes."""

    def __init__(self) -> None:
        used = np.zeros((100, 13), dtype=np.bool_)
        used[:, 0] = True
        self.rows = Rows(np.arange(100), used, np.zeros(100, dtype=np.int64), np.zeros((100, 13)), np.zeros(13))
        self.sizes, self.losses, self.taken_at = np.ones(1), list[float](), list[int]()

    def learnt(self, _here: Place, known: np.ndarray | None = None) -> Learnt:
        if known is None:
            self.taken_at.append(len(self.losses))
        return Learnt(np.zeros((100, 13, 1)), np.zeros((0, 3)))

    def loss(self, here: Place, left: np.ndarray, _bent: np.ndarray) -> float:
        return descent.loss_of(left, self.rows, here.scatter)

    def step(self, here: Place, _learnt: Learnt) -> Step:
        left = 0.8 * here.left
        before, after = (self.loss(here, there, here.bent) for there in (here.left, left))
        self.losses.append(after)
        return Step(here._replace(left=left), np.zeros(1), here.left - left, before - after)


@pytest.mark.parametrize("roughly", [False, True])
def test_a_descent_ends_where_steps_take_next_to_nothing_and_slopes_are_taken_there(
    monkeypatch: pytest.MonkeyPatch, roughly: bool
) -> None:
    """From 450: each step takes 0.36 of what there is, which is less than 0.01 (450 0.64^k + 500) from the ninth on."""
    falling: Any = Falling()
    # The first is one as any other.
    monkeypatch.setattr(descent, "_first_step", Falling.step)
    left = np.zeros((100, 13))
    left[:, 0] = 3.0
    nowhere: Any = None
    here = Place(np.zeros(1), nowhere, nowhere, nowhere, left, np.ones((1, 13)), np.zeros(0))
    descent.descended(falling, here, np.zeros((100, 13, 1)), 0.01, roughly)
    assert len(falling.losses) == 10
    # Where slopes that are known will do, two quiet steps in a row are the end.
    assert falling.taken_at == ([] if roughly else [9])


@pytest.mark.parametrize(("known", "first"), [(True, [0]), (False, [])])
def test_a_known_start_has_one_first_step_and_one_that_is_not_known_has_none(
    monkeypatch: pytest.MonkeyPatch, known: bool, first: list[int]
) -> None:
    falling: Any = Falling()
    seen: list[int] = []

    def first_step(slope: Any, here: Place, slopes: Learnt) -> Step:
        seen.append(len(slope.losses))
        found: Step = slope.step(here, slopes)
        return found

    monkeypatch.setattr(descent, "_first_step", first_step)
    left = np.zeros((100, 13))
    left[:, 0] = 3.0
    nowhere: Any = None
    here = Place(np.zeros(1), nowhere, nowhere, nowhere, left, np.ones((1, 13)), np.zeros(0))
    descent.descended(falling, here, np.zeros((100, 13, 1)) if known else None, 0.01)
    assert seen == first


@pytest.mark.parametrize(("usual_left", "other_left", "chosen"), [(0.5, 0.1, "other"), (0.1, 0.5, "usual")])
def test_a_known_start_first_tries_what_would_put_all_blocks_right(
    usual_left: float, other_left: float, chosen: str
) -> None:
    """One of three blocks is off by ten times the others: it counts as they do, if what that leads to is likelier."""
    block = np.repeat(np.arange(3), 200)
    used = np.zeros((600, 13), dtype=np.bool_)
    used[:, :2] = True
    rows = Rows(np.arange(600), used, block, np.zeros((600, 13)), np.zeros(13))
    noise = RNG.normal(size=(600, 13))
    here = place_of(noise * np.where(block == 2, 10.0, 1.0)[:, np.newaxis])
    floor = np.full(13, np.nan)
    floor[1] = 20.0
    seen: list[np.ndarray] = []

    def step(there: Place, slopes: np.ndarray) -> Step:
        seen.append(there.scatter)
        left = noise * (usual_left if there is here else other_left)
        return Step(place_of(left), np.zeros(1), slopes, 1.0)

    slope: Any = SimpleNamespace(rows=rows, floor=floor, step=step)
    found = descent._first_step(slope, here, np.zeros(1))
    assert found is not None
    assert np.std(found.there.left) == pytest.approx(min(usual_left, other_left), rel=0.05), chosen
    usual, alike = seen
    assert usual is here.scatter
    # A third of 100 and two of 1; the other channel scatters by no less than its sensor.
    np.testing.assert_allclose(alike[:, 0], math.sqrt(34.0), rtol=0.1)
    np.testing.assert_array_equal(alike[:, 1], 20.0)


@pytest.mark.parametrize("dead", ["usual", "other"])
def test_where_one_first_step_only_goes_up_the_other_is_taken(dead: str) -> None:
    used = np.ones((30, 13), dtype=np.bool_)
    rows = Rows(np.arange(30), used, np.repeat([0, 1], 15), np.zeros((30, 13)), np.zeros(13))
    here = place_of(RNG.normal(size=(30, 13)), blocks=2)
    there = Step(here, np.ones(1), np.ones(1), 1.0)

    def step(place: Place, _: np.ndarray) -> Step | None:
        return None if (place is here) is (dead == "usual") else there

    slope: Any = SimpleNamespace(rows=rows, floor=np.ones(13), step=step)
    assert descent._first_step(slope, here, np.zeros(1)) is there


def place_of(left: np.ndarray, blocks: int = 3) -> Place:
    none: Any = None
    return Place(none, none, none, none, left, np.ones((blocks, 13)), np.zeros(0))


@pytest.mark.parametrize("hopeless", [True, False])
def test_where_no_step_gets_further_what_is_hopeless_takes_no_other_slopes(hopeless: bool) -> None:
    """One step down, then none by slopes that were turned: with others it may go on."""
    falling: Any = Falling()
    down, asked = falling.step, list[int]()

    def step(here: Place, learnt: Learnt) -> Step | None:
        return None if falling.losses and not learnt.is_exact else down(here, learnt)

    def is_hopeless(_here: Place, _slopes: np.ndarray) -> bool:
        asked.append(len(falling.losses))
        return hopeless

    falling.step = step
    here = place_of(np.full((100, 13), 3.0), blocks=1)
    descent.descended(falling, here, None, 1e-9, is_hopeless=is_hopeless)
    assert asked[0] == 1
    assert falling.taken_at[:2] == ([0] if hopeless else [0, 1])


@pytest.mark.filterwarnings("error")
def test_a_car_that_spins_away_is_shown_without_a_word() -> None:
    """Its motion is beyond all numbers; whoever compares looks at that."""
    own = as_effect("accel_y", "vx", np.zeros(N), "1", 1.0)
    one = drive({}, CITY_V, CITY_STEER)._replace(vocabulary=vocabulary((own,)))
    x = nothing(one.vocabulary)
    x[one.vocabulary.columns_of(own.name)[0]] = 1.0
    moving = driven(one, x, flat(N))
    spun = moving._replace(moved=np.full_like(moving.moved, 1e200))
    assert not np.isfinite(shown(one, x, spun)).all()


@pytest.mark.parametrize("with_moments", [True, False])
def test_a_stretch_whose_end_nothing_tells_holds_no_other_parameter_up(
    monkeypatch: pytest.MonkeyPatch, with_moments: bool
) -> None:
    """It ends on a straight: by its slope there it may end anywhere, before it begins, too."""
    steer = CITY_STEER * np.where((T > 44.0) & (T < 52.0), 1e-3, 1.0)
    ice = {"low_friction.inverse_square": 0.25**-2, "low_friction.start_s": 20.0, "low_friction.end_s": 48.0}
    one = drive(ice | {"sensor_bandwidth.time_constant_s": 0.05}, CITY_V, steer)
    rows, x = rows_of(one), nothing()
    for name, value in ice.items():
        x[INDEX[name]] = value
    end = INDEX["low_friction.end_s"]
    original = Slope._along

    def along(slope: Slope, here: Place, step: np.ndarray) -> Step | None:
        if end in slope.columns and step[slope.columns.index(end)] != 0.0:
            step = step.copy()
            step[slope.columns.index(end)] = -40.0
        return original(slope, here, step)

    monkeypatch.setattr(Slope, "_along", along)
    if not with_moments:
        monkeypatch.setattr(fit, "Slope", lambda *given: Slope(*given[:-1]))
    found = fitted(one, rows, x, ("low_friction", "sensor_bandwidth"), TOLERANCE)
    followed_s = found.x[INDEX["sensor_bandwidth.time_constant_s"]]
    assert bool(abs(followed_s - 0.05) < 3e-3) is with_moments
    assert found.x[end] == pytest.approx(48.0, abs=4.0)
