"""One row per tick of the fixed-rate loop: what is published, written and drawn."""

from __future__ import annotations

from typing import NamedTuple

from dsz_daemon.core.outputs import StepOutput


class Counters(NamedTuple):
    """What the loop has seen since it started; all only grow. `frames` are those that gave a sample."""

    frames: int = 0
    samples: int = 0
    rejected: int = 0
    missed_ticks: int = 0
    gaps: int = 0
    clock_steps: int = 0


class Refusal(NamedTuple):
    """A decoded value that was not used, and why: "spike", "frozen" or "stamp" (far ahead of all others)."""

    role: str
    why: str


class Row(NamedTuple):
    """The loop's answer at one tick.

    `inputs` are the aligned values in SI by role, `ages_s` how old each was at the tick (both
    only for mapped roles that have been seen); `event` is "" or what happened to time just
    before this tick ("start", "gap", "clock_step"); `refused` are the values since the last tick
    that were not used.
    """

    t_ns: int
    output: StepOutput
    inputs: dict[str, float]
    ages_s: dict[str, float]
    counters: Counters
    event: str = ""
    refused: tuple[Refusal, ...] = ()
