"""Says what happens: to the journal with fields, or as lines on standard error. Never floods.

The journal's native protocol is a datagram of KEY=VALUE lines, documented in systemd's
JOURNAL_NATIVE_PROTOCOL; docs/decisions/0010-service-protocols.md says why no package is used for it.
"""

from __future__ import annotations

import os
import socket
import sys
from collections import deque
from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import NamedTuple

_JOURNAL = "/run/systemd/journal/socket"
# Of one kind of event: so many at once, then one in so many seconds. A bus that flaps must not fill a disk.
_BURST = 5
_PERIOD_S = 60.0
_KEPT = 50


class Priority(IntEnum):
    """syslog's priorities, as many as are needed."""

    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


class Event(NamedTuple):
    """Something that a user may want to know: when (bus time, ns), how bad, of which kind, in words."""

    t_ns: int
    priority: Priority
    kind: str
    message: str


class Journal:
    """Takes events, passes them on within their rate, keeps the last ones for `dsz status`.

    `now_s` is a steady clock. `suppressed` counts what was not passed on, by kind; the next one of
    the kind that is passed on says how many.
    """

    def __init__(self, now_s: Callable[[], float], to_journal: bool | None = None) -> None:
        self._now_s = now_s
        self._socket: socket.socket | None = None
        if to_journal or (to_journal is None and "JOURNAL_STREAM" in os.environ):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
        self._allowance: dict[str, tuple[float, float]] = {}
        self.suppressed: dict[str, int] = {}
        self.recent: deque[Event] = deque(maxlen=_KEPT)

    def say(
        self, priority: Priority, kind: str, message: str, t_ns: int = 0, fields: Mapping[str, str] | None = None
    ) -> None:
        """One event; `kind` is one lower-case word or a few (`bus_off`), `fields` are further journal fields."""
        self.recent.append(Event(t_ns, priority, kind, message))
        if not self._allowed(kind):
            self.suppressed[kind] = self.suppressed.get(kind, 0) + 1
            return
        held_back = self.suppressed.pop(kind, 0)
        if held_back:
            message += f" (and {held_back} more like this)"
        # By hand, only what is wrong: the rest is in the summary.
        is_worth_a_line = priority <= Priority.WARNING or "JOURNAL_STREAM" in os.environ
        if not self._to_journal(priority, kind, message, fields or {}) and is_worth_a_line:
            _to_stderr(priority, message)

    def _allowed(self, kind: str) -> bool:
        now = self._now_s()
        left, since = self._allowance.get(kind, (float(_BURST), now))
        left = min(float(_BURST), left + (now - since) / _PERIOD_S)
        allowed = left >= 1.0
        self._allowance[kind] = (left - 1.0 if allowed else left, now)
        return allowed

    def _to_journal(self, priority: Priority, kind: str, message: str, fields: Mapping[str, str]) -> bool:
        if self._socket is None:
            return False
        entry = {
            "PRIORITY": str(int(priority)),
            "SYSLOG_IDENTIFIER": "dsz",
            "DSZ_EVENT": kind,
            **fields,
            "MESSAGE": message,
        }
        try:
            self._socket.sendto(b"".join(_field(key, value) for key, value in entry.items()), _JOURNAL)
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Closes the way to the journal; safe to call twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _field(key: str, value: str) -> bytes:
    data = value.encode(errors="replace")
    if b"\n" in data:
        return key.encode() + b"\n" + len(data).to_bytes(8, "little") + data + b"\n"
    return key.encode() + b"=" + data + b"\n"


def _to_stderr(priority: Priority, message: str) -> None:
    prefix = f"<{int(priority)}>" if "JOURNAL_STREAM" in os.environ else "dsz: "
    try:
        print(f"{prefix}{message}", file=sys.stderr, flush=True)
    except OSError:
        # Nobody listens; the loop goes on.
        return
