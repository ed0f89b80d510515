"""The model fitted again, by a linear step, with one course more: what that gains on blocks that it has not seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.fitting.model import DRAWN, Fit
from dsz_daemon.diagnose.residuals.comparison import Bools, Rows, floors
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.residuals.evidence import Box, Sums, gain, held_out, inverse, scatter_of, solved
from dsz_daemon.diagnose.shapes.unlisted import CHOSEN_OF_MANY
from dsz_daemon.diagnose.simulation.drive import Drive, Floats

# The channels' weights are found anew so often.
_ROUNDS = 4
_HIDDEN = 1e-9


def taken_beside(bread: Floats, pulls: Floats, cross: Floats, square: float, pull: float) -> float:
    """How much of the sum of squares a course takes with the model fitted again beside it, its bounds aside.

    `bread` (p, p), the inverse of the model's normal equations, and its `pulls` (p,); the course's products with the
    model's slopes (p,), with itself, and with what is left.
    """
    bent = bread @ cross
    own, more = square - float(cross @ bent), pull - float(pulls @ bent)
    # One that the model hides takes nothing.
    return more**2 / own if own > _HIDDEN * square else 0.0


class Beside(NamedTuple):
    """A linear step with one parameter more, the last: its value, its spread if all rows are independent, its gain.

    `unseen` (13,): squares left on blocks that the step has not seen; `per_row` as of `gain`.
    """

    value: float
    std: float
    gain: float
    unseen: Floats
    per_row: Floats


def step_beside(
    drive: Drive, rows: Rows, fit: Fit, slopes: Floats, larger: Sums, box: Box, course: Floats, mute: Bools
) -> Beside:
    """The model fitted again, by a linear step, with what shows the `course` (k, 13) per unit beside it.

    `slopes` (k, 13, p) are the model's own, `larger` the sums of these and the course, p + 1.
    """
    p, squares, cross = slopes.shape[2], larger.squares, larger.cross
    low, high = np.append(box.low, -np.inf), np.append(box.high, np.inf)
    free = Box(low, high, np.append(box.weight, 0.0))
    weight = np.ones_like(fit.scatter)
    for _ in range(_ROUNDS):
        step = solved(np.einsum("bcij,bc->ij", squares, weight), np.einsum("bci,bc->i", cross, weight), free)
        left = fit.left - slopes @ step[:p] - step[p] * course
        left[~rows.used] = 0.0
        # What the course explains was scatter: the channels that show it count for more now.
        scatter = scatter_of(rows, left, floors(drive))
        weight = (fit.scatter / scatter) ** 2
    # From there on: how a car is drawn is not what is judged.
    moved = cross - squares @ step
    power = larger.left - np.einsum("bci,i->bc", cross + moved, step)
    each = weight[:, :, np.newaxis]
    now = Sums(squares * each[..., np.newaxis], moved * each, power * weight, larger.counts)
    lasting = [place for place, i in enumerate(fit.columns) if i not in DRAWN]
    after = held_out(now, [*lasting, p], Box(low - step, high - step, free.weight)) * scatter**2
    per_row = correlated_rows(left / scatter[rows.block], rows.used)
    gained = gain(fit.unseen, after, larger.counts, per_row, fit.form, mute) - CHOSEN_OF_MANY
    bread = inverse(now.squares.sum(axis=(0, 1)) + np.diag(np.maximum(free.weight, 1e-12)))
    return Beside(float(step[p]), float(np.sqrt(max(bread[p, p], 0.0))), gained, after.sum(axis=0), per_row)
