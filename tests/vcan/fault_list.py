"""Inside: the faults. Each is a context manager: entered it is there, left it is gone."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

from fault_bench import (
    CHANNEL,
    ERROR,
    EXTENDED,
    IMU_ACCEL,
    IMU_RATE,
    RATES,
    REMOTE,
    WHEELS,
    Bench,
    Lie,
    Listener,
    Sent,
    as_it_is,
    classical,
    flexible,
    ip_link,
    make_interface,
    raw_socket,
)

IMU = frozenset({IMU_RATE, IMU_ACCEL})


Inject = Callable[[Bench], AbstractContextManager[None]]


@dataclass(frozen=True)
class Fault:
    """`flagged`: what one of the flags must match ("" : nothing can be told of it, and `why` says why).

    `values` published in the fault's second half: "valid", "none" (nothing is published), "not available"
    or "any". `until` is a flag that must be seen before the fault ends, `calm` one that must be gone for
    it to be over.
    """

    name: str
    inject: Inject
    flagged: str
    values: str = "valid"
    seconds: float = 1.5
    why: str = ""
    until: str = ""
    calm: str = "$never"
    recovery_limit_s: float = 5.0
    guest_only: bool = False


def telling(lie: Lie) -> Inject:
    """The player lies."""

    @contextmanager
    def inject(bench: Bench) -> Iterator[None]:
        bench.player.lie = lie
        try:
            yield
        finally:
            bench.player.lie = as_it_is

    return inject


def besides(extra: Callable[[], bytes], per_s: float) -> Inject:
    """The player sends something besides."""

    @contextmanager
    def inject(bench: Bench) -> Iterator[None]:
        bench.player.extra_per_s, bench.player.extra = per_s, extra
        try:
            yield
        finally:
            bench.player.extra = None

    return inject


def on(ids: frozenset[int], change: Callable[[bytes], bytes | None]) -> Lie:
    """Changes the data of these ids; None: the frame is not sent."""

    def lie(can_id: int, data: bytes) -> list[Sent]:
        if can_id not in ids:
            return as_it_is(can_id, data)
        changed = change(data)
        return [] if changed is None else [(0.0, classical(can_id, changed))]

    return lie


class Sometimes:
    """Changes every n-th frame of these ids."""

    def __init__(self, ids: frozenset[int], every: int, change: Callable[[bytes], bytes]) -> None:
        self._ids, self._every, self._change, self._count = ids, every, change, 0

    def __call__(self, can_id: int, data: bytes) -> list[Sent]:
        """A Lie."""
        if can_id in self._ids:
            self._count += 1
            if self._count % self._every == 0:
                data = self._change(data)
        return as_it_is(can_id, data)


class Frozen:
    """Every frame has the data of the first of its id."""

    def __init__(self) -> None:
        self._first: dict[int, bytes] = {}

    def __call__(self, can_id: int, data: bytes) -> list[Sent]:
        """A Lie."""
        return as_it_is(can_id, self._first.setdefault(can_id, data) if can_id in IMU else data)


def _with_counter(values: bytes) -> Callable[[bytes], bytes]:
    return lambda data: values[:6] + data[6:]


def _dice(seed: int) -> random.Random:
    return random.Random(seed)


def half_lost() -> Lie:
    """Half of all frames do not arrive."""
    dice = _dice(1)
    return lambda can_id, data: as_it_is(can_id, data) if dice.random() < 0.5 else []


def shuffled() -> Lie:
    """Frames come up to 50 ms late, and out of order."""
    dice = _dice(2)
    return lambda can_id, data: [(dice.uniform(0.0, 0.05), classical(can_id, data))]


def junk(ids: tuple[int, ...]) -> Callable[[], bytes]:
    """Random data of random length on these ids."""
    dice = _dice(3)
    return lambda: classical(dice.choice(ids), dice.randbytes(dice.randint(0, 8)))


def cycling(frames: list[bytes]) -> Callable[[], bytes]:
    """One after the other."""
    count = iter(range(1 << 60))
    return lambda: frames[next(count) % len(frames)]


def _error_frame(flag: int, controller: int = 0) -> None:
    with raw_socket() as opened:
        opened.send(classical(ERROR | flag, bytes([0, controller, 0, 0, 0, 0, 0, 0])))


@contextmanager
def silent(bench: Bench) -> Iterator[None]:
    """Nobody sends."""
    bench.player.paused = True
    try:
        yield
    finally:
        bench.player.paused = False


@contextmanager
def bus_off(bench: Bench) -> Iterator[None]:
    """What a driver tells when its controller gives up, and when it comes back."""
    with silent(bench):
        # What the player was sending when it was told to pause would say that the bus is back.
        time.sleep(0.1)
        _error_frame(0x40)
        yield
        _error_frame(0x100)


@contextmanager
def error_passive(_: Bench) -> Iterator[None]:
    """What a driver tells of a bus with many errors, and of its recovery."""
    _error_frame(0x04, 0x10)
    yield
    _error_frame(0x04, 0x40)


@contextmanager
def down(_: Bench) -> Iterator[None]:
    """`ip link set down`."""
    ip_link("set", CHANNEL, "down")
    yield
    ip_link("set", CHANNEL, "up")


@contextmanager
def deleted(_: Bench) -> Iterator[None]:
    """An adapter is pulled and plugged in again."""
    ip_link("del", CHANNEL)
    yield
    make_interface()


@contextmanager
def stopped(bench: Bench) -> Iterator[None]:
    """SIGSTOP."""
    bench.daemon.process.send_signal(signal.SIGSTOP)
    yield
    bench.daemon.process.send_signal(signal.SIGCONT)


def clock_set(by_s: float) -> Inject:
    """Somebody sets the clock; it stays so."""

    @contextmanager
    def inject(_: Bench) -> Iterator[None]:
        time.clock_settime(time.CLOCK_REALTIME, time.time() + by_s)
        yield

    return inject


@contextmanager
def flooded(bench: Bench) -> Iterator[None]:
    """Fifty clients that never read."""
    clients = []
    for _ in range(50):
        client = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        client.setblocking(False)
        with contextlib.suppress(OSError):
            client.connect(str(bench.daemon.status_path))
        clients.append(client)
    yield
    for client in clients:
        client.close()


def reload(change: Callable[[str], str], keep: bool) -> Inject:
    """SIGHUP with another configuration."""

    @contextmanager
    def inject(bench: Bench) -> Iterator[None]:
        good = bench.config.read_text()
        bench.config.write_text(change(good))
        bench.daemon.hang_up()
        yield
        if not keep:
            bench.config.write_text(good)

    return inject


def _mount(*arguments: str) -> None:
    subprocess.run(["mount", *arguments], check=True)


@contextmanager
def read_only(bench: Bench) -> Iterator[None]:
    """The state's folder can't be written. Mounted over, for a file system that is in use can't be made read-only."""
    _mount("-t", "tmpfs", "-o", "ro", "nothing", str(bench.state.parent))
    yield
    subprocess.run(["umount", str(bench.state.parent)], check=True)


