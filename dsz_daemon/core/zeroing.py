"""The zeroing law, (10)-(15) and (23)-(28), with the time window and an honest spread.

One law serves all six channels: e' = Z gamma (-e + c (reference - reading)), whose target is
-p*, -q*, -r* for the gyros and a_ref - a* for the accelerometers. The paper's gamma is constant;
"with the time window" (its section 4.1) is read here as a gain of 1/(time learnt so far) that
falls to gamma = 1/window: the plain mean at first, then forgetting. e is the correction ADDED
to the reading; an offset is its negative.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core.parameters import ZeroingTuning


class ZeroingState(NamedTuple):
    """One channel's memory (its unit: rad/s or m/s^2).

    `learned_s` is the time learnt within the window; `drift_variance` what the offset may have
    walked since; the block and noise fields hold the scatter that was seen, see `noise_density`.
    """

    correction: float = 0.0
    learned_s: float = 0.0
    drift_variance: float = 0.0
    block_sum: float = 0.0
    block_s: float = 0.0
    noise_sum: float = 0.0
    noise_blocks: float = 0.0


# Scatter is remembered over about this many blocks, so that a change of road shows.
_NOISE_MEMORY_BLOCKS = 60.0


def compensated(reading: float, state: ZeroingState) -> float:
    """p = p* + e and so on: (10), (12), (14), (23), (25), (27)."""
    return reading + state.correction


def window_share(learned_s: float, weight: float, tuning: ZeroingTuning, dt_s: float) -> float:
    """How far e goes towards its target in dt_s (0..1).

    While the window fills, weight dt / (learned + weight dt) makes e the weighted mean of all
    targets; once full, 1 - exp(-weight dt / window) is eq. (11) held over the step. Both compose.
    """
    step = weight * dt_s
    fill = min(step, max(0.0, tuning.window_s - learned_s))
    keep = learned_s / (learned_s + fill) if learned_s + fill > 0.0 else 1.0
    keep *= math.exp(-(step - fill) / tuning.window_s)
    return min(1.0 - keep, -math.expm1(-tuning.gain_limit_per_s * dt_s))


def zeroed(
    state: ZeroingState,
    target: float,
    weight: float,
    tuning: ZeroingTuning,
    block_s: float,
    dt_s: float,
    c: float = 1.0,
) -> ZeroingState:
    """One open-gate step of (11), (13), (15), (24), (26), (28) towards `target`.

    `c` is the c_y of (26): the law settles at c times the target. `weight` > 1 is a standstill.
    """
    share = window_share(state.learned_s, weight, tuning, dt_s)
    correction = state.correction + share * (c * target - state.correction)
    learned = min(tuning.window_s, state.learned_s + weight * dt_s)
    drift = (state.drift_variance * (1.0 - share) + tuning.drift_density * dt_s) * (1.0 - share)
    moved = state._replace(correction=correction, learned_s=learned, drift_variance=drift)
    return moved if weight > 1.0 else scattered(moved, target, block_s, dt_s)


def held(state: ZeroingState, tuning: ZeroingTuning, dt_s: float) -> ZeroingState:
    """One closed-gate step, Z = 0: the correction stays, its uncertainty grows (to the data sheet's)."""
    drift = state.drift_variance + tuning.drift_density * dt_s
    return state._replace(drift_variance=min(drift, tuning.prior_std**2))


def scattered(state: ZeroingState, target: float, block_s: float, dt_s: float) -> ZeroingState:
    """Adds one step to the scatter: block means against the running correction.

    Block means keep what matters: the slow part of what is averaged (curves, bank, grade). A mean
    that already contains the block's share b/T of the data is nearer to it by 1 - b/T; corrected.
    """
    total, length = state.block_sum + target * dt_s, state.block_s + dt_s
    if length < block_s - 1e-9:
        return state._replace(block_sum=total, block_s=length)
    noise_sum, blocks = state.noise_sum, state.noise_blocks
    if state.learned_s > length:
        excess = total / length - state.correction
        fade = 1.0 - 1.0 / _NOISE_MEMORY_BLOCKS
        noise_sum = noise_sum * fade + length * excess * excess / (1.0 - length / state.learned_s)
        blocks = blocks * fade + 1.0
    return state._replace(block_sum=0.0, block_s=0.0, noise_sum=noise_sum, noise_blocks=blocks)


def noise_density(state: ZeroingState, tuning: ZeroingTuning) -> float:
    """Long-run spectral density (unit^2 s): the expected one, outvoted by the scatter seen."""
    return (tuning.noise_blocks * tuning.noise_density + state.noise_sum) / (tuning.noise_blocks + state.noise_blocks)


# A look is worth its full information once the sensor's own noise has averaged out, about this long.
_LOOK_S = 1.0


def learned_information(state: ZeroingState, tuning: ZeroingTuning) -> float:
    """Information (1/unit^2) in what was learnt: 0 at first, one look's, then growing with time.

    The mean over T of a process with density S and standard deviation s (correlation time
    S / 2 s^2) scatters by about S / (T + S/s^2): never by more than s, however short T is.
    """
    T = state.learned_s
    bound_s = tuning.noise_density / tuning.look_std**2
    return T / (T + _LOOK_S) * (T + bound_s) / noise_density(state, tuning)


def offset_std(state: ZeroingState, tuning: ZeroingTuning) -> float:
    """Standard deviation of the offset: averaging, drift since, and what never averages out."""
    averaging = 1.0 / (1.0 / tuning.prior_std**2 + learned_information(state, tuning))
    return math.sqrt(averaging + state.drift_variance + tuning.floor_std**2)
