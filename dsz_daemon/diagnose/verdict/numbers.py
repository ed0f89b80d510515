"""The numbers of a cause, in the parameters that the outside knows, with their spreads."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.model import values_of
from dsz_daemon.diagnose.fitting.mounts import BY_GRAVITY, as_offsets_else
from dsz_daemon.diagnose.fitting.spreads import JUDGED
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import Floats
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.verdict.grip import over_shapes
from dsz_daemon.diagnose.verdict.told_roads import rms_told, told_road

# A number is off zero by so many of its spreads, or is none.
LEAST_SPREADS = 2.0
# Of a factor that all wheels share: a drive that tells it no better does not tell it.
_UNTOLD_FACTOR = 0.005
# Values with their spreads, None where there is none.
Told = dict[str, tuple[float, float | None]]
# As the contract has them: true over configured, which is 1 where nothing is left out.
_OVER_CONFIGURED = {("wheel_radius", wheel) for wheel in ("fl", "fr", "rl", "rr")} | {
    ("steering_ratio", "scale"),
    ("cornering_stiffness", "front_scale"),
    ("cornering_stiffness", "rear_scale"),
    ("track_width", "front"),
    ("track_width", "rear"),
}


def offsets_of(found: Search, causes: Collection[str] = ()) -> dict[str, tuple[float, float]]:
    """Each channel's offset and spread beside these causes.

    With what gravity makes of a tilted road or a turned mount that is no cause.
    """
    turned = "imu_misalignment" in found.best.effects and "imu_misalignment" not in causes
    values = values_of(found.drive, found.best, "")
    offsets = {name: value for name, value in values.items() if name.startswith("offset_")}
    bank, grade = told_road(found.drive, found.best, causes)[1]
    roll, pitch = (found.best.x[INDEX[f"imu_misalignment.{axis}_rad"]] if turned else 0.0 for axis in ("roll", "pitch"))
    for name, tilt_rad in (("offset_accel_x", grade - pitch), ("offset_accel_y", bank + roll)):
        value, std = offsets[name]
        offsets[name] = (value + motion.G * float(tilt_rad), std)
    return offsets


def values_told(found: Search, effect: str, *, as_fitted: bool = False) -> Told:
    """(value, spread) of an effect's parameters, or `as_fitted`; of a profile its rms over what was driven."""
    profile = rms_told(found.drive, found.rows, found.best, effect)
    if profile is not None:
        return profile
    values: Told = dict(values_of(found.drive, found.best, effect, as_fitted=as_fitted))
    if effect in BY_GRAVITY:
        values = as_offsets_else(found.drive.vocabulary.described(effect).parameters, values)
    if effect == "wheel_radius" and shares_a_factor(found):
        values = _apart(found, values)
    if "inverse_square" in values:
        square, std = values["inverse_square"]
        mean, spread = over_shapes(*_front_share(found, effect))
        square /= mean * mean
        values["inverse_square"] = (square, math.hypot((std or 0.0) / mean**2, 2.0 * square * spread / mean))
    return values


def _of_radii(found: Search) -> tuple[Floats, Floats]:
    """The wheels' radii (4,), as shares beyond 1, and their covariance (4, 4)."""
    best = found.best
    columns = found.drive.vocabulary.columns_of("wheel_radius")
    places = [best.columns.index(i) for i in columns]
    covariance = np.zeros((4, 4)) if best.covariance is None else best.covariance[np.ix_(places, places)]
    return best.x[list(columns)], covariance


def shares_a_factor(found: Search) -> bool:
    """Whether all radii may be off by one factor that this drive does not tell."""
    radii, covariance = _of_radii(found)
    spread = math.sqrt(float(np.sum(covariance))) / 4.0
    return spread > _UNTOLD_FACTOR and abs(float(np.mean(radii))) < LEAST_SPREADS * spread


def _apart(found: Search, values: Told) -> Told:
    """Radii against their mean, with the spread of that."""
    radii, covariance = _of_radii(found)
    against = np.eye(4) - 0.25
    apart = against @ radii
    spread = np.hypot(np.sqrt(np.diag(against @ covariance @ against.T)), JUDGED.of_itself * apart)
    return dict(zip(values, zip(apart.tolist(), spread.tolist(), strict=True), strict=True))


def _front_share(found: Search, effect: str) -> tuple[Floats, float, float]:
    """The front axle's lateral force over its limit (k,) wherever grip ends, and how the fit bends it.

    Of the limit counts what drive and brakes leave of it.
    """
    drive, best = found.drive, found.best
    moving, car = driven(drive, best.x, best.road), drive.car
    grip = moving.road.grip[found.rows.at]
    load_n = car.mass_kg * motion.G * car.cg_to_rear_axle_m / car.wheelbase_m
    free_n = load_n * moving.rolling.front_free[found.rows.at]
    share = moving.moved[found.rows.at, motion.FRONT_N] * np.sqrt(grip) / free_n
    sharpness, brush = (float(best.x[INDEX[f"{effect}.{name}"]]) for name in ("sharpness", "brush"))
    return share[grip > 0.0], motion.SHARPNESS + sharpness, brush


def on_the_clock(found: Search, values: Told) -> Told:
    """Moments, in which the simulation counts what was recorded, in s since the first frame: pauses count, too."""
    time_s = found.drive.recording.time_s

    def at(moment_s: float) -> float:
        return float(time_s[min(max(round(moment_s / DT_S), 0), len(time_s) - 1)])

    return {n: (at(v), s) if n in {"start_s", "end_s"} else (v, s) for n, (v, s) in values.items()}


def as_told(effect: str, values: Told, units: dict[str, str]) -> tuple[Told, dict[str, str]]:
    """In the parameters that the outside knows."""
    units = units | {"rms_rad": "rad", "rms_n": "N", "friction_coefficient": "1", "cutoff_hz": "Hz"}
    if "inverse_square" in values:
        square, std = values.pop("inverse_square")
        friction = square**-0.5
        values = {"friction_coefficient": (friction, 0.5 * friction * (std or 0.0) / square)} | values
    if effect == "sensor_bandwidth":
        time_constant_s, std = values["time_constant_s"]
        cutoff_hz = 1.0 / (2.0 * math.pi * time_constant_s)
        values = values | {"cutoff_hz": (cutoff_hz, cutoff_hz * (std or 0.0) / time_constant_s)}
    told = {
        name: (value + 1.0, std) if (effect, name) in _OVER_CONFIGURED else (value, std)
        for name, (value, std) in values.items()
    }
    return told, units
