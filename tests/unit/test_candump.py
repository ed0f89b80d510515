"""The candump format by hand: every form of a line, and what is no frame."""

from __future__ import annotations

from typing import Any

import pytest

from dsz_daemon.edge.candump import MalformedLine, candump_line, channel_name, parse_line
from dsz_daemon.edge.candump_scan import candump_frames
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.pipeline.frames import Frame

T_NS = 1_486_049_865_816_040_000
STAMP = "(1486049865.816040) can0 "


def parsed(content: str) -> Frame:
    frame = parse_line(STAMP + content)
    assert frame is not None
    assert (frame.t_ns, frame.channel) == (T_NS, "can0")
    return frame


def scanned(text: bytes) -> tuple[list[Frame], LogReport]:
    report = LogReport()
    return list(candump_frames([text.splitlines(keepends=True)], "drive.log", report)), report


@pytest.mark.parametrize(
    ("id_text", "can_id", "is_extended"),
    [
        ("123", 0x123, False),
        ("00000123", 0x123, True),  # the width decides, not the value
        ("7FF", 0x7FF, False),
        ("1FFFFFFF", 0x1FFFFFFF, True),
        ("18FEF100", 0x18FEF100, True),
        ("98FEF100", 0x18FEF100, True),  # CAN_EFF_FLAG left in by the recorder
        ("7", 7, False),
        ("1234", 0x1234, True),
        ("ab", 0xAB, False),
    ],
)
def test_id_is_extended_by_the_width_of_its_text(id_text: str, can_id: int, is_extended: bool) -> None:
    assert parsed(f"{id_text}#01") == Frame(T_NS, "can0", can_id, b"\x01", is_extended)


@pytest.mark.parametrize(
    ("content", "data"),
    [
        ("123#", b""),
        ("123#dEaD", b"\xde\xad"),
        ("123#11.22.33", b"\x11\x22\x33"),
        ("123#11.2233.44.", b"\x11\x22\x33\x44"),
        ("123#0011223344556677", bytes.fromhex("0011223344556677")),
        ("123#0011223344556677_9", bytes.fromhex("0011223344556677")),
        ("123#0011223344556677_f", bytes.fromhex("0011223344556677")),
        ("123#DEAD R", b"\xde\xad"),
        ("123#DEAD T", b"\xde\xad"),
        ("123#DEAD  R B E", b"\xde\xad"),
        ("123#DEAD   'a(b c#'", b"\xde\xad"),
        ("123#DEAD T 'ab'", b"\xde\xad"),
        ("123#DEAD \t ", b"\xde\xad"),
    ],
)
def test_data_in_all_its_spellings(content: str, data: bytes) -> None:
    assert parsed(content) == Frame(T_NS, "can0", 0x123, data)


def test_can_fd_frames_keep_their_flags() -> None:
    assert parsed("123##0112233") == Frame(T_NS, "can0", 0x123, b"\x11\x22\x33", is_fd=True)
    assert parsed("123##5") == Frame(T_NS, "can0", 0x123, b"", is_fd=True, fd_flags=5)
    assert parsed("00000123##F" + "A5" * 64) == Frame(
        T_NS, "can0", 0x123, b"\xa5" * 64, is_extended=True, is_fd=True, fd_flags=15
    )
    assert parsed("123##1.11.22").data == b"\x11\x22"


@pytest.mark.parametrize(("content", "length"), [("123#R", 0), ("123#r0", 0), ("123#R8", 8), ("123#R8_C", 8)])
def test_remote_frames_have_a_length_and_no_data(content: str, length: int) -> None:
    assert parsed(content) == Frame(T_NS, "can0", 0x123, b"", is_remote=True, remote_length=length)


def test_error_frames_are_known_by_the_flag_in_an_id_of_eight_digits() -> None:
    data = bytes.fromhex("0004000000000000")
    assert parsed("20000004#0004000000000000") == Frame(T_NS, "can0", 4, data, is_error=True)
    assert parsed("20000088#").can_id == 0x88
    # can-utils, lib.h: 32345678#112233 is an error frame.
    assert parsed("32345678#112233") == Frame(T_NS, "can0", 0x12345678, b"\x11\x22\x33", is_error=True)


