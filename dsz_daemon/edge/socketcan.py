"""SocketCAN without anything in between: a raw socket with kernel filters, kernel stamps and its losses counted.

An interface may be absent, go down, be deleted and come back: that is said in `health`, never raised
after the start. Stamps are rounded to the microsecond that a candump line can hold, so that a live
run and a replay of its recording see the same times. Linux, Documentation/networking/can.rst.
"""

from __future__ import annotations

import errno
import fcntl
import select
import socket
import struct
import sys
import time
from collections.abc import Collection
from pathlib import Path

from dsz_daemon.edge.health import BusHealth, Link
from dsz_daemon.errors import ConfigError, MachineError
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.hardware_time import HardwareTime

Ids = Collection[tuple[int, bool]]

# Not in Python's socket module; the _NEW options have 64 bit times on every machine (Linux 5.1).
_CAN_RAW_ERR_FILTER = 2
_SO_RXQ_OVFL = 40
_SO_TIMESTAMPING_NEW = 65
_STAMPS = 0x04 | 0x08 | 0x10 | 0x40  # hardware and software, taken on receive and reported raw
_SIOCGIFFLAGS = 0x8913
_IFF_UP = 1

_EXTENDED, _REMOTE, _ERROR = 0x80000000, 0x40000000, 0x20000000
_HEAD = struct.Struct("=IBB")
_CLASSICAL = struct.Struct("=IB3x8s")
_FD = struct.Struct("=IBB2x64s")
_FD_BYTES = 72
_FLAG_FD = 0x04
_TIMES = struct.Struct("=6q")
_MANY_FILTERS = 512

# Error frames, linux/can/error.h.
_BUS_OFF, _RESTARTED, _CONTROLLER = 0x40, 0x100, 0x04
_PASSIVE, _BETTER = 0x30, 0x4C

# As much as the kernel gives without asking who we are; it doubles this, and a frame takes some 700 bytes of it.
_RECEIVE_BYTES = 1 << 20
_RETRY_S = 0.25


def _is_there(interface: str) -> bool:
    """Whether the kernel has such an interface.

    Asked by file: whoever binds to a name that is not there makes the kernel run modprobe for it
    (dev_load, where we may load modules) and waits for that, a second on a slow machine.
    """
    try:
        with Path("/proc/net/dev").open(encoding="ascii", errors="replace") as table:
            return any(line.split(":")[0].strip() == interface for line in table if ":" in line)
    except OSError:
        return True


