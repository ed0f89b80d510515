"""diagnose: where a wind pushes, on which road it is felt, and what it is for other tyres."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.signal import lfilter, lsim
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import told_from
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel, filtered
from dsz_daemon.diagnose.residuals.comparison import rows_of, sensitivities
from dsz_daemon.diagnose.selection import search as search_module
from dsz_daemon.diagnose.selection import together
from dsz_daemon.diagnose.selection.screening import Screening, screened
from dsz_daemon.diagnose.selection.search import _with_wind_anew, searched
from dsz_daemon.diagnose.selection.smaller import worth_now
from dsz_daemon.diagnose.selection.starts import Start, beside_a_wind, starts_of
from dsz_daemon.diagnose.selection.together import two_at_once
from dsz_daemon.diagnose.selection.trials import Step, Trial, enough_first
from dsz_daemon.diagnose.simulation.car import car_of
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.pulls import PULLS
from dsz_daemon.diagnose.simulation.road import Profiles, flat, on_road
from dsz_daemon.diagnose.surroundings import winds
from dsz_daemon.diagnose.surroundings.profiles import Felt, wind_ahead_m
from dsz_daemon.diagnose.verdict import told_roads

MIDDLE = slice(500, N - 500)
AHEAD = INDEX["side_wind.ahead_m"]
GUSTS_N = 400.0 * (np.sin(2.0 * np.pi * T / 4.0) + np.sin(2.0 * np.pi * T / 2.3))


def blown_on(ahead_m: float, road: Profiles | None = None) -> tuple[Drive, np.ndarray]:
    """A drive in a wind that pushes so far ahead of the C.G., and the parameters of that."""
    one = drive({}, CITY_V, CITY_STEER)
    noise = one.measured - predicted(one, nothing(), flat(N))
    x = nothing()
    x[AHEAD] = ahead_m
    return one._replace(measured=predicted(one, x, (road or flat(N))._replace(side_n=GUSTS_N)) + noise), x


@pytest.mark.parametrize("ahead_m", [0.05, 0.1, 0.15, 0.3, 0.4, 0.6, 0.8])
def test_the_yaw_rate_tells_where_a_wind_pushes(ahead_m: float) -> None:
    one, x = blown_on(ahead_m)
    calm = Felt(one, nothing(), ())
    # A tenth of a metre nearer to where a push turns no car it would be a fifth stronger.
    assert wind_ahead_m(one, nothing(), calm, ("side_wind",)) == pytest.approx(ahead_m, abs=0.02)
    # Pushed elsewhere, it would be another wind.
    right, wrong = (calm.blown(there, ("side_wind",))(there).side_n for there in (x, nothing()))
    assert np.std((right - GUSTS_N)[MIDDLE]) < 0.1 * np.std(GUSTS_N)
    if ahead_m > 0.2:
        assert np.std((wrong - GUSTS_N)[MIDDLE]) > 0.15 * np.std(GUSTS_N)


@pytest.mark.filterwarnings("error")
def test_without_a_yaw_rate_nobody_knows_where_a_wind_pushes() -> None:
    one, _ = blown_on(0.4)
    one.measured[:, 2] = np.nan
    assert wind_ahead_m(one, nothing(), Felt(one, nothing(), ()), ("side_wind",)) == 0.0


@pytest.mark.filterwarnings("error")
def test_where_a_car_spins_no_wind_has_pushed(monkeypatch: pytest.MonkeyPatch) -> None:
    one, _ = blown_on(0.4)
    calm = Felt(one, nothing(), ())
    monkeypatch.setattr("dsz_daemon.diagnose.surroundings.profiles.predicted", lambda *_: np.full((N, 13), np.inf))
    assert wind_ahead_m(one, nothing(), calm, ("side_wind",)) == 0.0


@pytest.mark.filterwarnings("error")
def test_a_push_that_spins_a_car_is_none_and_warns_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left of a car that goes anywhere has no square; no wind is felt by that."""
    one, x = blown_on(0.4)
    monkeypatch.setattr(winds, "predicted", lambda *_: np.full((N, 13), 1e200))
    assert not winds.with_wind(one, x, flat(N)).side_n.any()


