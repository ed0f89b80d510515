"""pipeline/cycles: what is missing from a cycle, and histograms that stay small however long a daemon runs."""

from __future__ import annotations

import random

import pytest

from dsz_daemon.pipeline.cycles import CycleWatch, binned
from dsz_daemon.pipeline.frames import Frame

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


def test_gaps_of_all_lengths_take_no_more_room_than_some_thousand() -> None:
    """A bus of hours with pauses of every length up to one: 1000 lengths below 0.1 s, 900 a decade above."""
    dice = random.Random(4)
    watch = watched([10.0 ** dice.uniform(0.0, 6.5) for _ in range(40_000)])
    (gaps,) = watch.seen.values()
    assert gaps.frames == 40_001
    assert len(gaps.gaps) < 1000 + 900 * 5


def test_a_number_is_rounded_to_three_digits_and_never_further_off() -> None:
    for number in [*range(0, 20_000, 7), 999_499, 999_500, 36_000_001]:
        assert abs(binned(number) - number) <= 0.005 * number
    assert {binned(n) for n in range(1000)} == set(range(1000))
    assert len({binned(n) for n in range(3_600_000)}) < 1000 + 900 * 4
