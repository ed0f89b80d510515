"""What the laws can have led to: a state from outside is held against it before it is believed.

No more than ranges: a state within them may still be wrong, but it is no worse than one that the
estimator could have come to by itself, and it is unlearnt as quickly.
"""

from __future__ import annotations

import math

from dsz_daemon.core.parameters import Tuning, ZeroingTuning
from dsz_daemon.core.stiffness import StiffnessState, initial_stiffness
from dsz_daemon.core.zeroing import ZeroingState

# Scatter is remembered over some 60 blocks, see `zeroing`.
_NOISE_MEMORY_BLOCKS = 60.0
_ROUNDING = 1e-6
# The steering's zero error is bounded by its prior alone: ten times that is no zero error.
_STEERING_ZERO_SPREADS = 10.0


def unreachable_zeroing(state: ZeroingState, law: ZeroingTuning, c: float, block_s: float) -> str:
    """Why one channel's law can't have led to `state`; "" where it can. `c` is the c_y of (26)."""
    if not all(math.isfinite(x) for x in state):
        return "not all of it are finite numbers"
    largest = law.largest_offset * max(1.0, c)
    if abs(state.correction) > largest:
        return f"an offset of {-state.correction:.4g} is beyond the largest that is believed, {largest:.4g}"
    least, most = smallest_variance(law), max(law.prior_std, law.largest_offset) ** 2
    if not (state.variance > 0.0 and least * (1.0 - _ROUNDING) <= state.variance <= most * (1.0 + _ROUNDING)):
        return f"a variance of {state.variance:.4g} is outside {least:.4g} to {most:.4g}"
    # Each block's mean and the correction may be off either way; see `zeroing.scattered` for the rest.
    scatter = _NOISE_MEMORY_BLOCKS * 2.0 * 2.0 * block_s * (2.0 * largest) ** 2
    bounds = {
        "driven_s": (state.driven_s, math.inf),
        "block_s": (state.block_s, math.inf),
        "block_variance": (state.block_variance, math.inf),
        "noise_sum": (state.noise_sum, scatter),
        "noise_blocks": (state.noise_blocks, _NOISE_MEMORY_BLOCKS * (1.0 + _ROUNDING)),
        "doubted_s": (state.doubted_s, math.inf),
        "doubt": (state.doubt, (2.0 * largest) ** 2 * (1.0 + _ROUNDING)),
        "contradiction": (state.contradiction, (2.0 * largest) ** 2 * (1.0 + _ROUNDING)),
    }
    for name, (value, high) in bounds.items():
        if not 0.0 <= value <= high:
            return f"{name} is {value:.4g}; expected 0 to {high:.4g}"
    if abs(state.neglected) > largest * (1.0 + _ROUNDING):
        return f"neglected is {state.neglected:.4g}; expected no more than {largest:.4g}"
    if abs(state.block_sum) > largest * state.block_s * (1.0 + _ROUNDING):
        return f"block_sum is {state.block_sum:.4g} after {state.block_s:.4g} s"
    if state.block_s > 0.0 and state.block_variance <= 0.0:
        return "a block has begun without a variance"
    return ""


def smallest_variance(law: ZeroingTuning) -> float:
    """The least that P can come down to: where P' = Q - P^2/S ends at the smallest S, or a single look.

    A constant gain g leaves g S/2 + Q/(2 g), which is never less than that (the mean of two numbers
    against the root of their product).
    """
    fewest = law.noise_blocks * law.noise_density / (law.noise_blocks + _NOISE_MEMORY_BLOCKS)
    return min(math.sqrt(law.drift_density * min(law.standstill_density, fewest)), law.look_std**2)


def unreachable_stiffness(state: StiffnessState, tuning: Tuning) -> str:
    """Why the adaptation can't have led to `state`; "" where it can. The smoothed values are not looked at."""
    known = state[:9]
    if not all(math.isfinite(x) for x in known):
        return "not all of it are finite numbers"
    low, high = 1.0 / (1.0 + tuning.stiffness_bound), 1.0 / (1.0 - tuning.stiffness_bound)
    for name, value in (("front", state.front), ("rear", state.rear)):
        if not low * (1.0 - _ROUNDING) <= value <= high * (1.0 + _ROUNDING):
            return f"the {name} compliance factor {value:.4g} is outside {low:.4g} to {high:.4g}"
    if abs(state.steering_zero_rad) > _STEERING_ZERO_SPREADS * tuning.steering_offset_spread_rad:
        return f"a steering zero error of {state.steering_zero_rad:.4g} rad"
    first = initial_stiffness(tuning)
    if not _is_covariance(state) or any(
        value > start * (1.0 + _ROUNDING)
        for value, start in ((state.p11, first.p11), (state.p22, first.p22), (state.p33, first.p33))
    ):
        return "its covariance is none, or larger than at the start"
    return ""


def _is_covariance(s: StiffnessState) -> bool:
    """Whether P has positive variances and correlations that fit together (rounding left out)."""
    if min(s.p11, s.p22, s.p33) <= 0.0:
        return False
    r12 = s.p12 / math.sqrt(s.p11) / math.sqrt(s.p22)
    r13 = s.p13 / math.sqrt(s.p11) / math.sqrt(s.p33)
    r23 = s.p23 / math.sqrt(s.p22) / math.sqrt(s.p33)
    determinant = 1.0 + 2.0 * r12 * r13 * r23 - r12 * r12 - r13 * r13 - r23 * r23
    return max(abs(r12), abs(r13), abs(r23)) <= 1.0 + _ROUNDING and determinant >= -_ROUNDING
