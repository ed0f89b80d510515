"""The zeroing law, (10)-(15) and (23)-(28), with a scheduled gain and an honest spread.

One law serves all six channels: e' = Z gamma (-e + c (reference - reading)), whose target is
-p*, -q*, -r* for the gyros and a_ref - a* for the accelerometers. The paper's gamma is constant.
Here gamma = P / S follows from how sure e is (variance P) and how far a target is off (density
S of its slow scatter): large at first, "the time window" of the paper's section 4.1, and larger
at a standstill, where a gyro's target is nearly exact. With the offset's own drift Q,

    e' = (P/S) (target - e),    P' = Q - P^2 / S,

the scalar Kalman-Bucy filter; its steady state is the paper's law with gamma = sqrt(Q/S). The
steps below are its closed-form solution for a held target, so they compose: one step of 2 dt is
two of dt. e is the correction ADDED to the reading; an offset is its negative.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core.parameters import ZeroingTuning


class ZeroingState(NamedTuple):
    """One channel's memory (its unit: rad/s or m/s^2).

    `variance` is P without the floor, `driven_s` the time learnt while driving; the block and
    noise fields hold the scatter that was seen, see `scattered`; four (a reading's departure from
    what was learnt, for how long it was too large, and two variances) are kept by `doubt`. `neglected` is
    what the targets took as zero though other sensors told it, averaged as the correction is.
    """

    correction: float
    variance: float
    driven_s: float = 0.0
    block_sum: float = 0.0
    block_s: float = 0.0
    block_variance: float = 0.0
    noise_sum: float = 0.0
    noise_blocks: float = 0.0
    departure: float = 0.0
    doubted_s: float = 0.0
    doubt: float = 0.0
    contradiction: float = 0.0
    neglected: float = 0.0


def with_law(state: ZeroingState, correction: float, variance: float, neglected: float) -> ZeroingState:
    """The state with another correction, its variance, and what both neglect."""
    return ZeroingState(
        correction,
        variance,
        state.driven_s,
        state.block_sum,
        state.block_s,
        state.block_variance,
        state.noise_sum,
        state.noise_blocks,
        state.departure,
        state.doubted_s,
        state.doubt,
        state.contradiction,
        neglected,
    )


def _with_scatter(
    state: ZeroingState,
    driven_s: float,
    block_sum: float,
    block_s: float,
    block_variance: float,
    noise_sum: float,
    noise_blocks: float,
) -> ZeroingState:
    return ZeroingState(
        state.correction,
        state.variance,
        driven_s,
        block_sum,
        block_s,
        block_variance,
        noise_sum,
        noise_blocks,
        state.departure,
        state.doubted_s,
        state.doubt,
        state.contradiction,
        state.neglected,
    )


def with_doubt(
    state: ZeroingState, departure: float, doubted_s: float, doubt: float, contradiction: float
) -> ZeroingState:
    """The state with another doubt in it."""
    return ZeroingState(
        state.correction,
        state.variance,
        state.driven_s,
        state.block_sum,
        state.block_s,
        state.block_variance,
        state.noise_sum,
        state.noise_blocks,
        departure,
        doubted_s,
        doubt,
        contradiction,
        state.neglected,
    )


class Step(NamedTuple):
    """How far e goes towards a held target (0..1), and the variance after it."""

    share: float
    variance: float


# Scatter is remembered over about this many blocks, so that a change of road shows.
_NOISE_MEMORY_BLOCKS = 60.0


def unlearnt(tuning: ZeroingTuning) -> ZeroingState:
    """Nothing learnt yet: no correction, the data sheet's spread."""
    return ZeroingState(0.0, tuning.prior_std**2)


def compensated(reading: float, state: ZeroingState) -> float:
    """p = p* + e and so on: (10), (12), (14), (23), (25), (27)."""
    return reading + state.correction


def scheduled_step(variance: float, density: float, drift: float, dt_s: float) -> Step:
    """Closed form of P' = Q - P^2/S and of e' = (P/S)(target - e) over dt_s.

    With k = sqrt(Q/S) and D = cosh(k t) + (P/S) sinh(k t)/k: 1 - share = 1/D and
    P(t) = (P cosh(k t) + Q sinh(k t)/k) / D. For Q = 0 this is the plain running mean.
    """
    k = math.sqrt(drift / density)
    z = k * dt_s
    cosh, sinh = math.cosh(z), math.sinh(z)
    over_k = dt_s if z < 1e-9 else sinh / k
    D = cosh + variance / density * over_k
    return Step(1.0 - 1.0 / D, (variance * cosh + drift * over_k) / D)


def constant_step(variance: float, density: float, drift: float, gamma: float, dt_s: float) -> Step:
    """The paper's constant gamma over dt_s, and what that does to the variance (Lyapunov, closed form).

    P' = -2 gamma P + gamma^2 S + Q.
    """
    share = -math.expm1(-gamma * dt_s)
    steady = 0.5 * gamma * density + 0.5 * drift / gamma
    return Step(share, steady + (variance - steady) * (1.0 - share) ** 2)


def limited_step(variance: float, density: float, drift: float, limit_per_s: float, dt_s: float) -> Step:
    """The scheduled gain, but constant at the limit for as long as P/S lies above it."""
    least = limit_per_s * density
    if variance <= least:
        return scheduled_step(variance, density, drift, dt_s)
    # P falls under the constant gain towards `steady` (below `least` unless the drift is absurd).
    steady = constant_step(variance, density, drift, limit_per_s, math.inf).variance
    limited_s = dt_s
    if steady < least:
        limited_s = min(dt_s, 0.5 * math.log((variance - steady) / (least - steady)) / limit_per_s)
    first = constant_step(variance, density, drift, limit_per_s, limited_s)
    then = scheduled_step(first.variance, density, drift, dt_s - limited_s)
    return Step(1.0 - (1.0 - first.share) * (1.0 - then.share), then.variance)


