"""A shape without a name as a rival of the names: judged with all that is in the model fitted again beside it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.comparison import Bools, Each, Rows, floors
from dsz_daemon.diagnose.correlation import correlated_rows
from dsz_daemon.diagnose.evidence import Box, Sums, gain, held_out, inverse, scatter_of, solved, sums
from dsz_daemon.diagnose.fit import DRAWN, Fit, Slopes, box_of, with_shapes
from dsz_daemon.diagnose.gains import quiet
from dsz_daemon.diagnose.prediction import CHANNELS, Drive, Floats, driven
from dsz_daemon.diagnose.unlisted import (
    BY_CHANCE,
    CHOSEN_OF_MANY,
    LEAST_ROWS,
    Found,
    as_effect,
    best_shape,
    is_named,
    library,
    unit_of,
)
from dsz_daemon.signals import IMU_CHANNELS

# So many are judged on blocks that they have not seen: those that take the most off what is left.
_TRIED = 4
# The channels' weights are found anew so often.
_ROUNDS = 4


class _Shape(NamedTuple):
    """A product of motion, `course` (n,), on channel c; `cross` (b, p): its products with the model's slopes."""

    c: int
    name: str
    unit: str
    course: Floats
    square: Floats
    cross: Floats
    pull: Floats


def likeliest_shape(
    drive: Drive,
    rows: Rows,
    fit: Fit,
    known: Slopes,
    tolerance: Mapping[str, float],
    each: Each = map,
    *,
    beside: bool,
) -> Found | None:
    """What has no name, found in what is left, or `beside` all that is fitted again: what gains more."""
    shapes = [best_shape(drive, rows, fit, each)]
    if beside:
        shapes.append(shape_beside(drive, rows, fit, known, tolerance, quiet(drive, fit), each))
    return max((shape for shape in shapes if shape is not None), key=lambda shape: shape.gain, default=None)


def shape_beside(
    drive: Drive,
    rows: Rows,
    fit: Fit,
    known: Slopes,
    tolerance: Mapping[str, float],
    mute: Bools,
    each: Each = map,
) -> Found | None:
    """The shape that gains most on unseen blocks where the whole model is fitted again beside it, by a linear step.

    That is how names are judged: what the first refit bends to a shape must not leave it a name's size. `known`:
    sensitivities at the model's end; `mute` (13,): channels that have nothing to gain, as of `gain`.
    """
    there = with_shapes(fit.effects)
    channels = [name for name in IMU_CHANNELS if name not in there]
    return _likeliest(drive, rows, fit, known, tolerance, mute, channels, each)


def another_course(
    drive: Drive, rows: Rows, fit: Fit, known: Slopes, tolerance: Mapping[str, float], channels: Collection[str]
) -> float:
    """What a second course gains on channels that have a shape already, as if it were not the best of many.

    The first is the simplest of a library: what it leaves is its own form's.
    """
    found = _likeliest(drive, rows, fit, known, tolerance, quiet(drive, fit), channels)
    return found.gain + BY_CHANCE if found is not None else 0.0


def _likeliest(
    drive: Drive,
    rows: Rows,
    fit: Fit,
    known: Slopes,
    tolerance: Mapping[str, float],
    mute: Bools,
    channels: Collection[str],
    each: Each = map,
) -> Found | None:
    slopes = np.ascontiguousarray(known.values[:, :, [known.columns.index(i) for i in fit.columns]])
    box = box_of(drive.vocabulary.columns, fit.x, fit.columns, tolerance)
    model = sums(rows, fit.left, slopes, fit.scatter)
    # Of parameters that the drive does not tell apart none is told: no solution, but no reason to end either.
    bread = inverse(model.squares.sum(axis=(0, 1)) + np.diag(np.maximum(box.weight, 1e-12)))
    shapes = _shapes(drive, rows, fit, slopes, channels)
    tried = sorted(shapes, key=lambda shape: -_taken(shape, model, bread))[:_TRIED]
    judged = each(lambda shape: _judged(drive, rows, fit, slopes, model, box, shape, mute), tried)
    return max(judged, key=lambda found: found.gain, default=None)


