"""`dsz run`: the live daemon. One thread: receive until the next tick is due, tick, publish.

Ticks are due at absolute times of the bus's clock; a tick waits a moment (`_GUARD_NS`) for
frames that are stamped before it and still on their way. Rows that come late are counted as
missed: only the newest is published, all of them are estimated.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from dsz_daemon.edge.bus import Buses
from dsz_daemon.edge.clock import Clock, WallClock
from dsz_daemon.edge.log_writer import CandumpWriter
from dsz_daemon.pipeline.cycles import CycleWatch
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.rows import Row
from dsz_daemon.runs.results import ResultFiles
from dsz_daemon.runs.setup import Setup
from dsz_daemon.runs.summary import RunSummary
from dsz_daemon.runs.truth import read_truth

_GUARD_NS = 2_000_000
_IDLE_S = 0.1
# A saturated bus has some 8 frames a millisecond: a bit more than waits after a hitch of 0.1 s.
_AT_ONCE = 1000
_LAST_ROUNDS = 100


@dataclass
class LiveOptions:
    """What a live run does besides publishing: record its input, write results, end by itself."""

    record: Path | None = None
    folder: Path | None = None
    truth: Path | None = None
    duration_s: float | None = None
    clock: Clock = field(default_factory=WallClock)
    should_stop: Callable[[], bool] = lambda: False
    on_row: Callable[[Row], None] = lambda _row: None
    on_ready: Callable[[], None] = lambda: None


class Live:
    """One live run over opened buses."""

    def __init__(self, setup: Setup, options: LiveOptions) -> None:
        self._setup, self._options, self._clock = setup, options, options.clock
        self._encoder = setup.encoder()
        self._decoder = setup.decoder(self._encoder)
        self._loop = setup.loop(self._decoder)
        self._summary = RunSummary(setup, setup.plausibility())
        self._cycles = CycleWatch(self._decoder.wanted_ids())
        self._missed = self._published = 0
        self._silent_due_ns = 0
        self._results: ResultFiles | None = None
        self._record: CandumpWriter | None = None
        self._stopped = False

    def run(self) -> dict[str, Any]:
        """Runs until stopped (signal, duration or `should_stop`); returns the summary."""
        options, arguments = self._options, {n: b.arguments for n, b in self._setup.settings.buses.items()}
        with ExitStack() as stack:
            buses = stack.enter_context(Buses(arguments))
            if options.folder is not None:
                self._results = stack.enter_context(ResultFiles(options.folder, self._setup))
            if options.record is not None:
                self._record = stack.enter_context(CandumpWriter(options.record))
            stack.enter_context(_stopping_signals(self._stop))
            options.on_ready()
            end_ns = None
            if options.duration_s is not None:
                end_ns = self._clock.now_ns() + round(options.duration_s * 1e9)
            try:
                while not self._stopped and not options.should_stop():
                    if end_ns is not None and self._clock.now_ns() >= end_ns:
                        break
                    self._cycle(buses)
                # What waits has come before the end; a bus that never falls silent must not put it off.
                for _ in range(_LAST_ROUNDS):
                    if self._receive(buses, 0.0) is not None:
                        break
                self._take(self._loop.finish(), buses)
            except KeyboardInterrupt:
                pass
            dropped = buses.dropped
        return self._concluded(dropped)

    def _stop(self) -> None:
        self._stopped = True

    def _cycle(self, buses: Buses) -> None:
        """Receives what comes until the next tick is due and what is waiting then, and ticks."""
        due_ns = self._loop.next_tick_ns
        wait_s = _IDLE_S if due_ns is None else min(_IDLE_S, self._clock.seconds_until(due_ns + _GUARD_NS))
        now_ns = self._receive(buses, wait_s)
        if now_ns is None:
            return
        self._take(self._loop.advance(now_ns - _GUARD_NS), buses)
        if now_ns >= self._silent_due_ns:
            self._say_silence(now_ns, buses)

    def _receive(self, buses: Buses, wait_s: float) -> int | None:
        """Waits for a frame, takes all that are there, of all buses in the order of their stamps.

        Returns the time up to which none is missing: asked before the queues are emptied, for frames
        go on coming meanwhile. None if they come faster than they can be taken; their stamps then
        bring the ticks due, and whoever wants to stop us is heard.
        """
        frame = buses.receive(wait_s)
        now_ns = self._clock.now_ns()
        frames: list[Frame] = []
        while frame is not None and len(frames) < _AT_ONCE:
            frames.append(frame)
            frame = buses.receive(0.0)
        if frame is not None:
            frames.append(frame)
        for waiting in sorted(frames, key=lambda waiting: waiting.t_ns):
            self._input(waiting, buses)
        return now_ns if frame is None else None

    def _input(self, frame: Frame, buses: Buses) -> None:
        if self._record is not None:
            self._record.write(frame)
        self._cycles.watch(frame)
        self._take(self._loop.frame(frame), buses)

    def _take(self, rows: list[Row], buses: Buses) -> None:
        self._missed += max(0, len(rows) - 1)
        for row in rows:
            frames = self._encoder.encode(row._replace(counters=row.counters._replace(missed_ticks=self._missed)))
            if row is rows[-1]:
                self._send(frames, buses)
            if self._results is not None:
                self._results.write(row, frames)
            self._summary.add(row)
            self._options.on_row(row)

    def _say_silence(self, now_ns: int, buses: Buses) -> None:
        """While no input comes, listeners are told so ten times a second."""
        self._silent_due_ns = now_ns + round(_IDLE_S * 1e9)
        row = self._loop.silent_row(now_ns)
        if row is not None:
            self._send(self._encoder.encode(row), buses)

    def _send(self, frames: list[Frame], buses: Buses) -> None:
        for frame in frames:
            buses.send(frame)
        self._published += len(frames)

    def _concluded(self, dropped: int) -> dict[str, Any]:
        published = {"frames": self._published, "dropped": dropped, "saturated": self._encoder.counters}
        source = {"buses": {name: bus.arguments for name, bus in self._setup.settings.buses.items()}}
        result = self._summary.result(self._decoder.counters, self._cycles, published, source, self._missed)
        if self._results is not None:
            truth = None if self._options.truth is None else read_truth(self._options.truth)
            self._results.conclude(result, f"Live run on {', '.join(self._setup.settings.buses)}", truth)
        return result


class _stopping_signals:  # noqa: N801 - reads as a verb where it is used
    """SIGTERM and SIGINT ask the loop to end; outside the main thread signals are not ours."""

    def __init__(self, stop: Callable[[], None]) -> None:
        self._stop = stop
        self._old: dict[int, Any] = {}

    def __enter__(self) -> None:
        def asked(_number: int, _frame: FrameType | None) -> None:
            self._stop()

        try:
            for number in (signal.SIGTERM, signal.SIGINT):
                self._old[number] = signal.signal(number, asked)
        except ValueError:
            self._old.clear()

    def __exit__(self, *_: object) -> None:
        for number, handler in self._old.items():
            signal.signal(number, handler)
