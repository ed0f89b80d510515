"""diagnose: what of a steering is lost in its play, and in its friction, by hand values."""

from __future__ import annotations

import numpy as np
import pytest
from core_cases import TUCSON
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive, found
from test_diagnose_choices import T as T_ALL

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel, filtered, recorded
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.selection import guesses as guesses_module
from dsz_daemon.diagnose.selection.starts import starts_of
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.simulation.play import geared, held_back, lost_in_play, played
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import WHEEL_SPEEDS

T = DT_S * np.arange(1000)
TREMBLES, WANDERS = 0.004 * np.sin(2.0 * np.pi * 4.0 * T), 0.03 * np.sin(0.8 * T)
YAW = 2


def test_play_swallows_what_is_smaller_than_itself() -> None:
    assert not played(0.004 * np.sin(T), 0.01).any()


def test_what_is_dragged_stands_half_the_play_behind_either_way() -> None:
    there_and_back = np.concatenate([np.linspace(0.0, 0.02, 100), np.linspace(0.02, -0.02, 200)])
    at = played(there_and_back, 0.01)
    assert at[99] == pytest.approx(0.015)
    # Back by the play's width nothing moves; then it follows again.
    assert at[100 + 49] == pytest.approx(0.015, abs=2e-4)
    assert at[-1] == pytest.approx(-0.015)


def test_wheels_that_pull_themselves_straight_stand_nearer_to_the_middle_on_either_side() -> None:
    """Play of 0.01: nothing within 0.005, half of it less beyond, however the hand turns; in part half as much."""
    there_and_back = np.array([0.0, 0.004, 0.02, 0.0, -0.004, -0.02, -0.01])
    at = there_and_back - lost_in_play(there_and_back, 0.01, None, 1.0)
    np.testing.assert_allclose(at, [0.0, 0.0, 0.015, 0.0, 0.0, -0.015, -0.005], atol=1e-12)
    both = [lost_in_play(there_and_back, 0.01, None, centred) for centred in (0.0, 1.0)]
    half = lost_in_play(there_and_back, 0.01, None, 0.5)
    np.testing.assert_allclose(half, np.mean(both, axis=0), atol=1e-12)
    assert np.abs(both[0] - both[1]).max() > 0.005


def test_play_may_begin_anywhere_within_it() -> None:
    """Until the hand has gone all of its width wheels stand where they stood; after that it is forgotten."""
    there_and_back = np.concatenate([np.linspace(0.0, 0.02, 100), np.linspace(0.02, -0.02, 200)])
    for begins in (-1.0, -0.5, 0.0, 0.5, 1.0):
        at = there_and_back - lost_in_play(there_and_back, 0.01, None, 0.0, begins)
        assert at[0] == pytest.approx(0.005 * begins)
        assert at[20] == pytest.approx(max(0.005 * begins, there_and_back[20] - 0.005))
        np.testing.assert_allclose(at[60:], played(there_and_back, 0.01)[60:], atol=1e-12)


@pytest.mark.parametrize("begins", [-1.0, 1.0])
def test_play_is_found_wherever_a_drive_begins_in_it(begins: float) -> None:
    """On a motorway, from a hand that has stood for seconds: without that it would be no play, for two channels."""
    left_out = {"steering_backlash.width_rad": 0.012, "steering_backlash.begins": begins}
    v_mps, hand = np.full(len(CITY_V), 25.0), 0.3 * CITY_STEER
    hand = np.where(T_ALL < 8.0, hand[np.searchsorted(T_ALL, 8.0)], hand)
    best = found(drive(left_out, v_mps, hand)).best
    assert best.effects == ("steering_backlash",)
    assert best.x[INDEX["steering_backlash.width_rad"]] == pytest.approx(0.012, rel=0.1)
    assert best.x[INDEX["steering_backlash.begins"]] == pytest.approx(begins, abs=0.15)


@pytest.mark.parametrize(("width_rad", "centred"), [(0.012, 1.0), (0.004, 1.0), (0.012, 0.0)])
def test_play_is_found_whichever_way_it_is_taken_up(width_rad: float, centred: float) -> None:
    left_out = {"steering_backlash.width_rad": width_rad, "steering_backlash.centred": centred}
    best = found(drive(left_out, CITY_V, CITY_STEER)).best
    assert best.effects == ("steering_backlash",)
    assert best.x[INDEX["steering_backlash.width_rad"]] == pytest.approx(width_rad, rel=0.1)
    assert best.x[INDEX["steering_backlash.centred"]] == pytest.approx(centred, abs=0.15)


