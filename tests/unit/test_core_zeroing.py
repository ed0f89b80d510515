"""core/zeroing: the law (10)-(15), (23)-(28) against its differential equations, means and Bayes by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_cases import law, rk4
from hypothesis import given, settings
from hypothesis import strategies as st

from dsz_daemon.core import zeroing
from dsz_daemon.core.parameters import ZeroingTuning
from dsz_daemon.core.zeroing import ZeroingState

BLOCK_S = 5.0


def learnt(
    state: ZeroingState,
    targets: list[float],
    tuning: ZeroingTuning,
    dt_s: float = 0.01,
    c: float = 1.0,
    standstill: bool = False,
    constant_gain: bool = False,
) -> ZeroingState:
    for target in targets:
        state = zeroing.zeroed(state, target, standstill, tuning, constant_gain, BLOCK_S, dt_s, c)
    return state


def test_the_correction_is_added_to_the_reading() -> None:
    """(10): p = p* + e."""
    assert zeroing.compensated(0.3, ZeroingState(-0.1, 1.0)) == pytest.approx(0.2)


# --- the printed law ---------------------------------------------------------------------------


def test_as_printed_the_correction_follows_with_gamma() -> None:
    """e' = gamma (-e + target), gamma = 1 / window: after t, e = target + (e0 - target) exp(-gamma t)."""
    state = learnt(ZeroingState(2.0, 1.0), [-1.0] * 700, law(), constant_gain=True)
    assert state.correction == pytest.approx(-1.0 + 3.0 * math.exp(-7.0 / 10.0), rel=1e-11)
    # Deaf to standing still, which the print does not know.
    still = learnt(ZeroingState(2.0, 1.0), [-1.0] * 700, law(), constant_gain=True, standstill=True)
    assert still == state


@pytest.mark.parametrize("constant_gain", [True, False])
@pytest.mark.parametrize("c", [1.0, 1.1, 1.5])
def test_the_law_settles_at_c_times_the_target(c: float, constant_gain: bool) -> None:
    """(26), PAPER item 2: DC gain c_y. With a bias of 0.25 the target is -0.25."""
    tuning = law(drift_density=0.04)  # steady gamma = sqrt(Q / S) = 0.2
    state = learnt(ZeroingState(0.0, 1.0), [-0.25] * 3000, tuning, 0.1, c, constant_gain=constant_gain)
    assert state.correction == pytest.approx(-c * 0.25, rel=1e-9)


def test_what_a_constant_gamma_does_to_the_variance() -> None:
    """P' = -2 gamma P + gamma^2 S + Q, by Runge-Kutta; steady: S gamma / 2 + Q / (2 gamma)."""
    gamma, S, Q = 0.1, 3.0, 0.02
    tuning = law(noise_density=S, drift_density=Q)
    for start in (9.0, 0.01):
        state = learnt(ZeroingState(0.0, start), [0.0], tuning, 4.0, constant_gain=True)
        expected = rk4(lambda P: -2.0 * gamma * P + gamma**2 * S + Q, np.array([start]), 4.0, 400)[0]
        assert state.variance == pytest.approx(expected, rel=1e-9)
    late = learnt(ZeroingState(0.0, 9.0), [0.0] * 100, tuning, 4.0, constant_gain=True)
    assert late.variance == pytest.approx(0.5 * gamma * S + 0.5 * Q / gamma, rel=1e-9)


# --- the scheduled gain ------------------------------------------------------------------------


@pytest.mark.parametrize("drift", [0.0, 1e-4, 0.3])
@pytest.mark.parametrize("start", [25.0, 0.01])
def test_the_scheduled_gain_is_the_kalman_bucy_filter(drift: float, start: float) -> None:
    """e' = (P/S)(target - e), P' = Q - P^2/S, by Runge-Kutta, in one step and in ten."""
    S, target, seconds = 2.0, -0.7, 3.0

    def rate(x: np.ndarray) -> np.ndarray:
        e, P = x
        return np.array([P / S * (target - e), drift - P * P / S])

    expected = rk4(rate, np.array([1.3, start]), seconds, 4000)
    tuning = law(noise_density=S, drift_density=drift)
    for steps in (1, 10):
        state = learnt(ZeroingState(1.3, start), [target] * steps, tuning, seconds / steps)
        np.testing.assert_allclose([state.correction, state.variance], expected, rtol=1e-8)


