"""Few enough points to draw, without hiding a peak or bridging a gap. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.report.display import Floats

# A page is about 1000 pixels wide: two buckets per pixel, each with its least and its greatest.
POINTS = 4000
_STRIP_RUNS = 1500
# Three steps without a value is a gap: two may be a late frame.
_GAP_STEPS = 3.0
# Up to here float32 resolves a millisecond (2^14 s * 2^-24); longer runs need the full width.
_FLOAT32_RUN_S = 16384.0

Ints = NDArray[np.int64]


def _step_s(time_s: Floats) -> float:
    steps = np.diff(time_s)
    return float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0


def section_starts(time_s: Floats) -> Ints:
    """Indices where a new section begins: 0, after every gap and where time runs backwards.

    >>> section_starts(np.array([0.0, 0.1, 0.2, 0.9, 1.0, 0.5])).tolist()
    [0, 3, 5]
    """
    if not len(time_s):
        return np.zeros(0, dtype=np.int64)
    steps = np.diff(time_s)
    # The 0.1 % keeps rounding of the times from making a gap of exactly three steps.
    jumps = np.flatnonzero((steps > 1.001 * _GAP_STEPS * _step_s(time_s)) | (steps <= 0))
    return np.concatenate([np.zeros(1, dtype=np.int64), 1 + jumps.astype(np.int64)])


def _sections(time_s: Floats) -> Iterator[slice]:
    starts = section_starts(time_s)
    for start, end in zip(starts, np.r_[starts[1:], len(time_s)], strict=True):
        yield slice(int(start), int(end))


def extreme_indices(values: Floats, points: int) -> Ints:
    """Indices of at most about `points` values: least and greatest of equal buckets, both ends.

    `values` shape (n,), finite. All of them when there are no more than `points`.
    """
    n = len(values)
    if n <= points:
        return np.arange(n)
    width = -(-n // max(points // 2, 1))
    rows = -(-n // width)
    padded = np.full(rows * width, values[-1])
    padded[:n] = values
    table = padded.reshape(rows, width)
    first = np.arange(rows) * width
    picked = np.concatenate([first + table.argmin(axis=1), first + table.argmax(axis=1), [0, n - 1]])
    return _sorted_once(picked, n)


def _sorted_once(indices: Ints, n: int) -> Ints:
    """The indices in order, each once; faster than sorting, for there are n at most."""
    marked = np.zeros(n, dtype=bool)
    marked[np.minimum(indices, n - 1)] = True
    return np.flatnonzero(marked)


def compact_time(time_s: Floats) -> NDArray[Any]:
    """Time in as few bytes as keep a millisecond."""
    longest = float(np.nanmax(np.abs(time_s), initial=0.0))
    return time_s.astype(np.float32 if longest < _FLOAT32_RUN_S else np.float64)


def line(time_s: Floats, values: Floats, points: int = POINTS) -> tuple[NDArray[Any], NDArray[Any]]:
    """Times and values of a line to draw, with a NaN wherever the line must break.

    A break is a stretch of NaN, of missing rows, or a time that runs backwards. Both inputs
    have shape (n,); both results (m,), m at most about twice `points` (breaks included).
    """
    good = np.isfinite(values) & np.isfinite(time_s)
    t, v = time_s[good], values[good]
    starts = section_starts(t)
    section = np.zeros(len(t), dtype=np.int64)
    section[starts[1:]] = 1
    section = np.cumsum(section)
    kept = extreme_indices(v, points)
    if 2 * len(starts) <= points // 2:
        # Both sides of a gap, so that it is drawn as wide as it is.
        kept = _sorted_once(np.concatenate([kept, starts, starts[1:] - 1]), len(t))
    breaks = 1 + np.flatnonzero(np.diff(section[kept]))
    x = np.insert(t[kept], breaks, np.nan)
    y = np.insert(v[kept], breaks, np.nan)
    return compact_time(x), y.astype(np.float32)


def band(time_s: Floats, low: Floats, high: Floats, points: int = POINTS) -> tuple[NDArray[Any], NDArray[Any]]:
    """Outline of the area between `low` and `high`, one closed polygon per section.

    Buckets take their least `low` and greatest `high`: the drawn band is never too narrow.
    Polygons are separated by NaN, as plotly's fill "toself" wants them.
    """
    good = np.isfinite(low) & np.isfinite(high) & np.isfinite(time_s)
    t, low, high = time_s[good], low[good], high[good]
    xs: list[Floats] = []
    ys: list[Floats] = []
    for part in _sections(t):
        size = part.stop - part.start
        buckets = min(size, max(1, points // 4 * size // len(t)))
        edges = np.linspace(0, size, buckets, endpoint=False).astype(np.int64)
        lower = np.minimum.reduceat(low[part], edges)
        upper = np.maximum.reduceat(high[part], edges)
        x = np.r_[t[part][edges], t[part][-1]]
        xs += [x, x[::-1], np.array([np.nan])]
        ys += [np.r_[lower, lower[-1]], np.r_[upper, upper[-1]][::-1], np.array([np.nan])]
    if not xs:
        return np.zeros(0), np.zeros(0)
    return compact_time(np.concatenate(xs)[:-1]), np.concatenate(ys)[:-1].astype(np.float32)


class Buckets(NamedTuple):
    """Least, mean and greatest value of equal stretches of time; each of shape (buckets,)."""

    middle_s: Floats
    low: Floats
    mean: Floats
    high: Floats


def bucket_length_s(duration_s: float) -> float:
    """Length of a stretch: a 400th of the run (two or three pixels), at least a tenth of a second."""
    return max(0.1, duration_s / 400.0)


def buckets(time_s: Floats, values: Floats, length_s: float) -> Buckets:
    """Summarise finite `values` over stretches of `length_s`; empty stretches are left out.

    >>> b = buckets(np.array([0.0, 0.4, 2.0]), np.array([1.0, 3.0, 7.0]), 1.0)
    >>> b.middle_s.tolist(), b.low.tolist(), b.mean.tolist(), b.high.tolist()
    ([0.5, 2.5], [1.0, 7.0], [2.0, 7.0], [3.0, 7.0])
    """
    good = np.isfinite(values) & np.isfinite(time_s)
    number = np.floor(time_s[good] / length_s).astype(np.int64)
    order = np.argsort(number, kind="stable")
    v = values[good][order]
    found, starts, sizes = np.unique(number[order], return_index=True, return_counts=True)
    if not len(found):
        return Buckets(*(np.zeros(0) for _ in range(4)))
    return Buckets(
        np.asarray((found + 0.5) * length_s, dtype=np.float64),
        np.minimum.reduceat(v, starts),
        np.asarray(np.add.reduceat(v, starts) / sizes, dtype=np.float64),
        np.maximum.reduceat(v, starts),
    )


class Runs(NamedTuple):
    """Stretches of time in which a code stayed the same; each of shape (runs,)."""

    start_s: Floats
    length_s: Floats
    code: Ints


def _run_starts(sections: Ints, codes: Ints) -> Ints:
    return _sorted_once(np.concatenate([sections, 1 + np.flatnonzero(np.diff(codes))]), len(codes))


def runs(time_s: Floats, codes: Ints, most: int = _STRIP_RUNS) -> Runs:
    """Run lengths of `codes`; a row lasts until the next one, but not over a gap.

    When there are more than `most` runs, each of `most` buckets shows what it mostly was.

    >>> r = runs(np.array([0.0, 1.0, 2.0, 3.0]), np.array([7, 7, 5, 5]))
    >>> r.start_s.tolist(), r.length_s.tolist(), r.code.tolist()
    ([0.0, 2.0], [2.0, 2.0], [7, 5])
    """
    good = np.isfinite(time_s)
    time_s, codes = time_s[good], codes[good]
    if not len(time_s):
        return Runs(np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64))
    step_s = _step_s(time_s)
    sections = section_starts(time_s)
    starts = _run_starts(sections, codes)
    if len(starts) > most:
        edges = np.linspace(0, len(codes), most, endpoint=False).astype(np.int64)
        kinds = np.unique(codes)
        counts = np.stack([np.add.reduceat(codes == kind, edges, dtype=np.int64) for kind in kinds])
        codes = np.repeat(kinds[counts.argmax(axis=0)], np.diff(np.r_[edges, len(codes)]))
        starts = _run_starts(sections, codes)
    last = np.r_[starts[1:] - 1, len(codes) - 1]
    following = np.r_[starts[1:], len(codes) - 1]
    is_gap = np.r_[np.isin(starts[1:], sections), True]
    end_s = np.where(is_gap, time_s[last] + step_s, time_s[following])
    return Runs(time_s[starts], end_s - time_s[starts], codes[starts])
