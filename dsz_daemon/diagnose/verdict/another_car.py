"""Whether a configuration is another car's: many of its numbers off at once are one mistake, and no physics.

Ratio, tracks, axles, stiffness and inertia that are all another car's are told one name at a time by a search for
causes, and what is left is told as sensors that are as much too weak. With all numbers free at once they need no names.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dsz_daemon.diagnose.effects.shape_names import is_of_the_car
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import far_off, gained
from dsz_daemon.diagnose.fitting.model import OWN_CHANNEL, SAME_TURN, Fit
from dsz_daemon.diagnose.fitting.without import slopes_at, surely_without, without
from dsz_daemon.diagnose.residuals.comparison import Each
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.selection.search import Progress, Search, searched
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive
from dsz_daemon.diagnose.verdict.configured import parameter_errors

# Effects that are numbers of a car; and where an IMU is counts from the C.G. that is configured.
NUMBERS = frozenset({"steering_ratio", "track_width", "yaw_inertia"}) | SAME_TURN
_PLACE = "imu_lever_arm"
_ODD = frozenset({"locked_axle", "soft_mount"})
# How far apart two cars are, as shares. Forces and inertia count by the mass, which no drive tells: it stays.
ROOM = {
    "front_cornering_stiffness_n_per_rad": 0.6,
    "rear_cornering_stiffness_n_per_rad": 0.6,
    "yaw_inertia_kgm2": 0.6,
    "cg_to_front_axle_m": 0.5,
    "cg_to_rear_axle_m": 0.5,
    "steering_ratio": 0.5,
    "front_track_m": 0.3,
    "rear_track_m": 0.3,
}
_OF_WHEELS = tuple(CHANNELS.index(f"wheel_{which}") for which in ("other_left", "other_right", "difference"))
_TRACKS = frozenset({"front_track_m", "rear_track_m"})
# Numbers that take no name's place have to gain so much of what names did.
_SHARE = 0.05
# In log likelihood, by a model's own spreads: what is there by so much does not gain nothing when it is fitted without.
_SURELY = 20.0 * LEAST_GAIN


def with_own_numbers(
    drive: Drive, found: Search, tolerance: Mapping[str, float], say: Progress | None = None, each: Each = map
) -> tuple[Search, float]:
    """The search anew with all numbers of the car free, and what these gain in it; else `found`, and 0.

    They are free where names leave much that numbers explain, or where one that is no number gains nothing beside them.
    `nominal` stays that of what is configured.
    """
    names = set(found.best.effects)
    if len(names) < 2 or not names & NUMBERS:
        return found, 0.0
    room = {name: max(most, tolerance.get(name, 0.0)) for name, most in ROOM.items()}

    beside = names - NUMBERS
    with_names = without(found.drive, found.rows, found.best, room, names & NUMBERS, each)
    gain = gained(found.drive, found.best, with_names)
    known = slopes_at(found.drive, found.rows, with_names, each)

    def worth(rest: Fit) -> float:
        return gained(found.drive, rest, with_names)

    def is_idle(name: str) -> bool:
        return worth(surely_without(found.drive, found.rows, with_names, room, name, known, worth)) < 0.0

    enough = max(LEAST_GAIN, _SHARE * sum(found.gains.values()))
    may_be_idle = sorted(name for name in beside - {_PLACE} if not _is_surely_there(found.drive, with_names, name))
    if gain < enough and not any(each(is_idle, may_be_idle)):
        return found, 0.0
    if say is not None:
        say("all numbers of the car at once explain more than names do")
    anew = searched(drive, found.rows, {**tolerance, **room}, say, each)
    # Wheels roll as any car's do, and numbers turn any car: where one doesn't, something else is wrong than numbers.
    # And an IMU that swings on its mount swings in its own way, of which numbers of the car take what is left.
    is_odd = any(map(is_of_the_car, anew.best.effects)) or bool(_ODD & set(anew.best.effects))
    if is_odd or far_off(anew.drive, anew.best)[list(_OF_WHEELS)].any():
        return found, 0.0
    # Of a ratio and of axles that come to the same on a drive none is told: then names say more.
    # Nor is it where one track is all that is off, and a differential that holds an axle's wheels says the same.
    errors = parameter_errors(anew, each)
    off = {e.parameter for e in errors if abs(e.fitted / e.configured - 1.0) > tolerance.get(e.parameter, 0.0)}
    if not off or ("locked_axle" in names and off <= _TRACKS):
        return found, 0.0
    start = anew.best.x.copy()
    start[[INDEX[name] for name in room]] = 0.0
    held = fitted(anew.drive, anew.rows, start, anew.best.effects, tolerance, each=each, felt=anew.best.felt)
    # What of a shape is in the vocabulary of another search is no column of this one.
    built_in = len(drive.vocabulary.columns)
    nominal = np.zeros(len(anew.nominal.x))
    nominal[:built_in] = found.nominal.x[:built_in]
    return anew._replace(nominal=found.nominal._replace(x=nominal)), gained(anew.drive, held, anew.best)


def _is_surely_there(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether the effect's parameters are nothing but 0 by far, all else free; of a road or a wind nobody asks."""
    places = [fit.columns.index(i) for i in drive.vocabulary.columns_of(effect) if i in fit.columns]
    if effect in OWN_CHANNEL or not places:
        return False
    values, covariance = fit.x[[fit.columns[place] for place in places]], fit.covariance[np.ix_(places, places)]
    return bool(0.5 * values @ np.linalg.lstsq(covariance, values, rcond=None)[0] > _SURELY)
