"""diagnose: what gains enough to be named, what two effects hide from each other, and what tells wind."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive, found

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import far_off, gained, puts_right, quiet
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.residuals.comparison import BLOCK_S, floors, rows_of
from dsz_daemon.diagnose.selection import trials as trials_module
from dsz_daemon.diagnose.selection.plausible import is_implausible, is_told
from dsz_daemon.diagnose.selection.screening import Screening, feels, screened
from dsz_daemon.diagnose.selection.starts import starts_of
from dsz_daemon.diagnose.selection.together import two_at_once
from dsz_daemon.diagnose.selection.trials import Step, Trial, enough_first, rank_by, rivals_of
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.surroundings.profiles import Felt
from dsz_daemon.diagnose.surroundings.winds import by_the_lean

YAW, ACROSS = 2, 4
ROLLS = {
    "suspension_roll.roll_gradient_rad_per_mps2": 0.015,
    "side_wind.leans": 1.0,
}


@pytest.fixture
def plain() -> tuple[Drive, Any, Fit]:
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    return one, rows, fitted(one, rows, nothing(), (), TOLERANCE)


def left_by(one: Drive, fit: Fit, channel: int, times_usual: float) -> Fit:
    """The same fit, in which a channel is off by so many times what noise and form leave."""
    usual = np.hypot(np.nan_to_num(floors(one)), fit.form)[channel]
    unseen = fit.unseen.copy()
    unseen[:, channel] = fit.sums.counts[:, channel] * (times_usual * usual) ** 2
    return fit._replace(unseen=unseen)


@pytest.mark.parametrize(
    ("before", "after", "is_right"),
    [(8.0, 2.0, True), (2.9, 0.5, False), (9.6, 3.1, False), (8.0, 2.8, False), (3.1, 1.0, True), (3.1, 1.1, False)],
)
def test_a_channel_is_put_right_that_was_far_off(
    plain: tuple[Drive, Any, Fit], before: float, after: float, is_right: bool
) -> None:
    one, _, fit = plain
    smaller, larger = left_by(one, fit, YAW, before), left_by(one, fit, YAW, after)
    assert puts_right(one, smaller, larger) is is_right
    assert far_off(one, smaller)[YAW] == (before > 3.0)
    assert not far_off(one, smaller)[ACROSS]


@pytest.mark.parametrize(
    ("effect", "channel", "is_right"),
    [("side_wind", ACROSS, False), ("side_wind", YAW, True), ("road_bank", 0, False), ("road_bank", ACROSS, True)],
)
def test_a_profile_puts_nothing_right_by_taking_what_is_left(
    plain: tuple[Drive, Any, Fit], effect: str, channel: int, is_right: bool
) -> None:
    one, _, fit = plain
    larger = left_by(one, fit, channel, 1.0)._replace(effects=(effect,))
    assert puts_right(one, left_by(one, fit, channel, 9.0), larger) is is_right


def test_what_gains_too_little_stands_in_nobodys_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """By rank the first, which gains less than what is asked for: the next one's turn."""
    none: Any = None
    right: set[str] = set()
    vague: set[str] = set()
    monkeypatch.setattr(trials_module, "is_beyond_form", lambda _, __, name: name in right)
    monkeypatch.setattr(trials_module, "is_told", lambda _, __, name: name not in vague)

    def order(share: float, *more: tuple[str, float]) -> list[str]:
        ranked = [("first", 89.0), ("second", 169.0), ("third", 163.0), *more]
        steps = [Step(name, gain, name) for name, gain in ranked]  # type: ignore[arg-type]
        return [step.effect for step in enough_first(none, none, steps, lambda _: share)]

    assert order(122.0) == ["second", "third", "first"]
    assert order(50.0) == ["first", "second", "third"]
    assert order(170.0) == []
    # A profile has to gain twice as much.
    assert order(122.0, ("road_bank", 200.0)) == ["second", "third", "first", "road_bank"]
    assert order(99.0, ("road_bank", 200.0)) == ["second", "third", "road_bank", "first"]
    # What puts right a channel that was far off is asked for no share, but for what is more than chance.
    right |= {"first", "last"}
    assert order(170.0, ("last", 9.0)) == ["first", "second", "third", "last"]
    # What a fit tells nothing of comes after the others, however much it gains.
    vague |= {"first"}
    assert order(50.0) == ["second", "third", "first"]


