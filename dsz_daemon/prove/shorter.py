"""The beginning of a recording alone: how right an answer is against how long was driven."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Iterable
from pathlib import Path

from dsz_daemon.prove.mix import PLAIN, Trial
from dsz_daemon.prove.recordings import PACKED

# The whole recording is judged anyway.
LENGTHS_S = (30.0, 60.0, 100.0)
# Of plain singles, the first so many.
_MOST = 60


def chosen(drawn: Iterable[Trial]) -> list[Trial]:
    """Trials of which beginnings are judged, too: plain singles."""
    return [trial for trial in drawn if trial.group == "single" and trial.size == PLAIN][:_MOST]


def name_of(trial: Trial, length_s: float) -> str:
    """The folder of a trial's beginning."""
    return f"{trial.number:05d}-{length_s:03.0f}"


def begin(recording: Path, length_s: float, folder: Path) -> None:
    """Writes the first `length_s` of a recording, with its configuration, into `folder`; nothing where it is there."""
    if (folder / PACKED).exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    for path in recording.iterdir():
        if path.name != PACKED:
            shutil.copy(path, folder / path.name)
    part = folder / f"{PACKED}.part"
    with gzip.open(recording / PACKED, "rt", encoding="utf-8") as whole, gzip.open(part, "wt", encoding="utf-8") as cut:
        last_s = None
        for line in whole:
            at_s = float(line[1 : line.index(")")])
            last_s = at_s + length_s if last_s is None else last_s
            if at_s > last_s:
                break
            cut.write(line)
    # Whole or not at all.
    part.rename(folder / PACKED)
