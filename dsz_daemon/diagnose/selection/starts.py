"""Where the real fits of candidates begin: at the model so far, at a guess, or with a wind that has been felt."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.drawings import UNTOLD
from dsz_daemon.diagnose.fitting.gains import far_off
from dsz_daemon.diagnose.fitting.model import OWN_CHANNEL, SAME_TURN, Fit
from dsz_daemon.diagnose.fitting.mounts import LEANS
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import Each, Rows
from dsz_daemon.diagnose.selection.guesses import PLAY, guesses
from dsz_daemon.diagnose.selection.plausible import is_told
from dsz_daemon.diagnose.selection.screening import feels
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.instruments import drifted_s
from dsz_daemon.diagnose.simulation.loads import LOAD
from dsz_daemon.diagnose.simulation.pulls import PULLS
from dsz_daemon.diagnose.surroundings.profiles import wind_ahead_m
from dsz_daemon.signals import IMU_CHANNELS

# Effects that are fitted besides, and from where on.
Start = tuple[tuple[str, ...], Floats]

# The most promising; the others' turn may come.
_TRIED = 7
# What a road takes along, and where to begin with it: rad per m/s2, as passenger cars have it.
_LEANS_WITH, _SOME_LEAN = {"road_bank": "suspension_roll", "road_grade": "suspension_pitch"}, 0.008
# What an accelerometer shows more of a body that leans; and how that is drawn.
_SHOWS_MORE, _FLAT_LEANS = "accel_scale", INDEX["flat_leans"]

# Some load, and as much of it turns as has to.
_SOME_LOAD, _OF_A_LOAD = 0.05, (INDEX[f"{LOAD}.added_mass_kg"], INDEX[f"{LOAD}.turns"])

# Wheels that slip a little: of others nothing tells how brakes, drive and what resists share what slips.
_SLIP, _SOME_SLIP = "wheel_slip", 0.02
_WHEELS = slice(6, 8)

# A sensor that warms up does so within half a minute to some minutes.
_FADES_PER_S = (-0.01, 0.008, 0.015, 0.03, 0.06)
_DRIFT = "bias_drift"
_RATES, _FADES = tuple(INDEX[f"{_DRIFT}.{channel}"] for channel in IMU_CHANNELS), INDEX[f"{_DRIFT}.fades_per_s"]
_LEAST_ROWS, _EXACT = 300, 1e-6


def starts_of(drive: Drive, rows: Rows, best: Fit, names: Sequence[str], each: Each = map) -> list[Start]:
    """What is worth a real fit, and from where: the best of a screening, profiles that can be felt, guesses."""
    # Where no drive tells one of those that turn a car alike, it tells no other of them beside it.
    if any(not is_told(drive, best, effect) for effect in SAME_TURN.intersection(best.effects)):
        names = [name for name in names if name not in SAME_TURN]
    roads = [name for name in OWN_CHANNEL if name not in best.effects and feels(drive, rows, best, name)]
    # What takes longest comes first, guesses and roads: several may be fitted side by side.
    starts: list[Start] = [((effect,), best.x) for effect in (*roads, *names[:_TRIED])]
    if "side_wind" in roads:
        starts = [*_winds(drive, best, each), *(start for start in starts if start[0] != ("side_wind",))]
    # The road that a gyro has felt has the body's lean in it: by one linear step none is left.
    for road, effect in _LEANS_WITH.items():
        if road in best.effects and effect not in best.effects:
            leaning = best.x.copy()
            leaning[drive.vocabulary.columns_of(effect)[0]] = _SOME_LEAN
            starts = [*(start for start in starts if start[0] != (effect,)), ((effect,), leaning)]
    # A body that stays as it leans shows the pitch gyro no turn: by one linear step, which has it turn, none leans.
    if _SHOWS_MORE in names[:_TRIED]:
        for effect in sorted(LEANS.difference(best.effects, names[:_TRIED])):
            leaning = best.x.copy()
            leaning[[drive.vocabulary.columns_of(effect)[0], _FLAT_LEANS]] = _SOME_LEAN, UNTOLD
            starts.append(((effect,), leaning))
    if _DRIFT in names[:_TRIED]:
        starts = [(new, _drifting(rows, best) if new == (_DRIFT,) else x) for new, x in starts]
    if LOAD in names[:_TRIED]:
        # Of nothing on board nothing turns: by one linear step no load does.
        turning = best.x.copy()
        turning[list(_OF_A_LOAD)] = _SOME_LOAD * drive.car.mass_kg, 1.0
        starts.append(((LOAD,), turning))
    # What a car rolls at is behind its wheels by a low-pass: by one linear step slip jumps where its force does.
    are_off = _SLIP not in best.effects and bool(far_off(drive, best)[_WHEELS].any())
    if _SLIP in names[:_TRIED] or are_off:
        slipping = best.x.copy()
        slipping[INDEX[f"{_SLIP}.slip_per_force"]] = _SOME_SLIP
        starts = [*(start for start in starts if start[0] != (_SLIP,)), ((_SLIP,), slipping)]
    found = guesses(drive, rows, best, each)
    guessed: list[Start] = [((effect,), x) for effect, x in found if effect not in best.effects]
    # Play is guessed one way, and begins the other way as well.
    known = {effects for effects, _ in guessed} - {(PLAY,)}
    return [*guessed, *(start for start in starts if start[0] not in known)]


def beside_a_wind(rows: Rows, best: Fit, x: Floats, other: str) -> Floats:
    """Where to begin with a wind (at `x`) and another effect: one is felt of what an accelerometer drifts by, too."""
    if other != _DRIFT:
        return x
    x = x.copy()
    x[list(_RATES)] += _drift(rows, best, 0.0)[1]
    return x


def _drifting(rows: Rows, best: Fit) -> Floats:
    """The model so far with a drift that fades as what is left tells; without one where that is an even one."""
    found = {fades_per_s: _drift(rows, best, fades_per_s) for fades_per_s in (0.0, *_FADES_PER_S)}
    fades_per_s = max(found, key=lambda one: found[one][0])
    x = best.x.copy()
    if fades_per_s != 0.0:
        x[_FADES] = fades_per_s
        x[list(_RATES)] += found[fades_per_s][1]
    return x


def _drift(rows: Rows, best: Fit, fades_per_s: float) -> tuple[float, Floats]:
    """What a drift of all of the IMU's offsets takes off what is left, in log likelihood, and its rates (6,)."""
    whole_s = DT_S * (float(rows.at[-1]) + 1.0)
    course = np.array([drifted_s(DT_S * at, whole_s, fades_per_s) for at in rows.at.tolist()])
    rates, gained = np.zeros(len(_RATES)), 0.0
    for c in range(len(_RATES)):
        used = rows.used[:, c]
        if np.count_nonzero(used) < _LEAST_ROWS:
            continue
        left, mine = best.left[used, c] - np.mean(best.left[used, c]), course[used] - np.mean(course[used])
        rates[c] = float(mine @ left) / float(mine @ mine)
        power = float(left @ left)
        if power > 0.0:
            rest = max(float(np.sum((left - rates[c] * mine) ** 2)), _EXACT * power)
            gained += 0.5 * len(left) * math.log(power / rest) / float(best.per_row[c])
    return gained, rates


def _winds(drive: Drive, best: Fit, each: Each) -> list[Start]:
    """A wind where the yaw rate has it, which leans no body, and one that leans a body on springs.

    Of a car that goes straight ahead as it is driven and braked: without a wind in the model what one happened to do
    meanwhile is in that, and no wind that is felt beside it takes it back.
    """
    softly = best.x[INDEX["suspension_roll.roll_gradient_rad_per_mps2"]] > 0.0
    found: list[Start] = []
    for leans in (0.0, 1.0) if softly else (0.0,):
        x = best.x.copy()
        x[INDEX["side_wind.leans"]], x[list(PULLS)] = leans, 0.0
        x[INDEX["side_wind.ahead_m"]] = wind_ahead_m(drive, x, best.felt, (*best.effects, "side_wind"), each)
        found.append((("side_wind",), x))
    return found
