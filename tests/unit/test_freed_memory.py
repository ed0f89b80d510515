"""edge/freed_memory: what was freed is not handed back."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from dsz_daemon.edge import freed_memory


def test_thresholds_are_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    """By malloc.h, M_TRIM_THRESHOLD is -1 and M_MMAP_THRESHOLD is -3."""
    asked: dict[int, int] = {}
    monkeypatch.setattr(freed_memory.ctypes, "CDLL", lambda _: SimpleNamespace(mallopt=asked.__setitem__))
    freed_memory.keep_freed_memory()
    assert set(asked) == {-1, -3}
    assert min(asked.values()) > 100e6


def test_without_glibc_nothing_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(freed_memory.ctypes, "CDLL", lambda _: object())
    freed_memory.keep_freed_memory()
