"""kill -9 at a random moment, 200 times: the state file is whole each time, and the next start goes on from it.

This file is also the program that starts the daemons: `python test_killed.py CONFIG STATE`. It imports once and
forks, for two hundred starts of an interpreter would take minutes. What it runs is what `dsz run --state` runs:
loop, service, state keeper and the writing process of its own, on python-can's virtual bus in real time.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import math
import os
import random
import select
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest
import short_drive

from dsz_daemon.core.state import as_plain
from dsz_daemon.edge.boot import this_boot
from dsz_daemon.edge.state_file import decoded, encoded, load, previous_path, save
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.runs.live import Live, LiveOptions
from dsz_daemon.runs.memory import remembered
from dsz_daemon.runs.service import Paths, Service
from dsz_daemon.runs.setup import Setup, set_up

KILLS = 200
SEED = 20261121
# Only what hangs takes longer.
HANG_S = 30.0
# A kill comes so long after one of these events in a daemon's life, at random; on an idle machine the first state
# is on the disk 0.1 s after the start. Waiting for the later ones keeps a busy machine from killing newborns only.
MOMENTS = ("started", "restored", "started", "saved")
LATEST_S = {"started": 0.3, "restored": 0.2, "saved": 0.1}
# The shortest that a configuration may ask for, and far shorter: then hardly a moment is left without a file in work.
PERIODS_S = (0.05, 0.002)
# Of prctl(2).
_DEATH_SIGNAL, _SUBREAPER = 1, 36


class Nursery:
    """Starts daemons on one state file, one at a time, and hears what each goes on from."""

    def __init__(self, config: Path, state: Path, errors: Path) -> None:
        self._errors = errors.open("wb")
        self._process = subprocess.Popen(
            [sys.executable, __file__, str(config), str(state)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            bufsize=0,
        )
        self._heard = b""

    def started(self, period_s: float) -> int:
        """A new daemon's process id."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{period_s}\n".encode())
        while True:
            told = self.told(HANG_S)
            assert told is not None, "the nursery does not answer"
            if "born" in told:
                return int(told["born"])

    def told(self, timeout_s: float) -> dict[str, Any] | None:
        """The next line that came, from the nursery or a daemon; None if none comes in time."""
        assert self._process.stdout is not None
        while b"\n" not in self._heard:
            if not select.select([self._process.stdout], [], [], timeout_s)[0]:
                return None
            part = os.read(self._process.stdout.fileno(), 1 << 16)
            assert part, "the nursery has ended"
            self._heard += part
        line, _, self._heard = self._heard.partition(b"\n")
        told: dict[str, Any] = json.loads(line)
        return told

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()
        self._errors.close()


@pytest.fixture
def config(tmp_path: Path) -> Path:
    _, path = short_drive.write(tmp_path / "car", short_drive.frames())
    with path.open("a") as file:
        file.write(f"service: {{save_period_s: {PERIODS_S[0]}, sensor: test}}\n")
    return path


@pytest.fixture
def nursery(config: Path, tmp_path: Path) -> Iterator[Nursery]:
    nursery = Nursery(config, tmp_path / "offsets.json", tmp_path / "said")
    yield nursery
    nursery.close()


def learnt(setup: Setup) -> dict[str, Any]:
    """The state file's body after the whole drive."""
    loop = setup.loop(setup.decoder(setup.encoder()))
    for sent in short_drive.frames():
        t_ns = short_drive.START_S * 10**9 + round(sent.t_s * 1e9)
        loop.frame(Frame(t_ns, sent.channel, sent.can_id, sent.data))
    body = remembered(setup, loop.memory.estimator, time.time_ns(), None, this_boot())
    return json.loads(json.dumps(body))  # type: ignore[no-any-return]


def corrections(body: dict[str, Any]) -> dict[str, float]:
    return {name: channel["learnt"]["correction"] for name, channel in body["channels"].items()}


def is_gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in {"Z", "X"}
    except (FileNotFoundError, ProcessLookupError):
        return True


