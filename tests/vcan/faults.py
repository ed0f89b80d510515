"""Inside: injects faults into a running `dsz run`, one after the other, and writes down what it makes of them.

    python tests/vcan/faults.py OUT [PATTERN OF NAMES]   OUT/faults.json
    python tests/vcan/faults.py --table OUT/faults.json

The car stands, the gyros have converged. Each fault is put in, looked at ten times a second, taken
out; then it is waited until values are valid again.
"""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from fault_bench import CHANNEL, GOLDEN, Bench, Daemon, Listener, Player, ip_link, make_interface
from fault_flags import Status, flags, worst_move
from fault_list import FAULTS, Fault

_LOOK_S = 0.1
_STEADY = 20
_UNTIL_S = 90.0
_SETTINGS = "service: {wait_for_bus: true, save_period_s: 0.5}\noutput: {on_conflict: report}\n"


def settled(bench: Bench, at_most_s: float = 6.0) -> Status:
    """The status once all gyros are converged, or after a while anyway."""
    end_s = time.monotonic() + at_most_s
    while True:
        status = bench.daemon.status()
        late = time.monotonic() > end_s
        if status is not None:
            gyros = [c["state"] for name, c in status["channels"].items() if name.startswith("gyro")]
            if late or all(state == "converged" for state in gyros):
                return status
        elif late and not bench.daemon.is_alive:
            sys.exit(f"the daemon is gone: {bench.daemon.said_path.read_text()}")
        time.sleep(_LOOK_S)


class Trial:
    """One fault: watched while it is there, and until it is over."""

    def __init__(self, bench: Bench, fault: Fault) -> None:
        self.bench, self.fault = bench, fault
        self.before = settled(bench)
        self.begin_s = time.monotonic()
        self.flags: dict[str, float] = {}
        self.now: set[str] = set()
        self.worst = (0.0, "", 0.0, 0.0)

    def look(self) -> None:
        """One answer of the daemon."""
        status = self.bench.daemon.status(0.3)
        self.now = flags(self.before, status)
        for flag in self.now:
            self.flags.setdefault(flag, round(max(0.0, time.monotonic() - self.begin_s), 2))
        self.worst = max(self.worst, worst_move(self.before, status))
        time.sleep(_LOOK_S)

    def has(self, pattern: str, among: set[str] | None = None) -> bool:
        """Whether a flag matches."""
        return any(re.search(pattern, flag) for flag in (self.flags if among is None else among))

    def run(self) -> dict[str, Any]:
        """Everything there is to tell of it."""
        fault = self.fault
        asked_s = time.monotonic()
        with fault.inject(self.bench):
            there_s = self.begin_s = time.monotonic()
            while time.monotonic() < there_s + fault.seconds or (
                fault.until and not self.has(fault.until) and time.monotonic() < there_s + _UNTIL_S
            ):
                self.look()
            end_s = time.monotonic()
        gone_s = time.monotonic()
        recovery_s = self.recover(gone_s)
        for _ in range(5):
            self.look()
        return {"injected_in_s": round(there_s - asked_s, 2)} | self.told(there_s, end_s, gone_s, recovery_s)

    def recover(self, gone_s: float) -> float | None:
        """Until the first of a run of valid outputs, in s from the fault's end; None: not in time."""
        fault = self.fault
        while time.monotonic() < gone_s + fault.recovery_limit_s + 1.0:
            self.look()
            heard = self.bench.listener.between(gone_s - 0.05, float("inf"))
            steady = heard[-_STEADY:]
            if len(steady) < _STEADY or not all(one.is_valid for one in steady) or self.has(fault.calm, self.now):
                continue
            first = len(heard) - 1
            while first > 0 and heard[first - 1].is_valid and heard[first].t_s - heard[first - 1].t_s < 0.1:
                first -= 1
            if fault.calm != "$never":
                return time.monotonic() - gone_s
            return max(0.0, heard[first].t_s - gone_s)
        return None

    def told(self, there_s: float, end_s: float, gone_s: float, recovery_s: float | None) -> dict[str, Any]:
        """The record."""
        fault, listener = self.fault, self.bench.listener
        heard = listener.between(there_s, end_s)
        late = listener.between(0.5 * (there_s + end_s), end_s)
        around = [there_s, *(one.t_s for one in listener.between(there_s, gone_s + 6.0))]
        rates = [abs(rate) for one in heard for rate in one.rates if rate is not None]
        matching = [t_s for flag, t_s in self.flags.items() if fault.flagged and re.search(fault.flagged, flag)]
        valid = sum(one.is_valid for one in late)
        share, channel, change, bound = self.worst
        after = self.bench.daemon.status()
        return {
            "name": fault.name,
            "seconds": round(end_s - there_s, 2),
            "published_per_s": round(len(heard) / (end_s - there_s), 1),
            "values": "none"
            if not late
            else "valid"
            if valid > 0.95 * len(late)
            else "not available"
            if valid < 0.05 * len(late)
            else "mixed",
            "largest_rate_degps": round(max(rates), 3) if rates else None,
            "longest_pause_s": round(max((b - a for a, b in itertools.pairwise(around)), default=0.0), 3),
            "flagged_after_s": round(min(matching), 2) if matching else None,
            "flags": self.flags,
            "saturated_share": round(sum(one.is_saturated for one in late) / max(1, len(late)), 3),
            "recovery_s": None if recovery_s is None else round(recovery_s, 2),
            "moved_share": round(share, 3),
            "moved_channel": channel,
            "moved_si": change,
            "bound_si": bound,
            "alive": self.bench.daemon.is_alive,
            "traceback": self.bench.daemon.has_raised,
            "expected": {"flagged": fault.flagged, "values": fault.values, "recovery_s": fault.recovery_limit_s},
            "why": fault.why,
            "buses": after["buses"] if after else None,
            "offsets_before_si": {name: c["offset"] for name, c in self.before["channels"].items()},
        }


