"""How an IMU stands in the car, as far as a recording can tell."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from dsz_daemon.diagnose.effects.row import Parameter
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.simulation.drive import Drive, Floats

MOUNT = "imu_misalignment"
LEANS = frozenset({"suspension_roll", "suspension_pitch"})
# What turns an IMU against the road: drawn wholly, or by small angles.
TURNED = LEANS | {MOUNT}
# What gravity alone may show of these is a constant.
BY_GRAVITY = frozenset({MOUNT, "accel_cross_axis", "gyro_g_sensitivity"})
_ROLL, _PITCH, _YAW = (INDEX[f"{MOUNT}.{axis}_rad"] for axis in ("roll", "pitch", "yaw"))
_GYRO_X, _GYRO_Y, _ACCEL_Z = 0, 1, 5
# An arm is from the C.G. of the car, or of its body: wheels and axles do not lean, and what leans swings by their tenth
# of the mass more, which is an IMU so much higher.
IN_A_BODY_M = 0.05


def untold_turns(drive: Drive, effects: Collection[str]) -> set[int]:
    """Columns of turns that only gravity would show, as a constant: the same as an accelerometer's offset.

    A pitched mount shows the yaw rate to the roll gyro, and what speeds the car up to a_z. What is rolled shows the
    yaw gyro how a road that climbs pitches the car, what is pitched how a bank rolls it.
    """
    gyro_x, gyro_y, accel_z = (bool(np.isfinite(drive.measured[:, c]).any()) for c in (_GYRO_X, _GYRO_Y, _ACCEL_Z))
    found = set() if gyro_y or accel_z or "road_grade" in effects else {_ROLL}
    return found if gyro_x or accel_z or "road_bank" in effects else found | {_PITCH}


def as_drawn_rad(x: Floats) -> dict[int, float]:
    """What each turn may be another by if turns are made one after another, in whatever order: half of two others."""
    roll, pitch, yaw = (abs(float(x[i])) for i in (_ROLL, _PITCH, _YAW))
    return {_ROLL: 0.5 * pitch * yaw, _PITCH: 0.5 * roll * yaw, _YAW: 0.5 * roll * pitch}


def as_offsets_else(
    parameters: Sequence[Parameter], values: Mapping[str, tuple[float, float | None]]
) -> dict[str, tuple[float, float | None]]:
    """(value, spread) of each; 0 where a constant would be the same and any value would do: the offset has it all."""
    found = dict[str, tuple[float, float | None]]()
    for parameter in parameters:
        value, std = values.get(parameter.name, (0.0, None))
        is_told = std is not None and std <= parameter.high
        found[parameter.name] = (value, std) if is_told else (0.0, std or parameter.high)
    return found
