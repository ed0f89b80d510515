"""`dsz replay`: the same loop over a recording, as fast as it goes, or at a pace onto a bus."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from dsz_daemon.config.load import parsed_bus
from dsz_daemon.edge.bus import Buses
from dsz_daemon.edge.clock import Clock, ScaledClock
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.logs import read_frames
from dsz_daemon.errors import ConfigError, InputError
from dsz_daemon.pipeline.cycles import CycleWatch
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.rows import Row
from dsz_daemon.runs.never_received import hints
from dsz_daemon.runs.results import RESULT_NAMES, ResultFiles
from dsz_daemon.runs.setup import set_up
from dsz_daemon.runs.summary import RunSummary
from dsz_daemon.runs.truth import read_truth

Progress = Callable[[int, int], None]


def replay(
    logs: Sequence[Path],
    config: Path,
    folder: Path,
    speed: float | None = None,
    to: str | None = None,
    progress: Progress | None = None,
    truth: Path | None = None,
) -> dict[str, Any]:
    """Runs the loop over `logs` (one recording in pieces) and writes the four result files.

    `speed` 1 is real time, None as fast as it goes; `to` plays the recording and the compensated
    frames onto a bus; `truth` (the simulator's truth.parquet) adds the errors. Returns the summary.
    A Ctrl-C ends the run early; what was done is kept and
    the summary says `interrupted`.
    """
    setup = set_up(config)
    known = None if truth is None else read_truth(truth)
    _keep_input(logs, folder)
    encoder = setup.encoder()
    decoder = setup.decoder(encoder)
    loop = setup.loop(decoder)
    report = LogReport()
    wanted = {can_id for can_id, _ in decoder.wanted_ids() | encoder.published_ids} if to is None else None
    frames = read_frames(logs, report, progress, wanted)
    summary, cycles = RunSummary(setup, setup.plausibility()), CycleWatch(decoder.wanted_ids())
    interrupted, published_frames = False, 0
    with ExitStack() as stack:
        results = stack.enter_context(ResultFiles(folder, setup))
        player = stack.enter_context(Player(to)) if to is not None else None

        def take(rows: list[Row]) -> None:
            nonlocal published_frames
            for row in rows:
                published = encoder.encode(row)
                published_frames += len(published)
                results.write(row, published)
                summary.add(row)
                if player is not None:
                    player.play(published)

        try:
            for frame in _paced(frames, speed if speed is not None or to is None else 1.0):
                cycles.watch(frame)
                take(loop.frame(frame))
                if player is not None:
                    player.play([frame])
            take(loop.finish())
        except KeyboardInterrupt:
            interrupted = True
    source = {"recording": [path.name for path in logs], "log": report.summary(), "interrupted": interrupted}
    decoded = decoder.counters
    # Frames that nobody wants were dropped while reading; they count all the same.
    decoded.unwanted += report.frames - decoded.frames
    decoded.frames = report.frames
    result = summary.result(decoded, cycles, {"frames": published_frames, "saturated": encoder.counters}, source)
    result["recording"] = source["recording"]
    result["warnings"] = [*report.words(), *result["warnings"]]
    if interrupted:
        result["warnings"].insert(0, "interrupted: only the part of the recording up to then was replayed")
    if summary.rows == 0 and not interrupted:
        nothing = _nothing_wanted(logs, report, decoder.wanted_ids(), decoded.samples)
        raise InputError(nothing + hints(setup, decoded))
    results.conclude(result, f"Replay of {', '.join(path.name for path in logs)}", known)
    return result


def _keep_input(logs: Sequence[Path], folder: Path) -> None:
    """A recording called as one of the results, in their folder, would be gone before it is read."""
    for log in logs:
        if log.name in RESULT_NAMES and log.resolve().parent == folder.resolve():
            raise ConfigError(f"{log}: the results would be written over it; expected another folder for -o")


class Player:
    """Sends frames onto one bus, named as on the command line (`vcan0`, `virtual:demo`)."""

    def __init__(self, bus: str) -> None:
        name = bus if ":" in bus else f"socketcan:{bus}"
        try:
            _, settings = parsed_bus(f"out={name}")
        except ValueError:
            raise ConfigError(
                f"--to {bus!r}: expected a SocketCAN interface, or INTERFACE:CHANNEL, e.g. vcan0 or virtual:demo"
            ) from None
        self._buses = Buses({"out": settings.arguments})

    def __enter__(self) -> Player:
        return self

    def __exit__(self, *_: object) -> None:
        self._buses.close()

    def play(self, frames: Sequence[Frame]) -> None:
        """Sends the frames now; error frames are a bus's own and can't be sent."""
        for frame in frames:
            if not frame.is_error:
                self._buses.send(frame._replace(channel="out"))


def _paced(frames: Iterator[Frame], speed: float | None) -> Iterator[Frame]:
    """The same frames, each no sooner than its stamp says at this speed."""
    if speed is None:
        yield from frames
        return
    clock: Clock | None = None
    for frame in frames:
        if clock is None:
            clock = ScaledClock(frame.t_ns, speed)
        wait_s = clock.seconds_until(frame.t_ns)
        if wait_s > 0.0:
            time.sleep(wait_s)
        yield frame


def _nothing_wanted(logs: Sequence[Path], report: LogReport, wanted: frozenset[tuple[int, bool]], samples: int) -> str:
    names = ", ".join(str(path) for path in logs)
    if samples:
        return f"{names}: too short: {samples} values, but not one step of the loop between the first and the last"
    ids = ", ".join(f"{can_id:08X}" if extended else f"{can_id:03X}" for can_id, extended in sorted(wanted)[:12])
    channels = ", ".join(sorted(report.channels))
    return (
        f"{names}: none of its {report.frames} frames (channels {channels}) is one that the configuration maps; "
        f"expected ids {ids}, on the configured channels"
    )
