"""A little of every fuzzer (in full: `python tests/fuzz/fuzz.py`), and the fuzzers themselves put to the test."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import fuzz
import fuzz_chunk
import pytest
from fuzz_chunk import ChunkResult, Session, Target, run_chunk

HERE = Path(__file__).parent


@pytest.mark.parametrize("name", fuzz.MODULES)
def test_fuzzed_a_little(name: str, tmp_path: Path) -> None:
    command = [sys.executable, str(HERE / "fuzz.py"), "--quick", "--jobs", "0", "--target", name]
    done = subprocess.run([*command, "--out", str(tmp_path)], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def _planted(what: str) -> Target:
    kept: list[bytes] = []

    def one(session: Session, data: bytes) -> None:
        if what == "crash" and data == b"7":
            raise IndexError("planted")
        if what == "hang" and data == b"7":
            while True:
                time.sleep(0.01)
        if what == "leak":
            kept.append(b"x" * 100_000)  # written, so resident

    def run(session: Session, count: int) -> None:
        for _ in range(count):
            data = str(session.inputs).encode()
            session.begin(data)
            one(session, data)

    return Target("planted", "inputs of a test", 400, 400, 400, run, one)


def test_a_planted_crash_is_found_saved_and_passed_over(tmp_path: Path) -> None:
    result = run_chunk(_planted("crash"), 1, 0, 20, tmp_path)
    (failure,) = result.failures
    assert failure.startswith("IndexError: planted")
    (saved,) = tmp_path.glob("*.input")
    assert saved.read_bytes() == b"7"
    assert f"--target planted --input {saved}" in failure
    assert result.inputs == 20, "the inputs behind it are run, too"


def test_a_planted_hang_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz_chunk, "HANG_S", 0.3)
    (failure,) = run_chunk(_planted("hang"), 1, 0, 20, tmp_path).failures
    assert failure.startswith("Hang: longer than")


def test_a_planted_leak_is_seen(tmp_path: Path) -> None:
    growth, slope = fuzz.growth_bytes([run_chunk(_planted("leak"), 1, 0, 400, tmp_path)])
    assert growth > fuzz.MOST_GROWTH_BYTES
    assert slope == pytest.approx(100_000, rel=0.2)
    growth, _ = fuzz.growth_bytes([run_chunk(_planted("nothing"), 1, 0, 400, tmp_path)])
    assert growth < 2**20


class _Keeping(Session):
    """Keeps what it is given."""

    def begin(self, current: bytes = b"", inputs: int = 1) -> None:
        self.kept = [*getattr(self, "kept", []), current]
        self.inputs += inputs


@pytest.mark.parametrize("name", ["lines", "configs", "dbcs", "states"])
def test_the_same_seed_gives_the_same_inputs(name: str, tmp_path: Path) -> None:
    target = fuzz.target_named(name)
    seen: list[list[bytes]] = []
    for _ in range(2):
        session = _Keeping(name, 5, 3, tmp_path)
        target.run(session, 60)
        seen.append(session.kept)
    assert seen[0] == seen[1]
    assert len(set(seen[0])) > (0 if name == "lines" else 40)


def test_all_chunks_together_are_the_amount() -> None:
    for name in fuzz.MODULES:
        target = fuzz.target_named(name)
        assert sum(size for _, size in fuzz.chunks(target, 1.0, quick=False)) == target.amount


def test_a_worker_that_grows_too_large_at_a_time_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    small = ChunkResult("planted", 1, 0, 10, peak_bytes=fuzz.MOST_PEAK_BYTES)
    large = ChunkResult("planted", 1, 1, 10, peak_bytes=fuzz.MOST_PEAK_BYTES + 2**20)
    assert fuzz._told(_planted("nothing"), [small], 1.0, quick=True)
    assert not fuzz._told(_planted("nothing"), [small, large], 1.0, quick=True)
    assert "513 MiB of memory at a time" in capsys.readouterr().out
