"""What the instruments would show if the simulation were right, with any of the effects in it."""

from __future__ import annotations

from typing import Any

import numpy as np

from dsz_daemon.diagnose.effects.row import Motion, Parameter
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import ALONG_FILTER_S, DT_S, filter_kernel
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats
from dsz_daemon.diagnose.simulation.instruments import (
    add_offsets,
    felt,
    low_passed,
    side_by_side,
)
from dsz_daemon.diagnose.simulation.moving import Moving, driven
from dsz_daemon.diagnose.simulation.road import Profiles
from dsz_daemon.diagnose.simulation.rolling import Rolling
from dsz_daemon.diagnose.simulation.slow_sensors import smoothed
from dsz_daemon.signals import IMU_CHANNELS, STANDARD_GRAVITY_MPS2

Ints = np.ndarray[Any, np.dtype[np.int64]]
G = STANDARD_GRAVITY_MPS2


def _places(effect: str, names: str) -> Ints:
    return np.array([INDEX[(f"{effect}." if effect else "") + name] for name in names.split()])


def _matrix(scale: str, cross: str) -> Ints:
    """Places (3, 3) of what axes show of each other; on the diagonal those of `scale`, if there is one."""
    rows = [[f"{scale}.{i}" if scale and i == j else f"{cross}.{i}{j}" for j in "xyz"] for i in "xyz"]
    return np.array([[INDEX[name] for name in row] for row in rows])


ALONG, ALONG_KERNEL = 3, filter_kernel(ALONG_FILTER_S)
# Where an IMU's numbers stand among all of them; of matrices (3, 3) what is shown of what.
_LIFT = INDEX["nose_lift.rad_per_v2"]
_LEVER, _TURN = _places("imu_lever_arm", "x_m y_m z_m"), _places("imu_misalignment", "roll_rad pitch_rad yaw_rad")
_SMALL_TURNS, _AS_DRAWN = INDEX["small_turns"], _places("", "small_turns flat_roads flat_bends flat_leans")
_BODY = np.concatenate([_places("suspension_roll", "above_m"), _places("suspension_pitch", "above_m ahead_m")])
# What instruments alone make of the motion, though the effects that have these move the car, too.
SHOWN = frozenset([*_BODY.tolist(), *_AS_DRAWN.tolist()])
_RATES_OF_RATES, _FORCES_OF_FORCES = (_matrix(f"{kind}_scale", f"{kind}_cross_axis") for kind in ("gyro", "accel"))
_SHOWN_OF = np.stack([_RATES_OF_RATES, _matrix("", "gyro_g_sensitivity"), _FORCES_OF_FORCES])
_OFFSETS = _places("", " ".join(f"offset_{channel}" for channel in IMU_CHANNELS))
_DRIFTS, _FADES = _places("bias_drift", " ".join(IMU_CHANNELS)), INDEX["bias_drift.fades_per_s"]
_ONES = np.eye(3)
_OWN = np.stack([_ONES, 0.0 * _ONES, _ONES])
_AT_LIMIT = 1.05


def predicted(drive: Drive, x: Floats, road: Profiles, rolls: Rolling | None = None) -> Floats:
    """All channels (n, 13) for the parameters `x` (in the order of `COLUMNS`), on this road and `x`'s corrections."""
    return shown(drive, x, driven(drive, x, road, rolls))


@np.errstate(over="ignore", invalid="ignore")
def shown(drive: Drive, x: Floats, moving: Moving) -> Floats:
    """What the instruments make of the motion: all channels (n, 13)."""
    reads = _imu(x, moving, moving.imu_ahead_m)
    out = side_by_side(reads, moving.wheels, moving.moved, moving.v_mps, moving.road.grade_rad)
    _clip(drive, x, out)
    _add_own(drive, x, moving, out)
    out[:, ALONG] = low_passed(out[:, ALONG], ALONG_KERNEL)
    return out


