"""Where a sensor's readings stand against where it is said to clip."""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.flat_tops import FlatTop
from dsz_daemon.diagnose.simulation.drive import Drive, Floats

# The first of the channels that a limit is of.
LIMITS = ((0, "gyro_limit_radps"), (3, "accel_limit_mps2"))
# The simulation goes so much of the way to where readings stand still: else they stand there for another reason.
_REACHES = 0.8
# So near to each other a limit and where readings stand are the same: behind the filter short tops are lower.
_SAME, _ROOM = 0.05, 0.045


def tops_of(drive: Drive, first: int) -> list[FlatTop]:
    """Of the three channels from `first` on."""
    return [top for top in drive.recording.tops if first <= top.channel < first + 3]


def reaches(drive: Drive, course: Floats, top: FlatTop) -> bool:
    """Whether the simulation goes there, too, when the readings stand there."""
    there = np.interp(top.at_s, drive.recording.time_s, course[:, top.channel])
    return float(np.median(np.abs(there))) > _REACHES * top.limit


def limits_read_off(drive: Drive, x: Floats) -> dict[int, list[FlatTop]]:
    """Columns of x that are limits where readings stand, with these."""
    found = {}
    for first, name in LIMITS:
        limit = x[INDEX[f"sensor_saturation.{name}"]]
        tops = [top for top in tops_of(drive, first) if abs(top.limit - limit) < _SAME * top.limit]
        if tops:
            found[INDEX[f"sensor_saturation.{name}"]] = tops
    return found


def room_of_limits(drive: Drive, x: Floats) -> dict[int, tuple[float, float]]:
    """How far columns of x may go that are limits where readings stand."""
    tops = {i: min(top.limit for top in found) for i, found in limits_read_off(drive, x).items()}
    return {i: ((1.0 - _ROOM) * limit, (1.0 + _ROOM) * limit) for i, limit in tops.items()}


def read_off(drive: Drive, x: Floats) -> float:
    """Log odds that the readings themselves, which stand at the limits that are in x, give these."""
    return sum(top.log_odds for tops in limits_read_off(drive, x).values() for top in tops)
