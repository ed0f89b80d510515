"""core/motion: which source stands for a quantity, and what of one room reaches the next."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_cases import DEFAULTS, NAN, NOTHING, TUCSON, G, straight

from dsz_daemon.core import motion
from dsz_daemon.core.bicycle import ObserverState
from dsz_daemon.core.motion import Motion
from dsz_daemon.core.state import initial_state
from dsz_daemon.core.stiffness import StiffnessState

STILL = Motion(0.0, 0.0, 0.0, 0.0, 20.0, 0.0, True, False, False)
START = initial_state(DEFAULTS)


def test_the_yaw_rate_is_the_gyros_else_the_wheels_else_the_steerings() -> None:
    turning = NOTHING._replace(wheel_speed_rl=9.5, wheel_speed_rr=10.5)
    assert motion.used_yaw_rate(0.3, turning, TUCSON, 10.0, 0.05) == 0.3
    assert motion.used_yaw_rate(NAN, turning, TUCSON, 10.0, 0.05) == pytest.approx(1.0 / 1.586)
    # A car that rolls where its front wheels point: r = v delta / L.
    assert motion.used_yaw_rate(NAN, NOTHING, TUCSON, 10.0, 0.05) == pytest.approx(0.5 / 2.64)
    assert math.isnan(motion.used_yaw_rate(NAN, NOTHING, TUCSON, 10.0, NAN))


def test_the_steering_is_the_sensors_else_the_wheels() -> None:
    turning = NOTHING._replace(wheel_speed_rl=9.9, wheel_speed_rr=10.1)
    assert motion.used_steering(turning._replace(road_wheel_angle=-0.1), TUCSON, 10.0, DEFAULTS) == -0.1
    assert motion.used_steering(turning, TUCSON, 10.0, DEFAULTS) == pytest.approx(2.64 * 0.2 / 1.586 / 10.0)
    # Backwards the same difference means the other way; near rest it means nothing.
    assert motion.used_steering(turning, TUCSON, -10.0, DEFAULTS) == pytest.approx(-2.64 * 0.2 / 1.586 / 10.0)
    assert math.isnan(motion.used_steering(turning, TUCSON, 2.9, DEFAULTS))
    assert math.isnan(motion.used_steering(NOTHING, TUCSON, 10.0, DEFAULTS))


def test_references_of_a_car_that_slides_brakes_turns_rolls_and_pitches() -> None:
    """v_y = v tan(beta) along a path, differentiated numerically; then (20)-(22) by hand."""
    v, v_rate, beta, beta_rate, h = 18.0, -3.0, -0.06, 0.25, 1e-6
    p, q, r = 0.11, -0.07, 0.4

    def vy(t: float) -> float:
        return (v + v_rate * t) * math.tan(beta + beta_rate * t)

    here = STILL._replace(p=p, q=q, r=r, v=v, v_rate=v_rate)
    found = motion.reference_accelerations(here, ObserverState(beta, 9.9, beta_rate))
    expected = (v_rate - r * vy(0.0), (vy(h) - vy(-h)) / (2.0 * h) + r * v, -q * v + p * vy(0.0) + G)
    np.testing.assert_allclose(found, expected, rtol=1e-7)


def test_references_without_some_gyros_or_without_speed() -> None:
    observer = ObserverState(-0.05, 0.3, 0.0)
    no_roll_and_pitch = motion.reference_accelerations(STILL._replace(p=NAN, q=NAN, r=0.3), observer)
    assert no_roll_and_pitch[2] == pytest.approx(G)
    no_yaw = motion.reference_accelerations(STILL._replace(v_rate=1.5, r=NAN), observer)
    assert no_yaw[0] == 1.5
    assert math.isnan(no_yaw[1])
    assert all(math.isnan(a) for a in motion.reference_accelerations(STILL._replace(speed_valid=False), observer))


def test_the_observer_uses_the_adapted_stiffnesses() -> None:
    """Compliances 25 % up in front and 20 % down at the rear are another car: C_f / 1.25, C_r / 0.8."""
    here = STILL._replace(r=0.2, delta=0.03)
    adapted = START._replace(stiffness=StiffnessState(front=1.25, rear=0.8))
    other = TUCSON._replace(
        front_cornering_stiffness_n_per_rad=62000.0 / 1.25, rear_cornering_stiffness_n_per_rad=68000.0 / 0.8
    )
    found = motion.observed_motion(TUCSON, DEFAULTS, adapted, here, 3.0, 0.02)
    assert found == pytest.approx(motion.observed_motion(other, DEFAULTS, START, here, 3.0, 0.02), rel=1e-12)
    assert found != pytest.approx(motion.observed_motion(TUCSON, DEFAULTS, START, here, 3.0, 0.02), rel=1e-3)


@pytest.mark.parametrize("changed", [{"v": 2.9}, {"v": -2.0}, {"v": -20.0}, {"r": NAN}, {"ay": NAN}], ids=str)
def test_where_the_observer_can_not_work_the_car_rolls_where_its_wheels_point(changed: dict[str, float]) -> None:
    """tan(beta) = l_r tan(delta) / L and r = v delta / L, both for the sign of v."""
    case = {"v": 20.0, "r": 0.2, "ay": 3.0} | changed
    here = STILL._replace(v=case["v"], r=case["r"], delta=0.1)
    found = motion.observed_motion(TUCSON, DEFAULTS, START, here, case["ay"], 0.02)
    assert math.tan(found.sideslip_rad) == pytest.approx(1.491 / 2.64 * math.tan(0.1), rel=1e-12)
    assert found.yaw_rate_radps == pytest.approx(case["v"] * 0.1 / 2.64, rel=1e-12)
    assert found.sideslip_rate_radps == 0.0


def test_without_steering_the_observer_says_straight_ahead() -> None:
    found = motion.observed_motion(TUCSON, DEFAULTS, START, STILL._replace(delta=NAN), 3.0, 0.02)
    assert found == ObserverState(0.0, 0.0, 0.0)


def test_the_motion_takes_the_gyros_with_what_is_known_of_their_offsets() -> None:
    known = START._replace(
        gyro_x=START.gyro_x._replace(correction=0.01),
        gyro_y=START.gyro_y._replace(correction=-0.02),
        gyro_z=START.gyro_z._replace(correction=0.03),
    )
    found, _ = motion.moved(TUCSON, DEFAULTS, known, straight(20.0, gyro_x=0.1, gyro_y=0.2, gyro_z=0.3), 0.01)
    assert (found.p, found.q, found.r) == pytest.approx((0.11, 0.18, 0.33))
    assert found.v == pytest.approx(20.0, abs=0.3)  # the rims, carried to the C.G. with r = 0.33
    assert found.speed_valid
    assert not found.standstill


def test_wheels_that_only_turn_do_not_slip_and_one_that_spins_does() -> None:
    """R = 20 m at 8 m/s: rims differ by 0.6 m/s, the C.G.'s speeds told by them do not."""
    half = 0.5 * 0.4 * 1.585
    turning = straight(8.0, gyro_z=0.4)._replace(
        wheel_speed_fl=8.0 - half, wheel_speed_fr=8.0 + half, wheel_speed_rl=8.0 - half, wheel_speed_rr=8.0 + half
    )
    assert not motion.moved(TUCSON, DEFAULTS, START, turning, 0.01)[0].slip
    assert motion.moved(TUCSON, DEFAULTS, START, turning._replace(wheel_speed_fl=9.0), 0.01)[0].slip
