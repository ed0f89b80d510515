"""core/stability: the true loop's polynomial, its slow pole and DC gain, and the same loop through `step`."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_cases import DEFAULTS, TUCSON, drive, straight
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dsz_daemon.config.estimator import EstimatorSettings
from dsz_daemon.core import bicycle, stability
from dsz_daemon.core.outputs import Reason

BODY = (1673.0, 2850.0, 1.149, 1.491, 62000.0, 68000.0)
POLE, MARGIN = DEFAULTS.observer_pole_per_s, DEFAULTS.neutral_steer_margin


def loop(v: float, body: tuple[float, ...] = BODY, pole: float = POLE):
    return bicycle.bicycle_model(*body, v), bicycle.observer_gain(*body, v, pole, MARGIN), v


def kappa(body: tuple[float, ...]) -> float:
    """K4 (1 + K1) / p_o^2 of (8), multiplied out, s^2/m: what the tyres' softness lends to the slow pole."""
    m, _, lf, lr, Cf, Cr = body
    return m * (Cf * lf**2 + Cr * lr**2) / (2.0 * Cf * Cr * (lf + lr) ** 2)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    st.tuples(
        st.floats(700.0, 5000.0),
        st.floats(900.0, 9000.0),
        st.floats(0.8, 2.5),
        st.floats(0.8, 2.5),
        st.floats(3e4, 2e5),
        st.floats(3e4, 2e5),
    ),
    st.floats(3.0, 70.0),
    st.floats(-20.0, -1.0),
    st.floats(1e-3, 2.0),
    st.floats(0.5, 2.0),
)
def test_the_characteristic_polynomial_is_the_one_derived_by_hand(
    body: tuple[float, ...], v: float, p_o: float, g: float, c: float
) -> None:
    """s^3 + s^2 (-2 p_o - g (c-1)) + s (2 p_o g (c-1) + K4 c g v (1 + K1) + p_o^2) + p_o^2 g."""
    assume(abs(bicycle.steer_margin(*body[2:])) > MARGIN)
    model, gain, _ = loop(v, body, p_o)
    matrix = stability.closed_loop_matrix(model, gain, v, g, c)
    linear = 2.0 * p_o * g * (c - 1.0) + gain.k4 * c * g * v * (1.0 + gain.k1) + p_o**2
    np.testing.assert_allclose(
        np.poly(matrix), [1.0, -2.0 * p_o - g * (c - 1.0), linear, p_o**2 * g], rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("c", [1.0, 1.2, 1.5])
@pytest.mark.parametrize("gamma", [1.0 / 300.0, 0.05, 1.0])
def test_the_tucsons_loop_is_hurwitz_over_its_speeds(gamma: float, c: float) -> None:
    for v in np.linspace(3.0, 70.0, 68):
        poles = stability.closed_loop_poles(*loop(float(v)), gamma, c)
        assert poles.real.max() < 0.0
        assert list(poles.real) == sorted(poles.real)


@pytest.mark.parametrize("margin", [-0.04, 0.0, 0.04])
def test_the_switched_loop_of_a_neutral_car_is_hurwitz_too(margin: float) -> None:
    m, Iz, lf, lr, Cf, _ = BODY
    body = (m, Iz, lf, lr, Cf, Cf * lf * (1.0 - margin) / (1.0 + margin) / lr)
    for v in np.linspace(3.0, 70.0, 68):
        model, gain, _ = loop(float(v), body)
        assert gain.k4 == 0.0
        assert stability.closed_loop_poles(model, gain, float(v), 1.0, 1.2).real.max() < 0.0


@pytest.mark.parametrize("c", [0.8, 1.0, 1.1, 1.2, 1.5])
@pytest.mark.parametrize("v", [5.0, 20.0, 60.0])
def test_the_dc_gain_is_minus_c_y(v: float, c: float) -> None:
    """PAPER item 2."""
    assert stability.lateral_dc_gain(*loop(v), 0.02, c) == pytest.approx(-c, rel=1e-9)


@pytest.mark.parametrize("c", [1.0, 1.2])
@pytest.mark.parametrize("v", [10.0, 25.0, 60.0])
def test_the_slow_pole_is_gamma_slowed_by_the_tyres_and_hastened_by_the_observer(v: float, c: float) -> None:
    """-gamma / (1 + c gamma (kappa v + 2 / p_o)), from the polynomial to second order in gamma."""
    for gamma in (1.0 / 300.0, 0.02):
        slow = stability.closed_loop_poles(*loop(v), gamma, c)[-1]
        expected = -gamma / (1.0 + c * gamma * (kappa(BODY) * v + 2.0 / POLE))
        assert slow.imag == 0.0
        # What is left is third order: gamma^2 times squares of terms below 1 s.
        assert slow.real == pytest.approx(expected, rel=2.0 * gamma**2)
    assert kappa(BODY) == pytest.approx(6.63e-3, rel=1e-3)


def test_34_as_printed_is_not_hurwitz_at_speed() -> None:
    """PAPER item 3: K C stands where A - K C belongs. The printed matrix has the trace

    a11 + a22 - 2 p_o + g (1 - c): positive once the car's own damping, which fades with speed, is below 2 |p_o|.
    """
    c, g = 1.2, 0.02
    for v, hurwitz in ((20.0, True), (40.0, False), (60.0, False)):
        A, K, _ = loop(v, pole=-5.0)
        printed = np.array(
            [
                [K.k2 * A.a11 * v, K.k1 + K.k2 * (A.a12 + 1.0) * v, -K.k2],
                [K.k4 * A.a11 * v, K.k3 + K.k4 * (A.a12 + 1.0) * v, -K.k4],
                [0.0, -c * g * v * ((A.a12 - K.k1) - (A.a12 + 1.0)), g * (1.0 - c)],
            ]
        )
        assert np.trace(printed) == pytest.approx(A.a11 + A.a22 + 10.0 + g * (1.0 - c))
        assert bool(np.linalg.eigvals(printed).real.max() < 0.0) is hurwitz
        assert stability.closed_loop_poles(A, K, v, g, c).real.max() < 0.0


# --- the same through step ---------------------------------------------------------------------


def quick(**changed: object) -> EstimatorSettings:
    """Default settings with a lateral gamma of 0.5/s: as printed 1 / window, else sqrt(drift / density)."""
    law = {"window_s": 2.0, "noise_density": 0.02, "drift_density": 0.005, "noise_blocks": 1e6}
    lateral = EstimatorSettings().lateral.model_copy(update=law)
    return EstimatorSettings(lateral=lateral, **changed)


SETTLES = {
    "defaults": ({}, 1.0),
    "as printed": ({"as_printed": True}, 1.2),
    "c_y 1.1": ({"c_y": 1.1}, 1.1),
    "as printed, c_y 1.5": ({"as_printed": True, "c_y": 1.5}, 1.5),
}


@pytest.mark.parametrize("name", SETTLES)
def test_a_lateral_bias_settles_at_c_y_times_itself(name: str) -> None:
    """0.25 m/s^2 straight ahead at 20 m/s; the offset is reading minus truth, so positive."""
    changed, c_y = SETTLES[name]
    _, outputs = drive(straight(20.0, accel_y=0.25), 50.0, dt_s=0.04, tuning=quick(**changed).tuning())
    channel = outputs[-1].accel_y
    assert channel.gate
    assert channel.reason is Reason.NONE
    assert channel.offset == pytest.approx(0.25 * c_y, rel=1e-6)
    assert channel.compensated == pytest.approx(0.25 * (1.0 - c_y), abs=1e-6)


@pytest.mark.parametrize("v", [12.0, 40.0])
def test_step_closes_the_loop_with_the_poles_that_check_tells(v: float) -> None:
    """e_y approaches its end at the slow pole: here 0.5/s bent by -3 to -7 %, not gamma itself."""
    tuning = quick(as_printed=True, c_y=1.0).tuning()
    car = TUCSON._replace(roll_gradient_rad_per_mps2=0.0)  # (4) would add the lean's own loop
    _, outputs = drive(straight(v, accel_y=0.25), 14.0, dt_s=0.01, tuning=tuning, car=car)
    first, later = (0.25 - outputs[round(t / 0.01) - 1].accel_y.offset for t in (7.0, 13.0))
    slow = float(stability.closed_loop_poles(*loop(v), 0.5, 1.0)[-1].real)
    assert math.log(later / first) / 6.0 == pytest.approx(slow, rel=0.005)
    assert abs(slow / -0.5 - 1.0) > 0.02
