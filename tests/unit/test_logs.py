"""The recordings' door: every format, several pieces, and what bad files get."""

from __future__ import annotations

import gzip
import os
import random
import sys
from collections.abc import Callable
from pathlib import Path

import can
import pytest
import zstandard

from dsz_daemon.edge import recording_file
from dsz_daemon.edge.logs import CandumpWriter, LogReport, read_frames
from dsz_daemon.errors import InputError, MachineError
from dsz_daemon.pipeline.frames import Frame

DATA = Path(__file__).parents[3] / "shared" / "data"
REAL_LOGS = sorted(DATA.glob("*/*.log")) or [DATA / "absent.log"]

TEXT = "".join(f"({100 + n}.{n:06d}) can{n % 2} {0x100 + n:03X}#{n:04X}\n" for n in range(200))
FRAMES = [Frame((100 + n) * 10**9 + n * 1000, f"can{n % 2}", 0x100 + n, n.to_bytes(2, "big")) for n in range(200)]


def read(*paths: Path, wanted: set[int] | None = None) -> tuple[list[Frame], LogReport]:
    report = LogReport()
    return list(read_frames(list(paths), report, wanted=wanted)), report


def zst(data: bytes) -> bytes:
    return zstandard.ZstdCompressor().compress(data)


@pytest.mark.parametrize(
    ("name", "pack"),
    [
        ("drive.log", bytes),
        ("DRIVE.LOG", bytes),
        ("drive.txt", bytes),
        ("drive.candump", bytes),
        ("drive", bytes),
        ("drive.asc", bytes),  # candump text under a wrong name
        ("drive.log.gz", gzip.compress),
        ("drive.LOG.GZ", gzip.compress),
        ("drive.log", gzip.compress),
        ("drive.log.zst", zst),
        ("drive.2026.log.zst", zst),
        ("drive.log.gz", bytes),
        ("drive.log.gz", lambda text: gzip.compress(text[:1000]) + gzip.compress(text[1000:]) + b"\0" * 40_000),
        ("drive.log.zst", lambda text: zst(text[:1000]) + zst(text[1000:])),
        ("drive.log", lambda text: b"\xef\xbb\xbf" + text),
        ("drive.log", lambda text: text.replace(b"\n", b"\r\n")),
        ("drive.log", lambda text: text.rstrip(b"\n")),
    ],
)
def test_candump_text_is_read_whatever_it_is_called_and_packed_in(
    tmp_path: Path, name: str, pack: Callable[[bytes], bytes]
) -> None:
    path = tmp_path / name
    path.write_bytes(pack(TEXT.encode("ascii")))
    frames, report = read(path)
    assert frames == FRAMES
    assert (report.files, report.lines, report.frames) == (1, 200, 200)
    assert (report.malformed_lines, report.cut_last_line, report.warnings) == (0, 0, [])
    assert report.channels == {"can0": 100, "can1": 100}
    assert (report.first_t_ns, report.last_t_ns) == (FRAMES[0].t_ns, FRAMES[-1].t_ns)


@pytest.mark.parametrize("block_bytes", [1, 7, 36, 37, 1000])
def test_lines_do_not_depend_on_how_a_file_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block_bytes: int
) -> None:
    path = tmp_path / "drive.log"
    path.write_text(TEXT)
    monkeypatch.setattr(recording_file, "_BLOCK_BYTES", block_bytes)
    frames, report = read(path)
    assert frames == FRAMES
    assert report.lines == 200


def test_pieces_are_one_recording(tmp_path: Path) -> None:
    lines = TEXT.splitlines(keepends=True)
    (tmp_path / "1.log").write_text("".join(lines[:120]))
    (tmp_path / "2.log.gz").write_bytes(gzip.compress("".join(lines[120:]).encode()))
    frames, report = read(tmp_path / "1.log", tmp_path / "2.log.gz")
    assert frames == FRAMES
    assert (report.files, report.lines, report.backward_steps, report.warnings) == (2, 200, 0, [])


def test_pieces_in_the_wrong_order_are_read_and_said(tmp_path: Path) -> None:
    lines = TEXT.splitlines(keepends=True)
    (tmp_path / "1.log").write_text("".join(lines[:120]))
    (tmp_path / "2.log").write_text("".join(lines[120:]))
    frames, report = read(tmp_path / "2.log", tmp_path / "1.log")
    assert frames == FRAMES[120:] + FRAMES[:120]
    assert report.backward_steps == 1
    assert report.largest_backward_ns == FRAMES[-1].t_ns - FRAMES[0].t_ns == 199_000_199_000
    assert report.first_t_ns == FRAMES[120].t_ns
    assert len(report.warnings) == 1
    assert "1.log starts 199.000199 s before" in report.warnings[0]


