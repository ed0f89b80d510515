"""What a sensor may do with what it feels: nothing near nothing, all but little, or follow it only after some play.

How much that is stands in no library: it is the width that explains most of what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.diagnose.recordings.recording import filter_kernel, filtered
from dsz_daemon.diagnose.simulation.drive import Floats
from dsz_daemon.diagnose.simulation.motion import AY, R
from dsz_daemon.diagnose.simulation.moving import Moving
from dsz_daemon.diagnose.simulation.play import played

Ints = np.ndarray[Any, np.dtype[np.int64]]

# Widths that are tried, of gyros, rad/s, and accelerometers, m/s2: so many; and about the best of these again, twice.
_WIDTHS = {"gyro": (0.003, 0.1), "accel": (0.04, 1.2)}
_TRIED, _ROUNDS = 10, 3
_OWN_NAMES = {"gyro_z": "r", "accel_x": "ax", "accel_y": "ay"}


# What of its course a sensor shows that does so: all of it, but for what the rest of the model has bent to it.
_SHOWN = (0.4, 1.6)


class _Way(NamedTuple):
    """A course (n,) of own motion (n,) and a width; how much of it is shown; as it is written; if it has a unit."""

    course: Callable[[Floats, float], Floats]
    shown: Callable[[float], float]
    written: str
    has_unit: bool


_WAYS = (
    _Way(lambda own, width: np.clip(own / width, -1.0, 1.0), lambda width: -width, "sat({own}/{width:.2g})", False),
    _Way(
        lambda own, width: np.where(np.abs(own) < width, own, 0.0),
        lambda _: -1.0,
        "{own} where |{own}| < {width:.2g}",
        True,
    ),
    _Way(lambda own, width: played(own, 2.0 * width) - own, lambda _: 1.0, "(play({own}, {width:.2g})-{own})", True),
)


def own_motion(moving: Moving, channel: str) -> Floats | None:
    """What a channel (n,) feels of a car that moves so; None for those of which the nominal simulation has nothing."""
    if channel == "gyro_z":
        return moving.moved[:, R]
    if channel == "accel_y":
        return moving.moved[:, AY]
    return filtered(moving.v_rate, filter_kernel()) if channel == "accel_x" else None


def own_ways(channel: str, own: Floats, left: Floats, at: Ints) -> Mapping[str, tuple[Floats, str]]:
    """Of each way the course (n,) of the width that explains most of what is left (k,), with its unit; if one does.

    `at` (k,): places of the rows on the grid of `own`.
    """
    name, (low, high) = _OWN_NAMES[channel], _WIDTHS[channel.partition("_")[0]]
    unit = "rad/s" if channel.startswith("gyro") else "m/s2"
    level = left - np.mean(left)
    found = {}
    for way in _WAYS:

        def taken(width: float, way: _Way = way) -> float:
            course = way.course(own, width)[at]
            course = course - np.mean(course)
            square, pull = float(course @ course), float(course @ level)
            if not (square > 0.0 and _SHOWN[0] < pull / square / way.shown(width) < _SHOWN[1]):
                return 0.0
            return pull**2 / square

        least, most = low, high
        for _ in range(_ROUNDS):
            widths = np.geomspace(least, most, _TRIED)
            gains = [taken(width) for width in widths]
            best = int(np.argmax(gains))
            least, most = widths[max(best - 1, 0)], widths[min(best + 1, _TRIED - 1)]
        width = float(widths[best])
        # What is best at an end is something else that looks a little like it.
        if not gains[best] > 0.0 or not low < width < high:
            continue
        found[way.written.format(own=name, width=width)] = (way.course(own, width), unit if way.has_unit else "")
    return found


def is_dead_near_nothing(shape: str, channel: str) -> bool:
    """Whether it is a channel's own motion that it does not show near nothing."""
    name = _OWN_NAMES.get(channel)
    return name is not None and shape.startswith((f"sat({name}/", f"{name} where |{name}|"))


def is_own_way(shape: str, channel: str) -> bool:
    """Whether it is one of what a channel may do with its own motion."""
    return is_dead_near_nothing(shape, channel) or shape.startswith(f"(play({_OWN_NAMES.get(channel)}, ")
