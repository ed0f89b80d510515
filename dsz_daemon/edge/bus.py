"""All configured CAN buses as one: frames of any of them in, frames out by bus name.

SocketCAN goes its own way (`socketcan.py`); every other interface, and a SocketCAN one with further
python-can arguments, through python-can.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any, Protocol

from dsz_daemon.edge.health import BusHealth
from dsz_daemon.edge.socketcan import Ids, SocketCan
from dsz_daemon.pipeline.frames import Frame

# Several buses without file descriptors (virtual ones) are polled in turn, this long each.
_POLL_S = 0.001
# What our own way understands; `bitrate` is set by `ip link` on SocketCAN, python-can ignores it there too.
_OWN_ARGUMENTS = {"interface", "channel", "fd", "bitrate"}


class Port(Protocol):
    """One bus."""

    health: BusHealth

    def fileno(self) -> int:
        """What epoll waits on; -1 where there is nothing to wait on."""
        ...

    def wait(self, timeout_s: float) -> bool:
        """Waits for a frame, at most so long; whether there is one."""
        ...

    def receive(self, at_most: int) -> list[Frame]:
        """The frames that wait, at most so many."""
        ...

    def send(self, frame: Frame) -> bool:
        """Whether the interface took the frame."""
        ...

    def tend(self) -> None:
        """What is to be done now and then."""
        ...

    def close(self) -> None:
        """Closes the bus; safe to call twice."""
        ...


class Buses:
    """All configured buses by name. Use as a context manager.

    `wanted` are the ids to receive by bus name (no entry: all of them), `own` those that only we
    should send, on `output`; both for interfaces whose kernel filters. `wait` for absent interfaces.
    Raises ConfigError or MachineError where a bus does not open.
    """

    def __init__(
        self,
        arguments: Mapping[str, Mapping[str, Any]],
        wanted: Mapping[str, Ids] | None = None,
        own: Ids = (),
        output: str = "",
        wait: bool = False,
    ) -> None:
        self._ports: dict[str, Port] = {}
        try:
            for name, options in arguments.items():
                ids = None if wanted is None else wanted.get(name)
                self._ports[name] = _opened(name, options, ids, own if name == output else (), wait)
        except BaseException:
            self.close()
            raise
        # How each bus is doing: made once, for it is asked all the time.
        self.health = tuple(port.health for port in self._ports.values())

    def refilter(self, wanted: Mapping[str, Ids] | None, own: Ids, output: str) -> None:
        """Other ids from now on."""
        for name, port in self._ports.items():
            if isinstance(port, SocketCan):
                port.refilter(None if wanted is None else wanted.get(name), own if name == output else ())

    def __enter__(self) -> Buses:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Shuts all buses down; safe to call twice. Their health can still be asked."""
        for port in self._ports.values():
            port.close()

    @property
    def dropped(self) -> int:
        """Own frames that no interface took."""
        return sum(port.health.dropped for port in self._ports.values())

    @property
    def foreign(self) -> dict[int, int]:
        """Frames with our own ids that somebody else sent, by id; seen on interfaces that don't echo our own."""
        found: dict[int, int] = {}
        for port in self._ports.values():
            if isinstance(port, SocketCan):
                found |= port.foreign
        return found

    def descriptors(self) -> list[int] | None:
        """File descriptors to wait on (of an absent interface there is none), None where a bus can only be polled."""
        found = []
        for port in self._ports.values():
            descriptor = port.fileno()
            if descriptor >= 0:
                found.append(descriptor)
            elif not isinstance(port, SocketCan):
                return None
        return found

    def wait(self, timeout_s: float) -> None:
        """Waits for a frame where a bus can only be polled."""
        ports = list(self._ports.values())
        if len(ports) == 1:
            ports[0].wait(timeout_s)
            return
        end_s = time.monotonic() + timeout_s
        while sum(port.wait(0.0) for port in ports) == 0:
            left_s = end_s - time.monotonic()
            if left_s <= 0.0:
                return
            time.sleep(min(_POLL_S, left_s))

    def receive(self, at_most: int) -> list[Frame]:
        """The frames that wait on all buses, at most so many of each; Raises MachineError when a bus fails."""
        frames: list[Frame] = []
        for port in self._ports.values():
            frames += port.receive(at_most)
        return frames

    def tend(self) -> None:
        """Brings back what has gone away, where that can be."""
        for port in self._ports.values():
            port.tend()

    def send(self, frame: Frame) -> bool:
        """Sends one frame on its bus; one that the bus does not take is dropped and counted.

        Raises MachineError when a bus of python-can is gone.
        """
        return self._ports[frame.channel].send(frame)

    def send_all(self, frames: Sequence[Frame]) -> int:
        """Sends them in order; returns how many were taken."""
        return sum(self.send(frame) for frame in frames)


def _opened(name: str, options: Mapping[str, Any], wanted: Ids | None, own: Ids, wait: bool) -> Port:
    given = {key for key, value in options.items() if value is not None}
    if options.get("interface") == "socketcan" and isinstance(options.get("channel"), str) and given <= _OWN_ARGUMENTS:
        return SocketCan(name, str(options["channel"]), bool(options.get("fd")), wanted, own, wait)
    # Here, for a car that has only SocketCAN need not load it.
    from dsz_daemon.edge.python_can import PythonCan  # noqa: PLC0415

    return PythonCan(name, options)
