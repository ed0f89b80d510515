"""What has no name and turns the car: where the car, not a sensor, is another than the simulated one.

A shape in a channel is of one sensor. What turns a car shows in its yaw rate and its lateral acceleration at once, as
the car makes it: a moment of the air, an axle that steers as the body leans, an eccentric steering sensor, a joint,
rear wheels that steer, drive that goes to the outer wheel, tyres that warm up.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import vocabulary
from dsz_daemon.diagnose.fitting.gains import quiet
from dsz_daemon.diagnose.fitting.model import Fit, Slopes, box_of
from dsz_daemon.diagnose.residuals.comparison import Each, Rows, sensitivities
from dsz_daemon.diagnose.residuals.evidence import inverse, sums
from dsz_daemon.diagnose.shapes.beside import step_beside, taken_beside
from dsz_daemon.diagnose.shapes.car_courses import as_effect_of_the_car, courses_of
from dsz_daemon.diagnose.shapes.unlisted import Found
from dsz_daemon.diagnose.simulation.car import car_of
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.simulation.prediction import predicted

_YAW, _ACROSS = CHANNELS.index("gyro_z"), CHANNELS.index("accel_y")
# So many are judged on blocks that they have not seen: those that take the most off what is left.
_TRIED = 3


def steered_shape(
    drive: Drive, rows: Rows, fit: Fit, known: Slopes, tolerance: Mapping[str, float], each: Each = map
) -> Found | None:
    """The course of the car that gains most with the model fitted again beside it, by a linear step.

    `known`: sensitivities at the model's end.
    """
    mute = quiet(drive, fit)
    if not (rows.used.any(axis=0) & ~mute)[[_YAW, _ACROSS]].any():
        return None
    moving, model_of_car = driven(drive, fit.x, fit.road), car_of(drive, fit.x)
    courses = courses_of(moving, drive.steer * drive.steering_ratio, drive.steer)
    effects = (as_effect_of_the_car(course, moving, model_of_car) for course in courses)
    new = [effect for effect in effects if effect is not None and effect.name not in fit.effects]
    # One that had to go is in the vocabulary still.
    renamed = [effect._replace(name=f"new {effect.name}") for effect in new]
    there = drive._replace(vocabulary=vocabulary((*drive.vocabulary.own(), *renamed)))
    x = np.append(fit.x, np.zeros(len(new)))
    columns = range(len(fit.x), len(x))
    shown = sensitivities(there, rows, x, fit.road, predicted(there, x, fit.road), columns, fit.felt, each)
    slopes = known.at(fit.columns)
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
