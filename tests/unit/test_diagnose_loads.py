"""diagnose: a load turns with the car, as far out as it has to stand; of two that turn a car alike that tells it."""

from __future__ import annotations

import numpy as np
import pytest
from core_cases import TUCSON
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained
from dsz_daemon.diagnose.fitting.model import Fit, values_of
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.plausible import is_told
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.selection.starts import starts_of
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.car import car_of
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.loads import between_ends, inertia_of_a_load_kgm2
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat

ADDED, SHIFT, TURNS = (INDEX[f"mass_loading.{name}"] for name in ("added_mass_kg", "cg_shift_m", "turns"))
MASS_KG, ADDED_KG = TUCSON.mass_kg, 300.0


def two_masses_kgm2(other_kg: float, apart_m: float) -> tuple[float, float]:
    """What two point masses so far apart have of yaw inertia about their common centre, and how far that moves."""
    centre_m = apart_m * other_kg / (MASS_KG + other_kg)
    return MASS_KG * centre_m**2 + other_kg * (apart_m - centre_m) ** 2, centre_m


@pytest.mark.parametrize("apart_m", [0.85, -1.2, 1.25])
def test_a_load_turns_as_two_masses_do(apart_m: float) -> None:
    inertia_kgm2, moved_m = two_masses_kgm2(ADDED_KG, apart_m)
    assert inertia_of_a_load_kgm2(TUCSON, ADDED_KG, moved_m) == pytest.approx(inertia_kgm2)


def test_what_is_taken_off_no_longer_turns() -> None:
    """200 kg of the car, 1 m behind the C.G. of the whole: the rest is another car, by parallel axes."""
    gone_kg, behind_m = 200.0, 1.0
    ahead_m = gone_kg * behind_m / (MASS_KG - gone_kg)
    less_kgm2 = -(gone_kg * behind_m**2 + (MASS_KG - gone_kg) * ahead_m**2)
    assert inertia_of_a_load_kgm2(TUCSON, -gone_kg, ahead_m) == pytest.approx(less_kgm2)


def test_a_load_stands_off_the_cg_but_between_the_axles() -> None:
    least, most = (two_masses_kgm2(ADDED_KG, out_m)[0] for out_m in (0.8, 0.5 * TUCSON.wheelbase_m))
    assert inertia_of_a_load_kgm2(TUCSON, ADDED_KG, 0.0) == pytest.approx(least)
    assert inertia_of_a_load_kgm2(TUCSON, ADDED_KG, -0.7) == pytest.approx(most)
    assert inertia_of_a_load_kgm2(TUCSON, 0.0, 0.3) == 0.0


def test_of_a_car_that_weighs_no_more_than_what_is_taken_off_nothing_turns() -> None:
    """A quad of 400 kg, at the end of what a load may be: no fault of whoever drives it."""
    assert inertia_of_a_load_kgm2(TUCSON._replace(mass_kg=400.0), -400.0, 0.1) == 0.0
    assert inertia_of_a_load_kgm2(TUCSON._replace(mass_kg=390.0), -400.0, 0.1) == 0.0


@pytest.mark.parametrize("turns", [0.0, 0.5, 1.0])
def test_the_simulations_car_is_as_slow_to_turn_as_car_and_load(turns: float) -> None:
    one, x = drive({}, CITY_V, CITY_STEER), nothing()
    inertia_kgm2, moved_m = two_masses_kgm2(ADDED_KG, -1.2)
    x[[ADDED, SHIFT, TURNS]] = ADDED_KG, moved_m, turns
    found = car_of(one, x)
    assert found.yaw_inertia_kgm2 == pytest.approx(TUCSON.yaw_inertia_kgm2 + turns * inertia_kgm2)
    assert found.mass_kg == pytest.approx(MASS_KG + ADDED_KG)


