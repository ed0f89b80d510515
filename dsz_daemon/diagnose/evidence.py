"""Sums of squares by block and channel, so that a fit on some blocks and its judgement on others are small algebra."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from dsz_daemon.compiled import compiled
from dsz_daemon.diagnose.comparison import FOLDS, Bools, Ints, Rows
from dsz_daemon.diagnose.prediction import Floats

# In log likelihood on unseen blocks: what one of thirty candidates may reach by chance is some ln(30) = 3.4.
LEAST_GAIN = 10.0
_CORRELATED_FOR_ROWS = 250
# Of normal equations with ones on their diagonal: combinations that are told by less are not told.
_TOLD_APART = 1e-10
# What is left open is no denial up to so many times the square that is expected: two standard deviations.
_LEFT_OPEN = 4.0
_ROUNDING = 1e-6


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


def sums(rows: Rows, left: Floats, slopes: Floats, std: Floats, bound: float = math.inf) -> Sums:
    """The sums of residuals `left` (k, 13) and sensitivities `slopes` (k, 13, p), scaled by `std` (13,).

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
        for c in range(left.shape[1]):
            if not used[k, c]:
                continue
            b, slope = block[k], slopes[k, c]
            twice = 1.0 / std[c] ** 2
            if abs(left[k, c]) > bound * std[c]:
                twice *= bound * std[c] / abs(left[k, c])
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
    values, vectors = np.linalg.eigh(a * scale[:, np.newaxis] * scale)
    values = np.maximum(values, _TOLD_APART * values[-1])
    root = (vectors * np.sqrt(values)).T
    goal = (vectors / np.sqrt(values)).T @ (cross * scale)
    low, high = box.low / scale, box.high / scale
    # A box without room holds its parameter.
    high = np.maximum(high, low + 1e-12)
    return np.asarray(lsq_linear(root, goal, (low, high), method="bvls").x * scale, dtype=np.float64)


def inverse(squares: Floats) -> Floats:
    """Of normal equations (p, p), which are never negative: what is not told apart is uncertain, not less than that."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(squares), 1e-30))
    values, vectors = np.linalg.eigh(squares * scale[:, np.newaxis] * scale)
    values = np.maximum(values, _TOLD_APART * values[-1])
    return np.asarray((vectors / values) @ vectors.T * scale[:, np.newaxis] * scale, dtype=np.float64)


def held_out(found: Sums, columns: Sequence[int], box: Box) -> Floats:
    """Sum of squares (b, c) of each block, of a fit of `columns` that has not seen it, and every FOLDS-th other."""
    chosen = list(columns)
    part = Box(box.low[chosen], box.high[chosen], box.weight[chosen])
    squares = found.squares[:, :, chosen][:, :, :, chosen]
    cross = found.cross[:, :, chosen]
    fold = np.arange(len(found.left)) % FOLDS
    result = np.zeros_like(found.left)
    for k in np.unique(fold):
        seen, unseen = fold != k, fold == k
        step = solved(squares[seen].sum(axis=(0, 1)), cross[seen].sum(axis=(0, 1)), part)
        result[unseen] = (
            found.left[unseen] - 2.0 * cross[unseen] @ step + np.einsum("bcij,i,j->bc", squares[unseen], step, step)
        )
    return result


def held_out_kinds(found: Sums, columns: Sequence[int], box: Box, kind: Ints, per_row: Floats) -> Floats:
    """Sum of squares (b, c) of each block, of a fit of `columns` that has seen none of its kind (b,).

    Calm driving leaves open what a hard bend will show: an error that large has to be expected (by the spread of the
    parameters, sandwich) and speaks against nothing; only what is beyond it is counted. `per_row` as below.
    """
    chosen = list(columns)
    part = Box(box.low[chosen], box.high[chosen], box.weight[chosen])
    squares = found.squares[:, :, chosen][:, :, :, chosen]
    cross = found.cross[:, :, chosen]

    def left_by(step: Floats, at: Bools) -> Floats:
        bent = np.einsum("bcij,i,j->bc", squares[at], step, step)
        return np.asarray(found.left[at] - 2.0 * cross[at] @ step + bent)

    whole = solved(squares.sum(axis=(0, 1)), cross.sum(axis=(0, 1)), part)
    power = found.left.sum(axis=0) / np.maximum(found.counts.sum(axis=0), 1.0)
    result = np.zeros_like(found.left)
    for k in np.unique(kind):
        seen, unseen = kind != k, kind == k
        own = squares[seen].sum(axis=(0, 1))
        step = solved(own, cross[seen].sum(axis=(0, 1)), part)
        bread = inverse(own + np.diag(np.maximum(part.weight, 1e-12)))
        pulls = cross[seen].sum(axis=1) - squares[seen].sum(axis=1) @ step
        meats = (np.einsum("bcij,c->ij", squares[seen], power * per_row), pulls.T @ pulls)
        there = squares[unseen].sum(axis=0)
        expected = np.max([np.einsum("cij,ji->c", there, bread @ meat @ bread) for meat in meats], axis=0)
        best, by_others = left_by(whole, unseen), left_by(step, unseen)
        more = (by_others - best).sum(axis=0)
        share = np.where(more > 0.0, np.maximum(1.0 - _LEFT_OPEN * expected / np.maximum(more, 1e-30), 0.0), 1.0)
        result[unseen] = best + share * (by_others - best)
    return result


def correlated_rows(left: Floats, used: Bools) -> Floats:
    """How many rows of each channel (13,) tell as much as one that is independent of the others."""
    found = np.ones(left.shape[1])
    for c in range(left.shape[1]):
        mine = np.where(used[:, c], left[:, c], 0.0)
        n = len(mine)
        power = np.abs(np.fft.rfft(mine, 2 * n)) ** 2
        lags = np.fft.irfft(power)[: min(n, _CORRELATED_FOR_ROWS)]
        if lags[0] <= 0.0:
            continue
        ratio = lags[1:] / lags[0]
        ends = np.flatnonzero(ratio < 0.05)
        found[c] = 1.0 + 2.0 * float(np.sum(ratio[: ends[0] if len(ends) else len(ratio)]))
    return found


def gain(
    before: Floats, after: Floats, count: Floats, per_row: Floats, form: Floats, quiet: Bools | None = None
) -> float:
    """Log likelihood gained on held-out blocks (b, c), SI, the channels' scatter unknown.

    `per_row` as above; what is below `form` (13,), the simulation's own coarseness, gains nothing, and neither does a
    channel that is `quiet` (13,) already; it may lose. A sum of squares that is none (the car became unstable) gains
    -inf.
    """
    n = count.sum(axis=0)
    known = n > 0
    coarse = n[known] * np.maximum(form[known] ** 2, 1e-24)
    old, new = before.sum(axis=0)[known], after.sum(axis=0)[known]
    # A trial fit in which the car is unstable has sums that are no sums of squares.
    if not (np.isfinite(new) & (new >= -_ROUNDING * old)).all():
        return -math.inf
    each = 0.5 * n[known] / per_row[known] * np.log((old + coarse) / (np.maximum(new, 0.0) + coarse))
    return float(np.sum(each if quiet is None else np.where(quiet[known], np.minimum(each, 0.0), each)))
