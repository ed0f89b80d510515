"""A simulated drive on disk: recording, configuration, DBC files and truth in one folder."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import yaml
from numpy.typing import NDArray

from dsz_daemon.edge.log_writer import CandumpWriter
from dsz_daemon.errors import MachineError
from dsz_daemon.pipeline.frames import Frame

RECORDING = "recording.log"
CONFIG = "config.yaml"
TRUTH = "truth.parquet"

_HEADER = """\
# Simulated drive "{name}", seed {seed}: how to read recording.log. What truly happened is in
# truth.parquet. Nominal values only: neither the sensors' drawn errors nor the IMU's place.
#   dsz replay recording.log -c config.yaml -o replayed
"""


class Drive(Protocol):
    """What is written; `dsz_daemon.sim.scenario.SimulatedDrive` is one.

    This floor and the simulation's stand side by side: neither imports the other.
    """

    @property
    def name(self) -> str:
        """The scenario's name."""

    @property
    def seed(self) -> int:
        """What the sensors' errors were drawn by."""

    @property
    def frames(self) -> Sequence[Frame]:
        """All frames in time order."""

    @property
    def truth(self) -> Mapping[str, NDArray[np.float64]]:
        """Columns of equal length."""

    @property
    def config(self) -> Mapping[str, Any]:
        """The configuration as plain data."""

    @property
    def dbc_files(self) -> Mapping[str, str]:
        """DBC text by file name."""


def write_scenario(drive: Drive, folder: Path) -> None:
    """Write a drive into `folder`, made where it is missing; files of these names are replaced.

    The same drive gives the same bytes. MachineError: a path that can't be written, or pyarrow
    missing (said before anything is written).
    """
    write_truth = _truth_writer()
    with _refusing(folder, "make the folder"):
        folder.mkdir(parents=True, exist_ok=True)
    for name, text in drive.dbc_files.items():
        _write_text(folder / name, text)
    header = _HEADER.format(name=drive.name, seed=drive.seed)
    body = yaml.safe_dump(dict(drive.config), sort_keys=False, width=1000)
    _write_text(folder / CONFIG, header + body)
    with CandumpWriter(folder / RECORDING) as recording:
        for frame in drive.frames:
            recording.write(frame)
    write_truth(drive.truth, folder / TRUTH)


def _write_text(path: Path, text: str) -> None:
    with _refusing(path, "write the file"):
        path.write_text(text, encoding="utf-8", newline="\n")


def _truth_writer() -> Callable[[Mapping[str, NDArray[np.float64]], Path], None]:
    try:
        pyarrow = importlib.import_module("pyarrow")
        parquet = importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise MachineError(f"{TRUTH} needs pyarrow, which is not installed: pip install dsz-daemon[desk]") from None

    def write(truth: Mapping[str, NDArray[np.float64]], path: Path) -> None:
        with _refusing(path, "write the file"):
            parquet.write_table(pyarrow.table(dict(truth)), path)

    return write


@contextmanager
def _refusing(path: Path, what: str) -> Iterator[None]:
    """Turn the system's refusal into one message that names the path."""
    try:
        yield
    except OSError as error:
        raise MachineError(f"{path}: can't {what}: {error.strerror or error}") from None
