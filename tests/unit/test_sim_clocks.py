"""Clocks: when frames are due and stamped, counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from dsz_daemon.sim.clocks import due_us, stamped_us
from dsz_daemon.sim.sensors import UnitClock


def test_a_right_clock_keeps_period_and_phase() -> None:
    assert due_us(UnitClock(), 10, 240, 0.05).tolist() == [240, 10240, 20240, 30240, 40240]
    # What is due at the very end is not sent any more.
    assert due_us(UnitClock(), 10, 0, 0.05).tolist() == [0, 10000, 20000, 30000, 40000]
    assert due_us(UnitClock(), 20, 5300, 0.004).tolist() == []


def test_a_slow_clock_falls_behind_by_its_parts_per_million() -> None:
    slow, fast = (due_us(UnitClock(ppm, 0.004), 10, 0, 100.0) for ppm in (100.0, -100.0))
    # After 50 s of its own: 5 ms later, or earlier.
    assert slow[5000] == 50_009_000
    assert fast[5000] == 49_999_000
    # 10.001 ms a frame: 9999 begin before 99.996 s; 9.999 ms: 10001.
    assert len(slow) == 9999
    assert len(fast) == 10001
    assert np.ptp(np.diff(slow)) <= 1


def test_jitter_makes_frames_late_never_early_and_keeps_their_order() -> None:
    due = due_us(UnitClock(), 10, 0, 60.0)
    stamps = stamped_us(due, 0.002, np.random.default_rng(1))
    late = stamps - due
    assert late.min() >= 0
    assert late.max() < 2000
    assert late.mean() == pytest.approx(1000.0, rel=0.03)
    assert stamped_us(due, 0.0, np.random.default_rng(1)).tolist() == due.tolist()
    crowded = stamped_us(due, 0.1, np.random.default_rng(1))
    assert np.all(np.diff(crowded) >= 0)
    assert np.array_equal(stamps, stamped_us(due, 0.002, np.random.default_rng(1)))
