"""The vocabulary: each row a statement, an equation, its parameters, and how much of it is plausible.

A parameter is 0 where nothing is left out. `step` is a plain size of it: sensitivities are secants over a step, so
that effects whose slope vanishes at 0 (play, grip) show, too. Below `least` no name is given: sines for angles, a
message's own few milliseconds, wheels with inertia, counted poles and a differentiated speed do as much.
"""

from __future__ import annotations

from typing import NamedTuple

from dsz_daemon.diagnose.effects.body import MASS_LOADING, SUSPENSION_PITCH, SUSPENSION_ROLL
from dsz_daemon.diagnose.effects.imu import (
    ACCEL_CROSS_AXIS,
    ACCEL_SCALE,
    BIAS_DRIFT,
    GYRO_CROSS_AXIS,
    GYRO_G_SENSITIVITY,
    GYRO_SCALE,
    IMU_DELAY,
    IMU_LEVER_ARM,
    IMU_MISALIGNMENT,
    SENSOR_BANDWIDTH,
    SENSOR_SATURATION,
)
from dsz_daemon.diagnose.effects.nameless import NAMELESS
from dsz_daemon.diagnose.effects.nuisances import FORM, OFFSETS, TOLERATED
from dsz_daemon.diagnose.effects.row import Effect, Parameter
from dsz_daemon.diagnose.effects.steering import (
    STEERING_BACKLASH,
    STEERING_COMPLIANCE,
    STEERING_DELAY,
    STEERING_OFFSET,
    STEERING_RATIO,
)
from dsz_daemon.diagnose.effects.surroundings import ROAD, SIDE_WIND
from dsz_daemon.diagnose.effects.tyres import (
    CORNERING_STIFFNESS,
    LOW_FRICTION,
    TYRE_RELAXATION,
    TYRE_SATURATION,
    WHEEL_SLIP,
)
from dsz_daemon.diagnose.effects.wheels import TRACK_WIDTH, WHEEL_RADIUS, WHEEL_SPEED_DELAY

EFFECTS: tuple[Effect, ...] = (
    IMU_LEVER_ARM,
    IMU_MISALIGNMENT,
    GYRO_SCALE,
    ACCEL_SCALE,
    GYRO_CROSS_AXIS,
    ACCEL_CROSS_AXIS,
    GYRO_G_SENSITIVITY,
    BIAS_DRIFT,
    IMU_DELAY,
    STEERING_DELAY,
    WHEEL_SPEED_DELAY,
    SENSOR_BANDWIDTH,
    SUSPENSION_ROLL,
    SUSPENSION_PITCH,
    TYRE_SATURATION,
    TYRE_RELAXATION,
    WHEEL_SLIP,
    WHEEL_RADIUS,
    STEERING_OFFSET,
    STEERING_RATIO,
    STEERING_COMPLIANCE,
    STEERING_BACKLASH,
    MASS_LOADING,
    CORNERING_STIFFNESS,
    TRACK_WIDTH,
    SENSOR_SATURATION,
    LOW_FRICTION,
    SIDE_WIND,
)

# What has no slope at 0: really fitted from a guess, never screened by a secant.
GUESSED = ("sensor_saturation", "low_friction", "soft_mount", "steering_slip")

_BUILT_IN_ROWS = len(EFFECTS) + len(ROAD) + len(NAMELESS)


class Vocabulary(NamedTuple):
    """What may have been left out: the rows above, and those of one's own behind them.

    `columns`: all parameters in a row, (effect, parameter), effect "" for what is refitted first.
    """

    effects: tuple[Effect, ...]
    columns: tuple[tuple[str, Parameter], ...]

    def columns_of(self, effect: str) -> tuple[int, ...]:
        """Where the parameters of one effect stand."""
        return tuple(i for i, (name, _) in enumerate(self.columns) if name == effect)

    def described(self, effect: str) -> Effect:
        """The row of this name."""
        return next(row for row in self.effects if row.name == effect)

    def own(self) -> tuple[Effect, ...]:
        """The rows behind the built-in ones."""
        return self.effects[_BUILT_IN_ROWS:]


def _does_something(effect: Effect) -> bool:
    """Whether a row says itself what it does, as those behind the built-in ones do."""
    return any(there is not None for there in (effect.shows, effect.steers, effect.pushes))


def vocabulary(own: tuple[Effect, ...] = ()) -> Vocabulary:
    """The built-in rows and one's own; ValueError: a name that is there already, or nothing that it shows."""
    for effect in own:
        if not _does_something(effect):
            raise ValueError(f"effect {effect.name!r} shows nothing; expected a function of the motion in `shows`")
    effects = (*EFFECTS, *ROAD, *NAMELESS, *own)
    names = [effect.name for effect in effects]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"effects {', '.join(twice)} are there twice; expected names of their own")
    first = tuple(("", parameter) for parameter in (*OFFSETS, *TOLERATED, *FORM))
    return Vocabulary(effects, (*first, *((e.name, parameter) for e in effects for parameter in e.parameters)))


BUILT_IN = vocabulary()
COLUMNS = BUILT_IN.columns
INDEX = {(f"{effect}." if effect else "") + parameter.name: i for i, (effect, parameter) in enumerate(COLUMNS)}
NUISANCES = tuple(range(len(OFFSETS) + len(TOLERATED) + len(FORM)))
