"""Sums of squares by block and channel, so that a fit on some blocks and its judgement on others are small algebra."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.diagnose.residuals.comparison import FOLDS, Bools, Ints, Rows, robust_std
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.simulation.drive import Floats

# In log likelihood on unseen blocks: what one of thirty candidates may reach by chance is some ln(30) = 3.4.
LEAST_GAIN = 10.0
# Of normal equations with ones on their diagonal: combinations that are told by less are not told.
_TOLD_APART = 1e-10
# Where no pivot is smaller than this, all combinations are told by far more than that.
_WELL_APART = 1e-6
# What is left open is no denial up to so many times the square that is expected: two standard deviations.
_LEFT_OPEN = 4.0
# Of what all kinds of manoeuvres show of a parameter, the others of one kind show so much, or are not asked.
_SHOWN_BY_OTHERS = 0.015
_ROUNDING = 1e-6
# Rounds of a search for what stands at its bound; few take more than three.
_MOST_HELD = 12
# What is known of a block's scatter before it is seen, in independent rows: Student's degrees of freedom.
_PRIOR_ROWS = 12.0
_SCALE_ROUNDS = 25
_WINSOR = 4.0


class Sums(NamedTuple):
    """Scaled normal equations by block b and channel c: J'J (b, c, p, p), J'r (b, c, p), r'r (b, c), rows (b, c)."""

    squares: Floats
    cross: Floats
    left: Floats
    counts: Floats


class Box(NamedTuple):
    """How far each parameter may go from here (p,), and its prior's weight (p,), 0 for none."""

    low: Floats
    high: Floats
    weight: Floats


def scatter_of(rows: Rows, left: Floats, floor: Floats) -> Floats:
    """The deviation (b, 13) of each block: that of the whole channel, as far as the block's own rows don't tell.

    What a simulation leaves is no noise that is the same all the way: where it is wrong it is wrong by more, and says
    less. With v degrees of freedom (Student's), s^2 = (v s_0^2 + sum of squares) / (v + rows), in independent rows.
    """
    whole = robust_std(rows, left, floor)
    near = np.clip(left, -_WINSOR * whole, _WINSOR * whole)
    per_row = correlated_rows(near, rows.used)
    blocks = int(rows.block[-1]) + 1
    power, count = np.zeros((blocks, left.shape[1])), np.zeros((blocks, left.shape[1]))
    _add_squares(rows.block, rows.used, left, power, count)
    square = (_PRIOR_ROWS * whole**2 + power / per_row) / (_PRIOR_ROWS + count / per_row)
    return np.sqrt(np.maximum(square, np.nan_to_num(floor) ** 2))


@compiled
def _add_squares(block: Ints, used: Bools, left: Floats, power: Floats, count: Floats) -> None:
    for k in range(len(block)):
        for c in range(left.shape[1]):
            if used[k, c]:
                power[block[k], c] += left[k, c] ** 2
                count[block[k], c] += 1.0


def sums(rows: Rows, left: Floats, slopes: Floats, std: Floats, bound: float = math.inf) -> Sums:
    """The sums of residuals `left` (k, 13) and sensitivities `slopes` (k, 13, p), scaled by `std` (13,) or (b, 13).

    Beyond `bound` deviations a row pulls no harder than there (Huber).
    """
    blocks = int(rows.block[-1]) + 1
    channels, p = left.shape[1], slopes.shape[2]
    found = Sums(
        np.zeros((blocks, channels, p, p)),
        np.zeros((blocks, channels, p)),
        np.zeros((blocks, channels)),
        np.zeros((blocks, channels)),
    )
    std = np.ascontiguousarray(np.broadcast_to(std, (blocks, channels)))
    _add_up(rows.block, rows.used, left, slopes, std, bound, *found)
    return found


@compiled
def _add_up(
    block: Ints,
    used: Bools,
    left: Floats,
    slopes: Floats,
    std: Floats,
    bound: float,
    squares: Floats,
    cross: Floats,
    power: Floats,
    counts: Floats,
) -> None:
    """Adds each row to its block's sums; what a channel does not feel of a parameter costs nothing."""
    p = slopes.shape[2]
    for k in range(len(block)):
        b = block[k]
        for c in range(left.shape[1]):
            if not used[k, c]:
                continue
            slope = slopes[k, c]
            deviation = std[b, c]
            twice = 1.0 / deviation**2
            if abs(left[k, c]) > bound * deviation:
                twice *= bound * deviation / abs(left[k, c])
            once = left[k, c] * twice
            counts[b, c] += 1.0
            power[b, c] += once * left[k, c]
            for i in range(p):
                mine = slope[i]
                if mine == 0.0:
                    continue
                cross[b, c, i] += mine * once
                row = squares[b, c, i]
                for j in range(i + 1):
                    row[j] += mine * twice * slope[j]
    for b in range(squares.shape[0]):
        for c in range(squares.shape[1]):
            for i in range(p):
                for j in range(i):
                    squares[b, c, j, i] = squares[b, c, i, j]


