"""The four files of a run: `samples.parquet`, `compensated.log`, `summary.json`, `report.html`.

Rows are written as they come; the summary and the report at the end, whatever ended the run.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

from dsz_daemon.edge.log_writer import CandumpWriter
from dsz_daemon.edge.samples_file import SamplesWriter, read_samples
from dsz_daemon.errors import MachineError
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.rows import Row
from dsz_daemon.report.page import write_report
from dsz_daemon.runs.setup import Setup
from dsz_daemon.runs.summary import write_json
from dsz_daemon.runs.truth import errors_against_truth
from dsz_daemon.signals import IMU_CHANNELS

RESULT_NAMES = ("samples.parquet", "compensated.log", "summary.json", "report.html")


def output_folder(path: Path) -> Path:
    """Makes the folder; a clear error before any work where it can't be written."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / ".dsz-probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise MachineError(f"{path}: can't write results here: {error.strerror or error}") from error
    return path


class ResultFiles:
    """Writes rows and published frames into a folder; a context manager."""

    def __init__(self, folder: Path, setup: Setup) -> None:
        self.folder = output_folder(folder)
        for name in ("summary.json", "report.html"):
            # Written last: until then an older run's must not stand beside this one's rows.
            try:
                (folder / name).unlink(missing_ok=True)
            except OSError as error:
                raise MachineError(f"{folder / name}: can't be replaced: {error.strerror or error}") from error
        tuning = setup.settings.estimator.tuning()
        self._goals = {name: getattr(tuning, name).goal_std for name in IMU_CHANNELS}
        self._samples = SamplesWriter(folder / "samples.parquet", setup.channels, sorted(setup.roles))
        self._log = CandumpWriter(folder / "compensated.log")
        self._stack = ExitStack()

    def __enter__(self) -> ResultFiles:
        with ExitStack() as opening:
            opening.enter_context(self._samples)
            opening.enter_context(self._log)
            self._stack = opening.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def write(self, row: Row, frames: list[Frame]) -> None:
        """One row and what was published of it."""
        self._samples.write(row)
        for frame in frames:
            self._log.write(frame)

    def conclude(self, summary: dict[str, Any], title: str, truth: dict[str, Any] | None = None) -> None:
        """Writes summary and report, after the `with` block has closed the rows' files."""
        samples = read_samples(self.folder / "samples.parquet")
        if truth is not None:
            summary["truth"] = errors_against_truth(samples, truth, self._goals)
        write_json(summary, self.folder / "summary.json")
        write_report(samples, summary, self.folder / "report.html", truth, title)
