"""A reload under way: the new configuration is checked and read while the loop goes on with the old one."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from dsz_daemon.errors import DszError
from dsz_daemon.runs.setup import Setup, set_up

_TIMEOUT_S = 120.0
# In the background, where it may step back: on one CPU the check must not take the loop's time. Under systemd
# it may not (no system call for priorities); there the unit puts the daemon before its children instead.
_CHECK = """\
import os, sys
try:
    os.nice(10)
except OSError:
    pass
from dsz_daemon.cli import main
sys.exit(main(["check", sys.argv[1]]))
"""
# How long the reading thread may keep the interpreter from the loop, each time that the loop wants it back: with
# the usual 5 ms, and some ten system calls a tick, each tick would be late.
_SWITCH_S = 1e-4


class Reload:
    """One reload: a process of its own checks the configuration at `path`, then a thread reads it.

    First the process, for a configuration may be anything: what takes gigabytes or never ends must not happen in
    here. Then a thread, for a car's whole DBC takes seconds to read. OSError where the process can't be started.
    """

    def __init__(self, path: Path, buses: Sequence[str] = (), timeout_s: float = _TIMEOUT_S) -> None:
        self._path, self._buses = path, buses
        command = [sys.executable, "-c", _CHECK, str(path.absolute())]
        self._check = subprocess.Popen(  # noqa: S603 - our own program
            command, bufsize=0, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        if self._check.stderr is not None:
            os.set_blocking(self._check.stderr.fileno(), False)
        self._said = b""
        self._until_s = time.monotonic() + timeout_s
        self._reader: threading.Thread | None = None
        self._read: Setup | str = "it could not be read"
        self._usual_switch_s = sys.getswitchinterval()

    def outcome(self) -> Setup | str | None:
        """The new configuration, or why it is refused; None as long as that is not known. Never waits."""
        if self._reader is not None:
            if self._reader.is_alive():
                return None
            self._end_reading()
            return self._read
        code = self._check.poll()
        self._hear()
        if code is None:
            if time.monotonic() < self._until_s:
                return None
            self.close()
            return "the check did not end"
        self.close()
        if code != 0:
            return self._said.decode(errors="replace").strip() or f"the check ended with {code}"
        self._begin_reading()
        return None

    def close(self) -> None:
        """Ends what still runs; safe to call twice. A thread that reads is left alone: it ends by itself."""
        if self._check.returncode is None:
            self._check.kill()
            self._check.wait()
        if self._check.stderr is not None:
            self._check.stderr.close()
        if self._reader is not None:
            sys.setswitchinterval(self._usual_switch_s)

    def _hear(self) -> None:
        """What the check says: as it comes, for with a full pipe it would never end."""
        if self._check.stderr is not None:
            while part := self._check.stderr.read(1 << 16):
                self._said += part

    def _begin_reading(self) -> None:
        def read() -> None:
            try:
                self._read = set_up(self._path, self._buses, live=True)
            except DszError as error:
                self._read = str(error)

        sys.setswitchinterval(_SWITCH_S)
        self._reader = threading.Thread(target=read, daemon=True)
        self._reader.start()

    def _end_reading(self) -> None:
        if self._reader is not None:
            self._reader.join()
        sys.setswitchinterval(self._usual_switch_s)
