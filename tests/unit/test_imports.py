"""edge/imports: what a command that reads logs need not import."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("asammdf", reason="only the desk has it")

TOLD = """
import sys
from pathlib import Path
from dsz_daemon.edge.imports import for_logs
with for_logs([Path(log) for log in sys.argv[1:]]):
    import can
print("asammdf" in sys.modules, "pandas" in sys.modules)
import asammdf
"""
CANDUMP = "(1700000000.000000) can0 123#00\n"


def has(*logs: Path) -> list[str]:
    """Whether asammdf and pandas are there after the imports, in a process of its own."""
    told = [sys.executable, "-c", TOLD, *map(str, logs)]
    return subprocess.run(told, capture_output=True, text=True, check=True).stdout.split()


def test_a_candump_log_needs_no_library_for_mf4(tmp_path: Path) -> None:
    (tmp_path / "drive.log").write_text(CANDUMP)
    assert has(tmp_path / "drive.log") == ["False", "False"]


def test_a_missing_log_is_somebody_elses_fault(tmp_path: Path) -> None:
    assert has(tmp_path / "nowhere.log") == ["False", "False"]


def test_a_broken_archive_is_too(tmp_path: Path) -> None:
    (tmp_path / "broken.log.gz").write_bytes(b"\x1f\x8b\x08rubbish")
    assert has(tmp_path / "broken.log.gz") == ["False", "False"]


@pytest.mark.parametrize("name", ["drive.mf4", "drive.log"])
def test_an_mf4_file_needs_it_whatever_it_is_called(tmp_path: Path, name: str) -> None:
    (tmp_path / "first.log").write_text(CANDUMP)
    (tmp_path / name).write_bytes(b"MDF     4.10    ")
    assert has(tmp_path / "first.log", tmp_path / name) == ["True", "True"]


def test_what_can_be_read_once_only_is_not_looked_at(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert has(tmp_path / "pipe") == ["True", "True"]


def test_columns_are_written_without_pandas(tmp_path: Path) -> None:
    """pyarrow would import it to ask whether an array is one of its."""
    told = """
import sys
from pathlib import Path
import numpy as np
from dsz_daemon.edge.samples_file import read_samples, write_columns
path = Path(sys.argv[1])
columns = {"time_s": np.array([0.0, 1.0, 2.0]), "odd": np.arange(6.0)[::2], "none": np.array([np.nan, 1.0, np.inf])}
write_columns(columns, path)
print("pandas" in sys.modules)
there = read_samples(path)
assert list(there) == list(columns)
assert all(np.array_equal(there[name], values, equal_nan=True) for name, values in columns.items())
"""
    told_by = [sys.executable, "-c", told, str(tmp_path / "columns.parquet")]
    assert subprocess.run(told_by, capture_output=True, text=True, check=True).stdout.split() == ["False"]
