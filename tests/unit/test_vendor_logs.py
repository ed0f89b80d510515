"""Recordings of other tools: what python-can writes comes back, and damage is counted."""

from __future__ import annotations

import gzip
import re
import sys
from itertools import islice
from pathlib import Path
from typing import Any

import can
import pytest

from dsz_daemon.edge.logs import LogReport, read_frames
from dsz_daemon.edge.vendor_logs import frame_of_message
from dsz_daemon.errors import InputError
from dsz_daemon.pipeline.frames import Frame

EPOCH_NS = 1_500_000_000_000_000_000
WRITERS: dict[str, Any] = {"asc": can.ASCWriter, "blf": can.BLFWriter, "trc": can.TRCWriter, "mf4": can.MF4Writer}
CLASSIC = [
    Frame(EPOCH_NS + 1_000, "can0", 0x123, b"\x01\x02\x03"),
    Frame(EPOCH_NS + 500_000_000, "can1", 0x18FEF100, bytes(range(8)), is_extended=True),
    Frame(EPOCH_NS + 600_000_000, "can0", 0x7F, b"", is_extended=True),
    Frame(EPOCH_NS + 1_234_567_000, "can0", 0x7FF, b"\xff" * 8),
]
OTHERS = [
    Frame(EPOCH_NS + 1_300_000_000, "can1", 0x12, b"", is_remote=True, remote_length=4),
    Frame(EPOCH_NS + 1_400_000_000, "can0", 0, b"", is_error=True),
    Frame(EPOCH_NS + 1_500_000_000, "can0", 0x77, bytes(range(12)), is_fd=True, fd_flags=1),
    Frame(EPOCH_NS + 1_600_000_000, "can2", 0x1ABCDEF0, bytes(64), is_extended=True, is_fd=True, fd_flags=3),
    Frame(EPOCH_NS + 1_700_000_000, "can0", 0x78, b"", is_fd=True),
]


def message(frame: Frame) -> can.Message:
    return can.Message(
        timestamp=frame.t_ns / 1e9,
        arbitration_id=frame.can_id,
        is_extended_id=frame.is_extended,
        is_remote_frame=frame.is_remote,
        is_error_frame=frame.is_error,
        is_fd=frame.is_fd,
        bitrate_switch=bool(frame.fd_flags & 1),
        error_state_indicator=bool(frame.fd_flags & 2),
        channel=frame.channel,
        dlc=frame.remote_length if frame.is_remote else len(frame.data),
        data=frame.data,
    )


def written(path: Path, frames: list[Frame]) -> Path:
    with WRITERS[path.suffix[1:]](path) as writer:
        for frame in frames:
            writer(message(frame))
    return path


def read(*paths: Path) -> tuple[list[Frame], LogReport]:
    report = LogReport()
    return list(read_frames(list(paths), report)), report


def relative(frames: list[Frame]) -> list[Frame]:
    return [frame._replace(t_ns=frame.t_ns - frames[0].t_ns) for frame in frames]


@pytest.mark.parametrize("suffix", ["asc", "blf", "trc", "mf4"])
@pytest.mark.parametrize("is_packed", [False, True])
def test_what_python_can_writes_comes_back(tmp_path: Path, suffix: str, is_packed: bool) -> None:
    frames = CLASSIC if suffix == "trc" else CLASSIC + OTHERS  # its TRC writer drops the others
    path = written(tmp_path / f"drive.{suffix}", frames)
    if is_packed:
        packed = tmp_path / f"packed.{suffix.upper()}.gz"
        packed.write_bytes(gzip.compress(path.read_bytes()))
        path = packed
    got, report = read(path)
    # ASC counts from the first frame; the others keep the epoch.
    assert got == (relative(frames) if suffix == "asc" else frames)
    assert report.frames == len(frames)
    assert (report.malformed_lines, report.cut_last_line, report.warnings) == (0, 0, [])
    assert report.backward_steps == 0
    if suffix != "trc":
        assert (report.remote_frames, report.error_frames, report.fd_frames) == (1, 1, 3)


@pytest.mark.parametrize("suffix", ["asc", "blf", "trc", "mf4"])
def test_times_and_contents_are_python_cans_own(tmp_path: Path, suffix: str) -> None:
    frames = [Frame(EPOCH_NS + n * 12_345_000, "can0", n, bytes([n])) for n in range(100)]
    path = written(tmp_path / f"drive.{suffix}", frames)
    got, _ = read(path)
    with can.LogReader(path) as reader:
        for ours, theirs in zip(got, reader, strict=True):
            assert abs(ours.t_ns / 1e9 - theirs.timestamp) < 1e-6
            assert (ours.can_id, ours.data) == (theirs.arbitration_id, bytes(theirs.data))


