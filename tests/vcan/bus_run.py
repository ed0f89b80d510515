"""Inside: plays a recording onto vcan0 into `dsz run` (or its peer), with candump as an independent witness.

    python tests/vcan/bus_run.py LOG CHANNEL[,CHANNEL] CONFIG OUT {dsz|watched|peer|nobody} [SECONDS]

OUT gets bus.log (all of the bus, by candump), summary.json, cost.json (memory, answers), hitches.json, see
hitches.py, and files `begun` and `ended` with these times in ns: what it costs meanwhile is measured from outside.
"watched" is dsz with `dsz monitor` on a terminal, `dsz metrics` asked once a second, and `status` ten times.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path
from typing import Any

from dsz_daemon.edge.status_socket import ask
from dsz_daemon.errors import DszError

HERE = Path(__file__).parent


def rss_kib(pid: int) -> int:
    """Resident memory of a process."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1])
    return 0


def ready(path: Path, process: subprocess.Popen[bytes]) -> None:
    """Waits for a file that says that the daemon's socket is open."""
    end_s = time.monotonic() + 120.0
    while not path.exists():
        if process.poll() is not None or time.monotonic() > end_s:
            sys.exit(f"the daemon did not start: {process.returncode}")
        time.sleep(0.05)


def deliver_at_once() -> None:
    """In a guest, frames that the kernel has stamped but not delivered go before all programs.

    On a busy CPU the delivery is left to ksoftirqd, an ordinary process: it would wait for programs of real time.
    And a guest's kernel counts CPU time in whole ticks of 10 ms: a daemon that wakes at each of them seems to take all
    of a CPU, and would be halted for the 50 ms of each second that real time leaves to others.
    """
    if os.environ.get("DSZ_GUEST") == "uml":
        Path("/proc/sys/kernel/sched_rt_runtime_us").write_text("-1")
        for stat in Path("/proc").glob("[0-9]*/stat"):
            if "(ksoftirqd/" in stat.read_text():
                subprocess.run(["chrt", "-f", "-p", "28", stat.parent.name], check=True)


class Watchers:
    """All who may look at a running daemon, at once; `seen` counts the answers."""

    METRICS = "127.0.0.1:9273"

    def __init__(self, status: Path, folder: Path) -> None:
        self.seen = {"status": 0, "metrics": 0}
        dsz = [sys.executable, "-m", "dsz_daemon"]
        monitor = " ".join([*dsz, "monitor", "--socket", str(status)])
        self._screen = folder / "screen.txt"
        # `script` gives it a terminal.
        self._others = [
            subprocess.Popen(["script", "-qfc", monitor, str(self._screen)], stdin=subprocess.DEVNULL,
                             stdout=subprocess.DEVNULL),
            subprocess.Popen([*dsz, "metrics", "--socket", str(status), "--listen", self.METRICS]),
        ]  # fmt: skip
        self._status, self._stop = status, threading.Event()
        self._threads = [
            threading.Thread(target=self._ask, args=(self._status_once, 0.1)),
            threading.Thread(target=self._ask, args=(self._metrics_once, 1.0)),
        ]
        for thread in self._threads:
            thread.start()

    def settled(self) -> None:
        """Waits until all of them have begun: a program's start is no part of being looked at."""
        end_s = time.monotonic() + 120.0
        while min(self.seen.values()) < 2 or not self._screen.exists() or self._screen.stat().st_size < 2000:
            if time.monotonic() > end_s:
                sys.exit(f"the watchers did not start: {self.seen}")
            time.sleep(0.2)

    def _ask(self, once: Any, period_s: float) -> None:
        while not self._stop.wait(period_s):
            try:
                once()
            except (OSError, DszError):
                continue

    def _status_once(self) -> None:
        ask(self._status, 2.0)
        self.seen["status"] += 1

    def _metrics_once(self) -> None:
        with urllib.request.urlopen(f"http://{self.METRICS}/metrics", timeout=5.0) as page:
            page.read()
        self.seen["metrics"] += 1

    def close(self) -> None:
        """All of them go."""
        self._stop.set()
        for thread in self._threads:
            thread.join(10.0)
        for other in self._others:
            other.terminate()
            other.wait(10.0)


def main(log: str, channel: str, config: str, out: str, who: str, seconds: str = "60") -> None:
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    ready_file = folder / "ready"
    ready_file.unlink(missing_ok=True)
    status = Path(tempfile.mkdtemp()) / "status.sock"
    program = [str(HERE / "live_on.py"), config, str(folder), str(status)]
    if who in ("peer", "nobody"):
        program = [str(HERE / f"{who}.py"), config, str(folder)]
    deliver_at_once()
    # In memory, and before the others: a witness that waits for a disk or for its turn loses frames.
    scratch = Path(tempfile.mkdtemp(dir="/dev/shm"))
    with (scratch / "bus.log").open("w") as record, (folder / "said.txt").open("w") as said:
        # As with service.realtime_priority: 20, for in a guest all programs share one CPU. The peer too.
        daemon = subprocess.Popen(["chrt", "-f", "20", sys.executable, *program], stdout=said, stderr=said)
        ready(ready_file, daemon)
        watchers = Watchers(status, folder) if who == "watched" else None
        if watchers is not None:
            watchers.settled()
        # Its buffer holds seconds: it need not go before the daemon, and at 0.2 ms a frame in a guest it must not.
        witness = subprocess.Popen(["chrt", "-f", "10", "candump", "-L", "-r", "4000000", "vcan0"], stdout=record)
        time.sleep(0.5)
        late = [sys.executable, str(HERE / "hitches.py"), str(folder / "hitches.json")]
        hitches = subprocess.Popen(["chrt", "-f", "30", *late])
        begun_s = time.monotonic()
        (folder / "begun").write_text(str(time.time_ns()))
        played = subprocess.Popen(
            ["canplayer", "-I", log, *(f"vcan0={name}" for name in channel.split(","))], stdin=subprocess.DEVNULL
        )
        rss = []
        while played.poll() is None and time.monotonic() < begun_s + float(seconds):
            time.sleep(1.0)
            rss.append(rss_kib(daemon.pid))
        played.kill()
        took_s = time.monotonic() - begun_s
        (folder / "ended").write_text(str(time.time_ns()))
        time.sleep(0.3)
        if watchers is not None:
            watchers.close()
        daemon.send_signal(signal.SIGTERM)
        code = daemon.wait(60.0)
        hitches.terminate()
        hitches.wait(10.0)
        witness.terminate()
        witness.wait(10.0)
    shutil.copy(scratch / "bus.log", folder / "bus.log")
    cost = {"seconds": took_s, "exit": code, "rss_kib": rss, "answers": watchers.seen if watchers is not None else {}}
    (folder / "cost.json").write_text(json.dumps(cost))


if __name__ == "__main__":
    main(*sys.argv[1:])
