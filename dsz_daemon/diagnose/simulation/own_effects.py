"""Effects of a user's own, asked once before anything is computed: what is wrong with them is said by its name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dsz_daemon.diagnose.effects.row import Effect, Motion
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.simulation.drive import CHANNELS

# Steps of a car that does one of everything all the time.
_STEPS = 1000


def require_sound(effects: Sequence[Effect]) -> None:
    """ValueError: words with a number that is no parameter, a channel that is none, a course of another length."""
    faults = [f"effect {effect.name!r}: {fault}" for effect in effects for fault in _faults(effect)]
    if faults:
        raise ValueError("; ".join(faults))


def _faults(effect: Effect) -> list[str]:
    values = {parameter.name: parameter.step for parameter in effect.parameters}
    own, faults = f"expected its parameters {', '.join(values) or '(none)'}", []
    try:
        effect.words.format(**values)
    except (KeyError, IndexError, ValueError) as error:
        faults.append(f"words {effect.words!r} ask for {error}; {own}")
    if effect.shows is None:
        return faults
    try:
        steady = Motion(*(np.ones(_STEPS) for _ in Motion._fields))
        shown = dict(effect.shows(steady._replace(time_s=np.asarray(DT_S * np.arange(_STEPS))), values))
    except KeyError as error:
        return [*faults, f"shows asks for {error}; {own}"]
    for channel, course in shown.items():
        if channel not in CHANNELS:
            faults.append(f"shows {channel!r}; expected some of {', '.join(CHANNELS)}")
        elif np.shape(course) not in {(), (_STEPS,)}:
            faults.append(
                f"shows {np.shape(course)} of {channel} where the motion is of ({_STEPS},); expected the same"
            )
    return faults
