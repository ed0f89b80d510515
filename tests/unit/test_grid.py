"""pipeline/grid: a whole recording at once is what the aligner makes of it sample by sample."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsz_daemon.pipeline.align import Aligner
from dsz_daemon.pipeline.grid import Signal, gridded, ticks_between
from dsz_daemon.pipeline.mapping import Sample

PERIOD_NS = 10_000_000
STALE_NS = 25_000_000
GAPS_NS = st.lists(st.integers(0, 60_000_000), min_size=1, max_size=40)


@pytest.mark.parametrize(("first", "ticks"), [(0, [0, 10, 20]), (1, [10, 20]), (20_000_000, [20])])
def test_ticks_are_whole_periods_inside_the_recording(first: int, ticks: list[int]) -> None:
    assert ticks_between(first, 20_000_000, PERIOD_NS).tolist() == [tick * 1_000_000 for tick in ticks]


@given(GAPS_NS, st.sampled_from(["gyro_x", "wheel_speed_fl", "brake"]), st.integers(0, 2**32))
def test_every_tick_has_the_aligners_value(gaps_ns: list[int], role: str, seed: int) -> None:
    t_ns = np.cumsum(np.array(gaps_ns, dtype=np.int64))
    values = np.random.default_rng(seed).normal(size=len(t_ns))
    ticks = np.arange(0, int(t_ns[-1]) + 8 * PERIOD_NS, PERIOD_NS, dtype=np.int64)
    found = gridded({role: Signal(t_ns, values)}, ticks, STALE_NS)[role]
    aligner, sent = Aligner(STALE_NS), 0
    for tick, value in zip(ticks.tolist(), found.tolist(), strict=True):
        while sent < len(t_ns) and t_ns[sent] <= tick:
            aligner.take(Sample(int(t_ns[sent]), role, float(values[sent])))
            sent += 1
        expected = aligner.aligned(tick)[0].get(role, float("nan"))
        assert value == pytest.approx(expected, rel=1e-12, nan_ok=True)
