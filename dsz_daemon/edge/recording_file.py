"""One file of a recording, opened: decompressed, its format recognised, its lines in blocks."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from dsz_daemon.edge.candump import MalformedLine, parse_line
from dsz_daemon.edge.compressed import Inflated, inflated

Format = Literal["candump", "asc", "blf", "trc", "mf4"]
_BY_SUFFIX: dict[str, Format] = {".asc": "asc", ".blf": "blf", ".trc": "trc", ".mf4": "mf4"}
_BLOCK_BYTES = 1 << 18
_HEAD_BYTES = 1 << 16
# No text format has lines like that. Zeros behind a recording (a preallocated file after a
# power cut) are one line of any length; memory must not grow with them.
_LINE_BYTES_MAX = 1 << 20
_LINE_BYTES_KEPT = 4096
_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class RecordingFile:
    """An open file of a recording.

    `stream` gives its decompressed bytes from the start (behind a byte order mark), `head` the
    first ones without moving it.
    """

    path: Path
    source: io.BufferedReader[Any]
    stream: io.BufferedReader[Any]
    inflated: Inflated | None
    head: bytes

    @property
    def damage(self) -> str:
        """What is wrong at the end that has been reached; "" if nothing is known to be."""
        return self.inflated.damage if self.inflated is not None else ""

    def position_bytes(self) -> int:
        """How far into the file on disk reading is, compressed or not; 0 where nobody knows."""
        return self.source.tell() if self.source.seekable() else 0

    def blocks(self, tick: Callable[[], None]) -> Iterator[list[bytes]]:
        """Lists of lines with their ends; `tick` is called after each list.

        A line of more than a mebibyte is shortened to its beginning.
        """
        rest = b""
        while chunk := self.stream.read(_BLOCK_BYTES):
            ends = chunk.rfind(b"\n") + 1
            if not ends:
                rest += chunk
                if len(rest) > _LINE_BYTES_MAX:
                    rest = rest[:_LINE_BYTES_KEPT]
                continue
            yield (rest + chunk[:ends]).splitlines(keepends=True)
            rest = chunk[ends:]
            tick()
        if rest:
            yield rest.splitlines(keepends=True)
            tick()


@contextmanager
def open_recording(path: Path) -> Iterator[RecordingFile]:
    """Open a plain, gz or zst file, whichever its first bytes say. Raises OSError, InputError."""
    with ExitStack() as stack:
        source: io.BufferedReader[Any] = stack.enter_context(io.BufferedReader(io.FileIO(path), _HEAD_BYTES))
        unpacked = inflated(source, source.peek(4)[:4], str(path))
        stream = source
        if unpacked is not None:
            stream = stack.enter_context(io.BufferedReader(unpacked, _HEAD_BYTES))
        if stream.peek(len(_BOM))[: len(_BOM)] == _BOM:
            stream.read(len(_BOM))
        yield RecordingFile(path, source, stream, unpacked, stream.peek(_HEAD_BYTES))


def recording_format(name: str, head: bytes) -> Format:
    """Format of a file: what its first bytes say beyond doubt, else its name, else candump.

    >>> recording_format("drive.BLF.gz", b""), recording_format("drive.txt", b"(1.0) can0 123#00")
    ('blf', 'candump')
    """
    if head.startswith(b"LOGG"):
        return "blf"
    if head.startswith((b"MDF  ", b"UnFinMF")):
        return "mf4"
    if _has_candump_line(head):
        return "candump"
    if head.lstrip().startswith((b";$FILEVERSION", b";#####")):
        return "trc"
    if head.lstrip().lower().startswith((b"date ", b"base hex", b"base dec")):
        return "asc"
    plain = Path(name.lower())
    if plain.suffix in {".gz", ".zst"}:
        plain = plain.with_suffix("")
    return _BY_SUFFIX.get(plain.suffix, "candump")


def _has_candump_line(head: bytes) -> bool:
    for line in head.decode("latin-1").split("\n"):
        if line.lstrip().startswith("("):
            try:
                return parse_line(line) is not None
            except MalformedLine:
                continue
    return False


def first_offending_line(head: bytes) -> tuple[int, str] | None:
    """Number and text of the first line that is neither candump frame nor comment, or None."""
    for number, line in enumerate(head.decode("latin-1").split("\n"), 1):
        try:
            parse_line(line)
        except MalformedLine:
            return number, line
    return None
