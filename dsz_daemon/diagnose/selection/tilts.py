"""A road that tilts, told from what tilts on it: a body, or a bracket, does so with no road below.

Both turn the IMU, and gravity comes in. But a car follows its road: where that climbs more and more the car is lifted,
-q v is in a_z; and on a bank it is pushed aside by what its tyres then hold, and turns by it. A body that is pitched by
its springs, or by air, goes straight on.
"""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.fitting.shown_by import shown_by
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel, filtered
from dsz_daemon.diagnose.residuals.comparison import SLOW_MPS, Rows
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.prediction import Ints
from dsz_daemon.diagnose.simulation.road import on_road
from dsz_daemon.diagnose.surroundings.winds import folds_of, told_by

# By what a road moves the car itself: a_z, and the yaw rate; and where its gravity is.
_LIFTED = 5
_MOVED, _PITCH_RATE, _YAW_RATE, _PULLED = (
    {"road_grade": _LIFTED, "road_bank": 2},
    1,
    2,
    {"road_grade": 3, "road_bank": 4},
)
# A tilt by itself: so much of its power is no course of what the car does, now or some seconds before, on a fifth of
# the way that the course has not seen; and so often it goes from far on one side, in parts of its rms, to far on the
# other. What follows a car had 0.02 at most, of three roads one 0.58, of which 0.85 was told where all of it was seen.
_BY_ITSELF, _PARTS, _LAGS_S, _FAR, _SWINGS, _FEWEST = 0.5, 5, (4.0, 15.0), 0.7, 3, 30
# There and back is enough where what the car does tells next to nothing of it (a motorway's hills: 0.09).
_HARDLY, _BACK = 0.2, 2
# Nor is it a body's that goes so far, and turns so often by more than so much of it, if what the car does leaves so
# much of it: at a steady speed none is tipped by its air, springs or load by 3 degrees, and back.
_NO_BODY_RAD, _A_TENTH, _OF_THE_RANGE = 0.06, 0.1, 0.15
_FLAT_ROADS, _FLAT_BENDS = INDEX["flat_roads"], INDEX["flat_bends"]
# A profile has its gyro's noise, of whose rate means over so long have little: no more than so much of all.
_OVER_S, _OF_NOISE = 2.0, 0.5
# Of what a road does less than half is none of it, by so many spreads; more than that the other way is something else
# that happens to look alike. What is left may last, but not for ever.
_HALF, _SURELY, _MOST = 0.5, 2.0, 0.9
# What tips at once from one side to the other: so often further than half of all its range, within so long, and so much
# of all its way in a tenth of the time. Of 41 roads of eight simulators none did so more than twice, or had 0.38 of it;
# two brackets that tip had 9 and 21, 0.74 and 0.91.
_AT_ONCE_S, _TIPS, _TENTH, _OF_ITS_WAY = 0.5, 5, 0.1, 0.6
# And what goes so much of its way while the car stands: eleven roads of three simulators went 0.04 of it at most then,
# a body that passengers rock at stops 0.91.
_STANDS_MPS, _STANDING = 0.3, 0.5
# What changes once: so much of all its power is two levels, and so much of the step within so long a way.
_ONCE, _LEAPS, _A_LENGTH_M = 0.9, 0.7, 5.0
# A bank knows nothing of drive and brakes, nor a grade of bends: of its power what they tell of it, now or so much
# before, on unseen blocks. Of 28 banks none had more than 0.12, but for one of these tests', which swings nearly as the
# car speeds up (0.82), a body that rolls by its engine's torque 0.99, and 0.93 where that hardly shows; of eight grades
# none had more than 0.06, a body that swing axles lift in bends 0.97.
_OF_THE_DRIVE, _DRIVEN_S = {"road_bank": 0.92, "road_grade": 0.95}, (0.0, 0.25, 0.5)


