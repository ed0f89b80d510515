"""Frames into a candump file that is readable at any moment, also after Ctrl-C."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self, TextIO

from dsz_daemon.edge.candump import candump_line
from dsz_daemon.errors import MachineError
from dsz_daemon.pipeline.frames import Frame

_FLUSH_NS = 1_000_000_000


class CandumpWriter:
    """Context manager that writes frames as candump text (.log), stamps in microseconds.

    What was written is on disk after every second of log time and at the end. An existing file
    is replaced. Raises MachineError where the file can't be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.frames = 0
        self._file: TextIO | None = None
        self._flushed_ns = 0

    def __enter__(self) -> Self:
        try:
            self._file = self.path.open("w", encoding="ascii", newline="\n")
        except OSError as error:
            raise self._failure(error) from None
        return self

    def write(self, frame: Frame) -> None:
        """Append one frame."""
        if self._file is None:
            raise RuntimeError("CandumpWriter is written to outside its with block")
        line = candump_line(frame) + "\n"
        try:
            self._file.write(line)
            if not 0 <= frame.t_ns - self._flushed_ns < _FLUSH_NS:
                self._flushed_ns = frame.t_ns
                self._file.flush()
        except OSError as error:
            raise self._failure(error) from None
        self.frames += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._file is None:
            return
        file, self._file = self._file, None
        try:
            file.close()
        except OSError as error:
            if kind is None:  # else the failure that ended the block is the one to tell
                raise self._failure(error) from None

    def _failure(self, error: OSError) -> MachineError:
        return MachineError(f"{self.path}: can't be written ({error.strerror or error})")