def solved(squares: Floats, cross: Floats, box: Box) -> Floats:
    """The step (p,) of least squares inside the box."""
    a = squares + np.diag(box.weight)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-30))
    a = a * scale[:, np.newaxis] * scale
    low, high, pull = box.low / scale, box.high / scale, cross * scale
    # Most are told apart well: that costs a tenth of the eigenvalues.
    if _is_told_apart(a) and (found := _held_at_bounds(a, pull, low, high)) is not None:
        return np.clip(found * scale, box.low, box.high)
    values, vectors = np.linalg.eigh(a)
    values = np.maximum(values, _TOLD_APART * values[-1])
    free = (vectors / values) @ (vectors.T @ pull)
    if ((low <= free) & (free <= high)).all():
        return np.asarray(free * scale, dtype=np.float64)
    if (found := _held_at_bounds((vectors * values) @ vectors.T, pull, low, high)) is not None:
        return np.clip(found * scale, box.low, box.high)
    # Seldom asked for, and a quarter of a second to import.
    from scipy.optimize import lsq_linear  # noqa: PLC0415

    root, goal = (vectors * np.sqrt(values)).T, (vectors / np.sqrt(values)).T @ pull
    # A box without room holds its parameter.
    high = np.maximum(high, low + 1e-12)
    return np.asarray(lsq_linear(root, goal, (low, high), method="bvls").x * scale, dtype=np.float64)


def _held_at_bounds(a: Floats, pull: Floats, low: Floats, high: Floats) -> Floats | None:
    """The least of x'ax / 2 - pull'x inside the box; None where it is not found at once.

    What is beyond a bound is held there, what is held and pulled back inside is let go, until nothing is either: that
    is the minimum, since there is but one (Kuhn and Tucker).
    """
    found, held = np.linalg.solve(a, pull).astype(np.float64), np.zeros(len(pull), dtype=np.bool_)
    for _ in range(_MOST_HELD):
        back = pull - a @ found
        beyond = ~held & ((found < low) | (found > high))
        # At a bound that is both of them nothing has room.
        let_go = held & (low < high) & np.where(found > low, back < 0.0, back > 0.0)
        if not beyond.any() and not let_go.any():
            return found
        held = (held | beyond) & ~let_go
        found = np.where(held, np.clip(found, low, high), 0.0)
        loose = ~held
        found[loose] = np.linalg.solve(a[np.ix_(loose, loose)], pull[loose] - a[np.ix_(loose, held)] @ found[held])
    return None


def _is_told_apart(a: Floats) -> bool:
    """Whether normal equations with ones on their diagonal are far from leaving a combination open."""
    try:
        return bool(np.min(np.diag(np.linalg.cholesky(a))) ** 2 > _WELL_APART)
    except np.linalg.LinAlgError:
        return False


def inverse(squares: Floats) -> Floats:
    """Of normal equations (p, p), which are never negative: what is not told apart is uncertain, not less than that."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(squares), 1e-30))
    values, vectors = np.linalg.eigh(squares * scale[:, np.newaxis] * scale)
    values = np.maximum(values, _TOLD_APART * values[-1])
    return np.asarray((vectors / values) @ vectors.T * scale[:, np.newaxis] * scale, dtype=np.float64)


def inverse_of_told(squares: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Of normal equations (p, p) and a prior's `weight` (p,): the inverse over what the data tell, and the rest.

    The rest is the covariance (p, p) of what they don't tell apart, which is the prior's.
    """
    a = squares + np.diag(weight)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-30))
    values, vectors = np.linalg.eigh(a * scale[:, np.newaxis] * scale)
    is_told = values > _TOLD_APART * values[-1]
    told, rest = (vectors[:, chosen] * scale[:, np.newaxis] for chosen in (is_told, ~is_told))
    # Which way the directions of one plane point is rounding's choice: the prior is that of all of it.
    prior = rest.T @ (weight[:, np.newaxis] * rest)
    return (told / values[is_told]) @ told.T, rest @ np.linalg.inv(prior) @ rest.T


