"""One candidate more: really fitted, judged by its own slopes, and held against the others in its place."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.nameless import NAMELESS, OUTER_LOAD
from dsz_daemon.diagnose.effects.row import CAR
from dsz_daemon.diagnose.effects.vocabulary import GUESSED, INDEX
from dsz_daemon.diagnose.fitting.fit import ONE_BY_ONE, exactly, fitted
from dsz_daemon.diagnose.fitting.gains import gained, is_beyond_form
from dsz_daemon.diagnose.fitting.model import GRIP, OWN_CHANNEL, SAME_TURN, TILTS, Fit, Slopes
from dsz_daemon.diagnose.fitting.moments import moments_of, with_best_moments
from dsz_daemon.diagnose.residuals.comparison import Each, Rows, all_hands
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.selection.guesses import as_everywhere
from dsz_daemon.diagnose.selection.plausible import (
    are_one_turn,
    does_nothing,
    is_implausible,
    is_rather_something,
    is_told,
    odds_against_less,
    weighs_nothing,
)
from dsz_daemon.diagnose.selection.starts import Start
from dsz_daemon.diagnose.shapes.unlisted import wheel_squares
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.loads import LOAD

# A profile fits nearly anything.
_PROFILE_SHARES = 2.0
# A wind may be a bank that gains so much of what it does: that is told by a gyro, and judged by more than the yaw rate.
_MAY_BE_A_BANK = 0.6
# Of two starts of an effect so close in log likelihood the drive does not choose.
_ALIKE = 3.0
# What turns a car, one with another, as no single name does.
TURNS = ("steering_ratio", "steering_compliance", "cornering_stiffness", "mass_loading", "tyre_relaxation")
# By slopes that are a step old, what gains so much of the most, or is so little off it, is judged by its own, unless it
# is hopeless.
_HOPEFUL, _OFF, _HOPELESS = 0.4, 20.0, 0.0
# Beside so many effects what lost the last time waits. What gained little does not: what came first may have hidden it.
_SOME = 2
# What a profile has still lost after twice some rounds of its fit no further ones bring back.
_LOST = -20.0
# Nor of what is so little of a leader's gain, if that is much, and by further rounds gains no more than so much.
_LITTLE, _MUCH, _FURTHER = 0.15, 50.0, 5.0
# What takes long.
_LONG = TILTS | GRIP | {"sensor_saturation"}
# Of the most that any candidate gains: from here on they are compared on the same number of independent rows.
_RIVALS = 0.5
# What has no name has to explain so much more than what has one; and grip that ends for a while, than grip that ends.
_UNNAMED, _ALL_WHEELS = frozenset(effect.name for effect in NAMELESS) - {OUTER_LOAD}, "wheels_more"
SURELY, _SPECIAL = 1.05, _UNNAMED | {"low_friction"}
# What stands behind by another rule than what it gains.
_RANKED_LOWER = _SPECIAL | OWN_CHANNEL.keys() | {LOAD}
# What is learnt in other manoeuvres may deny an effect, by so much of what it gains.
_DENIED = -0.2
# A load that weighs nothing is a thousand times less likely to begin with, in log likelihood.
ODD_LOAD = 7.0
# As are two leaks that happen to be as large as each other, the other way.
ODD_LEAKS = 7.0
# By so much more a load is one, of what stiffness and compliance gain: beside nine of these that were planted a load
# gained 0.2 to 86 less; of five loads that were, three gained 17 to 42 more (0.012 to 0.09).
_MORE_THAN_TYRES = 0.01
# What turns a car otherwise does so surely where it gains so much.
_SURELY_TURNS = 10.0 * LEAST_GAIN
# Moments are moved and all is fitted again, until they stay where they are, or that gains no more than so much.
_MOST_MOVES, _SETTLED_S, _MOVES_ON = 4, 0.2, 1.0
_RARE = {"sensor_saturation", "low_friction", "tyre_saturation"}


class Step(NamedTuple):
    """One candidate that was really fitted, and what it gains on unseen blocks."""

    effect: str
    gain: float
    fit: Fit


@dataclass(frozen=True)
class Trial:
    """Fits one effect more, or two."""

    drive: Drive
    rows: Rows
    best: Fit
    tolerance: Mapping[str, float]
    known: Slopes

    def fit(self, start: Start, each: Each = map, leader: float = 0.0) -> Step:
        """From there, judged by the slopes of its last step; no further where it stands still far behind a `leader`."""
        new, x = start
        effect, effects = new[-1], (*self.best.effects, *new)
        behind = _LITTLE * leader if leader > _MUCH else 0.0
        fit = self._fitted(x, effects, each, behind)
        if effect == "low_friction" and gained(self.drive, self.best, fit) > behind:
            # Where a stretch begins is a valley with many bends: a step of a gradient gets stuck in the first.
            for _ in range(_MOST_MOVES):
                moved = with_best_moments(self.drive, self.rows, fit)
                before, fit = fit, self._fitted(moved, effects, each)
                stays = all(abs(fit.x[i] - before.x[i]) < _SETTLED_S for i in moments_of(self.drive))
                if stays or gained(self.drive, before, fit) < _MOVES_ON:
                    break
        if effect in ONE_BY_ONE and (wheels := wheel_squares(self.drive, fit)):
            # What all wheels do alike would be another speed, and that accelerometers show too little of it.
            alone = fit.x.copy()
            alone[list(self.drive.vocabulary.columns_of(effect))] = 0.0
            alone[[INDEX[f"{effect}.{wheel}"] for wheel in wheels]] = [value for value, _ in wheels.values()]
            fit = self._fitted(alone, effects, each)
        if any(does_nothing(self.drive, fit, one) or is_implausible(self.drive, self.rows, fit, one) for one in new):
            return Step(effect, -math.inf, fit)
        if effect in GUESSED:
            # What has no slope at 0 began with those of a guess.
            fit = exactly(self.drive, self.rows, fit, self.tolerance, each)
        return Step(effect, gained(self.drive, self.best, fit), fit)

    def _fitted(self, x: Floats, effects: tuple[str, ...], each: Each = map, behind: float = 0.0) -> Fit:
        known, felt, new = self.known, self.best.felt, effects[len(self.best.effects) :]
        profiles, gains = OWN_CHANNEL.keys() & set(new), list[float]()

        def is_hopeless(fit: Fit) -> bool:
            gains.append(gained(self.drive, self.best, fit))
            stands = len(gains) > 1 and gains[-1] < min(behind, gains[-2] + _FURTHER)
            if not profiles:
                return stands
            is_lost = len(gains) > 1 and gains[-1] < _LOST
            return stands or is_lost or any(is_implausible(self.drive, self.rows, fit, one) for one in new)

        asked = is_hopeless if profiles or behind > 0.0 else None
        start = (self.drive, self.rows, x, effects, self.tolerance)
        return fitted(*start, each=each, known=known, felt=felt, is_hopeless=asked)

    def judge(self, step: Step, each: Each = map) -> Step:
        """By its own slopes, and by what other manoeuvres say."""
        effect, fit = step.effect, exactly(self.drive, self.rows, step.fit, self.tolerance, each)
        gain = gained(self.drive, self.best, fit)
        # What is there for a while, or at the limit only, is in few of the manoeuvres.
        if effect not in _RARE and gain > LEAST_GAIN and self._elsewhere(fit) < _DENIED * gain:
            return Step(effect, -math.inf, fit)
        return Step(effect, gain, fit)

    def _elsewhere(self, fit: Fit) -> float:
        gains = [gained(self.drive, self.best, fit, kind=kind) for kind in self.rows.together]
        return min(gains, default=0.0)


def all_tried(
    trial: Trial,
    starts: Sequence[Start],
    waits: Collection[str],
    enough: Callable[[list[Step]], list[Step]],
    each: Each,
) -> tuple[list[Step], frozenset[str]]:
    """All that may be the best, by rank, and what lost and waits next time.

    Beside a few effects, what lost the last time waits until of the others none gains enough.
    """
    waiting = set(waits) if len(trial.best.effects) >= _SOME else set[str]()
    fits = _fitted_each(trial, [start for start in starts if start[0][-1] not in waiting], each)
    judged = judged_steps(trial, fits, each)
    judged += _all_the_way(trial, judged, each)
    tried = _ranked(trial.drive, trial.best, judged)
    later = [start for start in starts if start[0][-1] in waiting]
    if later and not enough(tried):
        fits += (others := _fitted_each(trial, later, each))
        waiting = set()
        tried = _ranked(trial.drive, trial.best, [*judged, *judged_steps(trial, others, each)])
    hopeful = {step.effect for step in fits if step.gain > _HOPELESS}
    return tried, frozenset(waiting | ({step.effect for step in fits} - hopeful))


def _all_the_way(trial: Trial, judged: Sequence[Step], each: Each) -> list[Step]:
    """Where grip that ends for a while explains the most: grip that ends as low all the way, if that is not judged yet.

    Stiffnesses that have given way as far as they may hide that, until they are fitted beside it.
    """
    known = {step.effect for step in judged} | {*trial.best.effects}
    first = max(judged, key=lambda step: step.gain, default=None)
    if first is None or first.effect != "low_friction" or first.gain < LEAST_GAIN or "tyre_saturation" in known:
        return []
    start = (("tyre_saturation",), as_everywhere(trial.best.x, first.fit.x))
    return judged_steps(trial, [trial.fit(start, each)], each)


def _fitted_each(trial: Trial, starts: Sequence[Start], each: Each) -> list[Step]:
    """The starts' fits in their order; those that take long know what the others come to."""
    long = [i for i, start in enumerate(starts) if start[0][-1] in _LONG]
    others = [i for i in range(len(starts)) if i not in long]
    fits = dict(zip(others, all_hands(trial.fit, [starts[i] for i in others], each), strict=True))
    leader = max((step.gain for step in fits.values()), default=0.0)
    # Roads take longest.
    long.sort(key=lambda i: starts[i][0][-1] not in TILTS)

    def after(i: int, each: Each) -> Step:
        return trial.fit(starts[i], each, leader)

    fits |= zip(long, all_hands(after, long, each), strict=True)
    return [fits[i] for i in range(len(starts))]