def test_an_effect_is_told_where_one_of_its_numbers_is() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    mass, shift = INDEX["mass_loading.added_mass_kg"], INDEX["mass_loading.cg_shift_m"]
    x, spread = nothing(), np.array([400.0, 0.05])
    fit: Any = SimpleNamespace(x=x, std=spread, columns=(mass, shift), covariance=np.diag(spread**2))
    x[mass] = 790.0
    assert not is_told(one, fit, "mass_loading")
    x[shift] = -0.11
    assert is_told(one, fit, "mass_loading")
    # By twice its spread, but nearer to nothing than what is worth a word.
    spread[1], x[shift] = 1e-6, 1e-5
    assert not is_told(one, fit, "mass_loading")
    # A profile is no number.
    assert is_told(one, fit, "road_bank")


def test_of_wheels_their_differences_are_told() -> None:
    """What all of them have in common may be anything; what one has more than the other may not."""
    one = drive({}, CITY_V, CITY_STEER)
    radii = [INDEX[f"wheel_radius.{wheel}"] for wheel in ("fl", "fr", "rl", "rr")]
    x, common = nothing(), np.full((4, 4), 0.08**2)
    x[radii] = [-0.1065, -0.1066, -0.1050, -0.1050]
    fit: Any = SimpleNamespace(x=x, std=np.full(4, 0.08), columns=tuple(radii), covariance=common + 2e-4**2 * np.eye(4))
    assert is_told(one, fit, "wheel_radius")
    # Each by itself is off by so much, too.
    fit.covariance = common + 2e-3**2 * np.eye(4)
    assert not is_told(one, fit, "wheel_radius")
    # Front and rear differ by less than what is worth a word.
    x[radii] = [-0.1065, -0.1065, -0.10648, -0.10648]
    fit.covariance = common + 1e-6**2 * np.eye(4)
    assert not is_told(one, fit, "wheel_radius")


def test_a_quiet_channel_gains_where_what_hung_together_does_no_more(plain: tuple[Drive, Any, Fit]) -> None:
    one, _, fit = plain
    smaller, larger = left_by(one, fit, YAW, 0.8), left_by(one, fit, YAW, 0.5)
    assert quiet(one, smaller)[YAW]

    def gain(before_rows: float, after_rows: float) -> float:
        hung, hangs = fit.per_row.copy(), fit.per_row.copy()
        hung[YAW], hangs[YAW] = before_rows, after_rows
        return gained(one, smaller._replace(per_row=hung), larger._replace(per_row=hangs))

    assert gain(60.0, 9.9) > 10.0
    # It still hangs together, or never did.
    assert gain(60.0, 10.1) == pytest.approx(0.0)
    assert gain(19.0, 9.9) == pytest.approx(0.0)


def test_what_a_larger_model_has_wrong_counts_as_often_as_it_did(plain: tuple[Drive, Any, Fit]) -> None:
    """Play took back a gyro's dead zone; the accelerometer, which had been noise, was all of a piece then."""
    one, _, fit = plain
    white, right, wrong = left_by(one, fit, YAW, 3.0), left_by(one, fit, YAW, 3.0), left_by(one, fit, YAW, 9.0)

    def gain(larger: Fit, before_rows: float, after_rows: float) -> float:
        hung, hangs = fit.per_row.copy(), fit.per_row.copy()
        hung[YAW], hangs[YAW] = before_rows, after_rows
        return gained(one, white._replace(per_row=hung), larger._replace(per_row=hangs))

    assert gain(wrong, 5.0, 60.0) == pytest.approx(gain(wrong, 5.0, 5.0))
    assert gain(wrong, 60.0, 60.0) > 0.2 * gain(wrong, 5.0, 5.0)
    assert gain(wrong, 60.0, 5.0) == pytest.approx(gain(wrong, 5.0, 5.0))
    # What it has right is divided by what that leaves.
    better = left_by(one, fit, YAW, 1.0)
    assert gain(better, 5.0, 60.0) == pytest.approx(gain(better, 60.0, 60.0))
    assert 0.0 < gain(better, 5.0, 60.0) < 0.2 * gain(better, 5.0, 5.0)
    assert gain(right, 5.0, 60.0) == pytest.approx(0.0, abs=1e-6)


def test_wind_is_thought_of_where_what_is_left_across_hangs_together(plain: tuple[Drive, Any, Fit]) -> None:
    one, rows, fit = plain
    rows_alike = fit.per_row.copy()
    rows_alike[ACROSS] = 11.0
    assert feels(one, rows, fit._replace(per_row=rows_alike), "side_wind")
    assert not feels(one, rows, fit._replace(per_row=rows_alike), "road_bank")
    rows_alike[ACROSS] = 9.0
    assert not feels(one, rows, fit._replace(per_row=rows_alike), "side_wind")


