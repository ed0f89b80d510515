"""Words to systemd: READY, STATUS, WATCHDOG, RELOADING, STOPPING (sd_notify's protocol, one datagram each)."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Mapping


class Notify:
    """Says things to the service manager; without one (no NOTIFY_SOCKET) it says nothing.

    `watchdog_s` is how often the manager wants to hear of us, None if it does not.
    """

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        given = os.environ if environment is None else environment
        path = given.get("NOTIFY_SOCKET", "")
        self._address = "\0" + path[1:] if path.startswith("@") else path
        self._socket: socket.socket | None = None
        if path:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)
        self.watchdog_s = _watchdog_s(given)

    @property
    def is_service(self) -> bool:
        """Whether a service manager listens."""
        return self._socket is not None

    def say(self, *lines: str) -> None:
        """Sends the lines as one message; a manager that does not listen is no fault of ours."""
        if self._socket is None:
            return
        try:
            self._socket.sendto("\n".join(lines).encode(), self._address)
        except OSError:
            return

    def reloading(self) -> None:
        """A reload has begun; READY=1 ends it."""
        self.say("RELOADING=1", f"MONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def close(self) -> None:
        """Gives the socket back; safe to call twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _watchdog_s(given: Mapping[str, str]) -> float | None:
    usec, pid = given.get("WATCHDOG_USEC", ""), given.get("WATCHDOG_PID", "")
    if not usec.isdigit() or int(usec) == 0 or (pid.isdigit() and int(pid) != os.getpid()):
        return None
    return int(usec) * 1e-6