def tips_only_what_stands_on_it(drive: Drive, rows: Rows, fit: Fit, effect: str) -> bool:
    """Whether what this road would do to the car itself is surely not there: less than half of it, either way.

    That share is one number: by least squares on means, with a spread by what each then leaves, and for how long. Of
    a grade's rate some is the pitch gyro's noise, which lifts no car: without that the share would come out too small
    (errors in variables).
    """
    c = _MOVED[effect]
    used = rows.used[:, c]
    if not used.any():
        return False
    moved, as_drawn = (shown_by(drive, one, effect)[rows.at[used], c] for one in (_lifted(fit), fit))
    weight, at = fit.scatter[rows.block[used], c] ** -2.0, (rows.at[used] * DT_S // _OVER_S).astype(np.int64)
    weights = np.bincount(at, weight)
    there = weights > 0.0
    of_road, left = (
        np.bincount(at, weight * values)[there] / weights[there]
        for values in (moved, fit.left[used, c] + as_drawn - moved)
    )
    weights = weights[there]
    of_road -= np.average(of_road, weights=weights)
    power = float(np.sum(weights * of_road**2))
    lifted_mps2 = _lifted_by_noise_mps2(drive, rows.at[used], at)[there]
    noise = float(np.sum(weights * lifted_mps2**2)) if effect == "road_grade" else 0.0
    if noise >= _OF_NOISE * power:
        return False
    beyond = float(np.sum(weights * of_road * left)) / power
    rest = left - np.average(left, weights=weights) - beyond * of_road
    lasts = float(np.clip(np.sum(rest[1:] * rest[:-1]) / max(float(np.sum(rest**2)), 1e-30), 0.0, _MOST))
    std = math.sqrt(float(np.sum((weights * of_road * rest) ** 2)) * (1.0 + lasts) / (1.0 - lasts)) / power
    return (abs(1.0 + beyond) + _SURELY * std) * power / (power - noise) < _HALF


def is_a_tilt_alone(drive: Drive, rows: Rows, fit: Fit) -> bool:
    """Whether a climb that lifts no car may be a road all the same: one that is drawn as a tilt alone.

    Some draw it so that a_z shows what speeds the car up, as a body's does that goes there and back.
    """
    return goes_to_and_fro(drive, fit) and (
        not shows_the_drive(drive, rows, fit) or goes_to_and_fro(drive, fit, more=True)
    )


def shows_the_drive(drive: Drive, rows: Rows, fit: Fit) -> bool:
    """Whether a_z has the share of the car's own acceleration that a pitched body has, and one on a climb has not.

    On a road the car speeds up along what it stands on. An IMU in a body that is pitched against its way by theta feels
    -theta v' in a_z: by least squares surely more than half of that.
    """
    used = rows.used[:, _LIFTED]
    if not used.any():
        return False
    tilt_rad = _tilt_rad(fit, "road_grade")
    pull_mps2 = filtered(np.gradient(np.mean(drive.wheels, axis=1), DT_S), filter_kernel())
    pitched_mps2 = ((np.mean(tilt_rad) - tilt_rad) * pull_mps2)[rows.at[used]]
    left = fit.left[used, _LIFTED]
    power = float(np.sum(pitched_mps2**2))
    share = float(np.sum(pitched_mps2 * left)) / max(power, 1e-30)
    rest = left - share * pitched_mps2
    lasts = float(np.clip(np.sum(rest[1:] * rest[:-1]) / max(float(np.sum(rest**2)), 1e-30), 0.0, _MOST))
    std = math.sqrt(float(np.sum((pitched_mps2 * rest) ** 2)) * (1.0 + lasts) / (1.0 - lasts)) / max(power, 1e-30)
    return share - _SURELY * std > _HALF


def is_the_bodys(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether a tilt comes and goes as a body's does, or a bracket's, and no road's."""
    by_itself = tips_at_once(drive, fit, effect) or tips_once(drive, fit, effect) or tips_standing(drive, fit, effect)
    return by_itself or follows_the_drive(drive, fit, effect)


def tips_at_once(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether a tilt is from one side to the other at once, time and again, and else stays: a bracket that is loose."""
    course, every = _tilt_rad(fit, effect), round(_AT_ONCE_S / DT_S)
    rolls = (np.mean(drive.wheels, axis=1) > SLOW_MPS)[::every]
    if np.count_nonzero(rolls) < _FEWEST:
        return False
    low_rad, high_rad = np.quantile(course[::every][rolls], [0.02, 0.98]).tolist()
    steps_rad = np.sort(np.abs(np.diff(course[::every]))[rolls[1:]])
    tips = np.count_nonzero(steps_rad > _HALF * (high_rad - low_rad))
    furthest = steps_rad[-math.ceil(_TENTH * len(steps_rad)) :]
    return bool(tips >= _TIPS and np.sum(furthest) > _OF_ITS_WAY * np.sum(steps_rad))


def tips_standing(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether a tilt goes most of its way while the car stands: a body that rocks, for a road stays as it is."""
    way_rad = np.abs(np.diff(_tilt_rad(fit, effect)))
    stands = np.mean(drive.wheels, axis=1)[1:] < _STANDS_MPS
    return bool(np.sum(way_rad[stands]) > _STANDING * np.sum(way_rad))


def tips_once(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether a tilt changes once, within a car's length, and stays as it is then: who got in, or what was loaded.

    A road is another a few metres on; and one that leans for good from here on is no road that a car turns about on.
    """
    every = round(_AT_ONCE_S / DT_S)
    v_mps = np.mean(drive.wheels, axis=1)
    tilt, way_m = _tilt_rad(fit, effect)[::every], (np.cumsum(v_mps) * DT_S)[::every]
    n = len(tilt)
    count = np.arange(1, n)
    total = np.cumsum(tilt)
    before, after = total[:-1] / count, (total[-1] - total[:-1]) / (n - count)
    between = count * (n - count) / n * (after - before) ** 2
    at = int(np.argmax(between))
    step_rad = float(after[at] - before[at])
    first, last = np.searchsorted(way_m, way_m[at] + np.array([-_A_LENGTH_M, _A_LENGTH_M]))
    leaps = (tilt[min(int(last), n - 1)] - tilt[max(int(first) - 1, 0)]) / step_rad if step_rad else 0.0
    return bool(between[at] > _ONCE * np.sum((tilt - np.mean(tilt)) ** 2) and leaps > _LEAPS)


def follows_the_drive(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether most of a bank is what drive or brakes tell, or of a grade what bends tell, to either side alike.

    A body that rolls by its engine's torque does the one, one that axles lift in bends the other.
    """
    every = round(_AT_ONCE_S / DT_S)
    v_mps = np.mean(drive.wheels, axis=1)
    rolling = np.flatnonzero(v_mps > SLOW_MPS)
    rolling = rolling[rolling % every == 0]
    if len(rolling) < _FEWEST:
        return False
    if effect == "road_bank":
        does = np.gradient(v_mps, DT_S)
        courses = [np.maximum(does, 0.0), np.minimum(does, 0.0)]
    else:
        does = v_mps * np.nan_to_num(drive.measured[:, _YAW_RATE])
        courses = [does**2, np.abs(does), does]
    smooth = [filtered(course, filter_kernel()) for course in courses]
    before = [np.maximum(rolling - round(late_s / DT_S), 0) for late_s in _DRIVEN_S]
    table = np.column_stack([course[at] for at in before for course in smooth])
    return told_by(table, _tilt_rad(fit, effect)[rolling], folds_of(rolling)) > _OF_THE_DRIVE[effect]


def _tilt_rad(fit: Fit, effect: str) -> Floats:
    road = on_road(fit.road, fit.x)
    return road.bank_rad if effect == "road_bank" else road.grade_rad


def goes_to_and_fro(drive: Drive, fit: Fit, more: bool = False) -> bool:
    """Whether a climb comes and goes time and again, and not with what the car does: no springs or air do that.

    Some draw a road as a tilt alone, which lifts no car. What levels a body, or tips it, follows the speed, or what
    changes it, soon or after a while; or does so once. `more`: there and back is not enough.
    """
    tilt_rad = on_road(fit.road, fit.x).grade_rad
    at = np.arange(len(tilt_rad)) * DT_S // _OVER_S
    count = np.bincount(at.astype(np.int64))
    tilt, v_mps = (np.bincount(at.astype(np.int64), one) / count for one in (tilt_rad, np.mean(drive.wheels, axis=1)))
    pull_mps2 = np.gradient(v_mps, _OVER_S)
    lagged = [_lagged(one, lag_s / _OVER_S) for one in (v_mps, pull_mps2) for lag_s in _LAGS_S]
    does = np.column_stack([np.arange(len(tilt)), v_mps, v_mps**2, pull_mps2, *lagged])
    there = v_mps > SLOW_MPS
    if np.count_nonzero(there) < _FEWEST:
        return False
    tilt = tilt[there] - np.mean(tilt[there])
    told = told_by(does[there], tilt, np.arange(len(tilt)) * _PARTS // len(tilt))
    rms = float(np.sqrt(np.mean(tilt**2)))
    far = np.sign(tilt[np.abs(tilt) > _FAR * rms])
    swings = _SWINGS if more or told > _HARDLY else _BACK
    if 1.0 - told > _BY_ITSELF and np.count_nonzero(np.diff(far)) >= swings:
        return True
    low_rad, high_rad = np.quantile(tilt, [0.02, 0.98]).tolist()
    is_far = high_rad - low_rad > _NO_BODY_RAD and 1.0 - told > _A_TENTH
    return is_far and _turns(tilt, _OF_THE_RANGE * (high_rad - low_rad)) >= _SWINGS


def _turns(course: Floats, least: float) -> int:
    """How often a course (n,) that went up goes down again by so much at least, or the other way."""
    turns, up = 0, 0
    high = low = float(course[0])
    for value in course.tolist():
        high, low = max(high, value), min(low, value)
        if up >= 0 and high - value >= least:
            turns, up, low = turns + up, -1, value
        elif up <= 0 and value - low >= least:
            turns, up, high = turns - up, 1, value
    return turns


def _lagged(values: Floats, lag_rows: float) -> Floats:
    """The values (n,) by a first order so many rows behind them."""
    share = -math.expm1(-1.0 / lag_rows)
    found, at = np.empty(len(values)), values[0]
    for i, value in enumerate(values.tolist()):
        at += share * (value - at)
        found[i] = at
    return found


def _lifted(fit: Fit) -> Fit:
    """The same on roads that a car follows."""
    x = fit.x.copy()
    x[_FLAT_ROADS] = x[_FLAT_BENDS] = 0.0
    return fit._replace(x=x)


def pulls_nothing(drive: Drive, rows: Rows, fit: Fit, effect: str) -> bool:
    """Whether the accelerometer along or across is no better with this road than it would be without it.

    What its gyro feels is no road then: gravity would be there.
    """
    c = _PULLED[effect]
    used = rows.used[:, c]
    if not used.any():
        return False
    left = fit.left[used, c]
    without = left + shown_by(drive, fit, effect)[rows.at[used], c]
    return bool(np.std(left) >= np.std(without))


def _lifted_by_noise_mps2(drive: Drive, rows: Ints, at: Ints) -> Floats:
    """By what means `at` (k,) these rows (k,) the noise of the pitch gyro seems to lift the car, rms."""
    low_pass = math.sqrt(float(np.sum(filter_kernel() ** 2)))
    per_row_radps = float(np.nan_to_num(drive.recording.floor[_PITCH_RATE])) / low_pass
    v_mps = np.bincount(at, np.mean(drive.wheels, axis=1)[rows]) / np.maximum(np.bincount(at), 1)
    return np.asarray(v_mps * per_row_radps * math.sqrt(DT_S / _OVER_S))