@pytest.mark.parametrize("suffix", ["asc", "blf", "trc", "mf4"])
def test_the_format_is_known_under_any_name(tmp_path: Path, suffix: str) -> None:
    path = written(tmp_path / f"drive.{suffix}", CLASSIC)
    for name in ("drive.log", "drive"):
        got, _ = read(path.rename(tmp_path / name))
        assert [frame.can_id for frame in got] == [frame.can_id for frame in CLASSIC]
        path = tmp_path / name


@pytest.mark.parametrize("suffix", ["asc", "trc"])
def test_a_bad_line_costs_only_itself(tmp_path: Path, suffix: str) -> None:
    path = written(tmp_path / f"drive.{suffix}", CLASSIC)
    lines = path.read_text().splitlines(keepends=True)
    first = next(n for n, line in enumerate(lines) if "00 01 02 03 04 05 06 07" in line)
    bad = lines[first].replace("00 01 02 03 04 05 06 07", "00 XY 02 03 04 05 06 07")
    short = lines[first].replace("00 01 02 03 04 05 06 07", "00 01")
    path.write_text("".join([*lines[:first], bad, short, *lines[first:]]))
    got, report = read(path)
    assert got == (relative(CLASSIC) if suffix == "asc" else CLASSIC)
    assert (report.malformed_lines, report.cut_last_line) == (2, 0)
    assert [example.where for example in report.malformed_examples] == [
        f"drive.{suffix}:{first + 1}",
        f"drive.{suffix}:{first + 2}",
    ]
    assert "2 data bytes where the length says 8" in report.malformed_examples[1].what
    assert report.lines == len(lines) + 2


def test_a_bad_line_does_not_forget_the_base_of_an_asc_file(tmp_path: Path) -> None:
    path = tmp_path / "drive.asc"
    path.write_text(
        "date Sat Nov 21 10:00:00 2026\nbase dec  timestamps absolute\nno internal events logged\n"
        " 0.1 1  100 Rx   d 2 10 11\n"
        " 0.2 1  1x0 Rx   d 2 10 11\n"
        " 0.3 2  101 Rx   d 2 12 255\n"
    )
    got, report = read(path)
    assert got == [
        Frame(100_000_000, "can0", 100, b"\x0a\x0b"),
        Frame(300_000_000, "can1", 101, b"\x0c\xff"),
    ]
    assert report.malformed_lines == 1


def test_lines_of_a_trc_file_that_hold_no_frame(tmp_path: Path) -> None:
    path = tmp_path / "drive.trc"
    path.write_text(
        ";$FILEVERSION=1.1\n;$STARTTIME=42930.5\n"
        "     1)         1.5  Rx         0123  2  0A 0B\n"
        "     2)         1.6  Warng  FFFFFFFF  4  00 00 00 08  BUSLIGHT\n"
        "     3)         1.7  Rx         0124\n"
        "     4)         2.5  Rx     18FEF100  1  0C\n"
        "     5)         2.6  Rx         01"
    )
    got, report = read(path)
    start_ns = 1_500_033_600_000_000_000  # day 42930.5 of 1899-12-30, the 14th of July 2017 at noon
    assert got == [
        Frame(start_ns + 1_500_000, "can0", 0x123, b"\x0a\x0b"),
        Frame(start_ns + 2_500_000, "can0", 0x18FEF100, b"\x0c", is_extended=True),
    ]
    assert (report.malformed_lines, report.cut_last_line) == (1, 1)
    assert report.malformed_examples[0].where == "drive.trc:5"


def test_a_trc_file_without_its_columns_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "drive.trc", CLASSIC)
    path.write_text(path.read_text().replace("$COLUMNS", "$COLUMN"))
    report = LogReport()
    with pytest.raises(
        InputError, match=r"drive\.trc: no CAN frame in it; .*no column information.*expected CAN frames of the TRC"
    ):
        list(islice(read_frames([path], report), 10))
    assert report.malformed_lines == len(CLASSIC)


@pytest.mark.parametrize("suffix", ["asc", "trc"])
def test_a_cut_text_file_is_read_as_far_as_it_goes(tmp_path: Path, suffix: str) -> None:
    path = written(tmp_path / f"drive.{suffix}", CLASSIC)
    text = path.read_bytes()
    path.write_bytes(text[: text.index(b"FF FF FF FF FF FF FF FF") + 8])
    got, report = read(path)
    assert len(got) == 3
    assert (report.malformed_lines, report.cut_last_line) == (0, 1)


