"""Inside: minutes of `dsz run` on vcan0, fed by canplayer over and over, and watched from outside. A soak.

    tests/vcan/guest -t 900 .venv/bin/python tests/vcan/soak_on.py [SECONDS]

Memory (a straight line through RSS), descriptors and counters are those of tests/soak/live_soak.py.
"""

from __future__ import annotations

import gzip
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
GOLDEN = HERE.parent / "golden"
sys.path.insert(0, str(HERE.parent / "soak"))

import live_soak  # noqa: E402
from bus_run import ready  # noqa: E402


def main(seconds: str = "600") -> int:
    """0 if memory is flat and the counters add up."""
    folder = Path(tempfile.mkdtemp())
    log = folder / "drive.log"
    log.write_bytes(gzip.decompress((GOLDEN / "sine_steer.log.gz").read_bytes()))
    shutil.copytree(GOLDEN / "sine_steer", folder / "config")
    config, status = folder / "config/config.yaml", folder / "status.sock"
    daemon = subprocess.Popen([sys.executable, str(HERE / "live_on.py"), str(config), str(folder), str(status)])
    ready(folder / "ready", daemon)
    player = subprocess.Popen(["canplayer", "-l", "i", "-I", str(log), "vcan0=can0"], stdin=subprocess.DEVNULL)
    try:
        seen = live_soak.watch(daemon.pid, status, float(seconds), period_s=2.0)
    finally:
        player.kill()
        daemon.send_signal(signal.SIGTERM)
        code = daemon.wait(60.0)
    print(live_soak.told(seen, float(seconds)))
    print(f"exit code {code}")
    return 1 if seen.faults or code else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
