"""A car that goes to one side as it is driven, or braked: as if its front wheels were turned by what does that."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX

Floats = np.ndarray[Any, np.dtype[np.float64]]

# As it is driven, as it is braked; and how much of what slows a car by itself is in that, see `rolling.rolling`. Where
# a car does so by little that would be an offset of its steering.
PULLS, BY_FORCE = (INDEX["drive_steer"], INDEX["brake_steer"]), INDEX["steers_by_force"]
# Every car does so a little (docs/decisions/0031), rad/(m/s^2); more, and surely, is not drawn so but left out.
_MUCH, _SURELY = 3.5e-4, 5.0
# What slows a car at even speed.
_COASTS_MPS2 = 0.3


def is_much(value: float, std: float) -> bool:
    """Whether a car does so by more than others do."""
    return abs(value) > max(_MUCH, _SURELY * std)


def by_force(x: Floats, std: Floats, columns: Sequence[int]) -> Floats | None:
    """Where a car does so by much, the parameters with what does it as a force; None where it does not."""
    told = {i: float(std[list(columns).index(i)]) for i in PULLS if i in columns}
    if not any(is_much(float(x[i]), spread) for i, spread in told.items()):
        return None
    found = x.copy()
    found[BY_FORCE] = 1.0
    return found


def pulled_rad(x: Floats, v_rate: Floats) -> Floats:
    """By what a car that goes faster, or slower (n,), m/s^2, turns its front wheels (n,); roughly, by no force."""
    drive, brake = (float(x[i]) for i in PULLS)
    return np.asarray(drive * np.maximum(v_rate, 0.0) + brake * np.minimum(v_rate, 0.0))


def offset_by_a_pull_rad(x: Floats) -> float:
    """What of an offset of the steering it may be."""
    return _COASTS_MPS2 * float(np.max(np.abs(x[list(PULLS)])))
