"""From residuals to named causes: refit what is known first, screen all effects, really fit the best, keep what holds.

A step is judged by what it gains on blocks that its fit has not seen, in log likelihood, divided by the
autocorrelation of what the LARGER model leaves: a partial explanation leaves much that hangs together and gains little.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.diagnose.comparison import Bools, Rows, floors, residual, robust_std, sensitivities
from dsz_daemon.diagnose.effects import BUILT_IN, GUESSED, NUISANCES, OFFSETS, STIFFNESS, Parameter
from dsz_daemon.diagnose.evidence import Box, Sums, correlated_rows, gain, held_out, solved, sums
from dsz_daemon.diagnose.guesses import guesses
from dsz_daemon.diagnose.prediction import Drive, Floats, Profiles, felt_road, flat, nothing, predicted

Progress = Callable[[str], None]
# `map`, or one that works side by side.
Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]

# In log likelihood on unseen blocks: what one of thirty candidates may reach by chance is some ln(30) = 3.4.
LEAST_GAIN = 10.0
# A parameter more has to be paid for; one that the drive does not move is none.
_A_PARAMETER = 3.0
# No effect of a real car is to the letter what the simulation makes of it.
_EFFECT_FORM = 0.03
# What comes after the first may be what the simulation's form gets wrong about it: it has to gain so much of the rest.
_SHARE_OF_ALL = 0.03
# No effect of a real car is to the letter what the simulation makes of it: its parameter is so uncertain at least.
_OF_ITSELF = 0.02
_TRIED = 7
_MOMENTS = [("low_friction", p) for p in BUILT_IN.described("low_friction").parameters if p.name.endswith("_s")]
_UPRIGHT = 5
_TOLERATED = tuple(range(len(OFFSETS), len(OFFSETS) + len(STIFFNESS)))
# Of the power that noise and form may leave: a channel with less has nothing to gain.
_QUIET = 0.7
# Of the most that any candidate gains: from here on they are compared on the same number of independent rows.
_RIVALS = 0.5
_MOST_EFFECTS = 6
_ROUNDS = 12


class Fit(NamedTuple):
    """A converged model: its parameters, their spread, what it leaves, and its sums over all of its own columns."""

    x: Floats
    std: Floats
    effects: tuple[str, ...]
    left: Floats
    scatter: Floats
    per_row: Floats
    sums: Sums
    columns: tuple[int, ...]
    unseen: Floats
    road: Profiles
    form: Floats


class Step(NamedTuple):
    """One candidate that was really fitted, and what it gains on unseen blocks."""

    effect: str
    gain: float
    fit: Fit


class Search(NamedTuple):
    """The nominal refit, the model at the end, and the rivals of each effect at the time it was chosen."""

    drive: Drive
    rows: Rows
    nominal: Fit
    best: Fit
    rivals: Mapping[str, tuple[Step, ...]]
    gains: Mapping[str, float]


def box_of(
    parameters: Sequence[tuple[str, Parameter]], x: Floats, columns: Sequence[int], tolerance: Mapping[str, float]
) -> Box:
    """How far the columns may go from x: the plausible, the tolerance for configured stiffnesses."""
    low, high = [], []
    for i in columns:
        parameter = parameters[i][1]
        most = tolerance.get(parameter.name) if i in NUISANCES else None
        low.append((parameter.low if most is None else -most) - x[i])
        high.append((parameter.high if most is None else most) - x[i])
    # A prior as wide as what is plausible keeps what nothing was said of where it is.
    width = np.array([parameters[i][1].high - parameters[i][1].low for i in columns])
    return Box(np.array(low), np.array(high), 1.0 / width**2)


def fitted(
    drive: Drive,
    rows: Rows,
    start: Floats,
    effects: tuple[str, ...],
    tolerance: Mapping[str, float],
) -> Fit:
    """Gauss-Newton in the box to convergence, over offsets, stiffnesses and the effects' parameters."""
    words = drive.vocabulary
    first = [i for i in NUISANCES if "cornering_stiffness" not in effects or i not in _TOLERATED]
    # A guessed effect's parameter that nothing was guessed of is not there.
    columns = (
        *first,
        *(i for e in effects for i in words.columns_of(e) if e not in GUESSED or start[i] != 0.0),
    )
    floor = floors(drive)
    x = start.copy()
    if "cornering_stiffness" in effects:
        # Beyond the tolerance it has one name, not two.
        x[list(words.columns_of("cornering_stiffness"))] += x[list(_TOLERATED)]
        x[list(_TOLERATED)] = 0.0
    for profile in _OWN_CHANNEL:
        x[list(words.columns_of(profile))] = 0.0
    road = felt_road(drive, x, effects)
    base = predicted(drive, x, road)
    left = residual(rows, base)
    scatter = robust_std(rows, left, floor)
    for _ in range(_ROUNDS):
        slopes = sensitivities(drive, rows, x, road, base, columns)
        found = sums(rows, left, slopes, scatter)
        box = box_of(words.columns, x, columns, tolerance)
        step = solved(found.squares.sum(axis=(0, 1)), found.cross.sum(axis=(0, 1)), box)
        before = _loss(left, rows, scatter)
        share = 1.0
        while share > 0.05:
            trial = x.copy()
            trial[list(columns)] += share * step
            trial_base = predicted(drive, trial, road)
            trial_left = residual(rows, trial_base)
            if _loss(trial_left, rows, scatter) < before:
                break
            share *= 0.4
        else:
            break
        gone = before - _loss(trial_left, rows, scatter)
        x, base, left = trial, trial_base, trial_left
        new = robust_std(rows, left, floor)
        settled = gone < 1e-3 * before + 0.5 and bool(np.all(np.abs(new / scatter - 1.0) < 0.05))
        scatter = new
        if settled:
            break
    slopes = sensitivities(drive, rows, x, road, base, columns)
    found = sums(rows, left, slopes, scatter)
    per_row = correlated_rows(left, rows.used)
    box = box_of(words.columns, x, columns, tolerance)
    # When a stretch begins and ends is told by the moments around, which some fold has not seen.
    lasting = [place for place, i in enumerate(columns) if words.columns[i] not in _MOMENTS]
    unseen = held_out(found, lasting, box) * scatter**2
    form = _form(drive, rows, x, effects, base)
    std = np.hypot(_spread(found, per_row, box), _OF_ITSELF * np.abs(x[list(columns)]))
    return Fit(x, std, effects, left, scatter, per_row, found, columns, unseen, road, form)