@pytest.mark.parametrize(
    ("stamp", "t_ns"),
    [
        ("0.000001", 1_000),
        ("000.200074", 200_074_000),  # candump -L -tz
        ("12", 12_000_000_000),
        ("1.5", 1_500_000_000),
        ("1.05", 1_050_000_000),
        ("1486049865.816040123", 1_486_049_865_816_040_123),
        ("1486049865.8160401234", 1_486_049_865_816_040_123),
        ("1486049865.8160401235", 1_486_049_865_816_040_124),
        ("0000000001.000001", 1_000_001_000),
        # The float 1700000000.123457 is 24 ns away from it.
        ("1700000000.123457", 1_700_000_000_123_457_000),
    ],
)
def test_stamps_become_integer_nanoseconds(stamp: str, t_ns: int) -> None:
    frame = parse_line(f"({stamp}) can0 123#00")
    assert frame is not None
    assert frame.t_ns == t_ns


def test_spaces_and_line_ends_do_not_matter() -> None:
    expected = Frame(T_NS, "vcan0", 0x123, b"\xde\xad")
    for line in ("(1486049865.816040)   vcan0 123#DEAD\r\n", " (1486049865.816040)\tvcan0  123#DEAD \n"):
        assert parse_line(line) == expected


@pytest.mark.parametrize("line", ["", "\n", "  \r\n", "# note", "; note", "// note", "DROPCOUNT: dropped 3 CAN"])
def test_blank_lines_and_comments_are_no_frames(line: str) -> None:
    assert parse_line(line) is None


@pytest.mark.parametrize(
    "line",
    [
        "(1486049865.816040) can0 123#0",  # half a byte
        "(1486049865.816040) can0 123#00.1.22",
        "(1486049865.816040) can0 123#00..22",
        "(1486049865.816040) can0 123#001122334455667788",  # nine bytes of classic CAN
        "(1486049865.816040) can0 123##1" + "00" * 65,
        "(1486049865.816040) can0 123##",
        "(1486049865.816040) can0 123##G00",
        "(1486049865.816040) can0 123##0R",  # CAN FD has no remote frames
        "(1486049865.816040) can0 123#R9",
        "(1486049865.816040) can0 20000004#R",  # an error frame is never a remote one
        "(1486049865.816040) can0 20000004##000",
        "(1486049865.816040) can0 FFF#00",  # 12 bits
        "(1486049865.816040) can0 40000123#00",
        "(1486049865.816040) can0 123456789#00",
        "(1486049865.816040) can0 1_2#00",
        "(1486049865.816040) can0 0x1#00",
        "(1486049865.816040) can0 #00",
        "(1486049865.816040) can0 123",
        "(1486049865.816040) can0 123#11 22 33",  # one byte would be a wrong frame
        "(1486049865.816040) can0 123#00(1486049865.816041) can0 124#00",
        "(1486049865.816040) can0 123#00_9",
        "(1486049865.816040) can0 123##0" + "00" * 8 + "_9",
        "(1486049865.816040) 123#00",
        "(1486049865.816040)",
        "1486049865.816040 can0 123#00",
        "(-1.5) can0 123#00",
        "(1.5e9) can0 123#00",
        "(1_0.5) can0 123#00",
        "(.5) can0 123#00",
        "(9223372036.854775808) can0 123#00",
        "(9300000000.000000) can0 123#00",
        "(1486049865.816040) can0 123#00 X",
        "(" + "9" * 10_000 + ".0) can0 123#00",
        "(1.\xb2) can0 123#00",
        "(1.5) c\xe4n0 123#00",
        " (1486049865.816040)  can0  123   [2]  DE AD",  # candump's screen form
        "(1486049865.816040) can0 00123#81:00:12345678#11",  # CAN XL
        "\x00\x00\x00",
    ],
)
def test_what_is_no_frame_is_refused_with_a_reason(line: str) -> None:
    with pytest.raises(MalformedLine, match="expected "):
        parse_line(line)
    frames, report = scanned(line.encode("latin-1") + b"\n(1.0) can0 123#00\n")
    assert [frame.can_id for frame in frames] == [0x123]
    assert (report.malformed_lines, report.cut_last_line) == (1, 0)
    assert report.malformed_examples[0].where == "drive.log:1"


def test_channels_are_named_as_configurations_name_buses() -> None:
    assert [channel_name(c) for c in ("vcan0", "1", "007", 2, None, "can\xb2")] == [
        "vcan0", "can1", "can7", "can2", "can0", "can\xb2",
    ]  # fmt: skip
    for line in (b"(1.0) 3 123#00\n", b"(1.000000) 3 123#00\n"):
        frames, report = scanned(line)
        assert [frame.channel for frame in frames] == ["can3"]
        assert report.channels == {"can3": 1}