def until(condition: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < end_s, what
        time.sleep(0.001)


def writers_of(pid: int) -> list[int]:
    """The processes that a daemon has started: its writer, if it is there yet."""
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except (FileNotFoundError, ProcessLookupError):
        return []


def kill(*pids: int) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def readable_now(path: Path) -> int:
    """When the newest whole generation was saved that a reader finds at this moment, ns; without `load`'s tidying."""
    found = 0
    for candidate in (path, previous_path(path)):
        with contextlib.suppress(FileNotFoundError):
            found = max(found, decoded(candidate.read_bytes())["saved_ns"])
    return found


def killed_somehow(pid: int, rng: random.Random, how: str) -> None:
    """The daemon alone, its writer first, or both at once; afterwards nobody is left who writes."""
    writers = writers_of(pid)
    if how == "writer first":
        kill(*writers)
        time.sleep(rng.uniform(0.0, 0.02))
        writers += writers_of(pid)
    kill(pid, *(writers if how == "both" else ()))
    until(lambda: is_gone(pid) and all(map(is_gone, writers)), "a killed daemon, or its writer, goes on")


def test_two_hundred_kills_lose_no_offset(nursery: Nursery, config: Path, tmp_path: Path) -> None:
    rng = random.Random(SEED)
    path, body = tmp_path / "offsets.json", learnt(set_up(config))
    save(path, encoded(body))
    least_ns, seen = body["saved_ns"], Counter[str]()
    for number in range(KILLS):
        moment = MOMENTS[number % len(MOMENTS)]
        pid = nursery.started(PERIODS_S[number // len(MOMENTS) % len(PERIODS_S)])
        told = [] if moment == "started" else [nursery.told(HANG_S)]
        if moment == "saved":
            until(lambda old_ns=least_ns: readable_now(path) > old_ns, "nothing is saved")  # type: ignore[misc]
        time.sleep(rng.uniform(0.0, LATEST_S[moment]))
        least_ns = max(least_ns, readable_now(path))
        how = rng.choice(("daemon", "writer first", "both"))
        killed_somehow(pid, rng, how)

        loaded = load(path)
        assert loaded.body is not None, f"kill {number} ({how}): both generations are lost: {loaded.said}"
        # A stop between two renames leaves the generation before; nothing that is half.
        assert not [words for words in loaded.said if "set aside" in words], f"kill {number} ({how})"
        assert loaded.body["saved_ns"] >= least_ns, f"kill {number} ({how}): an older state is back"
        seen[f"loaded {loaded.generation}"] += 1
        seen["saved in its life"] += loaded.body["saved_ns"] > body["saved_ns"]
        told += [nursery.told(0.0)]
        for word in filter(None, told):
            # It went on with what the file held, to the last bit.
            assert (word["daemon"], word["corrections"]) == (pid, corrections(body)), f"start {number}"
            seen["went on"] += 1
        body, least_ns = loaded.body, loaded.body["saved_ns"]
    # The car stands still all the while: what was learnt of the drive stays, within its noise.
    true_radps = short_drive.OFFSETS["gyro_z"]
    assert abs(corrections(body)["gyro_z"]) == pytest.approx(true_radps, abs=math.radians(0.1))
    # That it was worth something.
    assert seen["went on"] >= KILLS // 2, seen
    assert seen["saved in its life"] >= KILLS // 4, seen
    assert "Traceback" not in (tmp_path / "said").read_text()


def test_after_a_kill_a_stop_saves_and_both_generations_are_whole(
    nursery: Nursery, config: Path, tmp_path: Path
) -> None:
    path, body = tmp_path / "offsets.json", learnt(set_up(config))
    save(path, encoded(body))
    until_saved = nursery.started(PERIODS_S[0])
    until(lambda: readable_now(path) > body["saved_ns"], "nothing is saved")
    kill(until_saved, *writers_of(until_saved))
    pid = nursery.started(PERIODS_S[0])
    told = nursery.told(HANG_S)
    while told is not None and told.get("daemon") != pid:
        told = nursery.told(HANG_S)
    before_ns = readable_now(path)
    until(lambda: readable_now(path) > before_ns, "nothing is saved")
    writers = writers_of(pid)
    os.kill(pid, signal.SIGTERM)
    until(lambda: is_gone(pid) and all(map(is_gone, writers)), "a daemon does not stop")
    now, previous = decoded(path.read_bytes()), decoded(previous_path(path).read_bytes())
    assert now["saved_ns"] > previous["saved_ns"] > body["saved_ns"]


def main(config: Path, state: Path) -> None:
    """For every line on standard input, a save period in s, one daemon; ends with standard input."""
    setup = set_up(config)
    drive = [sent for sent in short_drive.frames() if sent.t_s < 3.0]
    # Daemons, and writers that outlive them, are ours to bury; by the kernel, at once.
    ctypes.CDLL(None).prctl(_SUBREAPER, 1, 0, 0, 0)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while line := sys.stdin.readline():
        service = setup.settings.service.model_copy(update={"save_period_s": float(line)})
        prepared = Setup(setup.path, setup.settings.model_copy(update={"service": service}), setup.checked)
        pid = os.fork()
        if pid == 0:
            # A test that fails leaves none behind.
            ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            os.close(0)
            daemon(prepared, state, drive)
            os._exit(0)
        say(born=pid)


def say(**words: object) -> None:
    os.write(1, json.dumps(words).encode() + b"\n")


def daemon(setup: Setup, state: Path, drive: list[short_drive.Sent]) -> None:
    """What `dsz run --state` does, and a car that stands still and plays its part on the bus."""
    with Service(Paths(state)) as service:
        player = threading.Thread(target=play, args=(drive,), daemon=True)
        live = Live(setup, LiveOptions(on_ready=player.start), service)
        plain = as_plain(live.estimator)
        say(daemon=os.getpid(), corrections={name: plain[name]["correction"] for name in setup.channels})
        live.run()


def play(drive: list[short_drive.Sent]) -> None:
    buses = {
        name: can.Bus(interface="virtual", channel=f"short-drive-{number}")
        for number, name in enumerate(("can0", "can1"))
    }
    begin_s = time.monotonic()
    for sent in drive:
        time.sleep(max(0.0, begin_s + sent.t_s - time.monotonic()))
        buses[sent.channel].send(can.Message(arbitration_id=sent.can_id, data=sent.data, is_extended_id=False))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
