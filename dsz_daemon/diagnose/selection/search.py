"""From residuals to named causes: refit what is known first, screen all effects, really fit the best, keep what holds.

A step is judged by what it gains on blocks that its fit has not seen, in log likelihood, divided by the
autocorrelation of what the LARGER model leaves: a partial explanation leaves much that hangs together and gains little.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.nuisances import TOLERATED
from dsz_daemon.diagnose.effects.shape_names import is_shape
from dsz_daemon.diagnose.effects.vocabulary import INDEX, vocabulary
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained, is_beyond_form, quiet
from dsz_daemon.diagnose.fitting.model import Fit, Slopes
from dsz_daemon.diagnose.fitting.moments import in_the_middle
from dsz_daemon.diagnose.residuals.comparison import Each, Rows, all_hands, sensitivities
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.selection.drawn import WELL, drawn, refitted
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.selection.remembered import Remembered
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.selection.smaller import (
    Grown,
    asked_of,
    plausible,
    without_courses,
    without_idle_shapes,
    without_leaners,
    without_trifles,
    worth_now,
)
from dsz_daemon.diagnose.selection.starts import starts_of
from dsz_daemon.diagnose.selection.swaps import ONE_FOR_TWO, a_load_instead, in_its_place, one_for_two
from dsz_daemon.diagnose.selection.together import two_at_once, two_instead
from dsz_daemon.diagnose.selection.trials import (
    SURELY,
    Step,
    Trial,
    all_tried,
    enough_first,
    rank_by,
    rivals_of,
)
from dsz_daemon.diagnose.selection.two_roads import both_roads
from dsz_daemon.diagnose.shapes.shape_beside import likeliest_shapes
from dsz_daemon.diagnose.shapes.uneven_scales import is_of_two
from dsz_daemon.diagnose.shapes.unlisted import BY_CHANCE, Found
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.prediction import predicted

Progress = Callable[[str], None]
# Its effects, and those that are refused beside them.
_Model = tuple[frozenset[str], frozenset[str]]

# Beside a wind, of what it gains, what a car does.
_SHARE_OF_WIND = 0.3
_MOST_EFFECTS = 6
# What is no scale to one side, or at one time, has to explain so much more than a scale.
_SURELY_UNEVEN = 1.2
# An effect that had to go may come back; not for ever, nor so often to the same model.
_MOST_STEPS, _MOST_TIMES = 12, 3
# So little may a step still take off what is left of a model that others are compared with.
# The yaw rate.
_JUDGES_WIND = 2


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
    nominal = refitted(drive, rows, tolerance, each)
    best, rivals, gains = nominal, dict[str, tuple[Step, ...]](), dict[str, float]()
    elsewhere, shapes = dict[str, dict[str, float]](), list[Found]()
    refused, waits, known, been = set[str](), frozenset[str](), None, Counter[_Model]()
    trial: Remembered | None = None
    for _ in range(_MOST_STEPS):
        if len(best.effects) >= _MOST_EFFECTS or _is_again(been, best, refused):
            break
        best = drawn(drive, rows, best, tolerance, each)
        say(f"screening what else than {', '.join(best.effects) or 'nothing'}")
        trial = _beside(trial, drive, rows, best, tolerance, known, each)
        screening, starts = trial.screening, trial.starts_but_for(refused)
        beside = _SHARE_OF_WIND * gains.get("side_wind", 0.0)
        enough = partial(
            enough_first,
            drive,
            best,
            asked_by=partial(asked_of, drive, gains=dict(gains)),
            of_a_car=beside * best.felt.is_anew,
        )
        tried, waits = all_tried(trial, starts, waits, enough, each)
        shaped = _nameless(trial, tried, gains, each)
        # What has no name may be what the wrong one of two that are alike has left.
        if shaped is not None and (again := _chosen_again(trial, nominal, rivals, gains, elsewhere, say, each)):
            best = again
            continue
        two = two_instead(trial, screening, tried, refused, shaped[-1], each) if shaped is not None else []
        if shaped is not None and not two:
            before, (drive, best, shape) = best, shaped
            say(f"{shape.channel} has a shape without a name: {shape.shape}")
            name = shape.effect.name
            gains[name], rivals[name], elsewhere[name] = shape.gain, tuple[Step, ...](), {}
            best, gains = Grown(drive, rows, tolerance, before, best, each).what_stays(gains)
            # One that had to go may come back.
            shapes += [] if name in {known.effect.name for known in shapes} else [shape]
            nominal = nominal._replace(x=np.pad(nominal.x, (0, len(best.x) - len(nominal.x))))
            continue
        tried = (
            two
            or both_roads(trial, tried, refused, each)
            or enough(tried)
            or two_at_once(trial, screening, starts, refused, each)
        )
        if (not tried or tried[0].gain < beside) and (anew := _with_wind_anew(trial, each)) is not None:
            best = anew
            continue
        if not tried:
            break
        before, gained_before, now = best, dict(gains), tried[0].fit
        if not now.road.bank_rad.any() and not now.road.grade_rad.any():
            now = fitted(drive, rows, now.x, now.effects, tolerance, WELL, each)
        grown = Grown(drive, rows, tolerance, before, now, each)
        if (settled := grown.settled()) is not None:
            best = _without_its_twin(drive, best, settled, gains, rivals, elsewhere)
            continue
        _write_down(drive, rows, best, tried, rivals, gains, elsewhere)
        best = grown.without_idle(gains)
        best, wrong = plausible(drive, rows, before, best, tolerance, each)
        # Of the same model two may drive each other out for ever.
        refused, known = wrong | (refused if best is before else set()), grown.known if best is now else None
        gains = {effect: (gained_before if best is before else gains)[effect] for effect in best.effects}
    found = Search(drive, rows, nominal, best, rivals, gains, elsewhere, tuple(shapes))
    return _kept(_each_in_its_place(found, tolerance, say, each), tolerance, best.effects, each)


def _beside(
    before: Remembered | None,
    drive: Drive,
    rows: Rows,
    best: Fit,
    tolerance: Mapping[str, float],
    known: Slopes | None,
    each: Each,
) -> Remembered:
    """What can be tried beside a model; of the same model as `before` that is it, with all that was tried."""
    if before is not None and before.best is best:
        return before
    screening = screened(drive, rows, best, tolerance, each, known)
    starts = tuple(starts_of(drive, rows, best, screening.names, each))
    return Remembered(drive, rows, best, tolerance, screening.known, screening, starts)


def _is_again(been: Counter[_Model], best: Fit, refused: set[str]) -> bool:
    """Whether the search has been at this model, with the same refused, as often as it may; counts that it is."""
    here = frozenset(best.effects), frozenset(refused)
    been[here] += 1
    return been[here] == _MOST_TIMES


def _write_down(
    drive: Drive,
    rows: Rows,
    best: Fit,
    tried: Sequence[Step],
    rivals: dict[str, tuple[Step, ...]],
    gains: dict[str, float],
    elsewhere: dict[str, dict[str, float]],
) -> None:
    """Writes what the first of those that were tried gains, here and elsewhere, and what was held against it."""
    first = tried[0]
    rivals |= rivals_of(best, tried, rank_by(drive, best, tried))
    elsewhere |= {
        effect: {kind: gained(drive, best, first.fit, kind=kind) for kind in rows.together}
        for effect in first.fit.effects[len(best.effects) :]
    }
    gains[first.effect] = first.gain


def _chosen_again(
    trial: Trial,
    nominal: Fit,
    rivals: dict[str, tuple[Step, ...]],
    gains: dict[str, float],
    elsewhere: dict[str, dict[str, float]],
    say: Progress,
    each: Each,
) -> Fit | None:
    """The model with others in the place of what came early, if any gains more; writes what these gain."""
    so_far = Search(trial.drive, trial.rows, nominal, trial.best, rivals, gains, elsewhere)
    again = _each_in_its_place(so_far, trial.tolerance, say, each)
    if again.best is trial.best:
        return None
    for effect in set(so_far.best.effects) - set(again.best.effects):
        del rivals[effect], gains[effect], elsewhere[effect]
    rivals |= again.rivals
    gains |= again.gains
    elsewhere |= {effect: dict(gain) for effect, gain in again.elsewhere.items()}
    return again.best


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


def _each_in_its_place(found: Search, tolerance: Mapping[str, float], say: Progress, each: Each) -> Search:
    """What came before others did gives its place to a rival that gains more beside these."""
    best, gains, elsewhere = found.best, dict(found.gains), dict(found.elsewhere)
    rivals = dict(found.rivals)
    if len(best.effects) > 1:
        say("trying what came near each in its place")
    # The newest was held against all of them beside the same.
    for effect in best.effects[:-1]:
        if is_shape(effect):
            continue
        others = in_its_place(found.drive, found.rows, found.nominal, best, effect, rivals[effect], tolerance, each)
        if not others:
            continue
        top = next(step.gain for step in rivals[effect] if step.effect == effect)
        tried = [Step(effect, top, best), *(step._replace(gain=top + step.gain) for step in others)]
        again = {step.effect for step in tried}
        steps = (*tried, *(step for step in rivals[effect] if step.effect not in again))
        first, more = (others[0].effect, others[0].gain) if others[0].gain > 0.0 else (effect, 0.0)
        if first != effect:
            best = others[0].fit
            gains[first], elsewhere[first] = gains.pop(effect) + more, {}
            del rivals[effect], elsewhere[effect]
        rivals[first] = steps
    return found._replace(best=best, gains=gains, rivals=rivals, elsewhere=elsewhere)


def _with_a_load(found: Search, tolerance: Mapping[str, float], each: Each) -> Search:
    """The search with a load for what one does to tyres and inertia at once, where that is as good."""
    loaded = a_load_instead(found.drive, found.rows, found.nominal, found.best, found.rivals, tolerance, each)
    if loaded is None:
        return found
    gone = set(found.best.effects) - set(loaded.fit.effects)
    gain = loaded.gain + sum(found.gains[effect] for effect in gone)
    steps = tuple(step for effect in sorted(gone) for step in found.rivals[effect] if step.effect != loaded.effect)
    return found._replace(
        best=loaded.fit,
        gains={**{e: g for e, g in found.gains.items() if e not in gone}, loaded.effect: gain},
        rivals={
            **{e: r for e, r in found.rivals.items() if e not in gone},
            loaded.effect: (Step(loaded.effect, gain, loaded.fit), *steps),
        },
        elsewhere={**{e: k for e, k in found.elsewhere.items() if e not in gone}, loaded.effect: {}},
    )


def _with_one_for_two(found: Search, one: str, tolerance: Mapping[str, float], each: Each) -> Search:
    """The search with one cause for what it does as two, where that is as good."""
    instead = one_for_two(found.drive, found.rows, found.nominal, found.best, one, tolerance, each)
    if instead is None:
        return found
    gone = set(found.best.effects) - set(instead.fit.effects)
    gain = instead.gain + sum(found.gains[effect] for effect in gone)
    stays = [effect for effect in instead.fit.effects if effect != one]
    return found._replace(
        best=instead.fit,
        gains={**{effect: found.gains[effect] for effect in stays}, one: gain},
        rivals={**{effect: found.rivals[effect] for effect in stays}, one: (instead._replace(gain=gain),)},
        elsewhere={**{effect: found.elsewhere[effect] for effect in stays}, one: {}},
    )


def _kept(found: Search, tolerance: Mapping[str, float], came: Sequence[str], each: Each) -> Search:
    """One cause for two where it does what both do, without trifles, and what was found of them.

    `came`: the effects in the order in which they did, before any gave its place to another.
    """
    for one in ONE_FOR_TWO:
        found = _with_one_for_two(found, one, tolerance, each)
    found = _with_a_load(found, tolerance, each)
    gains = worth_now(found.drive, found.rows, found.best, tolerance, found.gains, came, each)
    best = without_trifles(found.drive, found.rows, found.best, tolerance, gains, each)
    best = without_idle_shapes(found.drive, found.rows, best, tolerance, each)
    best = without_leaners(found.drive, found.rows, best, tolerance, gains, each)
    best = without_courses(found.drive, found.rows, best, tolerance, gains, each)
    best = in_the_middle(found.drive, found.rows, best, tolerance, each)
    shapes = tuple(shape for shape in found.shapes if shape.effect.name in best.effects)
    return found._replace(
        best=best, gains=gains, rivals={effect: found.rivals[effect] for effect in best.effects}, shapes=shapes
    )


def _with_wind_anew(trial: Trial, each: Each) -> Fit | None:
    """Where the yaw rate is still off: the same model, of which other tyres have another wind; None where none has.

    Nor where that is none any more: what other tyres do not hold may be taken for wind that follows the car.
    """
    felt = None if quiet(trial.drive, trial.best)[_JUDGES_WIND] else trial.best.felt.anew()
    if felt is None:
        return None
    best = trial.best
    anew = fitted(trial.drive, trial.rows, best.x, best.effects, trial.tolerance, each=each, felt=felt)
    return None if is_implausible(trial.drive, trial.rows, anew, "side_wind") else anew


def _nameless(
    trial: Trial, tried: Sequence[Step], gains: Mapping[str, float], each: Each
) -> tuple[Drive, Fit, Found] | None:
    """What has no name and gains more than what was tried: the drive with its row, the model with it, and itself."""
    named = max((step.gain for step in tried), default=0.0)
    drive, rows, best, tolerance = trial.drive, trial.rows, trial.best, trial.tolerance

    def least(shape: Found) -> float:
        # A scale is one number for what is told by two: when, and how much.
        return named * (_SURELY_UNEVEN if is_of_two(shape.shape.removeprefix("k*")) else SURELY)

    def shaped(shape: Found, inside: Each) -> tuple[Drive, Fit, Found] | None:
        there, fit, one = _shaped(drive, rows, best, shape, tolerance, inside)
        is_enough = one.gain >= asked_of(there, one.effect.name, gains) or is_beyond_form(drive, best, fit)
        return (there, fit, one) if is_enough and one.gain > max(least(shape), LEAST_GAIN) else None

    shapes = likeliest_shapes(drive, rows, best, trial.known, tolerance, each, beside=named > LEAST_GAIN)
    fits = all_hands(shaped, [shape for shape in shapes if shape.gain > least(shape)], each)
    found = [one for one in fits if one is not None]
    return max(found, key=lambda one: one[2].gain, default=None)


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
