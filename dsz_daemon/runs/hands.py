"""Work side by side, also where one work has parts in its turn: no hand is idle while a part is open."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from types import TracebackType
from typing import Any


class _Job:
    """Works of one question."""

    def __init__(self, function: Callable[[Any], Any], works: Sequence[Any]) -> None:
        self.function, self.works = function, works
        self.found: list[Any] = [None] * len(works)
        self.fault: BaseException | None = None
        self._begun, self._open = 0, len(works)

    @property
    def has_more(self) -> bool:
        return self._begun < len(self.works)

    @property
    def is_done(self) -> bool:
        return self._open == 0

    def begin(self) -> int:
        self._begun += 1
        return self._begun - 1

    def end(self, fault: BaseException | None) -> None:
        """Of what was begun; after a fault nothing else is."""
        self._open -= 1
        if fault is not None:
            self.fault = self.fault or fault
            self._open -= len(self.works) - self._begun
            self._begun = len(self.works)


class Hands:
    """So many threads, the asking one included. `map` may be asked inside its own works: who waits there helps.

    An idle hand takes what was asked first: inside of that the rest was asked, so it takes longest.
    """

    nests = True

    def __init__(self, count: int) -> None:
        self._changed, self._jobs, self._is_closed = threading.Condition(), list[_Job](), False
        self._others = [threading.Thread(target=self._help, daemon=True) for _ in range(count - 1)]
        for other in self._others:
            other.start()

    def __enter__(self) -> Hands:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        for other in self._others:
            other.join()

    def map(self, function: Callable[[Any], Any], works: Iterable[Any]) -> list[Any]:
        """What the function makes of each, in their order; the first fault of one is raised when none is being done."""
        works = list(works)
        if len(works) < 2 or not self._others:
            return [function(work) for work in works]
        job = _Job(function, works)
        with self._changed:
            self._jobs.append(job)
            self._changed.notify_all()
            while not job.is_done:
                if (taken := job if job.has_more else self._first()) is not None:
                    self._do(taken)
                else:
                    self._changed.wait()
            self._jobs.remove(job)
        if job.fault is not None:
            raise job.fault
        return job.found

    def _help(self) -> None:
        with self._changed:
            while not self._is_closed:
                if (taken := self._first()) is not None:
                    self._do(taken)
                else:
                    self._changed.wait()

    def _first(self) -> _Job | None:
        return next((job for job in self._jobs if job.has_more), None)

    def _do(self, job: _Job) -> None:
        """One work of a job, for which the lock that is held is laid down."""
        at, fault = job.begin(), None
        self._changed.release()
        try:
            job.found[at] = job.function(job.works[at])
        except BaseException as error:
            fault = error
        finally:
            self._changed.acquire()
            job.end(fault)
            self._changed.notify_all()