def test_a_wind_is_tried_from_where_the_yaw_rate_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    one, _ = blown_on(0.4)
    rows = rows_of(one)
    plain = fitted(one, rows, nothing(), (), TOLERANCE)
    monkeypatch.setattr("dsz_daemon.diagnose.selection.starts.feels", lambda *arguments: arguments[-1] == "side_wind")
    starts = [x for names, x in starts_of(one, rows, plain, []) if names == ("side_wind",)]
    assert [x[AHEAD] for x in starts] == [pytest.approx(0.4, abs=0.1)]
    # And a fit begins there.
    fit = fitted(one, rows, starts[0], ("side_wind",), TOLERANCE, felt=plain.felt)
    assert fit.x[AHEAD] == pytest.approx(0.4, abs=0.1)


def test_a_wind_is_felt_by_a_car_that_goes_straight_ahead_as_it_is_driven(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else what a wind happened to do while a car was driven, or braked, would stay the car's, and told of it."""
    one, _ = blown_on(0.4)
    # It blows to one side where the car goes faster, and to the other where it goes more slowly.
    v_rate = np.gradient(CITY_V, DT_S)
    x = nothing()
    x[AHEAD] = 0.4
    noise = one.measured - predicted(one, nothing(), flat(N))
    blowing = flat(N)._replace(side_n=GUSTS_N + 200.0 * v_rate)
    one = one._replace(measured=predicted(one, x, blowing) + noise)
    rows = rows_of(one)
    plain = fitted(one, rows, nothing(), (), TOLERANCE)
    assert np.max(np.abs(plain.x[list(PULLS)])) > 5e-4
    monkeypatch.setattr("dsz_daemon.diagnose.selection.starts.feels", lambda *arguments: arguments[-1] == "side_wind")
    start = next(x for names, x in starts_of(one, rows, plain, []) if names == ("side_wind",))
    fit = fitted(one, rows, start, ("side_wind",), TOLERANCE, felt=plain.felt)
    assert np.max(np.abs(fit.x[list(PULLS)])) < 1.5e-4


def test_a_wind_is_felt_on_the_road_as_it_has_been_corrected() -> None:
    bank = 0.03 * np.sin(2.0 * np.pi * T / 20.0)
    one, x = blown_on(0.3, flat(N)._replace(bank_rad=bank))
    # An offset that the road was felt with, and knots that take its drift away again.
    off = nothing()
    off[INDEX["offset_gyro_x"]] = 2e-3
    felt = Felt(one, off, ("road_bank",))
    knots = slice(INDEX["road_bank.knot_0"], INDEX["road_bank.knot_0"] + 12)
    x[knots] = np.linspace(0.0, 2e-3 * T[-1], 12)
    with_wind = felt.blown(x, ("road_bank", "side_wind"))
    assert np.std((with_wind(x).side_n - GUSTS_N)[MIDDLE]) < 0.2 * np.std(GUSTS_N)
    np.testing.assert_array_equal(with_wind(x).bank_rad, felt(x).bank_rad)
    assert with_wind.profiles == {"road_bank", "side_wind"}
    # The corrections are kept where a wind is all that is new, and are not where the road is.
    rows = rows_of(one)
    start = x.copy()
    plain = fitted(one, rows, start, ("road_bank", "side_wind"), {}, felt=felt)
    assert plain.x[knots][-1] == pytest.approx(2e-3 * T[-1], rel=0.1)


def test_other_tyres_have_another_wind_where_it_is_felt_anew() -> None:
    one, x = blown_on(0.3)
    held = Felt(one, x, ("side_wind",))
    assert Felt(one, nothing(), ("road_bank",)).anew() is None
    felt = held.anew()
    assert felt is not None
    assert felt.anew() is None
    late = x.copy()
    late[INDEX["steering_delay.delay_s"]] = 0.05

    def left(road: Profiles) -> float:
        return float(np.std((one.measured - predicted(one, late, road))[MIDDLE, 4]))

    assert left(felt(late)) < 0.5 * left(held(late))
    assert felt.changes_with("steering_delay")
    assert not held.changes_with("steering_delay")
    # And so a fit's slopes have it.
    rows, column = rows_of(one), [INDEX["steering_delay.delay_s"]]
    slopes = [
        sensitivities(one, rows, x, one_felt(x), predicted(one, x, one_felt(x)), column, one_felt)[:, 4, 0]
        for one_felt in (held, felt)
    ]
    assert np.std(slopes[1]) < 0.7 * np.std(slopes[0])


def test_a_wind_is_felt_anew_only_where_the_yaw_rate_is_off(monkeypatch: pytest.MonkeyPatch) -> None:
    one, x = blown_on(0.3)
    rows = rows_of(one)
    best = fitted(one, rows, x, ("side_wind",), TOLERANCE)
    known: Any = None
    trial = Trial(one, rows, best, TOLERANCE, known)
    monkeypatch.setattr(search_module, "quiet", lambda *_: np.ones(13, dtype=bool))
    assert _with_wind_anew(trial, map) is None
    monkeypatch.setattr(search_module, "quiet", lambda *_: np.arange(13) != 2)
    anew = _with_wind_anew(trial, map)
    assert anew is not None
    assert anew.felt.is_anew
    assert anew.effects == ("side_wind",)
    # One that is none by then is not taken.
    monkeypatch.setattr(search_module, "is_implausible", lambda *given: given[2:] == (given[2], "side_wind"))
    assert _with_wind_anew(trial, map) is None


def test_a_wind_that_is_felt_anew_has_gained_what_it_gains_then() -> None:
    """It came with other tyres, by which the yaw rate was off, and gained little."""
    one, x = blown_on(0.3)
    rows = rows_of(one)
    held = fitted(one, rows, x, ("side_wind",), TOLERANCE)
    felt = held.felt.anew()
    assert felt is not None
    anew = fitted(one, rows, held.x, ("side_wind",), TOLERANCE, felt=felt)
    asked = told_from(one, anew, "side_wind")
    now = worth_now(one, rows, anew, TOLERANCE, {"side_wind": 0.9 * asked}, (), map)
    assert now["side_wind"] > 10.0 * asked
    # It was enough before, or no other tyres have made it another one.
    assert worth_now(one, rows, anew, TOLERANCE, {"side_wind": 1.1 * asked}, (), map) == {"side_wind": 1.1 * asked}
    assert worth_now(one, rows, held, TOLERANCE, {"side_wind": 0.9 * asked}, (), map) == {"side_wind": 0.9 * asked}


def test_beside_a_wind_that_is_felt_anew_what_a_car_does_has_to_gain_a_good_part_of_it() -> None:
    one, x = blown_on(0.3)
    best = fitted(one, rows_of(one), x, ("side_wind",), {})
    steps = [Step(effect, 50.0, best) for effect in ("steering_offset", "gyro_scale")]

    def asked(_: str) -> float:
        return 10.0

    assert enough_first(one, best, steps, asked) == steps
    assert enough_first(one, best, steps, asked, 60.0)[0].effect == "gyro_scale"
    assert enough_first(one, best, steps[:1], asked, 60.0) == []
    assert enough_first(one, best, steps[:1], asked, 40.0) == steps[:1]


def test_a_wind_by_the_lean_is_not_felt_anew() -> None:
    one, x = blown_on(0.3)
    x[INDEX["suspension_roll.roll_gradient_rad_per_mps2"]], x[INDEX["side_wind.leans"]] = 0.015, 1.0
    assert Felt(one, x, ("suspension_roll", "side_wind")).anew() is None


@pytest.mark.parametrize(("leans", "share"), [(1.0, 0.0), (0.0, 0.6)])
def test_a_wind_by_the_lean_is_all_that_leans_the_body(leans: float, share: float) -> None:
    one, x = blown_on(0.3)
    x[INDEX["suspension_roll.roll_gradient_rad_per_mps2"]], x[INDEX["side_wind.leans"]] = 0.015, leans
    felt = Felt(one, x, ("suspension_roll",))
    felt._lean_share = 0.6
    assert felt.blown(x, ("suspension_roll", "side_wind"))(x).lean_share == share


def test_where_a_wind_pushes_is_kept_where_the_road_is_felt_afresh() -> None:
    one, x = blown_on(0.4)
    leans = INDEX["side_wind.leans"]
    x[leans] = 0.7
    fit = fitted(one, rows_of(one), x, ("side_wind", "road_bank"), {}, felt=Felt(one, x, ("side_wind",)))
    assert fit.x[AHEAD] == pytest.approx(0.4, abs=0.1)
    assert fit.x[leans] == pytest.approx(0.7)


def test_an_offset_and_a_leak_of_gravity_are_the_same_beside_a_wind_that_is_felt_anew() -> None:
    one, x = blown_on(0.3)
    felt = Felt(one, x, ("side_wind",)).anew()
    assert felt is not None
    columns = [INDEX["offset_accel_y"], INDEX["accel_cross_axis.yz"]]
    slopes = sensitivities(one, rows_of(one), x, felt(x), predicted(one, x, felt(x)), columns, felt)
    np.testing.assert_allclose(slopes[:, 2, 1], 9.80665 * slopes[:, 2, 0], rtol=0.05, atol=1e-3)
    assert np.std(slopes[:, 2, 0]) > 1e-3


def test_a_wind_is_named_beside_a_body_that_leans_to_all_of_its_acceleration() -> None:
    """As many are drawn; a push at the C.G.'s height leans it to what its tyres hold alone."""
    soft = INDEX["suspension_roll.roll_gradient_rad_per_mps2"]
    one = drive({"suspension_roll.roll_gradient_rad_per_mps2": 0.0107}, CITY_V, CITY_STEER)
    calm, x = nothing(), nothing()
    calm[soft] = x[soft] = 0.0107
    x[AHEAD] = 0.3
    one.measured[:] += predicted(one, x, flat(N)._replace(side_n=GUSTS_N)) - predicted(one, calm, flat(N))
    search = searched(one, rows_of(one), TOLERANCE)
    assert search.best.effects == ("suspension_roll", "side_wind")
    assert np.corrcoef(search.best.road.side_n[MIDDLE], GUSTS_N[MIDDLE])[0, 1] > 0.9


@pytest.mark.parametrize(("ahead_m", "v_mps"), [(0.3, 12.0), (0.3, 35.0), (0.0, 20.0)])
def test_a_push_is_what_moves_a_linear_car_so(ahead_m: float, v_mps: float) -> None:
    """Against the state space of (1) with a side force, solved by scipy."""
    car = car_of(drive({}, CITY_V, CITY_STEER), nothing())._replace(wind_ahead_m=ahead_m)
    lf, lr, cf, cr = car.cg_to_front_axle_m, car.cg_to_rear_axle_m, car.front_stiffness, car.rear_stiffness
    forces = -np.array([[cf, cf * lf], [cr, -cr * lr]]) / v_mps
    a = np.array([forces.sum(axis=0) / car.mass_kg, (lf * forces[0] - lr * forces[1]) / car.yaw_inertia_kgm2])
    a[0, 1] -= v_mps
    b = np.array([[1.0 / car.mass_kg], [ahead_m / car.yaw_inertia_kgm2]])
    across = np.array([[forces[:, 0].sum() / car.mass_kg, forces[:, 1].sum() / car.mass_kg]])
    _, mps2, _ = lsim((a, b, across, np.array([[1.0 / car.mass_kg]])), GUSTS_N, T)
    push = winds._push_n(car, np.asarray(mps2), np.full(N, v_mps), DT_S)
    # What is held for a step is half a step late.
    assert np.std(push - GUSTS_N) < 0.05 * np.std(GUSTS_N)
    # A car that stands is held by its tyres; what a sensor shows there is what would have to push it.
    np.testing.assert_allclose(winds._push_n(car, np.ones(3), np.zeros(3), DT_S), car.mass_kg)


def test_where_a_push_turns_no_car_it_is_taken_to_stand_a_little_ahead() -> None:
    car = car_of(drive({}, CITY_V, CITY_STEER), nothing())
    cf, cr = car.front_stiffness, car.rear_stiffness
    neutral_m = (cf * car.cg_to_front_axle_m - cr * car.cg_to_rear_axle_m) / (cf + cr)
    ways = [
        winds._push_n(car._replace(wind_ahead_m=neutral_m + more_m), np.sin(T), np.full(N, 20.0), DT_S)
        for more_m in (-0.4, 0.0, 0.1, 0.2)
    ]
    np.testing.assert_allclose(ways[0], ways[2])
    np.testing.assert_allclose(ways[1], ways[2])
    assert np.std(ways[3]) < 0.9 * np.std(ways[2])


def test_an_accelerometers_noise_is_no_wind(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is quicker than a wind is left to the sensor: more of it is off, and turns the car, where all is a push."""
    one, x = blown_on(0.4)
    one = one._replace(measured=predicted(one, x, flat(N)._replace(side_n=GUSTS_N)))
    one.measured[:, 4] += filtered(np.random.default_rng(5).normal(0.0, 0.1, N), filter_kernel())

    def off_n() -> float:
        return float(np.std((winds.with_wind(one, x, flat(N)).side_n - GUSTS_N)[MIDDLE]))

    smooth_n = off_n()
    monkeypatch.setattr(winds, "GUSTS", np.ones(1))
    assert smooth_n < 0.8 * off_n()
    assert smooth_n < 0.25 * np.std(GUSTS_N)


def test_a_wind_that_is_nearly_there_is_not_looked_at_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each round begins with what is left, and the last one ends with it only if the one before left much."""
    one, x = blown_on(0.4)
    looks, left = list[int](), list[float]()

    def looked(*given: Any) -> np.ndarray:
        looks[-1] += 1
        return predicted(*given)

    monkeypatch.setattr(winds, "predicted", looked)
    for rounds in (1, 2, 3):
        looks.append(0)
        left.append(float(np.std((winds.with_wind(one, x, flat(N), rounds).side_n - GUSTS_N)[MIDDLE])))
    assert looks == [2, 2, 3]
    assert left[1] < left[0] < 0.1 * np.std(GUSTS_N)


def test_where_tyres_answer_late_no_wind_runs_away() -> None:
    one, x = blown_on(0.4)
    x[INDEX["tyre_relaxation.relaxation_length_m"]] = 1.5
    one = one._replace(measured=predicted(one, x, flat(N)._replace(side_n=GUSTS_N)))
    road = winds.with_wind(one, x, flat(N))
    assert np.std((road.side_n - GUSTS_N)[MIDDLE]) < 0.1 * np.std(GUSTS_N)


def test_an_rms_is_as_sure_as_what_makes_a_profile_another_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """The spread of a bank's rms, by its knots, against a thousand draws of these; and no surer than form allows."""
    monkeypatch.setattr(told_roads, "_evenly", lambda _: 0.0)
    monkeypatch.setattr(told_roads, "_untold_evenly", lambda *_: {"road_bank"})
    rng, n = np.random.default_rng(3), 6000
    road = flat(n)._replace(bank_rad=0.02 * np.sin(2.0 * np.pi * np.arange(n) / 2000.0))
    columns = tuple(BUILT_IN.columns_of("road_bank"))
    covariance = 0.004**2 * np.eye(len(columns))
    rows: Any = SimpleNamespace(at=np.arange(0, n, 4), used=np.ones((n // 4, 13), dtype=np.bool_))
    fit: Any = SimpleNamespace(
        x=nothing(), road=road, columns=columns, covariance=covariance, felt=lambda _: road, effects=("road_bank",)
    )
    told = told_roads.rms_told(cast("Drive", SimpleNamespace(vocabulary=BUILT_IN)), rows, fit, "road_bank")
    assert told is not None
    value, std = told["rms_rad"]
    draws = []
    for _ in range(1000):
        x = nothing()
        x[list(columns)] = rng.normal(0.0, 0.004, len(columns))
        bank = on_road(road, x).bank_rad[rows.at]
        draws.append(np.std(bank))
    assert value == pytest.approx(0.02 / np.sqrt(2.0), rel=1e-3)
    assert std == pytest.approx(np.hypot(np.std(draws), 0.01 * value), rel=0.1)
    fit.covariance = np.zeros_like(covariance)
    surest = told_roads.rms_told(cast("Drive", SimpleNamespace(vocabulary=BUILT_IN)), rows, fit, "road_bank")
    assert surest == {"rms_rad": (value, pytest.approx(0.01 * value))}
    # And no surer than the tilt all the way.
    monkeypatch.setattr(told_roads, "_evenly", lambda course: 0.04 * float(np.std(course)))
    surest = told_roads.rms_told(cast("Drive", SimpleNamespace(vocabulary=BUILT_IN)), rows, fit, "road_bank")
    assert surest == {"rms_rad": (value, pytest.approx(np.hypot(0.01, 0.04) * value))}
    # Where that is told it is in the rms.
    monkeypatch.setattr(told_roads, "_untold_evenly", lambda *_: set())
    fit.road = road._replace(bank_rad=road.bank_rad + 0.01)
    whole = told_roads.rms_told(cast("Drive", SimpleNamespace(vocabulary=BUILT_IN)), rows, fit, "road_bank")
    assert whole == {"rms_rad": (pytest.approx(np.hypot(value, 0.01)), pytest.approx(0.01 * np.hypot(value, 0.01)))}
    assert told_roads.rms_told(cast("Drive", None), rows, fit, "imu_delay") is None


@pytest.mark.parametrize("lasts_s", [1.0, 4.0])
def test_an_rms_is_no_surer_than_how_much_a_road_tilts_all_the_way(lasts_s: float) -> None:
    """Of longer roads of zero mean nine of ten and more have, on 150 s, an rms within it; and it is no wide one."""
    rng, rows, row_s = np.random.default_rng(5), 3750, 0.04
    gone = np.exp(-row_s / lasts_s)
    inside, off = [], []
    for _ in range(300):
        road = lfilter([1.0], [1.0, -gone], rng.normal(size=2 * rows))[rows:]
        course = road - np.mean(road)
        std = told_roads._evenly(course)
        truth, told = np.sqrt(np.mean(road**2)), np.sqrt(np.mean(course**2))
        inside.append(truth - told < 1.96 * std)
        off.append(std / told)
    assert 0.9 < np.mean(inside) < 0.99
    assert np.median(off) < 0.02 * lasts_s


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_the_noise_of_an_accelerometer_is_in_no_winds_rms(share: float) -> None:
    """A weak wind by a noisy sensor: what is felt is stronger by that, what is told is not."""
    one, x = blown_on(0.3)
    one = one._replace(measured=predicted(one, x, flat(N)._replace(side_n=share * GUSTS_N)))
    one.measured[:, 4] += filtered(np.random.default_rng(7).normal(0.0, 0.1, N), filter_kernel())
    one = one._replace(recording=one.recording._replace(floor=np.full(10, 0.1 * np.sqrt(np.sum(filter_kernel() ** 2)))))
    fit = fitted(one, rows_of(one), x, ("side_wind",), {}, felt=Felt(one, x, ("side_wind",)))
    rows = rows_of(one)
    told = told_roads.rms_told(one, rows, fit, "side_wind")
    assert told is not None
    value, std = told["rms_n"]
    at = told_roads.driven_rows(rows)
    true_n, felt_n = (float(np.std(course[at])) for course in (share * GUSTS_N, fit.road.side_n))
    assert felt_n > value
    assert abs(value - true_n) < 1.96 * std
    assert std < (0.15 if share > 0.3 else 4.0) * true_n


@pytest.mark.parametrize(("ahead_m", "arm_m"), [(0.3, None), (-0.3, 0.1)])
def test_a_winds_rms_is_no_surer_than_its_arm(ahead_m: float, arm_m: float | None) -> None:
    """Close to where a push turns no car its strength is hardly told."""
    one, x = blown_on(0.3)
    rows = rows_of(one)
    fit = fitted(one, rows, x, ("side_wind",), {}, felt=Felt(one, x, ("side_wind",)))
    y = fit.x.copy()
    y[AHEAD] = ahead_m
    car = one.car
    forces = car.front_cornering_stiffness_n_per_rad, car.rear_cornering_stiffness_n_per_rad
    both = forces[0] * car.cg_to_front_axle_m - forces[1] * car.cg_to_rear_axle_m
    arm_m = ahead_m - both / sum(forces) if arm_m is None else arm_m
    assert winds.arm_m(one, nothing() * 0.0 + np.where(np.arange(len(y)) == AHEAD, ahead_m, 0.0)) == pytest.approx(
        arm_m
    )
    told = told_roads.rms_told(one, rows, fit._replace(x=y), "side_wind")
    assert told is not None
    value, std = told["rms_n"]
    assert std is not None
    assert std >= 0.03 / arm_m * value * 0.98


def test_a_winds_rms_has_what_is_too_quick_to_be_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 3, 4 and 5 the last; of its power above half is not sure."""
    one, x = blown_on(0.3)
    rows = rows_of(one)
    fit = fitted(one, rows, x, ("side_wind",), {}, felt=Felt(one, x, ("side_wind",)))

    def told(above_n2: float) -> tuple[float, float]:
        monkeypatch.setattr(told_roads, "power_above_n2", lambda *_: above_n2)
        found = told_roads.rms_told(one, rows, fit, "side_wind")
        assert found is not None
        value, std = found["rms_n"]
        assert std is not None
        return value, std

    value, std = told(0.0)
    above = (4.0 / 3.0 * value) ** 2
    more, unsure = told(above)
    assert more == pytest.approx(5.0 / 3.0 * value)
    assert unsure == pytest.approx(np.hypot(5.0 / 3.0 * std, 0.5 * above / (2.0 * more)), rel=0.02)


# As slow as the bends are.
SLOW_GUSTS_N = 900.0 * (np.sin(2.0 * np.pi * T / 8.5 + 1.0) + 0.7 * np.sin(2.0 * np.pi * T / 21.0))


def begun(one: Drive) -> tuple[Trial, Screening, list[Start]]:
    """A trial beside nothing, what is screened, and from where effects are tried."""
    rows = rows_of(one)
    nominal = fitted(one, rows, nothing(), (), TOLERANCE)
    screening = screened(one, rows, nominal, TOLERANCE, map)
    trial = Trial(one, rows, nominal, TOLERANCE, screening.known)
    return trial, screening, starts_of(one, rows, nominal, screening.names)


@pytest.mark.parametrize("at_once", [True, False])
def test_a_wind_and_a_gyro_of_another_scale_are_found_at_once(at_once: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wind is judged by the yaw rate, of which a scale leaves as much as a wind does: alone neither helps."""
    if not at_once:
        monkeypatch.setattr(together, "_OTHERS_OF_A_WIND", 0)
    one, x = drive({}, CITY_V, CITY_STEER), nothing()
    x[AHEAD], x[INDEX["gyro_scale.z"]] = 0.3, 0.1
    one.measured[:] += predicted(one, x, flat(N)._replace(side_n=SLOW_GUSTS_N)) - predicted(one, nothing(), flat(N))
    trial, screening, starts = begun(one)
    assert any(new == ("side_wind",) for new, _ in starts)
    tried = two_at_once(trial, screening, starts, set(), map)
    first = tried[0] if tried else None
    assert (first is not None and set(first.fit.effects) == {"side_wind", "gyro_scale"}) is at_once
    if first is not None and at_once:
        assert first.fit.x[INDEX["gyro_scale.z"]] == pytest.approx(0.1, abs=0.02)
    # What was refused beside this model is not tried again.
    again = two_at_once(trial, screening, starts, {"side_wind"}, map)
    assert all("side_wind" not in step.fit.effects for step in again)


def test_a_wind_and_an_accelerometer_that_drifts_are_found_at_once() -> None:
    """A wind is felt of what an accelerometer shows, its drift too: beside one it is begun without that."""
    drifts = [INDEX["bias_drift.gyro_z"], INDEX["bias_drift.accel_y"]]
    one, x = drive({}, CITY_V, CITY_STEER), nothing()
    x[AHEAD] = 0.3
    x[drifts] = -2e-4, 0.005
    one.measured[:] += predicted(one, x, flat(N)._replace(side_n=SLOW_GUSTS_N)) - predicted(one, nothing(), flat(N))
    trial, screening, starts = begun(one)
    first = two_at_once(trial, screening, starts, set(), map)[0]
    assert set(first.fit.effects) == {"side_wind", "bias_drift"}
    assert first.fit.x[drifts] == pytest.approx(x[drifts], rel=0.3)
    # As felt of all that the accelerometer shows it is none.
    wind = next(start for new, start in starts if new == ("side_wind",))
    assert trial.fit((first.fit.effects, wind)).gain < 10.0 < first.gain
    # What else there is beside a wind begins where the wind does.
    assert beside_a_wind(trial.rows, trial.best, x, "gyro_scale") is x
