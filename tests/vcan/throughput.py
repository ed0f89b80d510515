"""2222 frames/s in and 100 Hz out on a kernel's own vcan0, for a minute: dsz, dsz being watched, and the usual way.

    python tests/vcan/throughput.py [-o OUT] [--seconds 60]

The frames are the RAV4's recording where it is beside the project, else a simulated car's, filled up with other ids
to 2222 a second (half of a 500 kbit/s bus). One after the other, in the same kind of guest (tests/vcan/guest):

- dsz: kernel filters, decode, estimator, E2E, six channels published at 100 Hz;
- dsz watched: the same with `dsz monitor` on a terminal, `dsz metrics` asked once and `status` ten times a second;
- peer: python-can's Notifier and cantools, the latest raw values published at 100 Hz. No estimator, no E2E.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
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
WAYS = ("dsz", "watched", "peer")
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
    command = [str(ROOT / "tests/vcan/guest"), "-p", "-t", str(limit_s), "-w", str(out), sys.executable, *inside]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=limit_s + 600, check=False)
    if done.returncode == NO_WAY:
        print(done.stderr.strip(), file=sys.stderr)
        raise SystemExit(NO_WAY)
    if done.returncode != 0:
        raise SystemExit(f"{who}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    names = ("cost.json", "summary.json", "hitches.json")
    cost, summary, hitches = (json.loads((out / name).read_text()) for name in names)
    return {"who": who, **cost, "summary": summary, "hitches": hitches}


def figures(result: dict[str, Any], frames: int) -> dict[str, Any]:
    """One way's row: shares, times in ms."""
    summary, live = result["summary"], result["summary"].get("live", {})
    late = live.get("lateness_us") or summary["lateness_us"]
    buses = live.get("buses", {}).values()
    return {
        "who": result["who"],
        "frames_per_s": frames / result["seconds"],
        "lost": sum(bus["lost"] for bus in buses) if live else max(0, frames - summary["received"]),
        "dropped": sum(bus["dropped"] for bus in buses),
        "missed": summary["counts"]["missed"] if live else None,
        "rows": summary["rows"] if live else summary["sent"] // 2,
        "cpu": result["cpu_share"],
        **{f"{name}_ms": late[name] * 1e-3 for name in ("p50", "p99", "max")},
    }


def table(rows: list[dict[str, Any]]) -> str:
    """As Markdown."""
    lines = ["| | frames/s in | lost | ticks | missed | CPU | late p50 | p99 | max, ms |", "|" + "---|" * 9]
    for row in rows:
        missed = "-" if row["missed"] is None else row["missed"]
        lines.append(
            f"| {row['who']} | {row['frames_per_s']:.0f} | {row['lost']} | {row['rows']} | {missed} | "
            f"{100 * row['cpu']:.1f} % | {row['p50_ms']:.2f} | {row['p99_ms']:.2f} | {row['max_ms']:.2f} |"
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


def report(rows: list[dict[str, Any]]) -> str:
    """All of it, of rows that have their `result` and what they are `of`."""
    texts = [
        f"{rows[0]['of'].of}, filled up to {FRAMES_PER_S} frames/s",
        table(rows),
        histogram([row["result"] for row in rows]),
    ]
    hitches = [len(row["result"]["hitches"]) for row in rows]
    texts.append(f"hitches of the machine over 4 ms meanwhile (tests/vcan/hitches.py): {', '.join(map(str, hitches))}")
    by_way = {row["who"]: row for row in rows}
    if {"dsz", "peer"} <= set(by_way):
        texts.append(f"CPU, dsz over peer: {by_way['dsz']['cpu'] / by_way['peer']['cpu']:.2f}")
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
