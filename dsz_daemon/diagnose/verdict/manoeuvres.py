"""What to drive next: the manoeuvre in which explanations that this recording can't split would part the most.

Each is simulated with the car as configured. What one explanation does there, less what the others, offsets and
stiffnesses could do alike, over noise and the simulation's coarseness, is what a recording of it would tell.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.fitting.model import nuisances
from dsz_daemon.diagnose.recordings.recording import DT_S, Recording, filter_kernel, filtered
from dsz_daemon.diagnose.recordings.rounding import rounded_anew
from dsz_daemon.diagnose.residuals.comparison import Each, Rows, noises, rows_of, sensitivities
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.pipeline.grid import Signal

_LASTS_S = 40.0
# What a recording has to tell, in log likelihood, and how many rows tell as much as one (those of the low-pass).
_LEAST, _PER_ROW = 10.0, 5.0
_LIMIT_MPS2 = 6.0
# What may be a little off in any car: stiffnesses.
_TOLERANCE = {"front_cornering_stiffness_n_per_rad": 0.1, "rear_cornering_stiffness_n_per_rad": 0.1}


class Manoeuvre(NamedTuple):
    """Words for a driver, and speed (m/s) and curvature wanted (1/m) over time (n,)."""

    words: str
    speed_mps: Callable[[Floats], Floats]
    curvature_1pm: Callable[[Floats], Floats]


def _steady(speed_mps: float) -> Callable[[Floats], Floats]:
    return lambda t: np.full(len(t), speed_mps)


def _straight(t: Floats) -> Floats:
    return np.zeros(len(t))


MANOEUVRES = (
    Manoeuvre(
        "on a flat, straight road brake firmly from 90 to 20 km/h and accelerate again, three times",
        lambda t: 15.0 + 9.5 * np.cos(2.0 * np.pi * t / 13.0),
        _straight,
    ),
    Manoeuvre(
        "on an empty place drive full circles to the left and to the right at 15 km/h with much steering",
        _steady(4.2),
        lambda t: 0.12 * np.sign(np.sin(2.0 * np.pi * t / 20.0)),
    ),
    Manoeuvre(
        "hold a bend of 60 m radius, from 20 to 65 km/h and back, to the left and then to the right",
        lambda t: 5.5 + 12.5 * np.abs(np.sin(np.pi * t / 20.0)),
        lambda t: np.where(t < 20.0, 1.0, -1.0) / 60.0,
    ),
    Manoeuvre(
        "swerve gently from side to side once in three seconds at 30 km/h",
        _steady(8.3),
        lambda t: 0.03 * np.sin(2.0 * np.pi * t / 3.0),
    ),
    Manoeuvre(
        "swerve gently from side to side once in three seconds at 100 km/h on an empty road",
        _steady(27.8),
        lambda t: 0.004 * np.sin(2.0 * np.pi * t / 3.0),
    ),
    Manoeuvre(
        "turn the steering wheel at once by a quarter at 70 km/h and hold it for two seconds, to either side",
        _steady(19.4),
        lambda t: 0.01 * np.sign(np.sin(2.0 * np.pi * t / 8.0)) * (np.abs(np.sin(2.0 * np.pi * t / 8.0)) > 0.7),
    ),
    Manoeuvre(
        "drive in bends while braking and accelerating, at 30 to 60 km/h",
        lambda t: 12.5 + 4.0 * np.sin(2.0 * np.pi * t / 9.0),
        lambda t: 0.012 * np.sin(2.0 * np.pi * t / 7.0),
    ),
    Manoeuvre("drive straight ahead on a flat road at 100 km/h for a minute", _steady(27.8), _straight),
)


def next_manoeuvre(drive: Drive, x: Floats, effect: str, others: Sequence[str], each: Each = map) -> str | None:
    """In words, what splits the effect (as large as in `x`) from the others best; None where nothing does."""
    told = list(each(lambda one: _tells(driven(drive, one), x, effect, others), MANOEUVRES))
    most = max(told)
    return MANOEUVRES[told.index(most)].words if most >= _LEAST else None


def driven(drive: Drive, manoeuvre: Manoeuvre) -> Drive:
    """The manoeuvre with the car as configured, and with the sensors of the drive."""
    time_s = DT_S * np.arange(round(_LASTS_S / DT_S), dtype=np.float64)
    v = manoeuvre.speed_mps(time_s)
    curvature = np.clip(manoeuvre.curvature_1pm(time_s), -_LIMIT_MPS2 / v**2, _LIMIT_MPS2 / v**2)
    car = drive.car
    softness = (
        car.cg_to_rear_axle_m / car.front_cornering_stiffness_n_per_rad
        - car.cg_to_front_axle_m / car.rear_cornering_stiffness_n_per_rad
    )
    understeer = 0.5 * car.mass_kg * softness / car.wheelbase_m
    steer = curvature * (car.wheelbase_m + understeer * v * v)
    # A hand turns the wheel within some tenths of a second.
    ramp = np.ones(30) / 30.0
    steer = np.convolve(np.pad(steer, 15, mode="edge"), ramp, "valid")[: len(v)]
    recording = Recording(
        time_s,
        steer,
        np.tile(v[:, np.newaxis], (1, 4)),
        np.zeros((len(v), 6)),
        drive.recording.floor,
        drive.recording.steering_step_rad,
        rounding_rad=_rounding_rad(time_s, steer, drive.recording.steering_step_rad),
    )
    made = drive_of(recording, car, drive.steering_ratio, drive.vocabulary)
    made.measured[:] = predicted(made, np.zeros(len(drive.vocabulary.columns)), flat(len(v)))
    made.measured[:, ~np.isfinite(drive.measured).any(axis=0)] = np.nan
    return made


def _rounding_rad(time_s: Floats, steer_rad: Floats, step_rad: float) -> Floats | None:
    """What rounding to such steps may do to the steering (ways, n); None without any."""
    if step_rad <= 0.0:
        return None
    told = Signal((1e9 * time_s).astype(np.int64), steer_rad)
    return np.array([filtered(one.values, filter_kernel()) for one in rounded_anew(told, step_rad)])


def _tells(drive: Drive, x: Floats, effect: str, others: Sequence[str]) -> float:
    """Log likelihood by which the effect would win there against the others at their best."""
    rows = rows_of(drive)
    words = drive.vocabulary
    mine = [i for i in words.columns_of(effect) if x[i] != 0.0]
    start = np.zeros(len(x))
    there = start.copy()
    there[mine] = x[mine]
    base = predicted(drive, start, flat(len(drive.steer)))
    signature = np.where(rows.used, (predicted(drive, there, flat(len(drive.steer))) - base)[rows.at], 0.0)
    columns = [*nuisances(_TOLERANCE), *(i for other in others for i in words.columns_of(other))]
    slopes = sensitivities(drive, rows, start, flat(len(drive.steer)), base, columns)
    return _left_over(drive, rows, signature, slopes)


def _left_over(drive: Drive, rows: Rows, signature: Floats, slopes: Floats) -> float:
    scatter = np.hypot(np.nan_to_num(noises(drive)), rows.form)
    heard = np.where(np.isfinite(scatter) & (scatter > 0.0), 1.0 / np.where(scatter > 0.0, scatter, 1.0), 0.0)
    goal = (signature * heard).ravel()
    table = (slopes * heard[:, np.newaxis]).reshape(len(goal), -1)
    step = np.linalg.lstsq(table, goal, rcond=1e-9)[0]
    return 0.5 * float(np.sum((goal - table @ step) ** 2)) / _PER_ROW
