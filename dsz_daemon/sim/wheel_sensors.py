"""Wheel speeds from pole counting: edges of a toothed ring, counted and timed.

The controller knows edges and their times only. Each message it divides the way of the edges
since the last message by the time that they took (counting alone would be coarse: one of
48 poles in 20 ms is 2.2 m/s). So a speed is late by half of what it was measured over, comes
in steps of the timer and of the message, and below a walking pace there is none.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.sim.sensors import Counts

Array = NDArray[np.float64]

WHEEL_SPEED_QUANTUM_KMH = 0.03125
WHEEL_SPEED_MOST = (1 << 14) - 1  # of the message's 14 bits: 512 km/h, as of a wheel that spins on ice
# Chosen: edges come too seldom below a walking pace; makers' units report 0 there.
WHEEL_SILENT_BELOW_KMH = 1.0
# Chosen: a capture timer of 1 MHz, usual in brake controllers.
TIMER_PER_S = 1_000_000


def wheel_speed_counts(speed_mps: Array) -> Counts:
    """Return wheel speeds in quanta; unsigned, as usual, 0 below a walking pace, and no more than the field holds."""
    kmh = np.abs(speed_mps) * 3.6
    quanta = np.rint(kmh / WHEEL_SPEED_QUANTUM_KMH).astype(np.int64)
    return np.where(kmh < WHEEL_SILENT_BELOW_KMH, 0, np.minimum(quanta, WHEEL_SPEED_MOST))


def edge_times_s(
    time_s: Array, rim_speed_mps: Array, pitch_m: float, start: float, off_pitches: tuple[float, ...] = ()
) -> Array:
    """Return when an edge passes the sensor, forward or backward, in time order.

    `rim_speed_mps` (signed) on the times `time_s`; `pitch_m` of rim lie between two edges, and
    at the first time the ring stands `start` (0 to 1) of it past one. `off_pitches`: how far each
    edge of the ring is from its place, in pitches (where the wheel turns fast enough to be heard).
    """
    dt_s = np.diff(time_s)
    way_m = np.cumsum(0.5 * (rim_speed_mps[1:] + rim_speed_mps[:-1]) * dt_s)
    turned = start + np.concatenate([[0.0], way_m]) / pitch_m
    before, after = turned[:-1], turned[1:]
    last, last_after = np.floor(before), np.floor(after)
    passed = np.abs(last_after - last).astype(np.int64)
    step = np.repeat(np.arange(len(passed)), passed)
    nth = np.arange(len(step)) - np.repeat(np.cumsum(passed) - passed, passed)
    edge = np.where(after[step] > before[step], last[step] + 1.0 + nth, last[step] - nth)
    if off_pitches:
        heard = np.abs(after[step] - before[step]) * pitch_m > WHEEL_SILENT_BELOW_KMH / 3.6 * dt_s[step]
        number = np.mod(edge, len(off_pitches)).astype(np.int64)
        edge = edge + np.where(heard, np.array(off_pitches)[number], 0.0)
    return np.asarray(time_s[step] + dt_s[step] * (edge - before[step]) / (after[step] - before[step]))


def counted_speed_mps(edges_s: Array, pitch_m: float, at_s: Array) -> Array:
    """Return the controller's speed (unsigned) at each message `at_s`, in time order.

    Without a new edge the speed is the last one, or less where even an edge right now would
    mean less. After a standstill (no edge for as long as a walking pace takes) two edges are
    needed to begin with.
    """
    if len(edges_s) == 0:
        return np.zeros(len(at_s), dtype=np.float64)
    ticks = np.floor(edges_s * TIMER_PER_S)
    silent_mps = WHEEL_SILENT_BELOW_KMH / 3.6
    longest = pitch_m / silent_mps * TIMER_PER_S
    until = np.searchsorted(edges_s, at_s, side="right")  # edges so far
    since = np.concatenate([[0], until[:-1]])
    # The measurement begins with the last edge before this message's, unless that is too old.
    first = np.minimum(since, len(ticks) - 1)
    old = (since == 0) | (ticks[first] - ticks[np.maximum(first - 1, 0)] > longest)
    begin = np.where(old, first, since - 1)
    end = np.maximum(until - 1, 0)
    took = ticks[end] - ticks[begin]
    fresh = (until > since) & (took > 0.0)
    measured = np.where(fresh, (end - begin) * pitch_m * TIMER_PER_S / np.where(fresh, took, 1.0), 0.0)
    # The last message that measured (or began anew, at zero) holds until there is another.
    newest = np.maximum.accumulate(np.where(until > since, np.arange(len(at_s)), 0))
    waited_s = at_s - edges_s[end]
    bound = np.where(waited_s > 0.0, pitch_m / np.where(waited_s > 0.0, waited_s, 1.0), math.inf)
    return np.minimum(measured[newest], bound)


def pitch_m(radius_m: float, poles: int) -> float:
    """Return the way of the rim from one edge to the next; `radius_m` is the controller's."""
    return 2.0 * math.pi * radius_m / poles
