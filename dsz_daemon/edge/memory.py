"""How much memory a process may still take before the system ends it."""

from __future__ import annotations

from pathlib import Path

_MEMINFO = Path("/proc/meminfo")
# A container's own bound (cgroup v2), as it is seen from inside.
_CGROUP = Path("/sys/fs/cgroup")


def available_bytes(meminfo: Path = _MEMINFO, cgroup: Path = _CGROUP) -> int | None:
    """What the machine has left, or the container where that is less; None where nothing tells (not on Linux)."""
    found = []
    for line in _lines(meminfo):
        name, _, value = line.partition(":")
        if name == "MemAvailable" and value.split()[1:] == ["kB"]:
            found.append(1024 * int(value.split()[0]))
    most, used = (_lines(cgroup / f"memory.{name}") for name in ("max", "current"))
    if most and used and most[0].isdigit() and used[0].isdigit():
        # What was read from files and is not looked at any more makes room by itself.
        stat = dict(line.split() for line in _lines(cgroup / "memory.stat"))
        found.append(max(0, int(most[0]) - int(used[0]) + int(stat.get("inactive_file", 0))))
    return min(found, default=None)


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="ascii").splitlines()
    except OSError:
        return []