def test_in_the_long_run_it_is_the_papers_law_with_gamma_from_drift_and_density() -> None:
    """gamma = sqrt(Q / S): here 0.2 1/s; the variance stays at sqrt(Q S)."""
    tuning = law(noise_density=0.5, drift_density=0.02)
    settled = learnt(ZeroingState(0.0, 100.0), [0.0] * 2000, tuning, 0.1)
    assert settled.variance == pytest.approx(0.1, rel=1e-9)
    moved = learnt(settled, [1.0] * 300, tuning, 0.01)
    assert moved.correction == pytest.approx(1.0 - math.exp(-0.2 * 3.0), rel=1e-9)


def test_without_prior_and_drift_the_correction_is_the_plain_mean() -> None:
    targets = list(np.random.default_rng(1).normal(0.4, 1.0, 900))
    state = ZeroingState(0.0, 1e14)
    for n, target in enumerate(targets, 1):
        state = learnt(state, [target], law())
        if n in (1, 2, 10, 899, 900):
            assert state.correction == pytest.approx(np.mean(targets[:n]), rel=1e-9)


def test_prior_and_data_weigh_as_bayes_has_it() -> None:
    """Prior 0 +- 2, data of density 1.5 for 0.5 s (variance 3): e = 0.8 * 4/(4 + 3), P = 12/7."""
    tuning = law(prior_std=2.0, noise_density=1.5)
    state = learnt(zeroing.unlearnt(tuning), [0.8] * 50, tuning)
    assert state.correction == pytest.approx(0.8 * 4.0 / 7.0, rel=1e-12)
    assert state.variance == pytest.approx(12.0 / 7.0, rel=1e-12)


def test_a_standstill_weighs_by_its_own_density() -> None:
    """10 s of driving at 0 with density 1 are 10 units of information, 3 s of standing with 0.1 are 30."""
    driven = learnt(ZeroingState(0.0, 1e14), [0.0] * 1000, law())
    state = learnt(driven, [0.4] * 300, law(), standstill=True)
    assert state.correction == pytest.approx(0.4 * 30.0 / 40.0, rel=1e-9)
    assert state.variance == pytest.approx(1.0 / 40.0, rel=1e-9)
    assert (state.noise_sum, state.noise_blocks, state.block_s, state.driven_s) == (
        driven.noise_sum,
        driven.noise_blocks,
        driven.block_s,
        driven.driven_s,
    )


def test_the_start_counts_less_and_that_fades_with_the_time_driven() -> None:
    tuning = law(noise_density=0.5, start_density=4.0, start_s=2.0)
    for driven in (0.0, 2.0, 7.0):
        state = ZeroingState(0.0, 1.0, driven_s=driven)
        assert zeroing.driving_density(state, tuning) == pytest.approx(0.5 + 4.0 * math.exp(-driven / 2.0), rel=1e-9)
    assert learnt(ZeroingState(0.0, 1.0), [0.0] * 150, tuning).driven_s == pytest.approx(1.5)


def test_the_gain_is_limited_and_the_variance_knows() -> None:
    """At most the limit's constant gain, however unsure e is; the variance then is that gain's."""
    tuning = law(gain_limit_per_s=2.0)
    state = learnt(ZeroingState(0.0, 1e3), [1.0], tuning, 0.1)
    assert state.correction == pytest.approx(1.0 - math.exp(-0.2), rel=1e-12)
    expected = rk4(lambda P: -4.0 * P + 4.0 * 1.0, np.array([1e3]), 0.1, 100)[0]
    assert state.variance == pytest.approx(expected, rel=1e-9)
    slow = learnt(ZeroingState(0.0, 0.2), [1.0], tuning, 0.1)
    assert slow.correction == pytest.approx(0.02 / 1.02, rel=1e-12)


def test_a_look_tells_at_once_what_a_look_can_tell() -> None:
    """A slow process of std 0.5, density 4: information grows by 1 / (0.5^2 * 1 s) up to 1 / 0.5^2, then by 1/4.

    From a prior of 2 (information 0.25): 4 after 3.75 / 4 = 0.9375 s, 4 + 2/4 two seconds later. The mean
    weighs accordingly: what came within the look has 3.75 of 4.5, later seconds 0.25 each.
    """
    tuning = law(noise_density=4.0, look_std=0.5, prior_std=2.0)
    for steps in (1, 3, 47):
        looking = learnt(zeroing.unlearnt(tuning), [1.0] * steps, tuning, 0.9375 / steps)
        assert looking.variance == pytest.approx(0.25, rel=1e-9)
        assert looking.correction == pytest.approx(3.75 / 4.0, rel=1e-9)
        later = learnt(looking, [-1.0] * steps, tuning, 2.0 / steps)
        assert later.variance == pytest.approx(1.0 / 4.5, rel=1e-9)
        assert later.correction == pytest.approx((3.75 - 0.5) / 4.5, rel=1e-9)
    across = learnt(zeroing.unlearnt(tuning), [1.0], tuning, 2.9375)
    assert across.variance == pytest.approx(1.0 / 4.5, rel=1e-9)
    assert across.correction == pytest.approx(4.25 / 4.5, rel=1e-9)


