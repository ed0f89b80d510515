"""diagnose: a body's lean is told from the bank by how smooth a road it leaves, and followed as far as it helps."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting import descent
from dsz_daemon.diagnose.fitting.descent import Place, Slope
from dsz_daemon.diagnose.fitting.fit import _floors, exactly, fitted
from dsz_daemon.diagnose.fitting.gains import gained, is_beyond_form, quiet
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.residuals.comparison import floors, rows_of
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.surroundings import smooth_roads
from dsz_daemon.diagnose.surroundings.profiles import Felt
from dsz_daemon.diagnose.surroundings.smooth_roads import (
    bends,
    leaning,
    roughness,
    rows_as_one,
    slopes_of_bends,
    smoother,
    unevenness,
)

G = 9.80665
ROLL = INDEX["suspension_roll.roll_gradient_rad_per_mps2"]
BOTH = ("road_bank", "suspension_roll")
# Bends into which a car turns within half a second, and a road that banks as it likes.
TURNS = 0.02 * np.convolve(np.sign(np.sin(0.55 * T + np.sin(0.13 * T))), np.ones(50) / 50, "same")
BANK_RAD = 0.03 * np.sin(0.31 * T + 1.0) + 0.01 * np.sin(0.83 * T)


def banked(gradient: float, more: float = 0.0) -> Drive:
    """A car on springs, on that road; `more`: of v_y' + r v, what the accelerometer shows by no formula."""
    level = drive({}, CITY_V, TURNS)
    noise = level.measured - predicted(level, nothing(), flat(N))
    x, road = leant(gradient), flat(N)._replace(bank_rad=BANK_RAD)
    one = level._replace(measured=predicted(level, x, road) + noise)
    one.measured[:, 4] += more * driven(one, x, road).moved[:, motion.AY]
    return one


def leant(gradient: float) -> np.ndarray:
    x = nothing()
    x[ROLL] = gradient
    return x


@pytest.mark.parametrize(("gradient", "lean_share"), [(0.0, 0.0), (0.02, 0.0), (0.02, 0.25)])
def test_what_a_bank_bends_is_its_second_difference_on_the_body(gradient: float, lean_share: float) -> None:
    """Of A sin(w t) that is -2 (1 - cos(w 0.5 s)) A sin(w t); a body leans to g times the bank, too."""
    one, omega = drive({}, CITY_V, TURNS), 0.7
    road = flat(N)._replace(bank_rad=0.03 * np.sin(omega * T), lean_share=lean_share)
    bent = bends(one, road, leant(gradient))
    more = 1.0 + (1.0 - lean_share) * G * gradient
    expected = -2.0 * (1.0 - math.cos(omega * 0.5)) * 0.03 * np.sin(omega * T[52 : N - 50 : 4]) * more
    np.testing.assert_allclose(bent, expected, atol=1e-9)
    assert roughness(bent) == pytest.approx(float(np.sqrt(np.mean(expected**2))))


def test_corrections_bend_a_road_too_and_a_level_one_has_the_least_roughness_there_is() -> None:
    one, x = drive({}, CITY_V, TURNS), nothing()
    assert roughness(bends(one, flat(N), x)) == 1e-4
    x[INDEX["road_bank.knot_5"]] = 0.5
    assert roughness(bends(one, flat(N), x)) > 1e-3
    assert roughness(np.zeros(0)) == 1e-4


