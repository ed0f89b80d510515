"""`dsz monitor`: a live screen of a running daemon, or text lines in a pipe. Survives the daemon's restarts."""

from __future__ import annotations

import os
import select
import signal
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from rich.console import Console
from rich.live import Live

from dsz_daemon.errors import ConfigError, MachineError
from dsz_daemon.runs.asking import answer
from dsz_daemon.runs.monitor_screen import TEXT_HEAD, Size, picture, text_lines
from dsz_daemon.runs.trend import Trend

# An answer takes a tick of the daemon, or 0.1 s while its bus is silent; keys are not read meanwhile.
_TIMEOUT_S = 1.0
_END = "q"
# Whoever looks costs the daemon half a millisecond a look; faster than this nobody can read.
LOWEST_HZ, HIGHEST_HZ, DEFAULT_HZ = 0.01, 20.0, 4.0


def monitor(path: Path, rate_hz: float = DEFAULT_HZ) -> None:
    """Shows the daemon at `path` until `q` or Ctrl-C; while there is none it says so and waits.

    Raises ConfigError for a rate out of bounds or a path that can't be a socket's.
    """
    if not LOWEST_HZ <= rate_hz <= HIGHEST_HZ:
        raise ConfigError(f"--rate {rate_hz:g}: out of range, expected {LOWEST_HZ:g} to {HIGHEST_HZ:g} a second")
    try:
        if sys.stdout.isatty() and not Console().is_dumb_terminal:
            _on_terminal(path, 1.0 / rate_hz)
        else:
            _in_pipe(path, 1.0 / rate_hz)
    except KeyboardInterrupt:
        # Ctrl-C is the way to end this.
        return


def _on_terminal(path: Path, period_s: float) -> None:
    console, trend = Console(highlight=False), Trend()
    has_blocks = console.encoding.startswith("utf")
    found: dict[str, Any] | None = None
    with _ended_by_signal(), _keys() as wait, Live(console=console, screen=True, auto_refresh=False) as live:
        while True:
            due_s = time.monotonic() + period_s
            problem = ""
            try:
                found = answer(path, _TIMEOUT_S)
                trend.add(found)
            except MachineError as error:
                problem = str(error)
            size = Size(console.size.width, console.size.height, has_blocks)
            live.update(picture(found, trend, problem, str(path), size), refresh=True)
            if _END in wait(due_s - time.monotonic()):
                return


def _in_pipe(path: Path, period_s: float) -> None:
    print(TEXT_HEAD, flush=True)
    problem = ""
    while True:
        due_s = time.monotonic() + period_s
        try:
            print("\n".join(text_lines(answer(path, _TIMEOUT_S))), flush=True)
            problem = ""
        except MachineError as error:
            if str(error) != problem:
                problem = str(error)
                print(f"dsz: waiting: {problem}", file=sys.stderr, flush=True)
        time.sleep(max(0.0, due_s - time.monotonic()))


@contextmanager
def _keys() -> Iterator[Callable[[float], str]]:
    """Yields what waits so many seconds for keys and returns them ("" for none); the terminal is put back after."""
    if not sys.stdin.isatty():

        def sleep(seconds: float) -> str:
            time.sleep(max(0.0, seconds))
            return ""

        yield sleep
        return
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)

    def key(seconds: float) -> str:
        ready, _, _ = select.select([descriptor], [], [], max(0.0, seconds))
        # Nothing to read although ready: the terminal is gone.
        return (os.read(descriptor, 64).decode(errors="replace") or _END) if ready else ""

    tty.setcbreak(descriptor)
    try:
        yield key
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


@contextmanager
def _ended_by_signal() -> Iterator[None]:
    """SIGTERM and SIGHUP end it as Ctrl-C does: the terminal must not stay as the screen left it."""

    def end(_number: int, _frame: FrameType | None) -> NoReturn:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
