"""Recordings of other tools (.asc, .blf, .trc, .mf4), read by python-can's readers.

Time: python-can's float seconds are rounded to the nearest microsecond, which is as much as a
float holds for a date of today. Which clock they are on is python-can's answer: ASC counts from
the start of the measurement, TRC 1.0 from zero; BLF, MF4 and TRC from 1.1 on are absolute.

Channel: the first bus is `can0`. python-can numbers ASC and BLF buses from 0 already (the files
count from 1); TRC files count from 1 and python-can leaves that, so 1 is taken off here; the
number in an MF4 file is taken as it stands. So what python-can writes for `can1` is `can1` again.
"""

from __future__ import annotations

import importlib
import logging
import math
import re
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TextIO, cast

from dsz_daemon.edge.candump import (
    CLASSIC_BYTES_MAX,
    EXTENDED_ID_MAX,
    FD_BYTES_MAX,
    STANDARD_ID_MAX,
    T_NS_LIMIT,
    channel_name,
)
from dsz_daemon.edge.log_report import NO_FRAME_YET_NS, LogReport, printable
from dsz_daemon.edge.recording_file import Format, RecordingFile
from dsz_daemon.errors import InputError
from dsz_daemon.pipeline.frames import Frame

if TYPE_CHECKING:
    from can import Message

_MESSAGES_PER_TICK = 4096
_LOOKS_LIKE_FRAME = re.compile(r"\s*[0-9]")
# TRC lines that hold no frame and are no fault: comments, and the controller's own news (types
# of PEAK's format description; FFFFFFFF is TRC 1.0's bus information).
_TRC_NO_FRAME = re.compile(r"\s*(?:;|$)|.*\s(?:ST|EC|ER|EV|Error|Warng|Ovrun|HWERR|FFFFFFFF)\s")
# An object's header: signature, header's length and version, the object's length.
_BLF_OBJECT_WITHOUT_LENGTH = re.compile(rb"LOBJ.{4}\0{4}", re.DOTALL)


class _BadMessage(ValueError):  # noqa: N818 - a status that is counted, not a failure
    """What python-can made of some bytes is no CAN frame; the message says why."""


def frame_of_message(message: Message, first_channel: int = 0) -> Frame:
    """Frame of a python-can message; `first_channel` is the number of the bus named can0.

    Raises ValueError for what can't have been on a bus (an id or a length out of range, data
    shorter than its DLC) and for a stamp that is no number.
    """
    if not math.isfinite(message.timestamp) or abs(message.timestamp) >= T_NS_LIMIT / 1e9:
        raise _BadMessage(f"time stamp {message.timestamp}")
    channel: str | int | None = None
    if isinstance(message.channel, int):
        channel = max(message.channel - first_channel, 0)
    elif isinstance(message.channel, str):
        channel = message.channel
    is_error, is_fd = message.is_error_frame, message.is_fd
    # CAN FD has no remote frames: python-can's ASC reader calls an empty FD frame so.
    is_remote = message.is_remote_frame and not is_fd and not is_error
    data = b"" if is_remote else bytes(message.data)
    limit = EXTENDED_ID_MAX if message.is_extended_id or is_error else STANDARD_ID_MAX
    if not 0 <= message.arbitration_id <= limit:
        raise _BadMessage(f"id {message.arbitration_id:X} above {limit:X}")
    if len(data) > (FD_BYTES_MAX if is_fd else CLASSIC_BYTES_MAX):
        raise _BadMessage(f"{len(data)} data bytes")
    is_plain = not (is_fd or is_remote or is_error)
    if is_plain and len(data) < min(message.dlc, CLASSIC_BYTES_MAX):
        raise _BadMessage(f"{len(data)} data bytes where the length says {message.dlc}")
    return Frame(
        t_ns=round(message.timestamp * 1e6) * 1000,
        channel=channel_name(channel),
        can_id=message.arbitration_id,
        data=data,
        is_extended=message.is_extended_id and not is_error,
        is_fd=is_fd,
        is_remote=is_remote,
        is_error=is_error,
        fd_flags=(message.bitrate_switch | message.error_state_indicator << 1) if is_fd else 0,
        remote_length=min(message.dlc, CLASSIC_BYTES_MAX) if is_remote else 0,
    )


class _TextLines:
    """The lines of a text file as python-can's readers take them.

    `is_used` tells whether the last line has been accounted for; one that has not been when the
    next is asked for was skipped by the reader.
    """

    def __init__(self, blocks: Iterable[list[bytes]], skipped: Callable[[_TextLines], None]) -> None:
        self._lines = (line.decode("latin-1") for block in blocks for line in block)
        self._skipped = skipped
        self._in_front: list[str] = []
        self.number = 0
        self.last = ""
        self.is_used = True
        self.is_exhausted = False

    def __iter__(self) -> _TextLines:
        return self

    def __next__(self) -> str:
        if self._in_front:
            return self._in_front.pop()
        if not self.is_used:
            self.is_used = True
            self._skipped(self)
        line = next(self._lines, None)
        if line is None:
            self.is_exhausted = True
            raise StopIteration
        self.last = line
        self.number += 1
        self.is_used = False
        return self.last

    @property
    def last_is_whole(self) -> bool:
        """Whether the last line has an end: the last one of a cut file has not."""
        return self.last.endswith(("\n", "\r"))

    def put_in_front(self, line: str) -> None:
        """Have `line` read next; it is not counted."""
        self._in_front.append(line)

    def close(self) -> None:
        """Do nothing: whoever opened the file closes it."""


