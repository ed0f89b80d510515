"""A standing car's gyro that reads otherwise than what was learnt: held, said, and believed only if it stays so.

At a standstill a gyro's target is nearly exact, so the law of `zeroing` would soon follow any reading. But an
offset wanders slowly; what leaps by many of its own spreads is something else: a sensor that fails, flipped bits,
somebody who rocks the car, a ferry or a turntable. The innovation d, smoothed over `look_s`, has the variance
P + n^2 + S/(2 look_s) while all is well, n being what was neglected. Beyond `sigmas` of that nothing is learnt,
and d^2 is added to the published variance, which covers both readings.

What lasts for `wait_s` is believed after all (the offset may really have moved while the car was parked): P grows
by d^2, though not beyond the largest offset, and the law goes to the new reading within a look. Two readings have
contradicted each other and nothing tells which was false, so that d stays in the published spread; it fades with
exp(-t / memory_s) while the new one is confirmed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core.parameters import DoubtTuning, ZeroingTuning
from dsz_daemon.core.zeroing import ZeroingState, with_doubt, with_law

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
    scatter = law.standstill_density / (2.0 * tuning.look_s)
    fade = math.exp(-2.0 * dt_s / tuning.memory_s)
    if departure * departure <= tuning.sigmas**2 * (state.variance + state.neglected**2 + scatter):
        calm = max(0.0, state.doubted_s - dt_s)
        return Look(with_doubt(state, departure, calm, 0.0, state.contradiction * fade), True)
    doubted = state.doubted_s + dt_s
    gap = departure * departure
    most = max(law.prior_std, law.largest_offset) ** 2
    if doubted < tuning.wait_s - _ROUNDING_S:
        return Look(with_doubt(state, departure, doubted, gap, state.contradiction), False)
    moved = with_law(state, state.correction, max(state.variance, min(state.variance + gap, most)), state.neglected)
    return Look(with_doubt(moved, 0.0, 0.0, 0.0, max(state.contradiction, gap)), True)


def unlooked(state: ZeroingState) -> ZeroingState:
    """The state when there is nothing to look at: the car drives, or the reading is missing."""
    return with_doubt(state, 0.0, 0.0, 0.0, state.contradiction)
