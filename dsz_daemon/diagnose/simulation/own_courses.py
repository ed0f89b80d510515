"""What rows behind the built-in ones do to the car, each by its course times its only parameter."""

from __future__ import annotations

from typing import Any

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import Vocabulary

Floats = np.ndarray[Any, np.dtype[np.float64]]


def turned_by(vocabulary: Vocabulary, x: Floats) -> Floats | float:
    """By what the front wheels turn further (n,), rad; on another drive (a manoeuvre) there is no such course."""
    turn: Floats | float = 0.0
    for effect in vocabulary.own():
        if effect.steers is not None and (k := _times(vocabulary, x, effect.name)) != 0.0:
            turn = turn + k * effect.steers
    return turn


def pushed_by(vocabulary: Vocabulary, x: Floats, n: int) -> Floats:
    """The side force at the C.G., N, and the yaw moment, N m, on the car (n, 2)."""
    push = np.zeros((n, 2))
    for effect in vocabulary.own():
        if effect.pushes is not None and (k := _times(vocabulary, x, effect.name)) != 0.0:
            push += k * effect.pushes
    return push


def _times(vocabulary: Vocabulary, x: Floats, name: str) -> float:
    return float(x[vocabulary.columns_of(name)[0]])