def test_normal_equations_are_those_of_what_a_fit_loses_by_bends() -> None:
    """Slope and curvature of the loss over the gradient, by finite differences of what it is defined by."""
    one, x = banked(0.012), leant(0.008)
    felt = Felt(one, x, BOTH)
    bent = bends(one, felt(x), x)
    found, usual = leaning(slopes_of_bends(one, felt, x, bent), bent), roughness(bent)
    names = [one.vocabulary.columns[i][1].name for i in found.columns]
    assert names == ["roll_gradient_rad_per_mps2", "frequency_share", "damping", "swings_m"]

    def lost(by: float) -> float:
        there = leant(0.008 + by)
        return unevenness(bends(one, felt(there), there), usual)

    step = 1e-4
    assert found.cross[0] == pytest.approx((lost(-step) - lost(step)) / (2.0 * step), rel=0.02)
    assert found.squares[0, 0] == pytest.approx((lost(step) + lost(-step) - 2.0 * lost(0.0)) / step**2, rel=0.05)
    np.testing.assert_allclose(found.squares, found.squares.T)
    # Too little of a lean: more of it leaves a smoother road.
    assert found.cross[0] > 0.0


def test_a_bank_that_bends_half_as_much_gains_by_independent_rows() -> None:
    rng = np.random.default_rng(3)
    white, held = 0.01 * rng.normal(size=2000), 0.01 * np.repeat(rng.normal(size=200), 10)
    assert rows_as_one(white) == pytest.approx(1.0, abs=0.3)
    assert 8.0 < rows_as_one(held) < 20.0
    for bent in (white, held):
        assert smoother(2.0 * bent, bent) == pytest.approx(2000 / rows_as_one(bent) * math.log(2.0))
        assert smoother(bent, 2.0 * bent) == pytest.approx(-2000 / rows_as_one(bent) * math.log(2.0))


def test_the_right_lean_is_found_beside_a_bank() -> None:
    one = banked(0.012)
    found = searched(one, rows_of(one), TOLERANCE)
    assert set(found.best.effects) == set(BOTH)
    assert found.best.x[ROLL] == pytest.approx(0.012, rel=0.04)


def test_what_else_seems_to_tell_a_lean_from_a_bank_is_less_sure(monkeypatch: pytest.MonkeyPatch) -> None:
    """An accelerometer that shows two hundredths more in bends is as a body that leans more to them."""
    one = banked(0.012, 0.02)
    rows = rows_of(one)
    beside = fitted(one, rows, nothing(), ("road_bank",), TOLERANCE)
    start = beside.x.copy()
    start[ROLL] = 0.008

    def off() -> float:
        fit = fitted(one, rows, start, BOTH, TOLERANCE, felt=beside.felt)
        return abs(float(fit.x[ROLL]) / 0.012 - 1.0)

    right = off()
    monkeypatch.setattr(smooth_roads, "SURER", 0.0)
    assert right < 0.04
    assert off() > 2.0 * right


def test_a_bank_without_a_lean_is_what_it_was() -> None:
    """A car that does not lean: of the bank nothing is taken for a lean."""
    one = banked(0.0)
    found = searched(one, rows_of(one), TOLERANCE)
    assert found.best.effects == ("road_bank",)


@pytest.fixture(scope="module")
def two_fits() -> tuple[Drive, Fit, Fit]:
    one = banked(0.012)
    rows = rows_of(one)
    smaller = fitted(one, rows, nothing(), ("road_bank",), TOLERANCE)
    start = smaller.x.copy()
    start[ROLL] = 0.008
    return one, smaller, fitted(one, rows, start, BOTH, TOLERANCE, felt=smaller.felt)


def test_a_lean_gains_what_the_bank_is_smoother_by(two_fits: tuple[Drive, Fit, Fit]) -> None:
    one, smaller, larger = two_fits
    by_rows = smoother(*(bends(one, fit.road, fit.x) for fit in (smaller, larger)))
    assert by_rows > 30.0
    # Beside it, and with it in both, there is nothing of the kind.
    alone = smaller._replace(effects=())
    others = larger._replace(effects=(*BOTH, "gyro_scale"))
    base = gained(one, smaller, larger)
    rougher = larger._replace(road=smaller.road, x=np.where(np.arange(len(larger.x)) == ROLL, 0.0, larger.x))
    assert base - gained(one, smaller, rougher) == pytest.approx(by_rows, abs=0.2 * by_rows)
    assert gained(one, larger, others) == pytest.approx(0.0, abs=1.0)
    assert smoother(*(bends(one, fit.road, fit.x) for fit in (alone, larger))) > 30.0
    assert not is_beyond_form(one, alone, larger._replace(unseen=alone.unseen))


