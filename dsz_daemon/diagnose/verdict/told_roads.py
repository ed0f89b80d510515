"""What is told of the road and the air: their course without what is an offset as well, and its rms with a spread."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.residuals.comparison import EVERY, Ints, Rows
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.road import Profiles, on_road
from dsz_daemon.diagnose.surroundings.gusts import power_above_n2
from dsz_daemon.diagnose.surroundings.unfelt_banks import is_unfelt
from dsz_daemon.diagnose.surroundings.unfelt_grades import climbs_unfelt, evenly_by
from dsz_daemon.diagnose.surroundings.winds import GUSTS, arm_m, by_the_lean, of_noise_n

_STIFFNESSES = tuple(INDEX[f"{axle}_cornering_stiffness_n_per_rad"] for axle in ("front", "rear"))
# A step to see by, in spreads: what is a square is not seen as one.
_STEP = 0.1
# Of each road its course, and whether nothing but an accelerometer feels it.
_EVENLY = {"road_bank": ("bank_rad", is_unfelt), "road_grade": ("grade_rad", climbs_unfelt)}
# A road's even tilt is told where it is known better than this, rad (and than by what any road's would be).
_EVENLY_RAD = 0.0026
# An interval of 95 %, in spreads; and where the spread is that of a dozen swings, told by these.
_SURELY, _OF_A_FEW = 1.96, 2.3
# Of a wind's power what the accelerometer's noise has in it is taken off, as far as that is known (its power to a
# fourth), and something stays.
_NOISE_UNSURE, _LEAST_OF_IT = 0.25, 0.3
# By how much the arm of a push comes out too long or too short, m: what a slow one turns a car by is both together.
# Of two simulators it was by 0.065 and 0.02 m, and a push within 0.1 m is taken to have that.
_ARM_M = 0.03
# And what it has in gusts that are too quick to be told may be half as much, or half as much again.
_ABOVE_UNSURE = 0.5


class _Rms(NamedTuple):
    """Of one profile: what its rms is called, what of it no model has to the letter, and what else makes it another."""

    name: str
    form: float
    beside: tuple[int, ...] = ()


# A wind is told by what tyres make of it, and those of a simulation by another author came out 15 % off at most
# (docs/decisions/0050); a road by a gyro's integral. What of it came true: docs/decisions/0083.
_RMS = {
    "road_bank": _Rms("rms_rad", 0.01),
    "road_grade": _Rms("rms_rad", 0.01),
    "side_wind": _Rms("rms_n", 0.07, _STIFFNESSES),
}


def driven_rows(rows: Rows) -> Ints:
    """Places of what is compared of any channel, on the recording's grid."""
    return np.unique(rows.at[rows.used.any(axis=1)])


def _all_rows(fit: Fit) -> Ints:
    """As many a second, standing included: a road is there, too, where nobody drives on it."""
    return np.arange(0, len(fit.road.bank_rad), EVERY, dtype=np.int64)


def told_road(drive: Drive, fit: Fit, causes: Collection[str]) -> tuple[Profiles, tuple[float, float]]:
    """The road of a model, and how much bank and grade (rad) were taken off it for being the same all the way.

    A road that tilts evenly is the same as an offset of its accelerometer: it is told as one, unless something else
    tells it, and the road is one of the `causes` that are said. A car that turns shows its turn to the roll and pitch
    gyros by as much as it is tilted, and one on a bank steers against it.
    """
    untold = _untold_evenly(drive, fit) | (_EVENLY.keys() - set(causes))
    road, (bank, grade) = _apart(_in_all(drive, fit, fit.road, fit.x), _all_rows(fit), untold)
    return road, (bank, grade - _by_the_turn(drive, fit, fit.x))


def _by_the_turn(drive: Drive, fit: Fit, x: Floats) -> float:
    """What a grade that no pitch gyro feels is all the way beyond its profile, rad: no accelerometer has that."""
    evenly = _climbs_by(drive, fit)
    return 0.0 if evenly is None else float(x[evenly])


def _climbs_by(drive: Drive, fit: Fit) -> int | None:
    """The column that tells how much such a grade climbs all the way; None without one, or if it is a leak's own."""
    return None if "gyro_cross_axis" in fit.effects else evenly_by(drive, fit.effects)


def _in_all(drive: Drive, fit: Fit, road: Profiles, x: Floats) -> Profiles:
    """The road with its corrections, and with what tells how much it climbs all the way."""
    there = on_road(road, x)
    return there._replace(grade_rad=there.grade_rad + _by_the_turn(drive, fit, x))


def _apart(road: Profiles, at: Ints, untold: Collection[str]) -> tuple[Profiles, tuple[float, float]]:
    bank = float(np.mean(road.bank_rad[at])) if "road_bank" in untold else 0.0
    grade = float(np.mean(road.grade_rad[at])) if "road_grade" in untold else 0.0
    return road._replace(bank_rad=road.bank_rad - bank, grade_rad=road.grade_rad - grade), (bank, grade)


