"""What a drive can't test: effects that would hardly show on it."""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.effects.nameless import NAMELESS
from dsz_daemon.diagnose.effects.row import (
    DURATION,
    LATERAL,
    LONGITUDINAL,
    SPEED,
    STEERING_RATE,
    YAW_ACCELERATION,
    YAW_RATE,
    Excitation,
    Parameter,
)
from dsz_daemon.diagnose.effects.shape_names import is_shape
from dsz_daemon.diagnose.fitting.model import OWN_CHANNEL
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel, filtered
from dsz_daemon.diagnose.residuals.comparison import Each, driven_s
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.selection import search as searching
from dsz_daemon.diagnose.selection.screening import NEVER_SCREENED
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import Drive
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.surroundings.unfelt_banks import is_unfelt
from dsz_daemon.diagnose.surroundings.unfelt_grades import climbs_unfelt
from dsz_daemon.signals import IMU_CHANNELS

_NAMELESS = frozenset(effect.name for effect in NAMELESS)


def untested(found: Search, each: Each) -> list[dict[str, str]]:
    """Effects of which a plain size would have shown by less than what is asked of a cause."""
    words = found.drive.vocabulary
    known = {*found.best.effects, *NEVER_SCREENED, *_NAMELESS}
    rows = [e for e in words.effects if e.name not in known and not is_shape(e.name)]
    columns = [i for effect in rows for i in words.columns_of(effect.name)]
    slopes = searching.slopes_of(found, columns, each)
    heard = 1.0 / ((found.best.scatter**2 + found.rows.form**2) * found.best.per_row)
    power: list[float] = np.einsum("kcp,kc->p", slopes**2, heard[found.rows.block]).tolist()
    weak, most = [], _excitation(found)
    for effect in rows:
        own = [columns.index(i) for i in words.columns_of(effect.name)]
        shown = [0.5 * words.columns[columns[i]][1].step ** 2 * power[i] for i in own]
        if max(shown) < LEAST_GAIN:
            name = words.columns[columns[own[int(np.argmax(shown))]]][1]
            why = f"even {_plain(name)} would show by less than noise does on this drive"
            lacks = ", ".join(f"{one.words} stayed below {most[one]:.2g} {one.unit}" for one in effect.needs)
            weak.append({"effect": effect.name, "why": f"{lacks}: {why}" if lacks else why})
    return [*weak, *_untold_roads(found.drive)]


def _plain(parameter: Parameter) -> str:
    """A plain size of a parameter, in those that the outside knows."""
    if parameter.name == "inverse_square":
        return f"friction_coefficient of {parameter.step**-0.5:g}"
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return f"{parameter.name} of {parameter.step:g}{unit}"


def _excitation(found: Search) -> dict[Excitation, float]:
    """The most there was of each where the drive is compared, in its unit; rounded up, as what stayed below it."""
    moving, at = driven(found.drive, found.best.x, found.best.road), found.rows.at
    m = moving.moved
    courses = {
        SPEED: moving.v_mps,
        YAW_RATE: m[:, motion.R],
        YAW_ACCELERATION: m[:, motion.R_RATE],
        LATERAL: m[:, motion.AY],
        LONGITUDINAL: filtered(moving.v_rate, filter_kernel()),
        STEERING_RATE: np.gradient(found.drive.steer, DT_S),
    }
    most = {one: float(np.max(np.abs(course[at]), initial=0.0)) for one, course in courses.items()}
    return {one: _rounded_up(value) for one, value in (most | {DURATION: driven_s(found.drive, found.rows)}).items()}


def _rounded_up(value: float) -> float:
    """To two digits."""
    if value <= 0.0:
        return 0.0
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / digit) * digit


def _untold_roads(drive: Drive) -> list[dict[str, str]]:
    """Roads that nothing there would show."""
    has = [bool(np.isfinite(drive.measured[:, c]).any()) for c in range(len(IMU_CHANNELS))]
    found = []
    if not has[OWN_CHANNEL["road_grade"]] and not climbs_unfelt(drive):
        why = "there is neither a pitch gyro to feel it nor a longitudinal accelerometer"
        found.append({"effect": "road_grade", "why": why})
    if not has[OWN_CHANNEL["road_bank"]] and not is_unfelt(drive):
        why = "there is no roll gyro to feel it, nor a yaw gyro beside a lateral accelerometer"
        found.append({"effect": "road_bank", "why": why})
    return found