def judged_steps(trial: Trial, tried: Iterable[Step], each: Each) -> list[Step]:
    """Those that may be the best, by their own slopes; where one of them is denied, those that come after it, too."""
    rest, judged = sorted(tried, key=lambda step: -step.gain), list[Step]()
    while rest and rest[0].gain > max([_HOPELESS, *(step.gain for step in judged)]):
        enough = max(min(_HOPEFUL * rest[0].gain, rest[0].gain - _OFF), _HOPELESS)
        judged += all_hands(trial.judge, [step for step in rest if step.gain > enough], each)
        rest = [step for step in rest if step.gain <= enough]
    return judged


def _ranked(drive: Drive, best: Fit, tried: list[Step]) -> list[Step]:
    """The best first."""
    if not tried:
        return []
    leader = max(tried, key=lambda step: step.gain)
    return [leader] if leader.gain <= 0.0 else sorted(tried, key=rank_by(drive, best, tried), reverse=True)


def rank_by(drive: Drive, best: Fit, tried: Sequence[Step]) -> Callable[[Step], float]:
    """What steps gain, as rivals: what is left hangs together more or less by candidate, so the same rows count.

    A profile fits nearly anything, and has to gain more than what has few parameters; what is special, than what is
    general; what has no name, than a name, by as much as any cause is asked for; a load that weighs nothing, than what
    turns a car as it does; and two leaks that are one turn, than a turn. How a car is drawn is a rival as names are.
    What all wheels read less has to gain the most by what it leaves itself, too.
    """
    least = _RIVALS * (most := max(step.gain for step in tried))
    same = np.exp(np.mean(np.log([step.fit.per_row for step in tried if step.gain > least]), axis=0))

    def rank(step: Step) -> float:
        alike = gained(drive, best, step.fit, same) if step.gain > least else step.gain
        if step.effect == LOAD:
            alike -= ODD_LOAD * weighs_nothing(step.fit) + odds_against_less(step.fit)
        alike -= ODD_LEAKS * (step.effect == "accel_cross_axis" and are_one_turn(step.fit))
        if step.effect in _UNNAMED:
            alike = 0.0 if step.effect == _ALL_WHEELS and step.gain < most else alike - LEAST_GAIN
        return alike * (0.8 if step.effect in OWN_CHANNEL else 1.0 / SURELY if step.effect in _SPECIAL else 1.0)

    return rank


