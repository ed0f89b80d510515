"""What no named effect explains: where it enters, and its simplest shape.

Each channel is held against a library of products of motion, one at a time; a coefficient's unit is the channel's over
the shape's. A shape is said only if it beats, on unseen blocks, what every named effect could do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.comparison import FOLDS, Ints, Rows, floors
from dsz_daemon.diagnose.fit import Fit
from dsz_daemon.diagnose.prediction import CHANNELS, Drive, Floats
from dsz_daemon.diagnose.recording import DT_S
from dsz_daemon.diagnose.search import LEAST_GAIN
from dsz_daemon.signals import IMU_CHANNELS

# Of a channel's power that is left: less is no shape worth a name. And it has to be more than noise and form, so often.
LEAST_SHARE = 0.05
_LEAST_LEVEL = 1.25


class Coefficient(NamedTuple):
    """A number with its spread."""

    value: float
    std: float
    unit: str


class Shape(NamedTuple):
    """One channel's left-over structure: coefficient (with spread) times a product of motion."""

    channel: str
    shape: str
    coefficient: Coefficient
    share: float


def library(drive: Drive, rows: Rows) -> dict[str, tuple[Floats, str]]:
    """Products of recorded motion (k,) with their units.

    None that is linear in acceleration, turn or steering: all of those have names (scale, leak, arm, ratio, stiffness).
    """
    measured = np.nan_to_num(drive.measured[rows.at])
    v = np.mean(drive.wheels, axis=1)[rows.at]
    v_rate = np.gradient(np.mean(drive.wheels, axis=1), DT_S)[rows.at]
    r, steer = measured[:, 2], drive.steer[rows.at]
    side = r * v
    shapes: dict[str, tuple[Floats, str]] = {
        "vx": (v, "m/s"),
        "vx^2": (v * v, "m2/s2"),
        "vx^3": (v**3, "m3/s3"),
        "ax^2": (v_rate**2, "m2/s4"),
        "ax^3": (v_rate**3, "m3/s6"),
        "|ax|": (np.abs(v_rate), "m/s2"),
        "ay^2": (side**2, "m2/s4"),
        "ay^3": (side**3, "m3/s6"),
        "|ay|": (np.abs(side), "m/s2"),
        "ax*ay": (v_rate * side, "m2/s4"),
        "|r|": (np.abs(r), "rad/s"),
        "r^2": (r * r, "rad2/s2"),
        "vx*ax": (v * v_rate, "m2/s3"),
        "|delta|": (np.abs(steer), "rad"),
    }
    return shapes


def unlisted(drive: Drive, rows: Rows, fit: Fit) -> list[Shape]:
    """The best shape of each IMU channel in which structure is left; none where there is none."""
    shapes, floor = library(drive, rows), np.nan_to_num(floors(drive))
    found = []
    for c, channel in enumerate(CHANNELS[:6]):
        used = rows.used[:, c]
        if np.count_nonzero(used) < 500:
            continue
        left, block = fit.left[used, c], rows.block[used]
        if float(np.sqrt(np.mean(left**2))) < _LEAST_LEVEL * float(np.hypot(floor[c], fit.form[c])):
            continue
        coarse = len(left) * fit.form[c] ** 2
        before = _unseen([np.ones(len(left))], left, block) + coarse
        best: Shape | None = None
        most = 0.0
        for name, (values, unit) in shapes.items():
            columns = [np.ones(len(left)), values[used]]
            after = _unseen(columns, left, block) + coarse
            gained = 0.5 * len(left) / fit.per_row[c] * float(np.log(before / after))
            share = 1.0 - after / before
            if gained > max(most, LEAST_GAIN) and share > LEAST_SHARE:
                value, std = _coefficient(columns, left, fit.per_row[c])
                most, best = (
                    gained,
                    Shape(channel, f"k*{name}", Coefficient(value, std, f"({_unit(c)})/({unit})"), share),
                )
        if best is not None:
            found.append(best)
    return found


def _unit(c: int) -> str:
    return "rad/s" if IMU_CHANNELS[c].startswith("gyro") else "m/s2"


def _unseen(columns: Sequence[Floats], left: Floats, block: Ints) -> float:
    """Sum of squares on blocks that a fit of the columns has not seen."""
    table, total = np.column_stack(columns), 0.0
    for k in range(FOLDS):
        unseen = block % FOLDS == k
        if not unseen.any() or unseen.all():
            continue
        step = np.linalg.lstsq(table[~unseen], left[~unseen], rcond=None)[0]
        total += float(np.sum((left[unseen] - table[unseen] @ step) ** 2))
    return max(total, 1e-30)


def _coefficient(columns: Sequence[Floats], left: Floats, per_row: float) -> tuple[float, float]:
    table = np.column_stack(columns)
    step = np.linalg.lstsq(table, left, rcond=None)[0]
    scatter = float(np.mean((left - table @ step) ** 2)) * per_row
    return float(step[1]), float(np.sqrt(scatter * np.linalg.pinv(table.T @ table)[1, 1]))