def _form(drive: Drive, rows: Rows, x: Floats, effects: tuple[str, ...], base: Floats) -> Floats:
    """What the simulation's form may be off by (13,): its own, and a share of what the effects in it do."""
    if not effects:
        return rows.form
    without = x.copy()
    without[[i for effect in effects for i in drive.vocabulary.columns_of(effect)]] = 0.0
    change = np.where(rows.used, (base - predicted(drive, without, flat(len(base))))[rows.at], 0.0)
    rms = np.sqrt(np.sum(change**2, axis=0) / np.maximum(np.sum(rows.used, axis=0), 1))
    found = np.hypot(rows.form, _EFFECT_FORM * rms)
    if {"road_bank", "road_grade"} & set(effects):
        # A road that a gyro has felt has the gyro's noise in it, and -q v shows it.
        noise = float(np.nan_to_num(floors(drive)[1])) * float(np.sqrt(np.mean(drive.wheels**2)))
        found[_UPRIGHT] = math.hypot(found[_UPRIGHT], noise)
    return np.asarray(found, dtype=np.float64)


def _loss(left: Floats, rows: Rows, scatter: Floats) -> float:
    """Half the sum of squares, beyond four deviations as for a distance."""
    # A car that has become unstable is infinitely wrong, and that is all that counts.
    z = np.nan_to_num(np.minimum(np.abs(left / scatter), 1e9), nan=1e9)
    return float(np.sum(np.where(z < 4.0, 0.5 * z * z, 4.0 * z - 8.0)[rows.used]))


