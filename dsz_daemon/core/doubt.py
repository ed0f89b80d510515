"""A standing car's gyro that reads otherwise than what was learnt: held, said, and believed only if it stays so.

At a standstill a gyro's target is nearly exact, so the law of `zeroing` would soon follow any reading. But an
offset wanders slowly; what leaps by many of its own spreads is something else: a sensor that fails, flipped bits,
somebody who rocks the car, a ferry or a turntable. The innovation d, smoothed over `look_s`, has the variance
P + S/(2 look_s) while all is well. Beyond `sigmas` of that nothing is learnt, and d^2 is added to the published
variance, which covers both readings. What was learnt while driving may be off by more than it knows (bends, bank,
a helix), and a standstill is there to mend that: in its first looks, up to `driven_goals` times the channel's goal,
P grows by d^2 and the law goes there.

What lasts for `wait_s` is believed after all (the offset may really have moved while the car was parked): P grows
by d^2, though not beyond the largest offset, and the law goes to the new reading within a look. Two readings have
contradicted each other and nothing tells which was false, so that d stays in the published spread; it fades with
exp(-t / memory_s) while the new one is confirmed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core.parameters import DoubtTuning, ZeroingTuning
from dsz_daemon.core.zeroing import ZeroingState

# A stop's first looks: what was learnt since is of this stop.
_FIRST_LOOKS = 5.0
# Sums of steps; a step is a thousand times that.
_ROUNDING_S = 1e-6


class Look(NamedTuple):
    """The state after a look at a reading, and whether the reading is to be learnt from."""

    state: ZeroingState
    believed: bool


def looked(state: ZeroingState, target: float, law: ZeroingTuning, tuning: DoubtTuning, dt_s: float) -> Look:
    """One step at a standstill: judges `target` (unit of the law) before the law goes towards it."""
    innovation = target - state.correction
    share = -math.expm1(-dt_s / tuning.look_s)
    departure = state.departure + share * (innovation - state.departure)
    gap = departure * departure
    begins = state.stood_s < _FIRST_LOOKS * tuning.look_s
    state = state._replace(departure=departure, stood_s=state.stood_s + dt_s)
    scatter = law.standstill_density / (2.0 * tuning.look_s)
    if gap <= tuning.sigmas**2 * (state.variance + scatter):
        fade = math.exp(-2.0 * dt_s / tuning.memory_s)
        calm = max(0.0, state.doubted_s - dt_s)
        return Look(state._replace(doubted_s=calm, doubt=0.0, contradiction=state.contradiction * fade), True)
    if begins and gap <= (tuning.driven_goals * law.goal_std) ** 2:
        return Look(_widened(state, gap, law), True)
    doubted = state.doubted_s + dt_s
    if doubted < tuning.wait_s - _ROUNDING_S:
        return Look(state._replace(doubted_s=doubted, doubt=gap), False)
    return Look(_widened(state, gap, law)._replace(contradiction=max(state.contradiction, gap)), True)


def _widened(state: ZeroingState, gap: float, law: ZeroingTuning) -> ZeroingState:
    """Believed although it departs by sqrt(gap): P grows by that, though not beyond the largest offset."""
    most = max(law.prior_std, law.largest_offset) ** 2
    variance = max(state.variance, min(state.variance + gap, most))
    return state._replace(variance=variance, departure=0.0, doubted_s=0.0, doubt=0.0)


def unlooked(state: ZeroingState) -> ZeroingState:
    """The state when there is nothing to look at: the car drives, or the reading is missing."""
    return state._replace(departure=0.0, stood_s=0.0, doubted_s=0.0, doubt=0.0)