def held_out(found: Sums, columns: Sequence[int], box: Box) -> Floats:
    """Sum of squares (b, c) of each block, of a fit of `columns` that has not seen it, and every FOLDS-th other."""
    chosen = np.array(columns, dtype=np.int64)
    part = Box(box.low[chosen], box.high[chosen], box.weight[chosen])
    fold = np.arange(len(found.left), dtype=np.int64) % FOLDS
    squares, cross = _by_kind(found.squares, found.cross, chosen, fold, np.ones(found.left.shape[1]))
    result = np.zeros_like(found.left)
    for k in range(len(squares)):
        seen = np.arange(len(squares)) != k
        step = solved(squares[seen].sum(axis=0), cross[seen].sum(axis=0), part)
        _leave(found.left, found.squares, found.cross, chosen, step, fold == k, result)
    return result


def held_out_kinds(found: Sums, columns: Sequence[int], box: Box, kind: Ints, per_row: Floats) -> Floats:
    """Sum of squares (b, c) of each block, of a fit of `columns` that has seen none of its kind (b,).

    Calm driving leaves open what a hard bend will show: an error that large has to be expected (by the spread of the
    parameters, sandwich) and speaks against nothing; only what is beyond it is counted. `per_row` as below. What one
    kind shows nearly alone no other is asked for: it stays as all of them have it.
    """
    chosen = np.array(columns, dtype=np.int64)
    part = Box(box.low[chosen], box.high[chosen], box.weight[chosen])
    there, kind = np.unique(kind, return_inverse=True)
    power = found.left.sum(axis=0) / np.maximum(found.counts.sum(axis=0), 1.0)
    squares, cross = _by_kind(found.squares, found.cross, chosen, kind, np.ones(len(power)))
    lasting = _by_kind(found.squares, found.cross, chosen, kind, power * per_row)[0]
    whole = solved(squares.sum(axis=0), cross.sum(axis=0), part)
    best, by_others = np.zeros_like(found.left), np.zeros_like(found.left)
    _leave(found.left, found.squares, found.cross, chosen, whole, kind >= 0, best)
    result = np.zeros_like(found.left)
    for k in range(len(there)):
        seen, unseen = np.arange(len(there)) != k, kind == k
        own = squares[seen].sum(axis=0)
        asked = np.diag(own) > _SHOWN_BY_OTHERS * np.diag(own + squares[~seen].sum(axis=0))
        step, bread = whole.copy(), np.zeros_like(own)
        here = np.ix_(asked, asked)
        rest = cross[seen].sum(axis=0)[asked] - own[asked][:, ~asked] @ whole[~asked]
        if asked.any():
            step[asked] = solved(own[here], rest, Box(part.low[asked], part.high[asked], part.weight[asked]))
            bread[here] = inverse(own[here] + np.diag(np.maximum(part.weight[asked], 1e-12)))
        pulls = _pulls(found.squares, found.cross, chosen, step)[~unseen]
        meats = (lasting[seen].sum(axis=0), pulls.T @ pulls)
        expected = np.max([_traces(found.squares, chosen, bread @ meat @ bread, unseen) for meat in meats], axis=0)
        _leave(found.left, found.squares, found.cross, chosen, step, unseen, by_others)
        more = (by_others - best)[unseen].sum(axis=0)
        share = np.where(more > 0.0, np.maximum(1.0 - _LEFT_OPEN * expected / np.maximum(more, 1e-30), 0.0), 1.0)
        result[unseen] = best[unseen] + share * (by_others - best)[unseen]
    return result


@compiled
def _by_kind(squares: Floats, cross: Floats, chosen: Ints, kind: Ints, weight: Floats) -> tuple[Floats, Floats]:
    """The sums (kinds, p, p) and (kinds, p) of the chosen columns over all channels, each with its weight (c,)."""
    p, kinds = len(chosen), int(kind.max()) + 1
    there, pulls = np.zeros((kinds, p, p)), np.zeros((kinds, p))
    for b in range(squares.shape[0]):
        for c in range(squares.shape[1]):
            for i in range(p):
                pulls[kind[b], i] += weight[c] * cross[b, c, chosen[i]]
                for j in range(i + 1):
                    there[kind[b], i, j] += weight[c] * squares[b, c, chosen[i], chosen[j]]
    for k in range(kinds):
        for i in range(p):
            for j in range(i):
                there[k, j, i] = there[k, i, j]
    return there, pulls


