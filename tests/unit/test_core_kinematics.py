"""core/kinematics and core/attitude: every sign by motion, against a rigid body of its own.

The body here moves by rotation matrices (right-handed turns about x forward, y left, z up, each
by Rodrigues) and a velocity in its own axes. Its inertial acceleration is the numerical derivative
of R v_b; an accelerometer feels R^T (a + g z). Nothing of (16)-(22) is used to make it.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from core_cases import NAN, TUCSON, G, rk4

from dsz_daemon.core import attitude, kinematics
from dsz_daemon.core.attitude import AttitudeState

X, Y, Z = np.eye(3)


def rodrigues(axis: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def derivative(f: Callable[[float], np.ndarray], t: float, h: float = 1e-3) -> np.ndarray:
    """Five-point central difference."""
    return (8.0 * (f(t + h) - f(t - h)) - (f(t + 2.0 * h) - f(t - 2.0 * h))) / (12.0 * h)


class Body:
    """A random smooth motion that is level, and moves neither up nor down, at t = 0."""

    def __init__(self, seed: int) -> None:
        draw = np.random.default_rng(seed)
        self.roll, self.pitch, self.yaw = draw.uniform(-0.5, 0.5, (3, 3))
        self.vx, self.vy = draw.uniform(-3.0, 3.0, (2, 3))
        self.vx[0] += 20.0
        self.vz = draw.uniform(-2.0, 2.0)

    def attitude(self, t: float) -> np.ndarray:
        yaw = self.yaw @ [1.0, t, t * t]
        pitch, roll = (angle[1:] @ [t, t * t] for angle in (self.pitch, self.roll))
        return rodrigues(Z, yaw) @ rodrigues(Y, pitch) @ rodrigues(X, roll)

    def velocity(self, t: float) -> np.ndarray:
        powers = np.array([1.0, t, t * t])
        return np.array([self.vx @ powers, self.vy @ powers, self.vz * t * t])

    def rates(self, t: float) -> np.ndarray:
        """p, q, r from R^T R' = [omega]x."""
        cross = self.attitude(t).T @ derivative(self.attitude, t)
        return np.array([cross[2, 1], cross[0, 2], cross[1, 0]])

    def specific_force(self, t: float) -> np.ndarray:
        acceleration = derivative(lambda s: self.attitude(s) @ self.velocity(s), t)
        return self.attitude(t).T @ (acceleration + G * Z)


@pytest.mark.parametrize("seed", range(12))
def test_20_to_22_are_what_an_accelerometer_feels_on_a_level_moving_body(seed: int) -> None:
    body = Body(seed)
    p, q, r = body.rates(0.0)
    vx, vy, _ = body.velocity(0.0)
    vx_rate, vy_rate, _ = derivative(body.velocity, 0.0)
    feels = body.specific_force(0.0)
    assert kinematics.longitudinal_reference(vx_rate, r, vy) == pytest.approx(feels[0], abs=1e-6)
    assert kinematics.lateral_reference(vy_rate, r, vx) == pytest.approx(feels[1], abs=1e-6)
    assert kinematics.vertical_reference(q, vx, p, vy) == pytest.approx(feels[2], abs=1e-6)


def test_a_steady_left_turn_by_hand() -> None:
    """15 m/s on R = 50 m, the C.G. sliding outwards at 0.4 m/s: r = 0.3, a_y = 4.5, a_x = +0.12."""
    assert kinematics.lateral_reference(0.0, 0.3, 15.0) == pytest.approx(4.5)
    assert kinematics.longitudinal_reference(0.0, 0.3, -0.4) == pytest.approx(0.12)


def test_a_crest_by_hand() -> None:
    """Over a crest the nose falls, q > 0, and the seat gets lighter: 20 m/s on R = 200 m takes 2 m/s^2."""
    assert kinematics.vertical_reference(0.1, 20.0, 0.0, 0.0) == pytest.approx(G - 2.0)
    # Sliding left while the left side rises presses into the seat.
    assert kinematics.vertical_reference(0.0, 20.0, 0.2, 1.5) == pytest.approx(G + 0.3)


