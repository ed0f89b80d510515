"""A daemon to ask: the real loop over the golden recording, and its answers served on a status socket."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

from dsz_daemon.edge.health import BusHealth
from dsz_daemon.edge.journal import Event, Priority
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.logs import read_frames
from dsz_daemon.edge.status_socket import StatusSocket
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.lateness import Lateness
from dsz_daemon.pipeline.rows import Row
from dsz_daemon.runs import status
from dsz_daemon.runs.facts import LiveFacts, StateFacts
from dsz_daemon.runs.setup import Setup, set_up
from tests.golden.golden import CONFIG, LOG


@cache
def golden_setup() -> Setup:
    return set_up(CONFIG)


@cache
def golden_frames() -> tuple[Frame, ...]:
    return tuple(read_frames([LOG], LogReport()))


def moments(every: int = 1, setup: Setup | None = None) -> Iterator[LiveFacts]:
    """The facts after every `every`-th row of the golden recording (24 s, 100 rows a second), and after the last."""
    setup = setup or golden_setup()
    encoder = setup.encoder()
    decoder = setup.decoder(encoder)
    loop = setup.loop(decoder)
    bus, lateness, frames, rows = BusHealth("can0", "socketcan:can0", stamps="kernel"), Lateness(), golden_frames(), 0
    row: Row | None = None

    def facts(now_ns: int) -> LiveFacts:
        return LiveFacts(
            phase="waiting" if row is None else "running",
            started_ns=frames[0].t_ns,
            now_ns=now_ns,
            rows=rows,
            row=row,
            missed_ticks=0,
            timer_overruns=0,
            decoder=decoder.counters,
            encoder=encoder.state,
            buses=(replace(bus),),
            lateness=lateness,
            state_file=StateFacts("/var/lib/dsz/offsets.json", None, frames[0].t_ns),
            events=(Event(frames[0].t_ns, Priority.NOTICE, "start", "golden recording begins"),),
        )

    for frame in frames:
        bus.received += 1
        for row in loop.frame(frame):
            rows += 1
            bus.sent += len(encoder.encode(row))
            lateness.add(50.0 + (7 * rows) % 100)
            if rows % every == 0:
                yield facts(row.t_ns)
    yield facts(frames[-1].t_ns)


@cache
def last_moment() -> LiveFacts:
    return list(moments(every=10**9))[-1]


@cache
def golden_texts(every: int) -> tuple[bytes, ...]:
    """What a daemon answers along the drive."""
    return tuple(status.snapshot_text(golden_setup(), facts) for facts in moments(every))


class FakeDaemon:
    """Answers at `path` from a thread, each time with the next moment of the drive (the last one again and again)."""

    def __init__(self, path: Path, every: int = 25, texts: Iterator[bytes] | None = None) -> None:
        self.path, self.answered = path, 0
        # Made beforehand: a daemon answers at once.
        self._texts = texts or iter(golden_texts(every))
        self._text, self._stop = b"", threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def _serve(self) -> None:
        socket = StatusSocket(self.path)
        with contextlib.closing(socket):
            self._ready.set()
            while not self._stop.wait(0.002):
                # One at a time: who asks again while the first is being answered would hear the same once more.
                self.answered += socket.answer(self._next, at_most=1)

    def _next(self) -> bytes:
        self._text = next(self._texts, self._text)
        return self._text

    def __enter__(self) -> FakeDaemon:
        self._ready = threading.Event()
        self._thread.start()
        assert self._ready.wait(10.0)
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(10.0)