def enough_first(
    drive: Drive, best: Fit, ranked: list[Step], asked_by: Callable[[str], float], of_a_car: float = 0.0
) -> list[Step]:
    """By rank, those that gain enough before the others; empty where none does.

    The first by rank need not be the one that gains the most: what gains too little stands in nobody's way. Neither
    does one of which the fit tells nothing: many parameters at once may come near what one of another's does.
    `of_a_car` is asked of what a car does, beside a wind that is felt anew: of a push that lasts little is told, and
    what holds against it could be anything. A wind waits for a bank that gains about as much: it takes what the
    lateral accelerometer has left, whatever that is of.
    """
    banks = max((step.gain for step in ranked if step.effect == "road_bank"), default=-math.inf)

    def gains_enough(step: Step) -> bool:
        if step.effect == "side_wind" and banks > max(LEAST_GAIN, _MAY_BE_A_BANK * step.gain):
            return False
        asked = asked_by(step.effect) * (_PROFILE_SHARES if step.effect in OWN_CHANNEL else 1.0)
        if of_a_car > asked and drive.vocabulary.described(step.effect).touches == CAR:
            asked = of_a_car
        return step.gain >= LEAST_GAIN and (step.gain >= asked or is_beyond_form(drive, best, step.fit))

    gaining = [step for step in ranked if gains_enough(step)]
    sure = [step for step in gaining if is_told(drive, step.fit, step.effect)]
    told = {step.effect for step in sure}
    # How low a limit of grip is its curve leaves open: one for a while is told no better than one all the way.
    told |= GRIP if told & GRIP else set()
    told |= _weighs_by_its_turn(drive, best, gaining)
    # How much of a load or a compliance is the tyres' leaves open, within what these may be off, and how low a limit is
    # its curve; not whether there is one: where something surely turns the car otherwise, the first is what it gains.
    turning = [step for step in gaining if step.effect in SAME_TURN | GRIP and step.gain > _SURELY_TURNS]
    tyres = next((step.fit for step in turning if step.effect == "cornering_stiffness"), None)
    told |= {step.effect for step in turning if is_rather_something(drive, step.fit, step.effect, tyres)}

    def is_vague(step: Step) -> bool:
        # From another start the same effect may be told, and gain as much.
        twins = [one for one in sure if one.effect == step.effect and one.gain > step.gain - _ALIKE]
        return bool(twins) and all(one is not step for one in sure)

    gaining.sort(key=lambda step: step.effect not in told or is_vague(step))
    return [*gaining, *(step for step in ranked if not gains_enough(step))] if gaining else []


