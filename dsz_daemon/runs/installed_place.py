"""Whether a service without a home and without rights can read this installation."""

from __future__ import annotations

import stat
import sys
from collections.abc import Callable
from pathlib import Path

from dsz_daemon.shipped import shipped

# What ProtectHome=yes and PrivateTmp=yes put out of the unit's sight (systemd.exec(5)).
_HIDDEN = {
    Path("/home"): "ProtectHome=yes",
    Path("/root"): "ProtectHome=yes",
    Path("/run/user"): "ProtectHome=yes",
    Path("/tmp"): "PrivateTmp=yes",  # noqa: S108 - no file is made there
    Path("/var/tmp"): "PrivateTmp=yes",  # noqa: S108
}
_ADVICE = "install where all may read: python3 -m venv /opt/dsz && /opt/dsz/bin/pip install dsz-daemon"


def unseen_by_services() -> list[str]:
    """One warning for each part of this installation that the units would not find; [] if all is well."""
    parts = {
        "the command": Path(sys.executable).parent,
        "Python": Path(sys.base_prefix),
        "Python's program": Path(sys.executable).resolve(),
        "the package": Path(__file__).resolve().parents[1],
        "its files": shipped("dbc/dsz.dbc"),
    }
    reasons: dict[str, str] = {}
    for what, path in parts.items():
        reason = why_unseen(path)
        if reason is not None:
            reasons.setdefault(reason, what)
    return [f"{what} lies where the service can't see it: {reason}; {_ADVICE}" for reason, what in reasons.items()]


def why_unseen(path: Path, mode_of: Callable[[Path], int] = lambda path: path.stat().st_mode) -> str | None:
    """Why a unit of ours can't use an absolute `path`, None if it can.

    >>> why_unseen(Path("/home/me/.venv/bin"), lambda _: 0o40755)
    '/home is hidden from it (ProtectHome=yes)'
    """
    for folder, option in _HIDDEN.items():
        if path.is_relative_to(folder):
            return f"{folder} is hidden from it ({option})"
    for place in (*reversed(path.parents), path):
        mode = mode_of(place)
        needed = stat.S_IXOTH if stat.S_ISDIR(mode) else stat.S_IROTH
        if not mode & needed:
            return f"only some may read {place} (mode {stat.S_IMODE(mode):04o})"
    return None