class SocketCan:
    """One interface. `wanted` are the ids to receive, (CAN id, is extended), None for all.

    With `wait` an interface that is not there is waited for; else opening raises MachineError. `own`
    are the ids that only we should send on this bus: they are received too, to see who else does.
    """

    def __init__(
        self, name: str, interface: str, fd: bool = False, wanted: Ids | None = None, own: Ids = (), wait: bool = False
    ) -> None:
        if not 1 <= len(interface.encode()) <= 15 or "/" in interface:
            raise ConfigError(f"bus {name}: channel {interface!r} is no interface name; expected 1 to 15 characters")
        self.health = BusHealth(name, interface, Link.ABSENT, stamps="kernel")
        self._fd, self._wanted, self._own = fd, wanted, frozenset(own)
        # Frames with our own ids that somebody else sent, by id.
        self.foreign: dict[int, int] = {}
        self._socket: socket.socket | None = None
        self._hardware = HardwareTime()
        self._lost_before = 0
        self._lost_here = 0
        self._retry_s = 0.0
        try:
            self._open()
        except OSError as error:
            if not wait:
                raise MachineError(
                    f"bus {name}: socketcan channel {interface} did not open: {error.strerror}; is the interface up?"
                ) from error
            self.health.last_error = str(error.strerror)
        if self.health.link is Link.DOWN and not wait:
            self.close()
            raise MachineError(f"bus {name}: socketcan interface {interface} is down; bring it up first")

    def _open(self) -> None:
        opened = socket.socket(socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_CLOEXEC, socket.CAN_RAW)
        try:
            opened.setblocking(False)
            # Before binding, so that no frame comes in that the filter would have kept out.
            self._filter(opened)
            opened.setsockopt(socket.SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, 0x1FFFFFFF)
            if self._fd:
                opened.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
            opened.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPING_NEW, _STAMPS)
            opened.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BYTES)
            opened.bind((self.health.interface,))
        except OSError:
            opened.close()
            raise
        self._socket = opened
        self._lost_before, self._lost_here = self.health.lost, 0
        self._hardware = HardwareTime()
        self.health.link = Link.UP if self._is_up(opened) else Link.DOWN

    def _filter(self, opened: socket.socket) -> None:
        # A socket's first filter lets everything through, and so does none being set here.
        ids = sorted({*(self._wanted or ()), *self._own})
        if self._wanted is None or len(ids) > _MANY_FILTERS:
            ids = []
        filters = b"" if ids else struct.pack("=II", 0, 0)
        for can_id, extended in ids:
            # Data frames of exactly this id. The error flag in a mask would mean something else altogether.
            width = 0x1FFFFFFF if extended else 0x7FF
            filters += struct.pack("=II", can_id | (_EXTENDED if extended else 0), width | _EXTENDED | _REMOTE)
        opened.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)

    def refilter(self, wanted: Ids | None, own: Ids) -> None:
        """Other ids from now on."""
        self._wanted, self._own = wanted, frozenset(own)
        if self._socket is not None:
            self._filter(self._socket)

    def fileno(self) -> int:
        """What epoll waits on; -1 while the interface is absent."""
        return -1 if self._socket is None else self._socket.fileno()

    def wait(self, timeout_s: float) -> bool:
        """Waits for a frame, at most so long; whether there is one. For use beside buses that can only be polled."""
        if self._socket is None:
            time.sleep(timeout_s)
            return False
        return bool(select.select([self._socket], [], [], timeout_s)[0])

    def tend(self) -> None:
        """Now and then: opens an interface that has come, sees whether one that was down is up again."""
        if self.health.link is Link.UP or time.monotonic() < self._retry_s:
            return
        self._retry_s = time.monotonic() + _RETRY_S
        if self._socket is None:
            if not _is_there(self.health.interface):
                return
            try:
                self._open()
            except OSError as error:
                self.health.last_error = str(error.strerror)
        elif self.health.link is Link.DOWN and self._is_up(self._socket):
            self.health.link = Link.UP

    def _is_up(self, opened: socket.socket) -> bool:
        request = struct.pack("16sh22x", self.health.interface.encode(), 0)
        try:
            answer = fcntl.ioctl(opened.fileno(), _SIOCGIFFLAGS, request)
        except OSError:
            return False
        return bool(struct.unpack_from("16xh", answer)[0] & _IFF_UP)

    def receive(self, at_most: int) -> list[Frame]:
        """The frames that wait, at most so many."""
        frames: list[Frame] = []
        opened = self._socket
        if opened is None:
            return frames
        health = self.health
        while len(frames) < at_most:
            try:
                data, ancillary, _, _ = opened.recvmsg(_FD_BYTES, 128)
            except BlockingIOError:
                break
            except OSError as error:
                self._failed(error)
                break
            frames.append(self._frame(data, self._stamp_ns(ancillary)))
        health.received += len(frames)
        return frames

    def _frame(self, data: bytes, t_ns: int) -> Frame:
        head, length, flags = _HEAD.unpack_from(data)
        extended = bool(head & _EXTENDED)
        can_id = head & (0x1FFFFFFF if extended else 0x7FF)
        payload = data[8 : 8 + length]
        name = self.health.name
        if not head & (_ERROR | _REMOTE):
            if len(data) == _FD_BYTES:
                return Frame(t_ns, name, can_id, payload, extended, is_fd=True, fd_flags=flags & 0x03)
            if (can_id, extended) in self._own:
                self.health.foreign += 1
                self.foreign[can_id] = self.foreign.get(can_id, 0) + 1
            # Frames come to an error-passive controller as well: its driver says when that is over.
            if self.health.link is not Link.UP and self.health.link is not Link.ERROR_PASSIVE:
                self.health.link = Link.UP
            return Frame(t_ns, name, can_id, payload, extended)
        if head & _ERROR:
            self._bus_error(head, payload)
            return Frame(t_ns, name, head & 0x1FFFFFFF, payload, is_error=True)
        return Frame(t_ns, name, can_id, b"", extended, is_remote=True, remote_length=length)

    def _stamp_ns(self, ancillary: list[tuple[int, int, bytes]]) -> int:
        stamp_ns = 0
        for _, kind, data in ancillary:
            if kind == _SO_TIMESTAMPING_NEW:
                seconds, nanoseconds, _, _, hardware_s, hardware_ns = _TIMES.unpack_from(data)
                stamp_ns = seconds * 1_000_000_000 + nanoseconds
                if hardware_s or hardware_ns:
                    self.health.stamps = "hardware"
                    stamp_ns = self._hardware.kernel_ns(hardware_s * 1_000_000_000 + hardware_ns, stamp_ns)
            elif kind == _SO_RXQ_OVFL:
                # The kernel's count of this socket, which wraps at 32 bits.
                lost = int.from_bytes(data[:4], sys.byteorder)
                self._lost_here += (lost - self._lost_here) & 0xFFFFFFFF
                self.health.lost = self._lost_before + self._lost_here
        return (stamp_ns or time.time_ns()) // 1000 * 1000

    def _bus_error(self, head: int, payload: bytes) -> None:
        health = self.health
        health.error_frames += 1
        if head & _BUS_OFF:
            health.bus_offs += health.link is not Link.BUS_OFF
            health.link, health.last_error = Link.BUS_OFF, "bus-off"
        elif head & _RESTARTED:
            health.link = Link.UP
        elif head & _CONTROLLER and len(payload) > 1 and health.link is not Link.BUS_OFF:
            if payload[1] & _PASSIVE:
                health.link, health.last_error = Link.ERROR_PASSIVE, "error passive"
            elif payload[1] & _BETTER:
                health.link = Link.UP

    def send(self, frame: Frame) -> bool:
        """Sends one frame; False (and counted) where the interface does not take it."""
        health, opened = self.health, self._socket
        if opened is None:
            health.dropped += 1
            return False
        head = frame.can_id | (_EXTENDED if frame.is_extended else 0) | (_REMOTE if frame.is_remote else 0)
        length = frame.remote_length if frame.is_remote else len(frame.data)
        try:
            if frame.is_fd:
                opened.send(_FD.pack(head, length, frame.fd_flags | _FLAG_FD, frame.data))
            else:
                opened.send(_CLASSICAL.pack(head, length, frame.data))
        except OSError as error:
            health.dropped += 1
            # A full queue is no failure of the interface: EAGAIN, ENOBUFS.
            if not isinstance(error, BlockingIOError) and error.errno != errno.ENOBUFS:
                self._failed(error)
            return False
        health.sent += 1
        return True

    def _failed(self, error: OSError) -> None:
        """The kernel says why a socket does not work: ENETDOWN for a while, anything else for good."""
        health = self.health
        health.last_error = str(error.strerror)
        was_there = health.link not in {Link.DOWN, Link.ABSENT}
        health.outages += was_there
        if error.errno == errno.ENETDOWN:
            health.link = Link.DOWN
            return
        self._drop()
        health.link = Link.ABSENT
        self._retry_s = time.monotonic() + _RETRY_S

    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def close(self) -> None:
        """Closes the socket; safe to call twice."""
        self._drop()
