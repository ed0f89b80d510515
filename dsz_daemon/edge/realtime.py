"""What makes the loop punctual on a busy machine: SCHED_FIFO, locked memory, one CPU, a quiet collector."""

from __future__ import annotations

import ctypes
import gc
import os

_MCL_CURRENT, _MCL_FUTURE = 1, 2


def be_punctual(priority: int, lock_memory: bool, cpu: int | None) -> list[str]:
    """Applies what is asked for; returns what could not be had, in words. Late is better than not at all."""
    problems = []
    if cpu is not None:
        try:
            os.sched_setaffinity(0, {cpu})
        except (OSError, ValueError) as error:
            problems.append(f"service.cpu: {cpu}: {_reason(error)}; expected a CPU that this process may use")
    if lock_memory and ctypes.CDLL(None, use_errno=True).mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        problems.append(f"service.lock_memory: {os.strerror(ctypes.get_errno())}; expected LimitMEMLOCK=infinity")
    if priority > 0:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
        except OSError as error:
            problems.append(f"service.realtime_priority: {priority}: {_reason(error)}; expected LimitRTPRIO or root")
    return problems


def calm_collector() -> None:
    """What was made so far stays: the garbage collector need not walk it again, which costs milliseconds."""
    gc.collect()
    gc.freeze()


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)
