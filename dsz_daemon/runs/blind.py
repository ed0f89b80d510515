"""A process that diagnoses recordings and knows nothing else: folders come in on standard input, answers go to files.

    python -m dsz_daemon.runs.blind

A line in: the folder of a recording (recording.log.gz, config.yaml, its DBCs), a tab, the folder for the answer. A line
out when it is done, a tab, and the seconds it took. What can't be diagnosed has an `error.json` with the message.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from dsz_daemon.edge.small_arrays import collect_seldom
from dsz_daemon.errors import DszError
from dsz_daemon.runs.diagnose import diagnose
from dsz_daemon.runs.results import output_folder


def answer(recording: Path, folder: Path) -> None:
    """diagnosis.json and fit.parquet of one recording in `folder`; or error.json."""
    try:
        diagnose([recording / "recording.log.gz"], recording / "config.yaml", folder, draws=False)
    except DszError as error:
        (output_folder(folder) / "error.json").write_text(json.dumps({"error": str(error)}))


def main() -> None:
    """Answers until nothing more is asked."""
    collect_seldom()
    for line in sys.stdin:
        recording, folder = (Path(part) for part in line.rstrip("\n").split("\t"))
        begun = time.monotonic()
        answer(recording, folder)
        print(f"{folder}\t{time.monotonic() - begun:.1f}", flush=True)


if __name__ == "__main__":
    main()
