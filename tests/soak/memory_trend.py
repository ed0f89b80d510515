"""Whether a process's memory grows: resident bytes from /proc, and a straight line through them."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple


class Trend(NamedTuple):
    """A straight line through (time, bytes): its slope and the slope's standard error, both per hour of that time.

    `growth_bytes` is slope times the time watched; `scatter_bytes` what is left round the line.
    """

    bytes_per_hour: float
    error_bytes_per_hour: float
    growth_bytes: float
    scatter_bytes: float
    samples: int

    def is_flat(self, most_bytes: float) -> bool:
        """Whether the growth is within `most_bytes`, or can't be told from the scatter (three standard errors)."""
        hours = self.growth_bytes / self.bytes_per_hour if self.bytes_per_hour else 0.0
        return self.growth_bytes <= most_bytes + 3.0 * self.error_bytes_per_hour * hours


def rss_bytes(pid: int | str = "self") -> int:
    """Resident memory."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def descriptors(pid: int | str = "self") -> int:
    """Open file descriptors."""
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def trend(samples: Sequence[tuple[float, int]], warm_up: float = 0.1) -> Trend:
    """The line through (hours, bytes) without the first share `warm_up`. ValueError for less than three samples.

    >>> line = trend([(h / 10, 10_000_000 + 1000 * h) for h in range(100)])
    >>> round(line.bytes_per_hour), round(line.growth_bytes), line.is_flat(1e6), line.is_flat(1e4)
    (10000, 89000, True, False)
    """
    late = samples[int(len(samples) * warm_up) :]
    n = len(late)
    if n < 3:
        raise ValueError(f"{n} samples; expected 3 or more")
    mean_x, mean_y = sum(x for x, _ in late) / n, sum(y for _, y in late) / n
    spread = sum((x - mean_x) ** 2 for x, _ in late)
    slope = sum((x - mean_x) * (y - mean_y) for x, y in late) / spread
    rest = sum((y - mean_y - slope * (x - mean_x)) ** 2 for x, y in late)
    scatter = math.sqrt(rest / (n - 2))
    return Trend(slope, scatter / math.sqrt(spread), slope * (late[-1][0] - late[0][0]), scatter, n)
