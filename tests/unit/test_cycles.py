"""pipeline/cycles: what is missing from a cycle, and histograms that stay small however long a daemon runs."""

from __future__ import annotations

import pickle
import random

import pytest

from dsz_daemon.pipeline.cycles import CycleWatch
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.histogram import Histogram

MS = 1_000_000
ID = 0x123


def watched(gaps_ms: list[float]) -> CycleWatch:
    watch, t_ns = CycleWatch(frozenset({(ID, False)})), 10**18
    for gap_ms in [0.0, *gaps_ms]:
        t_ns += round(gap_ms * MS)
        watch.watch(Frame(t_ns, "can0", ID, bytes(8)))
    return watch


def test_missing_frames_and_the_longest_gap() -> None:
    """Of a cycle of 10 ms a gap of 30 misses two and one of 271.8 misses 26: as long as it was, not rounded."""
    (cycle,) = watched([10.0] * 50 + [30.0] + [10.0] * 50 + [271.8, 10.0]).cycles()
    assert cycle.cycle_s == pytest.approx(0.010)
    assert cycle.missing == 2 + 26
    assert cycle.longest_gap_s == pytest.approx(0.2718)


def test_a_histogram_takes_its_room_at_once_and_never_more() -> None:
    """Pauses of every length up to an hour, in 0.1 ms; what a daemon for weeks may meet."""
    dice = random.Random(4)
    seen = Histogram()
    before = len(pickle.dumps(seen.__dict__))
    for _ in range(40_000):
        seen.add(round(10.0 ** dice.uniform(0.0, 7.5)))
    assert abs(len(pickle.dumps(seen.__dict__)) - before) < 100
    assert sum(count for _, count in seen.items()) == seen.total == 40_000


@pytest.mark.parametrize("digits", [2, 3])
def test_a_number_is_rounded_to_its_digits_and_never_further_off(digits: int) -> None:
    for number in [*range(0, 20_000, 7), 99, 999, 1000, 9_949, 9_951, 999_499, 999_500, 36_000_001]:
        seen = Histogram(digits, decades=7)
        seen.add(number)
        ((found, count),) = seen.items()
        assert count == 1
        assert seen.median() == found
        assert abs(found - number) <= (0 if number < 10**digits else 5.0 * 10.0**-digits * number), number
    largest = Histogram(digits, decades=2)
    largest.add(10**12)
    assert largest.items() == [(10 ** (digits + 2), 1)]
