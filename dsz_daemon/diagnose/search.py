"""From residuals to named causes: refit what is known first, screen all effects, really fit the best, keep what holds.

A step is judged by what it gains on blocks that its fit has not seen, in log likelihood, divided by the
autocorrelation of what the LARGER model leaves: a partial explanation leaves much that hangs together and gains little.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.comparison import Each, Rows, all_hands, sensitivities
from dsz_daemon.diagnose.effect_row import CAR
from dsz_daemon.diagnose.effects import GUESSED, INDEX, NAMELESS, TOLERATED, vocabulary
from dsz_daemon.diagnose.evidence import LEAST_GAIN
from dsz_daemon.diagnose.fit import GRIP, ONE_BY_ONE, OWN_CHANNEL, TILTS, Fit, Slopes, exactly, fitted
from dsz_daemon.diagnose.gains import far_off, gained, is_beyond_form, puts_right, quiet
from dsz_daemon.diagnose.moments import in_the_middle, moments_of, with_best_moments
from dsz_daemon.diagnose.plausible import is_implausible, is_told
from dsz_daemon.diagnose.prediction import Drive, Floats, nothing, predicted
from dsz_daemon.diagnose.screening import Screening, feels, screened
from dsz_daemon.diagnose.shape_beside import likeliest_shape
from dsz_daemon.diagnose.smaller import Grown, asked_of, plausible, without_trifles, worth_now
from dsz_daemon.diagnose.starts import Start, starts_of
from dsz_daemon.diagnose.unlisted import BY_CHANCE, Found, wheel_squares

Progress = Callable[[str], None]

# Beside a wind, of what it gains, what a car does.
_SHARE_OF_WIND = 0.3
# A profile fits nearly anything.
_PROFILE_SHARES = 2.0
# The most promising of two at once; and what makes a gyro show more than its own rate.
_PAIRS = 3
_OTHERS, _SHOWS_MORE = 2, ("gyro_cross_axis", "gyro_scale", "gyro_g_sensitivity", "imu_misalignment")
# By slopes that are a step old, what gains so much of the most, or is so little off it, is judged by its own, unless it
# is hopeless.
_HOPEFUL, _OFF, _HOPELESS = 0.4, 20.0, 0.0
# What a profile has lost after some rounds of its fit no further ones bring back.
_LOST = -20.0
# Of the most that any candidate gains: from here on they are compared on the same number of independent rows.
_RIVALS = 0.5
_MOST_EFFECTS = 6
# An effect that had to go may come back; not for ever.
_MOST_STEPS = 12
# So little may a step still take off what is left of a model that others are compared with.
_WELL = 2e-5
# What has no name has to explain so much more than what has one; and grip that ends for a while, than grip that ends.
_SURELY, _SPECIAL = 1.05, frozenset({"low_friction", *(effect.name for effect in NAMELESS)})
# What is learnt in other manoeuvres may deny an effect, by so much of what it gains.
_DENIED = -0.2
# Moments are moved and all is fitted again, until they stay where they are.
_MOST_MOVES, _SETTLED_S = 4, 0.2
# The yaw rate.
_JUDGES_WIND = 2
_RARE = {*GUESSED, "tyre_saturation"}


class Step(NamedTuple):
    """One candidate that was really fitted, and what it gains on unseen blocks."""

    effect: str
    gain: float
    fit: Fit


class Search(NamedTuple):
    """The nominal refit, the model at the end, and the rivals of each effect at the time it was chosen.

    `elsewhere`: what each gains on whole manoeuvres and recordings that its fit has not seen. `shapes` explained more
    than any name did, and are in the drive's prediction.
    """

    drive: Drive
    rows: Rows
    nominal: Fit
    best: Fit
    rivals: Mapping[str, tuple[Step, ...]]
    gains: Mapping[str, float]
    elsewhere: Mapping[str, Mapping[str, float]] = MappingProxyType({})
    shapes: tuple[Found, ...] = ()


def searched(
    drive: Drive,
    rows: Rows,
    tolerance: Mapping[str, float],
    progress: Progress | None = None,
    each: Each = map,
) -> Search:
    """The named causes of one drive, of the rows that are compared; `each` is a `map` that works side by side."""
    say = progress or (lambda _: None)
    say("refitting offsets and what has a tolerance")
    nominal = fitted(drive, rows, nothing(drive.vocabulary), (), tolerance, _WELL, each)
    best, rivals = nominal, {}
    gains: dict[str, float] = {}
    elsewhere: dict[str, dict[str, float]] = {}
    shapes: list[Found] = []
    refused: set[str] = set()
    for _ in range(_MOST_STEPS):
        if len(best.effects) >= _MOST_EFFECTS:
            break
        say(f"screening what else than {', '.join(best.effects) or 'nothing'}")
        screening = screened(drive, rows, best, tolerance, each)
        trial = _Trial(drive, rows, best, tolerance, screening.known)
        starts = [start for start in starts_of(drive, rows, best, screening.names, each) if not set(start[0]) & refused]
        tried = _ranked(drive, best, _judged(trial, each(trial.fit, starts), each))
        named = max((step.gain for step in tried), default=0.0)
        shape = likeliest_shape(drive, rows, best, screening.known, tolerance, beside=named > LEAST_GAIN)
        if shape is not None and shape.gain > _SURELY * named:
            there, shaped, shape = _shaped(drive, rows, best, shape, tolerance, each)
            is_enough = shape.gain >= asked_of(there, shape.effect.name, gains) or is_beyond_form(drive, best, shaped)
            if is_enough and shape.gain > max(_SURELY * named, LEAST_GAIN):
                say(f"{shape.channel} has a shape without a name: {shape.shape}")
                name, drive, best = shape.effect.name, there, shaped
                gains[name], rivals[name], elsewhere[name] = shape.gain, tuple[Step, ...](), {}
                # One that had to go may come back.
                shapes += [] if name in {known.effect.name for known in shapes} else [shape]
                nominal = nominal._replace(x=np.pad(nominal.x, (0, len(best.x) - len(nominal.x))))
                continue
        beside = _SHARE_OF_WIND * gains.get("side_wind", 0.0)
        tried = _enough_first(
            drive, best, tried, partial(asked_of, drive, gains=dict(gains)), beside * best.felt.is_anew
        ) or _two_at_once(trial, screening, refused, each)
        if (not tried or tried[0].gain < beside) and (anew := _with_wind_anew(trial, each)) is not None:
            best = anew
            continue
        if not tried:
            break
        before, gained_before, new = best, dict(gains), tried[0].effect
        grown = Grown(drive, rows, tolerance, best, tried[0].fit, each)
        if (settled := grown.settled()) is not None:
            best = _without_its_twin(drive, best, settled, gains, rivals, elsewhere)
            continue
        rivals |= _rivals(best, tried, _rank(drive, best, tried))
        elsewhere |= {
            effect: {kind: gained(drive, best, tried[0].fit, kind=kind) for kind in rows.together}
            for effect in tried[0].fit.effects[len(best.effects) :]
        }
        best, gains[new] = tried[0].fit, tried[0].gain
        if not best.road.bank_rad.any() and not best.road.grade_rad.any():
            best = fitted(drive, rows, best.x, best.effects, tolerance, _WELL, each)
            grown = Grown(drive, rows, tolerance, before, best, each)
        best = grown.without_idle(gains)
        best, wrong = plausible(drive, rows, before, best, tolerance, each)
        # Of the same model two may drive each other out for ever.
        refused = wrong | (refused if best is before else set())
        gains = {effect: (gained_before if best is before else gains)[effect] for effect in best.effects}
    return _kept(Search(drive, rows, nominal, best, rivals, gains, elsewhere, tuple(shapes)), tolerance, each)


def _without_its_twin(
    drive: Drive,
    before: Fit,
    settled: Fit,
    gains: dict[str, float],
    rivals: dict[str, tuple[Step, ...]],
    elsewhere: dict[str, dict[str, float]],
) -> Fit:
    """The settled model; of two that came at once the one that stays has gained what both did. Writes what it gains."""
    for effect in settled.effects:
        if effect not in gains:
            gains[effect] = gained(drive, before, settled)
            rivals[effect] = (Step(effect, gains[effect], settled),)
            elsewhere[effect] = {}
    return settled


def _kept(found: Search, tolerance: Mapping[str, float], each: Each) -> Search:
    """Without trifles, and what was found of them."""
    gains = worth_now(found.drive, found.rows, found.best, tolerance, found.gains, each)
    best = without_trifles(found.drive, found.rows, found.best, tolerance, gains, each)
    best = in_the_middle(found.drive, found.rows, best, tolerance, each)
    shapes = tuple(shape for shape in found.shapes if shape.effect.name in best.effects)
    return found._replace(
        best=best, gains=gains, rivals={effect: found.rivals[effect] for effect in best.effects}, shapes=shapes
    )


def _with_wind_anew(trial: _Trial, each: Each) -> Fit | None:
    """Where the yaw rate is still off: the same model, of which other tyres have another wind; None where none has."""
    felt = None if quiet(trial.drive, trial.best)[_JUDGES_WIND] else trial.best.felt.anew()
    if felt is None:
        return None
    best = trial.best
    return fitted(trial.drive, trial.rows, best.x, best.effects, trial.tolerance, each=each, felt=felt)


def _shaped(
    drive: Drive, rows: Rows, best: Fit, shape: Found, tolerance: Mapping[str, float], each: Each
) -> tuple[Drive, Fit, Found]:
    """The drive whose vocabulary has the shape, too, the model with it, and what it gains as names are judged.

    By its own channel alone, all of whose rows scatter alike, what shows in a few blocks would gain twice that.
    """
    start, name = best.x.copy(), shape.effect.name
    if name not in {effect.name for effect in drive.vocabulary.effects}:
        drive = drive._replace(vocabulary=vocabulary((*drive.vocabulary.own(), shape.effect)))
        start = np.append(start, 0.0)
    start[list(drive.vocabulary.columns_of(name))] = shape.value
    fit = fitted(drive, rows, start, (*best.effects, name), tolerance, each=each, felt=best.felt)
    return drive, fit, shape._replace(gain=min(shape.gain, gained(drive, best, fit) - BY_CHANCE))


def _two_at_once(trial: _Trial, screening: Screening, refused: set[str], each: Each) -> list[Step]:
    """What two effects gain that hide each other while a channel is far off, the most first; empty where none do.

    An IMU that is late and a steering that is, too, turn the car in time with each other; of a road that is felt by a
    gyro which shows more than its own rate nothing is left as it is.
    """
    off = far_off(trial.drive, trial.best)
    if not off.any():
        return []
    roads = [
        (other, road)
        for road in sorted(TILTS - set(trial.best.effects))
        if off[OWN_CHANNEL[road]] and feels(trial.drive, trial.rows, trial.best, road)
        for other in [name for name in screening.names if name in _SHOWS_MORE][:_OTHERS]
    ]
    pairs = [pair for pair in (*roads, *screening.pairs(off)[:_PAIRS]) if not set(pair) & refused]
    tried = _judged(trial, each(trial.fit, [(pair, trial.best.x) for pair in pairs]), each)
    return sorted(
        (step for step in tried if step.gain > LEAST_GAIN and puts_right(trial.drive, trial.best, step.fit)),
        key=lambda step: -step.gain,
    )


def _rivals(best: Fit, tried: Sequence[Step], rank: Callable[[Step], float]) -> dict[str, tuple[Step, ...]]:
    """Of each effect that the first has more than `best`: what was tried in its place beside what else it has more.

    What they gain is what they were ranked by.
    """
    added = [set(step.fit.effects[len(best.effects) :]) for step in tried]
    return {
        effect: tuple(
            Step(next(iter(mine - others)), rank(step), step.fit)
            for step, mine in zip(tried, added, strict=True)
            if (others := added[0] - {effect}) < mine
        )
        for effect in added[0]
    }


@dataclass(frozen=True)
class _Trial:
    """Fits one effect more, or two."""

    drive: Drive
    rows: Rows
    best: Fit
    tolerance: Mapping[str, float]
    known: Slopes

    def fit(self, start: Start) -> Step:
        """From there, judged by the slopes of its last step."""
        new, x = start
        effect, effects = new[-1], (*self.best.effects, *new)
        fit = self._fitted(x, effects)
        if effect == "low_friction" and gained(self.drive, self.best, fit) > 0.0:
            # Where a stretch begins is a valley with many bends: a step of a gradient gets stuck in the first.
            for _ in range(_MOST_MOVES):
                moved = with_best_moments(self.drive, self.rows, fit)
                before, fit = fit.x, self._fitted(moved, effects)
                if all(abs(fit.x[i] - before[i]) < _SETTLED_S for i in moments_of(self.drive)):
                    break
        if effect in ONE_BY_ONE and (wheels := wheel_squares(self.drive, fit)):
            # What all wheels do alike would be another speed, and that accelerometers show too little of it.
            alone = fit.x.copy()
            alone[list(self.drive.vocabulary.columns_of(effect))] = 0.0
            alone[[INDEX[f"{effect}.{wheel}"] for wheel in wheels]] = [value for value, _ in wheels.values()]
            fit = self._fitted(alone, effects)
        if any(is_implausible(self.drive, self.rows, fit, one) for one in new):
            return Step(effect, -math.inf, fit)
        if effect in GUESSED:
            # What has no slope at 0 began with those of a guess.
            fit = exactly(self.drive, self.rows, fit, self.tolerance)
        return Step(effect, gained(self.drive, self.best, fit), fit)

    def _fitted(self, x: Floats, effects: tuple[str, ...]) -> Fit:
        known, felt, new = self.known, self.best.felt, effects[-1]

        def is_hopeless(fit: Fit) -> bool:
            return gained(self.drive, self.best, fit) < _LOST or is_implausible(self.drive, self.rows, fit, new)

        asked = is_hopeless if new in OWN_CHANNEL else None
        return fitted(self.drive, self.rows, x, effects, self.tolerance, known=known, felt=felt, is_hopeless=asked)

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


def _judged(trial: _Trial, tried: Iterable[Step], each: Each) -> list[Step]:
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
    return [leader] if leader.gain <= 0.0 else sorted(tried, key=_rank(drive, best, tried), reverse=True)


def _rank(drive: Drive, best: Fit, tried: Sequence[Step]) -> Callable[[Step], float]:
    """What steps gain, as rivals: what is left hangs together more or less by candidate, so the same rows count.

    A profile fits nearly anything, and has to gain more than what has few parameters; what is special, than what is
    general.
    """
    least = _RIVALS * max(step.gain for step in tried)
    same = np.exp(np.mean(np.log([step.fit.per_row for step in tried if step.gain > least]), axis=0))

    def rank(step: Step) -> float:
        alike = gained(drive, best, step.fit, same) if step.gain > least else step.gain
        return alike * (0.8 if step.effect in OWN_CHANNEL else 1.0 / _SURELY if step.effect in _SPECIAL else 1.0)

    return rank


def _enough_first(
    drive: Drive, best: Fit, ranked: list[Step], asked_by: Callable[[str], float], of_a_car: float = 0.0
) -> list[Step]:
    """By rank, those that gain enough before the others; empty where none does.

    The first by rank need not be the one that gains the most: what gains too little stands in nobody's way. Neither
    does one of which the fit tells nothing: many parameters at once may come near what one of another's does.
    `of_a_car` is asked of what a car does, beside a wind that is felt anew: of a push that lasts little is told, and
    what holds against it could be anything.
    """

    def gains_enough(step: Step) -> bool:
        asked = asked_by(step.effect) * (_PROFILE_SHARES if step.effect in OWN_CHANNEL else 1.0)
        if of_a_car > asked and drive.vocabulary.described(step.effect).touches == CAR:
            asked = of_a_car
        return step.gain >= LEAST_GAIN and (step.gain >= asked or is_beyond_form(drive, best, step.fit))

    gaining = [step for step in ranked if gains_enough(step)]
    told = {step.effect for step in gaining if is_told(drive, step.fit, step.effect)}
    # How low a limit of grip is its curve leaves open: one for a while is told no better than one all the way.
    told |= GRIP if told & GRIP else set()
    gaining.sort(key=lambda step: step.effect not in told)
    return [*gaining, *(step for step in ranked if not gains_enough(step))] if gaining else []


def slopes_of(found: Search, columns: Sequence[int], each: Each = map) -> Floats:
    """Sensitivities (k, 13, len(columns)) at the end of the search."""
    best = found.best
    base = predicted(found.drive, best.x, best.road)
    return sensitivities(found.drive, found.rows, best.x, best.road, base, columns, None, each)


def tolerance_gain(found: Search, each: Each = map) -> float:
    """What refitting the configured parameters gains over leaving them as they are, causes included."""
    start = found.best.x.copy()
    start[[INDEX[p.name] for p in TOLERATED]] = 0.0
    held = fitted(found.drive, found.rows, start, found.best.effects, {}, each=each, felt=found.best.felt)
    return gained(found.drive, held._replace(form=found.rows.form, columns=found.best.columns), found.best)
