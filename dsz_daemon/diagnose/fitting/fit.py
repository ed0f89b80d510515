"""One model fitted to one drive: offsets, stiffnesses in their box, the parameters of the effects that are in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from dsz_daemon.diagnose.effects.nuisances import OFFSETS
from dsz_daemon.diagnose.effects.vocabulary import GUESSED, INDEX
from dsz_daemon.diagnose.fitting.descent import Place, Slope, descended
from dsz_daemon.diagnose.fitting.drawings import UNTOLD, told
from dsz_daemon.diagnose.fitting.judgement import form_of, judged_model
from dsz_daemon.diagnose.fitting.model import MOMENTS, OWN_CHANNEL, TILTS, Fit, Slopes, nuisances, room
from dsz_daemon.diagnose.fitting.mounts import LEANS, MOUNT, TURNED, untold_turns
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import Each, Rows, floors, sensitivities
from dsz_daemon.diagnose.residuals.evidence import Box
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.pulls import BY_FORCE
from dsz_daemon.diagnose.simulation.rolling import tells_engine_from_brakes
from dsz_daemon.diagnose.surroundings.profiles import Felt, undrawn
from dsz_daemon.diagnose.surroundings.smooth_roads import (
    bends,
    leans_on_a_bank,
)
from dsz_daemon.diagnose.surroundings.unfelt_banks import untold_beside
from dsz_daemon.diagnose.surroundings.unfelt_grades import evenly_by

# Of smaller road wheel angles a sine is the angle to a thousandth or two.
_FROM_RAD = {INDEX["large_angles"]: 0.1}
_SMALL_TURNS, _FLAT_LEANS, _FLAT_BENDS = (INDEX[name] for name in ("small_turns", "flat_leans", "flat_bends"))
# What a road's tilt turns into shows in the other gyro, and there as much more or less of it is that gyro's scale.
_SCALES_IT = "gyro_scale"
_ENGINE = INDEX["wheel_slip.engine_brakes_mps2"]
# Where it pushes is no course over time.
_OF_THE_WIND = ("ahead_m", "leans")
# Effects that are what may be a little off anyway, with more room.
_INSTEAD_OF = {
    effect: {INDEX[f"{effect}.{mine}"]: INDEX[other] for mine, other in pairs}
    for effect, pairs in {
        "cornering_stiffness": [
            (f"{axle}_scale", f"{axle}_cornering_stiffness_n_per_rad") for axle in ("front", "rear")
        ],
        "track_width": [("front", "front_track_m"), ("rear", "rear_track_m")],
        "yaw_inertia": [("share", "yaw_inertia_kgm2")],
        "steering_delay": [("delay_s", "steering_skew_s")],
        # In a body that leans both feel the same swing.
        "imu_lever_arm": [("z_m", "suspension_roll.above_m")],
    }.items()
}
# What one wheel has, and not all of them: once it is told of some the others have none.
ONE_BY_ONE = frozenset({"wheel_square"})


def fitted(
    drive: Drive,
    rows: Rows,
    start: Floats,
    effects: tuple[str, ...],
    tolerance: Mapping[str, float],
    settled: float = 1e-3,
    each: Each = map,
    known: Slopes | None = None,
    felt: Felt | None = None,
    is_hopeless: Callable[[Fit], bool] | None = None,
) -> Fit:
    """Gauss-Newton in the box, over offsets, stiffnesses and the effects' parameters.

    Until a step takes no more than this share off what is left. What candidates are compared with has to be settled
    better than these: else they gain what it has left undone. With slopes that are `known` where it starts, the fit is
    judged by those of its last step: `exactly` does so by its own. `felt`: the road of the model that it starts from;
    where it has more of a road, or less, that is felt from the start on. What `is_hopeless` after some rounds is left
    there.
    """
    words = drive.vocabulary
    hidden = {one for effect in effects for one in _INSTEAD_OF.get(effect, {}).values()}
    hidden |= {i for i, least_rad in _FROM_RAD.items() if float(np.max(np.abs(drive.steer))) < least_rad}
    hidden |= (set() if TURNED & set(effects) else {_SMALL_TURNS}) | undrawn(effects)
    hidden |= set() if LEANS & set(effects) else {_FLAT_LEANS}
    profiles = set(effects) & set(OWN_CHANNEL)
    tilts_anew = bool(profiles & TILTS) and (felt is None or felt.profiles & TILTS != profiles & TILTS)
    hidden |= {_FLAT_BENDS} if _SCALES_IT in effects and not tilts_anew else set()
    hidden |= {BY_FORCE} if start[BY_FORCE] == 0.0 else set()
    hidden |= told(start) | (set() if tells_engine_from_brakes(drive.wheels) else {_ENGINE})
    first = [i for i in nuisances(tolerance) if i not in hidden]
    # A guessed effect's parameter that nothing was guessed of is not there; but what begins may do so at 0.
    there = {i for i, column in enumerate(words.columns) if start[i] != 0.0 or column in MOMENTS}
    untold = (untold_turns(drive, effects) if MOUNT in effects else set()) | untold_beside(drive)
    few = {*GUESSED, *(e for e in ONE_BY_ONE if there.intersection(words.columns_of(e)))}
    own = (i for e in effects for i in words.columns_of(e) if (i in there or e not in few) and i not in untold | hidden)
    evenly = evenly_by(drive, effects)
    columns = tuple(dict.fromkeys((*first, *own, *([] if evenly is None else [evenly]))))
    sizes = np.array([math.inf if i in range(len(OFFSETS)) else words.columns[i][1].step for i in columns])
    x = start.copy()
    moments = [i for i, column in enumerate(words.columns) if column in MOMENTS]
    x[moments] = np.minimum(x[moments], len(drive.steer) * DT_S)
    x[[*undrawn(effects)]] = 0.0
    if tilts_anew:
        # A road that begins at either way to draw it may not find the other one.
        x[_FLAT_BENDS] = UNTOLD
    for effect in effects:
        # Beyond what may be off anyway it has one name, not two.
        for mine, other in _INSTEAD_OF.get(effect, {}).items():
            x[mine], x[other] = x[mine] + x[other], 0.0
    if felt is not None and profiles - felt.profiles == {"side_wind"} and felt.profiles < profiles:
        felt = felt.blown(x, effects)
    if felt is None or felt.profiles != profiles:
        for profile in OWN_CHANNEL:
            x[[i for i in words.columns_of(profile) if words.columns[i][1].name not in _OF_THE_WIND]] = 0.0
        felt = Felt(drive, x, effects)

    def taken(here: Place) -> Floats:
        return sensitivities(drive, rows, here.x, here.road, here.base, columns, here.felt, each)

    def judged(here: Place, slopes: Floats) -> Fit:
        return judged_model(drive, rows, tolerance, here, Slopes(here.x, effects, columns, slopes))

    def box(x: Floats) -> Box:
        return room(drive, x, columns, tolerance)

    asked = None if is_hopeless is None else lambda here, slopes: is_hopeless(judged(here, slopes))
    floor = _floors(drive, rows, x, effects, felt)
    slope = Slope(drive, rows, floor, columns, sizes, taken, box, leans_on_a_bank(effects), moments)
    here, given = slope.place(x, felt), None if known is None else known.of(x, effects, columns)
    here, learnt = descended(slope, here, given, settled, roughly=given is not None, is_hopeless=asked)
    if known is None and not learnt.is_exact:
        learnt = slope.learnt(here)
    return judged(here, learnt.slopes)._replace(is_exact=learnt.is_exact)


def _floors(drive: Drive, rows: Rows, x: Floats, effects: tuple[str, ...], felt: Felt) -> Floats:
    """What white noise leaves (13,); and where a lean is told from its bank, what the simulation's form does.

    What either shows that the other does not is less than that.
    """
    found = floors(drive)
    if leans_on_a_bank(effects):
        found = np.hypot(found, form_of(drive, rows, x, effects, predicted(drive, x, felt(x))))
    return found


def exactly(drive: Drive, rows: Rows, fit: Fit, tolerance: Mapping[str, float], each: Each = map) -> Fit:
    """A fit judged by the slopes that it has at its end."""
    if fit.is_exact:
        return fit
    base = predicted(drive, fit.x, fit.road)
    slopes = sensitivities(drive, rows, fit.x, fit.road, base, fit.columns, fit.felt, each)
    bent = bends(drive, fit.road, fit.x) if leans_on_a_bank(fit.effects) else np.zeros(0)
    here = Place(fit.x, fit.felt, fit.road, base, fit.left, fit.scatter, bent)
    return judged_model(drive, rows, tolerance, here, Slopes(fit.x, fit.effects, fit.columns, slopes))
