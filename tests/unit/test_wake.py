"""The loop's alarm clock on a real kernel: expirations, overruns, signals, descriptors."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time

from dsz_daemon.edge.clock import WallClock
from dsz_daemon.edge.timer import TickTimer
from dsz_daemon.edge.wake import Wake

MS = 1_000_000


def boot_ns() -> int:
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


def test_the_timer_keeps_its_grid_and_counts_what_nobody_came_for() -> None:
    timer = TickTimer(10 * MS)
    begin_ns = boot_ns()
    timer.aim(begin_ns + 10 * MS)
    time.sleep(0.2)
    timer.aim(begin_ns + 1000 * MS)  # the same grid: nothing is re-armed
    count = timer.expired()
    passed = (boot_ns() - begin_ns) // (10 * MS)
    assert 19 <= count <= passed
    assert timer.overruns == count - 1
    assert timer.expired() in {0, 1}
    timer.rest()
    timer.expired()
    time.sleep(0.03)
    assert timer.expired() == 0
    timer.close()
    timer.close()


def test_who_is_held_up_before_setting_the_timer_is_not_late_twice() -> None:
    """A tick that came due meanwhile is due, not so much later."""
    timer = TickTimer(3600_000 * MS)
    due_ns = boot_ns() + 5 * MS
    time.sleep(0.01)
    timer.aim(due_ns)
    assert timer.expired() == 1
    timer.close()


def test_bus_time_on_the_kernels_clock() -> None:
    """Now in bus time is now on the boot clock, whatever was set or corrected in between."""
    clock = WallClock()
    for correction_ns in (0, -3600 * 10**9):
        clock.correction_ns = correction_ns
        before_ns = boot_ns()
        now_ns = clock.boot_ns(clock.now_ns())
        assert before_ns <= now_ns <= boot_ns()


def test_signals_and_descriptors_wake_and_are_told() -> None:
    handler = signal.getsignal(signal.SIGHUP)
    near, far = socket.socketpair()
    with Wake(10 * MS) as wake:
        wake.watch([near.fileno()])
        assert wake.wait(0.0) == set()
        far.send(b"x")
        assert wake.wait(5.0) == {near.fileno()}
        near.recv(1)
        os.kill(os.getpid(), signal.SIGHUP)
        begin = time.monotonic()
        wake.wait(30.0)
        assert time.monotonic() - begin < 20.0
        assert wake.asked == {signal.SIGHUP}
        wake.watch([])
        far.send(b"y")
        assert wake.wait(0.0) == set()
        wake.watch([near.fileno()])
        near.close()
        # A descriptor that was closed has left by itself; its number may come again as another's.
        wake.watch([far.fileno()])
    assert signal.getsignal(signal.SIGHUP) == handler
    far.close()


def test_the_timer_wakes() -> None:
    with Wake(10 * MS) as wake:
        begin = time.monotonic()
        wake.timer.aim(boot_ns() + 5 * MS)
        wake.wait(30.0)
        assert 0.004 < time.monotonic() - begin < 20.0


def test_what_follows_a_frame_is_gathered_but_not_past_the_timer_or_a_signal() -> None:
    near, far = socket.socketpair()
    near.setblocking(False)
    with Wake(10 * MS) as wake, near, far:
        wake.watch([near.fileno()])
        far.send(b"1")
        sender = threading.Timer(0.02, far.send, (b"2",))
        sender.start()
        assert wake.wait(5.0, gather_s=0.2) == {near.fileno()}
        sender.join()
        assert near.recv(8) == b"12"
        # Nothing to gather where nothing came.
        before_ns = boot_ns()
        assert wake.wait(0.0, gather_s=60.0) == set()
        far.send(b"3")
        wake.timer.aim(boot_ns() + 5 * MS)
        assert wake.wait(5.0, gather_s=60.0) == {near.fileno()}
        far.send(b"4")
        wake.timer.rest()
        threading.Timer(0.02, signal.raise_signal, (signal.SIGHUP,)).start()
        wake.wait(5.0, gather_s=60.0)
        assert wake.asked == {signal.SIGHUP}
        # Any of the three, not heeded, would have taken a minute.
        assert boot_ns() - before_ns < 60_000 * MS
