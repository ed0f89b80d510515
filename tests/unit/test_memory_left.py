"""How much memory is left is what the machine says, or the container; too long a recording is refused with both."""

from __future__ import annotations

from pathlib import Path

import pytest

from dsz_daemon.cli import main
from dsz_daemon.edge.memory import available_bytes
from dsz_daemon.runs import diagnose
from dsz_daemon.runs.simulate import simulate

MEMINFO = "MemTotal:  16000000 kB\nMemFree:  100 kB\nMemAvailable:    8000000 kB\nHugePages_Total:   0\n"


def test_what_the_machine_has_left_or_the_container_where_that_is_less(tmp_path: Path) -> None:
    meminfo, cgroup = tmp_path / "meminfo", tmp_path / "cgroup"
    assert available_bytes(meminfo, cgroup) is None
    meminfo.write_text(MEMINFO)
    assert available_bytes(meminfo, cgroup) == 8_000_000 * 1024
    cgroup.mkdir()
    (cgroup / "memory.max").write_text("max\n")
    (cgroup / "memory.current").write_text("1000000\n")
    assert available_bytes(meminfo, cgroup) == 8_000_000 * 1024
    (cgroup / "memory.max").write_text("3000000\n")
    assert available_bytes(meminfo, cgroup) == 2_000_000
    (cgroup / "memory.stat").write_text("anon 400000\nfile 600000\ninactive_file 500000\nactive_file 100000\n")
    assert available_bytes(meminfo, cgroup) == 2_500_000
    (cgroup / "memory.max").write_text("400000\n")
    assert available_bytes(meminfo, cgroup) == 0


def test_a_recording_that_is_too_long_for_it_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    simulate("sine_steer", tmp_path, 1)
    asked = ["diagnose", str(tmp_path / "recording.log"), "-c", str(tmp_path / "config.yaml"), "-o"]
    monkeypatch.setattr(diagnose, "available_bytes", lambda: 310_000_000)
    assert main([*asked, str(tmp_path / "out")]) == 4
    told = capsys.readouterr().err
    assert "GB of memory, 0.3 GB are left; expected 5 s at most" in told
    monkeypatch.setattr(diagnose, "available_bytes", lambda: None)
    assert main([*asked, str(tmp_path / "out")]) == 0
