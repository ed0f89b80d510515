"""The keeper never waits, and its process loses nothing: hanging and full disks, kills, a second daemon."""

from __future__ import annotations

import contextlib
import fcntl
import os
import random
import resource
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from state_cases import body, fill, mounted

from dsz_daemon.edge.state_file import decoded, encoded, load, lock_path, previous_path
from dsz_daemon.edge.state_keeper import StateKeeper
from dsz_daemon.edge.state_writer import DEAF_TO, HEADER

# Only whoever hangs takes longer.
HANG_S = 30.0


class Clock:
    """A steady clock that can be put forward."""

    def __init__(self) -> None:
        self.ahead_s = 0.0

    def __call__(self) -> float:
        return time.monotonic() + self.ahead_s


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "offsets.json"


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def keep(path: Path, clock: Clock) -> Iterator[Callable[[], StateKeeper]]:
    """Starts keepers of `path` and leaves none of their processes behind."""
    kept: list[StateKeeper] = []

    def start() -> StateKeeper:
        kept.append(StateKeeper(path, clock))
        return kept[-1]

    yield start
    for keeper in kept:
        if keeper.pid is not None:
            signalled(keeper.pid, signal.SIGCONT)
        keeper.close(HANG_S)


def signalled(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


def until(is_so: Callable[[], bool]) -> None:
    end_s = time.monotonic() + HANG_S
    while not is_so():
        assert time.monotonic() < end_s, "waited too long"
        time.sleep(0.005)


def answered(keeper: StateKeeper) -> str:
    """The next outcome."""
    told: list[str] = []

    def is_told() -> bool:
        told.extend(keeper.outcomes())
        return bool(told)

    until(is_told)
    return told[-1]


def state_of(pid: int) -> str:
    """The kernel's letter for what a process does: T stopped, Z ended; "" where it is gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return ""


def paused(keeper: StateKeeper) -> int:
    """A disk that hangs looks like this from outside: the process does not come back."""
    pid = keeper.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    until(lambda: state_of(pid) == "T")
    return pid


def test_what_is_handed_over_is_on_the_disk(keep: Callable[[], StateKeeper], path: Path) -> None:
    keeper = keep()
    for n in range(3):
        assert keeper.save(body(n))
        assert select.select([keeper.fileno()], [], [], HANG_S)[0]
        assert keeper.outcomes() == ["saved"]
        assert load(path).body == body(n)
    assert decoded(previous_path(path).read_bytes()) == body(1)
    assert keeper.close()
    assert not keeper.save(body(3))
    assert keeper.close()
    assert load(path).body == body(2)


def test_without_anything_to_save_closing_is_quick_and_right(keep: Callable[[], StateKeeper], path: Path) -> None:
    assert keep().close()
    assert not path.exists()


def test_closing_waits_for_the_last_one(keep: Callable[[], StateKeeper], path: Path) -> None:
    keeper = keep()
    for n in range(200):
        keeper.save(body(n))
    assert keeper.close(HANG_S)
    assert load(path).body == body(199)


def test_no_process_of_ours_stays_behind(keep: Callable[[], StateKeeper]) -> None:
    keeper = keep()
    pid = keeper.pid
    assert pid is not None
    keeper.save(body(1))
    assert keeper.close(HANG_S)
    assert state_of(pid) == ""


def test_a_hanging_disk_holds_nobody_up(keep: Callable[[], StateKeeper], path: Path) -> None:
    """The pipe fills, states are let go, and no call waits; when the disk is back, the newest is saved."""
    keeper = keep()
    assert keeper.save(body(0))
    assert answered(keeper) == "saved"
    paused(keeper)
    taken = [keeper.save({**body(n), "ballast": "x" * 4000}) for n in range(1, 40)]
    assert taken[0]
    assert not taken[-1]
    assert keeper.outcomes() == []
    assert load(path).body == body(0)
    signalled(keeper.pid or 0, signal.SIGCONT)
    until(lambda: keeper.outcomes() == [] and (load(path).body or {}).get("n") == 39)
    assert keeper.save(body(40))
    assert keeper.close(HANG_S)
    assert load(path).body == body(40)


def test_a_half_sent_state_is_never_mixed_with_the_next(keep: Callable[[], StateKeeper], path: Path) -> None:
    """Of three states the pipe takes one and a half: the half goes on before the third."""
    keeper = keep()
    keeper.save(body(0))
    assert answered(keeper) == "saved"
    pid = paused(keeper)
    states = [{"n": n, "ballast": letter * 43_000} for n, letter in enumerate("abcd")]
    assert [keeper.save(state) for state in states] == [True, False, False, False]
    os.kill(pid, signal.SIGCONT)
    assert keeper.close(HANG_S)
    assert not [words for words in keeper.outcomes() if words != "saved"]
    assert load(path) == (states[3], (), "current")


def test_closing_starts_a_killed_process_once_more(keep: Callable[[], StateKeeper], path: Path) -> None:
    """However soon after the last start: it is the last chance."""
    keeper = keep()
    keeper.save(body(0))
    assert answered(keeper) == "saved"
    pid = keeper.pid
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    until(lambda: state_of(pid) in {"", "Z"})
    assert not keeper.save(body(1))
    assert keeper.close(HANG_S)
    assert load(path).body == body(1)


def test_closing_while_the_disk_hangs_gives_up_in_time(keep: Callable[[], StateKeeper], path: Path) -> None:
    """And when the disk comes back after all, the last state still gets there."""
    keeper = keep()
    keeper.save(body(0))
    assert answered(keeper) == "saved"
    pid = paused(keeper)
    assert keeper.save(body(1))
    assert not keeper.close(0.2)
    assert load(path).body == body(0)
    os.kill(pid, signal.SIGCONT)
    until(lambda: state_of(pid) in {"", "Z"})
    assert load(path).body == body(1)


def test_a_killed_process_is_replaced_and_its_state_sent_again(
    keep: Callable[[], StateKeeper], path: Path, clock: Clock
) -> None:
    keeper = keep()
    keeper.save(body(0))
    assert answered(keeper) == "saved"
    first = paused(keeper)
    assert keeper.save(body(1))
    os.kill(first, signal.SIGKILL)
    told: list[str] = []
    until(lambda: told.extend(keeper.outcomes()) or "SIGKILL" in "".join(told))
    clock.ahead_s += 100.0
    assert answered(keeper) == "saved"
    assert keeper.pid != first
    assert load(path).body == body(1)


def test_a_process_that_always_dies_is_not_started_again_and_again(
    path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dsz_daemon.edge.state_keeper._CODE", "import sys; sys.exit(5)")
    started: list[object] = []
    real = subprocess.Popen

    def counted(*arguments: object, **named: object) -> object:
        process = real(*arguments, **named)  # type: ignore[call-overload]
        process.wait()
        started.append(process)
        return process

    monkeypatch.setattr("dsz_daemon.edge.state_keeper.subprocess.Popen", counted)
    frozen_s = [0.0]
    keeper = StateKeeper(path, lambda: frozen_s[0])
    told: list[str] = []
    for _ in range(50):
        assert not keeper.save(body(1))
        told += keeper.outcomes()
    assert len(started) == 1
    assert told == [f"failed: the process that writes {path} has ended (exit code 5)"]
    frozen_s[0] = 11.0
    for _ in range(50):
        keeper.save(body(1))
    assert len(started) == 2
    assert not keeper.close(1.0)
    assert len(started) <= 4


def test_an_interpreter_that_is_not_there_is_an_outcome(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/no/such/python")
    keeper = StateKeeper(path)
    assert not keeper.save(body(1))
    assert "can't be started" in keeper.outcomes()[0]
    assert not keeper.close()


def test_kills_at_random_moments_always_leave_a_generation(
    keep: Callable[[], StateKeeper], path: Path, clock: Clock
) -> None:
    """The last that was saved or a newer one, never an older one: 200 kills."""
    rng = random.Random(5)
    keeper = keep()
    keeper.save(body(0))
    assert answered(keeper) == "saved"
    least, n = 0, 0
    for _ in range(200):
        for _ in range(rng.randint(1, 4)):
            n += 1
            keeper.save(body(n))
            time.sleep(rng.random() * 0.004)
        pid = keeper.pid
        if pid is not None:
            os.kill(pid, signal.SIGKILL)
            until(lambda pid=pid: state_of(pid) in {"", "Z"})
        loaded = load(path)
        assert loaded.body is not None
        assert not [words for words in loaded.said if "set aside" in words]
        assert least <= loaded.body["n"] <= n
        least = loaded.body["n"]
        clock.ahead_s += 11.0
        keeper.outcomes()
        # Now and then one comes to write; else all would be killed before they have begun.
        if rng.random() < 0.3:
            until(lambda n=n: keeper.outcomes() is not None and (load(path).body or {})["n"] == n)
            least = n
    assert keeper.close(HANG_S)
    assert load(path).body == body(n)


@pytest.mark.parametrize("moment_s", [0.0, 0.01, 0.05, 0.2])
def test_signals_that_end_a_daemon_are_not_for_the_process(
    keep: Callable[[], StateKeeper], path: Path, moment_s: float
) -> None:
    keeper = keep()
    pid = keeper.pid
    assert pid is not None
    assert keeper.save(body(1))
    time.sleep(moment_s)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(pid, number)
    assert os.getpgid(pid) != os.getpgid(0)
    assert answered(keeper) == "saved"
    assert keeper.pid == pid
    assert keeper.save(body(2))
    assert keeper.close(HANG_S)
    assert load(path).body == body(2)


def test_signals_of_ours_are_as_before(keep: Callable[[], StateKeeper]) -> None:
    keep()
    assert not DEAF_TO & signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_the_daemon_is_killed_and_its_last_state_is_saved(path: Path) -> None:
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from dsz_daemon.edge.state_keeper import StateKeeper\n"
        "keeper = StateKeeper(Path(sys.argv[1]))\n"
        "for n in range(5): keeper.save({'n': n})\n"
        "print(keeper.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, timeout=HANG_S, check=False)
    assert done.returncode == -signal.SIGKILL
    until(lambda: state_of(int(done.stdout)) in {"", "Z"})
    assert load(path).body == {"n": 4}


def test_a_second_daemon_on_the_same_file_says_so_and_keeps_off(keep: Callable[[], StateKeeper], path: Path) -> None:
    first, second = keep(), keep()
    first.save(body(1))
    assert answered(first) == "saved"
    second.save(body(100))
    assert answered(second) == f"failed: {path}: another daemon writes this file"
    first.save(body(2))
    assert answered(first) == "saved"
    assert load(path).body == body(2)
    assert decoded(previous_path(path).read_bytes()) == body(1)
    assert first.close()
    second.save(body(101))
    assert answered(second) == "saved"
    assert load(path).body == body(101)


def test_a_lock_that_nobody_holds_any_more_does_not_matter(keep: Callable[[], StateKeeper], path: Path) -> None:
    lock_path(path).write_text("left by a daemon that was killed")
    keeper = keep()
    keeper.save(body(1))
    assert answered(keeper) == "saved"


def test_a_write_that_does_not_fit_fails_and_the_next_works(keep: Callable[[], StateKeeper], path: Path) -> None:
    """RLIMIT_FSIZE stands for a full disk where none can be mounted."""
    keeper = keep()
    keeper.save(body(1))
    assert answered(keeper) == "saved"
    assert keeper.pid is not None
    _, hard = resource.prlimit(keeper.pid, resource.RLIMIT_FSIZE, (100, resource.prlimit(keeper.pid, 1)[1]))
    keeper.save(body(2))
    assert answered(keeper) == f"failed: {path}: File too large"
    assert load(path).body == body(1)
    resource.prlimit(keeper.pid, resource.RLIMIT_FSIZE, (hard, hard))
    keeper.save(body(3))
    assert answered(keeper) == "saved"
    assert load(path).body == body(3)


def test_full_and_read_only_disks_are_outcomes(tmp_path: Path) -> None:
    folder = tmp_path / "disk"
    folder.mkdir()
    with mounted(folder, 16 * 4096) as set_read_only:
        path, filler = folder / "offsets.json", folder / "filler"
        keeper = StateKeeper(path)
        keeper.save(body(1))
        assert answered(keeper) == "saved"
        fill(filler)
        keeper.save(body(2))
        assert answered(keeper) == f"failed: {path}: No space left on device"
        filler.unlink()
        keeper.save(body(3))
        assert answered(keeper) == "saved"
        # What holds a file open for writing keeps the disk writable: the lock.
        assert keeper.close()
        set_read_only(True)
        keeper = StateKeeper(path)
        keeper.save(body(4))
        assert answered(keeper) == f"failed: {path}: Read-only file system"
        assert load(path) == (body(3), (), "current")
        set_read_only(False)
        keeper.save(body(5))
        assert answered(keeper) == "saved"
        assert keeper.close()


def test_a_folder_that_comes_later_is_used_then(keep: Callable[[], StateKeeper], path: Path, tmp_path: Path) -> None:
    keeper = StateKeeper(tmp_path / "mounted later" / "offsets.json")
    keeper.save(body(1))
    assert "No such file or directory" in answered(keeper)
    (tmp_path / "mounted later").mkdir()
    keeper.save(body(2))
    assert answered(keeper) == "saved"
    assert keeper.close()


def test_what_is_no_state_is_refused_and_the_last_one_stays(keep: Callable[[], StateKeeper], path: Path) -> None:
    keeper = keep()
    keeper.save(body(1))
    assert answered(keeper) == "saved"
    assert not keeper.save({"x": float("nan")})
    assert keeper.outcomes()[0].startswith("failed: ")
    assert keeper.close()
    assert load(path).body == body(1)


def test_outcomes_that_nobody_asks_for_do_not_pile_up(keep: Callable[[], StateKeeper]) -> None:
    keeper = keep()
    for _ in range(500):
        keeper.save({"x": float("nan")})
    assert keeper.save(body(1))
    assert keeper.close(HANG_S)
    assert len(keeper.outcomes()) <= 100


def test_a_relative_path_is_meant_from_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And modules that happen to lie here are none of the writing process's."""
    monkeypatch.chdir(tmp_path)
    for name in ("json", "struct", "hashlib", "dsz_daemon"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit(7)")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    keeper = StateKeeper(Path("offsets.json"))
    keeper.save(body(1))
    assert answered(keeper) == "saved"
    assert keeper.close()
    assert load(tmp_path / "offsets.json").body == body(1)


def test_the_process_does_not_stay_on_the_loop_s_cpu(path: Path) -> None:
    cpus = os.sched_getaffinity(0)
    if len(cpus) < 2:
        pytest.skip("there is only one CPU here")
    os.sched_setaffinity(0, {min(cpus)})
    try:
        keeper = StateKeeper(path)
    finally:
        os.sched_setaffinity(0, cpus)
    keeper.save(body(1))
    assert answered(keeper) == "saved"
    assert keeper.pid is not None
    assert os.sched_getaffinity(keeper.pid) > {min(cpus)}
    assert keeper.close()


# The writing process by itself.


def frame(number: int, data: bytes) -> bytes:
    return HEADER.pack(len(data), number) + data


def written(path: Path, stream: bytes) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "dsz_daemon.edge.state_writer", str(path)]
    return subprocess.run(command, input=stream, capture_output=True, timeout=HANG_S, check=False)


def test_the_newest_wins(path: Path) -> None:
    done = written(path, b"".join(frame(n, encoded(body(n))) for n in range(1, 40)))
    assert (done.returncode, done.stdout) == (0, b"saved 39\n")
    assert load(path).body == body(39)
    assert not previous_path(path).exists()


def test_the_newest_wins_over_many_reads(path: Path, tmp_path: Path) -> None:
    """More than one read of a pipe holds; a file is always readable, so that none is waited for."""
    states = [encoded({"n": n, "ballast": "x" * 20_000}) for n in range(40)]
    (tmp_path / "stream").write_bytes(b"".join(frame(n, data) for n, data in enumerate(states)))
    command = [sys.executable, "-m", "dsz_daemon.edge.state_writer", str(path)]
    with (tmp_path / "stream").open("rb") as stream:
        done = subprocess.run(command, stdin=stream, capture_output=True, timeout=HANG_S, check=False)
    assert (done.returncode, done.stdout) == (0, b"saved 39\n")
    assert path.read_bytes() == states[39]


@pytest.mark.parametrize("left", [0, 1, 11, 12, 13, 100])
def test_a_stream_that_ends_within_a_state_leaves_the_one_before(path: Path, left: int) -> None:
    done = written(path, frame(1, encoded(body(1))) + frame(2, encoded(body(2)))[:left])
    assert (done.returncode, done.stdout) == (0, b"saved 1\n")
    assert load(path).body == body(1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_by_itself_it_is_deaf_too(path: Path, number: signal.Signals) -> None:
    command = [sys.executable, "-m", "dsz_daemon.edge.state_writer", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        process.stdin.write(frame(1, encoded(body(1))))
        process.stdin.flush()
        until(path.exists)
        process.send_signal(number)
        out, _ = process.communicate(frame(2, encoded(body(2))), timeout=HANG_S)
    assert (process.returncode, out) == (0, b"saved 1\nsaved 2\n")


def test_an_impossible_length_ends_it(path: Path) -> None:
    done = written(path, b"\xff" * 100)
    assert done.returncode == 2
    assert b"Traceback" not in done.stderr
    assert not path.exists()


def test_without_a_path_it_says_what_is_missing(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "dsz_daemon.edge.state_writer"], capture_output=True, timeout=HANG_S, check=False
    )
    assert done.returncode == 2
    assert b"expected one argument" in done.stderr


def test_reports_that_nobody_reads_do_not_stop_it(path: Path) -> None:
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    assert os.write(writer, bytes(4096)) == 4096
    command = [sys.executable, "-m", "dsz_daemon.edge.state_writer", str(path)]
    done = subprocess.run(command, input=frame(1, encoded(body(1))), stdout=writer, timeout=HANG_S, check=False)
    os.close(reader)
    os.close(writer)
    assert done.returncode == 0
    assert load(path).body == body(1)


def test_it_needs_nothing_but_the_standard_library() -> None:
    """So that it is there within a few hundredths of a second, and takes little memory."""
    root = Path(__file__).parents[2]
    code = "import sys; sys.path.append(sys.argv[1]); import dsz_daemon.edge.state_writer; print(*sys.modules)"
    command = [sys.executable, "-I", "-S", "-c", code, str(root)]
    loaded = subprocess.run(command, capture_output=True, timeout=HANG_S, check=True, text=True).stdout.split()
    ours = {name for name in loaded if name.split(".")[0] == "dsz_daemon"}
    assert ours == {
        "dsz_daemon",
        "dsz_daemon.edge",
        "dsz_daemon.edge.state_file",
        "dsz_daemon.edge.state_writer",
    }
    assert {name.split(".")[0] for name in set(loaded) - ours} <= {*sys.stdlib_module_names, "__main__"}
