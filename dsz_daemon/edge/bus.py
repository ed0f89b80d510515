"""CAN buses through python-can: open them all, receive the next frame of any, send, close.

The one place where `can.*` meets the loop. Stamps are rounded to the microsecond that a
candump line can hold, so that a live run and a replay of its recording see the same times.
"""

from __future__ import annotations

import select
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any

import can

from dsz_daemon.errors import ConfigError, MachineError
from dsz_daemon.pipeline.frames import Frame

# Several buses without file descriptors (virtual ones) are polled in turn, this long each.
_POLL_S = 0.001


def frame_of(message: can.Message, channel: str) -> Frame:
    """A python-can message as a frame of the bus named `channel`."""
    remote = bool(message.is_remote_frame)
    return Frame(
        t_ns=round(message.timestamp * 1e6) * 1000,
        channel=channel,
        can_id=message.arbitration_id,
        data=b"" if remote else bytes(message.data),
        is_extended=bool(message.is_extended_id),
        is_fd=bool(message.is_fd),
        is_remote=remote,
        is_error=bool(message.is_error_frame),
        fd_flags=(1 if message.bitrate_switch else 0) | (2 if message.error_state_indicator else 0),
        remote_length=message.dlc if remote else 0,
    )


def message_of(frame: Frame) -> can.Message:
    """A frame as a python-can message, stamped as the frame is."""
    return can.Message(
        timestamp=frame.t_ns * 1e-9,
        arbitration_id=frame.can_id,
        data=frame.data,
        is_extended_id=frame.is_extended,
        is_fd=frame.is_fd,
        is_remote_frame=frame.is_remote,
        is_error_frame=frame.is_error,
        dlc=frame.remote_length if frame.is_remote else None,
        bitrate_switch=bool(frame.fd_flags & 1),
        error_state_indicator=bool(frame.fd_flags & 2),
    )


class Buses:
    """All configured buses by name. Use as a context manager; opening reports every failure at once."""

    def __init__(self, arguments: Mapping[str, Mapping[str, Any]]) -> None:
        self._buses: dict[str, can.BusABC] = {}
        self.dropped = 0
        for name, options in arguments.items():
            try:
                self._buses[name] = can.Bus(**options)
            except (can.CanError, OSError, ValueError, TypeError, NotImplementedError, ImportError) as error:
                self.close()
                kind = options.get("interface", "?")
                what = f"bus {name}: {kind} channel {options.get('channel', '?')!s} did not open: {_one_line(error)}"
                if isinstance(error, can.CanInterfaceNotImplementedError | TypeError | ImportError):
                    raise ConfigError(f"{what}; expected a python-can interface and its arguments") from error
                raise MachineError(f"{what}; is the interface up?") from error
        self._descriptors = self._all_descriptors()
        self._turn = 0

    def _all_descriptors(self) -> dict[int, str] | None:
        """File descriptors to wait on, or None where a bus has none (virtual)."""
        found: dict[int, str] = {}
        for name, bus in self._buses.items():
            try:
                descriptor = bus.fileno()
            except NotImplementedError:
                return None
            if descriptor < 0:
                return None
            found[descriptor] = name
        return found

    def __enter__(self) -> Buses:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Shuts all buses down; safe to call twice."""
        for bus in self._buses.values():
            bus.shutdown()
        self._buses = {}

    def receive(self, timeout_s: float) -> Frame | None:
        """The next frame of any bus, or None after timeout_s (0: only what is there).

        Raises MachineError when a bus fails.
        """
        if len(self._buses) == 1:
            ((name, bus),) = self._buses.items()
            return self._from(name, bus, timeout_s)
        if self._descriptors is not None:
            ready, _, _ = select.select(list(self._descriptors), [], [], timeout_s)
            for descriptor in ready:
                name = self._descriptors[descriptor]
                return self._from(name, self._buses[name], 0.0)
            return None
        return self._polled(timeout_s)

    def _polled(self, timeout_s: float) -> Frame | None:
        names = list(self._buses)
        end = time.monotonic() + timeout_s
        while True:
            for _ in names:
                self._turn = (self._turn + 1) % len(names)
                frame = self._from(names[self._turn], self._buses[names[self._turn]], 0.0)
                if frame is not None:
                    return frame
            left = end - time.monotonic()
            if left <= 0.0:
                return None
            time.sleep(min(_POLL_S, left))

    def _from(self, name: str, bus: can.BusABC, timeout_s: float) -> Frame | None:
        try:
            message = bus.recv(timeout_s)
        except (can.CanError, OSError) as error:
            raise MachineError(f"bus {name} failed while receiving: {_one_line(error)}") from error
        return None if message is None else frame_of(message, name)

    def send(self, frame: Frame) -> None:
        """Sends one frame on its bus; a full transmit queue drops and counts it.

        Raises MachineError when the bus is gone.
        """
        try:
            self._buses[frame.channel].send(message_of(frame), timeout=0.0)
        except can.CanOperationError:
            self.dropped += 1
        except (can.CanError, OSError) as error:
            raise MachineError(f"bus {frame.channel} failed while sending: {_one_line(error)}") from error


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
