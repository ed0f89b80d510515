"""The candump text format, line by line: text -> Frame and Frame -> text. No file is touched here.

    (1486049865.816040) vcan0 083#4020000008000000       standard id (three digits), eight bytes
    (1486049865.816040) vcan0 18FEF100#FF.00 R           extended id (by the width of its text)
    (1486049865.816040) vcan0 083#R8                     remote frame
    (1486049865.816040) vcan0 083##1DEADBEEF             CAN FD: a flags digit, then up to 64 bytes
    (1486049865.816040) vcan0 20000004#0004000000000000  error frame (CAN_ERR_FLAG in the id)

Source: can-utils, `lib.h` and `parse_canframe`. Departures, all of them on the lenient side of
can-utils and as python-can reads them: ids of one, two and four to seven digits are read
(standard up to three digits, extended above); time stamps may have any number of decimals.
CAN XL is not read.
"""

from __future__ import annotations

import re

from dsz_daemon.pipeline.frames import Frame

STANDARD_ID_MAX = 0x7FF
EXTENDED_ID_MAX = 0x1FFFFFFF
CAN_ERR_FLAG = 0x20000000  # linux/can.h; a standard frame's text is too short to carry it
CAN_EFF_FLAG = 0x80000000  # says "extended", which the width has said already
CLASSIC_BYTES_MAX = 8
FD_BYTES_MAX = 64
T_NS_LIMIT = 2**63  # April 2262: nanoseconds stay within 64 bits for everything downstream
EXPECTED = "(epoch.seconds) channel ID#DATA, as `candump -l` writes it"

_SPACE = " \t\r\n\f\v"
_LINE = re.compile(
    r"\([ ]*([0-9]+)(?:\.([0-9]*))?[ ]*\)"  # seconds, decimals
    r"[ \t]+([!-~]+)[ \t]+([!-~]+)"  # channel, ID#DATA
    r"(?:[ \t]+(.+))?",  # what candump -x and converters append
    re.DOTALL,
)
# Direction, CAN FD bit names and an ASCII column may follow; bare hex digits may not, for
# they would be data bytes that the frame then lacks.
_APPENDED = re.compile(r"[RrTt][xX]?(?:[ \t]+[B-][ \t]+[E-])?(?:[ \t]+['`].*)?|['`].*", re.DOTALL)
_FRAME = re.compile(r"([0-9A-Fa-f]{1,8})#(.*)", re.DOTALL)
_REMOTE = re.compile(r"[Rr](?:([0-7])|(8)(?:_[9A-Fa-f])?)?")
_DATA = re.compile(r"((?:\.?[0-9A-Fa-f]{2})*)\.?(?:_([9A-Fa-f]))?")
_ODD_DIGITS = re.compile(r"(?:\.?[0-9A-Fa-f]{2})*\.?[0-9A-Fa-f]")
_CHANNEL = re.compile(r"[!-~]+")


class MalformedLine(ValueError):  # noqa: N818 - a status that is counted, not a failure
    """A line that is neither frame nor comment; the message says why.

    `odd_digits`: the data ends in half a byte, as a line does that was cut off.
    """

    def __init__(self, why: str, odd_digits: bool = False) -> None:
        super().__init__(why)
        self.odd_digits = odd_digits


def channel_name(channel: str | int | None) -> str:
    """Bus name as configurations write it: a bare number N is `canN`, none at all is `can0`.

    >>> channel_name("vcan0"), channel_name("1"), channel_name(2), channel_name(None)
    ('vcan0', 'can1', 'can2', 'can0')
    """
    if channel is None:
        return "can0"
    text = str(channel)
    return f"can{int(text)}" if text.isascii() and text.isdecimal() else text


def parse_line(line: str) -> Frame | None:
    r"""Frame in one line of candump text; None for a blank line, a comment or a DROPCOUNT note.

    The stamp becomes integer nanoseconds exactly (beyond nine decimals: the nearest one).
    An error frame keeps its error class as `can_id`, without the flag, and is not extended.
    Raises MalformedLine for anything else.

    >>> parse_line("(1.5) can0 123#DEAD")[:5]
    (1500000000, 'can0', 291, b'\xde\xad', False)
    """
    text = line.strip(_SPACE)
    if not text or text.startswith(("#", ";", "//", "DROPCOUNT")):
        return None
    found = _LINE.fullmatch(text)
    if found is None:
        raise MalformedLine(f"expected {EXPECTED}")
    seconds, decimals, channel, frame_text, appended = found.groups()
    if appended is not None and _APPENDED.fullmatch(appended) is None:
        raise MalformedLine("expected nothing but a direction (R, T) or an ASCII column behind the data")
    split = _FRAME.fullmatch(frame_text)
    if split is None:
        raise MalformedLine("expected ID#DATA with an id of 1 to 8 hexadecimal digits")
    t_ns = _stamp_ns(seconds, decimals or "")
    return _frame(t_ns, channel_name(channel), split[1], split[2])


