"""Candump text, by generated frames and by generated and damaged lines."""

from __future__ import annotations

import io
from decimal import ROUND_HALF_UP, Decimal
from itertools import pairwise

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dsz_daemon.edge.candump import MalformedLine, candump_line, parse_line
from dsz_daemon.edge.candump_scan import candump_frames
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.pipeline.frames import Frame

STANDARD = st.integers(0, 0x7FF).map(lambda can_id: (can_id, False))
EXTENDED = st.integers(0, 0x1FFFFFFF).map(lambda can_id: (can_id, True))
MICROSECONDS_NS = st.integers(0, 2**63 // 1000 - 1).map(lambda t_us: t_us * 1000)
CHANNELS = st.from_regex(r"[a-z][a-z0-9_.-]{0,14}", fullmatch=True)


@st.composite
def frames(draw: st.DrawFn, t_ns: st.SearchStrategy[int] = MICROSECONDS_NS) -> Frame:
    stamp, channel = draw(t_ns), draw(CHANNELS)
    kind = draw(st.sampled_from(["data", "data", "fd", "remote", "error"]))
    can_id, is_extended = draw(STANDARD | EXTENDED)
    if kind == "fd":
        data, flags = draw(st.binary(max_size=64)), draw(st.integers(0, 15))
        return Frame(stamp, channel, can_id, data, is_extended, is_fd=True, fd_flags=flags)
    if kind == "remote":
        length = draw(st.integers(0, 8))
        return Frame(stamp, channel, can_id, b"", is_extended, is_remote=True, remote_length=length)
    data = draw(st.binary(max_size=8))
    if kind == "error":
        return Frame(stamp, channel, can_id, data, is_error=True)
    return Frame(stamp, channel, can_id, data, is_extended)


@st.composite
def damaged_lines(draw: st.DrawFn) -> bytes:
    """A line as a recorder may leave it: whole, decorated, or with a few characters wrong."""
    line = candump_line(draw(frames()))
    line = draw(st.sampled_from([line, line.lower(), line.replace(" ", "  ")]))
    line += draw(st.sampled_from(["", "", " R", " T", " r", " Rx", " X", "  T", " 00", "_9", ".", " 'a b'", "#"]))
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 1, 2, 3]))):
        position = draw(st.integers(0, len(line)))
        width = draw(st.integers(0, 1))
        put = draw(st.text("0189AFaf78#R.()_+- \t\r\x00\x1c\x0b\xa0\xb2\xff'Tx", max_size=2))
        line = line[:position] + put + line[position + width :]
    return line.encode("latin-1").replace(b"\r\n", b"\n") + draw(st.sampled_from([b"\n", b"\n", b"\r\n"]))


def scanned(lines: list[bytes], wanted: set[int] | None = None) -> tuple[list[Frame], LogReport]:
    report = LogReport()
    return list(candump_frames([lines], "drive.log", report, wanted)), report


@given(frames())
def test_every_frame_comes_back_from_its_line(frame: Frame) -> None:
    assert parse_line(candump_line(frame)) == frame


@given(frames(st.integers(0, 2**63 - 1001)))
def test_written_stamp_is_the_nearest_microsecond(frame: Frame) -> None:
    written = Decimal(candump_line(frame)[1:].split(")")[0])
    exact = Decimal(frame.t_ns) / 10**9
    assert written == exact.quantize(Decimal("0.000001"), ROUND_HALF_UP)


@given(st.integers(0, 9_223_372_035), st.text("0123456789", min_size=1, max_size=9))
def test_stamps_are_read_exactly(seconds: int, decimals: str) -> None:
    frame = parse_line(f"({seconds}.{decimals}) can0 123#00")
    assert frame is not None
    assert frame.t_ns == Decimal(f"{seconds}.{decimals}") * 10**9


@given(st.lists(damaged_lines(), max_size=8))
@settings(max_examples=250, deadline=None)
def test_quick_and_defining_reader_agree_on_any_line(lines: list[bytes]) -> None:
    expected: list[Frame] = []
    odd_at_the_end = False
    malformed = 0
    for line in lines:
        odd_at_the_end = False
        try:
            frame = parse_line(line.decode("latin-1"))
        except MalformedLine as error:
            malformed += 1
            odd_at_the_end = error.odd_digits
        else:
            expected += [] if frame is None else [frame]
    read, report = scanned(lines)
    assert read == expected
    assert all(type(frame) is Frame for frame in read)
    assert report.lines == len(lines)
    assert report.frames == len(expected)
    assert (report.malformed_lines, report.cut_last_line) == (malformed - odd_at_the_end, int(odd_at_the_end))
    steps = [a.t_ns - b.t_ns for a, b in pairwise(expected) if b.t_ns < a.t_ns]
    assert (report.backward_steps, report.largest_backward_ns) == (len(steps), max(steps, default=0))


@given(st.lists(damaged_lines(), max_size=8), st.sets(st.integers(0, 0x7FF)), st.data())
@settings(max_examples=100, deadline=None)
def test_wanted_is_the_same_as_filtering_afterwards(lines: list[bytes], ids: set[int], data: st.DataObject) -> None:
    all_frames, all_report = scanned(lines)
    if all_frames:
        ids |= data.draw(st.sets(st.sampled_from([frame.can_id for frame in all_frames])))
    read, report = scanned(lines, wanted=ids)
    assert read == [frame for frame in all_frames if frame.can_id in ids]
    assert report == all_report


@given(st.lists(frames(st.integers(0, 4_000_000_000_000_000).map(lambda t_us: t_us * 1000)), max_size=10))
@settings(deadline=None)
def test_python_can_reads_the_same_frames(written: list[Frame]) -> None:
    # What it can't: error frames (it knows one of their kinds), flags above 9, more than ESI and BRS.
    written = [frame for frame in written if not frame.is_error and frame.fd_flags < 10]
    text = "".join(candump_line(frame) + "\n" for frame in written)
    read, _ = scanned(text.encode("ascii").splitlines(keepends=True))
    for ours, theirs in zip(read, can.CanutilsLogReader(io.StringIO(text)), strict=True):
        assert ours.t_ns == pytest.approx(theirs.timestamp * 1e9, abs=1000)
        assert (ours.channel, ours.can_id, ours.data) == (theirs.channel, theirs.arbitration_id, bytes(theirs.data))
        assert (ours.is_extended, ours.is_fd) == (theirs.is_extended_id, theirs.is_fd)
        assert ours.is_remote == theirs.is_remote_frame
        assert (ours.remote_length or len(ours.data)) == theirs.dlc
        assert (bool(ours.fd_flags & 1), bool(ours.fd_flags & 2)) == (
            theirs.bitrate_switch,
            theirs.error_state_indicator,
        )
