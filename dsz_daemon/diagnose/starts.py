"""Where the real fits of candidates begin: at the model so far, at a guess, or with a wind that has been felt."""

from __future__ import annotations

from collections.abc import Sequence

from dsz_daemon.diagnose.comparison import Each, Rows
from dsz_daemon.diagnose.effects import INDEX
from dsz_daemon.diagnose.fit import OWN_CHANNEL, Fit
from dsz_daemon.diagnose.guesses import guesses
from dsz_daemon.diagnose.prediction import Drive, Floats
from dsz_daemon.diagnose.profiles import wind_ahead_m
from dsz_daemon.diagnose.screening import feels

# Effects that are fitted besides, and from where on.
Start = tuple[tuple[str, ...], Floats]

# The most promising; the others' turn may come.
_TRIED = 7
# What a road takes along, and where to begin with it: rad per m/s2, as passenger cars have it.
_LEANS_WITH, _SOME_LEAN = {"road_bank": "suspension_roll", "road_grade": "suspension_pitch"}, 0.008


def starts_of(drive: Drive, rows: Rows, best: Fit, names: Sequence[str], each: Each = map) -> list[Start]:
    """What is worth a real fit, and from where: the best of a screening, profiles that can be felt, guesses."""
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
    found = guesses(drive, rows, best, each)
    guessed: list[Start] = [((effect,), x) for effect, x in found if effect not in best.effects]
    known = {effects for effects, _ in guessed}
    return [*guessed, *(start for start in starts if start[0] not in known)]


def _winds(drive: Drive, best: Fit, each: Each) -> list[Start]:
    """A wind where the yaw rate has it, which leans no body, and one that leans a body on springs."""
    softly = best.x[INDEX["suspension_roll.roll_gradient_rad_per_mps2"]] > 0.0
    found: list[Start] = []
    for leans in (0.0, 1.0) if softly else (0.0,):
        x = best.x.copy()
        x[INDEX["side_wind.leans"]] = leans
        x[INDEX["side_wind.ahead_m"]] = wind_ahead_m(drive, x, best.felt, (*best.effects, "side_wind"), each)
        found.append((("side_wind",), x))
    return found
