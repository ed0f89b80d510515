"""Whether a sensor's number is the same for what changes slowly and quickly, for much and little, and later: it is.

Nor are wheel speeds later while the car is driven than while it is braked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel, filtered
from dsz_daemon.diagnose.residuals.comparison import EVERY, Bools, Each, Rows, sensitivities
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
_LATE = "wheel_speed_delay"
_COURSES = {"accel": dict(zip("xyz", ("ax", "ay", "az"), strict=True)), "gyro": dict(zip("xyz", "pqr", strict=True))}
SLOWLY, MUCH = "where that changes slowly", "where that is much"
DRIVEN, BRAKED, _SPEEDS_UP_MPS2 = "where the car is driven", "where it is braked", 0.2
# What a Gaussian of this width leaves is slow, as compared rows come.
_SLOW = filter_kernel(4.0 / EVERY)
# More than so much of nearly the most is much.
_HALF, _NEARLY = 0.5, 0.98
# Slow motion shows another number by so much of it, and by so many spreads of what hangs together: of 62 right ones of
# four simulators by other authors those that were told by 1.5 spreads or more were off by 0.12 of themselves at most;
# an accelerometer behind a filter that takes what lasts for a tilt was by 1.2 of itself, and seven spreads. Set with
# these in view. Of much, later, driven or braked another 62 right ones of four simulators were off by 0.27 at most, at
# 3.0 spreads; brackets that tip in hard bends by 0.75 and 0.79, loads that slide once by 0.77 and 0.96, a body that its
# engine rolls by 3.6, all at 7 and more.
# Nor of 15 delays of wheel speeds that were right by more than 0.06 as they were driven or braked; of wheel speeds that
# rise at once, and fall smoothly, by 1.9 and 2.0 of it, at 15 spreads each.
_OF_ITSELF, _SPREADS = 0.5, 3.0
_NO_SLOPE = 1e-12


def differs_by_pace(drive: Drive, rows: Rows, fit: Fit, each: Each = map) -> dict[str, Shape]:
    """The sensors' effects of which a number is another one for slow motion, for much, or later, and by how much.

    Of each its best told number, and that by a good part of itself. What is left has nothing more of the whole course
    of a number in it, or it would be fitted; but it may have more of a part of it, and as much less of the rest. What
    other parameters of the model do is taken off that part first.
    """
    own = {effect: [i for i in drive.vocabulary.columns_of(effect) if i in fit.columns] for effect in fit.effects}
    numbers = {effect: columns for effect, columns in own.items() if effect in {*_SHARES, _LATE} and columns}
    if not numbers:
        return {}
    base = predicted(drive, fit.x, fit.road)
    slopes = sensitivities(drive, rows, fit.x, fit.road, base, fit.columns, fit.felt, each)
    weight = np.where(rows.used, 1.0 / fit.scatter[rows.block], 0.0)
    left = np.where(rows.used, fit.left, 0.0) * weight
    table = (slopes * weight[:, :, np.newaxis]).reshape(-1, len(fit.columns))
    table /= np.maximum(np.linalg.norm(table, axis=0), _NO_SLOPE)
    inverse, _ = inverse_of_told(table.T @ table, np.full(len(fit.columns), 1e-12))
    found, places = dict[str, Shape](), _places(drive, rows)
    for effect, columns in numbers.items():
        i = max(columns, key=lambda i: abs(fit.x[i]) / max(fit.std[fit.columns.index(i)], 1e-300))
        course = slopes[:, :, fit.columns.index(i)]
        parts = [(_slow_part(rows, course), SLOWLY), (_much_of(rows, course), MUCH)]
        parts += [(_where(rows, course, is_there), words) for is_there, words in places]
        least = _OF_ITSELF * abs(float(fit.x[i]))
        told = [(words, _more_of(rows, part * weight, left, table, inverse)) for part, words in parts]
        other = [(words, more) for words, more in told if abs(more.value) > max(least, _SPREADS * more.std)]
        if other:
            words, more = max(other, key=lambda one: abs(one[1].value) / max(one[1].std, _NO_SLOPE))
            found[effect] = _shape(effect, drive.vocabulary.columns[i][1].name, words, more)
    return found


def _shape(effect: str, parameter: str, words: str, more: Coefficient) -> Shape:
    """By how much more, and where, a number of a sensor's effect is another one there."""
    if effect == _LATE:
        return Shape("wheel_speed_fl", f"later by k, all four, {words}", more._replace(unit="s"), 1.0)
    sensor, axes = _SHARES[effect]
    two = axes[parameter]
    return Shape(f"{sensor}_{two[0]}", f"k*{_COURSES[sensor][two[1]]} {words}", more, 1.0)


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


def _places(drive: Drive, rows: Rows) -> list[tuple[Bools, str]]:
    """Rows (k,) that are later than each quarter of them, and those in which the car is driven, or braked."""
    quarters = [len(rows.at) * k // 4 for k in (1, 2, 3)]
    later = [(np.arange(len(rows.at)) >= since, f"from {rows.at[since] * DT_S:.1f} s on") for since in quarters]
    speeds_up = filtered(np.gradient(np.mean(drive.wheels, axis=1), DT_S), filter_kernel())[rows.at]
    return [*later, (speeds_up > _SPEEDS_UP_MPS2, DRIVEN), (speeds_up < -_SPEEDS_UP_MPS2, BRAKED)]


def _where(rows: Rows, course: Floats, is_there: Bools) -> Floats:
    """What of a course (k, 13) is in some rows (k,)."""
    return np.where(rows.used & is_there[:, np.newaxis], course, 0.0)


def _slow_part(rows: Rows, course: Floats) -> Floats:
    """What of a course (k, 13) changes slowly; where nothing is compared it is nothing."""
    whole = np.zeros((int(rows.at[-1]) // EVERY + 1, course.shape[1]))
    whole[rows.at // EVERY] = np.where(rows.used, course, 0.0)
    for c in np.flatnonzero(whole.any(axis=0)):
        whole[:, c] = low_passed(np.ascontiguousarray(whole[:, c]), _SLOW)
    return whole[rows.at // EVERY]
