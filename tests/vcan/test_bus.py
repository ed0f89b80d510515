"""On a kernel's own vcan0: what `dsz run` sends is what `dsz replay` makes of the same bus, frame by frame."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import cantools
import e2e.p02
import pytest

from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.logs import read_frames
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.runs.replay import replay
from dsz_daemon.shipped import shipped

ROOT = Path(__file__).parents[2]
GUEST = ROOT / "tests" / "vcan" / "guest"
RAV4 = ROOT.parent / "shared" / "data" / "rav4_highway" / "recording.log"
NO_WAY = 77

pytestmark = [pytest.mark.vcan, pytest.mark.xdist_group("guest")]


def played(log: Path, channels: str, config: Path, out: Path, who: str, seconds: int) -> dict[str, Any]:
    """Plays `log` in the guest; returns what the run cost. Skips, with the reason, where there is no vcan."""
    out.mkdir(parents=True, exist_ok=True)
    inside = ["tests/vcan/bus_run.py", str(log), channels, str(config), str(out), who, str(seconds)]
    command = [str(GUEST), "-t", "280", "-w", str(out), sys.executable, *inside]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    if done.returncode == NO_WAY:
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stderr
    return dict(json.loads((out / "cost.json").read_text()))


def same_as_replay(out: Path, config: Path, ids: dict[int, Any]) -> tuple[int, int]:
    """Compares the bus's output with a replay of its input; returns (frames compared, frames that differ)."""
    bus = list(read_frames([out / "bus.log"], LogReport()))
    ours = [frame for frame in bus if frame.can_id in ids and len(frame.data) == 8 and is_ours(frame, ids)]
    (out / "input.log").write_text(
        "".join(
            f"({frame.t_ns // 10**9}.{frame.t_ns % 10**9 // 1000:06d}) can0 {frame.can_id:03X}#{frame.data.hex()}\n"
            for frame in bus
            if frame.can_id not in ids
        )
    )
    replay([out / "input.log"], config, out / "replayed")
    again = list(read_frames([out / "replayed" / "compensated.log"], LogReport()))
    compared = different = 0
    for can_id, message in ids.items():
        live = [frame.data for frame in ours if frame.can_id == can_id]
        wanted = [frame.data for frame in again if frame.can_id == can_id]
        # The run goes on for some ticks after the last frame; the witness may have come after the first.
        assert len(live) >= len(wanted) - 1
        for one, other in zip(live, wanted, strict=False):
            values, expected = (message.decode(data, decode_choices=False) for data in (one, other))
            compared += 1
            different += any(
                abs(values[signal.name] - expected[signal.name]) > signal.scale * 1.001 for signal in message.signals
            )
    return compared, different


def is_ours(frame: Frame, ids: dict[int, Any]) -> bool:
    """By its CRC: real cars have messages of their own with these ids."""
    data_id = 0x40 + frame.can_id - min(ids)
    return bool(e2e.p02.e2e_p02_check(frame.data, bytes([data_id] * 16)))


@pytest.fixture(scope="module")
def messages() -> dict[int, Any]:
    database = cantools.database.load_file(shipped("dbc/dsz.dbc"))
    return {message.frame_id: message for message in database.messages}


def test_the_simulated_car_live_on_vcan_equals_replay(tmp_path: Path, messages: dict[int, Any]) -> None:
    log = tmp_path / "drive.log"
    frames = subprocess.run(
        ["gzip", "-dc", str(ROOT / "tests/golden/sine_steer.log.gz")], capture_output=True, text=True, check=True
    ).stdout.splitlines(keepends=True)
    log.write_text("".join(frames[: len(frames) // 2]))
    config = ROOT / "tests/golden/sine_steer/config.yaml"
    cost = played(log, "can0", config, tmp_path / "out", "dsz", 30)
    assert cost["exit"] == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert {bus["stamps"] for bus in summary["live"]["buses"].values()} == {"kernel"}
    assert sum(bus["lost"] + bus["dropped"] for bus in summary["live"]["buses"].values()) == 0
    counters = [
        frame.data[1] & 0x0F
        for frame in read_frames([tmp_path / "out" / "bus.log"], LogReport())
        if frame.can_id == min(messages)
    ]
    if summary["counts"]["missed"] == 0:
        assert all((later - earlier) % 16 == 1 for earlier, later in pairwise(counters))
        compared, different = same_as_replay(tmp_path / "out", config, messages)
        assert compared > 3000
        assert different == 0
    else:
        pytest.skip(f"{summary['counts']['missed']} ticks were missed on this busy machine: nothing to compare with")
