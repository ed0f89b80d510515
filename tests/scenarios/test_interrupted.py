"""Runs that are ended from outside: Ctrl-C, and a pipe whose reader goes away."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from scenario_results import Called, read_results

Dsz = Callable[..., Called]
FOUR_FILES = ("samples.parquet", "compensated.log", "summary.json", "report.html")


def test_ctrl_c_in_the_middle_of_a_replay(
    dsz: Dsz, recorded: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dsz_daemon.runs import replay

    def interrupted_reader(*arguments: Any) -> Any:
        for number, frame in enumerate(read(*arguments)):
            if number == 3000:
                raise KeyboardInterrupt
            yield frame

    read = replay.read_frames
    monkeypatch.setattr(replay, "read_frames", interrupted_reader)
    called = dsz("replay", recorded[0], "-c", recorded[1], "-o", tmp_path)
    assert called.code == 130
    assert "warning: interrupted: only the part of the recording up to then was replayed" in called.out
    results = read_results(tmp_path)
    assert results.summary["source"]["interrupted"] is True
    # 320 wanted frames come in a second: 3000 in 9.4 s.
    assert len(results.samples["time_s"]) == results.summary["rows"] == pytest.approx(468, abs=3)
    lines = (tmp_path / "compensated.log").read_text().splitlines()
    assert all(re.fullmatch(r"\(\d{10}\.\d{6}\) can0 6D[0-9A-F]#[0-9A-F]{16}", line) for line in lines)
    assert len(lines) >= 2 * results.summary["rows"]
    assert (tmp_path / "report.html").read_text().rstrip().endswith("</html>")


def test_sigint_ends_a_replay_of_its_own_process(recorded: tuple[Path, Path], tmp_path: Path) -> None:
    """At real time the replay would take 26 s; it is interrupted as soon as it has begun to write."""
    command = [sys.executable, "-m", "dsz_daemon", "replay", str(recorded[0]), "-c", str(recorded[1])]
    process = subprocess.Popen(
        [*command, "-o", str(tmp_path), "--speed", "1"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    log = tmp_path / "compensated.log"
    end_s = time.monotonic() + 20.0
    while not (log.exists() and log.stat().st_size) and time.monotonic() < end_s:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20.0)
    assert process.returncode == 130, err
    assert err == ""
    assert "warning: interrupted" in out
    assert read_results(tmp_path).summary["source"]["interrupted"] is True
    assert all((tmp_path / name).stat().st_size > 0 for name in FOUR_FILES)


def piped(command: str) -> subprocess.CompletedProcess[str]:
    shell = f'set -o pipefail; dsz() {{ {sys.executable} -m dsz_daemon "$@"; }}; {command}'
    # Buffered, as users have it: only then a broken pipe may show as late as at the very end.
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    return subprocess.run(["bash", "-c", shell], capture_output=True, text=True, timeout=60, check=False, env=buffered)


@pytest.mark.skipif(not Path("/bin/bash").exists(), reason="needs bash for a pipe")
@pytest.mark.parametrize(("more", "code"), [("", 0), ("--json", 0), ("--sped 2>&1", 2), ("--help", 0)])
def test_a_reader_that_goes_away(
    recorded: tuple[Path, Path], start_of_drive: Path, tmp_path: Path, more: str, code: int
) -> None:
    # `true` is gone long before Python has started: what little --help prints would else fit into the pipe.
    done = piped(f"dsz replay {start_of_drive} -c {recorded[1]} -o {tmp_path} {more} | true")
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")
    assert code or more == "--help" or all((tmp_path / name).stat().st_size > 0 for name in FOUR_FILES)


def test_json_is_all_that_is_printed_and_progress_is_for_terminals(
    recorded: tuple[Path, Path], start_of_drive: Path, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "dsz_daemon", "replay", str(start_of_drive), "-c", str(recorded[1])]
    done = subprocess.run(
        [*command, "-o", str(tmp_path), "--json"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        env={**os.environ, "TERM": "xterm-256color"},
    )
    assert done.stderr == ""
    assert json.loads(done.stdout) == json.loads((tmp_path / "summary.json").read_text())
