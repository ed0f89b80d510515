"""2222 frames/s in and 100 Hz out on a kernel's own vcan0, for a minute: dsz, dsz being watched, and the usual way.

    python tests/vcan/throughput.py [-o OUT] [--seconds 60]

The frames are the RAV4's recording where it is beside the project, else a simulated car's, filled up with other ids
to 2222 a second (half of a 500 kbit/s bus). One after the other, in the same kind of guest (tests/vcan/guest):

- dsz: kernel filters, decode, estimator, E2E, six channels published at 100 Hz;
- dsz watched: the same with `dsz monitor` on a terminal, `dsz metrics` asked once and `status` ten times a second;
- peer: python-can's Notifier and cantools, the latest raw values published at 100 Hz. No estimator, no E2E;
- nobody: player and witnesses alone, to tell their CPU time from a daemon's.

CPU time is what this machine's kernel counts for everything in the guest: the guest's own kernel only looks every
10 ms who is running. And hitches.py runs twice, in the guest and outside: what is late there has met neither daemon
nor guest.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dsz_daemon.runs.simulate import simulate

ROOT = Path(__file__).parents[2]
RAV4 = ROOT.parent / "shared" / "data" / "rav4_highway" / "recording.log"
RAV4_CONFIG = ROOT / "config/cars/toyota_rav4_2017.yaml"
FRAMES_PER_S = 2222
NO_WAY = 77
WAYS = ("nobody", "dsz", "watched", "peer")
_LINE = re.compile(r"\((\d+)\.(\d{6})\) (\S+) (\S+)")
_DATA = "0123456789ABCDEF"


@dataclass(frozen=True)
class Drive:
    """What is played: a candump log with everything on can0, its configuration and the number of its frames."""

    log: Path
    config: Path
    frames: int
    of: str


def _lines(source: Path, seconds: float) -> Iterator[tuple[int, str]]:
    """(time in us from the first frame, ID#DATA) of a recording's first `seconds`."""
    first_us = None
    with source.open() as lines:
        for found in filter(None, map(_LINE.match, lines)):
            t_us = int(found[1]) * 1_000_000 + int(found[2])
            first_us = t_us if first_us is None else first_us
            if t_us - first_us >= seconds * 1e6:
                return
            yield t_us - first_us, found[4]


def drive(folder: Path, seconds: float = 60.0) -> Drive:
    """Makes the log in `folder`."""
    if RAV4.exists():
        source, config, of = RAV4, RAV4_CONFIG, "RAV4, highway"
    else:
        simulate("sine_steer", folder / "sine_steer", seed=1)
        source, config, of = folder / "sine_steer/recording.log", folder / "sine_steer/config.yaml", "simulated car"
    frames = [(t_us, text) for t_us, text in _lines(source, seconds)]
    missing = max(0, round(seconds * FRAMES_PER_S) - len(frames))
    # Ids that no car's mapping wants, lower and higher in rank than those that are.
    filler = [
        (round(n * seconds * 1e6 / missing), f"{0x010 + 7 * (n % 3) if n % 2 else 0x7A0 + n % 64:03X}#{_DATA}")
        for n in range(missing)
    ]
    log = folder / "drive.log"
    with log.open("w") as out:
        for t_us, text in sorted([*frames, *filler]):
            out.write(f"({1_700_000_000 + t_us // 1_000_000}.{t_us % 1_000_000:06d}) can0 {text}\n")
    return Drive(log, config, len(frames) + missing, of)


def played(what: Drive, out: Path, who: str, seconds: float = 60.0) -> dict[str, Any]:
    """Plays the drive to one of WAYS in a guest; returns cost and summary. SystemExit 77 where there is no way."""
    out.mkdir(parents=True, exist_ok=True)
    inside = ["tests/vcan/bus_run.py", str(what.log), "can0", str(what.config), str(out), who, str(seconds + 20.0)]
    limit_s = round(seconds) + 300
    punctual = [str(ROOT / "tests/vcan/guest"), "-p", "-t", str(limit_s), "-w", str(out)]
    here = out / "hitches_here.json"
    first = ["chrt", "-f", "30"] if os.geteuid() == 0 else []
    witness = subprocess.Popen([*first, sys.executable, str(ROOT / "tests/vcan/hitches.py"), str(here)])
    try:
        with (out / "output.txt").open("w") as output:
            running = subprocess.Popen([*punctual, sys.executable, *inside], cwd=ROOT, stdout=output, stderr=output)
            code, cpu_share = _watched(running, out, limit_s + 600)
    finally:
        witness.send_signal(signal.SIGTERM)
        witness.wait(30.0)
    said = (out / "output.txt").read_text()
    if code == NO_WAY:
        print(said.strip(), file=sys.stderr)
        raise SystemExit(NO_WAY)
    if code != 0:
        raise SystemExit(f"{who}: exit code {code}\n{said}")
    begun_ns, ended_ns = (int((out / name).read_text()) for name in ("begun", "ended"))
    found = {name: json.loads((out / f"{name}.json").read_text()) for name in ("cost", "summary", "hitches")}
    outside = [hitch for hitch in json.loads(here.read_text()) if begun_ns <= hitch[1] <= ended_ns]
    hitches = [hitch for hitch in found["hitches"] if begun_ns <= hitch[1] <= ended_ns]
    return {
        "who": who,
        **found["cost"],
        "cpu_share": cpu_share,
        "summary": found["summary"],
        "hitches": hitches,
        "hitches_here": outside,
    }


def _watched(running: subprocess.Popen[bytes], out: Path, limit_s: float) -> tuple[int, float]:
    """Exit code, and the share of a CPU that it and all its children took between OUT/begun and OUT/ended."""
    end_s = time.monotonic() + limit_s
    at: dict[str, tuple[float, float]] = {}
    while running.poll() is None:
        for name in ("begun", "ended"):
            if name not in at and (out / name).exists():
                at[name] = time.monotonic(), _tree_cpu_s(running.pid)
        if time.monotonic() > end_s:
            running.kill()
        time.sleep(0.05)
    if len(at) < 2:
        return running.wait(), float("nan")
    (begun_s, before_s), (ended_s, after_s) = at["begun"], at["ended"]
    return running.wait(), (after_s - before_s) / (ended_s - begun_s)


def _tree_cpu_s(root: int) -> float:
    """CPU time so far of a process and its descendants, those that have ended included."""
    parents, times = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        parents[int(stat.parent.name)] = int(fields[1])
        times[int(stat.parent.name)] = sum(map(int, fields[11:15]))
    found, new = {root}, {root}
    while new:
        new = {pid for pid, parent in parents.items() if parent in new}
        found |= new
    return sum(times.get(pid, 0) for pid in found) / os.sysconf("SC_CLK_TCK")


def figures(result: dict[str, Any], frames: int) -> dict[str, Any]:
    """One way's row: shares, times in ms."""
    summary, live = result["summary"], result["summary"].get("live", {})
    late = live.get("lateness_us") or summary.get("lateness_us", {})
    buses = live.get("buses", {}).values()
    received = summary.get("received")
    return {
        "who": result["who"],
        "frames_per_s": frames / result["seconds"],
        "lost": sum(bus["lost"] for bus in buses) if live or received is None else max(0, frames - received),
        "dropped": sum(bus["dropped"] for bus in buses),
        "missed": summary["counts"]["missed"] if live else None,
        "rows": summary["rows"] if live else summary.get("sent", 0) // 2,
        "cpu": result["cpu_share"],
        **{f"{name}_ms": late.get(name, math.nan) * 1e-3 for name in ("p50", "p99", "max")},
    }


def table(rows: list[dict[str, Any]]) -> str:
    """As Markdown."""
    lines = ["| | frames/s in | lost | ticks | missed | CPU | late p50 | p99 | max, ms |", "|" + "---|" * 9]
    for row in rows:
        missed = "-" if row["missed"] is None else row["missed"]
        lines.append(
            f"| {row['who']} | {row['frames_per_s']:.0f} | {row['lost']} | {row['rows']} | {missed} | "
            f"{100 * row['cpu']:.1f} % | {row['p50_ms']:.2f} | {row['p99_ms']:.2f} | {row['max_ms']:.2f} |".replace(
                "nan", "-"
            )
        )
    return "\n".join(lines)


def histogram(results: list[dict[str, Any]]) -> str:
    """How many ticks were later than so much, in per cent: the ways of dsz side by side."""
    ways = [result for result in results if "live" in result["summary"]]
    lines = ["| later than | " + " | ".join(way["who"] for way in ways) + " |", "|" + "---|" * (len(ways) + 1)]
    for edge_ms in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0):
        shares = []
        for way in ways:
            bins = way["summary"]["live"]["lateness_us"]["bins"]
            total = sum(count for _, count in bins)
            later = sum(count for edge_us, count in bins if edge_us is None or edge_us > edge_ms * 1e3 * 1.001)
            shares.append(f"{100 * later / total:.2f} %")
        lines.append(f"| {edge_ms:g} ms | " + " | ".join(shares) + " |")
    return "\n".join(lines)