def gusts_n(seed: int = 4) -> np.ndarray:
    """Slow gusts, 300 N rms."""
    bell = np.exp(-0.5 * (np.arange(-400, 401) / 100.0) ** 2)
    slow = np.convolve(np.random.default_rng(seed).normal(size=N), bell, "same")
    return np.asarray(300.0 * slow / np.std(slow))


def blown(gusts: np.ndarray) -> tuple[Drive, np.ndarray]:
    """A soft car in the wind, and its parameters."""
    x = nothing()
    for name, value in ROLLS.items():
        x[INDEX[name]] = value
    one = drive({}, CITY_V, CITY_STEER)
    noise = one.measured - predicted(one, nothing(), flat(N))
    return one._replace(measured=predicted(one, x, flat(N)._replace(side_n=gusts)) + noise), x


def test_a_soft_body_tells_the_wind_by_its_lean() -> None:
    """What the tyres hold against the wind leans the body, and g times that is more than what they leave of a push."""
    gusts = gusts_n()
    one, x = blown(gusts)
    middle = slice(800, N - 800)
    told_n = Felt(one, x, ("suspension_roll", "side_wind"))(x).side_n
    assert np.corrcoef(told_n[middle], gusts[middle])[0, 1] > 0.92
    assert np.std(told_n[middle]) == pytest.approx(300.0, rel=0.15)
    # By the accelerometer alone, as if nothing leaned, it is not found.
    stiff = x.copy()
    stiff[INDEX["side_wind.leans"]] = 0.0
    by_push_n = Felt(one, stiff, ("suspension_roll", "side_wind"))(stiff).side_n
    assert np.corrcoef(by_push_n[middle], gusts[middle])[0, 1] < 0.7
    # Nothing else leans the body then: the force is in the simulation.
    felt = Felt(one, x, ("suspension_roll", "side_wind"))
    assert felt.leaning(x, None, None) is felt  # type: ignore[arg-type]


def test_wind_is_tried_by_its_push_and_by_the_lean(monkeypatch: pytest.MonkeyPatch) -> None:
    one, _ = blown(gusts_n())
    rows = rows_of(one)
    plain = fitted(one, rows, nothing(), (), TOLERANCE)
    soft = plain._replace(x=plain.x.copy(), effects=("suspension_roll",))
    soft.x[INDEX["suspension_roll.roll_gradient_rad_per_mps2"]] = 0.015
    leans = INDEX["side_wind.leans"]
    monkeypatch.setattr("dsz_daemon.diagnose.selection.starts.feels", lambda _, __, ___, effect: effect == "side_wind")

    def starts(best: Fit) -> list[float]:
        return [float(x[leans]) for names, x in starts_of(one, rows, best, []) if names == ("side_wind",)]

    assert starts(plain) == [0.0]
    assert starts(soft) == [0.0, 1.0]
    monkeypatch.setattr("dsz_daemon.diagnose.selection.starts.feels", lambda *_: False)
    assert starts(soft) == []


def test_a_fit_of_wind_by_the_lean_stays_one() -> None:
    gusts = gusts_n()
    one, _ = blown(gusts)
    rows = rows_of(one)
    soft = fitted(one, rows, nothing(), ("suspension_roll",), TOLERANCE)
    start = soft.x.copy()
    start[INDEX["side_wind.leans"]] = 1.0
    windy = fitted(one, rows, start, ("suspension_roll", "side_wind"), TOLERANCE, felt=soft.felt)
    assert by_the_lean(windy.x)
    assert windy.x[INDEX["side_wind.leans"]] == pytest.approx(1.0, abs=0.2)
    assert np.corrcoef(windy.road.side_n[800:-800], gusts[800:-800])[0, 1] > 0.9
    assert gained(one, soft, windy) > 20.0


@pytest.mark.parametrize(
    ("gradient", "leans", "is_by_lean"), [(0.015, 1.0, True), (0.003, 1.0, False), (0.015, 0.4, False)]
)
def test_wind_is_told_by_the_lean_of_a_body_that_is_soft(gradient: float, leans: float, is_by_lean: bool) -> None:
    x = nothing()
    x[INDEX["suspension_roll.roll_gradient_rad_per_mps2"]], x[INDEX["side_wind.leans"]] = gradient, leans
    assert by_the_lean(x) is is_by_lean


