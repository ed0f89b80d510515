"""A channel that shows its own motion unevenly: to one side only, or more as it warms up. No scale, which is a number.

Rivals of a scale from the first: one side is a half of it, and what comes with the time is most of it by the end.
"""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.effects.row import Floats
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.shapes.own_ways import OWN_NAMES, is_dead_near_nothing, is_own_way

_WARM_S = 60.0
# A car turns to the side that it is pushed to.
_SAME_SIGN = {"gyro_z": ("r", "ay"), "accel_x": ("ax",), "accel_y": ("ay", "r")}


def uneven(name: str, own: Floats, unit: str) -> dict[str, tuple[Floats, str]]:
    """Shapes (n,) of what a sensor shows of its `own` motion (n,), and not evenly, with their units."""
    time_s = np.arange(len(own), dtype=np.float64) * DT_S
    warm = 1.0 - np.exp(-time_s / _WARM_S)
    return {
        f"{name} where {name} > 0": (np.maximum(own, 0.0), unit),
        f"{name} where {name} < 0": (np.minimum(own, 0.0), unit),
        f"{name}*t": (own * time_s, f"{unit} s"),
        f"{name}*(1-exp(-t/{_WARM_S:.0f} s))": (own * warm, unit),
        f"{name}*exp(-t/{_WARM_S:.0f} s)": (own * (1.0 - warm), unit),
    }


def is_uneven(shape: str) -> bool:
    """Whether it is one of these, of any channel."""
    return any(_is_of(shape, name) for name in OWN_NAMES.values())


def is_of_two(shape: str) -> bool:
    """Whether it is told by two numbers: when, or from how much on; and how much."""
    return is_uneven(shape) or any(is_own_way(shape, channel) for channel in OWN_NAMES)


def sticks(shape: str, channel: str) -> bool:
    """Whether the channel does not follow its own motion near none of it: by that much less it shows, at any size."""
    signs = {f"sign({name})" for name in _SAME_SIGN.get(channel, ())}
    return shape in signs or is_dead_near_nothing(shape, channel)


def is_anothers(shape: str, channel: str) -> bool:
    """Whether the shape is what another channel shows of its own."""
    return any(_is_of(shape, name) for other, name in OWN_NAMES.items() if other != channel)


def _is_of(shape: str, name: str) -> bool:
    return shape.startswith((f"{name} where ", f"{name}*t", f"{name}*(1-exp", f"{name}*exp"))
