"""An offset that jumps once, or there and back: a sensor that was knocked, or switched."""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import Bools, Ints
from dsz_daemon.diagnose.simulation.drive import Floats

# So far from both ends, and by so many times as much as what is left beside it wanders (rms of blocks' means): a slow
# noise's largest step.
_SHORTEST_S, _FAR_BEYOND = 10.0, 8.0
# Of a stay so many pieces are tried to begin and end with, and so many parts of it are alike to within so much.
_PIECES, _PARTS, _EVEN = 300, 5, 0.3


def jump_in(left: Floats, at: Ints, block: Ints) -> int | None:
    """Where, on the recording's grid, what is left (k,) of a channel jumps; None where it does not.

    `at` (k,): places on that grid; `block` (k,) of the rows. The place is the one that two means explain most by.
    """
    n = len(left)
    sums = np.cumsum(left)
    before = np.arange(1, n)
    means = sums[:-1] / before, (sums[-1] - sums[:-1]) / (n - before)
    taken = (means[1] - means[0]) ** 2 * before * (n - before)
    far = (at[1:] - at[0] > _SHORTEST_S / DT_S) & (at[-1] - at[1:] > _SHORTEST_S / DT_S)
    if not far.any():
        return None
    place = int(np.argmax(np.where(far, taken, -1.0)))
    return int(at[place + 1]) if _is_beyond(left, np.arange(n) > place, block) else None


def stay_in(left: Floats, at: Ints, block: Ints) -> tuple[int, int] | None:
    """Between which places on the recording's grid what is left (k,) stays elsewhere; None where it does not.

    Of all stretches that are long enough, and leave enough before and after them, the one that two means explain most
    by: first of pieces, whose ends are moved by a row at a time then.
    """
    n = len(left)
    sums, rows = np.concatenate(([0.0], np.cumsum(left))), np.arange(n + 1)

    def taken(begin: Ints, end: Ints) -> Floats:
        inside = end - begin
        mean = (sums[end] - sums[begin]) / np.maximum(inside, 1), (sums[-1] - sums[end] + sums[begin]) / (n - inside)
        far = (at[end - 1] - at[begin] > _SHORTEST_S / DT_S) & (at[begin] - at[0] > _SHORTEST_S / DT_S)
        far &= at[-1] - at[end - 1] > _SHORTEST_S / DT_S
        return np.where(far, (mean[1] - mean[0]) ** 2 * inside * (n - inside), -1.0)

    piece = max(n // _PIECES, 1)
    places = rows[:n:piece]
    begins, ends = (some.ravel() for some in np.meshgrid(places[:-1], places[1:], indexing="ij"))
    begins, ends = begins[ends > begins], ends[ends > begins]
    if len(begins) == 0 or float(np.max(of_all := taken(begins, ends))) <= 0.0:
        return None
    begin, end = int(begins[np.argmax(of_all)]), int(ends[np.argmax(of_all)])
    for _ in range(2):
        near = np.arange(max(begin - piece, 0), min(begin + piece, end - 1) + 1)
        begin = int(near[np.argmax(taken(near, np.full(len(near), end)))])
        near = np.arange(max(end - piece, begin + 1), min(end + piece, n) + 1)
        end = int(near[np.argmax(taken(np.full(len(near), begin), near))])
    inside = (np.arange(n) >= begin) & (np.arange(n) < end)
    # It stays: what is shorter, or comes and goes smoothly, is not as far off in all of it.
    outside = float(np.mean(left[~inside]))
    parts = np.array([np.mean(part) for part in np.array_split(left[inside], _PARTS)]) - outside
    stays = float(np.ptp(parts)) < _EVEN * abs(float(np.mean(parts)))
    return (int(at[begin]), int(at[end - 1]) + 1) if stays and _is_beyond(left, inside, block) else None


def _is_beyond(left: Floats, there: Bools, block: Ints) -> bool:
    """Whether what is left is elsewhere where it is said to be `there` (k,) by far more than it wanders beside that."""
    means = float(np.mean(left[~there])), float(np.mean(left[there]))
    beside = left - np.where(there, means[1], means[0])
    count = np.bincount(block)
    whole = count > 0.5 * np.max(count)
    wander = float(np.std((np.bincount(block, beside) / np.maximum(count, 1))[whole]))
    jumped = abs(means[1] - means[0])
    return jumped > _FAR_BEYOND * wander and jumped > 0.0
