"""A shape without a name as a rival of the names: judged with all that is in the model fitted again beside it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.shape_names import with_shapes
from dsz_daemon.diagnose.fitting.gains import far_off, quiet
from dsz_daemon.diagnose.fitting.model import Fit, Slopes, box_of
from dsz_daemon.diagnose.residuals.comparison import Bools, Each, Rows, all_hands
from dsz_daemon.diagnose.residuals.evidence import Box, Sums, inverse, sums
from dsz_daemon.diagnose.shapes.beside import step_beside, taken_beside
from dsz_daemon.diagnose.shapes.own_ways import own_motion, own_ways
from dsz_daemon.diagnose.shapes.steered import steered_shape
from dsz_daemon.diagnose.shapes.unlisted import (
    BY_CHANCE,
    LEAST_ROWS,
    Found,
    as_effect,
    best_shape,
    is_named,
    library,
    unit_of,
)
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.signals import IMU_CHANNELS

# So many are judged on blocks that they have not seen: those that take the most off what is left.
_TRIED = 4


class _Shape(NamedTuple):
    """A product of motion, `course` (n,), on channel c; `cross` (b, p): its products with the model's slopes."""

    c: int
    name: str
    unit: str
    course: Floats
    square: Floats
    cross: Floats
    pull: Floats


def likeliest_shapes(
    drive: Drive,
    rows: Rows,
    fit: Fit,
    known: Slopes,
    tolerance: Mapping[str, float],
    each: Each = map,
    *,
    beside: bool,
) -> list[Found]:
    """What has no name: of a sensor, found in what is left, or `beside` all that is fitted again; and of the car.

    Of each the one that gains the most.
    """

    def of_a_sensor(inside: Each) -> Found | None:
        shapes = [best_shape(drive, rows, fit, inside)]
        # Where much is left and has no shape, tyres within their tolerance may have bent to it.
        if beside or (shapes[0] is None and far_off(drive, fit)[: len(IMU_CHANNELS)].any()):
            shapes.append(shape_beside(drive, rows, fit, known, tolerance, quiet(drive, fit), inside))
        return max((shape for shape in shapes if shape is not None), key=lambda shape: shape.gain, default=None)

    def of_the_car(inside: Each) -> Found | None:
        return steered_shape(drive, rows, fit, known, tolerance, inside)

    found = all_hands(lambda kind, inside: kind(inside), (of_a_sensor, of_the_car), each)
    return [shape for shape in found if shape is not None]


def shape_beside(
    drive: Drive,
    rows: Rows,
    fit: Fit,
    known: Slopes,
    tolerance: Mapping[str, float],
    mute: Bools,
    each: Each = map,
    channels: Collection[str] | None = None,
) -> Found | None:
    """The shape that gains most on unseen blocks where the whole model is fitted again beside it, by a linear step.

    That is how names are judged: what the first refit bends to a shape must not leave it a name's size. `known`:
    sensitivities at the model's end; `mute` (13,): what has nothing to gain, as of `gain`; `channels`: of which one is
    looked for, those of the IMU that have none if not given.
    """
    if channels is None:
        channels = set(IMU_CHANNELS) - with_shapes(fit.effects)
    slopes = known.at(fit.columns)
    box = box_of(drive.vocabulary.columns, fit.x, fit.columns, tolerance)
    model = sums(rows, fit.left, slopes, fit.scatter)
    # Of parameters that the drive does not tell apart none is told: no solution, but no reason to end either.
    bread = inverse(model.squares.sum(axis=(0, 1)) + np.diag(np.maximum(box.weight, 1e-12)))
    shapes = _shapes(drive, rows, fit, slopes, channels)
    pulls = model.cross.sum(axis=(0, 1))

    def taken(shape: _Shape) -> float:
        square, pull = float(shape.square.sum()), float(shape.pull.sum())
        return taken_beside(bread, pulls, shape.cross.sum(axis=0), square, pull)

    tried = sorted(shapes, key=lambda shape: -taken(shape))[:_TRIED]
    judged = each(lambda shape: _judged(drive, rows, fit, slopes, model, box, shape, mute), tried)
    return max(judged, key=lambda found: found.gain, default=None)


def another_course(
    drive: Drive, rows: Rows, fit: Fit, known: Slopes, tolerance: Mapping[str, float], channels: Collection[str]
) -> float:
    """What a second course gains on channels that have a shape already, as if it were not the best of many.

    The first is the simplest of a library: what it leaves is its own form's.
    """
    found = shape_beside(drive, rows, fit, known, tolerance, quiet(drive, fit), channels=channels)
    return found.gain + BY_CHANCE if found is not None else 0.0


def _shapes(drive: Drive, rows: Rows, fit: Fit, slopes: Floats, channels: Collection[str]) -> list[_Shape]:
    """Each shape of each of these channels, with its sums by block, in the channels' scatter."""
    moving = driven(drive, fit.x, fit.road)
    library_here = library(moving, drive)
    blocks, found = int(rows.block[-1]) + 1, []
    for c, channel in enumerate(IMU_CHANNELS):
        used = rows.used[:, c]
        if channel not in channels or np.count_nonzero(used) < LEAST_ROWS:
            continue
        own, here = own_motion(moving, channel), {n: it for n, it in library_here.items() if not is_named(n, channel)}
        here |= own_ways(channel, own, fit.left[used, c], rows.at[used]) if own is not None else {}
        scatter = fit.scatter[rows.block, c]
        courses = np.column_stack([course for course, _ in here.values()])
        # What is the same all the way is the offset's.
        courses -= np.mean(courses[rows.at[used]], axis=0)
        mine = np.where(used[:, np.newaxis], courses[rows.at], 0.0) / scatter[:, np.newaxis]
        of_model, left = slopes[:, c] / scatter[:, np.newaxis], fit.left[:, c] / scatter
        square, pull = np.zeros((blocks, len(here))), np.zeros((blocks, len(here)))
        cross = np.zeros((blocks, len(here), slopes.shape[2]))
        for b in range(blocks):
            at = rows.block == b
            square[b], pull[b] = np.sum(mine[at] ** 2, axis=0), mine[at].T @ left[at]
            cross[b] = mine[at].T @ of_model[at]
        for k, (name, (_, over)) in enumerate(here.items()):
            unit = f"({unit_of(c)})/({over})" if over else unit_of(c)
            found.append(_Shape(c, name, unit, courses[:, k], square[:, k], cross[:, k], pull[:, k]))
    return found


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
    course = np.zeros_like(fit.left)
    course[:, c] = np.where(rows.used[:, c], shape.course[rows.at], 0.0)
    larger = model._replace(squares=squares, cross=cross)
    step = step_beside(drive, rows, fit, slopes, larger, box, course, mute)
    coarse = model.counts.sum(axis=0)[c] * fit.form[c] ** 2
    share = 1.0 - float((step.unseen[c] + coarse) / (fit.unseen.sum(axis=0)[c] + coarse))
    effect = as_effect(CHANNELS[c], shape.name, shape.course, shape.unit, abs(step.value))
    std = step.std * float(np.sqrt(step.per_row[c]))
    return Found(effect, CHANNELS[c], f"k*{shape.name}", share, step.gain, step.value, std)