def gravity_reading(roll: float, pitch: float) -> np.ndarray:
    """What a resting accelerometer feels after pitching by `pitch` and rolling by `roll`."""
    return (rodrigues(Y, pitch) @ rodrigues(X, roll)).T @ (G * Z)


def test_signs_of_roll_and_pitch() -> None:
    """Right-handed about x forward: the left side rises. About y left: the nose falls."""
    assert (rodrigues(X, 0.1) @ Y)[2] > 0.0
    assert (rodrigues(Y, 0.1) @ X)[2] < 0.0
    assert gravity_reading(0.1, 0.0)[1] == pytest.approx(G * math.sin(0.1))
    assert gravity_reading(0.0, 0.1)[0] == pytest.approx(-G * math.sin(0.1))


@pytest.mark.parametrize("angle", [-0.4, -0.07, 0.0, 0.12, 0.5])
def test_attitude_from_acceleration_inverts_gravity(angle: float) -> None:
    lateral, longitudinal = 1.7, -0.9
    assert kinematics.roll_from_acceleration(lateral + gravity_reading(angle, 0.0)[1], lateral) == pytest.approx(angle)
    assert kinematics.pitch_from_acceleration(
        longitudinal + gravity_reading(0.0, angle)[0], longitudinal
    ) == pytest.approx(angle)


def test_attitude_from_acceleration_stops_at_30_degrees() -> None:
    assert kinematics.roll_from_acceleration(50.0, 0.0) == pytest.approx(math.pi / 6.0)
    assert kinematics.roll_from_acceleration(-50.0, 0.0) == pytest.approx(-math.pi / 6.0)
    assert kinematics.pitch_from_acceleration(50.0, 0.0) == pytest.approx(-math.pi / 6.0)


@pytest.mark.parametrize(
    ("bank", "grade", "lean", "dive"),
    [(0.0, 0.0, 0.05, 0.0), (0.08, 0.0, 0.0, 0.0), (-0.1, 0.2, 0.06, -0.04), (0.12, -0.3, -0.05, 0.07)],
)
def test_4_takes_out_the_leans_gravity_and_leaves_the_roads(
    bank: float, grade: float, lean: float, dive: float
) -> None:
    """A body that leans on a tilted road reads total gravity; wanted is what it would read upright on it."""
    of_the_tyres = 1.3
    total = gravity_reading(bank + lean, grade + dive)[1]
    expected = of_the_tyres + gravity_reading(bank, grade)[1]
    assert kinematics.road_lateral_acceleration(
        of_the_tyres + total, bank + lean, grade + dive, lean, dive
    ) == pytest.approx(expected, abs=1e-12)


# --- attitude ---------------------------------------------------------------------------------

# Long enough to forget nothing that shows (4e-6 of the angle), short enough for a regular matrix.
ENDLESS = 1e6


@pytest.mark.parametrize(
    "rates", [(0.0, 0.0, 0.6), (0.0, 0.0, -0.4), (2e-4, -3e-4, 0.5), (3e-4, 0.0, 0.0), (0.0, -2e-4, 0.0)]
)
def test_turning_couples_roll_and_pitch_as_gravity_turns_in_the_body(rates: tuple[float, float, float]) -> None:
    """phi' = p + r theta, theta' = q - r phi, from the gravity vector of a body that turns at (p, q, r)."""
    p, q, r = rates
    seconds, steps = 4.0, 40
    omega = np.array(rates)
    start = rodrigues(Y, 1.5e-3) @ rodrigues(X, -2e-3)
    up = rodrigues(omega / np.linalg.norm(omega), -np.linalg.norm(omega) * seconds) @ start.T @ Z
    state = AttitudeState(roll_rad=-2e-3, pitch_rad=1.5e-3)
    for _ in range(steps):
        state = attitude.turned(state, p, q, r, 0.0, 0.0, ENDLESS, seconds / steps)
    # Angles of some 2e-3 rad: the small-angle equations hold to their cube and the window to 4e-6 of them.
    assert state.roll_rad == pytest.approx(math.asin(up[1]), abs=2e-8)
    assert state.pitch_rad == pytest.approx(-math.asin(up[0]), abs=2e-8)