def test_wind_by_the_lean_is_judged_by_all_but_what_it_takes(plain: tuple[Drive, Any, Fit]) -> None:
    one, _, fit = plain
    x = fit.x.copy()
    for name, value in ROLLS.items():
        x[INDEX[name]] = value
    larger = fit._replace(x=x, effects=("side_wind",))
    before = {c: left_by(one, fit, c, 2.0) for c in range(6)}
    for c in range(6):
        gain = gained(one, before[c], left_by(one, larger, c, 1.0))
        assert (gain > 10.0) is (c != 0), c
    # The roll gyro may deny it.
    assert gained(one, before[0], left_by(one, larger, 0, 4.0)) < -10.0


def test_wind_is_judged_where_grip_does_not_end(plain: tuple[Drive, Any, Fit]) -> None:
    """Where a road is slippery what pushes sideways may be the tyres' own curve."""
    one, _, fit = plain
    x = fit.x.copy()
    x[INDEX["low_friction.start_s"]], x[INDEX["low_friction.end_s"]] = 20.0, 40.0
    smaller = left_by(one, fit._replace(x=x, effects=("low_friction",)), YAW, 2.0)
    blocks = np.arange(len(fit.unseen))
    slippery = (BLOCK_S * blocks > 19.9) & (BLOCK_S * blocks < 40.0)

    def gain(effect: str, at: np.ndarray) -> float:
        unseen = smaller.unseen.copy()
        unseen[at, YAW] *= 0.2
        return gained(one, smaller, smaller._replace(unseen=unseen, effects=("low_friction", effect)))

    assert gain("side_wind", slippery) == pytest.approx(0.0, abs=1e-6)
    assert gain("side_wind", ~slippery) > 10.0
    assert gain("steering_ratio", slippery) > 10.0


@pytest.mark.parametrize("grip", ["low_friction", "tyre_saturation"])
def test_where_grip_ends_a_sensor_clips_only_where_readings_stand(monkeypatch: pytest.MonkeyPatch, grip: str) -> None:
    """A car that goes no further than its tyres hold looks like an accelerometer that clips."""
    one = drive({}, CITY_V, CITY_STEER)
    x = nothing()
    x[INDEX["sensor_saturation.accel_limit_mps2"]] = float(np.max(np.abs(one.measured[:, 3:5])))
    rest = {"x": x, "columns": (), "road": flat(N), "left": np.zeros(rows_of(one).used.shape)}
    fit: Any = SimpleNamespace(**rest, effects=("sensor_saturation",))
    beside: Any = SimpleNamespace(**rest, effects=(grip, "sensor_saturation"))
    assert not is_implausible(one, rows_of(one), fit, "sensor_saturation")
    assert is_implausible(one, rows_of(one), beside, "sensor_saturation")
    monkeypatch.setattr("dsz_daemon.diagnose.selection.plausible.limits_read_off", lambda *_: {0: []})
    assert not is_implausible(one, rows_of(one), beside, "sensor_saturation")


def both_late() -> Drive:
    """An IMU that follows slowly and a steering that is late: the car turns in time with its steering."""
    late = {"sensor_bandwidth.time_constant_s": 0.08, "steering_delay.delay_s": 0.08}
    return drive(late, CITY_V + 2.0 * np.sin(0.6 * T), CITY_STEER)


def test_two_at_once_are_worth_what_they_gain_beyond_what_each_does() -> None:
    """By hand: 70 - 50 - 0 = 20 and 52 - 40 - 0 = 12, where what loses alone counts for nothing; 95 - 50 - 40 = 5."""
    gains = {"a": 50.0, "b": 40.0, "c": -30.0, "ab": 95.0, "ac": 70.0, "bc": 52.0}
    stands: Any = SimpleNamespace(
        of_effects=dict.fromkeys("abc", ()),
        after=lambda names: np.full((2, 13), {"a": 1.0, "b": 2.0, "c": 3.0}[names[0]]),
        gain=lambda names: gains["".join(names)],
    )
    assert Screening.pairs(stands, np.ones(13, dtype=np.bool_), map) == [("a", "c"), ("b", "c")]


