"""What the tests of the state file share: bodies, stops between two system calls, another user, small disks."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NOBODY = 65534
# What changes something on the disk, or decides what does.
CALLS = ("open", "write", "fsync", "close", "rename", "unlink")


def body(n: int) -> dict[str, Any]:
    """A small body that tells which one it is."""
    return {"n": n, "x": [0.1, -0.0, 5e-324, 1.7976931348623157e308], "text": 'a "quoted" ü'}


class Stopped(BaseException):
    """The power went: no clean-up may follow, so that it is none of the exceptions that code catches."""


class Disk:
    """Counts system calls on files below a folder; stops before or after one of them, or lets it fail.

    After a stop every further call stops as well: a dead process cleans nothing up.
    """

    def __init__(self, patch: pytest.MonkeyPatch, folder: Path) -> None:
        self.log: list[tuple[str, str]] = []
        self.stop_before: int | None = None
        self.fail_at: tuple[int, int] | None = None
        self.write_only: int | None = None
        self._names: dict[int, str] = {}
        self._folder = folder
        for name in CALLS:
            patch.setattr(os, name, self._watched(name, getattr(os, name)))

    def _watched(self, name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(first: Any, *rest: Any, **named: Any) -> Any:
            where = self._names.get(first) if isinstance(first, int) else self._inside(first)
            if where is None:
                return real(first, *rest, **named)
            if self.stop_before is not None and len(self.log) >= self.stop_before:
                self._last_breath(name, real, first, *rest)
                self.stop_before = 0
                raise Stopped
            if self.fail_at is not None and len(self.log) == self.fail_at[0]:
                self.log.append((name, where))
                if name == "close":
                    real(first)
                raise OSError(self.fail_at[1], os.strerror(self.fail_at[1]))
            result = real(first, *rest, **named)
            self.log.append((name, where))
            if name == "open":
                self._names[result] = where
            elif name == "close":
                self._names.pop(first, None)
            return result

        return call

    def _last_breath(self, name: str, real: Callable[..., Any], first: Any, *rest: Any) -> None:
        """A write may have got as far as some byte."""
        if name == "write" and self.write_only is not None:
            real(first, bytes(rest[0])[: self.write_only])
            self.write_only = None

    def _inside(self, path: Any) -> str | None:
        try:
            return str(Path(path).relative_to(self._folder))
        except (TypeError, ValueError):
            return None

    def close_all(self) -> None:
        """What the kernel does with the descriptors of a dead process."""
        for fd in self._names:
            os.close(fd)
        self._names.clear()


@contextmanager
def ordinary_user() -> Iterator[Path]:
    """A folder of one's own, as somebody whom permissions hold back (root they do not)."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if os.geteuid() != 0:
            yield folder
            folder.chmod(stat.S_IRWXU)
            return
        os.chown(folder, NOBODY, NOBODY)
        os.seteuid(NOBODY)
        try:
            yield folder
        finally:
            os.seteuid(0)


@contextmanager
def mounted(folder: Path, size_bytes: int) -> Iterator[Callable[[bool], None]]:
    """A tmpfs of that size on `folder`; yields what makes it read-only or writable. Skips without root."""
    libc = ctypes.CDLL(ctypes.util.find_library("c") or "libc.so.6", use_errno=True)

    def mount(flags: int) -> int:
        options = f"size={size_bytes}".encode()
        return int(libc.mount(b"tmpfs", str(folder).encode(), b"tmpfs", ctypes.c_ulong(flags), options))

    def set_read_only(read_only: bool) -> None:
        remount, is_read_only = 32, 1
        assert mount(remount | (is_read_only if read_only else 0)) == 0, os.strerror(ctypes.get_errno())

    if mount(0) != 0:
        pytest.skip(f"a file system can't be mounted here: {os.strerror(ctypes.get_errno())}")
    try:
        yield set_read_only
    finally:
        libc.umount2(str(folder).encode(), 2)


def fill(path: Path) -> None:
    """Leaves no room on the disk of `path`."""
    with path.open("wb", buffering=0) as file:
        for _ in range(10_000):
            try:
                file.write(bytes(4096))
            except OSError:
                return
    raise AssertionError("the disk is too large to be filled")