def _spread(found: Sums, per_row: Floats, box: Box) -> Floats:
    """Standard deviations by the sandwich over blocks, no less than autocorrelation allows."""
    bread = np.linalg.inv(found.squares.sum(axis=(0, 1)) + np.diag(np.maximum(box.weight, 1e-12)))
    n = np.maximum(found.counts.sum(axis=0), 1.0)
    power = found.left.sum(axis=0) / n
    meat = np.einsum("bcij,c->ij", found.squares, power * per_row)
    block = found.cross.sum(axis=1)
    meat_blocks = block.T @ block
    one, other = bread @ meat @ bread, bread @ meat_blocks @ bread
    prior = bread @ np.diag(box.weight) @ bread
    variance = np.maximum(np.diag(one), np.diag(other)) + np.diag(prior)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)


def searched(
    drive: Drive,
    rows: Rows,
    tolerance: Mapping[str, float],
    progress: Progress | None = None,
    each: Each | None = None,
) -> Search:
    """The named causes of one drive, of the rows that are compared; `each` is a `map` that works side by side."""
    say = progress or (lambda _: None)
    by_stiffness = {p.name: tolerance.get(f"{p.name}_n_per_rad", 0.0) for p in STIFFNESS}
    say("refitting offsets and stiffnesses")
    nominal = fitted(drive, rows, nothing(drive.vocabulary), (), by_stiffness)
    best, rivals = nominal, {}
    gains: dict[str, float] = {}
    while len(best.effects) < _MOST_EFFECTS:
        say(f"screening what else than {', '.join(best.effects) or 'nothing'}")
        fit_one, starts = _Trial(drive, rows, best, by_stiffness), _starts(drive, rows, best, by_stiffness)
        tried = list(each(fit_one, starts)) if each else [fit_one(start) for start in starts]
        tried = _ranked(drive, best, tried)
        if not tried or tried[0].gain < max(LEAST_GAIN, _SHARE_OF_ALL * sum(gains.values())):
            break
        best = tried[0].fit
        rivals[tried[0].effect], gains[tried[0].effect] = tuple(tried), tried[0].gain
        best = _without_idle(drive, rows, best, by_stiffness, gains)
    return Search(drive, rows, nominal, best, {e: rivals[e] for e in best.effects}, {e: gains[e] for e in best.effects})


def _starts(drive: Drive, rows: Rows, best: Fit, tolerance: Mapping[str, float]) -> list[tuple[str, Floats]]:
    """What is worth a real fit, and from where: the best of a screening, profiles that can be felt, guesses."""
    roads = [name for name in _OWN_CHANNEL if name not in best.effects and _feels(drive, rows, best, name)]
    starts = [(effect, best.x) for effect in (*_screened(drive, rows, best, tolerance)[:_TRIED], *roads)]
    return [*starts, *(guess for guess in guesses(drive, rows, best.x, best.left) if guess[0] not in best.effects)]


@dataclass(frozen=True)
class _Trial:
    """Fits one effect more."""

    drive: Drive
    rows: Rows
    best: Fit
    tolerance: Mapping[str, float]

    def __call__(self, start: tuple[str, Floats]) -> Step:
        effect, x = start
        effects = (*self.best.effects, effect)
        fit = fitted(self.drive, self.rows, x, effects, self.tolerance)
        if effect == "low_friction":
            # Where a stretch begins is a valley with many bends: a step of a gradient gets stuck in the first.
            moved = _with_best_moments(self.drive, self.rows, fit)
            fit = fitted(self.drive, self.rows, moved, effects, self.tolerance)
        if _is_implausible(self.drive, fit, effect):
            return Step(effect, -math.inf, fit)
        return Step(effect, gained(self.drive, self.best, fit), fit)