def test_progress_ends_at_the_whole_and_never_goes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording_file, "_BLOCK_BYTES", 500)
    monkeypatch.setattr(recording_file, "_HEAD_BYTES", 500)
    (tmp_path / "1.log").write_text(TEXT)
    (tmp_path / "2.log.gz").write_bytes(gzip.compress(TEXT.encode()))
    paths = [tmp_path / "1.log", tmp_path / "2.log.gz"]
    total = sum(path.stat().st_size for path in paths)
    seen: list[tuple[int, int]] = []
    for _ in read_frames(paths, LogReport(), lambda done, of: seen.append((done, of))):
        pass
    assert len(seen) > 10
    assert {of for _, of in seen} == {total}
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert seen[-1] == (total, total)
    assert 0 < seen[0][0] < 1500


def test_wanted_frames_only_and_the_same_report(tmp_path: Path) -> None:
    path = tmp_path / "drive.log"
    path.write_text(TEXT)
    frames, report = read(path, wanted={0x103, 0x777})
    assert frames == [FRAMES[3]]
    assert report == read(path)[1]


def test_missing_and_empty_files_and_folders_are_named_all_at_once(tmp_path: Path) -> None:
    (tmp_path / "empty.log").write_bytes(b"")
    (tmp_path / "folder.log").mkdir()
    (tmp_path / "good.log").write_text(TEXT)
    names = ["good.log", "missing.log", "empty.log", "folder.log", "nul\0.log"]
    with pytest.raises(InputError) as caught:
        read_frames([tmp_path / name for name in names], LogReport())
    message = str(caught.value)
    assert "4 of 5 recordings can't be read" in message
    assert "missing.log: no such file" in message
    assert "empty.log: is empty; expected candump text (.log" in message
    assert "folder.log: is a folder" in message
    assert "good.log" not in message
    with pytest.raises(InputError, match=r"missing\.log: no such file$"):
        read_frames([tmp_path / "missing.log"], LogReport())
    with pytest.raises(InputError, match="no recording given"):
        read_frames([], LogReport())


def test_a_file_without_permission_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "secret.log"
    path.write_text(TEXT)

    def refuse(self: Path, *args: object, **kwargs: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)  # root may read anything, so chmod shows nothing
    with pytest.raises(InputError, match=r"secret\.log: can't be opened \(Permission denied\)"):
        read_frames([path], LogReport())


@pytest.mark.parametrize(
    "name", ["junk.log", "junk.bin", "junk.asc", "junk.blf", "junk.trc", "junk.mf4", "junk.log.gz"]
)
def test_binary_junk_is_refused_with_its_name_and_what_was_expected(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(random.Random(4).randbytes(5000))
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "expected" in message
    assert message.isascii()
    assert message.isprintable()
    assert len(message) < 400


def test_a_text_without_a_frame_shows_its_first_offending_line(tmp_path: Path) -> None:
    path = tmp_path / "drive.log"
    path.write_text("# a note\n\ntime;id;data\t" + "x" * 500 + "\n")
    with pytest.raises(
        InputError, match=r"line 3 reads 'time;id;data\\tx+\.\.\.'; expected \(epoch\.seconds\) channel"
    ):
        read(path)
    path.write_text("# only a note\n")
    with pytest.raises(InputError, match="no CAN frame in it; expected"):
        read(path)


def test_a_later_piece_without_a_frame_is_refused_after_the_frames_before_it(tmp_path: Path) -> None:
    (tmp_path / "1.log").write_text(TEXT)
    (tmp_path / "2.log").write_text("nothing\n")
    got: list[Frame] = []
    with pytest.raises(InputError, match=r"2\.log: no CAN frame in it; line 1 reads 'nothing'"):
        got.extend(read_frames([tmp_path / "1.log", tmp_path / "2.log"], LogReport()))
    # list.extend keeps what came before the failure
    assert got == FRAMES


@pytest.mark.parametrize(("name", "pack"), [("d.log.gz", gzip.compress), ("d.log.zst", zst)])
def test_a_cut_compressed_file_is_read_as_far_as_it_goes(
    tmp_path: Path, name: str, pack: Callable[[bytes], bytes]
) -> None:
    # Several members, so that whole ones stand in front of the cut whatever the compressor does.
    lines = TEXT.encode().splitlines(keepends=True)
    packed = b"".join(pack(b"".join(lines[n : n + 20])) for n in range(0, 200, 20))
    for missing in (1, 9, 60):
        path = tmp_path / name
        path.write_bytes(packed[:-missing])
        frames, report = read(path)
        assert frames == FRAMES[: len(frames)]
        assert len(frames) >= 180
        assert (report.cut_last_line, report.malformed_lines) == (1, 0)
        assert "is not whole: its compressed data is cut off" in report.warnings[0]


def test_a_line_cut_by_a_cut_compressed_file_is_no_frame(tmp_path: Path) -> None:
    # Stored, not deflated: the last bytes of the file are the last bytes of the text.
    packed = gzip.compress(TEXT.encode(), compresslevel=0)
    path = tmp_path / "d.log.gz"
    path.write_bytes(packed[: -8 - 3])  # checksum and length gone, then "C7\n": "...#00" would read well
    frames, report = read(path)
    assert frames == FRAMES[:-1]
    assert (report.cut_last_line, report.malformed_lines) == (1, 0)


def test_damage_inside_a_gz_costs_only_what_is_behind_it(tmp_path: Path) -> None:
    path = tmp_path / "d.log.gz"
    packed = bytearray(gzip.compress(TEXT.encode()))
    packed[-8] ^= 0xFF  # the checksum alone
    path.write_bytes(packed)
    frames, report = read(path)
    assert frames == FRAMES
    assert report.cut_last_line == 1
    assert "its compressed data is damaged" in report.warnings[0]


def test_zeros_behind_a_recording_are_a_cut_line_and_take_no_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording_file, "_LINE_BYTES_MAX", 10_000)
    monkeypatch.setattr(recording_file, "_BLOCK_BYTES", 1_000)
    path = tmp_path / "drive.log"
    path.write_bytes(TEXT.encode() + b"\0" * 100_000)
    frames, report = read(path)
    assert frames == FRAMES
    assert (report.cut_last_line, report.malformed_lines) == (1, 0)
    with recording_file.open_recording(path) as file:
        assert max(len(line) for block in file.blocks(lambda: None) for line in block) <= 11_000


