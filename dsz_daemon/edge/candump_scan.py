"""A whole candump text, block of lines by block: frames out, everything else counted.

The common line is read by one regular expression, any other by `parse_line`, which is the
definition of the format: where both apply they agree (a property test says so).
"""

from __future__ import annotations

import re
from binascii import unhexlify
from collections.abc import Callable, Collection, Generator, Iterable, Sequence

from dsz_daemon.edge.candump import MalformedLine, channel_name, parse_line
from dsz_daemon.edge.log_report import NO_FRAME_YET_NS, LogReport
from dsz_daemon.pipeline.frames import Frame

# Six decimals, a classic data frame, whole line. Seconds stay below the limit of 63 bits; an odd number
# of digits is left to `parse_line` (checking the length is quicker than asking for pairs).
_COMMON = re.compile(
    rb"\(([0-8][0-9]{9}|[0-9]{1,9})\.([0-9]{6})\) +([!-~]+) +"
    rb"([0-7][0-9A-Fa-f]{2}|[01][0-9A-Fa-f]{7})#([0-9A-Fa-f]{0,16})(?: [RT])?\r?\n"
)
_DROPCOUNT = re.compile(r"\s*DROPCOUNT: dropped ([0-9]{1,10}) ")
# A recording of a car has some hundred ids; junk may have millions.
_REMEMBERED = 65536


def _not_truncated() -> bool:
    return False


class _SlowLines:
    """Lines that are not of the common form: read by the definition, or counted.

    A line with half a byte at its end is held back until it is known whether it is the last one
    of the file: cut, or malformed.
    """

    def __init__(self, name: str, report: LogReport, truncated: Callable[[], bool]) -> None:
        self._name = name
        self._report = report
        self._truncated = truncated
        self._held: tuple[int, str, str] | None = None

    def frame(self, number: int, line: bytes) -> Frame | None:
        text = line.decode("latin-1")
        has_end = text.endswith(("\n", "\r"))
        try:
            frame = parse_line(text)
        except MalformedLine as malformed:
            if not has_end:
                self._report.cut_last_line += 1
            elif malformed.odd_digits:
                self.release()
                self._held = (number, text, str(malformed))
            else:
                self.release()
                self._report.add_malformed(self._name, str(number), text, str(malformed))
            return None
        if frame is None:
            dropped = _DROPCOUNT.match(text)
            self._report.dropped_by_recorder += int(dropped[1]) if dropped else 0
        elif not has_end and self._truncated():
            self._report.cut_last_line += 1
            return None
        else:
            self._report.add_kind(frame)
        return frame

    def release(self, last_number: int = 0) -> None:
        """Count the line that was held back, as cut if it is number `last_number`."""
        if self._held is not None:
            number, text, why = self._held
            self._held = None
            if number == last_number:
                self._report.cut_last_line += 1
            else:
                self._report.add_malformed(self._name, str(number), text, why)


def candump_frames(
    blocks: Iterable[Sequence[bytes]],
    name: str,
    report: LogReport,
    wanted: Collection[int] | None = None,
    truncated: Callable[[], bool] = _not_truncated,
) -> Generator[Frame, None, None]:
    """Frames of a candump text, in the order of its lines; `name` is used in messages.

    `blocks` are lists of lines with their ends. `wanted`: only frames with these ids are
    yielded, but all are counted: the report does not depend on it. `truncated` is asked at a
    last line without end whether bytes are known to be missing there: it is then no frame, even
    where it reads like one.
    """
    ids: dict[bytes, tuple[int, bool, bool]] = {}
    names: dict[bytes, str] = {}
    slow = _SlowLines(name, report, truncated)
    channels = report.channels
    new_frame = tuple.__new__  # Frame(...) at half the cost; the property test compares
    lines_before, number, previous_ns = report.lines, 0, NO_FRAME_YET_NS
    try:
        for block in blocks:
            for line in block:
                number += 1
                common = _COMMON.fullmatch(line)
                if common is None or len(common[5]) & 1:
                    uncommon = slow.frame(number, line)
                    if uncommon is None:
                        continue
                    frame = uncommon
                    t_ns = frame.t_ns
                    is_wanted = wanted is None or frame.can_id in wanted
                else:
                    seconds, microseconds, channel_text, id_text, data_text = common.groups()
                    t_ns = int(seconds + microseconds) * 1000
                    try:
                        can_id, is_extended, is_wanted = ids[id_text]
                        channel = names[channel_text]
                    except KeyError:
                        can_id, is_extended = int(id_text, 16), len(id_text) > 3
                        is_wanted = wanted is None or can_id in wanted
                        channel = channel_name(channel_text.decode("ascii"))
                        if len(ids) < _REMEMBERED and len(names) < _REMEMBERED:
                            ids[id_text] = (can_id, is_extended, is_wanted)
                            names[channel_text] = channel
                        channels.setdefault(channel, 0)
                    channels[channel] += 1
                    if is_wanted:
                        data = unhexlify(data_text)
                        frame = new_frame(Frame, (t_ns, channel, can_id, data, is_extended, False, False, False, 0, 0))
                if t_ns < previous_ns:
                    report.add_earlier(name, t_ns, previous_ns)
                previous_ns = t_ns
                if is_wanted:
                    yield frame
            report.lines = lines_before + number
        slow.release(last_number=number)
    finally:
        slow.release()
        report.lines = lines_before + number
        if previous_ns != NO_FRAME_YET_NS:
            report.last_t_ns = previous_ns
