"""Wheels that spin or slide: beyond the slip at which a tyre pushes hardest nothing goes with the force."""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import Bools, Rows
from dsz_daemon.diagnose.residuals.locate import channel_names
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats, nothing
from dsz_daemon.diagnose.simulation.motion import ROLLING_MPS
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat

# Tyres push hardest at a slip of a tenth to a sixth (Pacejka, Tyre and Vehicle Dynamics, 2012, 4.3).
_BEYOND = 0.1
# A wheel that jumps by less, or for less time, may be its sensor; what lies so near in time is one.
_LEAST_MPS, _LEAST_S, _NEAR_S = 0.3, 0.2, 0.3
# Whoever spins gains speed, whoever slides loses it, by so much over this time about it.
_CHANGES_MPS2, _OVER_S = 1.0, 0.5
# Before and after, a wheel gains and loses its speed.
_AROUND_S = 0.5
_OTHERS = tuple(CHANNELS.index(f"wheel_other_{side}") for side in ("left", "right"))


def rolling_rows(drive: Drive, rows: Rows) -> Rows:
    """The rows without what a wheel shows while it spins or slides: no slip that goes with force is fitted to it."""
    more = drive.measured[rows.at] - predicted(drive, nothing(drive.vocabulary), flat(len(drive.steer)))[rows.at]
    t_s, used = drive.recording.time_s[rows.at], rows.used.copy()
    for c in _OTHERS:
        for first, last in _spins(drive, rows, more[:, c]):
            used[(t_s > t_s[first] - _AROUND_S) & (t_s < t_s[last] + _AROUND_S), c] = False
    return rows._replace(used=used)


def spinning(drive: Drive, rows: Rows, fit: Fit) -> list[Shape]:
    """When which wheel of the axle that drives no simulation spins, or slides, as far as `fit` does not tell it.

    Of the other axle, by whose wheels the car's speed is known, nothing is said: all else would be off, too. Of a
    shape the coefficient is the largest slip, against the fitted simulation, and its share one of the time.
    """
    t_s, names = drive.recording.time_s[rows.at], channel_names(drive)
    v = _speed(drive)[rows.at]
    left = drive.measured[rows.at] - predicted(drive, fit.x, fit.road)[rows.at]
    found = []
    for c in _OTHERS:
        for first, last in _spins(drive, rows, left[:, c]):
            share = left[first : last + 1, c] / v[first : last + 1]
            most = float(share[np.nanargmax(np.abs(share))])
            std = float(fit.scatter.min(axis=0)[c]) / float(np.min(v[first : last + 1]))
            shape = f"k*vx from {t_s[first]:.1f} to {t_s[last]:.1f} s"
            found.append(Shape(names[c], shape, Coefficient(most, std, "(m/s)/(m/s)"), (last - first) / len(t_s)))
    return found


def _spins(drive: Drive, rows: Rows, more: Floats) -> list[tuple[int, int]]:
    """First and last row of each stretch in which a wheel is `more` (k,) ahead of or behind the car's way."""
    speed = _speed(drive)
    reach = round(_OVER_S / DT_S)
    ahead, behind = (np.clip(rows.at + side * reach, 0, len(speed) - 1) for side in (1, -1))
    gains, v = (speed[ahead] - speed[behind]) / np.maximum(ahead - behind, 1) / DT_S, speed[rows.at]
    known = np.isfinite(more) & (v > ROLLING_MPS)
    is_off = known & (np.abs(more) > np.maximum(_BEYOND * v, _LEAST_MPS))
    return _stretches(is_off & (more * gains > _CHANGES_MPS2 * np.abs(more)), drive.recording.time_s[rows.at])


def _speed(drive: Drive) -> Floats:
    """The car's, by the wheels that drive the simulation."""
    own = slice(0, 2) if drive.front_gives_speed else slice(2, 4)
    return np.asarray(np.mean(drive.wheels[:, own], axis=1), dtype=np.float64)


def _stretches(slips: Bools, t_s: Floats) -> list[tuple[int, int]]:
    """First and last row of each stretch that lasts, near ones as one."""
    at = np.flatnonzero(slips)
    if not len(at):
        return []
    ends = np.flatnonzero(np.diff(t_s[at]) > _NEAR_S)
    firsts, lasts = at[np.concatenate(([0], ends + 1))], at[np.concatenate((ends, [len(at) - 1]))]
    return [(int(a), int(b)) for a, b in zip(firsts, lasts, strict=True) if t_s[b] - t_s[a] >= _LEAST_S]
