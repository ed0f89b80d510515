"""What `dsz run` sent on a kernel's bus against a replay of what came in, frame by frame, value by value."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import cantools
import e2e.p02

from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.logs import read_frames
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.runs.replay import replay
from dsz_daemon.shipped import shipped

Messages = dict[int, Any]


def output_messages() -> Messages:
    """cantools' description of our output, by id."""
    database = cantools.database.load_file(shipped("dbc/dsz.dbc"))
    return {message.frame_id: message for message in database.messages}


def is_ours(frame: Frame, messages: Messages) -> bool:
    """By its CRC, judged by another implementation: real cars have messages of their own with these ids."""
    if frame.can_id not in messages or len(frame.data) != 8:
        return False
    data_id = 0x40 + frame.can_id - min(messages)
    return bool(e2e.p02.e2e_p02_check(frame.data, bytes([data_id] * 16)))


def _positions(frames: list[Frame]) -> Iterator[int]:
    """Which of its id's frames each one is: the alive counter also counts those of missed ticks, which are not sent."""
    position, last = 0, None
    for frame in frames:
        counter = frame.data[1] & 0x0F
        position += 0 if last is None else (counter - last) % 16
        yield position
        last = counter


class Compared:
    """The record of `candump` in OUT, and a replay of the frames in it that are not ours.

    `frames`: how many of ours were compared; `different`: how many differ by more than one LSB somewhere; `not_sent`:
    how many the alive counters leapt over; `missing`: how many of the replay's last ones never came.
    `silences`: (begin, end) in ns where a frame that is due at every tick was not sent.
    """

    def __init__(self, out: Path, config: Path, messages: Messages) -> None:
        bus = list(read_frames([out / "bus.log"], LogReport()))
        ours = [frame for frame in bus if is_ours(frame, messages)]
        mine = {id(frame) for frame in ours}
        (out / "input.log").write_text(
            "".join(
                f"({frame.t_ns // 10**9}.{frame.t_ns % 10**9 // 1000:06d}) can0 {frame.can_id:03X}#{frame.data.hex()}\n"
                for frame in bus
                if id(frame) not in mine
            )
        )
        replay([out / "input.log"], config, out / "replayed")
        again = list(read_frames([out / "replayed" / "compensated.log"], LogReport()))
        self.frames = self.different = self.not_sent = self.missing = 0
        for can_id, message in messages.items():
            live = [frame for frame in ours if frame.can_id == can_id]
            wanted = [frame.data for frame in again if frame.can_id == can_id]
            positions = list(_positions(live))
            # The run goes on for some ticks after the last frame.
            self.missing += max(0, len(wanted) - positions[-1] - 1)
            self.not_sent += positions[-1] + 1 - len(positions)
            for frame, position in zip(live, positions, strict=True):
                if position < len(wanted):
                    self.frames += 1
                    self.different += differs(message, frame.data, wanted[position])
        first = [frame for frame in ours if frame.can_id == min(messages)]
        self.silences = [
            (one.t_ns, other.t_ns)
            for (one, here), (other, there) in pairwise(zip(first, _positions(first), strict=True))
            if there - here != 1
        ]


def differs(message: Any, data: bytes, other: bytes) -> bool:
    """Whether two payloads differ by more than one LSB in any signal.

    Left out are the counter, the CRC (it follows from the rest) and the number of missed ticks: a replay misses none.
    """
    values, expected = (message.decode(payload, decode_choices=False) for payload in (data, other))
    return any(
        abs(values[signal.name] - expected[signal.name]) > signal.scale * 1.001
        for signal in message.signals
        if signal.name not in ("E2E_CRC", "E2E_COUNTER", "MISSED_TICKS")
    )
