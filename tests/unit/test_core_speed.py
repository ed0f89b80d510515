"""core/speed: wheels of a rigid body, carried to its C.G.; patching, limiting, standing still."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_cases import DEFAULTS, NAN, NOTHING, TUCSON, WHEELS
from hypothesis import given, settings
from hypothesis import strategies as st

from dsz_daemon.core import speed
from dsz_daemon.core.parameters import Car, Inputs
from dsz_daemon.core.speed import Corners, SpeedState

REAR_DRIVEN = TUCSON._replace(front_driven=False, rear_driven=True)
ALL_DRIVEN = TUCSON._replace(rear_driven=True)
TUNING = DEFAULTS
DT = 0.01


def wheels(fl: float, fr: float, rl: float, rr: float, **more: float) -> Inputs:
    return NOTHING._replace(**dict(zip(WHEELS, (fl, fr, rl, rr), strict=True)))._replace(**more)


def rolling(car: Car, vx: float, vy: float, r: float, delta: float) -> Inputs:
    """Rim speeds of a rigid body: v + omega x r at each wheel, along that wheel's heading."""
    lf, lr = car.cg_to_front_axle_m, -car.cg_to_rear_axle_m
    places = [
        (lf, car.front_track_m / 2.0, delta),
        (lf, -car.front_track_m / 2.0, delta),
        (lr, car.rear_track_m / 2.0, 0.0),
        (lr, -car.rear_track_m / 2.0, 0.0),
    ]
    rims = []
    for x, y, heading in places:
        velocity = np.array([vx, vy, 0.0]) + np.cross([0.0, 0.0, r], [x, y, 0.0])
        rims.append(float(velocity @ [math.cos(heading), math.sin(heading), 0.0]))
    return wheels(*rims)


@pytest.mark.parametrize(
    ("vx", "vy", "r", "delta"), [(12.0, -0.3, 0.5, 0.12), (25.0, 0.6, -0.4, -0.07), (4.0, 0.5, 0.9, 0.5)]
)
def test_every_wheel_of_a_rigid_body_stands_for_its_cgs_speed(vx: float, vy: float, r: float, delta: float) -> None:
    car = TUCSON._replace(rear_track_m=1.4)
    inputs = rolling(car, vx, vy, r, delta)
    assert speed.corner_speeds(inputs, car, r, delta, vy) == pytest.approx((vx,) * 4, rel=1e-12)
    assert len({round(rim, 6) for rim in inputs[6:10]}) == 4


@pytest.mark.parametrize("r", [-0.5, 0.3])
def test_the_wheels_yaw_rate_has_the_turns_sign(r: float) -> None:
    """A left turn (r > 0): the right wheels run faster."""
    inputs = rolling(TUCSON, 12.0, 0.0, r, 0.0)
    assert speed.wheel_yaw_rate(inputs, TUCSON) == pytest.approx(r, rel=1e-12)


def test_the_wheels_yaw_rate_comes_from_the_undriven_axle_first() -> None:
    spinning_front = rolling(TUCSON, 12.0, 0.0, 0.2, 0.0)._replace(wheel_speed_fr=20.0)
    assert speed.wheel_yaw_rate(spinning_front, TUCSON) == pytest.approx(0.2)
    spinning_rear = rolling(TUCSON, 12.0, 0.0, 0.2, 0.0)._replace(wheel_speed_rr=20.0)
    assert speed.wheel_yaw_rate(spinning_rear, REAR_DRIVEN) == pytest.approx(0.2)
    no_rear = rolling(TUCSON, 12.0, 0.0, 0.2, 0.0)._replace(wheel_speed_rl=NAN)
    assert speed.wheel_yaw_rate(no_rear, TUCSON) == pytest.approx(0.2)
    assert math.isnan(speed.wheel_yaw_rate(no_rear._replace(wheel_speed_fl=NAN), TUCSON))


CORNERS = Corners(fl=11.0, fr=12.0, rl=9.0, rr=9.6)


