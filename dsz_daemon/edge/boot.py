"""Since when this machine runs: what tells a restarted daemon from a parked car."""

from __future__ import annotations

import time
from pathlib import Path
from typing import NamedTuple

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class Boot(NamedTuple):
    """One run of the machine: the kernel's id for it ("" where it is hidden) and how long it has lasted (ns).

    The time goes on while the machine sleeps, and nobody sets it.
    """

    id: str
    elapsed_ns: int


def this_boot() -> Boot:
    """The run of the machine that we are in."""
    try:
        name = _BOOT_ID.read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        # A unit with ProcSubset=pid does not see it.
        name = ""
    return Boot(name, time.clock_gettime_ns(time.CLOCK_BOOTTIME))