def test_a_look_under_the_gains_limit() -> None:
    """The same with at most 1/s, by Runge-Kutta of e' = g (target - e), P' = -2 g P + g^2 s with g = min(1, P/s),

    s being 0.25 while P > 0.25 and 4 afterwards.
    """

    def rate(x: np.ndarray) -> np.ndarray:
        e, P = x
        s = 0.25 if P > 0.25 else 4.0
        g = min(1.0, P / s)
        return np.array([g * (1.0 - e), -2.0 * g * P + g * g * s])

    tuning = law(noise_density=4.0, look_std=0.5, prior_std=2.0, gain_limit_per_s=1.0)
    for seconds, steps in ((0.5, 1), (3.0, 1), (3.0, 150)):
        state = learnt(zeroing.unlearnt(tuning), [1.0] * steps, tuning, seconds / steps)
        expected = rk4(rate, np.array([0.0, 4.0]), seconds, 6000)
        # The switch of s falls within a Runge-Kutta step: first order there.
        np.testing.assert_allclose([state.correction, state.variance], expected, rtol=1e-3)


# --- composition -------------------------------------------------------------------------------


@settings(max_examples=200, deadline=None, derandomize=True)
@given(
    st.floats(-5.0, 5.0),
    st.floats(1e-4, 100.0),
    st.floats(-5.0, 5.0),
    st.floats(0.001, 3.0),
    st.sampled_from([0.0, 1e-6, 0.05]),
    st.sampled_from([1.0, 1.2]),
    st.booleans(),
    st.booleans(),
)
def test_one_step_of_2_dt_is_two_of_dt(
    e: float, P: float, target: float, dt: float, drift: float, c: float, standstill: bool, constant: bool
) -> None:
    """To rounding, for the printed and the scheduled gain, driving and standing (looks: see below)."""
    tuning, start = law(drift_density=drift), ZeroingState(e, P)
    once = learnt(start, [target], tuning, 2.0 * dt, c, standstill, constant)
    twice = learnt(start, [target] * 2, tuning, dt, c, standstill, constant)
    assert twice.correction == pytest.approx(once.correction, rel=1e-12, abs=1e-12)
    assert twice.variance == pytest.approx(once.variance, rel=1e-12)
    assert twice.driven_s == pytest.approx(once.driven_s, rel=1e-12)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.floats(1e-3, 30.0), st.floats(0.001, 3.0), st.sampled_from([0.5, 2.0, 1e6]))
def test_one_step_of_2_dt_is_two_of_dt_over_the_first_looks(P: float, dt: float, limit: float) -> None:
    """With the gain's limit, without drift (which the look's end, in closed form, does not know)."""
    tuning, start = law(look_std=0.7, noise_density=3.0, gain_limit_per_s=limit), ZeroingState(1.0, P)
    once = learnt(start, [0.0], tuning, 2.0 * dt)
    twice = learnt(start, [0.0] * 2, tuning, dt)
    assert twice.correction == pytest.approx(once.correction, rel=1e-9, abs=1e-12)
    assert twice.variance == pytest.approx(once.variance, rel=1e-9)


def test_one_step_of_2_dt_is_two_of_dt_where_the_gains_limit_lets_go() -> None:
    tuning, start = law(gain_limit_per_s=1.0), ZeroingState(1.0, 1.5)
    once = learnt(start, [0.0], tuning, 0.8)
    twice = learnt(start, [0.0] * 2, tuning, 0.4)
    assert twice.correction == pytest.approx(once.correction, rel=1e-12)


def test_one_step_of_2_dt_is_two_of_dt_to_second_order_while_the_start_fades() -> None:
    """No closed form: the fading density is taken at the step's middle, so the error falls with dt squared.

    Size: density changes by the factor exp(-dt/start_s) over a step; the midpoint rule misses (dt/start_s)^2/24 of it.
    """
    tuning, start = law(start_density=30.0, start_s=2.0), ZeroingState(1.0, 1.0)
    for dt in (0.01, 0.1):
        once = learnt(start, [0.0], tuning, 2.0 * dt)
        twice = learnt(start, [0.0] * 2, tuning, dt)
        moved = 1.0 - once.correction
        assert twice.correction == pytest.approx(once.correction, abs=moved * (2.0 * dt / 2.0) ** 2 / 24.0)


