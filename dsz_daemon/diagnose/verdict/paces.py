"""Whether a sensor's number is the same for what changes slowly and quickly, for much and little, and later: it is."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel
from dsz_daemon.diagnose.residuals.comparison import EVERY, Each, Rows, sensitivities
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.residuals.evidence import inverse_of_told
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.instruments import low_passed
from dsz_daemon.diagnose.simulation.prediction import predicted

# Numbers by which a reading is a share of a force or a rate, each as the channel's axis and that of what it shows.
_OWN = {axis: axis + axis for axis in "xyz"}
_LEAKS = {two: two for two in ("xy", "xz", "yx", "yz", "zx", "zy")}
_SHARES: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "accel_scale": ("accel", _OWN),
    "gyro_scale": ("gyro", _OWN),
    "accel_cross_axis": ("accel", _LEAKS),
    "gyro_cross_axis": ("gyro", _LEAKS),
    "imu_misalignment": ("accel", {"roll_rad": "yz", "pitch_rad": "xz", "yaw_rad": "xy"}),
}
_COURSES = {"accel": dict(zip("xyz", ("ax", "ay", "az"), strict=True)), "gyro": dict(zip("xyz", "pqr", strict=True))}
SLOWLY, MUCH = "where that changes slowly", "where that is much"
# What a Gaussian of this width leaves is slow, as compared rows come.
_SLOW = filter_kernel(4.0 / EVERY)
# More than so much of nearly the most is much.
_HALF, _NEARLY = 0.5, 0.98
# Slow motion shows another number by so much of it, and by so many spreads of what hangs together: of 62 right ones of
# four simulators by other authors those that were told by 1.5 spreads or more were off by 0.12 of themselves at most;
# an accelerometer behind a filter that takes what lasts for a tilt was by 1.2 of itself, and seven spreads. Set with
# these in view. Much of it shows another one by 0.21 of itself at most, or by 2.2 spreads, where it is right (24 of two
# simulators); where a bracket tips in hard bends by 0.75 and 0.79, and 10 and 12 spreads.
_OF_ITSELF, _SPREADS = 0.5, 3.0
_NO_SLOPE = 1e-12


def differs_by_pace(drive: Drive, rows: Rows, fit: Fit, each: Each = map) -> dict[str, Shape]:
    """The sensors' effects of which a number is another one for slow motion, for much, or later, and by how much.

    Of each its best told number, and that by a good part of itself. What is left has nothing more of the whole course
    of a number in it, or it would be fitted; but it may have more of a part of it, and as much less of the rest. What
    other parameters of the model do is taken off that part first.
    """
    own = {effect: [i for i in drive.vocabulary.columns_of(effect) if i in fit.columns] for effect in fit.effects}
    numbers = {effect: columns for effect, columns in own.items() if effect in _SHARES and columns}
    if not numbers:
        return {}
    base = predicted(drive, fit.x, fit.road)
    slopes = sensitivities(drive, rows, fit.x, fit.road, base, fit.columns, fit.felt, each)
    weight = np.where(rows.used, 1.0 / fit.scatter[rows.block], 0.0)
    left = np.where(rows.used, fit.left, 0.0) * weight
    table = (slopes * weight[:, :, np.newaxis]).reshape(-1, len(fit.columns))
    table /= np.maximum(np.linalg.norm(table, axis=0), _NO_SLOPE)
    inverse, _ = inverse_of_told(table.T @ table, np.full(len(fit.columns), 1e-12))
    found = dict[str, Shape]()
    for effect, columns in numbers.items():
        i = max(columns, key=lambda i: abs(fit.x[i]) / max(fit.std[fit.columns.index(i)], 1e-300))
        course = slopes[:, :, fit.columns.index(i)]
        parts = [(_slow_part(rows, course), SLOWLY), (_much_of(rows, course), MUCH)]
        parts += [(_since(rows, course, since), f"from {rows.at[since] * DT_S:.1f} s on") for since in _moments(rows)]
        for part, words in parts:
            told = _more_of(rows, part * weight, left, table, inverse)
            if abs(told.value) > max(_OF_ITSELF * abs(float(fit.x[i])), _SPREADS * told.std):
                sensor, axes = _SHARES[effect]
                two = axes[drive.vocabulary.columns[i][1].name]
                found[effect] = Shape(f"{sensor}_{two[0]}", f"k*{_COURSES[sensor][two[1]]} {words}", told, 1.0)
                break
    return found


def _more_of(rows: Rows, part: Floats, left: Floats, table: Floats, inverse: Floats) -> Coefficient:
    """By how much more of a part (k, 13) is in what is left (k, 13), both over their scatter, beside what is fitted."""
    part = part - (table @ (inverse @ (table.T @ part.ravel()))).reshape(part.shape)
    power = np.sum(part**2, axis=0)
    whole = max(float(np.sum(power)), _NO_SLOPE)
    more = float(np.sum(part * left)) / whole
    # As often as the noise of what neither has hangs together: what is left has the difference in it.
    rest = left - more * part
    square = np.sum(rest**2, axis=0) / np.maximum(np.sum(rows.used, axis=0), 1)
    per_row = correlated_rows(rest, rows.used)
    return Coefficient(more, math.sqrt(float(np.sum(power * square * per_row))) / whole, "1")


def _much_of(rows: Rows, course: Floats) -> Floats:
    """What of a course (k, 13) is far from its mean."""
    found = np.zeros_like(course)
    for c in np.flatnonzero(course.any(axis=0) & rows.used.any(axis=0)):
        used = rows.used[:, c]
        far = course[:, c] - np.mean(course[used, c])
        is_much = used & (np.abs(far) > _HALF * np.quantile(np.abs(far[used]), _NEARLY))
        found[is_much, c] = far[is_much]
    return found


def _moments(rows: Rows) -> list[int]:
    """Quarters of the rows."""
    return [len(rows.at) * k // 4 for k in (1, 2, 3)]


def _since(rows: Rows, course: Floats, since: int) -> Floats:
    """What of a course (k, 13) is after a row."""
    return np.where(rows.used & (np.arange(len(course)) >= since)[:, np.newaxis], course, 0.0)


def _slow_part(rows: Rows, course: Floats) -> Floats:
    """What of a course (k, 13) changes slowly; where nothing is compared it is nothing."""
    whole = np.zeros((int(rows.at[-1]) // EVERY + 1, course.shape[1]))
    whole[rows.at // EVERY] = np.where(rows.used, course, 0.0)
    for c in np.flatnonzero(whole.any(axis=0)):
        whole[:, c] = low_passed(np.ascontiguousarray(whole[:, c]), _SLOW)
    return whole[rows.at // EVERY]
