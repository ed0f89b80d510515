"""A live run over a virtual bus, in real time, and the replay of what it recorded agree row for row."""

from __future__ import annotations

import threading
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dsz_daemon.config.settings import BusSettings
from dsz_daemon.edge.bus import Buses
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.logs import read_frames
from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.runs.live import Live, LiveOptions
from dsz_daemon.runs.replay import replay
from dsz_daemon.runs.setup import set_up

GOLDEN = Path(__file__).parents[1] / "golden"
CONFIG = GOLDEN / "sine_steer" / "config.yaml"


@pytest.mark.parametrize("start_s", [6.0, 11.0])
def test_live_over_a_virtual_bus_equals_replay_row_for_row(tmp_path: Path, start_s: float) -> None:
    frames = list(read_frames([GOLDEN / "sine_steer.log.gz"], LogReport()))
    first_ns = frames[0].t_ns + round(start_s * 1e9)
    frames = [frame for frame in frames if first_ns <= frame.t_ns < first_ns + 2_000_000_000]
    bus = BusSettings(interface="virtual", channel=f"row-for-row-{start_s}")
    setup = set_up(CONFIG).on_buses({"can0": bus})
    ready, done = threading.Event(), threading.Event()

    def play() -> None:
        ready.wait()
        with Buses({"can0": bus.arguments}) as out:
            begin = time.monotonic()
            for frame in frames:
                time.sleep(max(0.0, begin + (frame.t_ns - first_ns) * 1e-9 - time.monotonic()))
                out.send(frame)
            time.sleep(0.05)
        done.set()

    player = threading.Thread(target=play, daemon=True)
    player.start()
    options = LiveOptions(
        record=tmp_path / "seen.log", folder=tmp_path / "live", should_stop=done.is_set, on_ready=ready.set
    )
    summary = Live(setup, options).run()
    player.join()
    assert summary["counts"]["frames"] == len(frames)

    replay([tmp_path / "seen.log"], CONFIG, tmp_path / "replayed")
    live, again = (read_samples(tmp_path / name / "samples.parquet") for name in ("live", "replayed"))
    rows = len(again["time_s"])
    assert rows > 190
    # The live clock goes on past the last frame; a replay ends with it.
    assert rows <= len(live["time_s"]) <= rows + 20
    # The player gives the log's stamps up for the bus's own, so that rows are late by what the machine is:
    # frames that were still on their way when their tick was due are the one honest difference. None were.
    assert live.keys() == again.keys()
    for name in again:
        np.testing.assert_array_equal(live[name][:rows], again[name], err_msg=name)


def test_what_is_published_live_is_what_replay_writes(tmp_path: Path) -> None:
    """Both write compensated.log; times come from the grid, payloads from the same encoder."""
    out = tmp_path / "replayed"
    replay([GOLDEN / "sine_steer.log.gz"], CONFIG, out)
    frames = list(read_frames([out / "compensated.log"], LogReport()))
    stamps = sorted({frame.t_ns for frame in frames})
    assert all(later - earlier == 10_000_000 for earlier, later in pairwise(stamps))
