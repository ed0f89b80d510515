"""Two candidates at once, where one hides the other, or where a shape without a name is what both do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dsz_daemon.diagnose.effects.shape_names import is_of_the_car
from dsz_daemon.diagnose.fitting.gains import far_off, puts_right
from dsz_daemon.diagnose.fitting.model import OWN_CHANNEL, TILTS
from dsz_daemon.diagnose.residuals.comparison import Bools, Each
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.selection.plausible import is_told
from dsz_daemon.diagnose.selection.screening import Screening, feels
from dsz_daemon.diagnose.selection.starts import Start, beside_a_wind
from dsz_daemon.diagnose.selection.trials import SURELY, TURNS, Step, Trial, judged_steps
from dsz_daemon.diagnose.shapes.unlisted import Found
from dsz_daemon.diagnose.simulation.drive import CHANNELS

# A name alone is as good as a shape of the car that gains so much more: there are some twenty of these.
_AS_GOOD = 5.0
# The most promising of two at once; and what makes a gyro show more than its own rate.
_PAIRS, _OTHERS, _SHOWS_MORE = 3, 2, ("gyro_cross_axis", "gyro_scale", "gyro_g_sensitivity", "imu_misalignment")
# And the most promising beside a wind.
_BLOWN, _OTHERS_OF_A_WIND = "side_wind", 3
# Than a shape, for two to come in its place; than one of the car, whose place has fewer names.
_SO_MUCH_MORE, _THAN_OF_A_CAR = 2.0, 1.5


def two_at_once(
    trial: Trial, screening: Screening, starts: Sequence[Start], refused: set[str], each: Each
) -> list[Step]:
    """What two effects gain that hide each other while a channel is far off, the most first; empty where none do.

    An IMU that is late and a steering that is, too, turn the car in time with each other; of a road that is felt by a
    gyro which shows more than its own rate nothing is left as it is; and a wind, from where one `starts`, is judged by
    the yaw rate, of which nothing else may be off.
    """
    off = far_off(trial.drive, trial.best)
    if not off.any():
        return []
    winds = [
        ((_BLOWN, other), beside_a_wind(trial.rows, trial.best, x, other))
        for new, x in starts
        if new == (_BLOWN,)
        for other in [name for name in screening.names if name != _BLOWN][:_OTHERS_OF_A_WIND]
    ]
    pairs = (*_felt_by_more(trial, screening, off), *screening.pairs(off, each)[:_PAIRS])
    tried = tried_at_once(trial, (*winds, *((pair, trial.best.x) for pair in pairs)), refused, each)
    return [step for step in tried if step.gain > LEAST_GAIN and puts_right(trial.drive, trial.best, step.fit)]


def _felt_by_more(trial: Trial, screening: Screening, shown: Bools) -> list[tuple[str, str]]:
    """Roads that a gyro of these channels (13,) feels, each with what makes it show more than its own rate."""
    more = [name for name in screening.names if name in _SHOWS_MORE][:_OTHERS]
    roads = [road for road in sorted(TILTS - set(trial.best.effects)) if shown[OWN_CHANNEL[road]]]
    return [(one, road) for road in roads if feels(trial.drive, trial.rows, trial.best, road) for one in more]


def two_instead(
    trial: Trial, screening: Screening, tried: Sequence[Step], refused: set[str], shape: Found, each: Each
) -> list[Step]:
    """Two effects in place of a shape, the most first, where they gain much more: a scale that a ratio hides bends.

    Two fit more than one, and may be any of some hundred. A gyro that shows more than its own rate hides a road. What
    turns a car by its speed is the best that was `tried`, and another of those that do: wheels that turn less the
    faster it goes are a ratio and a stiffness, too. One that was not tried may be as good alone.
    """
    shown = np.array([channel == shape.channel for channel in CHANNELS])
    instead: list[tuple[str, ...]] = [*screening.pairs(shown, each)[:_PAIRS], *_felt_by_more(trial, screening, shown)]
    factor = _SO_MUCH_MORE
    if is_of_the_car(shape.effect.name):
        factor = _THAN_OF_A_CAR
        known, others = {step.effect for step in tried}, sorted(set(TURNS) - {*trial.best.effects})
        for first in [step.effect for step in tried if step.effect in TURNS][:1]:
            more = [(first, other) for other in others if other != first]
            instead += [pair for pair in more if set(pair) not in map(set, instead)]
        instead += [(other,) for other in others if other not in known]
    found = tried_at_once(trial, [(names, trial.best.x) for names in instead], refused, each)
    already = len(trial.best.effects)

    def is_better(step: Step) -> bool:
        if len(new := step.fit.effects[already:]) == 1:
            return step.gain > shape.gain / SURELY - _AS_GOOD
        return step.gain > factor * shape.gain and all(is_told(trial.drive, step.fit, effect) for effect in new)

    return [step for step in found if is_better(step)]


def tried_at_once(trial: Trial, starts: Sequence[Start], refused: set[str], each: Each) -> list[Step]:
    """All of these really fitted, but for what is `refused`, and judged; the most first."""
    fits = each(trial.fit, [start for start in starts if not set(start[0]) & refused])
    return sorted(judged_steps(trial, fits, each), key=lambda step: -step.gain)
