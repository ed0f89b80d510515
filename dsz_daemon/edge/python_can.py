"""python-can's buses: the door to every interface but Linux's own SocketCAN.

The one place where `can.*` meets the loop. Stamps are rounded to the microsecond that a
candump line can hold, so that a live run and a replay of its recording see the same times.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import can

from dsz_daemon.edge.health import BusHealth
from dsz_daemon.errors import ConfigError, MachineError
from dsz_daemon.pipeline.frames import Frame

# Driver errors in a row, with no frame between, after which a bus is given up: the supervisor opens it anew.
_PATIENCE = 1000


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


class PythonCan:
    """One bus, by python-can's arguments. Raises ConfigError or MachineError where it does not open."""

    def __init__(self, name: str, options: Mapping[str, Any]) -> None:
        kind, channel = options.get("interface", "?"), options.get("channel", "?")
        self.health = BusHealth(name, f"{kind}:{channel}")
        self._errors = 0
        self._early: list[Frame] = []
        try:
            self._bus: can.BusABC | None = can.Bus(**options)
        except (can.CanError, OSError, ValueError, TypeError, NotImplementedError, ImportError) as error:
            what = f"bus {name}: {kind} channel {channel!s} did not open: {_one_line(error)}"
            if isinstance(error, can.CanInterfaceNotImplementedError | TypeError | ImportError):
                raise ConfigError(f"{what}; expected a python-can interface and its arguments") from error
            raise MachineError(f"{what}; is the interface up?") from error

    def fileno(self) -> int:
        """What epoll waits on; -1 for an interface that can only be polled."""
        try:
            return -1 if self._bus is None else self._bus.fileno()
        except NotImplementedError:
            return -1

    def tend(self) -> None:
        """python-can tells nothing of an interface's life."""

    def wait(self, timeout_s: float) -> bool:
        """Waits for a frame, which the next `receive` gives; whether there is one."""
        frame = None if self._early else self._next(timeout_s)
        if frame is not None:
            self._early.append(frame)
        return bool(self._early)

    def receive(self, at_most: int) -> list[Frame]:
        """The frames that wait, at most so many."""
        frames, self._early = self._early, []
        while len(frames) < at_most:
            frame = self._next(0.0)
            if frame is None:
                break
            frames.append(frame)
        self.health.received += len(frames)
        return frames

    def _next(self, timeout_s: float) -> Frame | None:
        """The next frame; a message that the driver can't read is counted. Raises MachineError when the bus fails."""
        if self._bus is None:
            return None
        try:
            message = self._bus.recv(timeout_s)
        except can.CanError as error:
            self._errors += 1
            self.health.error_frames += 1
            self.health.last_error = _one_line(error)
            if self._errors > _PATIENCE:
                raise MachineError(f"bus {self.health.name} failed while receiving: {_one_line(error)}") from error
            return None
        except OSError as error:
            raise MachineError(f"bus {self.health.name} failed while receiving: {_one_line(error)}") from error
        if message is None:
            return None
        self._errors = 0
        return frame_of(message, self.health.name)

    def send(self, frame: Frame) -> bool:
        """Sends one frame; a full transmit queue drops and counts it. Raises MachineError when the bus is gone."""
        if self._bus is None:
            return False
        try:
            self._bus.send(message_of(frame), timeout=0.0)
        except can.CanOperationError:
            self.health.dropped += 1
            return False
        except (can.CanError, OSError) as error:
            raise MachineError(f"bus {self.health.name} failed while sending: {_one_line(error)}") from error
        self.health.sent += 1
        return True

    def close(self) -> None:
        """Shuts the bus down; safe to call twice."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