@contextmanager
def full(bench: Bench) -> Iterator[None]:
    """No room for the state."""
    filler = bench.state.parent / "filler"
    with contextlib.suppress(OSError), filler.open("wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))
    yield
    filler.unlink()


@contextmanager
def writer_killed(bench: Bench) -> Iterator[None]:
    """kill -9 of the process that writes the state."""
    for pid in bench.daemon.children():
        os.kill(pid, signal.SIGKILL)
    yield


@contextmanager
def killed(bench: Bench) -> Iterator[None]:
    """kill -9 of the daemon at some moment; its supervisor starts it again."""
    time.sleep(_dice(time.monotonic_ns()).uniform(0.0, 0.3))
    bench.daemon.process.kill()
    bench.daemon.process.wait()
    yield
    bench.daemon.start()


_GENUINE = classical(IMU_RATE, bytes.fromhex("BD803A7F2B800000"))
_FOREIGN = classical(RATES, b"\x00\x00" + Listener.FOREIGN)
_WANTED = (IMU_RATE, IMU_ACCEL, WHEELS)
_KERNEL = "the kernel's filter keeps them out; nothing changes"

FAULTS = [
    Fault("interface down 2 s", down, "link down", "none", 2.0),
    Fault("interface deleted 10 s", deleted, "link absent", "none", 10.0),
    Fault("bus-off, then restarted", bus_off, "link bus_off", "not available", 2.5),
    Fault("error passive", error_passive, "link error_passive"),
    Fault("silent bus", silent, "phase silent|invalid: stale", "not available", 2.5),
    Fault("4000 frames/s of unrelated ids", besides(junk((0x123, 0x7AA, 0x010)), 4000.0), "", why=_KERNEL),
    Fault("babbling IMU id, 4000 frames/s", besides(lambda: _GENUINE, 4000.0), "babbling"),
    Fault("second sender on our output id", besides(lambda: _FOREIGN, 100.0), "bus foreign"),
    Fault("daemon stopped 1 s (SIGSTOP)", stopped, "does not answer|missed ticks", "none", 1.0),
    Fault("clock +1 h", clock_set(3600.0), "event clock_set", guest_only=True),
    Fault("clock -1 h", clock_set(-3600.0), "event clock_set", guest_only=True),
    Fault("IMU frames cut to 3 bytes", telling(on(IMU, lambda data: data[:3])), "short", "not available"),
    Fault("IMU frames without data", telling(on(IMU, lambda _: b"")), "short", "not available"),
    Fault("IMU frozen", telling(Frozen()), "", why="at a standstill a frozen IMU looks like a quiet one"),
    Fault(
        "gyro spikes to full scale, every 20th frame",
        telling(Sometimes(frozenset({IMU_RATE}), 20, _with_counter(b"\xff" * 6))),
        "implausible|range|spike",
    ),
    Fault("IMU ADC at 0xFFFF", telling(on(IMU, _with_counter(b"\xff" * 6))), "out_of_range", "not available"),
    Fault("IMU ADC at 0", telling(on(IMU, _with_counter(bytes(6)))), "out_of_range", "not available"),
    Fault("one wheel at its largest value", telling(on(frozenset({WHEELS}), lambda d: b"\xff\x3f" + d[2:])), "wheel"),
    Fault("wheel speeds missing", telling(on(frozenset({WHEELS}), lambda _: None)), "input wheel"),
    Fault(
        "gyros missing", telling(on(frozenset({IMU_RATE}), lambda _: None)), "gyro_z invalid: stale", "not available"
    ),
    Fault("IMU missing", telling(on(IMU, lambda _: None)), "gyro_z invalid: stale", "not available"),
    Fault("half of all frames lost", telling(half_lost()), "", why="no counters are mapped; no value gets too old"),
    Fault("all frames sent twice", telling(lambda i, d: as_it_is(i, d) * 2), "", why="no counters are mapped"),
    Fault("frames up to 50 ms late, shuffled", telling(shuffled()), "", why="stamped when they come: within limits"),
    Fault(
        "remote frames of wanted ids",
        besides(cycling([classical(i | REMOTE, b"") for i in _WANTED]), 300.0),
        "",
        why=_KERNEL,
    ),
    Fault(
        "CAN FD frames of wanted ids",
        besides(cycling([flexible(i, b"\xaa" * 64) for i in _WANTED]), 300.0),
        "",
        why="a classical socket gets none; nothing changes",
    ),
    Fault(
        "extended frames of wanted numbers",
        besides(cycling([classical(i | EXTENDED, b"\xaa" * 8) for i in _WANTED]), 300.0),
        "",
        why=_KERNEL,
    ),
    Fault(
        "random junk on all ids, wanted ones too",
        besides(junk(tuple(range(0x800))), 2000.0),
        "short|range|foreign",
        "any",
    ),
    Fault("random junk on wanted ids, 500 frames/s", besides(junk(_WANTED), 500.0), "short", "any"),
    Fault("status socket: 50 clients that never read", flooded, "", why="the daemon goes on; askers are turned away"),
    Fault("state folder read-only", read_only, "state file", until="state file", calm="^state file", guest_only=True),
    Fault("disk full", full, "state file", until="state file", calm="^state file", guest_only=True),
    Fault("state writer killed", writer_killed, "state file|event state_file", calm="^state file"),
    Fault(
        "SIGHUP, bad configuration",
        reload(lambda text: text.replace("mass_kg: 1673.0", "mass_kg: -1"), False),
        "event reload_refused",
        until="event reload_refused",
    ),
    Fault(
        "SIGHUP, good configuration",
        reload(lambda text: text.replace("on_conflict: report", "on_conflict: refuse"), True),
        "reloaded",
        until="^reloaded",
    ),
    Fault("second sender, on_conflict: refuse", besides(lambda: _FOREIGN, 100.0), "output refused", "none"),
    Fault("daemon killed (SIGKILL)", killed, "does not answer", "none", 0.5, recovery_limit_s=60.0),
    Fault("daemon killed again (SIGKILL)", killed, "does not answer", "none", 0.5, recovery_limit_s=60.0),
    Fault(
        "all bits of IMU frames flipped",
        telling(on(IMU, lambda data: bytes(byte ^ 0xFF for byte in data))),
        "gyro_. doubted",
        seconds=10.0,
    ),
]
