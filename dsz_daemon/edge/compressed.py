"""Decompression of gz and zst recordings that keeps what can be read of a damaged one."""

from __future__ import annotations

import importlib
import io
import zlib
from collections.abc import Callable
from typing import BinaryIO, Protocol

from dsz_daemon.errors import InputError

GZIP_MAGIC = b"\x1f\x8b"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
# What is lost at most of a damaged file's zst; gz loses nothing. And what is unpacked at once: gz a
# thousand times as much, zst up to a hundred thousand times (a file made for it), hence so little.
_GZ_CHUNK_BYTES, _ZST_CHUNK_BYTES = 16384, 512


class _Member(Protocol):
    """One gzip member or zstd frame being decompressed: what zlib and zstandard share."""

    @property
    def eof(self) -> bool: ...
    @property
    def unused_data(self) -> bytes: ...
    def decompress(self, data: bytes, /) -> bytes: ...


class Inflated(io.RawIOBase):
    """The decompressed bytes of a file, several members in a row included.

    It ends where the file or the readable part of it ends; `damage` then says what is wrong
    there ("" if nothing is).
    """

    def __init__(
        self, source: BinaryIO, start: Callable[[], _Member], fault: type[Exception], chunk_bytes: int
    ) -> None:
        super().__init__()
        self._chunk_bytes = chunk_bytes
        self._source = source
        self._start = start
        self._fault = fault
        self._member: _Member | None = None
        self._compressed = b""
        self._ready = memoryview(b"")
        self.damage = ""

    def readable(self) -> bool:
        """Tell `io` that it may read."""
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """Fill `buffer` as far as is at hand; 0 only at the end."""
        while not self._ready and self._advance():
            pass
        piece = self._ready[: len(buffer)]
        buffer[: len(piece)] = piece
        self._ready = self._ready[len(piece) :]
        return len(piece)

    def _advance(self) -> bool:
        """Decompress one more chunk; False at the end."""
        if self.damage:
            return False
        chunk = self._compressed or self._source.read(self._chunk_bytes)
        self._compressed = b""
        if not chunk:
            self.damage = "its compressed data is cut off" if self._member is not None else ""
            return False
        if self._member is None:
            # Zeros between or behind members are padding, as gzip(1) has it.
            chunk = chunk.lstrip(b"\0")
            if not chunk:
                return True
            self._member = self._start()
        copy = getattr(self._member, "copy", None)
        before = None if copy is None else copy()
        try:
            # A view, of which pieces are taken: cutting bytes off copies all the rest each time.
            self._ready = memoryview(self._member.decompress(chunk))
        except self._fault as error:
            self.damage = f"its compressed data is damaged ({error})"
            self._ready = memoryview(b"" if before is None else _salvage(before, chunk, self._fault))
            return True
        if self._member.eof:
            self._compressed = self._member.unused_data
            self._member = None
        return True


def _salvage(member: _Member, chunk: bytes, fault: type[Exception]) -> bytes:
    """What a chunk gives up to its damage: zlib keeps nothing of a call that fails."""
    pieces: list[bytes] = []
    for index in range(len(chunk)):
        try:
            pieces.append(member.decompress(chunk[index : index + 1]))
        except fault:
            break
    return b"".join(pieces)


def inflated(source: BinaryIO, magic: bytes, path: str) -> Inflated | None:
    """Decompressing stream over `source` whose first bytes are `magic`; None if it is plain.

    Raises InputError where zst needs a library that is not installed.
    """
    if magic.startswith(GZIP_MAGIC):
        return Inflated(source, lambda: zlib.decompressobj(wbits=31), zlib.error, _GZ_CHUNK_BYTES)
    if not magic.startswith(ZSTD_MAGIC):
        return None
    try:
        zstandard = importlib.import_module("zstandard")
    except ImportError:
        raise InputError(f"{path}: reading .zst needs the zstandard package: pip install dsz-daemon[desk]") from None
    return Inflated(source, zstandard.ZstdDecompressor().decompressobj, zstandard.ZstdError, _ZST_CHUNK_BYTES)
