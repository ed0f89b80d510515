"""Files that ship with the project: the output DBC, the ready configurations, the units for systemd.

In a checkout they stand at the top of the tree (`dbc/`, `config/`, `systemd/`), where people look for
them; a wheel carries the same folders inside the package.
"""

from __future__ import annotations

from pathlib import Path

from dsz_daemon.errors import MachineError


def shipped(name: str) -> Path:
    """Path of a shipped file, `name` relative to the tree's top, e.g. `dbc/dsz.dbc`."""
    package = Path(__file__).resolve().parent
    for root in (package / "_shipped", package.parent):
        if (root / name).exists():
            return root / name
    raise MachineError(f"{name} is missing from this installation; reinstall dsz-daemon")
