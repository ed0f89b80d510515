"""`dsz run`: the live daemon. One thread: wait for frames or the next tick, tick, publish, attend to the rest.

Ticks are due at absolute times of the bus's clock; a tick waits a moment (`loop.guard_s`) for
frames that are stamped before it and still on their way. Where the machine held the loop up, all
rows are estimated; the newest is published, and the one before it, for a receiver is better served
with a row up to two periods late than with a hole. Older ones are of no use: they count as missed.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dsz_daemon.core.outputs import ChannelState
from dsz_daemon.core.state import EstimatorState
from dsz_daemon.edge.bus import Buses
from dsz_daemon.edge.clock import Clock, WallClock
from dsz_daemon.edge.journal import Priority
from dsz_daemon.edge.log_writer import CandumpWriter
from dsz_daemon.edge.wake import Wake
from dsz_daemon.errors import ConfigError
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.lateness import Lateness
from dsz_daemon.pipeline.rows import Row
from dsz_daemon.runs.chain import Chain
from dsz_daemon.runs.conflict import OutputConflict
from dsz_daemon.runs.facts import LiveFacts, StateFacts
from dsz_daemon.runs.results import ResultFiles
from dsz_daemon.runs.service import Service
from dsz_daemon.runs.setup import Setup
from dsz_daemon.runs.truth import read_truth

_IDLE_S = 0.1
# A waking costs more than a frame: those of this time are taken at once (18 on a saturated bus of 500 kbit/s, which
# has one every 0.11 ms), and a tick that falls due meanwhile has no more of them to take before it.
_GATHER_S = 0.002
# A saturated bus has some 8 frames a millisecond: a bit more than waits after a hitch of 0.1 s.
_AT_ONCE = 1000
_LAST_ROUNDS = 100
# Rows published at once after a hitch; older ones are missed.
_AT_MOST_LATE = 2
_ENDING = {signal.SIGTERM, signal.SIGINT}


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
    """One live run; opens its buses, and closes them. `service` is what surrounds it."""

    def __init__(self, setup: Setup, options: LiveOptions, service: Service | None = None) -> None:
        self._options, self._clock = options, options.clock
        self._service = service or Service()
        self._started_ns = self._clock.now_ns()
        self._chain = Chain.begun(setup, self._service.restored(setup, self._started_ns))
        self._conflict = OutputConflict(setup.settings.output.on_conflict)
        self._lateness = Lateness()
        self._rows = self._missed = self._published = 0
        self._silent_due_ns = 0
        self._last: Row | None = None
        self._ever_valid = False
        self._results: ResultFiles | None = None
        self._record: CandumpWriter | None = None

    @property
    def setup(self) -> Setup:
        """The configuration in force."""
        return self._chain.setup

    @property
    def estimator(self) -> EstimatorState:
        """What is learnt so far."""
        return self._chain.loop.memory.estimator

    def run(self) -> dict[str, Any]:
        """Runs until stopped (signal, duration or `should_stop`); returns the summary."""
        options = self._options
        with ExitStack() as stack:
            self._buses = self._opened(self.setup)
            stack.callback(self._closed)
            if options.folder is not None:
                self._results = stack.enter_context(ResultFiles(options.folder, self.setup))
            if options.record is not None:
                self._record = stack.enter_context(CandumpWriter(options.record))
            self._wake = stack.enter_context(Wake(self._chain.period_ns))
            options.on_ready()
            end_ns = None
            if options.duration_s is not None:
                end_ns = self._clock.now_ns() + round(options.duration_s * 1e9)
            try:
                while not self._wake.asked & _ENDING and not options.should_stop():
                    if end_ns is not None and self._clock.now_ns() >= end_ns:
                        break
                    self._cycle()
                # What waits has come before the end; a bus that never falls silent must not put it off.
                for _ in range(_LAST_ROUNDS):
                    if self._receive() is not None:
                        break
                self._take(self._chain.loop.finish())
            except KeyboardInterrupt:
                pass
            self._service.end(self, self._clock.now_ns())
        return self._concluded()

    def _closed(self) -> None:
        self._buses.close()

    def _opened(self, setup: Setup) -> Buses:
        settings, chain = setup.settings, self._chain
        wait = settings.service.wait_for_bus
        return Buses(
            {name: bus.arguments for name, bus in settings.buses.items()},
            None if self._options.record is not None else dict.fromkeys(settings.buses, chain.decoder.wanted_ids()),
            chain.encoder.published_ids,
            setup.output_bus,
            self._service.is_service if wait is None else wait,
        )

    def _cycle(self) -> None:
        """Waits until the next tick is due or frames have come, takes them, ticks, attends to the rest."""
        loop = self._chain.loop
        self._wait(loop.next_tick_ns)
        step_ns = self._clock.look()
        now_ns = self._receive()
        rows_before = self._rows
        if now_ns is not None:
            self._take(loop.advance(now_ns - self._chain.guard_ns))
            if now_ns >= self._silent_due_ns:
                self._say_silence(now_ns)
        is_healthy = self._rows > rows_before or now_ns is not None
        now_ns = self._clock.now_ns()
        if step_ns:
            self._say_step(step_ns, now_ns)
        self._follow_conflict(now_ns)
        self._buses.tend()
        self._service.attend(self, now_ns, is_healthy, self._wake.asked)

    def _wait(self, due_ns: int | None) -> None:
        wait_s = _IDLE_S
        if due_ns is not None:
            wait_s = min(_IDLE_S, self._clock.seconds_until(due_ns + self._chain.guard_ns))
        descriptors = self._buses.descriptors()
        if descriptors is None:
            self._buses.wait(wait_s)
            self._wake.watch(())
            self._wake.wait(0.0)
            return
        self._wake.watch(descriptors)
        gather_s = 0.0
        if isinstance(self._clock, WallClock):
            gather_s = _GATHER_S
            if due_ns is None:
                self._wake.timer.rest()
            else:
                # The kernel's timer is exact; epoll's own timeout counts whole milliseconds.
                self._wake.timer.aim(self._clock.boot_ns(due_ns + self._chain.guard_ns))
                wait_s = _IDLE_S if wait_s > 0.0 else 0.0
        self._wake.wait(wait_s, gather_s)

    def _receive(self) -> int | None:
        """Takes all frames that are there, of all buses in the order of their stamps.

        Returns the time up to which none is missing: asked before the queues are emptied, for frames
        go on coming meanwhile. None if they come faster than they can be taken; their stamps then
        bring the ticks due, and whoever wants to stop us is heard.
        """
        now_ns = self._clock.now_ns()
        frames = self._buses.receive(_AT_ONCE)
        bus_time_ns, taken_ns = self._clock.bus_time_ns, self._clock.now_ns()
        for frame in frames if len(frames) < 2 else sorted(frames, key=lambda waiting: waiting.t_ns):
            t_ns = bus_time_ns(frame.t_ns, taken_ns)
            self._input(frame if t_ns == frame.t_ns else frame._replace(t_ns=t_ns))
        return now_ns if len(frames) < _AT_ONCE else None

    def _input(self, frame: Frame) -> None:
        if self._record is not None:
            self._record.write(frame)
        self._chain.cycles.watch(frame)
        self._take(self._chain.loop.frame(frame))

    def _take(self, rows: list[Row]) -> None:
        if not rows:
            return
        missed = max(0, len(rows) - _AT_MOST_LATE)
        self._missed += missed
        self._rows += len(rows)
        chain = self._chain
        for number, row in enumerate(rows):
            frames = chain.encoder.encode(row._replace(counters=row.counters._replace(missed_ticks=self._missed)))
            if number >= missed:
                self._send(frames)
                self._lateness.add((self._clock.now_ns() - row.t_ns - chain.guard_ns) * 1e-3)
            if self._results is not None:
                self._results.write(row, frames)
            chain.summary.add(row)
            self._options.on_row(row)
        self._last = rows[-1]
        if not self._ever_valid:
            self._ever_valid = any(channel.state is not ChannelState.INVALID for channel in rows[-1].output.channels)

    def _say_silence(self, now_ns: int) -> None:
        """While no input comes, listeners are told so ten times a second."""
        self._silent_due_ns = now_ns + round(_IDLE_S * 1e9)
        row = self._chain.loop.silent_row(now_ns)
        if row is not None:
            self._send(self._chain.encoder.encode(row))

    def _send(self, frames: list[Frame]) -> None:
        refused = self._conflict.refused
        if refused:
            frames = [frame for frame in frames if frame.can_id not in refused]
        self._published += self._buses.send_all(frames)

    def _say_step(self, step_ns: int, now_ns: int) -> None:
        message = f"the machine's clock was set by {step_ns * 1e-9:+.3f} s: bus time goes on as before"
        self._service.journal.say(Priority.NOTICE, "clock_set", message, now_ns)

    def _follow_conflict(self, now_ns: int) -> None:
        conflict, chain = self._conflict, self._chain
        conflict.follow(self._buses.foreign, now_ns)
        if conflict.wants_to_move:
            chain.encoder = chain.setup.encoder(chain.encoder.state, spare=True)
            wanted = dict.fromkeys(chain.setup.settings.buses, chain.decoder.wanted_ids())
            own = chain.encoder.published_ids
            self._buses.refilter(None if self._record is not None else wanted, own, chain.setup.output_bus)
            conflict.moved_over()
            message = f"somebody else sends our ids: publishing from 0x{min(own)[0]:X} on (output.spare_base_id)"
            self._service.journal.say(Priority.WARNING, "output_moved", message, now_ns)

    def facts(self) -> LiveFacts:
        """One moment of the run, but for what the service knows."""
        phase = "waiting"
        if self._ever_valid:
            phase = "silent" if self._chain.loop.memory.asleep else "running"
        return LiveFacts(
            phase=phase,
            started_ns=self._started_ns,
            now_ns=self._clock.now_ns(),
            rows=self._rows,
            row=self._last,
            missed_ticks=self._missed,
            timer_overruns=self._wake.timer.overruns,
            decoder=self._chain.decoder.counters,
            encoder=self._chain.encoder.state,
            buses=self._buses.health,
            lateness=self._lateness,
            state_file=StateFacts(),
            output_refused=bool(self._conflict.refused),
        )

    def take_over(self, setup: Setup) -> None:
        """Goes on with another configuration and what was learnt; where that can't be, as before (DszError)."""
        if self._results is not None:
            raise ConfigError("results are being written (-o); expected a run without, to reload")
        old, self._chain = self._chain, self._chain.succeeded_by(setup, self._clock.now_ns())
        try:
            if {n: b.arguments for n, b in setup.settings.buses.items()} == {
                n: b.arguments for n, b in old.setup.settings.buses.items()
            }:
                wanted = dict.fromkeys(setup.settings.buses, self._chain.decoder.wanted_ids())
                own = self._chain.encoder.published_ids
                self._buses.refilter(None if self._record is not None else wanted, own, setup.output_bus)
            else:
                opened = self._opened(setup)
                self._buses.close()
                self._buses = opened
        except BaseException:
            self._chain = old
            raise
        self._conflict = replace(self._conflict, mode=setup.settings.output.on_conflict)
        self._wake.timer.period_ns = self._chain.period_ns

    def _concluded(self) -> dict[str, Any]:
        chain = self._chain
        published = {"frames": self._published, "dropped": self._buses.dropped, "saturated": chain.encoder.counters}
        source = {"buses": {name: bus.arguments for name, bus in chain.setup.settings.buses.items()}}
        result = chain.summary.result(chain.decoder.counters, chain.cycles, published, source, self._missed)
        late = self._lateness
        result["live"] = {
            "lateness_us": {
                "p50": late.percentile_us(50.0),
                "p99": late.percentile_us(99.0),
                "max": late.max_us,
            },
            "timer_overruns": self._wake.timer.overruns,
            "buses": {health.name: health.plain() for health in self._buses.health},
        }
        if self._results is not None:
            truth = None if self._options.truth is None else read_truth(self._options.truth)
            self._results.conclude(result, f"Live run on {', '.join(chain.setup.settings.buses)}", truth)
        return result
