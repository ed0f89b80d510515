"""core/curve: a curve inside the steering gate is no straight road, and what looks like one is no curve."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_cases import DEFAULTS, DEG, NAN, TUCSON, drive, law, rk4, straight

from dsz_daemon.config.estimator import EstimatorSettings
from dsz_daemon.core import bicycle, curve, zeroing
from dsz_daemon.core.curve import CurveState
from dsz_daemon.core.outputs import ChannelState, Reason
from dsz_daemon.core.parameters import Inputs
from dsz_daemon.core.zeroing import ZeroingState

OFFSET = 0.8 * DEG


def turning(radius_m: float, v: float, zero: float = 0.0, radii: float = 0.0) -> Inputs:
    """A steady curve (inf: straight) by the textbook's understeer gradient; steering zero and radii may be off."""
    r = v / radius_m
    L, half = TUCSON.wheelbase_m, 0.5 * r * TUCSON.rear_track_m
    front, rear = (
        0.5 * TUCSON.mass_kg * TUCSON.cg_to_rear_axle_m / L / TUCSON.front_cornering_stiffness_n_per_rad,
        0.5 * TUCSON.mass_kg * TUCSON.cg_to_front_axle_m / L / TUCSON.rear_cornering_stiffness_n_per_rad,
    )
    return straight(
        v, gyro_z=r + OFFSET, accel_y=v * r, road_wheel_angle=L / radius_m + (front - rear) * v * r + zero
    )._replace(
        wheel_speed_fl=v - half,
        wheel_speed_fr=v + half,
        wheel_speed_rl=v - half,
        wheel_speed_rr=(v + half) * (1.0 + radii),
    )


def test_the_steady_turn_is_where_the_car_comes_to_rest() -> None:
    """Against (1) integrated for 20 s, and the understeer gradient's r = v delta / (L + K v^2)."""
    v, delta = 30.0, 0.37 * DEG
    model = bicycle.bicycle_model(*TUCSON[:4], *TUCSON[6:8], v)
    A = np.array([[model.a11, model.a12], [model.a21, model.a22]])
    end = rk4(lambda x: A @ x + np.array([model.b1, model.b2]) * delta, np.zeros(2), 20.0, 20_000)
    assert bicycle.steady_yaw_rate(model, delta) == pytest.approx(end[1], rel=1e-9)
    there = turning(800.0, v)
    assert bicycle.steady_yaw_rate(model, there.road_wheel_angle) == pytest.approx(v / 800.0, rel=1e-9)


def test_a_car_that_spins_has_no_steady_turn() -> None:
    """Oversteer beyond the critical speed sqrt(-L / K): the model diverges."""
    loose = bicycle.bicycle_model(1673.0, 2850.0, 1.149, 1.491, 68000.0, 40000.0, 60.0)
    assert math.isnan(bicycle.steady_yaw_rate(loose, 0.01))
    assert (
        curve.agreed_yaw_rate(
            CurveState(0.01, 0.05), TUCSON._replace(rear_cornering_stiffness_n_per_rad=40000.0), 60.0, DEFAULTS
        )
        == 0.0
    )


def steady(inputs: Inputs) -> CurveState:
    return CurveState(inputs.road_wheel_angle, (inputs.wheel_speed_rr - inputs.wheel_speed_rl) / TUCSON.rear_track_m)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_neither_witness_says_less(side: float) -> None:
    there = steady(turning(side * 800.0, 30.0))
    rate = side * 30.0 / 800.0
    assert curve.agreed_yaw_rate(there, TUCSON, 30.0, DEFAULTS) == pytest.approx(rate, rel=1e-6)
    less = there._replace(wheels_radps=0.6 * there.wheels_radps)
    assert curve.agreed_yaw_rate(less, TUCSON, 30.0, DEFAULTS) == pytest.approx(0.6 * rate, rel=1e-6)
    more = there._replace(wheels_radps=1.7 * there.wheels_radps)
    assert curve.agreed_yaw_rate(more, TUCSON, 30.0, DEFAULTS) == pytest.approx(rate, rel=1e-6)
    against = there._replace(wheels_radps=-there.wheels_radps)
    assert curve.agreed_yaw_rate(against, TUCSON, 30.0, DEFAULTS) == 0.0
    assert curve.agreed_yaw_rate(there, TUCSON, 0.9 * DEFAULTS.observer_min_speed_mps, DEFAULTS) == 0.0


def test_the_steering_counts_beyond_its_zero_error() -> None:
    zero = DEFAULTS.yaw_steering_zero_rad
    model = bicycle.bicycle_model(*TUCSON[:4], *TUCSON[6:8], 25.0)
    for angle, share in ((0.9 * zero, 0.0), (1.5 * zero, 0.5), (2.0 * zero, 1.0), (3.0 * zero, 1.0)):
        told = curve.agreed_yaw_rate(CurveState(angle, 1.0), TUCSON, 25.0, DEFAULTS)
        assert told == pytest.approx(share * bicycle.steady_yaw_rate(model, angle), rel=1e-9)
    exact = DEFAULTS._replace(yaw_steering_zero_rad=0.0)
    told = curve.agreed_yaw_rate(CurveState(0.1 * zero, 1.0), TUCSON, 25.0, exact)
    assert told == pytest.approx(bicycle.steady_yaw_rate(model, 0.1 * zero), rel=1e-9)


