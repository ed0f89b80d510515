"""One effect in another's place: what was chosen before others came is held against its rivals beside all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dsz_daemon.diagnose.effects.nameless import NAMELESS
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained
from dsz_daemon.diagnose.fitting.model import GRIP, OWN_CHANNEL, Fit
from dsz_daemon.diagnose.fitting.mounts import MOUNT
from dsz_daemon.diagnose.fitting.without import without
from dsz_daemon.diagnose.residuals.comparison import Each, Rows, all_hands
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.selection.plausible import (
    are_one_turn,
    is_implausible,
    is_told,
    odds_against_less,
    weighs_nothing,
)
from dsz_daemon.diagnose.selection.trials import ODD_LEAKS, ODD_LOAD, Step
from dsz_daemon.diagnose.simulation.drive import Drive
from dsz_daemon.diagnose.simulation.loads import LOAD

# Of what an effect gained when it was chosen, a rival worth another look.
_NEAR = 0.75
# Those that come as the road, or the air, is felt; a limit of grip, which has a curve for its rival; and what has no
# name takes the place of none.
_NEVER = frozenset({*OWN_CHANNEL, *GRIP})
_NO_RIVALS = _NEVER | {effect.name for effect in NAMELESS}
# A mount that is turned, beside leaks of the accelerometers, is leaks of the gyros beside others of theirs.
_LEAKS, _OF_FORCES = "gyro_cross_axis", "accel_cross_axis"
# What a load does to how a car turns, as two; and so little less it may gain than both.
_TYRES = "cornering_stiffness"
_A_LOADS, _ALIKE = frozenset({_TYRES, "yaw_inertia"}), 3.0
# One cause, as two. A yaw gyro that shows less: a car that turns less by its steering, and by the difference of its
# wheels. A mount that is turned: what leaks between accelerometers, and between gyros.
ONE_FOR_TWO = {
    "gyro_scale": frozenset({"steering_ratio", "track_width"}),
    MOUNT: frozenset({_LEAKS, _OF_FORCES}),
}


def in_its_place(
    drive: Drive,
    rows: Rows,
    nominal: Fit,
    best: Fit,
    effect: str,
    rivals: Sequence[Step],
    tolerance: Mapping[str, float],
    each: Each,
) -> list[Step]:
    """What rivals of an effect gain more than it does (or less, below 0) beside all else in the model, the most first.

    Those that came near it when it was chosen, what is `like` it (while a road is not told yet, an IMU that smooths may
    gain much less than one that is late), and leaks for a turned mount. What is implausible there is none, and what is
    not told: of neither, nor in place of that, is anything said.
    """
    if effect in _NEVER or not is_told(drive, best, effect):
        return []
    first = {step.effect: step for step in reversed(rivals)}
    least = _NEAR * first[effect].gain
    near = {name for name, step in first.items() if step.gain > least and name not in _NO_RIVALS}
    near |= set(drive.vocabulary.described(effect).like)
    near |= {_LEAKS} if effect == MOUNT and _OF_FORCES in best.effects else set()

    def fit(name: str, each: Each) -> Fit:
        start, own = best.x.copy(), list(drive.vocabulary.columns_of(name))
        start[list(drive.vocabulary.columns_of(effect))] = 0.0
        start[own] = first[name].fit.x[own] if name in first else 0.0
        effects = tuple(name if one == effect else one for one in best.effects)
        return fitted(drive, rows, start, effects, tolerance, each=each, felt=best.felt)

    names = sorted(near - set(best.effects))
    found = [
        Step(name, _more(drive, nominal, best, there), there)
        for name, there in zip(names, all_hands(fit, names, each), strict=True)
        if is_told(drive, there, name) and not is_implausible(drive, rows, there, name)
    ]
    return sorted(found, key=lambda step: -step.gain)


def _more(drive: Drive, nominal: Fit, before: Fit, after: Fit) -> float:
    """As rivals: what is left hangs together more or less, so the same rows count.

    An empty load is odd, a lack, and leaks that are one turn.
    """
    same = np.exp(np.mean(np.log([before.per_row, after.per_row]), axis=0))
    odd = ODD_LOAD * (weighs_nothing(after) - weighs_nothing(before))
    odd += odds_against_less(after) - odds_against_less(before)
    odd += ODD_LEAKS * (are_one_turn(after) - are_one_turn(before))
    return gained(drive, nominal, after, same) - gained(drive, nominal, before, same) - odd


def a_load_instead(
    drive: Drive,
    rows: Rows,
    nominal: Fit,
    best: Fit,
    rivals: Mapping[str, Sequence[Step]],
    tolerance: Mapping[str, float],
    each: Each,
) -> Step | None:
    """A load in place of tyres and a yaw inertia that are both others, with what it gains more; None if that is less.

    One cause is likelier than two that come to the same.
    """
    if not set(best.effects) >= _A_LOADS or LOAD in best.effects:
        return None
    tried = next((step for step in rivals[_TYRES] if step.effect == LOAD), None)
    if tried is None:
        return None
    start, own = best.x.copy(), list(drive.vocabulary.columns_of(LOAD))
    start[[i for effect in _A_LOADS for i in drive.vocabulary.columns_of(effect)]] = 0.0
    start[own] = tried.fit.x[own]
    effects = tuple(LOAD if one == _TYRES else one for one in best.effects if one not in _A_LOADS - {_TYRES})
    there = fitted(drive, rows, start, effects, tolerance, each=each, felt=best.felt)
    gain = _more(drive, nominal, best, there)
    return Step(LOAD, gain, there) if gain > -_ALIKE and not is_implausible(drive, rows, there, LOAD) else None


def one_for_two(
    drive: Drive, rows: Rows, nominal: Fit, best: Fit, one: str, tolerance: Mapping[str, float], each: Each
) -> Step | None:
    """One in place of the two that come to the same (`ONE_FOR_TWO`), and of all that does nothing beside it.

    With what it gains more; None if that is less: one cause is likelier than two that come to the same.
    """
    two = ONE_FOR_TWO[one]
    if not set(best.effects) >= two or one in best.effects:
        return None
    start = best.x.copy()
    start[[i for effect in two for i in drive.vocabulary.columns_of(effect)]] = 0.0
    effects = (*(other for other in best.effects if other not in two), one)
    there = fitted(drive, rows, start, effects, tolerance, each=each, felt=best.felt)
    if (gain := _more(drive, nominal, best, there)) < -_ALIKE or is_implausible(drive, rows, there, one):
        return None
    for effect in effects[:-1]:
        rest = without(drive, rows, there, tolerance, (effect,), each)
        more = _more(drive, nominal, best, rest)
        if gained(drive, rest, there) < LEAST_GAIN and more > -_ALIKE:
            there, gain = rest, more
    return Step(one, gain, there)
