"""Some minutes of the soak, and its judge put to the test."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import soak
from memory_trend import trend
from soak import Soaked

MIB = 2**20


def test_some_minutes_of_bus_time_are_flat_and_consistent(tmp_path: Path) -> None:
    # In a process of its own: what other tests left behind in this one is given back, and taken, at any time.
    out = tmp_path / "soaked.json"
    ran = subprocess.run(
        [sys.executable, soak.__file__, "--hours", "0.02", "--lap", "12", "-o", str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "counters consistent" in ran.stdout, ran.stdout + ran.stderr
    done = json.loads(out.read_text(encoding="utf-8"))
    assert done["rows"] == round(done["hours"] * 3600 * 100) == 7200
    # Memory comes in arenas of a mebibyte, six laps are few. Blocks are counted to the one: a lap has 1200 ticks.
    assert trend(done["rss"]).growth_bytes < 4 * MIB
    assert done["blocks"][-1] - done["blocks"][1] < 24


def test_a_leak_of_a_kilobyte_a_minute_is_seen_over_a_day() -> None:
    rss = [(k / 60, 100 * MIB + 1024 * k + (k % 3) * 4096) for k in range(24 * 60)]
    line = trend(rss)
    assert line.bytes_per_hour == pytest.approx(60 * 1024, rel=0.01)
    assert not line.is_flat(soak.MOST_GROWTH_BYTES)


def test_scatter_alone_is_flat() -> None:
    rss = [(k / 60, 100 * MIB + (k * 7919 % 13) * 65536) for k in range(24 * 60)]
    assert trend(rss).is_flat(soak.MOST_GROWTH_BYTES)


def test_counts_that_do_not_add_up_are_told() -> None:
    good = [(k / 60, 100 * MIB) for k in range(60)]
    assert soak.conclusion(Soaked(1.0, 60.0, 1, 1, 1, [], good))[0]
    verdict, words = soak.conclusion(Soaked(1.0, 60.0, 1, 1, 1, ["rows: 1 and 2"], good))
    assert not verdict
    assert "NOT CONSISTENT: rows: 1 and 2" in words
