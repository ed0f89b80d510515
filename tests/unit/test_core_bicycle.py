"""core/bicycle, (1)-(9): every matrix from Newton's equations of the two axles, poles from A - K C."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from core_cases import DEFAULTS, TUCSON, rk4
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dsz_daemon.core import bicycle
from dsz_daemon.core.bicycle import ObserverGain, ObserverState

MARGIN = DEFAULTS.neutral_steer_margin
TUCSON_BODY = (1673.0, 2850.0, 1.149, 1.491, 62000.0, 68000.0)
OVERSTEER_BODY = (1300.0, 1900.0, 1.45, 1.05, 70000.0, 60000.0)

bodies = st.tuples(
    st.floats(500.0, 40000.0),
    st.floats(300.0, 200000.0),
    st.floats(0.5, 5.0),
    st.floats(0.5, 5.0),
    st.floats(1e4, 6e5),
    st.floats(1e4, 6e5),
)
speeds = st.floats(3.0, 80.0)


def newton(body: tuple[float, ...], v: float, beta: float, r: float, delta: float) -> tuple[float, float, float]:
    """beta', r' and a_y of a rigid car on two axles whose four tyres make F = -C alpha each."""
    m, Iz, lf, lr, Cf, Cr = body
    vx, vy = v, v * math.tan(beta)
    front_slip = math.atan2(vy + lf * r, vx) - delta
    rear_slip = math.atan2(vy - lr * r, vx)
    front = 2.0 * -Cf * front_slip * math.cos(delta)
    rear = 2.0 * -Cr * rear_slip
    ay = (front + rear) / m
    # a_y = v_y' + r v_x, (2), and v_y = v tan(beta) at constant v.
    return (ay - r * vx) / v * math.cos(beta) ** 2, (lf * front - lr * rear) / Iz, ay


def jacobian(body: tuple[float, ...], v: float) -> np.ndarray:
    """d(beta', r', a_y) / d(beta, r, delta) at straight running, by central differences."""
    h = 1e-5
    columns = [
        (np.array(newton(body, v, *(h * e))) - np.array(newton(body, v, *(-h * e)))) / (2.0 * h) for e in np.eye(3)
    ]
    return np.array(columns).T


@pytest.mark.parametrize("body", [TUCSON_BODY, OVERSTEER_BODY])
@pytest.mark.parametrize("v", [5.0, 20.0, 45.0])
def test_1_and_3_are_newtons_equations(body: tuple[float, ...], v: float) -> None:
    J = jacobian(body, v)
    model = bicycle.bicycle_model(*body, v)
    np.testing.assert_allclose([[model.a11, model.a12], [model.a21, model.a22]], J[:2, :2], rtol=1e-6)
    np.testing.assert_allclose([model.b1, model.b2], J[:2, 2], rtol=1e-6)
    for beta, r, delta in ((0.01, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.03), (-0.02, 0.3, 0.05)):
        assert bicycle.lateral_acceleration(model, v, beta, r, delta) == pytest.approx(
            float(J[2] @ [beta, r, delta]), rel=1e-6, abs=1e-9
        )


def test_3_is_the_axle_forces_over_the_mass() -> None:
    m, Iz, lf, lr, Cf, Cr = TUCSON_BODY
    v, beta, r, delta = 23.0, -0.013, 0.21, 0.034
    forces = -2.0 * Cf * (beta + lf * r / v - delta) - 2.0 * Cr * (beta - lr * r / v)
    model = bicycle.bicycle_model(m, Iz, lf, lr, Cf, Cr, v)
    assert bicycle.lateral_acceleration(model, v, beta, r, delta) == pytest.approx(forces / m, rel=1e-12)


def error_matrix(body: tuple[float, ...], v: float, gain: ObserverGain) -> np.ndarray:
    """A - K C with C of (5), by numpy."""
    model = bicycle.bicycle_model(*body, v)
    A = np.array([[model.a11, model.a12], [model.a21, model.a22]])
    C = np.array([[0.0, 1.0], [model.a11 * v, (model.a12 + 1.0) * v]])
    return A - np.array([[gain.k1, gain.k2], [gain.k3, gain.k4]]) @ C


@settings(max_examples=150, deadline=None, derandomize=True)
@given(bodies, speeds, st.floats(-50.0, -1.0))
def test_both_observer_poles_lie_at_p_o_for_any_car(body: tuple[float, ...], v: float, pole: float) -> None:
    """(s - p_o)^2 to 1e-9 of its coefficients.

    The poles themselves can't be asked to 1e-9 in doubles: a double root splits by the root of the
    rounding, some 1e-8. The exact test below has no rounding.
    """
    assume(abs(bicycle.steer_margin(*body[2:])) > MARGIN)
    # 1 + K1 must stand clear of K1's rounding, or (8) has lost its digits before anyone uses it.
    _m, Iz, lf, lr, Cf, Cr = body
    assume(abs(Iz * (Cf * lf - Cr * lr) * pole**2 / (2.0 * Cf * Cr * (lf + lr) ** 2)) > 1e-4)
    M = error_matrix(body, v, bicycle.observer_gain(*body, v, pole, MARGIN))
    np.testing.assert_allclose(np.poly(M), [1.0, -2.0 * pole, pole * pole], rtol=1e-9)


class Exact(Fraction):
    """A rational number that stays rational when a float meets it (a float is one, too)."""

    def __new__(cls, value: object = 0) -> Exact:
        return super().__new__(cls, Fraction(value))  # type: ignore[arg-type]

    def __add__(self, other):
        return Exact(Fraction.__add__(self, Fraction(other)))

    def __sub__(self, other):
        return Exact(Fraction.__sub__(self, Fraction(other)))

    def __rsub__(self, other):
        return Exact(Fraction.__sub__(Fraction(other), self))

    def __mul__(self, other):
        return Exact(Fraction.__mul__(self, Fraction(other)))

    def __truediv__(self, other):
        return Exact(Fraction.__truediv__(self, Fraction(other)))

    def __rtruediv__(self, other):
        return Exact(Fraction.__truediv__(Fraction(other), self))

    def __pow__(self, power, _modulus=None):
        return Exact(Fraction.__pow__(self, power))

    def __neg__(self):
        return Exact(Fraction.__neg__(self))

    __radd__, __rmul__ = __add__, __mul__


@settings(max_examples=60, deadline=None, derandomize=True)
@given(bodies, speeds, st.floats(-100.0, -0.1))
def test_the_characteristic_polynomial_is_exactly_s_minus_p_o_squared(
    body: tuple[float, ...], v: float, pole: float
) -> None:
    """(8) in rational arithmetic: no tolerance at all, so both poles are p_o for any car."""
    exact = tuple(Exact(value) for value in body)
    assume(abs(bicycle.steer_margin(*exact[2:])) > MARGIN)
    speed, p_o = Exact(v), Exact(pole)
    gain = bicycle.observer_gain(*exact, speed, p_o, MARGIN)
    M = bicycle.observer_matrix(bicycle.bicycle_model(*exact, speed), gain, speed)
    assert M.m11 + M.m22 == 2 * p_o
    assert M.m11 * M.m22 - M.m12 * M.m21 == p_o * p_o


def test_8_as_printed() -> None:
    m, Iz, lf, lr, Cf, Cr = TUCSON_BODY
    gain = bicycle.observer_gain(*TUCSON_BODY, 20.0, -5.0, MARGIN)
    assert gain.k1 == pytest.approx(Iz * (Cf * lf - Cr * lr) * 25.0 / (2.0 * Cf * Cr * 2.64**2) - 1.0, rel=1e-12)
    assert gain.k2 == pytest.approx(1.0 / 20.0, rel=1e-15)
    assert gain.k3 == 10.0
    assert gain.k4 == pytest.approx(m * (Cf * lf**2 + Cr * lr**2) / (Iz * (Cf * lf - Cr * lr)), rel=1e-12)


def neutral(body: tuple[float, ...], margin: float) -> tuple[float, ...]:
    """The same car with C_r such that (C_f l_f - C_r l_r) / (C_f l_f + C_r l_r) = margin."""
    m, Iz, lf, lr, Cf, _ = body
    return m, Iz, lf, lr, Cf, Cf * lf * (1.0 - margin) / (1.0 + margin) / lr


@settings(max_examples=150, deadline=None, derandomize=True)
@given(bodies, speeds, st.floats(-20.0, -0.5), st.floats(-0.999, 0.999))
def test_the_switched_observer_is_stable_near_neutral_steer(
    body: tuple[float, ...], v: float, pole: float, share: float
) -> None:
    car = neutral(body, share * MARGIN)
    gain = bicycle.observer_gain(*car, v, pole, MARGIN)
    assert (gain.k2, gain.k4) == (0.0, 0.0)
    assert gain.k3 == -2.0 * pole
    assert np.linalg.eigvals(error_matrix(car, v, gain)).real.max() < 0.0


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_switch_is_at_the_margin_on_both_sides(side: float) -> None:
    off = bicycle.observer_gain(*neutral(TUCSON_BODY, side * 0.99 * MARGIN), 20.0, -5.0, MARGIN)
    on = bicycle.observer_gain(*neutral(TUCSON_BODY, side * 1.01 * MARGIN), 20.0, -5.0, MARGIN)
    assert off.k4 == 0.0 != on.k4
    assert math.copysign(1.0, on.k4) == side  # K4 has the sign of C_f l_f - C_r l_r
    assert bicycle.steer_margin(*neutral(TUCSON_BODY, side * 0.03)[2:]) == pytest.approx(side * 0.03, rel=1e-12)


@pytest.mark.parametrize(
    ("body", "v"), [(TUCSON_BODY, 20.0), (OVERSTEER_BODY, 12.0), (neutral(TUCSON_BODY, 0.01), 25.0)]
)
def test_one_observed_step_is_fine_runge_kutta_of_6(body: tuple[float, ...], v: float) -> None:
    """(6) as it stands: x^' = A x^ + B u + K (y - C x^ - D u), inputs held over the step."""
    r, ay, delta, dt = 0.17, 2.9, 0.021, 0.05
    model = bicycle.bicycle_model(*body, v)
    gain = bicycle.observer_gain(*body, v, -5.0, MARGIN)
    A = np.array([[model.a11, model.a12], [model.a21, model.a22]])
    C = np.array([[0.0, 1.0], [model.a11 * v, (model.a12 + 1.0) * v]])
    B, D = np.array([model.b1, model.b2]), np.array([0.0, model.b1 * v])
    K = np.array([[gain.k1, gain.k2], [gain.k3, gain.k4]])

    def rate(x: np.ndarray) -> np.ndarray:
        return A @ x + B * delta + K @ (np.array([r, ay]) - C @ x - D * delta)

    start = np.array([-0.02, 0.1])
    state = bicycle.observed(ObserverState(*start, 9.9), model, gain, v, r, ay, delta, dt)
    np.testing.assert_allclose(state[:2], rk4(rate, start, dt, 500), rtol=1e-9, atol=1e-12)
    assert state.sideslip_rate_radps == pytest.approx(rate(start)[0], rel=1e-12)


