"""Watches a running daemon: memory and descriptors from /proc, counters from its status socket.

    python tests/soak/live_soak.py --pid PID --status /run/dsz/status.sock --duration 600

`watch` does it from a test that has a bus and a daemon at hand. The daemon is only asked what anybody may ask.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
for folder in (ROOT, Path(__file__).resolve().parent):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

from memory_trend import Trend, descriptors, rss_bytes, trend  # noqa: E402

from dsz_daemon.edge.status_socket import ask  # noqa: E402

_ONLY_GROW = ("rows", "missed_ticks", "timer_overruns", "reloads")
# A page or two that an allocator had not touched before are no slope.
MOST_GROWTH_BYTES = 32 * 2**10


@dataclass
class Watched:
    """What was seen: (hours, bytes), descriptors, the first and the last answer, and what does not add up."""

    rss: list[tuple[float, int]] = field(default_factory=list)
    descriptors: list[int] = field(default_factory=list)
    first: dict[str, Any] = field(default_factory=dict)
    last: dict[str, Any] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)

    @property
    def memory(self) -> Trend:
        """The line through the resident memory, without its first quarter."""
        return trend(self.rss, warm_up=0.25)


def watch(
    pid: int, status: Path, duration_s: float, period_s: float = 1.0, ask_status: Callable[..., Any] = ask
) -> Watched:
    """Watches for `duration_s`; what is wrong at the end stands in `faults`."""
    seen, began_s = Watched(), time.monotonic()
    while (now_s := time.monotonic() - began_s) < duration_s:
        seen.rss.append((now_s / 3600.0, rss_bytes(pid)))
        seen.descriptors.append(descriptors(pid))
        answer = ask_status(status)
        seen.faults += [f for f in counter_faults(answer, seen.last) if f not in seen.faults]
        seen.first, seen.last = seen.first or answer, answer
        time.sleep(max(0.0, period_s - (time.monotonic() - began_s - now_s)))
    if len(seen.rss) > 10 and not seen.memory.is_flat(MOST_GROWTH_BYTES):
        seen.faults.append(f"memory grows: {seen.memory}")
    # A state that is being written and a client that is being answered hold one for a moment.
    # (Before the first answer there was no client at all.)
    early, late = seen.descriptors[1:11], seen.descriptors[-10:]
    if early and min(late) > min(early):
        seen.faults.append(f"descriptors grow: {early} .. {late}")
    return seen


def counter_faults(answer: dict[str, Any], before: dict[str, Any]) -> list[str]:
    """What does not add up in one answer, or between it and the one before."""
    faults = []
    decoder = answer["decoder"]
    messages, roles = decoder["messages"].values(), decoder["roles"].values()
    used = sum(m["frames"] + m["refused"] for m in messages)
    others = sum(decoder[name] for name in ("unwanted", "own", "remote", "error_frames", "ambiguous"))
    if used + others < decoder["frames"]:
        faults.append(f"{decoder['frames']} frames decoded, {used + others} accounted for")
    samples = sum(r["samples"] for r in roles)
    values = sum(r["rejected"] + r["not_present"] + r["samples"] for r in roles)
    most = len(roles) * sum(m["frames"] for m in messages)
    if not samples <= values <= most:
        faults.append(f"{samples} samples of {values} values, {most} at most")
    if not before:
        return faults
    faults += [
        f"{name} fell from {before[name]} to {answer[name]}" for name in _ONLY_GROW if answer[name] < before[name]
    ]
    for old, new in zip(before["buses"], answer["buses"], strict=True):
        counts = [name for name, value in new.items() if isinstance(value, int) and not isinstance(value, bool)]
        faults += [
            f"{new['name']}: {name} fell from {old[name]} to {new[name]}" for name in counts if new[name] < old[name]
        ]
    return faults + _rate_faults(answer, before)


def _rate_faults(answer: dict[str, Any], before: dict[str, Any]) -> list[str]:
    """Rows are the rate times the time between two running answers, give or take what was under way."""
    if answer["phase"] != "running" or before["phase"] != "running" or answer["reloads"] != before["reloads"]:
        return []
    due = (answer["row"]["time_s"] - before["row"]["time_s"]) * answer["rate_hz"]
    rows = answer["rows"] - before["rows"]
    return [] if abs(rows - due) <= 1.5 else [f"{rows} rows where {due:.1f} were due"]


def told(seen: Watched, duration_s: float) -> str:
    """What was seen, in words."""
    line, last = seen.memory, seen.last
    error_kib = 3 * line.error_bytes_per_hour * duration_s / 3600 / 1024
    quarters = [seen.rss[(len(seen.rss) - 1) * i // 4][1] for i in range(5)]
    grown = ", ".join(f"{(b - a) / 1024:+.0f}" for a, b in pairwise(quarters))
    words = [
        f"{duration_s:g} s: RSS {seen.rss[0][1] / 2**20:.2f} -> {seen.rss[-1][1] / 2**20:.2f} MiB; "
        f"after the first quarter {line.growth_bytes / 1024:+.0f} KiB (+- {error_kib:.0f})",
        f"by quarters {grown} KiB",
        f"{last['rows']} rows, {last['missed_ticks']} ticks missed, {last['timer_overruns']} timer overruns",
        *(f"FAILED {fault}" for fault in seen.faults),
    ]
    if not seen.faults:
        words.append("memory flat, counters consistent")
    return "\n".join(words)


def main(argv: Sequence[str] | None = None) -> int:
    """Prints what was seen; 0 if memory is flat and the counters add up."""
    parser = argparse.ArgumentParser(description="Watches a running daemon.")
    parser.add_argument("--pid", type=int, required=True)
    parser.add_argument("--status", type=Path, default=Path("/run/dsz/status.sock"))
    parser.add_argument("--duration", type=float, default=600.0, metavar="S")
    arguments = parser.parse_args(argv)
    seen = watch(arguments.pid, arguments.status, arguments.duration)
    print(told(seen, arguments.duration))
    return 1 if seen.faults else 0


if __name__ == "__main__":
    raise SystemExit(main())
