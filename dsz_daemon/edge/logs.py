"""The recordings' door: files of any known format in, one stream of frames out."""

from __future__ import annotations

import stat
from collections.abc import Callable, Collection, Generator, Sequence
from pathlib import Path

from dsz_daemon.edge.candump import EXPECTED
from dsz_daemon.edge.candump_scan import candump_frames
from dsz_daemon.edge.log_report import LogReport, printable
from dsz_daemon.edge.log_writer import CandumpWriter
from dsz_daemon.edge.recording_file import (
    Format,
    RecordingFile,
    first_offending_line,
    open_recording,
    recording_format,
)
from dsz_daemon.edge.vendor_logs import vendor_frames
from dsz_daemon.errors import Fault, InputError
from dsz_daemon.pipeline.frames import Frame

__all__ = ["CandumpWriter", "LogReport", "read_frames"]

FORMATS = "candump text (.log, .log.gz, .log.zst) or .asc, .blf, .trc, .mf4"


def read_frames(
    paths: Sequence[Path],
    report: LogReport,
    progress: Callable[[int, int], None] | None = None,
    wanted: Collection[int] | None = None,
) -> Generator[Frame, None, None]:
    """Frames of one recording, `paths` being its pieces in the order given.

    What can't be read is counted in `report`, and time that goes backwards is passed on as it
    is. `progress` gets bytes read and bytes in all, of the files as they are on disk (both 0 for
    a pipe). With `wanted`, only frames with these ids are yielded; the report counts all of them.

    Raises InputError at once for files that are missing, empty, folders or not readable, and
    while reading for a file without a single frame.
    """
    paths = [Path(path) for path in paths]
    if not paths:
        raise InputError(f"no recording given; expected {FORMATS}")
    faults = [fault for path in paths if (fault := _fault(path)) is not None]
    if len(faults) == 1:
        raise InputError(str(faults[0]))
    if faults:
        raise InputError(f"{len(faults)} of {len(paths)} recordings can't be read", faults)
    return _frames(paths, report, progress, wanted)


def _fault(path: Path) -> Fault | None:
    """What can be said against a file before reading it."""
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            return Fault(str(path), f"is a folder; expected a file: {FORMATS}")
        if stat.S_ISREG(status.st_mode):  # opening a pipe would wait for its writer
            with path.open("rb"):
                pass
            if status.st_size == 0:
                return Fault(str(path), f"is empty; expected {FORMATS}")
    except FileNotFoundError:
        return Fault(str(path), "no such file")
    except (OSError, ValueError) as error:
        return Fault(str(path), f"can't be opened ({getattr(error, 'strerror', None) or error})")
    return None


def _frames(
    paths: Sequence[Path],
    report: LogReport,
    progress: Callable[[int, int], None] | None,
    wanted: Collection[int] | None,
) -> Generator[Frame, None, None]:
    sizes = [path.stat().st_size for path in paths]
    done_bytes = 0
    for path, size_bytes in zip(paths, sizes, strict=True):
        try:
            with open_recording(path) as file:

                def tick(file: RecordingFile = file, done_bytes: int = done_bytes) -> None:
                    if progress is not None:
                        progress(done_bytes + file.position_bytes(), sum(sizes))

                yield from _frames_of(file, report, tick, wanted)
        except OSError as error:
            raise InputError(f"{path}: can't be read ({error.strerror or error})") from None
        report.files += 1
        done_bytes += size_bytes
        if progress is not None:
            progress(done_bytes, sum(sizes))


def _frames_of(
    file: RecordingFile, report: LogReport, tick: Callable[[], None], wanted: Collection[int] | None
) -> Generator[Frame, None, None]:
    """Frames of one piece; InputError if it has none."""
    frames_before, cut_before = report.frames, report.cut_last_line
    said_before, shown_before = len(report.warnings), len(report.malformed_examples)
    kind = recording_format(file.path.name, file.head)
    if kind == "candump":
        blocks = file.blocks(tick)
        yield from candump_frames(blocks, file.path.name, report, wanted, lambda: bool(file.damage))
    else:
        for frame in vendor_frames(file, kind, report, tick):
            if wanted is None or frame.can_id in wanted:
                yield frame
    if file.damage:
        report.cut_last_line = cut_before + 1
        report.warnings.append(f"{file.path.name} is not whole: {file.damage}; read as far as that")
    if report.frames == frames_before:
        raise InputError(_no_frame(file, kind, report.warnings[said_before:], report.malformed_examples[shown_before:]))


def _no_frame(file: RecordingFile, kind: Format, said: list[str], malformed: list[Fault]) -> str:
    """Message for a file without a single frame: what is in it and what was expected."""
    found = [f"{file.path}: no CAN frame in it"]
    offending = first_offending_line(file.head)
    if kind != "candump" and malformed:
        found.append(str(malformed[0]))
    elif kind not in {"blf", "mf4"} and offending is not None:
        found.append(f"line {offending[0]} reads '{printable(offending[1])}'")
    if kind == "candump":
        expected = f"expected {EXPECTED}, or a .asc, .blf, .trc or .mf4 recording"
    else:
        expected = f"expected CAN frames of the {kind.upper()} format"
    return "; ".join([*found, *said, expected])
