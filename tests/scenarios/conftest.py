"""The short drive on disk and replayed once, and the command line called in this process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import short_drive
from scenario_results import Called, Replayed, read_results
from short_drive import Sent

from dsz_daemon.cli import main


@pytest.fixture
def dsz(capsys: pytest.CaptureFixture[str]) -> Callable[..., Called]:
    """Calls `dsz` with these arguments; whatever happens, there must be no traceback."""

    def call(*arguments: object) -> Called:
        capsys.readouterr()
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as done:  # argparse ends so after --help and --version
            code = int(done.code or 0)
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return Called(code, out, err)

    return call


@pytest.fixture
def without_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes longer than the replay of this drive; where it is not the point it is left out."""
    monkeypatch.setattr("dsz_daemon.runs.results.write_report", lambda *_: None)


@pytest.fixture(scope="session")
def drive() -> Sequence[Sent]:
    return short_drive.frames()


@pytest.fixture(scope="session")
def recorded(drive: Sequence[Sent], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Recording and configuration of the short drive: to be read, not to be changed."""
    return short_drive.write(tmp_path_factory.mktemp("short_drive"), drive)


@pytest.fixture(scope="session")
def start_of_drive(drive: Sequence[Sent], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 6 s of it."""
    path = tmp_path_factory.mktemp("start") / "start.log"
    path.write_text(short_drive.candump([frame for frame in drive if frame.t_s < 6.0]))
    return path


@pytest.fixture(scope="session")
def clean(recorded: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    """The drive replayed with nothing wrong."""
    folder = tmp_path_factory.mktemp("clean")
    assert main(["replay", str(recorded[0]), "-c", str(recorded[1]), "-o", str(folder)]) == 0
    return read_results(folder)