def absent_at_start(bench: Bench) -> dict[str, Any]:
    """The daemon was started without its interface; it comes now."""
    begin_s = time.monotonic()
    status = None
    while status is None and time.monotonic() < begin_s + 60.0:
        status = bench.daemon.status()
        time.sleep(_LOOK_S)
    link = status["buses"][0]["link"] if status else ""
    make_interface()
    made_s = time.monotonic()
    while not any(one.is_valid for one in bench.listener.heard) and time.monotonic() < made_s + 10.0:
        time.sleep(0.02)
    valid = [one.t_s for one in bench.listener.heard if one.is_valid]
    return {
        "name": "interface absent at start",
        "seconds": round(made_s - begin_s, 2),
        "published_per_s": 0.0,
        "values": "none",
        "largest_rate_degps": None,
        "longest_pause_s": None,
        "flagged_after_s": 0.0 if link == "absent" else None,
        "flags": {f"link {link}": 0.0},
        "saturated_share": 0.0,
        "recovery_s": round(valid[0] - made_s, 2) if valid else None,
        "moved_share": 0.0,
        "moved_channel": "",
        "moved_si": 0.0,
        "bound_si": 0.0,
        "alive": bench.daemon.is_alive,
        "traceback": bench.daemon.has_raised,
        "expected": {"flagged": "link absent", "values": "none", "recovery_s": 5.0},
        "why": "",
    }


def main(out: Path, only: str = "") -> None:
    """Runs them all, or those whose name matches `only`."""
    out.mkdir(parents=True, exist_ok=True)
    is_guest = os.environ.get("DSZ_GUEST") == "uml"
    shutil.copytree(GOLDEN / "sine_steer", out / "config", dirs_exist_ok=True)
    config = out / "config/config.yaml"
    config.write_text((GOLDEN / "sine_steer/config.yaml").read_text() + _SETTINGS)
    state = (Path("/run/dsz-faults") if is_guest else out / "state") / "offsets.json"
    state.parent.mkdir(parents=True, exist_ok=True)
    if is_guest:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "state", str(state.parent)], check=True)
    ip_link("del", CHANNEL)
    run_folder = Path("/run") if is_guest else out
    bench = Bench(Player(), Listener(), Daemon(run_folder, config, state), config, state)
    bench.player.start()
    bench.listener.start()
    results = [absent_at_start(bench)]
    settled(bench, 15.0)
    time.sleep(6.0)
    for fault in FAULTS:
        if re.search(only, fault.name) and (is_guest or not fault.guest_only):
            results.append(Trial(bench, fault).run())
            print(row(results[-1]), flush=True)
            (out / "faults.json").write_text(json.dumps(results, indent=1))
    bench.daemon.process.terminate()
    code = bench.daemon.process.wait(30.0)
    (out / "end.json").write_text(json.dumps({"exit": code, "traceback": bench.daemon.has_raised}))
    shutil.copy(bench.daemon.said_path, out / "daemon.txt")


_HEAD = ("fault", "published meanwhile", "flagged after", "as", "recovery", "offset moved / its bound")


def row(result: dict[str, Any]) -> str:
    """One line of the table."""
    published = f"{result['published_per_s']:.0f}/s"
    if result["values"] != "none":
        published += f", {result['values']}"
    if result["largest_rate_degps"] is not None:
        published += f", rates to {result['largest_rate_degps']:.2f} deg/s"
    if result["saturated_share"] > 0.5:
        published += " (marked saturated)"
    after = result["flagged_after_s"]
    pattern = result["expected"]["flagged"]
    told = [flag for flag in result["flags"] if pattern and re.search(pattern, flag)]
    flagged = "not flagged" if after is None else f"{after:.1f} s"
    words = ", ".join(told[:2]) or result["why"]
    recovery = "none in time" if result["recovery_s"] is None else f"{result['recovery_s']:.2f} s"
    moved = f"{result['moved_share']:.2f} {result['moved_channel']}".strip()
    if result["moved_share"] > 1.0:
        moved += ": beyond its bound"
    return f"| {' | '.join((result['name'], published, flagged, words, recovery, moved))} |"


def table(results: list[dict[str, Any]]) -> str:
    """All of it as Markdown."""
    return "\n".join([f"| {' | '.join(_HEAD)} |", "|" + " --- |" * len(_HEAD), *map(row, results)])


if __name__ == "__main__":
    if sys.argv[1] == "--table":
        print(table(json.loads(Path(sys.argv[2]).read_text())))
    else:
        main(Path(sys.argv[1]).resolve(), *sys.argv[2:3])