def test_accelerating_the_undriven_wheels_count() -> None:
    assert speed.patched_speed(CORNERS, TUCSON, braking=False) == pytest.approx(9.3)
    assert speed.patched_speed(CORNERS, REAR_DRIVEN, braking=False) == pytest.approx(11.5)
    # All driven: spin only makes wheels faster, so the slowest is the nearest to the car.
    assert speed.patched_speed(CORNERS, ALL_DRIVEN, braking=False) == 9.0


@pytest.mark.parametrize("car", [TUCSON, REAR_DRIVEN, ALL_DRIVEN])
def test_braking_the_fastest_wheel_counts(car: Car) -> None:
    assert speed.patched_speed(CORNERS, car, braking=True) == 12.0
    assert speed.patched_speed(CORNERS._replace(fl=15.0), car, braking=True) == 15.0


def test_missing_wheels_leave_the_work_to_the_rest() -> None:
    assert speed.patched_speed(CORNERS._replace(rl=NAN), TUCSON, braking=False) == 9.6
    assert speed.patched_speed(Corners(11.0, 12.0, NAN, NAN), TUCSON, braking=False) == 11.0
    assert speed.patched_speed(Corners(NAN, 12.0, NAN, NAN), TUCSON, braking=True) == 12.0
    assert math.isnan(speed.patched_speed(Corners(NAN, NAN, NAN, NAN), TUCSON, braking=True))


def test_braking_is_the_switchs_word_and_without_one_the_speeds() -> None:
    pressed, released = NOTHING._replace(brake=1.0), NOTHING._replace(brake=0.0)
    assert speed.is_braking(pressed, 1.0, 0.5)
    assert not speed.is_braking(released, -3.0, 0.5)
    assert speed.is_braking(NOTHING, -0.6, 0.5)
    assert not speed.is_braking(NOTHING, -0.4, 0.5)
    assert not speed.is_braking(NOTHING, 3.0, 0.5)


def test_the_wheels_agree_within_share_and_absolute_tolerance() -> None:
    """0.3 m/s + 3 %: at 20 m/s wheels may differ by 0.9 m/s."""
    even = Corners(19.2, 20.0, 19.6, 19.5)
    assert speed.wheels_agree(even, TUNING)
    assert not speed.wheels_agree(even._replace(fl=19.0), TUNING)
    assert speed.wheels_agree(Corners(NAN, NAN, NAN, 4.0), TUNING)
    assert speed.wheels_agree(Corners(NAN, NAN, NAN, NAN), TUNING)


def test_the_limiter_knows_what_a_car_can_do() -> None:
    """At most +6 and -11 m/s^2 without an accelerometer."""
    assert speed.limited_speed(20.0, 30.0, NAN, TUNING, 0.1) == pytest.approx(20.6)
    assert speed.limited_speed(20.0, 10.0, NAN, TUNING, 0.1) == pytest.approx(18.9)
    assert speed.limited_speed(20.0, 20.3, NAN, TUNING, 0.1) == 20.3


def test_the_accelerometer_narrows_the_limiter_to_its_margin() -> None:
    """a_x = -2 with a margin of 3: the speed may change by -5 to +1 m/s^2."""
    assert speed.limited_speed(20.0, 30.0, -2.0, TUNING, 0.1) == pytest.approx(20.1)
    assert speed.limited_speed(20.0, 10.0, -2.0, TUNING, 0.1) == pytest.approx(19.5)
    # Never wider than the car's own limits: a_x = -9 leaves -11, not -12.
    assert speed.limited_speed(20.0, 10.0, -9.0, TUNING, 0.1) == pytest.approx(18.9)
    assert speed.limited_speed(20.0, 30.0, 5.0, TUNING, 0.1) == pytest.approx(20.6)


def advanced(
    state: SpeedState, inputs: Inputs, seconds: float, car: Car = TUCSON, ax: float = NAN, dt_s: float = DT
) -> SpeedState:
    for _ in range(round(seconds / dt_s)):
        inputs = speed.signed_wheels(inputs)
        corners = speed.corner_speeds(inputs, car, 0.0, 0.0, 0.0)
        state = speed.advanced_speed(state, inputs, corners, car, ax, TUNING, dt_s)
    return state