def hitched(rows: list[dict[str, Any]]) -> str:
    """When the machine was late itself, and what of dsz was late meanwhile."""
    texts = []
    for name, where in (("hitches", "in the guest"), ("hitches_here", "outside of it")):
        seen = [row["result"][name] for row in rows]
        found = ", ".join(f"{len(late)} (to {max((b - a for a, b in late), default=0) * 1e-6:.0f} ms)" for late in seen)
        texts.append(f"hitches of the machine over 4 ms meanwhile, {where} (tests/vcan/hitches.py): {found}")
    for row in rows:
        missed = row["result"]["summary"].get("live", {}).get("missed_rows", ())
        hitches = [*row["result"]["hitches"], *row["result"]["hitches_here"]]
        alone = sum(not any(begin < sent and due < end for begin, end in hitches) for due, sent in missed)
        if missed:
            texts.append(f"{row['who']}: {len(missed)} rows 10 ms late, {alone} of them without a hitch meanwhile")
    return "\n\n".join(texts)


def report(rows: list[dict[str, Any]]) -> str:
    """All of it, of rows that have their `result` and what they are `of`."""
    texts = [
        f"{rows[0]['of'].of}, filled up to {FRAMES_PER_S} frames/s",
        table(rows),
        histogram([row["result"] for row in rows]),
    ]
    texts.append(hitched(rows))
    cpu = {row["who"]: row["cpu"] for row in rows}
    if {"nobody", "dsz", "peer"} <= set(cpu):
        dsz, peer = cpu["dsz"] - cpu["nobody"], cpu["peer"] - cpu["nobody"]
        texts.append(
            f"CPU above nobody's: dsz {100 * dsz:.0f} %, peer {100 * peer:.0f} %; dsz over peer: {dsz / peer:.2f}"
        )
    return "\n\n".join(texts)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="2222 frames/s in, 100 Hz out: dsz, dsz watched, and a peer.")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--ways", default=",".join(WAYS), help="default %(default)s")
    arguments = parser.parse_args()
    out = (arguments.output or Path(tempfile.mkdtemp(prefix="dsz-throughput."))).resolve()
    out.mkdir(parents=True, exist_ok=True)
    what = drive(out, arguments.seconds)
    rows = []
    for who in arguments.ways.split(","):
        result = played(what, out / who, who, arguments.seconds)
        rows.append({**figures(result, what.frames), "result": result, "of": what})
    print(report(rows))


if __name__ == "__main__":
    main()
