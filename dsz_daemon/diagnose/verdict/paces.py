"""Whether a sensor's number is the same for what changes slowly and for what changes quickly: a scale is."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.recordings.recording import filter_kernel
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
SLOWLY = "where that changes slowly"
# What a Gaussian of this width leaves is slow, as compared rows come.
_SLOW = filter_kernel(4.0 / EVERY)
# Slow motion shows another number by so much of it, and by so many spreads of what hangs together: of 62 right ones of
# four simulators by other authors those that were told by 1.5 spreads or more were off by 0.12 of themselves at most;
# an accelerometer behind a filter that takes what lasts for a tilt was by 1.2 of itself, and seven spreads. Set with
# these in view.
_OF_ITSELF, _SPREADS = 0.5, 3.0
_NO_SLOPE = 1e-12


def differs_by_pace(drive: Drive, rows: Rows, fit: Fit, each: Each = map) -> dict[str, Shape]:
    """The sensors' effects whose best told number is another one for slow motion, by a good part of itself, and that.

    What is left has nothing more of the whole course of a number in it, or it would be fitted; but it may have more of
    its slow part, and as much less of the rest. What other parameters of the model do is taken off that part first.
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
        slow = _slow_part(rows, slopes[:, :, fit.columns.index(i)]) * weight
        slow -= (table @ (inverse @ (table.T @ slow.ravel()))).reshape(slow.shape)
        power = np.sum(slow**2, axis=0)
        more = float(np.sum(slow * left)) / max(float(np.sum(power)), _NO_SLOPE)
        # As often as the noise of what neither has hangs together: what is left has the difference in it.
        rest = left - more * slow
        square = np.sum(rest**2, axis=0) / np.maximum(np.sum(rows.used, axis=0), 1)
        per_row = correlated_rows(rest, rows.used)
        std = math.sqrt(float(np.sum(power * square * per_row))) / max(float(np.sum(power)), _NO_SLOPE)
        if abs(more) > max(_OF_ITSELF * abs(float(fit.x[i])), _SPREADS * std):
            sensor, axes = _SHARES[effect]
            two = axes[drive.vocabulary.columns[i][1].name]
            told = Coefficient(more, std, "1")
            found[effect] = Shape(f"{sensor}_{two[0]}", f"k*{_COURSES[sensor][two[1]]} {SLOWLY}", told, 1.0)
    return found


def _slow_part(rows: Rows, course: Floats) -> Floats:
    """What of a course (k, 13) changes slowly; where nothing is compared it is nothing."""
    whole = np.zeros((int(rows.at[-1]) // EVERY + 1, course.shape[1]))
    whole[rows.at // EVERY] = np.where(rows.used, course, 0.0)
    for c in np.flatnonzero(whole.any(axis=0)):
        whole[:, c] = low_passed(np.ascontiguousarray(whole[:, c]), _SLOW)
    return whole[rows.at // EVERY]