def test_the_first_reading_starts_the_speed_and_losing_all_wheels_ends_it() -> None:
    state = advanced(SpeedState(), wheels(20.0, 20.0, 20.0, 20.0), DT)
    assert (state.speed_mps, state.smoothed_mps, state.valid) == (20.0, 20.0, 1.0)
    assert advanced(state, wheels(NAN, NAN, NAN, NAN), DT) == SpeedState()
    back = advanced(SpeedState(), wheels(NAN, 5.0, NAN, NAN), DT)
    assert (back.speed_mps, back.valid) == (5.0, 1.0)


def test_spinning_driven_wheels_do_not_move_the_speed_and_braking_does_not_follow_a_locked_one() -> None:
    start = advanced(SpeedState(), wheels(10.0, 10.0, 10.0, 10.0), 1.0)
    assert advanced(start, wheels(18.0, 17.0, 10.0, 10.0), 1.0).speed_mps == pytest.approx(10.0)
    assert advanced(start, wheels(10.0, 9.0, 2.0, 2.0, brake=1.0), 1.0).speed_mps == pytest.approx(10.0)


@pytest.mark.parametrize("dt_s", [0.002, 0.01, 0.05])
@pytest.mark.parametrize("a_mps2", [1.5, -1.5])
def test_v_dot_of_a_steady_acceleration_at_any_rate_of_the_loop(a_mps2: float, dt_s: float) -> None:
    state = SpeedState()
    for k in range(round(4.0 / dt_s) + 1):
        v = 10.0 + a_mps2 * k * dt_s
        state = advanced(state, wheels(v, v, v, v), dt_s, dt_s=dt_s)
    assert state.rate_mps2 == pytest.approx(a_mps2, rel=1e-3)


def test_v_dot_adds_up_to_the_smoothed_speed() -> None:
    """What is learnt from v' over a while depends on the speed's begin and end, not on the way between."""
    state, total = advanced(SpeedState(), wheels(10.0, 10.0, 10.0, 10.0), DT), 0.0
    for v in 10.0 + np.cumsum(np.random.default_rng(2).normal(0.0, 0.02, 200)):
        state = advanced(state, wheels(v, v, v, v), DT)
        total += state.rate_mps2 * DT
    assert total == pytest.approx(state.smoothed_mps - 10.0, abs=1e-12)


def test_reverse_gear_turns_the_sign_of_undirected_wheels() -> None:
    for rim in (2.0, -2.0):
        state = advanced(SpeedState(), wheels(rim, rim, rim, rim, reverse=1.0), DT)
        assert state.speed_mps == -2.0
    forward = advanced(state, wheels(0.5, 0.5, 0.5, 0.5, reverse=0.0), DT)
    assert forward.speed_mps == 0.5
    # Backing faster and faster is an acceleration to the rear.
    backing = advanced(SpeedState(-2.0, -2.0, valid=1.0), wheels(3.0, 3.0, 3.0, 3.0, reverse=1.0), 0.1, ax=-6.0)
    assert backing.speed_mps == pytest.approx(-2.9)
    missing = speed.signed_wheels(wheels(1.0, NAN, 2.0, 3.0, reverse=1.0))
    assert (missing.wheel_speed_fl, missing.wheel_speed_rl, missing.wheel_speed_rr) == (-1.0, -2.0, -3.0)
    assert math.isnan(missing.wheel_speed_fr)


def test_a_standstill_is_one_second_of_resting_wheels() -> None:
    rolling_slowly = wheels(0.5, 0.5, 0.5, 0.5)
    at_rest = wheels(0.0, 0.05, 0.0, 0.0)
    # The limited speed needs some 0.04 s to come down.
    state = advanced(advanced(SpeedState(), rolling_slowly, 0.1), at_rest, 1.0)
    assert not speed.at_standstill(state, TUNING)
    state = advanced(state, at_rest, 0.08)
    assert speed.at_standstill(state, TUNING)
    assert not speed.at_standstill(advanced(state, rolling_slowly, DT), TUNING)
    # One wheel that reports nothing does not keep the car from standing, one that turns does.
    assert speed.at_standstill(advanced(state, wheels(0.0, NAN, 0.0, 0.0), DT), TUNING)
    assert not speed.at_standstill(advanced(state, wheels(0.0, 0.2, 0.0, 0.0), DT), TUNING)
    assert not speed.at_standstill(advanced(state, wheels(NAN, NAN, NAN, NAN), DT), TUNING)


