"""Inside: what a fault is tried on. A player that may be told to lie, a listener, the daemon and its status.

Only the standard library: an import of anything large costs seconds in the guest.
"""

from __future__ import annotations

import contextlib
import gzip
import heapq
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from dsz_daemon.edge.status_socket import ask
from dsz_daemon.errors import DszError

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "tests/golden"
CHANNEL = "vcan0"
IMU_RATE, IMU_ACCEL, WHEELS, STEERING, RATES = 0x500, 0x501, 0x386, 0x2B0, 0x6D0
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000
FD_MTU = 72
_NOT_AVAILABLE = -32768
# The car stands still for so long at the log's beginning.
_STANDING_S = 3.0
_BEHIND_S = 0.2
_RETRY_S = 0.05
_LINE = re.compile(r"\((\d+\.\d+)\) can0 ([0-9A-F]+)#([0-9A-F]*)")

Sent = tuple[float, bytes]
Lie = Callable[[int, bytes], list[Sent]]


def classical(can_id: int, data: bytes) -> bytes:
    """struct can_frame."""
    return struct.pack("=IB3x8s", can_id, len(data), data)


def flexible(can_id: int, data: bytes) -> bytes:
    """struct canfd_frame."""
    return struct.pack("=IBB2x64s", can_id, len(data), 0x04, data)


def as_it_is(can_id: int, data: bytes) -> list[Sent]:
    """The truth."""
    return [(0.0, classical(can_id, data))]


def raw_socket(filters: bytes | None = None) -> socket.socket:
    """A raw socket on vcan0; OSError while it is not there.

    Looked for in a file first: binding to a name that is not there makes the kernel run modprobe.
    """
    if f"{CHANNEL}:" not in Path("/proc/net/dev").read_text():
        raise OSError(f"no {CHANNEL}")
    opened = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    try:
        opened.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        opened.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters or b"")
        opened.bind((CHANNEL,))
    except OSError:
        opened.close()
        raise
    return opened


def ip_link(*arguments: str) -> None:
    """`ip link ...`."""
    subprocess.run(["ip", "link", *arguments], check=True)


def make_interface() -> None:
    """vcan0, able to carry CAN FD, up."""
    ip_link("add", CHANNEL, "type", "vcan")
    ip_link("set", CHANNEL, "mtu", str(FD_MTU))
    ip_link("set", CHANNEL, "up")