def test_zst_without_its_library_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "drive.log.zst"
    path.write_bytes(zst(TEXT.encode()))
    monkeypatch.setitem(sys.modules, "zstandard", None)
    with pytest.raises(InputError, match=r"drive\.log\.zst: .*pip install dsz-daemon\[desk\]"):
        read(path)


def test_a_pipe_is_read(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.write(writer, TEXT[:4000].encode())
    os.close(writer)
    try:
        frames, _ = read(Path(f"/dev/fd/{reader}"))
    finally:
        os.close(reader)
    assert frames[:100] == FRAMES[:100]


def test_what_the_writer_writes_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "out.log"
    with CandumpWriter(path) as writer:
        for frame in FRAMES:
            writer.write(frame)
    assert writer.frames == 200
    assert path.read_text() == "".join(line.replace("(", "(0000000") + "\n" for line in TEXT.splitlines())
    assert read(path)[0] == FRAMES


def test_what_was_written_is_readable_after_every_second_of_log_time(tmp_path: Path) -> None:
    path = tmp_path / "out.log"
    with CandumpWriter(path) as writer:
        for n in range(25):
            writer.write(Frame(5_000_000_000 + n * 100_000_000, "can0", n, b""))
            if n == 20:
                assert len(path.read_text().splitlines()) == 21
        writer.write(Frame(1_000_000_000, "can0", 1, b""))  # the clock was set back
        assert len(path.read_text().splitlines()) == 26


def test_ctrl_c_leaves_a_readable_file(tmp_path: Path) -> None:
    path = tmp_path / "out.log"

    def interrupted() -> None:
        with CandumpWriter(path) as writer:
            for frame in FRAMES[:50]:
                writer.write(frame)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert read(path)[0] == FRAMES[:50]


def test_an_unwritable_path_and_a_full_disk_are_the_machines_fault(tmp_path: Path) -> None:
    with (
        pytest.raises(MachineError, match=r"no/out\.log: can't be written \(No such file"),
        CandumpWriter(tmp_path / "no" / "out.log"),
    ):
        pass
    with pytest.raises(MachineError, match="Is a directory"), CandumpWriter(tmp_path):
        pass
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("/dev/full, a disk that is always full, is only on Linux")
    with pytest.raises(MachineError, match="No space left"), CandumpWriter(full) as writer:
        writer.write(Frame(0, "can0", 1, b""))
    with pytest.raises(MachineError, match="No space left"), CandumpWriter(full) as writer:
        writer.write(Frame(2_000_000_000, "can0", 1, b""))


@pytest.mark.real
@pytest.mark.parametrize("path", REAL_LOGS, ids=lambda path: path.name)
def test_real_logs_read_as_python_can_reads_them(path: Path) -> None:
    if not path.exists():
        pytest.skip("the real recordings are not beside the project (../shared/data)")
    frames, report = read(path)
    for ours, theirs in zip(frames, can.CanutilsLogReader(path), strict=True):
        assert abs(ours.t_ns / 1e9 - theirs.timestamp) <= 1e-6
        assert ours == Frame(
            ours.t_ns, str(theirs.channel), theirs.arbitration_id, bytes(theirs.data), theirs.is_extended_id
        )
        assert (theirs.is_fd, theirs.is_remote_frame, theirs.is_error_frame) == (False, False, False)
    assert report.frames == report.lines - report.cut_last_line
    assert report.malformed_lines == 0
