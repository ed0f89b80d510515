"""What a log does that no signal shows: another interface first, a clock that is set; and a scale on a scale."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import short_drive as sd
from scenario_results import Called
from short_drive import CONFIG, Sent, edited

pytestmark = pytest.mark.usefixtures("without_report")


def replayed(dsz: Callable[..., Called], log: Path, config: Path, out: Path) -> dict[str, Any]:
    called = dsz("replay", log, "-c", config, "-o", out, "--json")
    assert called.code == 0, called.err
    summary: dict[str, Any] = json.loads(called.out)
    return summary


def test_frames_of_another_interface_that_came_first_are_said(
    dsz: Callable[..., Called], drive: Sequence[Sent], tmp_path: Path
) -> None:
    log, config = sd.write(tmp_path, drive, CONFIG.replace(", channel: can0", ""))
    lines = log.read_text().splitlines()
    stray = next(line for line in lines if f" {sd.WHEELS:03X}#" in line).replace("can0", "can7")
    log.write_text("\n".join([stray, *lines]) + "\n")
    [said] = [
        words for words in replayed(dsz, log, config, tmp_path / "o")["warnings"] if "on another interface" in words
    ]
    assert said.startswith(f"{sum(f' {sd.WHEELS:03X}#' in line for line in lines)} frames not used")
    assert "WHEEL_SPEEDS on can7" in said
    assert said.endswith("give their signals a channel")


@pytest.mark.parametrize(("by_s", "event", "more_s"), [(-3600, "clock_step", 0.0), (3600, "gap", 3600.0)])
def test_a_clock_that_is_set_back_is_no_time_that_passed(
    dsz: Callable[..., Called], drive: Sequence[Sent], tmp_path: Path, by_s: int, event: str, more_s: float
) -> None:
    """One that is set ahead may as well be a recorder that paused: that is time."""
    log, config = sd.write(tmp_path, drive)
    before = replayed(dsz, log, config, tmp_path / "before")["duration_s"]
    lines = log.read_text().splitlines()
    half = len(lines) // 2
    later = []
    for line in lines[half:]:
        stamp, rest = line.split(") ", 1)
        later.append(f"({float(stamp[1:]) + by_s:.6f}) {rest}")
    log.write_text("\n".join([*lines[:half], *later]) + "\n")
    summary = replayed(dsz, log, config, tmp_path / "after")
    assert {one["event"] for one in summary["events"]} == {event}
    assert summary["duration_s"] == pytest.approx(before + more_s, abs=0.1)


def test_a_scale_of_volts_on_what_is_no_voltage_is_said(
    dsz: Callable[..., Called], drive: Sequence[Sent], tmp_path: Path
) -> None:
    analog = ", volts_per_count: 7.63e-5, null_volts: 2.5, volts_per_unit: 0.007}"
    line = next(line for line in CONFIG.splitlines() if line.strip().startswith("gyro_x:"))
    log, config = sd.write(tmp_path, drive, edited(CONFIG, (line, line.rstrip("}") + analog)))
    [said] = [words for words in replayed(dsz, log, config, tmp_path / "o")["warnings"] if "volts_per_count" in words]
    assert "volts per count, but by the DBC IMU_RATES.P is in 'deg/s' already" in said
