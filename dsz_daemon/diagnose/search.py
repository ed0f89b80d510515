"""From residuals to named causes: refit what is known first, screen all effects, really fit the best, keep what holds.

A step is judged by what it gains on blocks that its fit has not seen, in log likelihood, divided by the
autocorrelation of what the LARGER model leaves: a partial explanation leaves much that hangs together and gains little.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.comparison import Rows, floors, residual, robust_std, sensitivities
from dsz_daemon.diagnose.effects import COLUMNS, EFFECTS, INDEX, NUISANCES, ROAD, STIFFNESS, columns_of
from dsz_daemon.diagnose.evidence import Box, Sums, correlated_rows, gain, held_out, solved, sums
from dsz_daemon.diagnose.prediction import Drive, Floats, Profiles, felt_road, flat, nothing, predicted

Progress = Callable[[str], None]

# In log likelihood on unseen blocks: what one of thirty candidates may reach by chance is some ln(30) = 3.4.
LEAST_GAIN = 10.0
# A parameter more has to be paid for; one that the drive does not move is none.
_A_PARAMETER = 3.0
# No effect of a real car is to the letter what the simulation makes of it.
_EFFECT_FORM = 0.03
# What comes after the first may be what the simulation's form gets wrong about it: it has to gain so much of the rest.
_SHARE_OF_ALL = 0.03
_TRIED = 7
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


def box_of(x: Floats, columns: Sequence[int], tolerance: Mapping[str, float]) -> Box:
    """How far the columns may go from x: the plausible, the tolerance for configured stiffnesses."""
    low, high = [], []
    for i in columns:
        parameter = COLUMNS[i][1]
        most = tolerance.get(parameter.name) if i in NUISANCES else None
        low.append((parameter.low if most is None else -most) - x[i])
        high.append((parameter.high if most is None else most) - x[i])
    # A prior as wide as what is plausible keeps what nothing was said of where it is.
    width = np.array([COLUMNS[i][1].high - COLUMNS[i][1].low for i in columns])
    return Box(np.array(low), np.array(high), 1.0 / width**2)


def fitted(
    drive: Drive,
    rows: Rows,
    start: Floats,
    effects: tuple[str, ...],
    tolerance: Mapping[str, float],
) -> Fit:
    """Gauss-Newton in the box to convergence, over offsets, stiffnesses and the effects' parameters."""
    columns = (*NUISANCES, *(i for effect in effects for i in columns_of(effect)))
    floor = floors(drive)
    x = start.copy()
    for effect in ROAD:
        x[list(columns_of(effect.name))] = 0.0
    road = felt_road(drive, x, effects)
    base = predicted(drive, x, road)
    left = residual(rows, base)
    scatter = robust_std(rows, left, floor)
    for _ in range(_ROUNDS):
        slopes = sensitivities(drive, rows, x, road, base, columns)
        found = sums(rows, left, slopes, scatter)
        box = box_of(x, columns, tolerance)
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
    box = box_of(x, columns, tolerance)
    unseen = held_out(found, range(len(columns)), box) * scatter**2
    form = _form(drive, rows, x, effects, base)
    return Fit(x, _spread(found, per_row, box), effects, left, scatter, per_row, found, columns, unseen, road, form)


def _form(drive: Drive, rows: Rows, x: Floats, effects: tuple[str, ...], base: Floats) -> Floats:
    """What the simulation's form may be off by (9,): its own, and a share of what the effects in it do."""
    if not effects:
        return rows.form
    without = x.copy()
    without[[i for effect in effects for i in columns_of(effect)]] = 0.0
    change = np.where(rows.used, (base - predicted(drive, without, flat(len(base))))[rows.at], 0.0)
    rms = np.sqrt(np.sum(change**2, axis=0) / np.maximum(np.sum(rows.used, axis=0), 1))
    return np.asarray(np.hypot(rows.form, _EFFECT_FORM * rms), dtype=np.float64)


def _loss(left: Floats, rows: Rows, scatter: Floats) -> float:
    """Half the sum of squares, beyond four deviations as for a distance."""
    z = np.abs(left / scatter)
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


