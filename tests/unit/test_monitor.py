"""`dsz monitor`: what it remembers, what it shows, and that it leaves the terminal as it found it."""

from __future__ import annotations

import contextlib
import io
import json
import os
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from dataclasses import replace
from fcntl import ioctl
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from status_cases import FakeDaemon, golden_setup, last_moment, moments

from dsz_daemon import cli
from dsz_daemon.edge.health import BusHealth, Link
from dsz_daemon.edge.journal import Event, Priority
from dsz_daemon.runs.facts import LiveFacts
from dsz_daemon.runs.monitor_screen import Size, picture
from dsz_daemon.runs.status import snapshot, snapshot_text
from dsz_daemon.runs.trend import BLOCKS, PLAIN_BLOCKS, Trend, bridged, sparkline


def answer_at(time_s: float, offset: float | None, frames: int = 0, pid: int = 1) -> dict[str, Any]:
    """As much of a snapshot as the trend looks at."""
    return {
        "pid": pid,
        "started_s": 0.0,
        "time_s": time_s,
        "channels": {"gyro_z": {"offset": offset}},
        "buses": [{"name": "can0", "received": frames, "sent": frames // 2}],
    }


def trend_of(*answers: dict[str, Any]) -> Trend:
    trend = Trend()
    for answer in answers:
        trend.add(answer)
    return trend


def test_the_trend_spans_the_last_minute_oldest_first() -> None:
    # One value a second for 100 s: the last 60 columns of a second each are 40 .. 99, and 39 is just too old
    # to be apart from 40.
    trend = trend_of(*(answer_at(float(n), float(n)) for n in range(100)))
    offsets = trend.offsets("gyro_z", 60)
    assert offsets[-1] == 99.0
    assert offsets[-11] == pytest.approx(89.0, abs=1.0)
    assert offsets == sorted(offsets, key=lambda value: value or 0.0)
    assert min(value for value in offsets if value is not None) >= 39.0
    # Half a minute's worth fills half the columns.
    short = trend_of(*(answer_at(float(n), 1.0) for n in range(31))).offsets("gyro_z", 60)
    assert short[:29] == [None] * 29
    assert short[30:] == [1.0] * 30


def test_the_trend_begins_afresh_with_another_daemon_or_another_time() -> None:
    first = [answer_at(float(n), 1.0) for n in range(10)]
    for other in (answer_at(11.0, 2.0, pid=2), answer_at(3.0, 2.0), {**answer_at(11.0, 2.0), "started_s": 5.0}):
        known = [value for value in trend_of(*first, other).offsets("gyro_z", 60) if value is not None]
        assert known == [2.0]
    assert trend_of(*first, answer_at(10.0, None)).offsets("gyro_z", 60)[-1] is None


def test_the_load_is_that_of_the_last_second_or_so() -> None:
    # 1000 frames/s for 5 s, then none for 2 s; asked four times a second.
    counts = [(n / 4.0, min(5000, 250 * n)) for n in range(29)]
    trend = trend_of(*(answer_at(time_s, 0.0, frames) for time_s, frames in counts[:19]))
    assert trend.load("can0") == pytest.approx((1000.0, 500.0))
    for time_s, frames in counts[19:]:
        trend.add(answer_at(time_s, 0.0, frames))
    assert trend.load("can0") == (0.0, 0.0)
    assert trend.load("can1") is None
    assert trend_of(answer_at(0.0, 0.0)).load("can0") is None
    assert trend_of(answer_at(1.0, 0.0), answer_at(1.0, 0.0)).load("can0") is None


def test_a_sparkline_rises_where_the_values_do() -> None:
    assert sparkline([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], 0.0) == BLOCKS
    assert sparkline([7.0, 0.0], 0.0) == "█▁"
    assert sparkline([None, None], 1.0) == "  "
    assert sparkline([3.0, 3.0], 0.0) == sparkline([3.0, 3.0], 1.0)
    # What moves by a hundredth of its spread looks flat.
    assert len(set(sparkline([1.0, 1.001, 0.999], 0.2))) == 1
    assert bridged([None, None]) == [None, None]
    assert bridged([1.0, None, None, 4.0]) == [1.0, 1.0, 1.0, 4.0]


def golden_answer(facts: LiveFacts | None = None) -> dict[str, Any]:
    found = json.loads(snapshot_text(golden_setup(), facts or last_moment()))
    assert isinstance(found, dict)
    return found


def drawn(size: Size, answer: dict[str, Any] | None, trend: Trend, problem: str = "") -> list[str]:
    console = Console(file=io.StringIO(), width=size.columns, height=size.rows, force_terminal=True, color_system=None)
    console.print(picture(answer, trend, problem, "/run/dsz/status.sock", size))
    file = console.file
    assert isinstance(file, io.StringIO)
    lines = file.getvalue().splitlines()
    assert len(lines) <= size.rows
    assert max(len(line) for line in lines) <= size.columns
    return lines


@pytest.fixture(scope="module")
def drive() -> tuple[dict[str, Any], Trend]:
    """The golden drive as the monitor saw it, twice a second."""
    trend, answer = Trend(), {}
    for facts in moments(every=50):
        answer = snapshot(golden_setup(), facts)
        trend.add(answer)
    return answer, trend


@pytest.mark.parametrize(("columns", "rows"), [(80, 24), (120, 24), (200, 60), (80, 18), (40, 10), (20, 3), (80, 1)])
def test_the_picture_fits_any_terminal(drive: tuple[dict[str, Any], Trend], columns: int, rows: int) -> None:
    lines = drawn(Size(columns, rows), *drive)
    assert lines[0].startswith("dsz monitor")
    if columns >= 80 and rows >= 18:
        names = ("roll rate", "pitch rate", "yaw rate", "longitudinal", "lateral", "vertical")
        for name in names:
            (line,) = [line for line in lines if line.startswith(name)]
            assert any(state in line for state in ("converged", "learning", "holding", "invalid"))
        assert any("frames/s" in line for line in lines)
        has_trend = sum(any(block in line for block in BLOCKS) for line in lines)
        assert has_trend == (0 if (columns, rows) == (80, 18) else 6)


def test_the_picture_shows_values_in_the_units_of_people(drive: tuple[dict[str, Any], Trend]) -> None:
    answer, trend = drive
    channel = {"unit": "rad/s", "raw": 0.1, "compensated": -0.2, "offset": 0.3, "offset_std": 0.01}
    state = {"state": "learning", "gate": True, "reason": "none"}
    lines = drawn(Size(80, 24), {**answer, "channels": {"gyro_z": {**channel, **state}}}, trend)
    (line,) = [line for line in lines if line.startswith("yaw rate")]
    # 0.1 rad/s is 5.730 deg/s; 1.96 times 0.01 rad/s is 1.123 deg/s.
    assert line.split() == ["yaw", "rate", "deg/s", "+5.730", "-11.459", "+17.189", "1.123", "learning"]


def test_newest_events_fill_what_is_left_newest_first(drive: tuple[dict[str, Any], Trend]) -> None:
    events = tuple(Event(last_moment().now_ns, Priority.INFO, "x", f"event {n}.") for n in range(50))
    answer = golden_answer(replace(last_moment(), events=events))
    for rows in (18, 24, 40):
        lines = drawn(Size(80, rows), answer, drive[1])
        shown = [line.split("event ")[1] for line in lines if "event " in line]
        assert shown == [f"{49 - n}." for n in range(len(shown))]
        assert len(lines) == rows


def test_while_no_daemon_answers_the_last_answer_stays(drive: tuple[dict[str, Any], Trend]) -> None:
    problem = "no daemon at /run/dsz/status.sock"
    lines = drawn(Size(80, 24), *drive, problem)
    assert lines[1].startswith(f"waiting: {problem}")
    assert any(line.startswith("yaw rate") for line in lines)
    assert not any("running on can0" in line for line in lines)
    assert len(drawn(Size(80, 24), None, Trend(), problem)) == 2


def test_troubles_stand_out_by_words(drive: tuple[dict[str, Any], Trend]) -> None:
    bus = BusHealth("can0", "socketcan:can0", Link.BUS_OFF, lost=7, last_error="network is down")
    answer = golden_answer(replace(last_moment(), buses=(bus,), output_refused=True))
    text = "\n".join(drawn(Size(120, 30), answer, drive[1]))
    for words in ("bus off", "lost 7", "network is down", "OUTPUT REFUSED"):
        assert words in text


def test_a_terminal_without_block_characters_gets_none(drive: tuple[dict[str, Any], Trend]) -> None:
    lines = drawn(Size(60, 24, has_blocks=False), *drive)
    assert all(line.isascii() for line in lines)
    assert sum(line.strip().startswith(tuple(PLAIN_BLOCKS)) for line in lines) == 6


class Terminal:
    """`dsz monitor` on a terminal of its own; `screen` is all that it has written."""

    def __init__(self, path: Path, columns: int = 80, rows: int = 24) -> None:
        self.master, slave = pty.openpty()
        self.descriptors = [self.master, slave]
        ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.before = termios.tcgetattr(slave)
        self.screen = ""
        environment = {**os.environ, "TERM": "xterm-256color", "PYTHONIOENCODING": "utf-8"}
        for name in ("COLUMNS", "LINES", "NO_COLOR"):
            environment.pop(name, None)
        command = [sys.executable, "-m", "dsz_daemon", "monitor", "--socket", str(path), "--rate", "20"]
        self.process = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, env=environment)
        self.slave = slave

    def until(self, words: str) -> None:
        deadline_s = time.monotonic() + 30.0
        while words not in self.screen:
            assert time.monotonic() < deadline_s, f"{words!r} never came: {self.screen[-2000:]!r}"
            self._read(0.1)

    def _read(self, timeout_s: float) -> bool:
        ready, _, _ = select.select([self.master], [], [], timeout_s)
        if ready:
            self.screen += os.read(self.master, 65536).decode(errors="replace")
        return bool(ready)

    def end(self) -> int:
        deadline_s = time.monotonic() + 30.0
        while self.process.poll() is None and time.monotonic() < deadline_s:
            self._read(0.05)
        while self._read(0.0):
            pass
        return self.process.wait(1.0)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.hang_up()

    def hang_up(self) -> None:
        while self.descriptors:
            os.close(self.descriptors.pop())


@contextlib.contextmanager
def terminal(path: Path) -> Iterator[Terminal]:
    opened = Terminal(path)
    try:
        yield opened
    finally:
        opened.close()


@pytest.mark.parametrize("way", ["q", "ctrl-c", "sigterm", "sighup"])
def test_it_ends_cleanly_and_puts_the_terminal_back(tmp_path: Path, way: str) -> None:
    with FakeDaemon(tmp_path / "s"), terminal(tmp_path / "s") as shown:
        shown.until("yaw rate")
        # The screen is one of its own, keys come without Enter and are not echoed.
        assert "\x1b[?1049h" in shown.screen
        assert not termios.tcgetattr(shown.slave)[3] & (termios.ICANON | termios.ECHO)
        if way == "q":
            os.write(shown.master, b"xq")
        elif way == "ctrl-c":
            shown.process.send_signal(signal.SIGINT)
        else:
            shown.process.send_signal({"sigterm": signal.SIGTERM, "sighup": signal.SIGHUP}[way])
        assert shown.end() == 0
        assert termios.tcgetattr(shown.slave) == shown.before
        assert "\x1b[?1049l" in shown.screen
        assert "Traceback" not in shown.screen


def test_it_waits_for_a_daemon_and_survives_its_restart(tmp_path: Path) -> None:
    path = tmp_path / "s"
    with terminal(path) as shown:
        shown.until("waiting: no daemon at")
        with FakeDaemon(path):
            shown.until("yaw rate")
        shown.screen = ""
        shown.until("waiting: no daemon at")
        shown.screen = ""
        with FakeDaemon(path):
            shown.until("running on can0")
        os.write(shown.master, b"q")
        assert shown.end() == 0


def test_it_ends_when_its_terminal_is_gone(tmp_path: Path) -> None:
    with FakeDaemon(tmp_path / "s"), terminal(tmp_path / "s") as shown:
        shown.until("yaw rate")
        shown.hang_up()
        shown.process.wait(30.0)


def test_in_a_pipe_it_prints_a_line_a_channel(tmp_path: Path) -> None:
    path = tmp_path / "s"
    command = [sys.executable, "-m", "dsz_daemon", "monitor", "--socket", str(path), "--rate", "20"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            head = process.stdout.readline()
            assert process.stderr.readline().startswith(f"dsz: waiting: no daemon at {path}")
            with FakeDaemon(path):
                lines = [process.stdout.readline().split() for _ in range(12)]
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=30.0)
        finally:
            process.kill()
    assert process.returncode == 0
    assert "Traceback" not in errors
    names = head.removeprefix("#").split()
    assert {len(line) for line in lines} == {len(names)}
    rows = [dict(zip(names, line, strict=True)) for line in lines]
    assert [row["channel"] for row in rows[:6]] == ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    for row in rows:
        # Compensated is raw minus offset, as far as three decimals show it.
        assert float(row["compensated"]) == pytest.approx(float(row["raw"]) - float(row["offset"]), abs=2e-3)
    assert float(rows[6]["time_s"]) > float(rows[0]["time_s"])


def test_the_readers_end_is_ours(tmp_path: Path) -> None:
    with FakeDaemon(tmp_path / "s"):
        command = f"{sys.executable} -m dsz_daemon monitor --rate 20 --socket {tmp_path / 's'} | head -3"
        run = subprocess.run(
            ["bash", "-o", "pipefail", "-c", command], check=False, capture_output=True, text=True, timeout=60.0
        )
    assert (run.returncode, run.stderr) == (0, "")
    assert len(run.stdout.splitlines()) == 3


@pytest.mark.parametrize("rate", ["0", "-1", "nan", "x", "1000", "0.001"])
def test_rates_out_of_bounds_are_refused(rate: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["monitor", f"--rate={rate}"]) == 2
    assert rate in capsys.readouterr().err