def loaded() -> Drive:
    """300 kg that stand 1.2 m behind the C.G., and turn with the car."""
    inertia_kgm2, moved_m = two_masses_kgm2(ADDED_KG, -1.2)
    numbers = {"mass_loading.added_mass_kg": ADDED_KG, "mass_loading.cg_shift_m": moved_m}
    return drive({**numbers, "yaw_inertia_kgm2": inertia_kgm2 / TUCSON.yaw_inertia_kgm2}, CITY_V, CITY_STEER)


def fit_of(one: Drive, effect: str, turns: float = 0.0) -> Fit:
    start = nothing()
    start[[ADDED, TURNS]] = (100.0, turns) if turns else (0.0, 0.0)
    return fitted(one, rows_of(one), start, (effect,), TOLERANCE, 1e-6)


def test_a_load_that_turns_is_no_soft_tyre() -> None:
    one = loaded()
    plain = fitted(one, rows_of(one), nothing(), (), TOLERANCE)
    load, tyres = fit_of(one, "mass_loading", 1.0), fit_of(one, "cornering_stiffness")
    assert gained(one, plain, load) > gained(one, plain, tyres) + 20.0
    for column, truth in ((ADDED, ADDED_KG), (SHIFT, two_masses_kgm2(ADDED_KG, -1.2)[1]), (TURNS, 1.0)):
        assert load.x[column] == pytest.approx(truth, abs=2.5 * load.std[load.columns.index(column)])


def test_a_load_begins_with_nothing_and_with_one_that_turns() -> None:
    """By one linear step a load of nothing turns nothing."""
    one = loaded()
    rows = rows_of(one)
    best = fitted(one, rows, nothing(), (), TOLERANCE)
    starts = [x for new, x in starts_of(one, rows, best, ["mass_loading"]) if new == ("mass_loading",)]
    assert [(x[ADDED], x[TURNS]) for x in starts] == [(0.0, 0.0), (0.05 * MASS_KG, 1.0)]
    assert "mass_loading" in screened(one, rows, best, TOLERANCE, map).names
    assert not any(new == ("mass_loading",) for new, _ in starts_of(one, rows, best, ["gyro_scale"]))


def test_how_a_load_turns_is_no_surer_than_a_drive_tells_it() -> None:
    """Straight ahead nothing tells it: it stays as open as its ends, by more than half of their distance."""
    one = drive({"mass_loading.added_mass_kg": ADDED_KG}, CITY_V, np.zeros(len(CITY_V)))
    fit = fit_of(one, "mass_loading", 1.0)
    assert 0.6 < fit.std[fit.columns.index(TURNS)] < 1.0


@pytest.mark.parametrize(
    ("added_kg", "shift_m", "alike", "expected"),
    [
        # Each by itself could be nothing, together (as they are told along one line) they are far off it.
        (150.0, 0.15, -0.99, True),
        (150.0, 0.15, 0.99, False),
        # Or are too little to have a name.
        (20.0, 0.02, -0.999, False),
        # One of them surely is something.
        (150.0, 0.5, 0.0, True),
    ],
)
def test_a_load_is_told_if_how_much_and_where_are_surely_something_together(
    added_kg: float, shift_m: float, alike: float, expected: bool
) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    rows, x = rows_of(one), nothing()
    fit = fitted(one, rows, x, ("mass_loading",), TOLERANCE)
    fit.x[ADDED], fit.x[SHIFT] = added_kg, shift_m
    places = [fit.columns.index(i) for i in (ADDED, SHIFT)]
    spread = np.array([100.0, 0.1])
    fit.std[places] = spread
    fit.covariance[np.ix_(places, places)] = np.outer(spread, spread) * np.array([[1.0, alike], [alike, 1.0]])
    assert is_told(one, fit, "mass_loading") is expected