def test_lines_are_written_as_candump_writes_them() -> None:
    assert candump_line(Frame(T_NS, "vcan0", 0x83, b"\x40\x20")) == "(1486049865.816040) vcan0 083#4020"
    assert candump_line(Frame(0, "can0", 0x83, b"", True)) == "(0000000000.000000) can0 00000083#"
    assert candump_line(Frame(T_NS, "can0", 4, b"\x01", is_error=True)) == STAMP + "20000004#01"
    assert candump_line(Frame(T_NS, "can0", 4, b"\x01", is_fd=True, fd_flags=10)) == STAMP + "004##A01"
    remote = Frame(T_NS, "can0", 4, b"", is_remote=True)
    assert candump_line(remote) == STAMP + "004#R"
    assert candump_line(remote._replace(remote_length=8)) == STAMP + "004#R8"


def test_written_stamps_are_rounded_to_the_nearest_microsecond() -> None:
    for t_ns, text in ((1499, "000001"), (1500, "000002"), (2500, "000003"), (999, "000001")):
        assert candump_line(Frame(t_ns, "can0", 1, b"")) == f"(0000000000.{text}) can0 001#"
    assert candump_line(Frame(999_999_500, "can0", 1, b"")).startswith("(0000000001.000000)")


@pytest.mark.parametrize(
    "change",
    [
        {"t_ns": -1},
        {"can_id": 0x800},
        {"can_id": 0x20000000, "is_extended": True},
        {"data": bytes(9)},
        {"channel": "front camera"},
        {"channel": ""},
        {"fd_flags": 16, "is_fd": True},
        {"remote_length": 9, "is_remote": True},
    ],
)
def test_a_frame_that_no_line_can_hold_is_not_written(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="no candump text"):
        candump_line(Frame(T_NS, "can0", 1, b"")._replace(**change))


def test_a_cut_last_line_is_told_from_a_malformed_one() -> None:
    good = b"(1.0) can0 123#00\n"
    for tail in (b"(2.0) can0 12", b"(2.", b"(2.0) can0 123#001", b"(2.0) can0 123#001\n", b"\0" * 500):
        frames, report = scanned(good + tail)
        assert len(frames) == 1
        assert (report.malformed_lines, report.cut_last_line, report.lines) == (0, 1, 2)
    frames, report = scanned(good + b"(2.0) can0 123#001\n" + good)
    assert len(frames) == 2
    assert (report.malformed_lines, report.cut_last_line) == (1, 0)
    frames, report = scanned(good + b"(2.0) can0 123#0011")  # whole, only its end is missing
    assert [frame.data for frame in frames] == [b"\x00", b"\x00\x11"]
    assert (report.malformed_lines, report.cut_last_line) == (0, 0)


def test_the_report_counts_what_was_in_the_text() -> None:
    frames, report = scanned(
        b"# from the car\n"
        b"(10.000000) can0 123#00\n"
        b"(12.000000) can1 123#R\n"
        b"(11.500000) can1 20000004#\n"
        b"DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 3)\n"
        b"(11.600000) can0 124##001\n"
        b"(11.400000) can0 125#00\n"
        b"junk \x01\n"
    )
    assert [frame.can_id for frame in frames] == [0x123, 0x123, 4, 0x124, 0x125]
    assert report.frames == 5
    assert report.channels == {"can0": 3, "can1": 2}
    assert (report.error_frames, report.remote_frames, report.fd_frames) == (1, 1, 1)
    assert (report.first_t_ns, report.last_t_ns) == (10_000_000_000, 11_400_000_000)
    assert (report.backward_steps, report.largest_backward_ns) == (2, 500_000_000)
    assert report.dropped_by_recorder == 3
    assert report.lines == 8
    assert str(report.malformed_examples[0]).startswith(r"drive.log:8: 'junk \x01' (expected (epoch.seconds)")


def test_only_the_first_five_malformed_lines_are_kept() -> None:
    _, report = scanned(b"".join(b"bad %d\n" % number for number in range(9)))
    assert report.malformed_lines == 9
    assert [example.where for example in report.malformed_examples] == [f"drive.log:{n}" for n in range(1, 6)]


def test_a_reader_that_stops_early_has_counted_what_it_read() -> None:
    report = LogReport()
    line = b"(1.0) can0 123#00\n"
    frames = candump_frames([[line, line, line[:-2] + b"\n", line, line, line]], "drive.log", report)
    for _ in range(3):
        next(frames)
    frames.close()
    assert (report.lines, report.frames, report.last_t_ns) == (4, 3, 1_000_000_000)
    assert (report.malformed_lines, report.cut_last_line) == (1, 0)