def _shapes(drive: Drive, rows: Rows, fit: Fit, slopes: Floats, channels: Collection[str]) -> list[_Shape]:
    """Each shape of each of these channels, with its sums by block, in the channels' scatter."""
    library_here = library(driven(drive, fit.x, fit.road), drive.steer)
    names, courses = list(library_here), np.column_stack([course for course, _ in library_here.values()])
    blocks, found = int(rows.block[-1]) + 1, []
    for c, channel in enumerate(IMU_CHANNELS):
        used = rows.used[:, c]
        if channel not in channels or np.count_nonzero(used) < LEAST_ROWS:
            continue
        scatter = fit.scatter[rows.block, c]
        # What is the same all the way is the offset's.
        own_courses = courses - np.mean(courses[rows.at[used]], axis=0)
        mine = np.where(used[:, np.newaxis], own_courses[rows.at], 0.0) / scatter[:, np.newaxis]
        own, left = slopes[:, c] / scatter[:, np.newaxis], fit.left[:, c] / scatter
        square, pull = np.zeros((blocks, len(names))), np.zeros((blocks, len(names)))
        cross = np.zeros((blocks, len(names), slopes.shape[2]))
        for b in range(blocks):
            at = rows.block == b
            square[b], pull[b] = np.sum(mine[at] ** 2, axis=0), mine[at].T @ left[at]
            cross[b] = mine[at].T @ own[at]
        for k, name in enumerate(names):
            if is_named(name, channel):
                continue
            over = library_here[name][1]
            unit = f"({unit_of(c)})/({over})" if over else unit_of(c)
            found.append(_Shape(c, name, unit, own_courses[:, k], square[:, k], cross[:, k], pull[:, k]))
    return found


def _taken(shape: _Shape, model: Sums, bread: Floats) -> float:
    """How much of the sum of squares a shape takes with the model fitted again, its bounds aside."""
    cross = shape.cross.sum(axis=0)
    bent = bread @ cross
    own = float(shape.square.sum() - cross @ bent)
    pull = float(shape.pull.sum() - model.cross.sum(axis=(0, 1)) @ bent)
    return pull**2 / own if own > 1e-9 * float(shape.square.sum()) else 0.0


def _judged(
    drive: Drive, rows: Rows, fit: Fit, slopes: Floats, model: Sums, box: Box, shape: _Shape, mute: Bools
) -> Found:
    """The shape with what it gains on unseen blocks."""
    p, c = slopes.shape[2], shape.c
    squares = np.zeros((*model.left.shape, p + 1, p + 1))
    squares[:, :, :p, :p] = model.squares
    squares[:, c, p, :p] = squares[:, c, :p, p] = shape.cross
    squares[:, c, p, p] = shape.square
    cross = np.zeros((*model.left.shape, p + 1))
    cross[:, :, :p], cross[:, c, p] = model.cross, shape.pull
    low, high = np.append(box.low, -np.inf), np.append(box.high, np.inf)
    free = Box(low, high, np.append(box.weight, 0.0))
    weight = np.ones_like(fit.scatter)
    for _ in range(_ROUNDS):
        step = solved(np.einsum("bcij,bc->ij", squares, weight), np.einsum("bci,bc->i", cross, weight), free)
        left = fit.left - slopes @ step[:p]
        left[:, c] -= step[p] * shape.course[rows.at]
        left[~rows.used] = 0.0
        # What the shape explains was scatter: the channels that show it count for more now.
        scatter = scatter_of(rows, left, floors(drive))
        weight = (fit.scatter / scatter) ** 2
    # From there on: how a car is drawn is not what is judged.
    moved = cross - squares @ step
    power = model.left - np.einsum("bci,i->bc", cross + moved, step)
    each = weight[:, :, np.newaxis]
    now = Sums(squares * each[..., np.newaxis], moved * each, power * weight, model.counts)
    lasting = [place for place, i in enumerate(fit.columns) if i not in DRAWN]
    after = held_out(now, [*lasting, p], Box(low - step, high - step, free.weight)) * scatter**2
    coarse = model.counts.sum(axis=0)[c] * fit.form[c] ** 2
    share = 1.0 - float((after.sum(axis=0)[c] + coarse) / (fit.unseen.sum(axis=0)[c] + coarse))
    per_row = correlated_rows(left / scatter[rows.block], rows.used)
    gained = gain(fit.unseen, after, model.counts, per_row, fit.form, mute) - CHOSEN_OF_MANY
    bread = inverse(now.squares.sum(axis=(0, 1)) + np.diag(np.maximum(free.weight, 1e-12)))
    std = float(np.sqrt(max(bread[p, p], 0.0) * per_row[c]))
    effect = as_effect(CHANNELS[c], shape.name, shape.course, shape.unit, abs(float(step[p])))
    return Found(effect, CHANNELS[c], f"k*{shape.name}", share, gained, float(step[p]), std)
