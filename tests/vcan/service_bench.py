"""Inside, under systemd: dsz installed, its service looked at, frames played to it. Only the standard library."""

from __future__ import annotations

import gzip
import json
import math
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from guest_checks import Checks
from vehicle import DSZ, PROJECT, install_dsz

sys.path.insert(0, str(PROJECT))

from dsz_daemon.edge.status_socket import ask
from dsz_daemon.errors import DszError

GOLDEN = PROJECT / "tests" / "golden"
CONFIG = Path("/etc/dsz/config.yaml")
FIRST_OUTPUT_ID = "6D0"
_LOG = Path("/run/drive.log")


def command(*words: object) -> subprocess.CompletedProcess[str]:
    """Runs a command; its output is for the caller."""
    return subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False)


def said(*words: object) -> str:
    """All that a command said."""
    done = command(*words)
    return (done.stdout + done.stderr).strip()


def prepare(checks: Checks, service: str, *options: str) -> str:
    """Installs dsz and its service for the golden drive, with more `service` settings; returns what was said."""
    install_dsz()
    folder = Path("/run/mine")
    shutil.copytree(GOLDEN / "sine_steer", folder)
    (folder / "config.yaml").open("a").write(f"service: {{{service}}}\n")
    _LOG.write_bytes(gzip.decompress((GOLDEN / "sine_steer.log.gz").read_bytes()))
    return install(checks, "-c", str(folder / "config.yaml"), *options)


def install(checks: Checks, *options: str) -> str:
    """Runs `dsz install-service --write`; returns what it said."""
    done = command(DSZ, "install-service", "--write", *options)
    checks.equal(f"install-service {' '.join(option for option in options if option[0] == '-')}", done.returncode, 0)
    checks.equal("install-service finds its place visible to services", done.stderr, "")
    command("systemctl", "daemon-reload")
    return done.stdout


class Unit:
    """A unit as systemd shows it."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __getitem__(self, name: str) -> str:
        return said("systemctl", "show", "-P", name, self.name)

    @property
    def is_active(self) -> bool:
        """Started and, as Type=notify has it, ready."""
        return self["ActiveState"] == "active"

    @property
    def pid(self) -> int:
        """Of its main process; 0 for none."""
        return int(self["MainPID"])

    def process(self) -> dict[str, str]:
        """The lines of the main process's /proc/PID/status; none where there is no process."""
        try:
            text = Path(f"/proc/{self.pid}/status").read_text()
        except OSError:
            return {}
        return {key: value.strip() for key, _, value in (line.partition(":") for line in text.splitlines())}

    @property
    def user(self) -> str:
        """The numeric user of its main process; empty for none."""
        return self.process().get("Uid", "").partition("\t")[0]

    def signal(self, number: signal.Signals) -> None:
        """Sends a signal to the main process alone."""
        command("kill", f"-{number.value}", self.pid)

    def events(self, kind: str) -> list[dict[str, Any]]:
        """Its journal entries with the field DSZ_EVENT=kind."""
        lines = said("journalctl", "-q", "-o", "json", "-u", self.name, f"DSZ_EVENT={kind}").splitlines()
        return [json.loads(line) for line in lines]

    def journal(self, *options: str) -> str:
        """All of it, as text; with options of journalctl, a part."""
        return said("journalctl", "-q", "-o", "cat", "-u", self.name, *options)


def status(socket: str = "/run/dsz/status.sock") -> dict[str, Any]:
    """The running daemon's answer; empty where it does not answer."""
    try:
        return dict(ask(Path(socket), 5.0))
    except DszError:
        return {}


def restored_age_s() -> float:
    """How old the offsets were that the running daemon took over from its state file; -1 if it took none."""
    age_s = status().get("state_file", {}).get("restored_age_s")
    return -1.0 if age_s is None else float(age_s)


def missed_ticks() -> int:
    """How many ticks the running daemon has missed so far."""
    return int(status().get("missed_ticks", 0))


def yaw_offset() -> dict[str, float]:
    """Offset and spread of the yaw rate, of the running daemon."""
    channel = status().get("channels", {}).get("gyro_z", {})
    return {name: math.nan if channel.get(name) is None else channel[name] for name in ("offset", "offset_std")}


def play(interface: str = "vcan0") -> subprocess.Popen[bytes]:
    """Plays the drive onto the bus, over and over."""
    words = ["canplayer", "-l", "i", "-I", str(_LOG), f"{interface}=can0"]
    return subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def publishes(interface: str = "vcan0") -> bool:
    """Whether compensated frames come."""
    done = command("candump", "-n", "3", "-T", "20000", f"{interface},{FIRST_OUTPUT_ID}:7FF")
    return done.stdout.count(f" {FIRST_OUTPUT_ID} ") == 3


def plug(interface: str = "vcan0") -> None:
    """The interface is created and set up."""
    command("ip", "link", "add", interface, "type", "vcan")
    command("ip", "link", "set", interface, "up")


def unplug(interface: str = "vcan0") -> None:
    """The interface is gone."""
    command("ip", "link", "del", interface)


def journal() -> str:
    """Everything since boot, for whoever has to find out what went wrong."""
    return said("journalctl", "-q", "-o", "short-monotonic")


def exposure(checks: Checks, unit: str, limit: float) -> None:
    """The unit is as closed as it should be by systemd's own figure: 0 is safe, 10 is not."""
    done = command("systemd-analyze", "security", "--no-pager", f"--threshold={round(limit * 10)}", unit)
    checks.tell(done.stdout.strip().splitlines()[-1])
    checks.check(f"exposure of {unit} is at most {limit}", done.returncode == 0, done.stdout)


def sound(checks: Checks, unit: str, limit: float) -> None:
    """The unit is without fault, and closed."""
    checks.equal(f"verify of {unit} is clean", said("systemd-analyze", "verify", "--man=no", unit), "")
    exposure(checks, unit, limit)
