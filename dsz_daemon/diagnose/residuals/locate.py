"""Where recording and nominal simulation part: which channel, from when to when, how the car was driven then."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.residuals.comparison import Bools, Rows
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats
from dsz_daemon.signals import WHEEL_SPEEDS

# A second stands out if its mean square is this many times what is usual where nothing is left out, and if that is no
# chance: of all seconds that are said to stand out, in all channels, so many may by chance (Benjamini, Hochberg 1995).
_STANDS_OUT = 3.0
_FALSE = 0.01
_BIN_S = 1.0
# Between two stretches so near (bins) all is one; one so short is none.
_GAP, _SHORTEST = 4, 2
_MOST_PLACES = 40


class Place(NamedTuple):
    """One stretch of one channel, s since the first frame, with its share of the channel's excess."""

    channel: str
    start_s: float
    end_s: float
    share: float
    region: dict[str, tuple[float, float]]


def located(drive: Drive, rows: Rows, before: Floats, scatter: Floats, per_row: Floats) -> list[Place]:
    """Stretches in which `before` (k, 13), what the nominal simulation leaves, is beyond the usual `scatter` (13,).

    `per_row` (13,): how many rows count as one, where all is explained.
    """
    places = []
    names = channel_names(drive)
    bins = (drive.recording.time_s[rows.at] / _BIN_S).astype(np.int64)
    v = np.mean(drive.wheels, axis=1)[rows.at]
    side = np.abs(np.nan_to_num(drive.measured[rows.at, 2]) * v)
    count = np.column_stack([np.bincount(bins, rows.used[:, c]) for c in range(len(CHANNELS))])
    total = np.column_stack([np.bincount(bins, before[:, c] ** 2) for c in range(len(CHANNELS))])
    powers = total / np.maximum(count, 1.0)
    if not (powers > _STANDS_OUT * scatter**2).any():
        return []
    no_chance = _is_no_chance(powers / scatter**2, count / per_row, count > 0)
    for c in range(len(CHANNELS)):
        power = powers[:, c]
        excess = np.maximum(power - scatter[c] ** 2, 0.0) * (count[:, c] > 0)
        out = (power > _STANDS_OUT * scatter[c] ** 2) & no_chance[:, c]
        for start, end in _stretches(out):
            inside = (bins >= start) & (bins < end) & rows.used[:, c]
            region = {
                "speed_mps": (float(np.min(v[inside])), float(np.max(v[inside]))),
                "abs_ay_mps2": (float(np.min(side[inside])), float(np.max(side[inside]))),
            }
            share = float(np.sum(excess[start:end]) / np.sum(excess))
            last_s = float(drive.recording.time_s[-1])
            places.append(Place(names[c], start * _BIN_S, min(end * _BIN_S, last_s), share, region))
    return sorted(places, key=lambda place: -place.share)[:_MOST_PLACES]


def _is_no_chance(ratio: Floats, independent: Floats, known: Bools) -> Bools:
    """Which mean squares, over what is usual, of so many independent rows are too large for chance."""
    # A sixth of a second to import, and where nothing is left out nobody asks.
    from scipy.special import chdtrc  # noqa: PLC0415

    found = np.zeros(ratio.shape, dtype=np.bool_)
    rows = np.maximum(independent[known], 1.0)
    by_chance = chdtrc(rows, ratio[known] * rows)
    ranked = np.sort(by_chance)
    below = np.flatnonzero(ranked <= _FALSE * np.arange(1, len(ranked) + 1) / max(len(ranked), 1))
    if len(below):
        found[known] = by_chance <= ranked[below[-1]]
    return found


def _stretches(out: Bools) -> list[tuple[int, int]]:
    """First and last bin (exclusive) of each stretch that stands out, near ones as one."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], out.astype(np.int64), [0])))).reshape(-1, 2)
    found: list[tuple[int, int]] = []
    for start, end in edges.tolist():
        if found and start - found[-1][1] <= _GAP:
            found[-1] = (found[-1][0], end)
        else:
            found.append((start, end))
    return [(start, end) for start, end in found if end - start >= _SHORTEST]


def channel_names(drive: Drive) -> tuple[str, ...]:
    """The compared channels in the project's vocabulary; a difference by its right wheel."""
    own, other = ((0, 1), (2, 3)) if drive.front_gives_speed else ((2, 3), (0, 1))
    return (*CHANNELS[:6], *(WHEEL_SPEEDS[i] for i in (other[0], other[1], own[1])), *CHANNELS[9:])
