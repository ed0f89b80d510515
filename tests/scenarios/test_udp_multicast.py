"""The live daemon on python-can's udp_multicast, in a network of its own: nothing leaves the machine.

This file is also the program that runs inside: `python test_udp_multicast.py DRIVE_FOLDER OUT`.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path

import can
import cantools
import pytest
import short_drive
from scenario_results import read_results
from short_drive import Sent

from dsz_daemon.cli import main
from dsz_daemon.shipped import shipped

GROUPS = {"can0": "239.74.163.2", "can1": "239.74.163.3"}
SETUP = (
    ("ip", "link", "set", "lo", "up"),
    ("ip", "link", "set", "lo", "multicast", "on"),
    ("ip", "route", "add", "239.0.0.0/8", "dev", "lo"),
)
SECONDS = 2.0


def private_network() -> list[str]:
    """The command that starts another in a network namespace of its own; skips with the reason where there is none."""
    for tool in ("ip", "unshare"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed: no private network for multicast")
    said = ""
    for command in (["unshare", "-n"], ["unshare", "-rn"]):
        done = subprocess.run([*command, *SETUP[0]], capture_output=True, text=True, timeout=20, check=False)
        if done.returncode == 0:
            return command
        said = done.stderr.strip()
    pytest.skip(f"no private network namespace here: {said}")


def test_run_on_udp_multicast(recorded: tuple[Path, Path], tmp_path: Path) -> None:
    unshare = private_network()
    command = [*unshare, sys.executable, __file__, str(recorded[1]), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    heard = json.loads(done.stdout)
    summary = read_results(tmp_path).summary
    assert summary["counts"]["samples"] > 200
    assert summary["rows"] > 60
    # Multicast hands our own frames back to us: they are counted, and never taken for input.
    assert summary["counts"]["own"] > 100
    assert summary["counts"]["rejected"] == 0
    database = cantools.database.load_file(shipped("dbc/dsz.dbc"))
    ids = {message.frame_id: message for message in database.messages}
    assert set(ids) <= {can_id for can_id, _ in heard}
    accelerations = [
        ids[can_id].decode(bytes.fromhex(data)) for can_id, data in heard if ids.get(can_id) is not None
        and ids[can_id].name == "DSZ_ACCEL"
    ]  # fmt: skip
    # The car stands still in these seconds: g and the IMU's own offset of 0.1 m/s^2.
    upward = [float(values["AZ"]) for values in accelerations if str(values["AZ"]) != "not_available"]
    assert len(upward) > 60
    assert 9.7 < min(upward) < max(upward) < 10.1


def inside(config: Path, out: Path) -> None:
    """Feeds the first seconds of the drive over and over, runs the daemon on them, prints what was on can0."""
    for command in SETUP:
        subprocess.run(command, check=True)
    drive = [frame for frame in short_drive.frames() if frame.t_s < SECONDS]
    heard: list[tuple[int, str]] = []
    done = threading.Event()
    threads = [
        threading.Thread(target=feed, args=(drive, done)),
        threading.Thread(target=listen, args=(heard.append, done)),
    ]
    for thread in threads:
        thread.start()
    buses = [f"--bus={name}=udp_multicast:{group}" for name, group in GROUPS.items()]
    sys.stdout.flush()
    code = quietly(["run", "-c", str(config), *buses, "--duration", str(SECONDS), "-o", str(out)])
    done.set()
    for thread in threads:
        thread.join()
    print(json.dumps(heard))
    raise SystemExit(code)


def quietly(arguments: Sequence[str]) -> int:
    """`dsz` without its table: standard output is for what was heard."""
    from contextlib import redirect_stdout
    from io import StringIO

    with redirect_stdout(StringIO()):
        return main(arguments)


def feed(drive: Sequence[Sent], done: threading.Event) -> None:
    buses = {name: can.Bus(interface="udp_multicast", channel=group) for name, group in GROUPS.items()}
    begin_s = time.monotonic()
    for turn, frame in ((turn, frame) for turn in count() for frame in drive):
        if done.is_set():
            break
        time.sleep(max(0.0, turn * SECONDS + frame.t_s - (time.monotonic() - begin_s)))
        buses[frame.channel].send(can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False))
    for bus in buses.values():
        bus.shutdown()


def listen(take: Callable[[tuple[int, str]], None], done: threading.Event) -> None:
    with can.Bus(interface="udp_multicast", channel=GROUPS["can0"]) as bus:
        while not done.is_set():
            message = bus.recv(0.1)
            if message is not None:
                take((message.arbitration_id, message.data.hex()))


if __name__ == "__main__":
    inside(Path(sys.argv[1]), Path(sys.argv[2]))
