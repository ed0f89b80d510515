"""`dsz demo`, the main job on an embedded default: simulated car -> virtual CAN -> daemon -> table and report."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from dsz_daemon.config.settings import BusSettings
from dsz_daemon.edge.bus import Buses
from dsz_daemon.edge.clock import PlayedClock, ScaledClock
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.logs import read_frames
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.runs.live import Live, LiveOptions
from dsz_daemon.runs.setup import set_up
from dsz_daemon.runs.simulate import simulate

Progress = Callable[[int, int], None]

# The bus falls silent for this long before the daemon ends.
_REST_NS = 10_000_000


def demo(
    folder: Path, scenario: str = "sine_steer", seed: int = 1, speed: float = 5.0, progress: Progress | None = None
) -> dict[str, Any]:
    """Simulates a drive, plays it onto a virtual bus at `speed`, runs the live daemon on it.

    Everything is in `folder`: the drive (recording, configuration, DBC, truth) and the run's four files.
    """
    simulate(scenario, folder, seed, None if progress is None else lambda done, total: progress(done, 2 * total))
    frames = list(read_frames([folder / "recording.log"], LogReport()))
    setup = set_up(folder / "config.yaml")
    buses = {
        name: BusSettings(interface="virtual", channel=f"dsz-demo-{name}", preserve_timestamps=True)
        for name in setup.settings.buses
    }
    setup = setup.on_buses(buses)
    clock = PlayedClock(frames[0].t_ns - 1, speed)
    done = threading.Event()
    start = threading.Event()
    failure: list[BaseException] = []

    def play() -> None:
        start.wait()
        try:
            with Buses({name: bus.arguments for name, bus in buses.items()}) as out:
                _played(frames, out, clock, speed)
        except BaseException as error:  # handed to the main thread below
            failure.append(error)
        finally:
            done.set()

    player = threading.Thread(target=play, daemon=True, name="player")
    player.start()
    end_ns = frames[-1].t_ns

    def ended() -> bool:
        return bool(failure) or done.is_set()

    def shown(t_ns: int) -> None:
        if progress is not None:
            span = max(1, end_ns - frames[0].t_ns)
            progress(1000 + round(1000 * (t_ns - frames[0].t_ns) / span), 2000)

    options = LiveOptions(
        folder=folder,
        truth=folder / "truth.parquet",
        clock=clock,
        should_stop=ended,
        on_row=lambda row: shown(row.t_ns),
        on_ready=start.set,
    )
    summary = Live(setup, options).run()
    player.join()
    if failure:
        raise failure[0]
    return summary


def _played(frames: Sequence[Frame], out: Buses, clock: PlayedClock, speed: float) -> None:
    """Sends the frames at their time and moves the bus's clock along with them."""
    pace = ScaledClock(frames[0].t_ns, speed)
    for frame in frames:
        wait_s = pace.seconds_until(frame.t_ns)
        if wait_s > 0.0:
            time.sleep(wait_s)
        out.send(frame)
        clock.sent_ns = max(clock.sent_ns, frame.t_ns)
    clock.sent_ns += _REST_NS
