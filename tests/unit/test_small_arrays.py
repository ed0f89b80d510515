"""edge/small_arrays: what a process that works with thousands of small arrays asks for."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from dsz_daemon.edge import small_arrays


def test_thresholds_are_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    """By malloc.h, M_TRIM_THRESHOLD is -1 and M_MMAP_THRESHOLD is -3."""
    asked: dict[int, int] = {}
    monkeypatch.setattr(small_arrays.ctypes, "CDLL", lambda _: SimpleNamespace(mallopt=asked.__setitem__))
    small_arrays.keep_freed_memory()
    assert set(asked) == {-1, -3}
    assert min(asked.values()) > 100e6


def test_without_glibc_nothing_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(small_arrays.ctypes, "CDLL", lambda _: object())
    small_arrays.keep_freed_memory()


def test_a_users_number_of_threads_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    small_arrays.one_thread_for_each_product()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "3"


def test_without_a_wish_it_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    small_arrays.one_thread_for_each_product()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"


def test_the_collector_comes_seldom_and_not_at_the_end() -> None:
    """In a process of its own: cycles are still collected, what is left at the end is not.

    By its version, Python itself begins with 700 or 2000 new objects.
    """
    told = """
import gc, weakref
from dsz_daemon.edge.small_arrays import collect_seldom

class Knot:
    def __init__(self):
        self.own = self

before = gc.get_threshold()
collect_seldom()
assert gc.get_threshold()[0] > 20 * before[0] and gc.get_threshold()[1:] == before[1:]
knot = Knot()
gone = weakref.ref(knot)
del knot
assert gone() is not None
gc.collect()
assert gone() is None
collect_seldom()
import atexit
before = gc.get_freeze_count()
atexit.register(lambda: print(gc.get_freeze_count() - before))
atexit._run_exitfuncs()
print(gc.get_freeze_count() - before > 1000)
"""
    ended = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    assert ended.stdout.split() == ["0", "True"]


def test_numpy_is_not_there_before_it_is_asked() -> None:
    """OpenBLAS reads its number of threads once, when numpy is imported: `dsz diagnose` has to set it before."""
    rooms = "dsz_daemon.cli, dsz_daemon.runs.screen, dsz_daemon.edge.small_arrays"
    told = f"import sys, {rooms}; print('numpy' in sys.modules)"
    ended = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "False"
    assert gc.isenabled()