def test_what_takes_the_bends_out_of_a_bank_needs_no_share_of_all_gains(two_fits: tuple[Drive, Fit, Fit]) -> None:
    one, smaller, larger = two_fits
    same = larger._replace(unseen=smaller.unseen)
    assert is_beyond_form(one, smaller, same)
    assert not is_beyond_form(one, smaller, same._replace(road=smaller.road, x=smaller.x))


def test_a_leans_spread_has_in_it_what_the_smooth_road_tells(
    two_fits: tuple[Drive, Fit, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, _, larger = two_fits
    rows, at = rows_of(one), larger.columns.index(ROLL)
    larger = larger._replace(is_exact=False)
    told = float(exactly(one, rows, larger, TOLERANCE).covariance[at, at])
    bent = bends(one, larger.road, larger.x)
    lean = leaning(slopes_of_bends(one, larger.felt, larger.x, bent), bent)
    # Honestly counted: rows that hang together count as one, however much more the fit listens to them.
    by_road = rows_as_one(bent) * smooth_roads.SURER / lean.squares[0, 0]
    assert told == pytest.approx(by_road, rel=0.6)
    for room in ("fit", "judgement"):
        monkeypatch.setattr(f"dsz_daemon.diagnose.fitting.{room}.leans_on_a_bank", lambda effects: False)
    # By the kernel's own formulas all else is to the last digit, and would tell more than it does of any car.
    assert float(exactly(one, rows, larger, TOLERANCE).covariance[at, at]) < 0.5 * told


class Swinging:
    """A felt road of which each round of leaning goes `by` of the way past where it should."""

    def __init__(self, off: float, by: float) -> None:
        self.off, self.by, self.asked = off, by, list[float]()

    def __call__(self, _: np.ndarray) -> Any:
        return self.off

    def leaning(self, _x: Any, _moving: Any, _base: Any, share: float) -> Swinging:
        self.asked.append(share)
        return Swinging(self.off - share * (1.0 + self.by) * self.off, self.by)


@pytest.mark.parametrize(
    ("by", "asked", "off"), [(0.5, [1.0], 0.5), (1.4, [1.0, 0.4], 0.04), (4.0, [1.0, 0.4, 0.16], 0.2)]
)
def test_a_body_leans_to_what_is_left_only_as_far_as_that_loses_nothing(
    monkeypatch: pytest.MonkeyPatch, by: float, asked: list[float], off: float
) -> None:
    """A round that goes further the other way is taken by smaller shares: 0.4 of 2.4 is 0.96 of the way."""
    monkeypatch.setattr(descent, "predicted", lambda drive, x, road: road)
    monkeypatch.setattr(descent, "residual", lambda rows, base: np.array([[base]]))
    monkeypatch.setattr(descent, "scatter_of", lambda rows, left, floor: np.ones((1, 1)))
    monkeypatch.setattr(descent, "loss_of", lambda left, rows, scatter: float(np.sum(left**2)))
    nowhere: Any = None
    slope = Slope(nowhere, nowhere, nowhere, (), np.zeros(0), nowhere, nowhere)
    felt: Any = Swinging(1.0, by)
    here = Place(np.zeros(1), felt, nowhere, nowhere, np.ones((1, 1)), np.ones((1, 1)), np.zeros(0))
    there = slope._leant(here, nowhere, here, 0.95)
    assert felt.asked == pytest.approx(asked)
    assert abs(float(there.left[0, 0])) == pytest.approx(off)
    # Where no share helps, the body leans as it did.
    assert slope._leant(here, nowhere, here, -1.0) is here


def test_half_a_round_of_leaning_is_half_the_way() -> None:
    one, x = banked(0.012), leant(0.012)
    felt = Felt(one, x, BOTH)
    road = felt(x)
    moving, base = driven(one, x, road), predicted(one, x, road)
    base[:, 4] += 1.0
    whole, half = (felt.leaning(x, moving, base, share)(x) for share in (1.0, 0.5))
    assert whole.lean_share > 0.5
    assert half.lean_share == pytest.approx(0.5 * whole.lean_share)
    for name in ("_left_mps2", "_tyres_mps2"):
        there, halfway = (getattr(felt.leaning(x, moving, base, share), name) for share in (1.0, 0.5))
        assert np.max(np.abs(there)) > 0.1
        np.testing.assert_allclose(halfway, 0.5 * there)


def test_slopes_of_no_lean_are_no_matter_of_the_road() -> None:
    """Only a model with both has rows of the road; any other is fitted as it was."""
    nowhere: Any = SimpleNamespace()
    slope = Slope(nowhere, nowhere, nowhere, (), np.zeros(0), nowhere, nowhere)
    assert not slope.leans
    assert smooth_roads.leans_on_a_bank(BOTH)
    assert not smooth_roads.leans_on_a_bank(("road_bank", "suspension_pitch"))
    assert not smooth_roads.leans_on_a_bank(("suspension_roll",))
    assert smooth_roads.is_new_on_a_bank(("road_bank",), BOTH)
    assert not smooth_roads.is_new_on_a_bank(("suspension_roll",), BOTH)
    assert not smooth_roads.is_new_on_a_bank(BOTH, BOTH)


def test_form_is_the_floor_where_a_lean_is_told_from_a_bank(two_fits: tuple[Drive, Fit, Fit]) -> None:
    one, smaller, larger = two_fits
    rows = rows_of(one)
    for fit in (smaller, larger):
        found = _floors(one, rows, fit.x, fit.effects, fit.felt)
        form = fit.form if fit is larger else np.zeros(13)
        np.testing.assert_allclose(found[:6], np.hypot(floors(one), form)[:6], rtol=0.05)
    assert larger.form[4] > 2.0 * floors(one)[4]
    # No block is listened to more than that.
    assert np.min(larger.scatter[:, 4]) > 0.95 * larger.form[4]
    assert np.min(smaller.scatter[:, 4]) < 0.95 * larger.form[4]


def test_the_gyro_that_a_bank_is_taken_from_judges_no_lean_beside_it(two_fits: tuple[Drive, Fit, Fit]) -> None:
    """A bank takes the lean along to the gyro's last digit; no simulation of a lean does."""
    one, smaller, larger = two_fits
    unseen = smaller.unseen.copy()
    unseen[:, 0] *= 0.01
    sharp, better = larger._replace(form=np.zeros(13)), smaller._replace(unseen=unseen, form=np.zeros(13))
    assert quiet(one, better)[0]
    assert gained(one, better, sharp) > 50.0
    # Of any other channel it counts.
    unseen = smaller.unseen.copy()
    unseen[:, 4] *= 0.25
    assert gained(one, smaller._replace(unseen=unseen), larger) < gained(one, smaller, larger) - 30.0


def test_what_a_lean_beside_a_bank_is_off_by_is_judged_by_its_own_form(two_fits: tuple[Drive, Fit, Fit]) -> None:
    one, smaller, larger = two_fits
    unseen = smaller.unseen.copy()
    unseen[:, 4] *= 0.25
    better, coarse = smaller._replace(unseen=unseen), larger.form.copy()
    coarse[4] = 1.0
    whole = larger._replace(form=coarse)
    assert gained(one, better, whole) == pytest.approx(gained(one, smaller, whole), abs=1.0)
    # Where the lean is not what is new, the smaller model's counts.
    both = better._replace(effects=BOTH, columns=larger.columns)
    assert gained(one, both, whole) == pytest.approx(gained(one, both, larger))


def test_a_fit_counts_the_bends_and_follows_a_lean_only_as_far_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    one = banked(0.012)
    rows, asked = rows_of(one), list[tuple[float, float]]()
    real = Slope._leant

    def leant_to(self: Slope, here: Place, moving: Any, before: Place, most: float) -> Place:
        asked.append((most, self.loss(before, before.left, before.bent)))
        return real(self, here, moving, before, most)

    monkeypatch.setattr(Slope, "_leant", leant_to)
    beside = fitted(one, rows, nothing(), ("road_bank",), TOLERANCE)
    start = beside.x.copy()
    start[ROLL] = 0.008
    asked.clear()
    fitted(one, rows, start, BOTH, TOLERANCE, felt=beside.felt)
    (first, _), *others = asked
    # At first it leans as it will; at a step no further than to what there was before it.
    assert first == math.inf
    assert len(others) > 1
    assert all(most == there for most, there in others)


def test_what_a_fit_loses_has_the_bends_in_it() -> None:
    """Of a bank that bends as much as it does: a half for each row, ten times."""
    nowhere: Any = None
    used = np.ones((4, 13), dtype=np.bool_)
    rows: Any = SimpleNamespace(used=used, block=np.zeros(4, dtype=np.int64))
    slope = Slope(nowhere, rows, nowhere, (), np.zeros(0), nowhere, nowhere, leans=True)
    left, bent = np.zeros((4, 13)), 0.01 * np.array([1.0, -1.0, 1.0, -1.0, 1.0])
    here = Place(nowhere, nowhere, nowhere, nowhere, left, np.ones((1, 13)), bent)
    assert slope.loss(here, left, bent) == pytest.approx(0.5 * 5 * smooth_roads.SURER)
    assert slope.loss(here, left, 2.0 * bent) == pytest.approx(4.0 * 0.5 * 5 * smooth_roads.SURER)
    assert slope.loss(here, left + 1.0, 0.0 * bent) == pytest.approx(0.5 * 4 * 13)


def test_whole_manoeuvres_know_of_the_smooth_road_too(two_fits: tuple[Drive, Fit, Fit]) -> None:
    one, smaller, larger = two_fits
    same = larger._replace(together=smaller.together)
    by_rows = smoother(*(bends(one, fit.road, fit.x) for fit in (smaller, larger)))
    for kind in rows_of(one).together:
        assert gained(one, smaller, same, kind=kind) == pytest.approx(by_rows, abs=15.0)


def test_city_bends_are_told_from_a_bank_too() -> None:
    level = drive({}, CITY_V, CITY_STEER)
    noise = level.measured - predicted(level, nothing(), flat(N))
    road = flat(N)._replace(bank_rad=BANK_RAD)
    one = level._replace(measured=predicted(level, leant(0.012), road) + noise)
    found = searched(one, rows_of(one), TOLERANCE)
    assert set(found.best.effects) == set(BOTH)
    assert found.best.x[ROLL] == pytest.approx(0.012, rel=0.05)


def test_what_is_learnt_of_a_lean_beside_a_bank_is_how_it_bends(two_fits: tuple[Drive, Fit, Fit]) -> None:
    one, _, larger = two_fits
    nowhere: Any = None
    bent = bends(one, larger.road, larger.x)
    here = Place(larger.x, larger.felt, larger.road, nowhere, larger.left, larger.scatter, bent)
    none = np.zeros((len(larger.left), 13, 1))
    slope = Slope(one, nowhere, nowhere, (), np.zeros(1), lambda _: none, nowhere, leans=True)
    found = slope.learnt(here)
    np.testing.assert_array_equal(found.bends, slopes_of_bends(one, larger.felt, larger.x, bent))
    assert np.abs(found.bends).max() > 0.0
    assert found.slopes is none
    assert found.is_exact
    known = none + 1.0
    assert slope.learnt(here, known).slopes is known
    assert slope._replace(leans=False).learnt(here).bends.shape == (0, 4)