def _weighs_by_its_turn(drive: Drive, best: Fit, gaining: Sequence[Step]) -> set[str]:
    """A load, if it gains clearly more than any stiffness or compliance does.

    How much it weighs is open within the stiffnesses' tolerance. That it turns with the car is what they have not.
    """
    alike = [step for step in gaining if step.effect in SAME_TURN]
    if not {LOAD} < {step.effect for step in alike}:
        return set()
    rank = rank_by(drive, best, alike)
    of_load = max(rank(step) for step in alike if step.effect == LOAD)
    others = max(rank(step) for step in alike if step.effect != LOAD)
    return {LOAD} if of_load > others + max(LEAST_GAIN, _MORE_THAN_TYRES * others) else set()


def rivals_of(best: Fit, tried: Sequence[Step], rank: Callable[[Step], float]) -> dict[str, tuple[Step, ...]]:
    """Of each effect that the first has more than `best`: what was tried in its place beside what else it has more.

    What they gain is what they were ranked by. One that gains more than the first by what itself leaves, and less by
    what all of them leave, is as likely: the two ways to judge do not agree.
    """
    added = [set(step.fit.effects[len(best.effects) :]) for step in tried]
    first = rank(tried[0])

    def gain(step: Step) -> float:
        is_open = step.gain > tried[0].gain and step.effect not in _RANKED_LOWER
        return max(rank(step), first) if is_open else rank(step)

    return {
        effect: tuple(
            Step(next(iter(mine - others)), gain(step), step.fit)
            for step, mine in zip(tried, added, strict=True)
            if (others := added[0] - {effect}) < mine
        )
        for effect in added[0]
    }
