"""One chunk of fuzzing: inputs from a seed, a guard against hangs, memory watched, failures kept.

A chunk is the unit of everything: its inputs follow from (target, seed, number of the chunk) alone, so that
it can be run again by itself, on any machine, in any order.
"""

from __future__ import annotations

import ctypes
import faulthandler
import gc
import json
import os
import random
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import FrameType
from typing import NamedTuple

# Far above what any input needs (tens of milliseconds) on a machine that is busy with other things.
HANG_S = 60.0
# One that no signal reaches, in C, ends its process.
ENDED_S = 180.0
_RSS_SAMPLES = 16
_MOST_FAILURES = 5
# A hundred thousand small files: in memory where there is such a place, or the disk is what is measured.
_IN_MEMORY = Path("/dev/shm")
_TRIM = getattr(ctypes.CDLL(None), "malloc_trim", None)


class Hang(BaseException):
    """An input took longer than HANG_S; not an Exception, so that no `except Exception` swallows it."""


class Unexpected(AssertionError):  # noqa: N818 - reads as what it is where it is raised
    """The code under test did not crash, but did something that it must never do."""


class Target(NamedTuple):
    """What is fuzzed: `amount` inputs in all, `per_chunk` of them a chunk, `quick` within pytest.

    `run` takes a session through so many inputs; `one` runs a single input from a file (None where an
    input is a sequence that only its chunk can repeat).
    """

    name: str
    meaning: str
    amount: int
    per_chunk: int
    quick: int
    run: Callable[[Session, int], None]
    one: Callable[[Session, bytes], None] | None = None


@dataclass
class ChunkResult:
    """What became of a chunk; `rss` are (inputs so far, bytes)."""

    target: str
    seed: int
    chunk: int
    inputs: int = 0
    cpu_s: float = 0.0
    slowest_s: float = 0.0
    pid: int = 0
    peak_bytes: int = 0
    outcomes: dict[str, int] = field(default_factory=dict)
    rss: list[tuple[int, int]] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def line(self) -> str:
        """The result as one line of JSON."""
        return json.dumps(asdict(self))


class Session:
    """What a target needs while it runs: randomness, a folder, the guard, a place to note outcomes."""

    def __init__(self, target: str, seed: int, chunk: int, folder: Path) -> None:
        self.target, self.seed, self.chunk, self.folder = target, seed, chunk, folder
        # A text seeds by its hash, which is the same everywhere (unlike `hash`).
        self.random = random.Random(f"{target}:{seed}:{chunk}")
        self.outcomes: Counter[str] = Counter()
        self.current = b""
        self.rss: list[tuple[int, int]] = []
        self.inputs = 0
        self.slowest_s = 0.0
        self.rss_every = 1
        self._next_rss = 0
        self._began_s = time.process_time()
        self._armed_s = -HANG_S

    def begin(self, current: bytes = b"", inputs: int = 1) -> None:
        """The next input (or a batch of them) begins; `current` is what a failure would save."""
        # Of the processor: on a busy machine the clock says little about the input.
        cpu_s, now_s = time.process_time(), time.perf_counter()
        if self.inputs:
            self.slowest_s = max(self.slowest_s, cpu_s - self._began_s)
        self._began_s = cpu_s
        self.current = current
        if self.inputs >= self._next_rss:
            self.rss.append((self.inputs, rss_bytes()))
            self._next_rss = self.inputs + self.rss_every
        self.inputs += inputs
        if now_s - self._armed_s > 0.1 * HANG_S:
            # The backstop for code that never comes back to Python: ends the process, with a trace.
            faulthandler.dump_traceback_later(ENDED_S, exit=True)
            signal.setitimer(signal.ITIMER_REAL, HANG_S)
            self._armed_s = now_s


def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="dsz-fuzz-", dir=_IN_MEMORY if os.access(_IN_MEMORY, os.W_OK) else None)


def rss_bytes() -> int:
    """Resident memory of this process, without what it has freed and glibc still holds."""
    if _TRIM is not None:
        _TRIM(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _peak_bytes() -> int:
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024


def run_chunk(target: Target, seed: int, chunk: int, inputs: int, failures: Path) -> ChunkResult:
    """Runs one chunk; every failure is saved into the folder `failures` and told, none is raised."""
    result = ChunkResult(target.name, seed, chunk, pid=os.getpid())
    with _folder() as folder, _alarm():
        session = Session(target.name, seed, chunk, Path(folder))
        session.rss_every = max(1, inputs // _RSS_SAMPLES)
        began_s = time.process_time()
        while session.inputs < inputs and len(result.failures) < _MOST_FAILURES:
            try:
                target.run(session, inputs - session.inputs)
            except (Exception, Hang) as error:  # whatever it is, it is what we look for
                result.failures.append(_saved(session, target, error, failures))
                if target.one is None:
                    break
        # What is left is ours, and no input's.
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        gc.collect()
        session.rss.append((session.inputs, rss_bytes()))
        result.cpu_s = time.process_time() - began_s
    result.inputs, result.outcomes = session.inputs, dict(session.outcomes)
    result.rss, result.slowest_s, result.peak_bytes = session.rss, session.slowest_s, _peak_bytes()
    return result


def run_one(target: Target, data: bytes) -> None:
    """Runs one saved input; what is wrong with it is raised."""
    if target.one is None:
        raise SystemExit(f"{target.name}: an input is a sequence; repeat its chunk with --chunk instead")
    with _folder() as folder, _alarm():
        session = Session(target.name, 0, 0, Path(folder))
        session.begin(data)
        target.one(session, data)


def _saved(session: Session, target: Target, error: BaseException, folder: Path) -> str:
    """Writes the offending input and the trace; returns what to tell, with the command that repeats it."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = folder / f"{session.target}-{session.seed}-{session.chunk}-{session.inputs}"
    stem.with_suffix(".trace").write_text("".join(traceback.format_exception(error)), encoding="utf-8")
    words = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    command = f"python tests/fuzz/fuzz.py --target {session.target}"
    if target.one is None:
        command += f" --seed {session.seed} --chunk {session.chunk}"
    else:
        stem.with_suffix(".input").write_bytes(session.current)
        command += f" --input {stem}.input"
    return f"{words}\n    trace: {stem}.trace\n    again: {command}"


class _alarm:  # noqa: N801 - reads as a verb where it is used
    """While inside, SIGALRM means that an input hangs."""

    def __enter__(self) -> None:
        def hung(_number: int, frame: FrameType | None) -> None:
            raise Hang(f"longer than {HANG_S:.0f} s, at {frame}")

        self._old = signal.signal(signal.SIGALRM, hung)

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGALRM, self._old)
        sys.stderr.flush()