@compiled
def _leave(
    left: Floats, squares: Floats, cross: Floats, chosen: Ints, step: Floats, asked: Bools, result: Floats
) -> None:
    """Writes the sums of squares (b, c) that a step (p,) of the chosen columns leaves in the blocks `asked` for."""
    for b in range(left.shape[0]):
        if not asked[b]:
            continue
        for c in range(left.shape[1]):
            power = left[b, c]
            for i in range(len(chosen)):
                along = -2.0 * cross[b, c, chosen[i]]
                for j in range(len(chosen)):
                    along += squares[b, c, chosen[i], chosen[j]] * step[j]
                power += along * step[i]
            result[b, c] = power


@compiled
def _pulls(squares: Floats, cross: Floats, chosen: Ints, step: Floats) -> Floats:
    """How each block still pulls (b, p) at the chosen columns after a step."""
    found = np.zeros((squares.shape[0], len(chosen)))
    for b in range(squares.shape[0]):
        for c in range(squares.shape[1]):
            for i in range(len(chosen)):
                pull = cross[b, c, chosen[i]]
                for j in range(len(chosen)):
                    pull -= squares[b, c, chosen[i], chosen[j]] * step[j]
                found[b, i] += pull
    return found


@compiled
def _traces(squares: Floats, chosen: Ints, covariance: Floats, asked: Bools) -> Floats:
    """The sum of squares (c,) that parameters with this covariance are expected to leave in the blocks `asked` for."""
    found = np.zeros(squares.shape[1])
    for b in range(squares.shape[0]):
        if not asked[b]:
            continue
        for c in range(squares.shape[1]):
            for i in range(len(chosen)):
                for j in range(len(chosen)):
                    found[c] += squares[b, c, chosen[i], chosen[j]] * covariance[j, i]
    return found


def gain(
    before: Floats, after: Floats, count: Floats, per_row: Floats, form: Floats, quiet: Bools | None = None
) -> float:
    """Log likelihood gained on held-out blocks (b, c), SI, the channels' scatter unknown.

    `per_row` as above; what is below `form` (13,), the simulation's own coarseness, gains nothing, and neither does a
    channel that is `quiet` (13,) already; it may lose. A sum of squares that is none (the car became unstable) gains
    -inf.
    """
    known = count.sum(axis=0) > 0
    before, after, rows = before[:, known], after[:, known], count[:, known]
    # A trial fit in which the car is unstable has sums that are no sums of squares.
    old, new = before.sum(axis=0), after.sum(axis=0)
    if not (np.isfinite(new) & (new >= -_ROUNDING * old)).all():
        return -math.inf
    coarse, independent = rows * np.maximum(form[known] ** 2, 1e-24), rows / per_row[known]
    each = _likelihood((np.maximum(after, 0.0) + coarse) / per_row[known], independent)
    each -= _likelihood((np.maximum(before, 0.0) + coarse) / per_row[known], independent)
    return float(np.sum(each if quiet is None else np.where(quiet[known], np.minimum(each, 0.0), each)))


def likelihood_of(rows: Rows, left: Floats, per_row: Floats) -> float:
    """Log likelihood of what is left (k, 13), each block scattering by itself; `per_row` as above."""
    blocks = int(rows.block[-1]) + 1
    power, count = np.zeros((blocks, left.shape[1])), np.zeros((blocks, left.shape[1]))
    _add_squares(rows.block, rows.used, left, power, count)
    known = count.sum(axis=0) > 0
    return float(np.sum(_likelihood((power / per_row)[:, known], (count / per_row)[:, known])))


@compiled
def _likelihood(power: Floats, count: Floats) -> Floats:
    """Log likelihood (c,) of blocks with these sums of squares and numbers of independent rows (b, c), at its best.

    Each block scatters by itself about what its channel does: Student's distribution, with the scale that fits best.
    """
    found = np.zeros(power.shape[1])
    for c in range(len(found)):
        whole = np.sum(count[:, c])
        square = max(np.sum(power[:, c]) / whole, 1e-30)
        for _ in range(_SCALE_ROUNDS):
            scale = 0.0
            for b in range(len(power)):
                scale += (_PRIOR_ROWS + count[b, c]) * power[b, c] / (_PRIOR_ROWS + power[b, c] / square)
            square = max(scale / whole, 1e-30)
        for b in range(len(power)):
            found[c] -= 0.5 * (_PRIOR_ROWS + count[b, c]) * math.log1p(power[b, c] / (_PRIOR_ROWS * square))
        found[c] -= 0.5 * whole * math.log(square)
    return found