def test_a_car_on_a_banked_circle_sees_the_bank_go_round_as_grade() -> None:
    """By hand: left side 3 deg high, turned left by a quarter circle: now the nose is 3 deg high."""
    state = AttitudeState(roll_rad=math.radians(3.0))
    state = attitude.turned(state, 0.0, 0.0, math.pi / 2.0, NAN, NAN, ENDLESS, 1.0)
    assert state.roll_rad == pytest.approx(0.0, abs=1e-7)
    assert state.pitch_rad == pytest.approx(-math.radians(3.0), rel=1e-5)


def test_total_attitude_is_pulled_to_what_the_accelerometers_say_within_the_window() -> None:
    p, q, r, roll_seen, pitch_seen, window = 0.02, -0.01, 0.3, 0.05, -0.08, 5.0

    def rate(x: np.ndarray) -> np.ndarray:
        return np.array([p + r * x[1] + (roll_seen - x[0]) / window, q - r * x[0] + (pitch_seen - x[1]) / window])

    state = attitude.turned(AttitudeState(roll_rad=0.03, pitch_rad=0.01), p, q, r, roll_seen, pitch_seen, window, 0.7)
    np.testing.assert_allclose(
        [state.roll_rad, state.pitch_rad], rk4(rate, np.array([0.03, 0.01]), 0.7, 400), rtol=1e-9
    )


def test_what_is_missing_counts_as_zero_in_the_attitude() -> None:
    state = AttitudeState(roll_rad=0.03, pitch_rad=0.01)
    missing = attitude.turned(state, NAN, NAN, NAN, NAN, NAN, 5.0, 0.7)
    assert missing == attitude.turned(state, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.7)
    assert missing.roll_rad == pytest.approx(0.03 * math.exp(-0.14), rel=1e-12)


def leaned(lateral: float, longitudinal: float, seconds: float, damping: float = 0.4) -> AttitudeState:
    state = AttitudeState(roll_rad=0.07, pitch_rad=-0.02)
    for _ in range(round(seconds / 0.01)):
        state = attitude.leaned(state, lateral, longitudinal, 0.008, 0.004, 9.4, damping, 0.01)
    return state


def test_suspension_signs_and_steady_gains() -> None:
    """A left turn lifts the left side and braking drops the nose, so readings grow: a_y (1 + g k), a_x (1 + g k)."""
    state = leaned(3.0, -4.0, 30.0)
    assert state.suspension_roll_rad == pytest.approx(0.024, rel=1e-9)
    assert state.suspension_pitch_rad == pytest.approx(0.016, rel=1e-9)
    assert (state.roll_rad, state.pitch_rad) == (0.07, -0.02)
    lateral = 3.0 + gravity_reading(state.suspension_roll_rad, 0.0)[1]
    longitudinal = -4.0 + gravity_reading(0.0, state.suspension_pitch_rad)[0]
    # sin against small angle: 0.024^2 / 6 of the lean's share.
    assert lateral == pytest.approx(3.0 * (1.0 + G * TUCSON.roll_gradient_rad_per_mps2), rel=1e-4)
    assert longitudinal == pytest.approx(-4.0 * (1.0 + G * TUCSON.pitch_gradient_rad_per_mps2), rel=1e-4)


@pytest.mark.parametrize("damping", [0.4, 1.0, 1.5])
def test_suspension_swings_as_a_spring_and_damper(damping: float) -> None:
    w = 9.4

    def rate(x: np.ndarray) -> np.ndarray:
        return np.array([x[1], w * w * (0.024 - x[0]) - 2.0 * damping * w * x[1]])

    state = leaned(3.0, 0.0, 0.2, damping)
    expected = rk4(rate, np.zeros(2), 0.2, 2000)
    np.testing.assert_allclose(
        [state.suspension_roll_rad, state.suspension_roll_rate_radps], expected, rtol=1e-8, atol=1e-12
    )
    pitch = leaned(0.0, -6.0, 0.2, damping)
    np.testing.assert_allclose(
        [pitch.suspension_pitch_rad, pitch.suspension_pitch_rate_radps], expected, rtol=1e-8, atol=1e-12
    )