def _is_implausible(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether a parameter that is told stands at the end of what is plausible: then something else is wrong."""
    for i in drive.vocabulary.columns_of(effect):
        parameter = drive.vocabulary.columns[i][1]
        at_end = any(end != 0.0 and abs(fit.x[i] - end) < 1e-6 * abs(end) for end in (parameter.low, parameter.high))
        if at_end and math.isfinite(parameter.least):
            return True
    return False


def _with_best_moments(drive: Drive, rows: Rows, fit: Fit) -> Floats:
    """The parameters with the moments in which a stretch begins and ends moved to where least is left.

    Where nothing tells (the car goes straight), the shortest stretch is taken.
    """
    x, least = fit.x.copy(), _loss(fit.left, rows, fit.scatter)

    def loss_of(trial: Floats) -> float:
        return _loss(residual(rows, predicted(drive, trial, fit.road)), rows, fit.scatter)

    moments = [i for i, column in enumerate(drive.vocabulary.columns) if column in _MOMENTS]
    last_s = float(drive.recording.time_s[-1])
    for by_s in (16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 8.0, 4.0, 2.0, 1.0, 0.5):
        for i in moments:
            for sign in (-1.0, 1.0):
                trial = x.copy()
                trial[i] = min(max(trial[i] + sign * by_s, 0.0), last_s)
                loss = loss_of(trial)
                if loss < least:
                    x, least = trial, loss
    for i, inwards in zip(moments, (1.0, -1.0), strict=True):
        for by_s in (4.0, 2.0, 1.0, 0.5, 0.2):
            trial = x.copy()
            trial[i] += inwards * by_s
            if trial[moments[0]] < trial[moments[1]] and loss_of(trial) < least + 0.5:
                x = trial
    return x


def _ranked(drive: Drive, best: Fit, tried: list[Step]) -> list[Step]:
    """The best first. What is left hangs together more or less by candidate: among rivals the same rows count.

    A profile fits nearly anything, and has to gain more than what has few parameters.
    """
    if not tried:
        return []
    leader = max(tried, key=lambda step: step.gain)
    if leader.gain <= 0.0:
        return [leader]
    close = [step.fit.per_row for step in tried if step.gain > _RIVALS * leader.gain]
    same = np.exp(np.mean(np.log(close), axis=0))

    def rank(step: Step) -> float:
        alike = gained(drive, best, step.fit, same) if step.gain > _RIVALS * leader.gain else step.gain
        return (0.8 if step.effect in _OWN_CHANNEL else 1.0) * alike

    return sorted(tried, key=rank, reverse=True)


# A profile takes all that its own sensor has left over: it is judged by the other channels; wind by the yaw rate alone,
# since whatever is wrong about the lateral motion shows in the wheels as it does in the acceleration.
_OWN_CHANNEL = {"road_bank": 0, "road_grade": 1, "side_wind": 4}
NEVER_SCREENED = (*_OWN_CHANNEL, *GUESSED)


_NO_JUDGES = {"road_bank": [0], "road_grade": [1], "side_wind": [4, 6, 7, 8]}
# So much more than noise and form has to be left of the lateral acceleration for wind to be thought of.
_FELT = 1.5


def _feels(drive: Drive, rows: Rows, best: Fit, effect: str) -> bool:
    c = _OWN_CHANNEL[effect]
    used = rows.used[:, c]
    if effect != "side_wind" or not used.any():
        return bool(used.any())
    rms = float(np.sqrt(np.mean(best.left[used, c] ** 2)))
    return rms > _FELT * float(np.hypot(floors(drive)[c], best.form[c]))


def gained(drive: Drive, smaller: Fit, larger: Fit, per_row: Floats | None = None) -> float:
    """Log likelihood that the larger model gains on blocks that its fit has not seen.

    `per_row` (13,): how many rows count as one, if not as many as hang together in what the larger model leaves.
    """
    per_row = larger.per_row if per_row is None else per_row
    count, form = larger.sums.counts.copy(), smaller.form.copy()
    for effect in set(larger.effects) - set(smaller.effects):
        count[:, _NO_JUDGES.get(effect, [])] = 0.0
        if effect in {"road_bank", "road_grade"}:
            # With the profile comes its gyro's noise.
            form[_UPRIGHT] = max(form[_UPRIGHT], larger.form[_UPRIGHT])
    parameters = drive.vocabulary.columns
    moved = [
        i
        for i, std in zip(larger.columns, larger.std.tolist(), strict=True)
        if i not in smaller.columns and std < 0.1 * (parameters[i][1].high - parameters[i][1].low)
    ]
    found = gain(smaller.unseen, larger.unseen, count, per_row, form, _quiet(drive, smaller))
    return found - _A_PARAMETER * len(moved)


def _quiet(drive: Drive, fit: Fit) -> Bools:
    """Channels (13,) in which no more is left than noise and form leave."""
    power = fit.unseen.sum(axis=0) / np.maximum(fit.sums.counts.sum(axis=0), 1.0)
    return np.asarray(power < _QUIET * (np.nan_to_num(floors(drive)) ** 2 + fit.form**2))


def _screened(drive: Drive, rows: Rows, best: Fit, tolerance: Mapping[str, float]) -> list[str]:
    """The effects that are not in the model, the most promising first, by one linear step each."""
    words = drive.vocabulary
    special = [i for name in NEVER_SCREENED for i in words.columns_of(name)]
    columns = [i for i in range(len(words.columns)) if i not in special or i in best.columns]
    base = predicted(drive, best.x, best.road)
    slopes = sensitivities(drive, rows, best.x, best.road, base, columns)
    found = sums(rows, best.left, slopes, best.scatter)
    box = box_of(words.columns, best.x, columns, tolerance)
    place = {column: i for i, column in enumerate(columns)}
    own = [place[i] for i in best.columns]
    before = held_out(found, own, box) * best.scatter**2
    scored = []
    for effect in words.effects:
        if effect.name in best.effects or effect.name in NEVER_SCREENED:
            continue
        after = held_out(found, [*own, *(place[i] for i in words.columns_of(effect.name))], box)
        scored.append(
            (gain(before, after * best.scatter**2, found.counts, np.ones_like(best.form), best.form), effect.name)
        )
    return [name for value, name in sorted(scored, reverse=True) if value > 0.5 * LEAST_GAIN]


def _without_idle(
    drive: Drive,
    rows: Rows,
    best: Fit,
    tolerance: Mapping[str, float],
    gains: dict[str, float],
) -> Fit:
    """Each earlier effect is tried without: what another explains better has to go."""
    for effect in best.effects[:-1]:
        rest = tuple(name for name in best.effects if name != effect)
        start = best.x.copy()
        start[list(drive.vocabulary.columns_of(effect))] = 0.0
        smaller = fitted(drive, rows, start, rest, tolerance)
        gains[effect] = gained(drive, smaller._replace(form=rows.form), best)
        if gains[effect] < LEAST_GAIN:
            best = smaller
    return best


def slopes_of(found: Search, columns: Sequence[int]) -> Floats:
    """Sensitivities (k, 13, len(columns)) at the end of the search."""
    best = found.best
    base = predicted(found.drive, best.x, best.road)
    return sensitivities(found.drive, found.rows, best.x, best.road, base, columns)


def stiffness_gain(found: Search) -> float:
    """What refitting the configured stiffnesses gains over leaving them as they are, causes included."""
    held = fitted(found.drive, found.rows, found.best.x, found.best.effects, {p.name: 0.0 for p in STIFFNESS})
    return gained(found.drive, held._replace(form=found.rows.form, columns=found.best.columns), found.best)


def values_of(drive: Drive, fit: Fit, effect: str) -> dict[str, tuple[float, float]]:
    """(value, spread) of each parameter of an effect."""
    place = {column: i for i, column in enumerate(fit.columns)}
    return {
        drive.vocabulary.columns[i][1].name: (float(fit.x[i]), float(fit.std[place[i]]))
        for i in (drive.vocabulary.columns_of(effect) if effect else NUISANCES)
        if i in place
    }
