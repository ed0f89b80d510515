"""What a car may do that has no name: its wheels turn further, or what turns it is another, by a course over time.

Each is a row behind the vocabulary, of one parameter. Of the front wheels none is linear in steering or lateral
acceleration, nor the steering's own square: all of those have names.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.row import CAR, Effect, Parameter
from dsz_daemon.diagnose.effects.shape_names import MOMENT, REAR, SHAPE, STEERING, TYRES
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel, filtered
from dsz_daemon.diagnose.simulation.drive import Floats
from dsz_daemon.diagnose.simulation.instruments import followed
from dsz_daemon.diagnose.simulation.motion import AY, FRONT_N, ROLLING_MPS, VY, CarModel, R
from dsz_daemon.diagnose.simulation.moving import Moving

# A turn of the wheels, rms, that any of them may bring; and the most.
_SOME_RAD, _MOST_RAD = 0.002, 0.5
# Of smaller turns of the hand wheel its sine is the turn, which has a name.
_TURNED_RAD = 1.5
# A locked axle's moment is all there at a yaw rate of this, rad/s; or in a bend of this, where its wheels slip enough.
_LOCKS_RADPS, _LOCKS_PER_M = 0.06, 0.03
# What is loose in an axle is at its end in a bend of this.
_PLAYS_MPS2 = 1.0
_MINUTE_S = 60.0
# Rear wheels that are made to steer do so against the front ones below 40 to 70 km/h, and with them above.
_CROSSES_MPS = ((12.0, 3.0), (15.0, 7.0), (20.0, 4.0))
# ... and follow the front ones by a first order.
_FOLLOWS_S = 0.2
_UNIT = {
    STEERING: "rad{per} of the front wheels",
    REAR: "rad{per} of the rear wheels",
    MOMENT: "N m{per}",
    TYRES: "1{per} of the tyres' side force",
}
_WORDS = {
    STEERING: "the front wheels turn by {{k:.3g}} {course} more",
    REAR: "the rear wheels turn by {{k:.3g}} {course} more",
    MOMENT: "the car is turned by {{k:.3g}} {course} more",
    TYRES: "the tyres' side force is {{k:.3g}} {course} of it more",
}


class Course(NamedTuple):
    """By what (n,) front or rear wheels turn further, the car is turned, or its tyres are stiffer; with its unit."""

    place: str
    name: str
    values: Floats
    unit: str


def courses_of(moving: Moving, hand_rad: Floats, steer_rad: Floats) -> list[Course]:
    """All that is looked for. None at rest, straight ahead: that is the steering's offset."""
    v, side, r = moving.v_mps, moving.moved[:, AY], moving.moved[:, R]
    v_rate = filtered(moving.v_rate, filter_kernel())
    minutes = np.arange(len(v), dtype=np.float64) * (DT_S / _MINUTE_S)
    found = [
        Course(STEERING, "vx^2", v * v, "m2/s2"),
        Course(STEERING, "vx*delta", v * steer_rad, "m rad/s"),
        Course(STEERING, "vx*vy", v * moving.moved[:, VY], "m2/s2"),
        Course(STEERING, "ay*|ay|", side * np.abs(side), "m2/s4"),
        Course(STEERING, "(1-cos(hand))", 1.0 - np.cos(hand_rad), ""),
        Course(STEERING, "(1-cos(2*hand))", 1.0 - np.cos(2.0 * hand_rad), ""),
        Course(REAR, "delta", steer_rad, "rad"),
        Course(REAR, "vx*delta", v * steer_rad, "m rad/s"),
        Course(REAR, "delta, slowly", followed(steer_rad[:, np.newaxis], _FOLLOWS_S, DT_S)[:, 0], "rad"),
        *(
            Course(REAR, f"tanh((vx-{at:g})/{over:g})*delta", np.tanh((v - at) / over) * steer_rad, "rad")
            for at, over in _CROSSES_MPS
        ),
        Course(REAR, "sign(ay)", np.tanh(side / _PLAYS_MPS2), ""),
        # A wing on one axle, or on both.
        Course(MOMENT, "vx^2*ay", v * v * side, "m3/s4"),
        Course(MOMENT, "ax*ay where ax > 0", np.maximum(v_rate, 0.0) * side, "m2/s4"),
        Course(MOMENT, "ax*ay where ax < 0", np.minimum(v_rate, 0.0) * side, "m2/s4"),
        Course(TYRES, "vx^2", v * v, "m2/s2"),
        Course(TYRES, "t", minutes, "min"),
        Course(TYRES, "exp(-t/60 s)", np.exp(-minutes), ""),
    ]
    # What is locked is no more than a stiffness where it is nowhere near its end.
    bends = r / np.maximum(v, ROLLING_MPS)
    locked = (("sign(r)", r / _LOCKS_RADPS), ("sign(r/vx)", bends / _LOCKS_PER_M))
    found += [Course(MOMENT, name, np.tanh(slip), "") for name, slip in locked if _reaches_its_end(slip)]
    if float(np.max(np.abs(hand_rad))) > _TURNED_RAD:
        found += [
            Course(STEERING, "sin(hand)", np.sin(hand_rad), ""),
            Course(STEERING, "sin(2*hand)", np.sin(2.0 * hand_rad), ""),
        ]
    return found


def _reaches_its_end(slip: Floats) -> bool:
    """Whether a twentieth of the way (n,) is beyond 1."""
    return float(np.quantile(np.abs(slip), 0.95)) > 1.0


def as_effect_of_the_car(course: Course, moving: Moving, model: CarModel) -> Effect | None:
    """The course as what may have been left out of the car, which moves so, and is this; None where it does nothing."""
    lf, lr, front_n = model.cg_to_front_axle_m, model.cg_to_rear_axle_m, moving.moved[:, FRONT_N]
    values, steers, pushes = course.values, None, None
    if course.place == STEERING:
        steers, turn = values, values
    elif course.place == REAR:
        side_n = model.rear_stiffness * values
        pushes, turn = np.column_stack([side_n, -lr * side_n]), values
    elif course.place == MOMENT:
        # As much as a turn of the front wheels.
        turn = values / (model.front_stiffness * lf)
        pushes = np.column_stack([np.zeros(len(values)), values])
    else:
        rear_n = model.mass_kg * moving.moved[:, AY] - front_n
        pushes = values[:, np.newaxis] * np.column_stack([front_n + rear_n, lf * front_n - lr * rear_n])
        turn = values * front_n / model.front_stiffness
    size = float(np.sqrt(np.mean(turn**2)))
    # A car that stands, or has no steering, has tyres that may warm up as they like.
    if size == 0.0:
        return None
    per = f"/({course.unit})" if course.unit else ""
    k = Parameter("k", _UNIT[course.place].format(per=per), _SOME_RAD / size, -_MOST_RAD / size, _MOST_RAD / size, 0.0)
    return Effect(
        name=f"{course.place}{SHAPE}{course.name}",
        words=_WORDS[course.place].format(course=course.name),
        equation=f"{course.place} += k {course.name}",
        touches=CAR,
        parameters=(k,),
        steers=steers,
        pushes=pushes,
    )