class Player(threading.Thread):
    """Sends the standing car over and over; `lie` turns each of its frames into others."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.lie: Lie = as_it_is
        self.paused = False
        # Sent besides, `extra_per_s` a second.
        self.extra: Callable[[], bytes] | None = None
        self.extra_per_s = 0.0
        self._frames = self._read()

    def _read(self) -> list[tuple[float, int, bytes]]:
        frames, first_s = [], None
        with gzip.open(GOLDEN / "sine_steer.log.gz", "rt") as log:
            for line in log:
                found = _LINE.match(line)
                if found is None:
                    continue
                t_s = float(found[1])
                first_s = t_s if first_s is None else first_s
                if t_s - first_s >= _STANDING_S:
                    break
                can_id = int(found[2], 16) | (EXTENDED if len(found[2]) > 3 else 0)
                frames.append((t_s - first_s, can_id, bytes.fromhex(found[3])))
        return frames

    def run(self) -> None:
        opened, waiting, number = None, list[tuple[float, int, bytes]](), 0
        start_s = extra_s = time.monotonic()
        retry_s = 0.0
        index = 0
        while True:
            now_s = time.monotonic()
            due_s = start_s + self._frames[index][0]
            if due_s < now_s - _BEHIND_S:
                # A real bus does not catch up on what it could not send.
                start_s, due_s = start_s + now_s - due_s, now_s
            while due_s <= now_s:
                _, can_id, data = self._frames[index]
                if not self.paused:
                    for delay_s, frame in self.lie(can_id, data):
                        number += 1
                        heapq.heappush(waiting, (now_s + delay_s, number, frame))
                index += 1
                if index == len(self._frames):
                    index, start_s = 0, start_s + _STANDING_S
                due_s = start_s + self._frames[index][0]
            extra = self.extra
            if extra is None:
                extra_s = now_s
            else:
                count = min(200, int((now_s - extra_s) * self.extra_per_s))
                extra_s = now_s if count == 200 else extra_s + count / self.extra_per_s
                for _ in range(count):
                    number += 1
                    heapq.heappush(waiting, (now_s, number, extra()))
            while waiting and waiting[0][0] <= now_s:
                frame = heapq.heappop(waiting)[2]
                if opened is None and now_s < retry_s:
                    continue
                try:
                    opened = opened or raw_socket()
                    opened.send(frame)
                except OSError:
                    if opened is not None:
                        opened.close()
                    opened, retry_s = None, now_s + _RETRY_S
            time.sleep(0.002)


class Heard(NamedTuple):
    """One DSZ_RATES: monotonic time, roll, pitch and yaw rate in deg/s, None where not available.

    `is_saturated`: one of them is marked as beyond what the frame can hold.
    """

    t_s: float
    rates: tuple[float | None, ...]
    is_saturated: bool

    @property
    def is_valid(self) -> bool:
        """Whether all three are there."""
        return None not in self.rates


class Listener(threading.Thread):
    """Hears DSZ_RATES, but for those of our own that bear FOREIGN."""

    FOREIGN = b"\x11" * 6

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.heard: list[Heard] = []

    def run(self) -> None:
        only_rates = struct.pack("=II", RATES, 0x7FF | EXTENDED | REMOTE)
        while True:
            try:
                opened = raw_socket(only_rates)
            except OSError:
                time.sleep(0.02)
                continue
            with opened:
                opened.settimeout(0.5)
                self._listen(opened)

    def _listen(self, opened: socket.socket) -> None:
        while True:
            try:
                frame = opened.recv(FD_MTU)
            except TimeoutError:
                continue
            except OSError as error:
                if error.errno == 100:  # ENETDOWN: it may come up again
                    time.sleep(0.02)
                    continue
                return
            if frame[10:16] == self.FOREIGN:
                continue
            raw = struct.unpack_from("<3h", frame, 10)
            rates = tuple(None if value == _NOT_AVAILABLE else value * 0.01 for value in raw)
            self.heard.append(Heard(time.monotonic(), rates, bool(frame[9] & 0x70)))

    def between(self, begin_s: float, end_s: float) -> list[Heard]:
        """What was heard from begin_s to end_s, monotonic."""
        return [heard for heard in self.heard if begin_s <= heard.t_s < end_s]


class Daemon:
    """`dsz run` in a process of its own."""

    def __init__(self, folder: Path, config: Path, state: Path) -> None:
        self.status_path, self.said_path = folder / "s.sock", folder / "said.txt"
        self._command = [sys.executable, "-m", "dsz_daemon", "run", "-c", str(config)]
        self._command += ["--bus", f"can0=socketcan:{CHANNEL}", "--status", str(self.status_path)]
        self._command += ["--state", str(state)]
        self.said_path.write_text("")
        self.start()

    def start(self) -> None:
        """Starts it (again)."""
        with self.said_path.open("a") as said:
            self.process = subprocess.Popen(self._command, stdout=said, stderr=said, cwd=ROOT)

    def status(self, timeout_s: float = 0.5) -> dict[str, Any] | None:
        """What it answers; None where it does not."""
        try:
            return ask(self.status_path, timeout_s)
        except DszError:
            return None

    def hang_up(self) -> None:
        """SIGHUP: read the configuration again."""
        self.process.send_signal(signal.SIGHUP)

    def children(self) -> list[int]:
        """Its child processes."""
        found = []
        for entry in Path("/proc").iterdir():
            if entry.name.isdecimal():
                with contextlib.suppress(OSError):
                    parent = (entry / "stat").read_text().rpartition(")")[2].split()[1]
                    if int(parent) == self.process.pid:
                        found.append(int(entry.name))
        return found

    @property
    def is_alive(self) -> bool:
        """Whether it still runs."""
        return self.process.poll() is None

    @property
    def has_raised(self) -> bool:
        """Whether a traceback was ever printed."""
        return "Traceback" in self.said_path.read_text()


@dataclass
class Bench:
    """What faults work on."""

    player: Player
    listener: Listener
    daemon: Daemon
    config: Path
    state: Path
