"""What has no name and turns the front wheels: where the car, not a sensor, is another than the simulated one.

A shape in a channel is of one sensor. What steers a car shows in its yaw rate and its lateral acceleration at once, as
the car makes it: a moment of the air, an axle that steers as the body leans, an eccentric steering sensor, a joint.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dsz_daemon.diagnose.beside import step_beside, taken_beside
from dsz_daemon.diagnose.comparison import Each, Rows, sensitivities
from dsz_daemon.diagnose.effect_row import CAR, Effect, Parameter
from dsz_daemon.diagnose.effects import vocabulary
from dsz_daemon.diagnose.evidence import inverse, sums
from dsz_daemon.diagnose.fit import Fit, Slopes, box_of
from dsz_daemon.diagnose.gains import quiet
from dsz_daemon.diagnose.motion import AY, VY
from dsz_daemon.diagnose.prediction import CHANNELS, Drive, Floats, Moving, driven, predicted
from dsz_daemon.diagnose.shape_names import SHAPE, STEERING
from dsz_daemon.diagnose.unlisted import Found

_YAW, _ACROSS = CHANNELS.index("gyro_z"), CHANNELS.index("accel_y")
# A turn of the front wheels, rms, that any of them may bring; and the most.
_SOME_RAD, _MOST_RAD = 0.002, 0.5
# So many are judged on blocks that they have not seen: those that take the most off what is left.
_TRIED = 2
# Of smaller turns of the hand wheel its sine is the turn, which has a name.
_TURNED_RAD = 1.5


def courses_of(moving: Moving, hand_rad: Floats, steer_rad: Floats) -> dict[str, tuple[Floats, str]]:
    """By what (n,) front wheels may turn further, each with its unit.

    None that is linear in steering or lateral acceleration, nor the steering's own square: all of those have names. And
    none at rest, straight ahead: that is the steering's offset.
    """
    v, side = moving.v_mps, moving.moved[:, AY]
    found: dict[str, tuple[Floats, str]] = {
        "vx^2": (v * v, "m2/s2"),
        "vx*delta": (v * steer_rad, "m rad/s"),
        "vx*vy": (v * moving.moved[:, VY], "m2/s2"),
        "ay*|ay|": (side * np.abs(side), "m2/s4"),
        "(1-cos(hand))": (1.0 - np.cos(hand_rad), ""),
        "(1-cos(2*hand))": (1.0 - np.cos(2.0 * hand_rad), ""),
    }
    if float(np.max(np.abs(hand_rad))) > _TURNED_RAD:
        found |= {"sin(hand)": (np.sin(hand_rad), ""), "sin(2*hand)": (np.sin(2.0 * hand_rad), "")}
    return found


def as_steering(course: str, values: Floats, unit: str) -> Effect:
    """The course as what may have been left out of the car; `values` (n,)."""
    size = float(np.sqrt(np.mean(values**2)))
    per = f"rad/({unit}) of the front wheels" if unit else "rad of the front wheels"
    k = Parameter("k", per, _SOME_RAD / size, -_MOST_RAD / size, _MOST_RAD / size, 0.0)
    return Effect(
        name=f"{STEERING}{SHAPE}{course}",
        words=f"the front wheels turn by {{k:.3g}} {course} more",
        equation=f"delta += k {course}",
        touches=CAR,
        parameters=(k,),
        steers=values,
    )


def steered_shape(
    drive: Drive, rows: Rows, fit: Fit, known: Slopes, tolerance: Mapping[str, float], each: Each = map
) -> Found | None:
    """The course of the front wheels that gains most with the model fitted again beside it, by a linear step.

    `known`: sensitivities at the model's end.
    """
    mute = quiet(drive, fit)
    if not (rows.used.any(axis=0) & ~mute)[[_YAW, _ACROSS]].any():
        return None
    courses = courses_of(driven(drive, fit.x, fit.road), drive.steer * drive.steering_ratio, drive.steer)
    new = [as_steering(name, *course) for name, course in courses.items() if np.any(course[0])]
    new = [effect for effect in new if effect.name not in fit.effects]
    # One that had to go is in the vocabulary still.
    renamed = [effect._replace(name=f"new {effect.name}") for effect in new]
    there = drive._replace(vocabulary=vocabulary((*drive.vocabulary.own(), *renamed)))
    x = np.append(fit.x, np.zeros(len(new)))
    columns = range(len(fit.x), len(x))
    shown = sensitivities(there, rows, x, fit.road, predicted(there, x, fit.road), columns, fit.felt, each)
    slopes = np.ascontiguousarray(known.values[:, :, [known.columns.index(i) for i in fit.columns]])
    box = box_of(drive.vocabulary.columns, fit.x, fit.columns, tolerance)
    p, model = slopes.shape[2], sums(rows, fit.left, np.concatenate([slopes, shown], axis=2), fit.scatter)
    squares, cross = model.squares.sum(axis=(0, 1)), model.cross.sum(axis=(0, 1))
    bread = inverse(squares[:p, :p] + np.diag(np.maximum(box.weight, 1e-12)))

    def taken(at: int) -> float:
        own, mine = squares[p + at], p + at
        return taken_beside(bread, cross[:p], own[:p], float(own[mine]), float(cross[mine]))

    def judged(at: int) -> Found:
        course, effect = np.ascontiguousarray(shown[:, :, at]), new[at]
        mine = [*range(p), p + at]
        larger = model._replace(
            squares=np.ascontiguousarray(model.squares[:, :, mine][..., mine]), cross=model.cross[..., mine]
        )
        step = step_beside(drive, rows, fit, slopes, larger, box, course, mute)
        share = 1.0 - float(step.unseen[_YAW] / max(fit.unseen.sum(axis=0)[_YAW], 1e-30))
        std = step.std * float(np.sqrt(step.per_row[_YAW]))
        return Found(effect, CHANNELS[_YAW], effect.name.partition(": ")[2], share, step.gain, step.value, std)

    tried = sorted(range(len(new)), key=lambda at: -taken(at))[:_TRIED]
    return max(each(judged, tried), key=lambda found: found.gain, default=None)
