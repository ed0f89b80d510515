"""A steering sensor that goes no further: seen in its own readings, which stop and stand, and in a car that turns on.

What the simulation is steered by is not known there. Those rows are left out, and a second after them, which is what a
car takes to forget.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.diagnose.recordings.recording import Recording, white_std, without_steering
from dsz_daemon.diagnose.residuals.comparison import SLOW_MPS
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.pipeline.grid import Signal

Floats = np.ndarray[Any, np.dtype[np.float64]]
Bools = np.ndarray[Any, np.dtype[np.bool_]]

# How wide readings that stand are, in their white noise; how long they stand, and how often.
_AS_WIDE_AS, _STANDS_S, _OFTEN = 10.0, 0.3, 2
# A hand that turns slows down before it stops: one that stood by itself moved by less in this time, of that width.
_BEFORE_S, _MOVED = 0.15, 4.0
# The car turns further than by the steering: by this share, which is more than ratios are off by, and by so many
# deviations of what is off elsewhere.
_TURNS_ON, _SURELY = 0.25, 3.0
_FORGETS_S, _FEWEST = 1.0, 50
# As far before as filters reach.
_FILTERED_S = 0.3
_YAW = CHANNELS.index("gyro_z")


class Stop(NamedTuple):
    """Where a steering signal ends, rad of its own, its noise, and from when to when it stood there, ns (k, 2)."""

    role: str
    limit_rad: float
    std_rad: float
    stood_ns: np.ndarray[Any, np.dtype[np.int64]]

    def as_shape(self, share: float) -> Shape:
        """What is said of it; `share`: of the drive."""
        return Shape(self.role, f"|{self.role}| <= k", Coefficient(self.limit_rad, self.std_rad, "rad"), share)


def stop_of(signals: Mapping[str, Signal]) -> Stop | None:
    """What the steering's own readings tell of an end of theirs; None where they tell of none."""
    role = next((name for name in ("steering_wheel_angle", "road_wheel_angle") if name in signals), None)
    if role is None or len(signals[role].t_ns) < _FEWEST:
        return None
    t_ns, values = signals[role].t_ns, signals[role].values
    steps = np.abs(np.diff(values))
    if not np.isfinite(values).all() or not (steps > 0.0).any():
        return None
    noise = white_std(values)
    width = max(_AS_WIDE_AS * noise, 0.5 * float(np.min(steps[steps > 0.0])))
    furthest = float(np.max(np.abs(values)))
    ends = np.flatnonzero(np.diff(np.concatenate(([0], np.abs(values) > furthest - width, [0])).astype(np.int64)))
    stood = []
    for first, after in ends.reshape(-1, 2).tolist():
        last = after - 1
        earlier, later = np.searchsorted(t_ns, (t_ns[first] - _BEFORE_S * 1e9, t_ns[last] + _BEFORE_S * 1e9))
        at_either = np.abs(values[[earlier, min(later, len(values) - 1)]])
        if t_ns[last] - t_ns[first] > _STANDS_S * 1e9 and (furthest - at_either > _MOVED * width).all():
            stood.append((int(t_ns[first]), int(t_ns[last])))
    if len(stood) < _OFTEN:
        return None
    inside = np.zeros(len(values), dtype=np.bool_)
    for begin_ns, end_ns in stood:
        inside |= (t_ns >= begin_ns) & (t_ns <= end_ns)
    return Stop(role, float(np.mean(np.abs(values[inside]))), noise, np.array(stood, dtype=np.int64))


def is_one(drive: Drive, stop: Stop, first_ns: int) -> bool:
    """Whether the car turns on while the steering stands, by more than it is off elsewhere: a held wheel turns none."""
    there = _within(drive.recording.time_s, stop, first_ns, 0.0)
    found = predicted(drive, nothing(drive.vocabulary), flat(len(drive.steer)))[:, _YAW]
    measured, moves = drive.measured[:, _YAW], np.mean(drive.wheels, axis=1) > SLOW_MPS
    moves &= np.isfinite(measured)
    beside = moves & ~_within(drive.recording.time_s, stop, first_ns, _FORGETS_S)
    there &= moves
    if min(np.count_nonzero(there), np.count_nonzero(beside)) < _FEWEST:
        return False
    left = measured - found
    more = (left - float(np.median(left[beside]))) * np.sign(found)
    further = float(np.median(more[there]))
    usual = 1.4826 * float(np.median(np.abs(more[beside])))
    return further > max(_SURELY * usual, _TURNS_ON * float(np.median(np.abs(found[there]))))


def without_it(recording: Recording, stop: Stop, first_ns: int) -> tuple[Recording, float]:
    """The recording with no steering where it stood, or the car has not forgotten that yet; and which share it was."""
    there = _within(recording.time_s, stop, first_ns, _FORGETS_S)
    return without_steering(recording, there), float(np.mean(there))


def _within(time_s: Floats, stop: Stop, first_ns: int, after_s: float) -> Bools:
    """Which instants (n,) are within the times it stood, or so long after."""
    found = np.zeros(len(time_s), dtype=np.bool_)
    for begin_s, end_s in ((stop.stood_ns - first_ns) * 1e-9).tolist():
        found |= (time_s >= begin_s - _FILTERED_S) & (time_s <= end_s + after_s)
    return found
