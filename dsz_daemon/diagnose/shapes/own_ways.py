"""What a sensor may do with what it feels: show nothing of little, follow it after some play or no quicker, or lose it.

How much that is stands in no library: it is what explains most of what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel, filtered
from dsz_daemon.diagnose.simulation.drive import Floats
from dsz_daemon.diagnose.simulation.instruments import followed
from dsz_daemon.diagnose.simulation.motion import AY, R
from dsz_daemon.diagnose.simulation.moving import Moving
from dsz_daemon.diagnose.simulation.play import played

Ints = np.ndarray[Any, np.dtype[np.int64]]

# How much is looked for: widths of gyros, rad/s, and accelerometers, m/s2; how quickly these change at most, per s;
# of gyros from how slow a turn on they lose it, s; and beyond what readings begin again at the other end.
_WIDTHS = {"gyro": (0.003, 0.1), "accel": (0.04, 1.2)}
_RATES = {"gyro": (0.04, 1.0), "accel": (0.4, 10.0)}
_TIMES = {"gyro": (3.0, 120.0)}
_ENDS, _MOST_WRAPPED = {"gyro": (0.1, 1.2), "accel": (1.0, 12.0)}, 0.3
# So many are tried, and about the best of these again, twice.
_TRIED, _ROUNDS = 10, 3
# Which channel shows what as its own.
OWN_NAMES = {"gyro_z": "r", "accel_x": "ax", "accel_y": "ay"}
# What of its course a sensor shows that does so: all of it, but for what the rest of the model has bent to it.
_SHOWN = (0.4, 1.6)


@compiled
def slewed(values: Floats, rate_per_s: float, dt_s: float) -> Floats:
    """What follows the values (n,), by no more than so much in a second."""
    shown, at, most = np.empty_like(values), values[0], rate_per_s * dt_s
    for i in range(len(values)):
        at = min(max(values[i], at - most), at + most)
        shown[i] = at
    return shown


def _slowly(own: Floats, time_s: float) -> Floats:
    return followed(own[:, np.newaxis], time_s, DT_S)[:, 0]


def _wrapped(own: Floats, end: float) -> Floats:
    # What has too few bits for most of what it feels shows nothing of it.
    if np.mean(np.abs(own) > end) > _MOST_WRAPPED:
        return own
    return np.asarray(np.mod(own + end, 2.0 * end) - end)


class _Way(NamedTuple):
    """A course (n,) of own motion (n,) and a size; how much of it is shown; as it is written; sizes, low and high.

    `has_unit`: whether the course has the motion's, or none. `explains`: what part of what is left it must at least
    explain of the rows in which it is anything.
    """

    course: Callable[[Floats, float], Floats]
    shown: Callable[[float], float]
    written: str
    sizes: Mapping[str, tuple[float, float]]
    has_unit: bool = True
    explains: float = 0.0


# The first two show nothing near nothing.
_WAYS = (
    _Way(
        lambda own, width: np.clip(own / width, -1.0, 1.0),
        lambda width: -width,
        "sat({own}/{size:.2g})",
        _WIDTHS,
        False,
    ),
    _Way(
        lambda own, width: np.where(np.abs(own) < width, own, 0.0),
        lambda _: -1.0,
        "{own} where |{own}| < {size:.2g}",
        _WIDTHS,
    ),
    _Way(lambda own, width: played(own, 2.0 * width) - own, lambda _: 1.0, "(play({own}, {size:.2g})-{own})", _WIDTHS),
    _Way(lambda own, rate: slewed(own, rate, DT_S) - own, lambda _: 1.0, "(slew({own}, {size:.2g}/s)-{own})", _RATES),
    _Way(_slowly, lambda _: -1.0, "({own}, slowly by {size:.2g} s)", _TIMES),
    # What begins again at the other end jumps by all of the range, and nothing but noise is left of that. Readings that
    # have nothing to do with the motion leave what they show.
    _Way(
        lambda own, end: _wrapped(own, end) - own,
        lambda _: 1.0,
        "(wrap({own}, {size:.2g})-{own})",
        _ENDS,
        explains=0.9,
    ),
)


def own_motion(moving: Moving, channel: str) -> Floats | None:
    """What a channel (n,) feels of a car that moves so; None for those of which the nominal simulation has nothing."""
    if channel == "gyro_z":
        return moving.moved[:, R]
    if channel == "accel_y":
        return moving.moved[:, AY]
    return filtered(moving.v_rate, filter_kernel()) if channel == "accel_x" else None


def own_ways(channel: str, own: Floats, left: Floats, at: Ints) -> Mapping[str, tuple[Floats, str]]:
    """Of each way the course (n,) of the size that explains most of what is left (k,), with its unit; if one does.

    `at` (k,): places of the rows on the grid of `own`.
    """
    name, kind = OWN_NAMES[channel], channel.partition("_")[0]
    unit = "rad/s" if channel.startswith("gyro") else "m/s2"
    level = left - np.mean(left)
    found = {}
    for way in (way for way in _WAYS if kind in way.sizes):
        low, high = way.sizes[kind]

        def taken(size: float, way: _Way = way) -> tuple[float, float]:
            """How much of what is left the course takes, and what part of it where it is anything."""
            course = way.course(own, size)[at]
            anything = course != 0.0
            course = course - np.mean(course)
            square, pull = float(course @ course), float(course @ level)
            if not (square > 0.0 and _SHOWN[0] < pull / square / way.shown(size) < _SHOWN[1]):
                return 0.0, 0.0
            rest = (level - pull / square * course)[anything]
            return pull**2 / square, 1.0 - float(rest @ rest) / float(level[anything] @ level[anything])

        least, most = low, high
        for _ in range(_ROUNDS):
            sizes = np.geomspace(least, most, _TRIED)
            gains = [taken(size)[0] for size in sizes]
            best = int(np.argmax(gains))
            least, most = sizes[max(best - 1, 0)], sizes[min(best + 1, _TRIED - 1)]
        size = float(sizes[best])
        gain, part = taken(size)
        # What is best at an end is something else that looks a little like it.
        if gain > 0.0 and part >= way.explains and low < size < high:
            found[way.written.format(own=name, size=size)] = (way.course(own, size), unit if way.has_unit else "")
    return found


def is_dead_near_nothing(shape: str, channel: str) -> bool:
    """Whether it is a channel's own motion that it does not show near nothing."""
    return _is_one_of(shape, channel, _WAYS[:2])


def is_own_way(shape: str, channel: str) -> bool:
    """Whether it is one of what a channel may do with its own motion."""
    return _is_one_of(shape, channel, _WAYS)


def _is_one_of(shape: str, channel: str, ways: Sequence[_Way]) -> bool:
    """Whether it is written as one of these ways, of whatever size."""
    name = OWN_NAMES.get(channel)
    return name is not None and shape.startswith(
        tuple(way.written.partition("{size")[0].format(own=name) for way in ways)
    )
