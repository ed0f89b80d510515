"""What a command that reads logs need not import."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from dsz_daemon.edge.recording_file import open_recording, recording_format
from dsz_daemon.errors import InputError

_FOR_MF4 = "asammdf"


@contextmanager
def for_logs(logs: Sequence[Path]) -> Iterator[None]:
    """What is imported inside has asammdf only if one of the logs is an MF4 file, or may be one.

    python-can imports it, and pandas with it, wherever they are installed: a third of what starting a command takes.
    For the rest of the process python-can then reads no MF4 file.
    """
    modules = cast("dict[str, Any]", sys.modules)
    is_kept_out = not {_FOR_MF4, "can"} & set(modules) and not any(map(_may_be_mf4, logs))
    if is_kept_out:
        # As Python's own mark of what must not be imported.
        modules[_FOR_MF4] = None
    try:
        yield
    finally:
        if is_kept_out:
            del modules[_FOR_MF4]


def _may_be_mf4(path: Path) -> bool:
    """What is no file (a pipe) may be anything, and can be read once only. What can't be read is not told here."""
    if not path.is_file():
        return path.exists()
    try:
        with open_recording(path) as file:
            return recording_format(path.name, file.head) == "mf4"
    except (OSError, InputError):
        return False
