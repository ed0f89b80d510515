"""What wakes the loop, all in one epoll: the tick timer, sockets, and signals through a pipe."""

from __future__ import annotations

import os
import select
import signal
from collections.abc import Collection
from types import FrameType
from typing import Any

from dsz_daemon.edge.timer import TickTimer

_SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


class Wake:
    """Use as a context manager. `asked` gathers the signals that came; outside the main thread signals are not ours."""

    def __init__(self, period_ns: int) -> None:
        self.timer = TickTimer(period_ns)
        self.asked: set[signal.Signals] = set()
        self._epoll, self._calm = select.epoll(), select.epoll()
        self._pipe = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._watched: set[int] = set()
        self._old_handlers: dict[signal.Signals, Any] = {}
        self._old_wakeup = -1
        for descriptor in (self.timer.fileno(), self._pipe[0]):
            self._epoll.register(descriptor, select.EPOLLIN)
            self._calm.register(descriptor, select.EPOLLIN)

    def __enter__(self) -> Wake:
        def asked(number: int, _frame: FrameType | None) -> None:
            self.asked.add(signal.Signals(number))

        try:
            for number in _SIGNALS:
                self._old_handlers[number] = signal.signal(number, asked)
            self._old_wakeup = signal.set_wakeup_fd(self._pipe[1], warn_on_full_buffer=False)
        except ValueError:
            self._old_handlers.clear()
        return self

    def __exit__(self, *_: object) -> None:
        if self._old_handlers:
            signal.set_wakeup_fd(self._old_wakeup)
        for number, handler in self._old_handlers.items():
            signal.signal(number, handler)
        self._epoll.close()
        self._calm.close()
        self.timer.close()
        for end in self._pipe:
            os.close(end)

    def watch(self, descriptors: Collection[int]) -> None:
        """From now on exactly these wake the loop as well. A closed descriptor has left by itself."""
        wanted = set(descriptors)
        for descriptor in self._watched - wanted:
            try:
                self._epoll.unregister(descriptor)
            except (OSError, ValueError):
                continue
        for descriptor in wanted:
            try:
                self._epoll.register(descriptor, select.EPOLLIN)
            except FileExistsError:
                continue
        self._watched = wanted

    def wait(self, at_most_s: float, gather_s: float = 0.0) -> set[int]:
        """Waits until something happens, at most so long; returns the watched descriptors that are ready.

        Where that is only they, what follows them within `gather_s` is let come too, unless the timer or a signal
        wakes: one waking for many frames.
        """
        ready = self._heard(self._epoll, at_most_s)
        if gather_s > 0.0 and ready and ready <= self._watched:
            self._heard(self._calm, gather_s)
        return ready & self._watched

    def _heard(self, epoll: select.epoll, at_most_s: float) -> set[int]:
        ready = {descriptor for descriptor, _ in epoll.poll(at_most_s)}
        if self._pipe[0] in ready:
            self._emptied()
        if self.timer.fileno() in ready:
            self.timer.expired()
        return ready

    def _emptied(self) -> None:
        try:
            while os.read(self._pipe[0], 512):
                pass
        except BlockingIOError:
            return
