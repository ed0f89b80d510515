"""How `dsz status`, `dsz monitor` and `dsz metrics` get at a running daemon's answer."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dsz_daemon.edge.status_socket import DEFAULT_PATH, ask
from dsz_daemon.errors import MachineError

# Of the answer (`runs.status`). Whoever asks refuses another; a field more is none.
FORMAT = 1
_SECTIONS = ("versions", "channels", "motion", "inputs", "decoder", "encoder", "lateness", "state_file")


def socket_path(given: Path | None, environment: Mapping[str, str] = os.environ) -> Path:
    """The status socket to ask: the one given, else $DSZ_STATUS, else that of the service.

    >>> str(socket_path(None, {})), str(socket_path(None, {"DSZ_STATUS": "/run/my.sock"}))
    ('/run/dsz/status.sock', '/run/my.sock')
    """
    return given or Path(environment.get("DSZ_STATUS") or DEFAULT_PATH)


def answer(path: Path, timeout_s: float = 2.0) -> dict[str, Any]:
    """The snapshot of the daemon at `path` (`runs.status.snapshot`), its words fit for a terminal.

    Raises MachineError as `ask` does, and where another version of the daemon answers.
    """
    found = ask(path, timeout_s)
    if found.get("format") != FORMAT:
        raise MachineError(
            f"the daemon at {path} answers in format {found.get('format')!r}, expected {FORMAT}: "
            "daemon and command are of different versions; restart the daemon"
        )
    absent = [name for name in _SECTIONS if not isinstance(found.get(name), dict)]
    if absent:
        raise MachineError(f"the answer of the daemon at {path} lacks {', '.join(absent)}")
    return _fit_for_a_terminal(found)  # type: ignore[no-any-return]


def _fit_for_a_terminal(value: Any) -> Any:
    """The same with every control character of its words as `?`: none may steer the reader's terminal."""
    if isinstance(value, str):
        return value if value.isprintable() else "".join(c if c.isprintable() else "?" for c in value)
    if isinstance(value, dict):
        return {_fit_for_a_terminal(key): _fit_for_a_terminal(item) for key, item in value.items()}
    return [_fit_for_a_terminal(item) for item in value] if isinstance(value, list) else value
