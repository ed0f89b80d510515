"""What a running daemon can tell of itself: gathered by the loop, shown by status, monitor and metrics."""

from __future__ import annotations

from dataclasses import dataclass, field

from dsz_daemon.edge.health import BusHealth
from dsz_daemon.edge.journal import Event
from dsz_daemon.pipeline.decode import DecodeCounters
from dsz_daemon.pipeline.encode import EncoderState
from dsz_daemon.pipeline.lateness import Lateness
from dsz_daemon.pipeline.rows import Row


@dataclass
class StateFacts:
    """The state file: where, how old it was when its offsets were taken over (None: they were not), last saved when."""

    path: str = ""
    restored_age_s: float | None = None
    saved_ns: int | None = None
    problem: str = ""


@dataclass
class LiveFacts:
    """One moment of a live run; times are bus time in ns.

    `phase`: "waiting" (no valid step yet), "running", "silent" (no wanted frames any more).
    `row` is the last one. `missed_ticks` were estimated too late to be published;
    `timer_overruns` is the kernel timer's own count of expirations that nobody came for.
    """

    phase: str
    started_ns: int
    now_ns: int
    rows: int
    row: Row | None
    missed_ticks: int
    timer_overruns: int
    decoder: DecodeCounters
    encoder: EncoderState
    buses: tuple[BusHealth, ...]
    lateness: Lateness
    state_file: StateFacts
    reloads: int = 0
    output_refused: bool = False
    events: tuple[Event, ...] = field(default_factory=tuple)