# --- hold --------------------------------------------------------------------------------------


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.floats(-5.0, 5.0), st.floats(0.0, 3.0), st.floats(0.001, 100.0))
def test_hold_keeps_the_correction_and_composes(e: float, P: float, dt: float) -> None:
    tuning = law(drift_density=1e-3, prior_std=1.1)
    start = ZeroingState(e, P, 7.0, 0.3, 1.0, 0.2, 4.0, 3.0)
    once = zeroing.held(start, tuning, 2.0 * dt)
    twice = zeroing.held(zeroing.held(start, tuning, dt), tuning, dt)
    assert twice.variance == pytest.approx(once.variance, rel=1e-12)
    assert once._replace(variance=P) == start


def test_the_spread_grows_while_held_as_a_random_walk_up_to_the_data_sheet() -> None:
    """Variance + 1e-4 a second for 100 s; a year later it is the prior's, and never less than it was."""
    tuning = law(drift_density=1e-4, prior_std=2.0)
    assert zeroing.held(ZeroingState(0.0, 0.3), tuning, 100.0).variance == pytest.approx(0.31, rel=1e-12)
    assert zeroing.held(ZeroingState(0.0, 0.3), tuning, 3e7).variance == pytest.approx(4.0)
    assert zeroing.held(ZeroingState(0.0, 5.0), tuning, 100.0).variance == 5.0


# --- spread ------------------------------------------------------------------------------------


def test_before_anything_was_learnt_the_spread_is_the_data_sheets() -> None:
    tuning = law(prior_std=3.0, floor_std=0.4)
    assert zeroing.offset_std(zeroing.unlearnt(tuning), tuning) == pytest.approx(math.hypot(3.0, 0.4), rel=1e-12)
    assert zeroing.unlearnt(tuning).correction == 0.0


def test_averaging_shrinks_the_spread_with_the_root_of_time_down_to_the_floor() -> None:
    """White noise of density 4 averaged for 100 s: variance 0.04."""
    tuning = law(noise_density=4.0)
    state = learnt(zeroing.unlearnt(tuning), [0.0] * 1000, tuning, 0.1)
    assert zeroing.offset_std(state, tuning) == pytest.approx(0.2, rel=1e-6)
    assert zeroing.offset_std(state, tuning._replace(floor_std=0.15)) == pytest.approx(0.25, rel=1e-6)


def test_the_scatter_of_block_means_is_kept_with_its_own_share_taken_out() -> None:
    """Second route: the posterior mean after each block by Bayes in numpy (density 2, prior 0 +- 1.5, no drift)."""
    tuning = law(noise_density=2.0, prior_std=1.5)
    targets = np.random.default_rng(5).normal(0.0, 3.0, 800)
    state = learnt(zeroing.unlearnt(tuning), list(targets), tuning, 0.1)
    total, count = 0.0, 0.0
    for end in range(50, 801, 50):
        T = end * 0.1
        before, after = (1.0 / (1.0 / 2.25 + t / 2.0) for t in (T - 5.0, T))
        if after / before > 0.5:  # a block that makes up most of what is known tells nothing about scatter
            rest = targets[end - 50 : end].mean() - after * targets[:end].sum() * 0.1 / 2.0
            total = total * (59.0 / 60.0) + 5.0 * rest**2 / (after / before)
            count = count * (59.0 / 60.0) + 1.0
    assert 12.0 < count < 15.0
    assert state.noise_blocks == pytest.approx(count, rel=1e-12)
    assert state.noise_sum == pytest.approx(total, rel=1e-9)
    outvoted = tuning._replace(noise_blocks=4.0)
    assert zeroing.driving_density(state, outvoted) == pytest.approx((4.0 * 2.0 + total) / (4.0 + count), rel=1e-9)
    # What was scattered: 3 per 0.1 s step, a density of 0.9.
    assert total / count == pytest.approx(0.9, rel=4.0 * math.sqrt(2.0 / count))


def test_c_y_is_not_mistaken_for_noise() -> None:
    """A constant target, no noise at all: nothing scatters, whatever c_y is."""
    tuning = law()
    state = learnt(ZeroingState(-0.3, 0.1), [-0.25] * 3000, tuning, 0.1, c=1.2, constant_gain=True)
    assert state.noise_blocks > 10.0
    assert state.noise_sum == pytest.approx(0.0, abs=1e-12)