rims = st.one_of(st.just(NAN), st.floats(-30.0, 120.0))


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    st.lists(st.tuples(rims, rims, rims, rims), min_size=1, max_size=8),
    st.one_of(st.just(NAN), st.floats(-160.0, 160.0)),
    st.one_of(st.just(NAN), st.floats(-2.0, 2.0)),
    st.sampled_from([NAN, 0.0, 1.0]),
)
def test_where_a_wheel_reports_the_speed_is_a_number(
    rows: list[tuple[float, ...]], ax: float, r: float, flag: float
) -> None:
    state = SpeedState()
    for row in rows:
        inputs = speed.signed_wheels(wheels(*row, brake=flag, reverse=flag))
        corners = speed.corner_speeds(inputs, ALL_DRIVEN, r, NAN, 0.1)
        state = speed.advanced_speed(state, inputs, corners, ALL_DRIVEN, ax, TUNING, DT)
        assert all(math.isfinite(value) for value in state)
        assert state.valid == (0.0 if all(math.isnan(rim) for rim in row) else 1.0)


@pytest.mark.parametrize("ax", [4.5, 9.8, -9.8])
def test_an_accelerometer_that_is_wrong_for_long_does_not_outvote_four_wheels(ax: float) -> None:
    """All four wheels say 0 (or 20 m/s) for half a minute; so does the car."""
    for v in (0.0, 20.0):
        state = advanced(SpeedState(), wheels(v, v, v, v), 30.0, ax=ax, dt_s=0.05)
        assert state.speed_mps == pytest.approx(v, abs=1.0)


def test_locked_wheels_at_speed_are_no_standstill() -> None:
    """From 20 m/s on ice (a_x = -1 m/s^2) all wheels lock: after 1.5 s the car still slides at 18 m/s."""
    state = advanced(SpeedState(), wheels(20.0, 20.0, 20.0, 20.0), 1.0, ax=0.0)
    state = advanced(state, wheels(0.0, 0.0, 0.0, 0.0, brake=1.0), 1.5, ax=-1.0)
    assert state.speed_mps > 5.0
    assert not speed.at_standstill(state, TUNING)


def test_wheels_that_stop_faster_than_a_car_are_doubted_until_they_turn_again() -> None:
    """All four fall from 12 m/s to 0 within one step: dead, not standing, however long it lasts."""
    dead = wheels(0.0, 0.0, 0.0, 0.0)
    state = advanced(SpeedState(), wheels(12.0, 12.0, 12.0, 12.0), 1.0, ax=0.0)
    state = advanced(state, dead, 20.0, ax=0.0)
    assert abs(state.speed_mps) < TUNING.standstill_speed_mps
    assert not speed.at_standstill(state, TUNING)
    # They turn, and come to rest as a car does: believed.
    state = advanced(state, wheels(0.5, 0.5, 0.5, 0.5), 2.0, ax=0.0)
    assert speed.at_standstill(advanced(state, dead, 3.0, ax=0.0), TUNING)


def test_backing_round_a_corner_with_undirected_wheels() -> None:
    """v_x = -3 m/s, r = 0.4: rims that only count up read |v_x -+ r t/2|; the C.G. backs at 3 m/s."""
    r = 0.4
    true = rolling(TUCSON, -3.0, 0.0, r, 0.0)
    inputs = speed.signed_wheels(wheels(*(abs(rim) for rim in true[6:10]), reverse=1.0))
    corners = speed.corner_speeds(inputs, TUCSON, r, 0.0, 0.0)
    state = speed.advanced_speed(SpeedState(), inputs, corners, ALL_DRIVEN, NAN, TUNING, DT)
    assert state.speed_mps == pytest.approx(-3.0, abs=0.01)
    assert speed.wheel_yaw_rate(inputs, TUCSON) == pytest.approx(r, rel=1e-9)
