"""Keeps the state file up to date without ever waiting for a disk: see `state_writer`, its other end."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import dsz_daemon
from dsz_daemon.edge import state_file
from dsz_daemon.edge.state_writer import DEAF_TO, HEADER

# A writing process that always dies at once must not keep the machine busy.
_RESTART_GAP_S = 10.0
_LOOK_AGAIN_S = 0.05
# Outcomes that nobody asks for.
_KEPT = 100
# Isolated (-I -S): neither a file `json.py` in the current folder nor site-packages have a say, and it starts sooner.
_ROOT = str(Path(dsz_daemon.__file__).resolve().parent.parent)
_CODE = (
    "import sys; sys.path.append(sys.argv[1]); "
    "from dsz_daemon.edge.state_writer import main; sys.exit(main(sys.argv[2:]))"
)


class StateKeeper:
    """Hands states to a process that writes them to `path`; no call but `close` ever waits.

    If states come faster than the disk takes them, the newest one counts and the others are let go.
    `now_s` is a steady clock.
    """

    def __init__(self, path: Path, now_s: Callable[[], float] = time.monotonic) -> None:
        self.path = path.absolute()
        self._now_s = now_s
        self._start_after_s = -float("inf")
        self._process: subprocess.Popen[bytes] | None = None
        # Ours for good, so that whoever waits for it need not know of a process that was started anew.
        self._reports, self._reports_in = os.pipe()
        os.set_blocking(self._reports, False)
        self._heard = b""
        self._outcomes: list[str] = []
        # Files handed over are numbered; the newest stays here until it is answered.
        self._number = self._answered = self._saved = 0
        self._newest = self._unsent = b""
        self._part_sent = False
        self._next: bytes | None = None
        self._closed = False
        self._start()

    @property
    def pid(self) -> int | None:
        """The writing process, None while there is none."""
        return None if self._process is None or self._process.returncode is not None else self._process.pid

    def fileno(self) -> int:
        """Readable when there may be outcomes; the same for as long as this lives."""
        return self._reports

    def save(self, body: dict[str, Any]) -> bool:
        """Hands a state over. False where that is not possible now (the disk hangs, no process): see `outcomes`.

        It is then kept until the next call of any method can hand it over, or a newer one replaces it.
        """
        if self._closed:
            return False
        try:
            data = state_file.encoded(body)
        except ValueError as error:
            self._outcomes.append(f"failed: {error}")
            return False
        self._number += 1
        self._newest = HEADER.pack(len(data), self._number) + data
        if self._part_sent:
            self._next = self._newest
        else:
            self._unsent = self._newest
        self._attend()
        return self._next is None and not self._unsent and self._process is not None

    def outcomes(self) -> list[str]:
        """What became of states since the last call: "saved", or "failed: " and why."""
        if not self._closed:
            self._attend()
        told, self._outcomes = self._outcomes, []
        return told

    def close(self, timeout_s: float = 5.0) -> bool:
        """Waits, `timeout_s` at most, until the last state is on the disk; True if it is (or there was none).

        A process that hangs in the kernel is left alone: it writes what it has and ends by itself. A second
        call waits for that.
        """
        if self._closed:
            self._end(timeout_s)
            return self._saved >= self._number
        deadline_s = self._now_s() + timeout_s
        self._start_after_s = -float("inf")
        while self._answered < self._number:
            self._attend()
            left_s = deadline_s - self._now_s()
            if left_s <= 0.0 or self._answered >= self._number or self._process is None:
                break
            self._wait(min(left_s, _LOOK_AGAIN_S))
        self._closed = True
        self._end(max(0.0, deadline_s - self._now_s()))
        self._listen()
        os.close(self._reports)
        os.close(self._reports_in)
        return self._saved >= self._number

    def _wait(self, seconds: float) -> None:
        """Until there is something to read, or room for what is not sent yet."""
        waiting = select.poll()
        waiting.register(self._reports, select.POLLIN)
        if self._unsent and self._process is not None and self._process.stdin is not None:
            waiting.register(self._process.stdin, select.POLLOUT)
        waiting.poll(seconds * 1e3)

    def _end(self, timeout_s: float) -> None:
        """No more input for the process; its end, if it comes in time."""
        if self._process is None:
            return
        if self._process.stdin is not None:
            self._process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)

    def _attend(self) -> None:
        """Hears outcomes, starts a process where there is none, sends what waits: as far as goes at once."""
        self._listen()
        if self._process is not None and self._process.poll() is not None:
            self._bury()
        if self._process is None:
            self._start()
        self._send()

    def _bury(self) -> None:
        """The process has ended although it should not."""
        if self._process is None:
            return
        # What it said last came before its end.
        self._listen()
        code = self._process.returncode
        how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        self._outcomes.append(f"failed: the process that writes {self.path} has ended ({how})")
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process, self._part_sent, self._next = None, False, None
        self._unsent = self._newest if self._answered < self._number else b""

    def _start(self) -> None:
        now_s = self._now_s()
        if now_s < self._start_after_s:
            return
        self._start_after_s = now_s + _RESTART_GAP_S
        # Blocked from the first instruction: a stop of the whole group must not take it away before it is deaf.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, DEAF_TO)
        try:
            process = subprocess.Popen(  # noqa: S603 - this interpreter, this package
                [sys.executable, "-I", "-S", "-c", _CODE, _ROOT, str(self.path)],
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=self._reports_in,
                cwd="/",
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            self._outcomes.append(f"failed: the process that writes {self.path} can't be started: {error}")
            return
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if process.stdin is not None:
            os.set_blocking(process.stdin.fileno(), False)
        self._process = process

    def _send(self) -> None:
        """As much as the pipe takes; a file that is half sent goes on before a newer one."""
        while self._unsent and self._process is not None and self._process.stdin is not None:
            try:
                sent = os.write(self._process.stdin.fileno(), self._unsent)
            except OSError:
                # Full, or the process is gone, which the next look will find.
                return
            self._unsent = self._unsent[sent:]
            self._part_sent = bool(self._unsent)
            if not self._unsent and self._next is not None:
                self._unsent, self._next = self._next, None

    def _listen(self) -> None:
        while True:
            try:
                part = os.read(self._reports, 1 << 16)
            except OSError:
                break
            self._heard += part
        *lines, self._heard = self._heard.split(b"\n")
        for line in lines:
            self._answer(line.decode(errors="replace"))
        del self._outcomes[:-_KEPT]

    def _answer(self, line: str) -> None:
        what, _, rest = line.partition(" ")
        number, _, why = rest.partition(" ")
        if not number.isdecimal():
            return
        self._answered = max(self._answered, int(number))
        if what == "saved":
            self._saved = max(self._saved, int(number))
            self._outcomes.append("saved")
        else:
            self._outcomes.append(f"failed: {why}")
