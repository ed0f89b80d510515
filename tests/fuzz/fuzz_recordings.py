"""Recordings in other formats: mutated ASC, TRC, BLF, MF4 and compressed files through `read_frames`.

python-can's readers do the reading; what they run into becomes counts, or InputError. Fewer than the
others: reading one takes milliseconds, and the formats are not ours.
"""

from __future__ import annotations

import gzip
import random
import tempfile
from functools import cache
from pathlib import Path

import can
import zstandard
from fuzz_chunk import Session, Target, Unexpected
from fuzz_configs import look_at
from fuzz_mutate import mutated

from dsz_daemon.edge.candump import T_NS_LIMIT
from dsz_daemon.edge.logs import LogReport, read_frames
from dsz_daemon.errors import InputError

_TOKENS = [
    b"Rx", b"Tx", b"d 8 ", b"CANFD ", b"ErrorFrame", b"base dec", b"base hex", b"Begin Triggerblock", b"date ",
    b"date Xxx", b";$FILEVERSION=2.1",
    b";$COLUMNS=N,O,T,I,d,R,L,D", b"LOBJ", b"LOGG", b"\0\0\0\0", b"\xff\xff\xff\xff", b"MDF     4.10", b"##DG", b"x",
    b"18FEF100x", b"-1.0", b"1e99",
]  # fmt: skip


@cache
def _corpus() -> tuple[tuple[str, bytes], ...]:
    """(file name, bytes), written by python-can, and the same text compressed."""
    rng = random.Random(1)
    messages = [
        can.Message(
            timestamp=1.7e9 + 0.01 * k, arbitration_id=rng.randrange(0x800 if k % 3 else 0x20000000),
            is_extended_id=not k % 3,
            data=rng.randbytes(8 if k % 5 else 64), is_fd=not k % 5, channel=k % 2,
        )
        for k in range(40)
    ]  # fmt: skip
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for suffix, usable in ((".asc", messages), (".trc", [m for m in messages if not m.is_fd]), (".blf", messages)):
            path = Path(folder) / f"drive{suffix}"
            with can.Logger(str(path)) as logger:
                for message in usable:
                    logger.on_message_received(message)
            found.append((path.name, path.read_bytes()))
    text = b"".join(
        b"(%d.%06d) can0 123#%s\n" % (1_700_000_000 + k, k, rng.randbytes(8).hex().encode()) for k in range(300)
    )
    found.append(("drive.log.gz", gzip.compress(text)))
    found.append(("drive.log.zst", zstandard.compress(text)))
    # A few kB that unfold to a hundred thousand kB without a line end.
    found.append(("drive.log.gz", gzip.compress(b"\0" * 10**7) * 5))
    found.append(("drive.log.zst", zstandard.compress(b"A" * 10**8) * 3))
    return tuple(found)


def run(session: Session, count: int) -> None:
    """Each file as it is, then mutated ones; `one` takes the name as the first line."""
    rng, corpus = session.random, _corpus()
    for i in range(count):
        # Bombs, at the end of the corpus, take a second each.
        name, data = corpus[i] if i < len(corpus) else rng.choice(corpus if rng.random() < 0.02 else corpus[:5])
        if i >= len(corpus):
            data = mutated(data, rng, _TOKENS)
        whole = name.encode() + b"\n" + data
        session.begin(whole)
        one(session, whole)


def one(session: Session, data: bytes) -> None:
    """Reads it; what comes out must be frames that a bus can carry."""
    name, _, content = data.partition(b"\n")
    path = session.folder / name.decode()
    path.write_bytes(content)
    report = LogReport()
    try:
        for frame in read_frames([path], report):
            session.outcomes["frames"] += 1
            limit = 0x1FFFFFFF if frame.is_extended or frame.is_error else 0x7FF
            if not (0 <= frame.can_id <= limit and len(frame.data) <= 64 and abs(frame.t_ns) <= T_NS_LIMIT):
                raise Unexpected(f"read {frame}")
    except InputError as error:
        session.outcomes["InputError"] += 1
        look_at(error)
    session.outcomes["damage said"] += bool(report.warnings)
    session.outcomes["malformed"] += report.malformed_lines


TARGET = Target("recordings", "mutated ASC, TRC, BLF, gz and zst recordings", 2_000, 250, 60, run, one)