def _stamp_ns(seconds: str, decimals: str) -> int:
    """Integer nanoseconds of a decimal stamp; no float on the way."""
    if len(seconds) > 20:  # leading zeros are fine, a million digits are not
        raise MalformedLine("expected a time stamp in seconds")
    t_ns = int(seconds) * 1_000_000_000 + int(decimals[:9].ljust(9, "0")) + (decimals[9:10] >= "5")
    if t_ns >= T_NS_LIMIT:
        raise MalformedLine("expected a time stamp before the year 2262")
    return t_ns


def _frame(t_ns: int, channel: str, id_text: str, content: str) -> Frame:
    """Frame of the texts on both sides of the first '#'."""
    can_id = int(id_text, 16)
    is_extended = len(id_text) > 3
    if len(id_text) == 8 and can_id & CAN_ERR_FLAG:
        data = _data(content, CLASSIC_BYTES_MAX)
        return Frame(t_ns, channel, can_id & EXTENDED_ID_MAX, data, is_error=True)
    if len(id_text) == 8:
        can_id &= ~CAN_EFF_FLAG
    if can_id > (EXTENDED_ID_MAX if is_extended else STANDARD_ID_MAX):
        limit = EXTENDED_ID_MAX if is_extended else STANDARD_ID_MAX
        raise MalformedLine(f"expected an id of {len(id_text)} digits up to {limit:X}")
    if content.startswith("#"):
        if content[1:2] not in set("0123456789ABCDEFabcdef"):
            raise MalformedLine("expected a CAN FD flags digit behind ##")
        data = _data(content[2:], FD_BYTES_MAX)
        return Frame(t_ns, channel, can_id, data, is_extended, is_fd=True, fd_flags=int(content[1], 16))
    remote = _REMOTE.fullmatch(content)
    if remote is not None:
        length = int(remote[1] or remote[2] or 0)
        return Frame(t_ns, channel, can_id, b"", is_extended, is_remote=True, remote_length=length)
    return Frame(t_ns, channel, can_id, _data(content, CLASSIC_BYTES_MAX), is_extended)


def _data(text: str, bytes_max: int) -> bytes:
    """Bytes of a data text; single dots may separate them, `_9`..`_F` is a raw DLC above 8."""
    found = _DATA.fullmatch(text)
    if found is None:
        odd = _ODD_DIGITS.fullmatch(text) is not None
        why = "an even number of hexadecimal digits" if odd else "data in hexadecimal digits"
        raise MalformedLine(f"expected {why}", odd_digits=odd)
    data = bytes.fromhex(found[1].replace(".", ""))
    if len(data) > bytes_max:
        raise MalformedLine(f"expected at most {bytes_max} data bytes, found {len(data)}")
    if found[2] is not None and (bytes_max != CLASSIC_BYTES_MAX or len(data) != CLASSIC_BYTES_MAX):
        raise MalformedLine("expected a raw DLC only behind eight bytes of classic CAN")
    return data


def candump_line(frame: Frame) -> str:
    """One line of candump text for a frame, without line end.

    The stamp is written in microseconds as candump does, rounded to the nearest (a half up), so
    stamps in whole microseconds come back exactly. Raises ValueError for a frame that candump
    text can't hold: a bug of the caller.

    >>> candump_line(Frame(1486049865816040000, "vcan0", 0x83, bytes.fromhex("4020")))
    '(1486049865.816040) vcan0 083#4020'
    """
    limit = EXTENDED_ID_MAX if frame.is_extended or frame.is_error else STANDARD_ID_MAX
    bytes_max = FD_BYTES_MAX if frame.is_fd else CLASSIC_BYTES_MAX
    if not (
        0 <= frame.t_ns < T_NS_LIMIT
        and 0 <= frame.can_id <= limit
        and len(frame.data) <= bytes_max
        and 0 <= frame.fd_flags <= 0xF
        and 0 <= frame.remote_length <= CLASSIC_BYTES_MAX
        and _CHANNEL.fullmatch(frame.channel)
    ):
        raise ValueError(f"no candump text for {frame}")
    seconds, microseconds = divmod((frame.t_ns + 500) // 1000, 1_000_000)
    head = f"({seconds:010d}.{microseconds:06d}) {frame.channel} "
    data = frame.data.hex().upper()
    if frame.is_error:
        return f"{head}{frame.can_id | CAN_ERR_FLAG:08X}#{data}"
    head += f"{frame.can_id:08X}#" if frame.is_extended else f"{frame.can_id:03X}#"
    if frame.is_remote:
        return f"{head}R{frame.remote_length or ''}"
    return f"{head}#{frame.fd_flags:X}{data}" if frame.is_fd else head + data