def test_the_imu_stays_where_it_was_when_a_load_moves_the_cg() -> None:
    """The C.G. 0.3 m further ahead has the IMU 0.3 m behind it: a + r' x rho - r^2 rho."""
    one, x = drive({}, CITY_V, CITY_STEER), nothing()
    x[ADDED], x[SHIFT] = 300.0, 0.3
    moving = driven(one, x, flat(len(CITY_V)))
    r = moving.moved[:, motion.R]
    shown, inside = predicted(one, x, flat(len(CITY_V)))[:, 4], slice(200, -200)
    at_the_cg = moving.moved[:, motion.AY]
    np.testing.assert_allclose(shown[inside], (at_the_cg - 0.3 * np.gradient(r, DT_S))[inside], atol=2e-3)
    assert float(np.max(np.abs(0.3 * np.gradient(r, DT_S))[inside])) > 0.05


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_what_lies_between_two_ends_is_as_sure_as_that(seed: int) -> None:
    """As information that is added up: a precision matrix with one over the variance of what is even between ends."""
    rng = np.random.default_rng(seed)
    root, x = rng.standard_normal((4, 4)), rng.standard_normal(4)
    covariance = root @ root.T + 0.1 * np.eye(4)
    ends = {1: (-0.3, 0.3), 3: (0.0, 1.3)}
    prior, middle = np.zeros(4), np.zeros(4)
    for place, (low, high) in ends.items():
        prior[place], middle[place] = 12.0 / (high - low) ** 2, 0.5 * (low + high)
    information = np.linalg.inv(covariance)
    whole = np.linalg.inv(information + np.diag(prior))
    values, spreads = between_ends(x, covariance, ends)
    assert values == pytest.approx(whole @ (information @ x + prior * middle))
    assert spreads == pytest.approx(np.sqrt(np.diag(whole)))
    # Nothing is known besides: all is as it was.
    values, spreads = between_ends(x, covariance, {})
    assert (values, spreads) == (pytest.approx(x), pytest.approx(np.sqrt(np.diag(covariance))))


def test_how_much_is_on_board_is_told_by_what_tyres_may_be() -> None:
    """Without a turn of its own a load is what tyres within their tolerance are: between both the middle is told."""
    moved_m = two_masses_kgm2(ADDED_KG, -1.2)[1]
    one = drive({"mass_loading.added_mass_kg": ADDED_KG, "mass_loading.cg_shift_m": moved_m}, CITY_V, CITY_STEER)
    fit = fit_of(one, "mass_loading")
    told = values_of(one, fit, "mass_loading")
    for name, column, truth in (("added_mass_kg", ADDED, ADDED_KG), ("cg_shift_m", SHIFT, moved_m)):
        value, std = told[name]
        assert std < fit.std[fit.columns.index(column)]
        assert value == pytest.approx(truth, abs=1.96 * std)
    # All at once: the two stiffnesses within a tenth, and none to all and a third of what turns with the load.
    names = [one.vocabulary.columns[i][1].name for i in fit.columns]
    ends = {"turns": (0.0, 1.3)} | {f"{axle}_cornering_stiffness_n_per_rad": (-0.1, 0.1) for axle in ("front", "rear")}
    places = [names.index(name) for name in ends]
    middle, wide = np.array([(0.5 * (a + b), b - a) for a, b in ends.values()]).T
    across = fit.covariance[:, places]
    gain = across @ np.linalg.inv(across[places] + np.diag(wide**2 / 12.0))
    values = fit.x[list(fit.columns)] + gain @ (middle - fit.x[[fit.columns[place] for place in places]])
    for name, column in (("added_mass_kg", ADDED), ("cg_shift_m", SHIFT)):
        place = fit.columns.index(column)
        variance = fit.covariance[place, place] - gain[place] @ across[place]
        assert told[name][0] == pytest.approx(values[place])
        assert told[name][1] == pytest.approx(np.hypot(np.sqrt(variance), 0.02 * values[place]), rel=0.02)
    # Other effects are told with the values that they are fitted with.
    fit = fit_of(one, "cornering_stiffness")
    assert fit.told is not None
    np.testing.assert_array_equal(fit.told[0], fit.x[list(fit.columns)])
