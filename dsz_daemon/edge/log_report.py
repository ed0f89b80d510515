"""What reading a recording has seen: counts, never an opinion."""

from __future__ import annotations

from dataclasses import dataclass, field

from dsz_daemon.errors import Fault
from dsz_daemon.pipeline.frames import Frame

# Enough to see what is wrong with a recording, few enough to print.
EXAMPLES_KEPT = 5
EXAMPLE_WIDTH = 72
# Later than any stamp (they have 63 bits), so that comparing times finds the first frame too.
NO_FRAME_YET_NS = 2**63


def printable(text: str) -> str:
    r"""Text of a file as one short line of plain ASCII.

    >>> printable("ab\x00c\n")
    'ab\\x00c'
    """
    # Cut first, so that a line of megabytes is not escaped in vain, and again, for it grows.
    shown = text[: EXAMPLE_WIDTH + 2].rstrip("\r\n").encode("unicode_escape").decode("ascii")
    return shown if len(shown) <= EXAMPLE_WIDTH else shown[:EXAMPLE_WIDTH] + "..."


@dataclass
class LogReport:
    """Counts over all pieces of one recording.

    `lines` counts lines of text formats. `channels` has the frames per bus name and `frames`
    is their sum: all frames of the recording, also those that the caller did not want.
    `cut_last_line` counts pieces that end in the middle of something. Times are those of the
    first and the last frame in the order of the files, nanoseconds. A backward step is a frame
    stamped earlier than the one before it. `dropped_by_recorder` sums candump's own DROPCOUNT
    notes. Counts are exact once the reading iterator is exhausted or closed.
    """

    files: int = 0
    lines: int = 0
    malformed_lines: int = 0
    malformed_examples: list[Fault] = field(default_factory=list)
    cut_last_line: int = 0
    error_frames: int = 0
    remote_frames: int = 0
    fd_frames: int = 0
    dropped_by_recorder: int = 0
    backward_steps: int = 0
    largest_backward_ns: int = 0
    channels: dict[str, int] = field(default_factory=dict)
    first_t_ns: int | None = None
    last_t_ns: int | None = None
    warnings: list[str] = field(default_factory=list)

    @property
    def frames(self) -> int:
        """All frames read, error and remote frames included."""
        return sum(self.channels.values())

    def words(self) -> list[str]:
        """What a reader of the recording should know, a line each."""
        words = list(self.warnings)
        if self.malformed_lines:
            examples = "; ".join(str(example) for example in self.malformed_examples[:2])
            words.append(f"{self.malformed_lines} lines of the recording are no frames: {examples}")
        if self.cut_last_line:
            words.append(f"{self.cut_last_line} piece(s) of the recording end in the middle of a line")
        if self.backward_steps:
            words.append(
                f"stamps go backwards {self.backward_steps} times, by up to {self.largest_backward_ns * 1e-9:.6f} s"
            )
        if self.dropped_by_recorder:
            words.append(f"the recorder itself dropped {self.dropped_by_recorder} frames")
        return words

    def add_kind(self, frame: Frame) -> None:
        """Count what a frame is and where it came from, not when."""
        self.channels[frame.channel] = self.channels.get(frame.channel, 0) + 1
        self.error_frames += frame.is_error
        self.remote_frames += frame.is_remote
        self.fd_frames += frame.is_fd

    def add_malformed(self, name: str, place: str, text: str, why: str) -> None:
        """Count something that is no frame; the first few are kept with file, place and text."""
        self.malformed_lines += 1
        if len(self.malformed_examples) < EXAMPLES_KEPT:
            self.malformed_examples.append(Fault(f"{name}:{place}", f"'{printable(text)}' ({why})"))

    def add_earlier(self, name: str, t_ns: int, previous_ns: int) -> None:
        """Note a frame at `t_ns` < `previous_ns`: a step backwards, or the first of its piece.

        It is the first where `previous_ns` is NO_FRAME_YET_NS; `last_t_ns` is then still that of
        the piece in front.
        """
        if previous_ns == NO_FRAME_YET_NS:
            if self.first_t_ns is None or self.last_t_ns is None:
                self.first_t_ns = t_ns
                return
            if t_ns >= self.last_t_ns:
                return
            previous_ns = self.last_t_ns
            self.warnings.append(
                f"{name} starts {(previous_ns - t_ns) / 1e9:.6f} s before the piece in front of it ends; "
                "expected the pieces in the order of time"
            )
        self.backward_steps += 1
        self.largest_backward_ns = max(self.largest_backward_ns, previous_ns - t_ns)

    def summary(self) -> dict[str, object]:
        """All counts as plain values, ready for JSON."""
        return {
            "files": self.files,
            "lines": self.lines,
            "frames": self.frames,
            "channels": dict(self.channels),
            "first_t_ns": self.first_t_ns,
            "last_t_ns": self.last_t_ns,
            "malformed_lines": self.malformed_lines,
            "malformed_examples": [str(example) for example in self.malformed_examples],
            "cut_last_line": self.cut_last_line,
            "error_frames": self.error_frames,
            "remote_frames": self.remote_frames,
            "fd_frames": self.fd_frames,
            "dropped_by_recorder": self.dropped_by_recorder,
            "backward_steps": self.backward_steps,
            "largest_backward_ns": self.largest_backward_ns,
            "warnings": list(self.warnings),
        }