def _clip(drive: Drive, x: Floats, out: Floats) -> None:
    """Limits the IMU's channels; az only if it stands at the limit: a sensor's z may well reach further than 1 g.

    What is limited before offsets are added to it stands as much higher on one side as it stands lower on the other.
    """
    gyro, accel = x[INDEX["sensor_saturation.gyro_limit_radps"]], x[INDEX["sensor_saturation.accel_limit_mps2"]]
    aside = x[INDEX["sensor_saturation.before_offset"]] * x[_OFFSETS]
    if gyro > 0.0:
        np.clip(out[:, :3], aside[:3] - gyro, aside[:3] + gyro, out=out[:, :3])
    if accel > 0.0:
        upright = float(np.nanmedian(np.abs(drive.measured[:, 5]))) if np.isfinite(drive.measured[:, 5]).any() else 0.0
        last = 6 if upright < _AT_LIMIT * accel else 5
        np.clip(out[:, 3:last], aside[3:last] - accel, aside[3:last] + accel, out=out[:, 3:last])


def _add_own(drive: Drive, x: Floats, moving: Moving, out: Floats) -> None:
    """What the user's own effects show."""
    m = moving.moved
    for effect in drive.vocabulary.own():
        values = {p.name: float(x[i]) for i, p in _own_parameters(drive, effect.name)}
        if effect.shows is None or not any(values.values()):
            continue
        motion_ = Motion(
            drive.recording.time_s,
            moving.v_mps,
            moving.v_rate - m[:, motion.R] * m[:, motion.VY],
            m[:, motion.VY],
            m[:, motion.R],
            m[:, motion.AY],
            m[:, motion.DELTA],
        )
        for channel, values_of in effect.shows(motion_, values).items():
            out[:, CHANNELS.index(channel)] += values_of


def _own_parameters(drive: Drive, name: str) -> list[tuple[int, Parameter]]:
    return [(i, drive.vocabulary.columns[i][1]) for i in drive.vocabulary.columns_of(name)]


def _imu(x: Floats, moving: Moving, ahead_m: float) -> Floats:
    """The IMU's readings (n, 6); the C.G. is `ahead_m` less far from the front axle than it is configured."""
    m = moving.moved
    if (lift := float(x[_LIFT])) != 0.0:
        m = m.copy(order="F")
        m[:, motion.PITCH] -= lift * moving.v_mps**2
        m[:, motion.PITCH_RATE] -= 2.0 * lift * moving.v_mps * moving.v_rate
    reads: Floats = felt(
        m,
        moving.v_mps,
        moving.v_rate,
        moving.road.bank_rad,
        moving.road.grade_rad,
        x[_LEVER] + np.array([ahead_m, 0.0, 0.0]),
        x[_BODY],
        _axes_of(x),
        DT_S,
        *x[_AS_DRAWN].tolist(),
    )
    reads = smoothed(reads, x)
    add_offsets(reads, x[_OFFSETS], x[_DRIFTS], float(x[_FADES]), DT_S)
    return reads


def _turned(x: Floats) -> Floats:
    """What the sensors' axes (3, 3) see of the car's: turned wholly (to second order), or by small angles."""
    turn_x, turn_y, turn_z = x[_TURN].tolist()
    turn = np.array([[0.0, turn_z, -turn_y], [-turn_z, 0.0, turn_x], [turn_y, -turn_x, 0.0]])
    return np.asarray(_ONES + turn + 0.5 * (1.0 - x[_SMALL_TURNS]) * (turn @ turn))


def gyros_of(x: Floats) -> tuple[Floats, Floats]:
    """What the gyros show of the car's rates, and of the forces that the IMU feels (3, 3)."""
    of_rates, of_forces, _ = _axes_of(x)
    return of_rates, of_forces


def forces_of(x: Floats) -> Floats:
    """What the accelerometers show of the forces that the IMU feels (3, 3)."""
    return np.asarray(_axes_of(x)[2])


def _axes_of(x: Floats) -> Floats:
    """What is shown of what (3, 3, 3): rates of rates, rates of forces, forces of forces."""
    return np.asarray((_OWN + x[_SHOWN_OF]) @ _turned(x))