def first_looks(variance: float, density: float, tuning: ZeroingTuning, dt_s: float) -> Step:
    """The scheduled gain, quicker while less is known than a single look tells (P > look_std^2).

    A slow process (bank, grade) is nearly constant over a look: its mean over T scatters by
    look_std for small T and by sqrt(S/T) only for large T. White noise of density S would claim
    that nothing is learnt before S/P seconds.
    """
    drift, limit = tuning.drift_density, tuning.gain_limit_per_s
    told = tuning.look_std**2
    if variance <= told:
        return limited_step(variance, density, drift, limit, dt_s)
    quick = min(density, told * tuning.look_s)
    # Time until P has come down to `told`: at the limited gain first, then 1/P grows by t/quick.
    edge = min(variance, max(told, limit * quick))
    steady = 0.5 * limit * quick
    at_limit_s = 0.5 * math.log((variance - steady) / (edge - steady)) / limit if edge < variance else 0.0
    seconds = at_limit_s + quick * (1.0 / told - 1.0 / edge)
    looking = limited_step(variance, quick, drift, limit, min(dt_s, seconds))
    if seconds >= dt_s:
        return looking
    then = limited_step(looking.variance, density, drift, limit, dt_s - seconds)
    return Step(1.0 - (1.0 - looking.share) * (1.0 - then.share), then.variance)


def zeroed(
    state: ZeroingState,
    target: float,
    standstill: bool,
    tuning: ZeroingTuning,
    constant_gain: bool,
    block_s: float,
    dt_s: float,
    c: float = 1.0,
    neglected: float = 0.0,
) -> ZeroingState:
    """One open-gate step of (11), (13), (15), (24), (26), (28) towards `target`.

    `c` is the c_y of (26): the law settles at c times the target. `constant_gain` is the printed
    law with gamma = 1/window, deaf to standstill. `neglected` is what other sensors tell of the motion that
    the target takes as zero (the law's unit): the more, the less is learnt from it, and its mean over what
    was learnt is part of the spread.
    """
    exact = standstill and not constant_gain
    density = tuning.standstill_density if exact else driving_density(state, tuning, dt_s)
    neglected = max(-tuning.largest_offset, min(tuning.largest_offset, neglected))
    density += neglected * neglected * tuning.neglect_s
    drift = tuning.drift_density
    if constant_gain:
        step = constant_step(state.variance, density, drift, 1.0 / tuning.window_s, dt_s)
    else:
        step = first_looks(state.variance, density, tuning, dt_s)
    moved = with_law(
        state,
        state.correction + step.share * (c * target - state.correction),
        step.variance,
        state.neglected + step.share * (neglected - state.neglected),
    )
    return moved if exact else scattered(moved, state.variance, c * target, block_s, dt_s)


def held(state: ZeroingState, tuning: ZeroingTuning, dt_s: float) -> ZeroingState:
    """One closed-gate step, Z = 0: the correction stays, its uncertainty grows (to the data sheet's)."""
    grown = min(state.variance + tuning.drift_density * dt_s, tuning.prior_std**2)
    return with_law(state, state.correction, max(state.variance, grown), state.neglected)


def scattered(state: ZeroingState, variance_before: float, target: float, block_s: float, dt_s: float) -> ZeroingState:
    """Adds one driving step to the scatter: means over `block_s` against the correction.

    Block means keep what matters: the slow part of what is averaged (curves, bank, grade). The
    correction has already gone a share K towards the block's mean, so that the rest d has
    E d^2 = (S/b)(1 - K); 1 - K is the ratio of the variances after and before the block.
    """
    start = variance_before if state.block_s == 0.0 else state.block_variance
    total, length = state.block_sum + target * dt_s, state.block_s + dt_s
    driven = state.driven_s + dt_s
    if length < block_s - 1e-9:
        return _with_scatter(state, driven, total, length, start, state.noise_sum, state.noise_blocks)
    noise_sum, blocks = state.noise_sum, state.noise_blocks
    left = min(1.0, state.variance / start)
    if left > 0.5:
        rest = total / length - state.correction
        fade = 1.0 - 1.0 / _NOISE_MEMORY_BLOCKS
        noise_sum = noise_sum * fade + length * rest * rest / left
        blocks = blocks * fade + 1.0
    return _with_scatter(state, driven, 0.0, 0.0, 0.0, noise_sum, blocks)


def driving_density(state: ZeroingState, tuning: ZeroingTuning, dt_s: float = 0.0) -> float:
    """S while driving (unit^2 s): the expected one, outvoted by the scatter seen, more at the start.

    A rate's mean over the first seconds is mostly a change of angle: `start_density` fades with
    the time driven, over `start_s`; a step of dt_s takes it at its middle.
    """
    expected = tuning.noise_blocks * tuning.noise_density
    density = (expected + state.noise_sum) / (tuning.noise_blocks + state.noise_blocks)
    return density + tuning.start_density * math.exp(-(state.driven_s + 0.5 * dt_s) / tuning.start_s)


def offset_std(state: ZeroingState, tuning: ZeroingTuning) -> float:
    """Standard deviation of the offset, with what never averages out, what contradicts it and what it neglects."""
    told = state.variance + state.doubt + state.contradiction
    return math.sqrt(told + state.neglected**2 + tuning.floor_std**2)