def test_the_observer_finds_a_simulated_cars_sideslip() -> None:
    """A steady left turn of Newton's car: sideslip and yaw rate of the observer settle on its own."""
    v, delta = 20.0, 0.02
    J = jacobian(TUCSON_BODY, v)
    beta, r = np.linalg.solve(J[:2, :2], -J[:2, 2] * delta)
    ay = float(J[2] @ [beta, r, delta])
    assert ay == pytest.approx(r * v, rel=1e-6)
    model = bicycle.bicycle_model(*TUCSON_BODY, v)
    gain = bicycle.observer_gain(*TUCSON_BODY, v, -5.0, MARGIN)
    state = ObserverState()
    for _ in range(500):
        state = bicycle.observed(state, model, gain, v, r, ay, delta, 0.02)
    assert state.sideslip_rad == pytest.approx(beta, rel=1e-5)
    assert state.yaw_rate_radps == pytest.approx(r, rel=1e-5)
    assert state.sideslip_rate_radps == pytest.approx(0.0, abs=1e-6)


def test_9_and_its_derivative() -> None:
    """v_y = v tan(beta), differentiated numerically along a path."""
    v, v_rate, beta, beta_rate, h = 18.0, -2.5, 0.11, 0.4, 1e-6
    assert bicycle.lateral_velocity(18.0, math.atan(0.25)) == pytest.approx(4.5, rel=1e-12)
    ahead, behind = (
        (v + s * h * v_rate) * math.sin(beta + s * h * beta_rate) / math.cos(beta + s * h * beta_rate)
        for s in (1.0, -1.0)
    )
    assert bicycle.lateral_velocity_rate(v, v_rate, beta, beta_rate) == pytest.approx(
        (ahead - behind) / (2.0 * h), rel=1e-7
    )


def test_rolling_sideslip_puts_both_axles_on_their_wheels_headings() -> None:
    """A rigid body: with the C.G. moving at atan(v_y/v_x) = beta and yawing, no axle moves sideways."""
    lf, lr, delta, vx = 1.149, 1.491, 0.35, 3.0
    beta = bicycle.kinematic_sideslip(lf, lr, delta)
    vy = vx * math.tan(beta)
    yaw = vy / lr  # the rear axle has no sideways speed: v_y - l_r r = 0
    assert math.atan2(vy + lf * yaw, vx) == pytest.approx(delta, rel=1e-12)
    assert TUCSON.wheelbase_m == pytest.approx(lf + lr)