def vendor_frames(file: RecordingFile, kind: Format, report: LogReport, tick: Callable[[], None]) -> Iterator[Frame]:
    """Frames of a recording in one of python-can's formats, in the order of the file.

    Lines and messages that can't be read are counted and the rest is read; where a binary file
    breaks off, what stands in front of that is yielded and the break is counted. Raises
    InputError if python-can refuses the file as a whole.
    """
    if kind in {"asc", "trc"}:
        messages = _text_messages(file, kind, report, tick)
    else:
        messages = _binary_messages(file, kind, report, tick)
    first_channel = 1 if kind == "trc" else 0
    previous_ns = NO_FRAME_YET_NS
    for place, text, message in messages:
        try:
            frame = frame_of_message(message, first_channel)
        except _BadMessage as bad:
            if text and not text.endswith(("\n", "\r")):
                report.cut_last_line += 1
            else:
                report.add_malformed(file.path.name, place, text or str(message), f"found {bad}")
            continue
        report.add_kind(frame)
        if frame.t_ns < previous_ns:
            report.add_earlier(file.path.name, frame.t_ns, previous_ns)
        previous_ns = report.last_t_ns = frame.t_ns
        yield frame


def _text_messages(
    file: RecordingFile, kind: Format, report: LogReport, tick: Callable[[], None]
) -> Iterator[tuple[str, str, Message]]:
    """(line number, line, message) of an ASC or TRC file.

    A reader of python-can ends at the first line that it stumbles over; it is asked again for
    the lines behind it.
    """

    def skipped(lines: _TextLines) -> None:
        if not lines.last_is_whole:
            report.cut_last_line += _LOOKS_LIKE_FRAME.match(lines.last) is not None
        elif kind == "trc" and not _TRC_NO_FRAME.match(lines.last):
            report.add_malformed(file.path.name, str(lines.number), lines.last, "expected a TRC frame")

    lines = _TextLines(file.blocks(tick), skipped)
    reader = cast("Any", _reader_class(kind))(cast("TextIO", lines))
    try:
        messages = iter(reader)
        while True:
            try:
                message = next(messages)
            except StopIteration:
                break
            except Exception as error:  # any failure of a foreign parser is the line's
                if lines.is_exhausted:  # it misses something in the header: there is no line to blame
                    break
                lines.is_used = True
                if lines.last_is_whole:
                    report.add_malformed(file.path.name, str(lines.number), lines.last, _reason(error))
                else:
                    report.cut_last_line += 1
                messages = iter(reader)
                if kind == "asc":
                    # The reader expects a header and drops the line that ends it.
                    lines.put_in_front("no internal events logged\n")
                continue
            lines.is_used = True
            yield str(lines.number), lines.last, message
    finally:
        report.lines += lines.number


def _binary_messages(
    file: RecordingFile, kind: Format, report: LogReport, tick: Callable[[], None]
) -> Iterator[tuple[str, str, Message]]:
    """(position, "", message) of a BLF or MF4 file."""
    reader = _binary_reader(file, kind)
    count = 0
    try:
        messages = iter(reader)
        while True:
            try:
                message = next(messages)
            except StopIteration:
                break
            except Exception as error:  # any failure of a foreign parser is the file's
                report.cut_last_line += 1
                report.warnings.append(f"{file.path.name} can't be read behind frame {count} ({_reason(error)})")
                return
            count += 1
            if count % _MESSAGES_PER_TICK == 0:
                tick()
            yield f"frame {count}", "", message
        if kind == "blf" and not file.inflated and reader.file_size > file.path.stat().st_size:
            report.cut_last_line += 1
            report.warnings.append(f"{file.path.name} is cut off: it says that it has {reader.file_size} bytes")
    finally:
        reader.stop()


def _binary_reader(file: RecordingFile, kind: Format) -> Any:
    """python-can's reader on an open file. An MF4 file, which is no stream, it takes into memory."""
    if kind == "mf4":
        try:
            importlib.import_module("asammdf")
        except ImportError:
            raise InputError(
                f"{file.path}: reading .mf4 needs the asammdf package: pip install dsz-daemon[desk]"
            ) from None
    try:
        return cast("Any", _reader_class(kind))(file.stream)
    except Exception as error:  # any failure of a foreign parser is the file's
        _abandon(error)
        raise InputError(
            f"{file.path}: {kind.upper()} expected by its name or first bytes, but it is not readable "
            f"({_reason(error)})"
        ) from None


def _abandon(error: Exception) -> None:
    """Close what asammdf had half made when it failed.

    Otherwise its `__del__` closes, stumbles over what the object lacks, and that is printed.
    """
    for frame, _ in traceback.walk_tb(error.__traceback__):
        half_made = frame.f_locals.get("self")
        if half_made is not None and hasattr(half_made, "close"):
            with suppress(Exception):
                half_made.close()


def _reader_class(kind: Format) -> type:
    """python-can's reader; imported here because it takes longer than reading a short log."""
    import can  # noqa: PLC0415

    # Its readers log what they skip, raw, and logging prints that where nobody has set it up. Here
    # it is counted; whoever sets logging up still gets it.
    logger = logging.getLogger("can.io")
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())

    class FiniteBLFReader(can.BLFReader):
        """BLFReader that ends where an object has no length: the original reads that one for ever."""

        def _parse_container(self, data: bytes) -> Iterator[Message]:
            data, self._tail = self._tail + data, b""
            endless = _BLF_OBJECT_WITHOUT_LENGTH.search(data)
            yield from super()._parse_container(data[: endless.start()] if endless else data)
            if endless:
                raise ValueError("an object without length")

    readers = {"asc": can.ASCReader, "blf": FiniteBLFReader, "trc": can.TRCReader, "mf4": can.MF4Reader}
    return readers[kind]


def _reason(error: Exception) -> str:
    return printable(f"{type(error).__name__}: {error}" if str(error) else type(error).__name__)