def test_the_witnesses_are_smoothed_and_a_missing_one_tells_nothing() -> None:
    state = CurveState()
    there = turning(800.0, 30.0)
    for _ in range(100):
        state = curve.advanced_curve(state, TUCSON, there, there.road_wheel_angle, 0.02)
    risen = 1.0 - math.exp(-1.0)  # 2 s of a time constant of 2 s
    assert state.road_wheel_angle_rad == pytest.approx(risen * there.road_wheel_angle, rel=1e-9)
    assert state.wheels_radps == pytest.approx(risen * 30.0 / 800.0, rel=1e-6)
    blind = there._replace(wheel_speed_fl=NAN, wheel_speed_rl=NAN)
    assert curve.advanced_curve(state, TUCSON, blind, NAN, 0.02) == CurveState(0.0, 0.0)


def test_what_a_target_neglects_is_averaged_weighed_and_published() -> None:
    """White noise only: the mean of 1 unit over t, with a density of S + n^2 T, has the variance (S + n^2 T) / t."""
    tuning = law(neglect_s=10.0, largest_offset=50.0)
    state = ZeroingState(0.0, 1e12)
    for _ in range(1000):
        state = zeroing.zeroed(state, 1.0, False, tuning, False, 5.0, 0.01, 1.0, 3.0)
    assert state.neglected == pytest.approx(3.0, rel=1e-6)
    assert state.variance == pytest.approx((1.0 + 9.0 * 10.0) / 10.0, rel=1e-6)
    assert zeroing.offset_std(state, tuning) == pytest.approx(math.sqrt(9.1 + 9.0), rel=1e-6)
    # As much again where nothing is neglected weighs 91 times as much.
    for _ in range(1000):
        state = zeroing.zeroed(state, 0.0, False, tuning, False, 5.0, 0.01)
    assert state.neglected == pytest.approx(3.0 / 92.0, rel=1e-6)
    assert state.correction == pytest.approx(1.0 / 92.0, rel=1e-6)
    assert zeroing.held(state, tuning, 1.0).neglected == state.neglected
    for sign in (1.0, -1.0):
        absurd = zeroing.zeroed(state, 0.0, False, tuning, False, 5.0, 1e9, 1.0, sign * 1e6)
        assert absurd.neglected == pytest.approx(sign * 50.0, rel=1e-3)


def test_a_long_curve_is_not_learnt_as_an_offset() -> None:
    """150 s of R = 800 m from the first frame on: the spread covers it, a_y waits, and a straight minute mends it."""
    state, outputs = drive(turning(800.0, 30.0), 150.0)
    last = outputs[-1].gyro_z
    assert last.state is ChannelState.LEARNING
    assert abs(last.offset - OFFSET) < 2.0 * last.offset_std
    assert last.offset_std > 1.0 * DEG
    assert {output.accel_y.reason for output in outputs[200:]} == {Reason.SETTLING}
    _, after = drive(turning(math.inf, 30.0), 60.0, state=state)
    last = after[-1].gyro_z
    assert abs(last.offset - OFFSET) < 0.15 * DEG
    assert abs(last.offset - OFFSET) < 2.0 * last.offset_std


def test_as_printed_the_curve_is_learnt() -> None:
    printed = EstimatorSettings(as_printed=True).tuning()
    state, outputs = drive(turning(800.0, 30.0), 150.0, tuning=printed)
    assert state.gyro_z.neglected == 0.0
    assert outputs[-1].gyro_z.offset == pytest.approx((OFFSET + 30.0 / 800.0) * (1.0 - math.exp(-1.0)), rel=1e-3)


@pytest.mark.parametrize(
    "looks_like_one",
    [
        {"zero": 0.3 * DEG},  # 5 deg at the hand wheel
        {"radii": 0.004},
        {"zero": 0.3 * DEG, "radii": -0.004},
        {"zero": 0.09 * DEG, "radii": 0.004},
    ],
)
def test_one_witness_alone_is_no_curve(looks_like_one: dict[str, float]) -> None:
    state, outputs = drive(turning(math.inf, 30.0, **looks_like_one), 60.0)
    assert state.gyro_z.neglected == 0.0
    assert outputs[-1].gyro_z.offset == pytest.approx(OFFSET, abs=0.01 * DEG)


def test_a_standing_car_neglects_nothing() -> None:
    """What a standstill has taught outweighs the curve after it, and the wheel turned at rest is no curve."""
    taught, _ = drive(straight(0.0, gyro_z=OFFSET, road_wheel_angle=0.3), 30.0)
    assert taught.gyro_z.neglected == 0.0
    _, after = drive(turning(800.0, 30.0), 20.0, state=taught)
    assert after[-1].gyro_z.offset == pytest.approx(OFFSET, abs=0.05 * DEG)
    # It brakes to a stop from a curve: what was neglected on the way is told by the gyro at rest.
    curved, _ = drive(turning(800.0, 30.0), 20.0)
    slowed, _ = drive(lambda t: turning(800.0, max(0.0, 30.0 - 5.0 * t))._replace(accel_x=-5.0), 6.0, state=curved)
    assert slowed.gyro_z.neglected > 0.5 * DEG
    stopped, _ = drive(straight(0.0, gyro_z=OFFSET, road_wheel_angle=0.37 * DEG), 30.0, state=slowed)
    assert abs(stopped.gyro_z.neglected) < 0.02 * DEG
