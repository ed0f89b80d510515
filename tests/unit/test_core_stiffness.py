"""core/stiffness: plants other tyres in a car of its own (two axles, RK4) and has them found."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from core_cases import DEFAULTS, NAN, TUCSON, drive, rk4, straight

from dsz_daemon.core import stiffness
from dsz_daemon.core.parameters import Tuning
from dsz_daemon.core.stiffness import StiffnessState

V, DT = 20.0, 0.01
FRONT, REAR = 62000.0, 68000.0
# Nothing but the car's own equations moves this recording: the noise may be set low.
CLEAN = DEFAULTS._replace(stiffness_noise_density_rad2s=DEFAULTS.stiffness_noise_density_rad2s / 1000.0)


@cache
def recording(front: float, rear: float, hertz: tuple[float, ...], amplitude: float, seconds: float, dt_s: float = DT):
    """(r, a_y, delta) every dt_s of a Tucson with these tyre stiffness factors, steered by sines."""

    def steered(t: float) -> float:
        return amplitude * sum(math.sin(2.0 * math.pi * f * t) for f in hertz)

    def forces(vy: float, r: float, delta: float) -> tuple[float, float]:
        front_slip = math.atan2(vy + 1.149 * r, V) - delta
        rear_slip = math.atan2(vy - 1.491 * r, V)
        return -2.0 * FRONT * front * front_slip, -2.0 * REAR * rear * rear_slip

    def rate(x: np.ndarray) -> np.ndarray:
        vy, r, t = x
        ahead, behind = forces(vy, r, steered(t))
        return np.array([(ahead + behind) / 1673.0 - r * V, (1.149 * ahead - 1.491 * behind) / 2850.0, 1.0])

    x, rows = np.zeros(3), []
    for _ in range(round(seconds / dt_s)):
        x = rk4(rate, x, dt_s, 2)
        rows.append((float(x[1]), sum(forces(x[0], x[1], steered(x[2]))) / 1673.0, steered(x[2])))
    return rows


def adapted(rows, tuning: Tuning, zero_rad: float = 0.0, v: float = V, dt_s: float = DT) -> StiffnessState:
    state = stiffness.initial_stiffness(tuning)
    for r, ay, delta in rows:
        state = stiffness.adapted(state, TUCSON, v, r, ay, delta + zero_rad, tuning, dt_s)
    return state


PLANTED = [(0.85, 1.15), (1.2, 0.9), (0.8, 0.85)]


def found_within_1_percent(front: float, rear: float, dt_s: float) -> None:
    rows = recording(front, rear, (0.2, 0.9), 0.03, 12.0, dt_s)
    state = adapted(rows, CLEAN, zero_rad=0.004, dt_s=dt_s)
    assert stiffness.front_stiffness(state, TUCSON) == pytest.approx(FRONT * front, rel=0.01)
    assert stiffness.rear_stiffness(state, TUCSON) == pytest.approx(REAR * rear, rel=0.01)
    assert state.steering_zero_rad == pytest.approx(0.004, abs=1e-4)


@pytest.mark.parametrize("dt_s", [0.01, 0.02])  # the smoothed a_y, delta and r' must belong to one instant
@pytest.mark.parametrize(("front", "rear"), PLANTED)
def test_planted_stiffnesses_and_the_steerings_zero_are_found(front: float, rear: float, dt_s: float) -> None:
    found_within_1_percent(front, rear, dt_s)


def test_with_the_default_noise_the_truth_lies_within_the_quoted_spread() -> None:
    state = adapted(recording(0.85, 1.15, (0.2, 0.9), 0.03, 30.0), DEFAULTS, zero_rad=-0.003)
    for compliance, variance, true in (
        (state.front, state.p11, 1.0 / 0.85),
        (state.rear, state.p22, 1.0 / 1.15),
        (state.steering_zero_rad, state.p33, -0.003),
    ):
        assert abs(compliance - true) < 2.0 * math.sqrt(variance)
    assert stiffness.front_stiffness(state, TUCSON) < 0.93 * FRONT
    assert stiffness.rear_stiffness(state, TUCSON) > 1.07 * REAR


def test_the_estimate_is_batch_least_squares_with_the_configured_car_as_prior() -> None:
    """Second route: one ridge regression over all excited samples, rows from the axle balances."""
    tau, dt_s = CLEAN.speed_smoothing_s, 0.002
    rows = np.array(recording(0.9, 1.1, (0.2, 0.7), 0.03, 8.0, dt_s))
    smooth = [rows[0]]
    for row in rows[1:]:
        smooth.append(row + (smooth[-1] - row) * math.exp(-dt_s / tau))
    r, ay, delta = np.array(smooth).T
    turning = np.gradient(r, dt_s)
    ahead = (1673.0 * ay * 1.491 + 2850.0 * turning) / 2.64
    behind = (1673.0 * ay * 1.149 - 2850.0 * turning) / 2.64
    excited = (np.abs(ay) > 1.0) & (np.abs(ay) < 4.0)
    H = np.stack([ahead / (2.0 * FRONT), -behind / (2.0 * REAR), np.ones_like(ay)], axis=1)[excited]
    measured = (delta - 2.64 * r / V)[excited]
    information = 1.0 / np.array([0.1, 0.1, CLEAN.steering_offset_spread_rad]) ** 2
    weight = dt_s / CLEAN.stiffness_noise_density_rad2s
    A = weight * H.T @ H + np.diag(information)
    expected = np.linalg.solve(A, weight * H.T @ measured + information * [1.0, 1.0, 0.0])
    state = adapted([tuple(map(float, row)) for row in rows], CLEAN, dt_s=dt_s)
    np.testing.assert_allclose([state.front, state.rear, state.steering_zero_rad], expected, rtol=0.01, atol=1e-5)
    spread = np.sqrt(np.diag(np.linalg.inv(A)))
    np.testing.assert_allclose(np.sqrt([state.p11, state.p22, state.p33]), spread, rtol=0.02)
    correlation = np.linalg.inv(A) / np.outer(spread, spread)
    assert state.p12 / (spread[0] * spread[1]) == pytest.approx(correlation[0, 1], abs=0.02)


def test_axle_forces_are_the_lateral_and_yaw_balances() -> None:
    ahead, behind = stiffness.axle_side_forces(TUCSON, 2.5, -0.6)
    assert ahead + behind == pytest.approx(1673.0 * 2.5, rel=1e-12)
    assert 1.149 * ahead - 1.491 * behind == pytest.approx(2850.0 * -0.6, rel=1e-12)


@pytest.mark.parametrize(("front", "rear", "zero_rad"), [(0.3, 3.0, 0.0), (3.0, 0.3, 0.02), (1.0, 1.0, -0.1)])
def test_the_stiffnesses_stay_within_their_bound(front: float, rear: float, zero_rad: float) -> None:
    """30 % either way, whatever is fed in: a car of another make, a steering zero error of 6 degrees."""
    state = stiffness.initial_stiffness(CLEAN)
    for r, ay, delta in recording(1.0, 1.0, (0.2, 0.9), 0.03, 30.0)[:1000]:
        state = stiffness.adapted(state, TUCSON, V, r * front, ay, delta * rear + zero_rad, CLEAN, DT)
        assert 0.7 - 1e-9 <= stiffness.front_stiffness(state, TUCSON) / FRONT <= 1.3 + 1e-9
        assert 0.7 - 1e-9 <= stiffness.rear_stiffness(state, TUCSON) / REAR <= 1.3 + 1e-9


def learnt_nothing(state: StiffnessState, tuning: Tuning = CLEAN) -> bool:
    return state[:9] == stiffness.initial_stiffness(tuning)[:9]


def test_nothing_is_learnt_without_excitation() -> None:
    gentle = recording(0.8, 1.2, (0.3,), 0.004, 10.0)
    assert max(abs(ay) for _, ay, _ in gentle) < 1.0
    assert learnt_nothing(adapted(gentle, CLEAN))
    violent = [(0.3, 4.5, 0.05)] * 500  # beyond linear tyres
    assert learnt_nothing(adapted(violent, CLEAN))
    brisk = recording(0.85, 1.15, (0.2, 0.9), 0.03, 30.0)
    assert not learnt_nothing(adapted(brisk, CLEAN))
    assert learnt_nothing(adapted(brisk, CLEAN, v=7.9))
    off = CLEAN._replace(adapt_stiffness=False)
    assert learnt_nothing(adapted(brisk, off), off)


def test_a_missing_reading_leaves_the_state_as_it_is() -> None:
    state = adapted(recording(0.85, 1.15, (0.2, 0.9), 0.03, 30.0)[:500], CLEAN)
    for r, ay, delta in ((NAN, 2.0, 0.02), (0.1, NAN, 0.02), (0.1, 2.0, NAN)):
        assert stiffness.adapted(state, TUCSON, V, r, ay, delta, CLEAN, DT) == state


def test_without_any_yaw_rate_the_tyres_are_not_adapted() -> None:
    """One wheel an axle and no gyro_z: the sideways acceleration alone says nothing about compliance."""
    state, _ = drive(
        lambda t: straight(
            20.0,
            gyro_z=NAN,
            wheel_speed_fl=NAN,
            wheel_speed_rl=NAN,
            road_wheel_angle=0.03 * math.sin(2.0 * t),
            accel_y=3.0 * math.sin(2.0 * t),
        ),
        10.0,
    )
    assert learnt_nothing(state.stiffness, DEFAULTS)
