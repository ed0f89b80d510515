"""Inside: plays a recording onto vcan0 into `dsz run` (or its peer), with candump as an independent witness.

    python tests/vcan/bus_run.py LOG CHANNEL[,CHANNEL] CONFIG OUT {dsz|peer} [SECONDS]

OUT gets bus.log (all of the bus, by candump), summary.json and cost.json: CPU time, frames sent, lateness.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent


def cpu_s(pid: int) -> float:
    """CPU time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


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


def main(log: str, channel: str, config: str, out: str, who: str, seconds: str = "60") -> None:
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    ready_file = folder / "ready"
    ready_file.unlink(missing_ok=True)
    program = [str(HERE / ("peer.py" if who == "peer" else "live_on.py")), config, str(folder)]
    with (folder / "bus.log").open("w") as record, (folder / "said.txt").open("w") as said:
        daemon = subprocess.Popen([sys.executable, *program], stdout=said, stderr=said)
        ready(ready_file, daemon)
        witness = subprocess.Popen(["candump", "-L", "-r", "4000000", "vcan0"], stdout=record)
        time.sleep(0.5)
        before: dict[str, Any] = {"cpu_s": cpu_s(daemon.pid), "at_s": time.monotonic()}
        played = subprocess.Popen(
            ["canplayer", "-I", log, *(f"vcan0={name}" for name in channel.split(","))], stdin=subprocess.DEVNULL
        )
        rss = []
        while played.poll() is None and time.monotonic() < before["at_s"] + float(seconds):
            time.sleep(1.0)
            rss.append(rss_kib(daemon.pid))
        played.kill()
        took_s = time.monotonic() - before["at_s"]
        used_s = cpu_s(daemon.pid) - before["cpu_s"]
        time.sleep(0.3)
        daemon.send_signal(signal.SIGTERM)
        code = daemon.wait(60.0)
        witness.terminate()
        witness.wait(10.0)
    cost = {"seconds": took_s, "cpu_s": used_s, "cpu_share": used_s / took_s, "exit": code, "rss_kib": rss}
    (folder / "cost.json").write_text(json.dumps(cost))


if __name__ == "__main__":
    main(*sys.argv[1:])