def test_two_that_hide_each_other_are_found_at_once() -> None:
    one = both_late()
    rows = rows_of(one)
    best = fitted(one, rows, nothing(), (), TOLERANCE)
    screening = screened(one, rows, best, TOLERANCE, map)
    trial = Trial(one, rows, best, TOLERANCE, screening.known)
    off = far_off(one, best)
    assert off.any()
    late = [pair for pair in screening.pairs(off, map) if set(pair) == {"sensor_bandwidth", "steering_delay"}]
    assert late
    assert screening.gain(late[0]) > sum(max(screening.gain([name]), 0.0) for name in late[0]) + 10.0
    tried = two_at_once(trial, screening, [], set(), map)
    assert set(tried[0].fit.effects) == {"sensor_bandwidth", "steering_delay"}
    assert tried == sorted(tried, key=lambda step: -step.gain)
    assert puts_right(one, best, tried[0].fit)
    # What was refused beside this model is not tried again, and where nothing is far off nobody looks.
    assert all(
        "steering_delay" not in step.fit.effects for step in two_at_once(trial, screening, [], {"steering_delay"}, map)
    )
    even = Trial(one, rows, tried[0].fit, TOLERANCE, screening.known)
    assert two_at_once(even, screening, [], set(), map) == []


def test_of_two_at_once_each_has_its_own_rivals() -> None:
    def step(gain: float, *effects: str) -> Step:
        fit: Any = SimpleNamespace(effects=("wheel_slip", *effects))
        return Step(effects[-1], gain, fit)

    best: Any = SimpleNamespace(effects=("wheel_slip",))
    tried = [
        step(90.0, "steering_delay", "sensor_bandwidth"),
        step(70.0, "steering_delay", "imu_delay"),
        step(60.0, "gyro_scale", "sensor_bandwidth"),
        step(50.0, "gyro_scale", "accel_scale"),
    ]

    def rank(one: Step) -> float:
        return 0.5 * one.gain

    # By what they were ranked by, not by what each gains of its own rows.
    rivals = {
        effect: [(one.effect, one.gain) for one in steps] for effect, steps in rivals_of(best, tried, rank).items()
    }
    assert rivals == {
        "sensor_bandwidth": [("sensor_bandwidth", 45.0), ("imu_delay", 35.0)],
        "steering_delay": [("steering_delay", 45.0), ("gyro_scale", 30.0)],
    }
    alone = [step(90.0, "steering_delay"), step(70.0, "imu_delay")]
    assert [one.effect for one in rivals_of(best, alone, rank)["steering_delay"]] == ["steering_delay", "imu_delay"]


def test_of_two_ways_to_judge_that_do_not_agree_neither_is_surer() -> None:
    """By what itself leaves one gains more than the first, by what all of them leave it gains less."""
    best: Any = SimpleNamespace(effects=())

    def step(effect: str, gain: float) -> Step:
        fit: Any = SimpleNamespace(effects=(effect,))
        return Step(effect, gain, fit)

    tried = [step("sensor_bandwidth", 100.0), step("imu_delay", 110.0), step("gyro_scale", 90.0)]
    tried += [step(effect, 120.0) for effect in ("road_bank", "low_friction", "mass_loading")]
    ranks = {"sensor_bandwidth": 105.0, "imu_delay": 95.0}
    found = rivals_of(best, tried, lambda one: ranks.get(one.effect, 80.0))["sensor_bandwidth"]
    gains = {one.effect: one.gain for one in found}
    assert gains == {
        "sensor_bandwidth": 105.0,
        "imu_delay": 105.0,
        "gyro_scale": 80.0,
        # Behind by other rules than what they gain.
        "road_bank": 80.0,
        "low_friction": 80.0,
        "mass_loading": 80.0,
    }


def test_two_that_hide_each_other_are_both_named() -> None:
    search = found(both_late())
    assert set(search.best.effects) == {"sensor_bandwidth", "steering_delay"}
    assert search.best.x[INDEX["sensor_bandwidth.time_constant_s"]] == pytest.approx(0.08, rel=0.05)
    assert search.best.x[INDEX["steering_delay.delay_s"]] == pytest.approx(0.08, rel=0.05)
    assert set(search.elsewhere) == set(search.rivals) == set(search.gains) == set(search.best.effects)


def test_what_has_no_name_has_to_gain_a_twentieth_more_than_what_has_and_as_a_cause_does() -> None:
    """One fit under three names: a wheel's radius, its square, which has none, and a profile."""
    scaled = drive({"accel_scale.y": 0.05}, CITY_V, CITY_STEER)
    rows = rows_of(scaled)
    before = fitted(scaled, rows, nothing(), (), TOLERANCE)
    fit = fitted(scaled, rows, before.x, ("accel_scale",), TOLERANCE)
    gain = gained(scaled, before, fit)
    tried = [Step(name, gain, fit) for name in ("wheel_radius", "wheel_square", "road_bank")]
    named, nameless, profile = (rank_by(scaled, before, tried)(step) for step in tried)
    assert gain > 100.0
    assert nameless == pytest.approx((named - 10.0) / 1.05)
    assert profile == pytest.approx(0.8 * named)