def test_play_towards_the_middle_is_guessed_where_the_yaw_rate_has_it() -> None:
    for left_out, is_there in (
        ({"steering_backlash.width_rad": 0.012, "steering_backlash.centred": 1.0}, True),
        ({"gyro_scale.z": 0.05}, False),
        ({}, False),
    ):
        one = drive(left_out, CITY_V, CITY_STEER)
        rows = rows_of(one)
        plain = fitted(one, rows, nothing(), (), TOLERANCE)
        starts = [x for new, x in starts_of(one, rows, plain, ["steering_backlash"]) if new == ("steering_backlash",)]
        # And the way that play is screened by.
        widths = sorted(float(x[INDEX["steering_backlash.width_rad"]]) for x in starts)
        assert widths[0] == 0.0
        assert len(widths) == (2 if is_there else 1)
        if is_there:
            assert widths[1] == pytest.approx(0.012, rel=0.4)
        there = plain._replace(effects=("steering_backlash",))
        assert ("steering_backlash",) not in dict(starts_of(one, rows, there, ["gyro_scale"]))


def test_no_play_is_guessed_of_a_yaw_rate_that_is_right(monkeypatch: pytest.MonkeyPatch) -> None:
    one = drive({"steering_backlash.width_rad": 0.012, "steering_backlash.centred": 1.0}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    plain = fitted(one, rows, nothing(), (), TOLERANCE)
    assert "steering_backlash" in dict(guesses_module.guesses(one, rows, plain))
    monkeypatch.setattr(guesses_module, "quiet", lambda *_: np.ones(13, dtype=bool))
    assert "steering_backlash" not in dict(guesses_module.guesses(one, rows, plain))


def test_a_ratio_turns_the_road_wheels_less_and_less() -> None:
    """True over configured 1.1, and 0.05 more per rad of a hand wheel that turns 16 times as far."""
    angle = np.array([-0.05, 0.05])
    np.testing.assert_allclose(geared(angle, 16.0, 0.1, 0.05), angle / (1.1 + 0.05 * 0.8))
    assert geared(angle, 16.0, 0.0, 0.0) is angle


def test_play_comes_before_the_low_pass() -> None:
    """A hand that trembles by less than the play moves nothing, which the low-pass would show as a smaller tremble."""
    kernel = filter_kernel()
    kept = filtered(TREMBLES, kernel) - lost_in_play(TREMBLES, 0.01, kernel)
    assert np.std(filtered(TREMBLES, kernel)) > 5e-4
    np.testing.assert_allclose(kept, 0.0, atol=1e-12)
    assert lost_in_play(TREMBLES, 0.002, None) == pytest.approx(TREMBLES - played(TREMBLES, 0.002))


@pytest.mark.parametrize("role", ["steering_wheel_angle", "road_wheel_angle"])
def test_a_recorded_hand_that_trembles_turns_a_car_with_play_by_what_is_dragged(role: str) -> None:
    """Second route: a car without play that is recorded with the angle that its wheels have."""
    at_ns = (T * 1e9).astype(np.int64) + 1
    width_rad, ratio = 0.012, 16.0

    def car_of(angle_rad: np.ndarray, **more: float) -> np.ndarray:
        by_hand = ratio if role == "steering_wheel_angle" else 1.0
        signals = {name: Signal(at_ns, np.full(len(T), 20.0)) for name in WHEEL_SPEEDS}
        signals[role] = Signal(at_ns, by_hand * angle_rad)
        signals["gyro_z"] = Signal(at_ns, np.zeros(len(T)))
        drive, x = drive_of(recorded(signals, ratio), TUCSON, ratio), nothing()
        for name, value in more.items():
            x[INDEX[name.replace("__", ".")]] = value
        return np.asarray(predicted(drive, x, flat(len(drive.steer)))[:, YAW])

    steering = WANDERS + TREMBLES
    with_play = car_of(steering, steering_backlash__width_rad=width_rad)
    by_its_wheels = car_of(played(steering, width_rad))
    turning = np.std(by_its_wheels)
    assert turning > 0.05
    assert np.std(with_play - by_its_wheels) < 1e-3 * turning
    assert np.std(car_of(steering) - by_its_wheels) > 0.1 * turning


def test_play_goes_on_where_a_steering_is_missing_for_a_moment() -> None:
    at_ns = (T * 1e9).astype(np.int64) + 1
    signals = {name: Signal(at_ns, np.full(len(T), 20.0)) for name in (*WHEEL_SPEEDS, "gyro_z")}
    there = (T < 4.0) | (T > 4.5)
    signals["road_wheel_angle"] = Signal(at_ns[there], WANDERS[there])
    drive, x = drive_of(recorded(signals, 1.0), TUCSON, 1.0), nothing()
    x[INDEX["steering_backlash.width_rad"]] = 0.01
    assert np.isfinite(predicted(drive, x, flat(len(drive.steer)))[:, YAW]).all()


def test_noise_of_a_steering_sensor_takes_up_no_play() -> None:
    """Of what is lost on the way a twelfth would be missing, as if the play were less wide by that."""
    at_ns, width_rad, noise_rad = (T * 1e9).astype(np.int64) + 1, 0.003, 2.5e-4
    noisy = WANDERS + noise_rad * np.random.default_rng(1).normal(0.0, 1.0, len(T))
    signals = {name: Signal(at_ns, np.full(len(T), 20.0)) for name in (*WHEEL_SPEEDS, "gyro_z")}

    def told(angle_rad: np.ndarray, by_hand: float) -> np.ndarray:
        role = "steering_wheel_angle" if by_hand != 1.0 else "road_wheel_angle"
        found = recorded(signals | {role: Signal(at_ns, by_hand * angle_rad)}, by_hand).told_rad
        assert found is not None
        return found

    lost = lost_in_play(WANDERS, width_rad, filter_kernel())[20:-20]
    for by_hand in (16.0, 1.0):
        shown = lost_in_play(told(noisy, by_hand), width_rad, filter_kernel())[20:-20]
        as_it_comes = lost_in_play(noisy, width_rad, filter_kernel())[20:-20]
        # By as much as play is too narrow, either way.
        assert np.mean(np.abs(lost)) - np.mean(np.abs(as_it_comes)) > 0.4 * noise_rad
        assert abs(np.mean(np.abs(lost)) - np.mean(np.abs(shown))) < 0.05 * noise_rad
        # A hand that trembles besides is no noise: play lets nothing of it through.
        trembling = noisy + TREMBLES
        np.testing.assert_allclose(told(trembling, by_hand), trembling, rtol=0.0, atol=1e-8)
        # A sensor with little noise is taken as it is.
        np.testing.assert_allclose(told(WANDERS + TREMBLES, by_hand), WANDERS + TREMBLES, rtol=0.0, atol=1e-8)
        little = WANDERS + 0.1 * (noisy - WANDERS)
        np.testing.assert_allclose(told(little, by_hand), little, rtol=0.0, atol=1e-8)


def rubbed(hand_rad: np.ndarray, half_rad: float, on_the_way: float) -> np.ndarray:
    """What wheels do behind dry friction, in steps a fiftieth as long as the hand's: z' = k x' (1 - z sign(x') / h)."""
    fine = np.interp(np.linspace(0, len(hand_rad) - 1, 50 * (len(hand_rad) - 1) + 1), range(len(hand_rad)), hand_rad)
    lost = np.zeros(len(fine))
    for i, way in enumerate(np.diff(fine)):
        lost[i + 1] = lost[i] + on_the_way * way * (1.0 - np.sign(way) * lost[i] / half_rad)
    return hand_rad - lost[::50]


def test_friction_holds_back_softly() -> None:
    """After a turn nothing is lost on a way of ln(2) half / k, where play has lost nothing on half its width."""
    hand = np.concatenate([np.linspace(0.0, 0.2, 2000), np.linspace(0.2, 0.0, 4000)])
    half, k = 0.005, 0.7
    lost = held_back(hand, 2.0 * half, 1.0 / k - 1.0)
    np.testing.assert_allclose(lost, hand - rubbed(hand, half, k), atol=2e-5)
    assert lost[1999] == pytest.approx(half, rel=1e-6)
    crossing = 1999 + int(np.argmax(lost[1999:] < 0.0))
    assert 0.2 - hand[crossing] == pytest.approx(np.log(2.0) * half / k, rel=0.02)
    # A hand that stays where it is loses nothing more.
    assert held_back(np.full(9, 0.1), 0.01, 0.0).tolist() == [0.0] * 9


@pytest.mark.parametrize("half_rad", [0.006, 0.002])
def test_a_column_that_rubs_has_no_play(half_rad: float) -> None:
    wheels = drive({}, CITY_V, rubbed(CITY_STEER, half_rad, 0.7))
    one = wheels._replace(steer=CITY_STEER, told_steer=CITY_STEER)
    told = answered(found(one))
    assert told.causes == []
    [shape] = told.unlisted
    assert (shape.channel, shape.shape) == ("gyro_z", "k*sign(delta')")
    assert shape.coefficient.value == pytest.approx(-half_rad, rel=0.1)


@pytest.mark.parametrize("width_rad", [0.01, 0.003])
def test_and_play_does_not_rub(width_rad: float) -> None:
    wheels = drive({}, CITY_V, played(CITY_STEER, width_rad))
    told = answered(found(wheels._replace(steer=CITY_STEER, told_steer=CITY_STEER)))
    assert [cause.effect for cause in told.causes] == ["steering_backlash"]
    assert told.unlisted == []