def test_a_cut_blf_file_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    frames = [Frame(EPOCH_NS + n * 1_000_000, "can0", n % 0x700, n.to_bytes(8, "big")) for n in range(8_000)]
    path = written(tmp_path / "drive.blf", frames)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 3 // 4])
    got, report = read(path)
    assert got == frames[: len(got)]
    assert 2_000 < len(got) < 8_000
    assert report.cut_last_line == 1
    assert "drive.blf" in report.warnings[0]
    second = whole.index(b"LOBJ", whole.index(b"LOBJ") + 4)
    path.write_bytes(whole[:second] + b"XXXX" + whole[second + 4 :])
    got, report = read(path)
    assert got == frames[: len(got)]
    assert 2_000 < len(got) < 8_000
    assert report.cut_last_line == 1
    assert f"can't be read behind frame {len(got)}" in report.warnings[0]


@pytest.mark.parametrize("version", [1, 9])
def test_a_blf_object_without_length_ends_the_reading(tmp_path: Path, version: int) -> None:
    # python-can reads such an object again and again; the container is stored to get at it.
    path = tmp_path / "drive.blf"
    with can.BLFWriter(path, compression_level=0) as writer:
        for frame in CLASSIC:
            writer(message(frame))
    data = bytearray(path.read_bytes())
    third = [found.start() for found in re.finditer(b"LOBJ", data)][3]  # the first is the container
    data[third + 6 : third + 12] = version.to_bytes(2, "little") + bytes(4)
    path.write_bytes(data)
    report = LogReport()
    got = list(islice(read_frames([path], report), 100))
    assert got == CLASSIC[:2]
    assert report.cut_last_line == 1
    assert "can't be read behind frame 2 (ValueError: an object without length)" in report.warnings[0]


def test_a_cut_mf4_file_is_refused_without_a_traceback(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path / "drive.mf4", CLASSIC)
    path.write_bytes(path.read_bytes()[:4000])
    with pytest.raises(
        InputError, match=r"drive\.mf4: MF4 expected by its name or first bytes, but it is not readable"
    ):
        read(path)
    assert "Traceback" not in capfd.readouterr().err


def test_mf4_without_its_library_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path / "drive.mf4", CLASSIC)
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(InputError, match=r"drive\.mf4: .*pip install dsz-daemon\[desk\]"):
        read(path)


def test_wanted_frames_of_other_formats(tmp_path: Path) -> None:
    path = written(tmp_path / "drive.blf", CLASSIC)
    report = LogReport()
    assert list(read_frames([path], report, wanted={0x7FF})) == [CLASSIC[-1]]
    assert report.frames == len(CLASSIC)


def test_pieces_of_different_formats_are_one_recording(tmp_path: Path) -> None:
    (tmp_path / "1.log").write_text("(1499999999.0) can0 123#00\n")
    got, report = read(tmp_path / "1.log", written(tmp_path / "2.blf", CLASSIC), written(tmp_path / "3.asc", CLASSIC))
    assert [frame.t_ns for frame in got[:2]] == [EPOCH_NS - 10**9, CLASSIC[0].t_ns]
    # The ASC piece counts from zero: back by the whole epoch, and said.
    assert (report.backward_steps, report.largest_backward_ns) == (1, CLASSIC[-1].t_ns)
    assert "3.asc starts" in report.warnings[0]


@pytest.mark.parametrize(
    ("channel", "first", "name"),
    [(0, 0, "can0"), (3, 0, "can3"), (1, 1, "can0"), (-1, 0, "can0"), (None, 0, "can0"), ("vcan1", 0, "vcan1")],
)
def test_numbered_channels_get_a_name(channel: int | str | None, first: int, name: str) -> None:
    assert frame_of_message(can.Message(channel=channel), first).channel == name


@pytest.mark.parametrize(
    ("timestamp", "t_ns"),
    [
        (1700000000.123457, 1_700_000_000_123_457_000),
        (0.0000004, 0),
        (0.0000006, 1_000),
    ],
)
def test_float_seconds_are_rounded_to_the_nearest_microsecond(timestamp: float, t_ns: int) -> None:
    assert frame_of_message(can.Message(timestamp=timestamp)).t_ns == t_ns


@pytest.mark.parametrize(
    "message_arguments",
    [
        {"timestamp": float("nan")},
        {"timestamp": 1e300},
        {"arbitration_id": 0x800, "is_extended_id": False},
        {"arbitration_id": 0x20000000},
        {"data": bytes(9)},
        {"data": bytes(65), "is_fd": True},
        {"data": b"\x01", "dlc": 8},
    ],
)
def test_what_no_bus_carries_is_refused(message_arguments: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"."):
        frame_of_message(can.Message(**message_arguments))
