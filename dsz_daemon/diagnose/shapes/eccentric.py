"""A steering sensor that is eccentric: what it is off by straight ahead belongs to its circle, and is no offset."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from dsz_daemon.diagnose.effects.shape_names import SHAPE, STEERING
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.shapes.unlisted import Shape
from dsz_daemon.diagnose.simulation.drive import Drive

# Courses that are nothing straight ahead, and what they are about the middle of the circle.
_CIRCLES = {f"(1-cos({turn}))": f"cos({turn})" for turn in ("hand", "2*hand")}
# What goes by the hand wheel's angle.
_OF_THE_HAND = "hand)"
_OFFSET = INDEX["steering_offset.offset_rad"]
# The middle is at zero but for so many spreads, and for so much of the circle; or, of which a ratio is the other half.
_SPREADS, _OF_THE_CIRCLE, _OF_HALF_A_CIRCLE = 2.0, 0.2, 0.5
_RATIO = "steering_ratio"


def circle_of(drive: Drive, fit: Fit) -> str | None:
    """The course whose value straight ahead is all that the model's steering offset is; None without one."""
    if "steering_offset" not in fit.effects:
        return None
    offset = fit.columns.index(_OFFSET)
    for course in _CIRCLES:
        if (name := f"{STEERING}{SHAPE}{course}") not in fit.effects:
            continue
        [i] = drive.vocabulary.columns_of(name)
        k = fit.columns.index(i)
        # k (1 - cos) + offset = -k cos + middle.
        middle = float(fit.x[_OFFSET] + fit.x[i])
        std = math.sqrt(max(float(fit.covariance[[offset, k]][:, [offset, k]].sum()), 0.0))
        share = _OF_HALF_A_CIRCLE if _RATIO in fit.effects else _OF_THE_CIRCLE
        if abs(middle) < max(_SPREADS * std, share * abs(float(fit.x[i]))):
            return course
    return None


def parts_of(drive: Drive, fit: Fit, said: Collection[str]) -> set[str]:
    """The names of the model that belong to an eccentric sensor, if it is `said` to be one.

    Its zero; and near it, how steep its circle is.
    """
    if not any(effect.startswith(f"{STEERING}{SHAPE}") and _OF_THE_HAND in effect for effect in said):
        return set()
    return ({"steering_offset"} if circle_of(drive, fit) is not None else set()) | ({_RATIO} & set(fit.effects))


def about_the_middle(shapes: Sequence[Shape], course: str) -> list[Shape]:
    """The shapes, of which the `course` is said about the middle of its circle."""
    return [
        shape._replace(
            shape=shape.shape.replace(course, _CIRCLES[course]),
            coefficient=shape.coefficient._replace(value=-shape.coefficient.value),
        )
        if course in shape.shape
        else shape
        for shape in shapes
    ]
