"""The watcher of a running daemon, on a stand-in for one: this process and made-up answers."""

from __future__ import annotations

import copy
import mmap
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import live_soak
import pytest

ANSWER: dict[str, Any] = {
    "phase": "running", "rate_hz": 100.0, "rows": 1000, "missed_ticks": 0, "timer_overruns": 0, "reloads": 0,
    "row": {"time_s": 1.7e9},
    "buses": [{"name": "can0", "received": 5000, "lost": 0, "link": "up"}],
    "decoder": {
        "frames": 130, "unwanted": 10, "own": 5, "remote": 3, "error_frames": 2, "ambiguous": 0,
        "messages": {"K": {"frames": 100, "refused": 10}},
        "roles": {"gyro_z": {"samples": 90, "rejected": 10, "not_present": 0}},
    },
}  # fmt: skip


def after(seconds: float, **changes: Any) -> dict[str, Any]:
    answer = copy.deepcopy(ANSWER)
    answer["rows"] += round(seconds * 100)
    answer["row"]["time_s"] += seconds
    return {**answer, **changes}


def test_a_daemon_that_goes_on_has_no_faults() -> None:
    assert live_soak.counter_faults(ANSWER, {}) == []
    assert live_soak.counter_faults(after(1.0), ANSWER) == []


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"rows": 1090}, "rows where"),
        ({"rows": 900}, "rows fell"),
        ({"missed_ticks": -1}, "missed_ticks fell"),
        ({"buses": [{"name": "can0", "received": 4999, "lost": 0, "link": "up"}]}, "received fell"),
        ({"decoder": {**ANSWER["decoder"], "frames": 131}}, "131 frames decoded, 130 accounted for"),
        (
            {"decoder": {**ANSWER["decoder"], "roles": {"r": {"samples": 90, "rejected": 99, "not_present": 0}}}},
            "at most",
        ),
    ],
)
def test_what_does_not_add_up_is_told(changes: dict[str, Any], word: str) -> None:
    assert any(word in fault for fault in live_soak.counter_faults(after(1.0, **changes), ANSWER))


def test_this_process_watched_for_a_moment_and_while_it_leaks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A test's process does other things, too.
    monkeypatch.setattr(live_soak, "MOST_GROWTH_BYTES", 2 * 2**20)
    times: Iterator[int] = iter(range(10_000))
    kept: list[mmap.mmap] = []

    def answers(_path: Path) -> dict[str, Any]:
        return after(0.1 * next(times))

    def leaking(path: Path) -> dict[str, Any]:
        # Pages of its own: what earlier tests freed would be used again, and not show.
        kept.append(mmap.mmap(-1, 500_000))
        kept[-1].write(b"x" * 500_000)
        return answers(path)

    assert live_soak.watch(os.getpid(), tmp_path, 0.5, 0.02, answers).faults == []
    assert any("memory grows" in fault for fault in live_soak.watch(os.getpid(), tmp_path, 1.0, 0.02, leaking).faults)
