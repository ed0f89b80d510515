"""A kernel timer for the ticks: it keeps its phase whatever the loop does, and counts what the loop missed.

timerfd on CLOCK_BOOTTIME, always with absolute times: "in 6 ms" would come late by as long as its thread is held up
between reading a clock and setting the timer. Python has it from 3.13 on; before, the C library is called.
"""

from __future__ import annotations

import ctypes
import os
import struct
import sys
import time

from dsz_daemon.errors import MachineError

_TFD_TIMER_ABSTIME = 1
_FLAGS = os.O_NONBLOCK | os.O_CLOEXEC
# Re-armed only when the grid has moved by more than two clocks slew against each other in a while.
_PHASE_NS = 100_000


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


class _Itimerspec(ctypes.Structure):
    _fields_ = (("it_interval", _Timespec), ("it_value", _Timespec))


def _created() -> int:
    if sys.version_info >= (3, 13):
        return os.timerfd_create(time.CLOCK_BOOTTIME, flags=_FLAGS)
    libc = ctypes.CDLL(None, use_errno=True)
    descriptor = int(libc.timerfd_create(time.CLOCK_BOOTTIME, _FLAGS))
    if descriptor < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return descriptor


def _armed(descriptor: int, first_ns: int, period_ns: int) -> None:
    if sys.version_info >= (3, 13):
        os.timerfd_settime_ns(descriptor, flags=_TFD_TIMER_ABSTIME, initial=first_ns, interval=period_ns)
        return
    libc = ctypes.CDLL(None, use_errno=True)
    times = _Itimerspec(_Timespec(*divmod(period_ns, 10**9)), _Timespec(*divmod(first_ns, 10**9)))
    if libc.timerfd_settime(descriptor, _TFD_TIMER_ABSTIME, ctypes.byref(times), None) != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


class TickTimer:
    """Expires every `period_ns` on a grid that `aim` sets; `overruns` counts expirations nobody came for."""

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self._phase_ns: int | None = None
        self.overruns = 0
        try:
            self._descriptor = _created()
        except OSError as error:
            raise MachineError(f"the kernel gives no timer: {error.strerror}") from error

    def fileno(self) -> int:
        """What epoll waits on."""
        return self._descriptor

    def aim(self, due_ns: int) -> None:
        """The next tick is due at `due_ns` of CLOCK_BOOTTIME; re-arms only where the grid has moved."""
        phase_ns = due_ns % self.period_ns
        if self._phase_ns is not None:
            off_ns = (phase_ns - self._phase_ns + self.period_ns // 2) % self.period_ns - self.period_ns // 2
            if abs(off_ns) <= _PHASE_NS:
                return
        _armed(self._descriptor, max(1, due_ns), self.period_ns)
        self._phase_ns = phase_ns

    def rest(self) -> None:
        """No tick is due for now."""
        if self._phase_ns is not None:
            _armed(self._descriptor, 0, 0)
            self._phase_ns = None

    def expired(self) -> int:
        """Expirations since the last call (0: none); those beyond one are overruns."""
        try:
            (count,) = struct.unpack("=Q", os.read(self._descriptor, 8))
        except BlockingIOError:
            return 0
        self.overruns += max(0, count - 1)
        return int(count)

    def close(self) -> None:
        """Gives the timer back; safe to call twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
