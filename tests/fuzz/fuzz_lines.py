"""Log lines: mutated candump text through the quick reader and the defining one, which must agree.

Nothing may be lost in silence: every line is a frame, blank or a comment, or counted as malformed or cut;
and every line that was left whole gives its frame, whatever stands round it.
"""

from __future__ import annotations

import gzip
import random
import re
from pathlib import Path

from fuzz_chunk import Session, Target, Unexpected
from fuzz_mutate import mutated

from dsz_daemon.edge.candump import MalformedLine, parse_line
from dsz_daemon.edge.logs import LogReport, read_frames
from dsz_daemon.errors import InputError
from dsz_daemon.pipeline.frames import Frame

HERE = Path(__file__).parent
_CORPUS = (HERE.parent / "golden" / "sine_steer.log.gz", HERE / "corpus" / "lines" / "forms.log")
_TOKENS = [
    b"#", b"##", b"##1", b"R", b" R", b" T", b" Rx B E", b"(", b")", b".", b" ", b"  ", b"_9", b"_F", b"00", b"0",
    b"7FF", b"800",
    b"1FFFFFFF", b"20000004", b"80000123", b"FFFFFFFF", b"can0", b"1", b"99999999999999999999",
    b"(9223372036.854775807)",
    b"(9223372036.854775808)", b"(0.0)", b"(-1.5)", b"DROPCOUNT: dropped 5 CAN frames", b";", b"//", b"'....'",
    b"\xa0", b"\x85", b"\x1c",
]  # fmt: skip
_LINES_A_FILE = 2_000
_ENDS = re.compile(rb"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+$")


def _corpus() -> list[bytes]:
    with gzip.open(_CORPUS[0]) as file:
        usual = file.read().splitlines()[:6_000]
    return usual + _CORPUS[1].read_bytes().splitlines() * 60


def run(session: Session, count: int) -> None:
    """Files of some thousand lines, a good part of them mutated."""
    rng, corpus = session.random, _corpus()
    while count > 0:
        lines = min(count, _LINES_A_FILE)
        data = _file(corpus, lines, rng)
        session.begin(data, lines)
        one(session, data)
        count -= lines


def _file(corpus: list[bytes], count: int, rng: random.Random) -> bytes:
    share, start = rng.choice((0.02, 0.5, 1.0)), rng.randrange(len(corpus))
    lines = []
    for i in range(count):
        line = corpus[(start + i) % len(corpus)]
        lines.append(mutated(line, rng, _TOKENS)[:5_000] if rng.random() < share else line)
    end = rng.choice((b"\n", b"\n", b"\n", b"\r\n", b"\r"))
    data = end.join(lines) + rng.choice((b"", end))
    return data[: rng.randrange(len(data))] if rng.random() < 0.05 else data


def one(session: Session, data: bytes) -> None:
    """Reads the file both ways and compares frames and counts."""
    path = session.folder / "drive.log"
    path.write_bytes(data)
    body = data.removeprefix(b"\xef\xbb\xbf")
    expected, malformed, cut = _by_definition(_ENDS.findall(body))
    report = LogReport()
    try:
        frames = list(read_frames([path], report))
    except InputError:
        session.outcomes["InputError"] += 1
        # Refused as a whole: only where there is nothing to be had, or where it is another format by its first bytes.
        if expected and _is_candump(body):
            raise Unexpected(f"{len(expected)} good lines refused") from None
        return
    if not _is_candump(body):
        session.outcomes["another format"] += 1
        return
    session.outcomes["frames"] += len(frames)
    session.outcomes["malformed"] += report.malformed_lines
    if frames != expected:
        at = next((i for i, pair in enumerate(zip(frames, expected, strict=False)) if pair[0] != pair[1]), -1)
        raise Unexpected(f"{len(frames)} frames read, {len(expected)} by definition; first difference at {at}")
    if (report.malformed_lines, report.cut_last_line) != (malformed, cut):
        found = (report.malformed_lines, report.cut_last_line)
        raise Unexpected(f"(malformed, cut) {found}, by definition {(malformed, cut)}")
    if report.lines != len(_ENDS.findall(body)):
        raise Unexpected(f"{report.lines} lines counted of {len(_ENDS.findall(body))}")


def _is_candump(body: bytes) -> bool:
    """Whether the first bytes are no other format's; those have a fuzzer of their own."""
    head = body.lstrip().lower()
    return not head.startswith(
        (b"logg", b"mdf ", b"unfinmf", b";$fileversion", b";#####", b"date ", b"base ", b"\x1f\x8b", b"\x28\xb5")
    )


def _by_definition(lines: list[bytes]) -> tuple[list[Frame], int, int]:
    """Frames, malformed lines and cut last lines, by `parse_line` alone."""
    frames: list[Frame] = []
    malformed = cut = 0
    for number, line in enumerate(lines, 1):
        try:
            frame = parse_line(line.decode("latin-1"))
        except MalformedLine as error:
            is_last = number == len(lines)
            has_end = line.endswith((b"\n", b"\r"))
            if is_last and (not has_end or error.odd_digits):
                cut += 1
            else:
                malformed += 1
            continue
        if frame is not None:
            frames.append(frame)
    return frames, malformed, cut


TARGET = Target(
    "lines", "mutated candump lines, quick reader against the defining one", 1_000_000, 100_000, 20_000, run, one
)
