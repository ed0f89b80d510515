"""How late the loop's ticks were: a histogram whose size does not grow, for percentiles at any time."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field

# Bins a tenth of a decade wide from 1 us to 100 s: a percentile read from them is at most 26 % too high.
_BINS_PER_DECADE = 10
_EDGES_US = tuple(10.0 ** (n / _BINS_PER_DECADE) for n in range(8 * _BINS_PER_DECADE + 1))


@dataclass
class Lateness:
    """Times by which ticks came late, in microseconds; `counts[n]` are those below the n-th upper edge."""

    counts: list[int] = field(default_factory=lambda: [0] * (len(_EDGES_US) + 1))
    total: int = 0
    sum_us: float = 0.0
    max_us: float = 0.0

    def add(self, late_us: float) -> None:
        """Takes one tick into account; one that came early (a clock's jitter) counts as on time."""
        self.total += 1
        late_us = max(0.0, late_us)
        self.sum_us += late_us
        self.max_us = max(self.max_us, late_us)
        self.counts[bisect_left(_EDGES_US, late_us)] += 1

    def percentile_us(self, percent: float) -> float:
        """Upper edge of the bin that holds the percentile, never above the maximum; 0 if nothing was added."""
        wanted, seen = self.total * percent / 100.0, 0
        for n, count in enumerate(self.counts):
            seen += count
            if count and seen >= wanted:
                return min(self.max_us, _EDGES_US[n]) if n < len(_EDGES_US) else self.max_us
        return 0.0

    def bins(self) -> list[tuple[float, int]]:
        """(upper edge in us, count) of all bins that are not empty."""
        edges = (*_EDGES_US, float("inf"))
        return [(edge, count) for edge, count in zip(edges, self.counts, strict=True) if count]
