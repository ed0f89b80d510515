"""core/gates: tau of (29) on signals of known variance, Table 3 one condition at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_cases import DEFAULTS, DEG, NAN

from dsz_daemon.core import gates
from dsz_daemon.core.gates import TransientState
from dsz_daemon.core.outputs import Reason

P, Q, R, AX, AY, AZ, DELTA, SPEED = range(8)
SCALES = (1.0 * DEG, 1.0 * DEG, 1.0 * DEG, 0.3, 0.3, 0.5, 0.3 * DEG)
QUIET = (0.0,) * 8


def one_signal(i: int, value: float, others: float = 0.0) -> tuple[float, ...]:
    return tuple(value if k == i else others for k in range(8))


def watched(rows: np.ndarray, tuning=DEFAULTS, dt_s: float = 0.01) -> TransientState:
    state = TransientState()
    for row in rows:
        state = gates.watched(state, tuple(row), tuning, dt_s)
    return state


# --- (29) --------------------------------------------------------------------------------------


@pytest.mark.parametrize("i", range(8))
def test_a_sine_scatters_by_half_its_amplitude_squared(i: int) -> None:
    """2 Hz in a window of 20 s, unsmoothed: A^2 / 2 whatever the mean, and nothing in the other signals."""
    tuning = DEFAULTS._replace(tau_window_s=20.0, tau_smoothing_s=1e-4)
    t = np.arange(0.0, 120.0, 0.02)
    rows = np.zeros((len(t), 8))
    rows[:, i] = 9.8 + 0.4 * np.sin(2.0 * np.pi * 2.0 * t)
    state = watched(rows, tuning, 0.02)
    for k in range(8):
        assert gates.window_variance(state, k) == pytest.approx(0.08 if k == i else 0.0, rel=0.02, abs=1e-9)
    if i < gates.SIGNALS:
        assert gates.transient(state, tuning) == pytest.approx(0.08 / (7.0 * SCALES[i] ** 2), rel=0.02)
    else:
        assert gates.transient(state, tuning) == pytest.approx(0.0, abs=1e-9)


def test_tau_is_one_where_all_seven_scatter_by_their_scale() -> None:
    square = tuple(scale**2 + 4.0 for scale in SCALES)
    state = TransientState((0.0,) * 8, (2.0,) * 8, (*square, 4.0), (10.0,) * 8)
    assert gates.transient(state, DEFAULTS) == pytest.approx(1.0, rel=1e-9)


def test_steering_and_speed_have_their_own_variances() -> None:
    state = TransientState((0.0,) * 8, (1.0,) * 8, (1.0,) * 6 + (1.5, 1.25), (10.0,) * 8)
    assert gates.steering_variance(state) == pytest.approx(0.5)
    assert gates.speed_variance(state) == pytest.approx(0.25)


def test_the_window_is_an_exponentially_weighted_mean_square_about_the_mean() -> None:
    """Second route: weights and sums in numpy, smoothing 0.25 s, window 1 s, at 100 Hz."""
    x = np.random.default_rng(3).normal(0.7, 2.0, 500)
    a, b = math.exp(-0.01 / 0.25), math.exp(-0.01 / 1.0)
    n = np.arange(len(x))
    smoothed = np.array([a**k * x[0] + (1.0 - a) * np.sum(x[1 : k + 1] * a ** (k - n[1 : k + 1])) for k in n])
    weights = np.where(n == 0, b ** (len(x) - 1), (1.0 - b) * b ** (len(x) - 1.0 - n))
    assert weights.sum() == pytest.approx(1.0)
    mean = np.sum(weights * smoothed)
    state = watched(np.outer(x, one_signal(AY, 1.0)))
    assert gates.window_variance(state, AY) == pytest.approx(np.sum(weights * (smoothed - mean) ** 2), rel=1e-9)


def test_a_missing_signal_leaves_its_window_still_and_the_others_running() -> None:
    before = watched(np.random.default_rng(4).normal(0.0, 1.0, (300, 8)))
    after = gates.watched(before, one_signal(AX, NAN, others=5.0), DEFAULTS, 0.01)
    for field in ("smoothed", "mean", "square"):
        old, new = getattr(before, field), getattr(after, field)
        assert [k for k in range(8) if old[k] == new[k]] == [AX]
    # It has to fill its window anew when it comes back.
    expected = [0.0 if k == AX else time_s + 0.01 for k, time_s in enumerate(before.filled_s)]
    np.testing.assert_allclose(after.filled_s, expected, atol=1e-12)
    assert gates.transient(watched(np.full((300, 8), NAN)), DEFAULTS) == 0.0


def test_the_windows_are_settled_after_two_of_them() -> None:
    assert not gates.settled(watched(np.zeros((199, 8))), DEFAULTS)
    assert gates.settled(watched(np.zeros((201, 8))), DEFAULTS)


# --- (15), Table 3 -----------------------------------------------------------------------------


def windows(tau: float = 0.0, steering: float = 0.0, speed: float = 0.0, filled_s: float = 10.0) -> TransientState:
    """Windows with this tau (all of it in the roll rate), Var(delta_f) and Var(v_car)."""
    square = [0.0] * 8
    square[P], square[DELTA], square[SPEED] = 7.0 * SCALES[P] ** 2 * tau, steering, speed
    return TransientState((0.0,) * 8, (0.0,) * 8, tuple(square), (filled_s,) * 8)


CALM = windows()


def yaw(delta: float, standstill: bool = False) -> Reason:
    return gates.yaw_gate(delta, standstill, DEFAULTS)


def test_15_the_yaw_rate_zeroes_while_the_wheels_point_ahead() -> None:
    k_r = 0.5 * DEG
    assert yaw(0.99 * k_r) is yaw(-0.99 * k_r) is Reason.NONE
    assert gates.yaw_gate(k_r, False, DEFAULTS._replace(k_r_rad=k_r)) is Reason.NONE  # <=, as printed
    assert yaw(1.01 * k_r) is yaw(-1.01 * k_r) is Reason.STEERING_LARGE
    assert yaw(NAN) is Reason.NO_STEERING
    # At a standstill, whatever the wheel does.
    assert yaw(30.0 * DEG, standstill=True) is yaw(NAN, standstill=True) is Reason.NONE


def test_roll_and_pitch_rates_zero_except_while_turning() -> None:
    limit = 5.0 * DEG
    for sign in (-1.0, 1.0):
        assert gates.roll_pitch_gate(sign * 0.99 * limit, False, DEFAULTS) is Reason.NONE
        assert gates.roll_pitch_gate(sign * 1.01 * limit, False, DEFAULTS) is Reason.TURNING
    assert gates.roll_pitch_gate(9.0, True, DEFAULTS) is Reason.NONE
    assert gates.roll_pitch_gate(NAN, False, DEFAULTS) is Reason.NONE
    assert gates.roll_pitch_gate(9.0, False, DEFAULTS._replace(as_printed=True)) is Reason.NONE


LONGITUDINAL = {
    "open": ({}, Reason.NONE),
    "no wheels": ({"valid": False}, Reason.NO_SPEED),
    "walking pace": ({"v": 4.9}, Reason.TOO_SLOW),
    "just fast enough": ({"v": 5.1}, Reason.NONE),
    "backing": ({"v": -9.0}, Reason.REVERSING),
    "wheels disagree": ({"slip": True}, Reason.WHEELS_SLIP),
    "just started": ({"state": windows(filled_s=1.9)}, Reason.SETTLING),
    "c2 passed": ({"state": windows(speed=0.249)}, Reason.NONE),
    "c2 missed": ({"state": windows(speed=0.251)}, Reason.SPEED_VARIES),
    "c1 passed": ({"state": windows(tau=0.49)}, Reason.NONE),
    "c1 missed": ({"state": windows(tau=0.51)}, Reason.TRANSIENT),
}


@pytest.mark.parametrize("name", LONGITUDINAL)
def test_table_3_x(name: str) -> None:
    changed, expected = LONGITUDINAL[name]
    case = {"state": CALM, "v": 20.0, "valid": True, "slip": False} | changed
    assert gates.longitudinal_gate(**case, tuning=DEFAULTS) is expected


LATERAL = {
    "open": ({}, Reason.NONE),
    "no wheels": ({"valid": False}, Reason.NO_SPEED),
    "c3 missed": ({"v": 7.9}, Reason.TOO_SLOW),
    "standing": ({"v": 0.0}, Reason.TOO_SLOW),
    "backing": ({"v": -9.0}, Reason.REVERSING),
    "c3 passed": ({"v": 8.1}, Reason.NONE),
    "no steering": ({"delta": NAN}, Reason.NO_STEERING),
    "no yaw rate": ({"r": NAN}, Reason.NO_STEERING),
    "just started": ({"state": windows(filled_s=1.9)}, Reason.SETTLING),
    "yaw rate not zeroed yet": ({"yaw_std": 0.21 * DEG}, Reason.SETTLING),
    "yaw rate zeroed": ({"yaw_std": 0.19 * DEG}, Reason.NONE),
    "c4 passed": ({"delta": -0.99 * DEG}, Reason.NONE),
    "c4 missed, right": ({"delta": -1.01 * DEG}, Reason.STEERING_LARGE),
    "c4 missed, left": ({"delta": 1.01 * DEG}, Reason.STEERING_LARGE),
    "c5 passed": ({"state": windows(steering=0.039 * DEG**2)}, Reason.NONE),
    "c5 missed": ({"state": windows(steering=0.041 * DEG**2)}, Reason.STEERING_MOVES),
    "c6 passed": ({"r": -1.99 * DEG}, Reason.NONE),
    "c6 missed, right": ({"r": -2.01 * DEG}, Reason.TURNING),
    "c6 missed, left": ({"r": 2.01 * DEG}, Reason.TURNING),
    "tau has no say": ({"state": windows(tau=9.0, speed=9.0)}, Reason.NONE),
}


@pytest.mark.parametrize("name", LATERAL)
def test_table_3_y(name: str) -> None:
    changed, expected = LATERAL[name]
    case = {"state": CALM, "v": 20.0, "valid": True, "delta": 0.0, "r": 0.0, "yaw_std": 0.0} | changed
    assert gates.lateral_gate(**case, tuning=DEFAULTS) is expected


VERTICAL = {
    "open": ({}, Reason.NONE),
    "no wheels": ({"valid": False}, Reason.NO_SPEED),
    "just started": ({"state": windows(filled_s=1.9)}, Reason.SETTLING),
    "c7 passed": ({"state": windows(tau=0.49, speed=9.0)}, Reason.NONE),
    "c7 missed": ({"state": windows(tau=0.51)}, Reason.TRANSIENT),
}


@pytest.mark.parametrize("name", VERTICAL)
def test_table_3_z(name: str) -> None:
    changed, expected = VERTICAL[name]
    case = {"state": CALM, "valid": True} | changed
    assert gates.vertical_gate(**case, tuning=DEFAULTS) is expected


def test_c1_and_c7_are_two_constants() -> None:
    tuning = DEFAULTS._replace(c1=0.2, c7=0.8)
    assert gates.longitudinal_gate(windows(tau=0.5), 20.0, True, False, tuning) is Reason.TRANSIENT
    assert gates.vertical_gate(windows(tau=0.5), True, tuning) is Reason.NONE


def test_a_speed_that_has_just_appeared_has_no_variance_yet() -> None:
    """10 s without wheels, then one reading: nothing is known about Var(v_car)."""
    state = watched(np.tile([0.0] * 7 + [NAN], (1000, 1)))
    state = gates.watched(state, (0.0,) * 7 + (20.0,), DEFAULTS, 0.01)
    assert gates.longitudinal_gate(state, 20.0, True, False, DEFAULTS) is Reason.SETTLING


def test_a_signal_that_was_never_there_does_not_keep_the_windows_from_settling() -> None:
    state = watched(np.tile([0.0] * 5 + [NAN] + [0.0] * 2, (250, 1)))
    assert gates.vertical_gate(state, True, DEFAULTS) is Reason.NONE


def test_a_signal_that_was_there_for_a_moment_does_not_either() -> None:
    """A sensor that reports for 0.5 s and dies: ten minutes later the others are long settled."""
    rows = np.zeros((60000, 8))
    rows[50:, Q] = NAN
    assert gates.vertical_gate(watched(rows[::50], dt_s=0.5), True, DEFAULTS) is Reason.NONE
