"""The process that writes the state file, so that no disk can hold up the loop.

A disk may take seconds for an fsync, or hang. That must not cost a tick, and a thread would share
the interpreter's lock; so the daemon hands whole files through a pipe to this small process, which
writes the newest and answers with a line each:

    saved NUMBER                 generation NUMBER is on the disk, and whatever came before it
    failed NUMBER REASON         it is not; the last good one still is

It ends when the pipe is closed, after the last file; SIGINT, SIGTERM and SIGHUP are not for it.
By hand: `python -m dsz_daemon.edge.state_writer PATH < FRAMES`. Only the standard library.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import signal
import struct
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from dsz_daemon.edge import state_file

# Before each file: its length and its number.
HEADER = struct.Struct(">IQ")
DEAF_TO = frozenset({signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
# A line fits into a pipe at once (PIPE_BUF is 4096).
_LONGEST_REASON = 400
_NICE = 10


class PathInUseError(OSError):
    """Another process holds the lock of this state file."""


class Lock:
    """The right to write one state file; tried at every save, kept once it was got."""

    def __init__(self, path: Path) -> None:
        self._path = state_file.lock_path(path)
        self._fd: int | None = None

    def take(self) -> None:
        """OSError where it can't be taken."""
        if self._fd is not None:
            return
        fd = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(fd)
            if isinstance(error, BlockingIOError):
                raise PathInUseError(0, "another daemon writes this file") from None
            raise
        self._fd = fd


def newest(fd: int) -> Iterator[tuple[int, bytes]]:
    """(number, file) of the newest that has come, as often as something has; until the pipe's end.

    ValueError where a length is impossible: what follows would be guesswork.
    """
    held = bytearray()
    ended = False
    while not ended:
        last: tuple[int, bytes] | None = None
        while not ended and (last is None or _is_readable(fd)):
            part = os.read(fd, 1 << 16)
            ended = not part
            held += part
            last = _taken(held) or last
        if last is not None:
            yield last


def _taken(held: bytearray) -> tuple[int, bytes] | None:
    """The last whole file in `held`, from which all whole ones are removed."""
    last = None
    while len(held) >= HEADER.size:
        length, number = HEADER.unpack_from(held)
        if length > state_file.MAX_BYTES:
            raise ValueError(f"a file of {length} bytes is announced; expected {state_file.MAX_BYTES} at most")
        if len(held) < HEADER.size + length:
            break
        last = number, bytes(held[HEADER.size : HEADER.size + length])
        del held[: HEADER.size + length]
    return last


def _is_readable(fd: int) -> bool:
    return bool(select.select([fd], [], [], 0.0)[0])


def outcome(path: Path, lock: Lock, data: bytes) -> str:
    """Writes one file; "" where it is on the disk, else why not."""
    try:
        lock.take()
        state_file.save(path, data)
    except OSError as error:
        return f"{path}: {error.strerror or error}"[:_LONGEST_REASON].replace("\n", " ")
    return ""


def _report(line: str) -> None:
    # A daemon that is gone, or too busy to read, must not keep us from writing.
    with contextlib.suppress(OSError):
        if select.select([], [1], [], 0.0)[1]:
            os.write(1, f"{line}\n".encode(errors="backslashreplace"))


def _step_back() -> None:
    """What the daemon may have set up for itself (priority, its one CPU, its signals) is not for us."""
    for number in DEAF_TO:
        signal.signal(number, signal.SIG_IGN)
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with contextlib.suppress(OSError):
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
    with contextlib.suppress(OSError):
        os.nice(_NICE)


def main(arguments: Sequence[str]) -> int:
    """Writes what comes on standard input to the file named until the input ends; 2 where it makes no sense."""
    if len(arguments) != 1:
        print("expected one argument: the state file's path", file=sys.stderr)
        return 2
    _step_back()
    path = Path(arguments[0])
    lock = Lock(path)
    try:
        for number, data in newest(0):
            why = outcome(path, lock, data)
            _report(f"failed {number} {why}" if why else f"saved {number}")
    except ValueError as error:
        print(f"state writer: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