def searched(drive: Drive, rows: Rows, tolerance: Mapping[str, float], progress: Progress | None = None) -> Search:
    """The named causes of one drive, of the rows that are compared."""
    say = progress or (lambda _: None)
    by_stiffness = {p.name: tolerance.get(f"{p.name}_n_per_rad", 0.0) for p in STIFFNESS}
    say("refitting offsets and stiffnesses")
    nominal = fitted(drive, rows, nothing(), (), by_stiffness)
    best, rivals = nominal, {}
    gains: dict[str, float] = {}
    while len(best.effects) < _MOST_EFFECTS:
        say(f"screening what else than {', '.join(best.effects) or 'nothing'}")
        roads = [effect.name for effect in ROAD if effect.name not in best.effects and _feels(rows, effect.name)]
        tried = []
        for effect in [*_screened(drive, rows, best, by_stiffness)[:_TRIED], *roads]:
            fit = fitted(drive, rows, best.x, (*best.effects, effect), by_stiffness)
            tried.append(Step(effect, gained(best, fit), fit))
        tried.sort(key=_rank)
        if not tried or tried[0].gain < max(LEAST_GAIN, _SHARE_OF_ALL * sum(gains.values())):
            break
        best = tried[0].fit
        rivals[tried[0].effect], gains[tried[0].effect] = tuple(tried), tried[0].gain
        best = _without_idle(drive, rows, best, by_stiffness, gains)
    return Search(drive, rows, nominal, best, {e: rivals[e] for e in best.effects}, {e: gains[e] for e in best.effects})


def _rank(step: Step) -> float:
    """The more gained the better; a profile fits nearly anything, and has to gain more than what has few parameters."""
    return -(0.8 if step.effect in _OWN_CHANNEL else 1.0) * step.gain


# A profile takes all that its own gyro has left over: it is judged by the other channels.
_OWN_CHANNEL = {"road_bank": 0, "road_grade": 1}


def _feels(rows: Rows, effect: str) -> bool:
    return bool(rows.used[:, _OWN_CHANNEL[effect]].any())


def gained(smaller: Fit, larger: Fit) -> float:
    """Log likelihood that the larger model gains on blocks that its fit has not seen."""
    count = larger.sums.counts.copy()
    for effect in set(larger.effects) - set(smaller.effects):
        if effect in _OWN_CHANNEL:
            count[:, _OWN_CHANNEL[effect]] = 0.0
    moved = [
        i
        for i, std in zip(larger.columns, larger.std.tolist(), strict=True)
        if i not in smaller.columns and std < 0.1 * (COLUMNS[i][1].high - COLUMNS[i][1].low)
    ]
    found = gain(smaller.unseen, larger.unseen, count, larger.per_row, smaller.form)
    return found - _A_PARAMETER * len(moved)


def _screened(drive: Drive, rows: Rows, best: Fit, tolerance: Mapping[str, float]) -> list[str]:
    """The effects that are not in the model, the most promising first, by one linear step each."""
    knots = [i for effect in ROAD for i in columns_of(effect.name)]
    columns = [i for i in range(len(COLUMNS)) if i not in knots or i in best.columns]
    base = predicted(drive, best.x, best.road)
    slopes = sensitivities(drive, rows, best.x, best.road, base, columns)
    found = sums(rows, best.left, slopes, best.scatter)
    box = box_of(best.x, columns, tolerance)
    place = {column: i for i, column in enumerate(columns)}
    own = [place[i] for i in best.columns]
    before = held_out(found, own, box) * best.scatter**2
    scored = []
    for effect in EFFECTS:
        if effect.name in best.effects:
            continue
        after = held_out(found, [*own, *(place[i] for i in columns_of(effect.name))], box)
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
        start[list(columns_of(effect))] = 0.0
        smaller = fitted(drive, rows, start, rest, tolerance)
        gains[effect] = gained(smaller._replace(form=rows.form), best)
        if gains[effect] < LEAST_GAIN:
            best = smaller
    return best


def slopes_of(found: Search, columns: Sequence[int]) -> Floats:
    """Sensitivities (k, 9, len(columns)) at the end of the search."""
    best = found.best
    base = predicted(found.drive, best.x, best.road)
    return sensitivities(found.drive, found.rows, best.x, best.road, base, columns)


def stiffness_gain(found: Search) -> float:
    """What refitting the configured stiffnesses gains over leaving them as they are, causes included."""
    held = fitted(found.drive, found.rows, found.best.x, found.best.effects, {p.name: 0.0 for p in STIFFNESS})
    return gained(held._replace(form=found.rows.form, columns=found.best.columns), found.best)


def values_of(fit: Fit, effect: str) -> dict[str, tuple[float, float]]:
    """(value, spread) of each parameter of an effect."""
    place = {column: i for i, column in enumerate(fit.columns)}
    return {
        COLUMNS[i][1].name: (float(fit.x[i]), float(fit.std[place[i]]))
        for i in (columns_of(effect) if effect else NUISANCES)
        if i in place
    }


def stiffness_of(fit: Fit) -> dict[str, tuple[float, float]]:
    """(share, spread) by which the configured stiffnesses were refitted."""
    place = {column: i for i, column in enumerate(fit.columns)}
    return {p.name: (float(fit.x[INDEX[p.name]]), float(fit.std[place[INDEX[p.name]]])) for p in STIFFNESS}