def _untold_evenly(drive: Drive, fit: Fit) -> set[str]:
    """The roads of which the fit does not tell how much they tilt all the way, or no better than their swings do."""
    untold, at = set(_EVENLY), _all_rows(fit)
    for effect, (name, is_felt_by_none) in _EVENLY.items():
        # Where no gyro feels it, an accelerometer shows both, and at most another gyro the road.
        other = _climbs_by(drive, fit) if effect == "road_grade" else None
        if effect not in fit.effects or (is_felt_by_none(drive) and other is None):
            continue

        def evenly(x: Floats, road: Profiles, name: str = name) -> float:
            return float(np.mean(getattr(_in_all(drive, fit, road, x), name)[at]))

        course = getattr(on_road(fit.road, fit.x), name)[at]
        least = min(_EVENLY_RAD, float(np.std(course)) * math.sqrt(_as_one(course) / len(course)))
        columns = drive.vocabulary.columns_of(effect) if other is None else [other]
        if _spread(fit, columns, evenly) < least:
            untold.remove(effect)
    return untold


def _spread(fit: Fit, columns: Sequence[int], of: Callable[[Floats, Profiles], float]) -> float:
    """By how much something of the parameters and their road is uncertain, as these columns are (the delta method)."""
    places = [fit.columns.index(i) for i in columns if i in fit.columns]
    covariance, value = fit.covariance[np.ix_(places, places)], of(fit.x, fit.road)
    slopes, steps = np.zeros(len(places)), _STEP * np.sqrt(np.diag(covariance))
    for k in np.flatnonzero(steps):
        x = fit.x.copy()
        x[fit.columns[places[k]]] += steps[k]
        slopes[k] = (of(x, fit.felt(x)) - value) / steps[k]
    return math.sqrt(float(slopes @ covariance @ slopes))


def rms_told(drive: Drive, rows: Rows, fit: Fit, effect: str) -> dict[str, tuple[float, float | None]] | None:
    """What a profile's rms is called, with the rms and its spread (a wind's over what was driven); else None."""
    if effect not in _RMS:
        return None
    of, untold = _RMS[effect], _untold_evenly(drive, fit)
    at = driven_rows(rows) if effect == "side_wind" else _all_rows(fit)

    def course_of(x: Floats, road: Profiles) -> Floats:
        told = _apart(_in_all(drive, fit, road, x), at, untold)[0]
        return {"road_bank": told.bank_rad, "road_grade": told.grade_rad, "side_wind": told.side_n}[effect][at]

    def rms(x: Floats, road: Profiles) -> float:
        return float(np.sqrt(np.mean(course_of(x, road) ** 2)))

    value = rms(fit.x, fit.road)
    evenly = _climbs_by(drive, fit) if effect == "road_grade" else None
    more = of.beside if evenly is None else (*of.beside, evenly)
    std = math.hypot(_spread(fit, (*drive.vocabulary.columns_of(effect), *more), rms), of.form * value)
    if effect in untold:
        std = math.hypot(std, _evenly(course_of(fit.x, fit.road)))
    if effect == "side_wind" and not by_the_lean(fit.x):
        noise_n = of_noise_n(drive, fit.x, fit.road)
        noise, above = float(np.mean(noise_n[at] ** 2)), power_above_n2(fit.road.side_n, noise_n, GUSTS)
        less = math.sqrt(max(value**2 - noise, (_LEAST_OF_IT * value) ** 2))
        whole = math.hypot(less, math.sqrt(above))
        unsure = math.hypot(_NOISE_UNSURE * noise, _ABOVE_UNSURE * above) / (2.0 * whole)
        of_its_arm = whole * _ARM_M / arm_m(drive, fit.x)
        value, std = whole, math.hypot(std * whole / value, unsure, of_its_arm)
    return {of.name: (value, std)}


def _evenly(course: Floats) -> float:
    """How unsure the rms of a road is, as no drive tells by how much it tilts all the way, beside its course (n,).

    A road that goes up and down as this one does is level on average but for s / sqrt(n / c), c rows that tell as much
    as one. Its rms may be that of both.
    """
    rms = float(np.sqrt(np.mean(course**2)))
    return (math.hypot(rms, _OF_A_FEW * rms * math.sqrt(_as_one(course) / len(course))) - rms) / _SURELY


def _as_one(course: Floats) -> float:
    """How many rows of a road (n,) tell as much of its mean as one that is independent of the others."""
    apart = course - np.mean(course)
    return float(correlated_rows(apart[:, np.newaxis], np.ones((len(course), 1), dtype=np.bool_))[0])
