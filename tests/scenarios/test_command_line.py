"""The verbs as they are typed: help, recordings of every kind, playing onto a bus, the live daemon and its end."""

from __future__ import annotations

import gzip
import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import can
import cantools
import pytest
import zstandard
from can.interfaces.virtual import channels
from scenario_results import Called, Replayed, read_results
from short_drive import OFFSETS, START_S, Sent, candump

import dsz_daemon
from dsz_daemon.shipped import shipped

Dsz = Callable[..., Called]
# One of our own messages with 300 deg/s in R.
FORGED = bytes.fromhex("0000000000003075")
FOUR_FILES = ("samples.parquet", "compensated.log", "summary.json", "report.html")
OPTIONS = {
    "run": ("--config", "--bus", "--output", "--record", "--duration", "--json"),
    "replay": ("LOG", "--config", "--output", "--speed", "--to", "--truth", "--json"),
    "simulate": ("SCENARIO", "--output", "--seed", "--json"),
    "check": ("CONFIG", "--json"),
    "demo": ("--output", "--scenario", "--seed", "--speed", "--json"),
}


def test_help_names_every_verb_and_every_option(dsz: Dsz) -> None:
    called = dsz("--help")
    assert called.code == 0
    assert all(verb in called.out for verb in OPTIONS)
    for verb, options in OPTIONS.items():
        called = dsz(verb, "--help")
        assert (called.code, called.err) == (0, "")
        assert [option for option in options if option not in called.out] == []


def test_version_of_the_module() -> None:
    command = [sys.executable, "-m", "dsz_daemon", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    assert done.stdout == f"dsz {dsz_daemon.__version__}\n"


# Recordings


def rows_of(results: Replayed) -> dict[str, list[Any]]:
    """All columns but time; NaN is not equal to itself, its text is."""
    return {name: [str(x) for x in column] for name, column in results.samples.items() if name != "time_s"}


@pytest.mark.usefixtures("without_report")
def test_pieces_equal_the_whole(
    dsz: Dsz, drive: Sequence[Sent], recorded: tuple[Path, Path], clean: Replayed, tmp_path: Path
) -> None:
    cuts = [0, 1234, 4321, 8000, len(drive)]
    pieces = [tmp_path / f"piece{n}.log" for n in range(4)]
    for n, piece in enumerate(pieces):
        piece.write_text(candump(drive[cuts[n] : cuts[n + 1]]))
    assert dsz("replay", *pieces, "-c", recorded[1], "-o", tmp_path / "out").code == 0
    pieced = read_results(tmp_path / "out")
    assert pieced.samples["time_s"] == clean.samples["time_s"]
    assert rows_of(pieced) == rows_of(clean)
    assert pieced.summary["channels"] == clean.summary["channels"]


@pytest.fixture(scope="module")
def messages(drive: Sequence[Sent]) -> list[can.Message]:
    """The first 8 s for python-can's writers; one foreign frame on the full second, which ASC counts from."""
    head = Sent(0.0, "can0", 0x7AA, b"\0")
    return [
        can.Message(
            timestamp=START_S + round(frame.t_s * 1e6) / 1e6,
            channel=int(frame.channel[-1]),
            arbitration_id=frame.can_id,
            data=frame.data,
            is_extended_id=False,
        )
        for frame in (head, *drive)
        if frame.t_s < 8.0
    ]


@pytest.fixture(scope="module")
def first_seconds(
    drive: Sequence[Sent], recorded: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory
) -> Replayed:
    from dsz_daemon.runs.replay import replay

    folder = tmp_path_factory.mktemp("first_seconds")
    (folder / "first.log").write_text(candump([frame for frame in drive if frame.t_s < 8.0]))
    replay([folder / "first.log"], recorded[1], folder / "out")
    return read_results(folder / "out")


@pytest.mark.usefixtures("without_report")
@pytest.mark.parametrize("suffix", [".log.gz", ".log.zst", ".asc", ".blf", ".trc", ".mf4"])
def test_every_format_gives_the_same_rows(
    dsz: Dsz,
    drive: Sequence[Sent],
    messages: list[can.Message],
    recorded: tuple[Path, Path],
    first_seconds: Replayed,
    tmp_path: Path,
    suffix: str,
) -> None:
    path = tmp_path / f"first{suffix}"
    text = candump([frame for frame in drive if frame.t_s < 8.0]).encode()
    if suffix == ".log.gz":
        path.write_bytes(gzip.compress(text))
    elif suffix == ".log.zst":
        path.write_bytes(zstandard.ZstdCompressor().compress(text))
    else:
        writer = {".asc": can.ASCWriter, ".blf": can.BLFWriter, ".trc": can.TRCWriter, ".mf4": can.MF4Writer}[suffix]
        with writer(str(path)) as recorder:
            for message in messages:
                recorder.on_message_received(message)
    called = dsz("replay", path, "-c", recorded[1], "-o", tmp_path / "out")
    assert called.code == 0, called.err
    same = read_results(tmp_path / "out")
    assert rows_of(same) == rows_of(first_seconds)


# Onto a bus


@contextmanager
def listening(channel: str) -> Iterator[can.BusABC]:
    with can.Bus(interface="virtual", channel=channel) as bus:
        yield bus


def received(bus: can.BusABC) -> list[can.Message]:
    found = []
    while (message := bus.recv(0.0)) is not None:
        found.append(message)
    return found


@pytest.mark.usefixtures("without_report")
def test_a_replay_is_played_onto_a_bus_at_its_speed(
    dsz: Dsz, drive: Sequence[Sent], recorded: tuple[Path, Path], start_of_drive: Path, tmp_path: Path
) -> None:
    with listening("adversary-to") as bus:
        begin_s = time.monotonic()
        called = dsz(
            "replay", start_of_drive, "-c", recorded[1], "-o", tmp_path, "--to", "virtual:adversary-to", "--speed", "6"
        )
        took_s = time.monotonic() - begin_s
        heard = [(message.arbitration_id, bytes(message.data)) for message in received(bus)]
    assert called.code == 0
    assert took_s > 0.95 * 6.0 / 6.0
    played = [(frame.can_id, frame.data) for frame in drive if frame.t_s < 6.0]
    published = [line.split()[2].split("#") for line in (tmp_path / "compensated.log").read_text().splitlines()]
    own = {can_id for can_id, _ in published}
    # Both in their own order; between them a step's result stands before the frame that came after it.
    assert [frame for frame in heard if f"{frame[0]:03X}" not in own] == played
    assert [[f"{i:03X}", data.hex().upper()] for i, data in heard if f"{i:03X}" in own] == published


@contextmanager
def fed(drive: Sequence[Sent], name: str, seconds: float, more: Sequence[tuple[int, bytes]] = ()) -> Iterator[None]:
    """Plays the drive from 12 s on, as it was sent, onto buses NAME-0 and NAME-1, once somebody is there."""

    def feed() -> None:
        with listening(f"{name}-0") as can0, listening(f"{name}-1") as can1:
            end_s = time.monotonic() + 20.0
            while len(channels[f"{name}-1"]) < 2 and time.monotonic() < end_s:
                time.sleep(0.01)
            begin_s = time.monotonic()
            for frame in (frame for frame in drive if 12.0 <= frame.t_s < 12.0 + seconds):
                time.sleep(max(0.0, frame.t_s - 12.0 - (time.monotonic() - begin_s)))
                bus = can0 if frame.channel == "can0" else can1
                bus.send(can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False))
                if frame.channel == "can0":
                    for can_id, data in more:
                        can0.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    thread = threading.Thread(target=feed)
    thread.start()
    yield
    thread.join()


def test_run_publishes_and_is_deaf_to_itself(
    dsz: Dsz, drive: Sequence[Sent], recorded: tuple[Path, Path], tmp_path: Path
) -> None:
    """Another sender repeats one of our own frames, with a yaw rate of 300 deg/s in it, at every frame of the car."""
    database = cantools.database.load_file(shipped("dbc/dsz.dbc"))
    own_id = min(message.frame_id for message in database.messages)
    arguments = ("--bus", "can0=virtual:adv-run-0", "--bus", "can1=virtual:adv-run-1", "--duration", "1.5")
    with listening("adv-run-0") as bus, fed(drive, "adv-run", 1.3, [(own_id, FORGED)]):
        called = dsz("run", "-c", recorded[1], *arguments, "-o", tmp_path, "--record", tmp_path / "rec.log", "--json")
        heard = received(bus)
    assert called.code == 0
    summary = json.loads(called.out)
    lines = (tmp_path / "rec.log").read_text().splitlines()
    repeated = sum(line.endswith(f"{own_id:03X}#{FORGED.hex().upper()}") for line in lines)
    assert summary["counts"]["own"] == repeated > 100
    assert summary["counts"]["samples"] > 200
    messages = {message.frame_id: message for message in database.messages}
    published = [m for m in heard if m.arbitration_id in messages and m.data != FORGED]
    assert {message.arbitration_id for message in published} == set(messages)
    rates = [messages[own_id].decode(bytes(m.data)) for m in published if m.arbitration_id == own_id]
    assert len(rates) > 10
    # What the car does in these seconds is up to 7 deg/s.
    assert all(str(rate["R"]) == "not_available" or abs(rate["R"]) < 20.0 for rate in rates)
    # A machine that is held up misses ticks: so many are missing from the alive counter (which wraps at 16).
    skipped = sum((b["E2E_COUNTER"] - a["E2E_COUNTER"] - 1) % 16 for a, b in pairwise(rates))
    assert (summary["counts"]["missed"] - skipped) % 16 == 0
    assert all((tmp_path / name).stat().st_size > 0 for name in FOUR_FILES)
    # The record is a recording: all of both buses, and a replay of it makes the same steps.
    assert dsz("replay", tmp_path / "rec.log", "-c", recorded[1], "-o", tmp_path / "again").code == 0
    assert read_results(tmp_path / "again").summary["counts"]["own"] == repeated


def test_a_silent_bus_leaves_the_machine_in_peace(
    dsz: Dsz, drive: Sequence[Sent], recorded: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a gap's second after the last frame on, the daemon waits; it says "silent" ten times a second."""
    from dsz_daemon.edge.bus import Buses

    receive, waits = Buses.receive, []

    def counted(self: Buses, timeout_s: float) -> Any:
        waits.append(time.monotonic())
        return receive(self, timeout_s)

    monkeypatch.setattr(Buses, "receive", counted)
    database = cantools.database.load_file(shipped("dbc/dsz.dbc"))
    own_id = min(message.frame_id for message in database.messages)
    arguments = ("--bus", "can0=virtual:adv-silent-0", "--bus", "can1=virtual:adv-silent-1", "--duration", "2.4")
    with listening("adv-silent-0") as bus, fed(drive, "adv-silent", 0.3):
        called = dsz("run", "-c", recorded[1], *arguments)
        heard = [message for message in received(bus) if message.arbitration_id == own_id]
    assert called.code == 0
    end_s = max(waits)
    assert sum(when > end_s - 0.8 for when in waits) < 30
    late = [database.decode_message(own_id, bytes(m.data)) for m in heard if m.timestamp > heard[-1].timestamp - 0.8]
    assert 4 <= len(late) <= 12
    assert {str(message["R"]) for message in late} == {"not_available"}


def test_sigterm_ends_a_run_with_all_its_files(recorded: tuple[Path, Path], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "dsz_daemon", "run", "-c", str(recorded[1]), "-o", str(tmp_path)]
    process = subprocess.Popen(
        [*command, "--bus", "can0=virtual:x"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    end_s = time.monotonic() + 20.0
    while not (tmp_path / "compensated.log").exists() and time.monotonic() < end_s:
        time.sleep(0.05)
    time.sleep(0.3)
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=20.0)
    assert (process.returncode, err) == (0, "")
    assert "mapped, but never received" in out
    assert all((tmp_path / name).exists() for name in FOUR_FILES)
    assert read_results(tmp_path).summary["rows"] == 0
    assert (tmp_path / "report.html").read_text().rstrip().endswith("</html>")


# Simulated


@pytest.fixture
def short_scenario(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first 7 s of sine_steer: enough to be driven, recorded and replayed."""
    from dsz_daemon.sim import catalogue

    whole = catalogue.SCENARIOS["sine_steer"]
    programme = replace(whole.programme, duration_s=7.0)
    monkeypatch.setitem(catalogue.SCENARIOS, "sine_steer", replace(whole, programme=programme))


@pytest.mark.usefixtures("short_scenario")
def test_simulate_check_replay_and_demo(dsz: Dsz, tmp_path: Path) -> None:
    drive = tmp_path / "drive"
    assert dsz("simulate", "sine_steer", "-o", drive, "--seed", "3").code == 0
    assert {path.name for path in drive.iterdir()} >= {"recording.log", "config.yaml", "truth.parquet"}
    called = dsz("check", drive / "config.yaml")
    assert called.code == 0
    assert called.out.startswith(f"{drive / 'config.yaml'}: good; ")
    called = dsz(
        "replay", drive / "recording.log", "-c", drive / "config.yaml", "-o", tmp_path / "out",
        "--truth", drive / "truth.parquet", "--json",
    )  # fmt: skip
    assert called.code == 0
    truth = json.loads(called.out)["truth"]
    assert set(truth) == set(OFFSETS)
    called = dsz("demo", "-o", tmp_path / "demo", "--seed", "3", "--speed", "10")
    assert called.code == 0
    assert f"report: {tmp_path / 'demo' / 'report.html'}" in called.out
    # The demonstration is live: the same drive, the same rows as the replay's, but that its clock may go on a step.
    live, again = rows_of(read_results(tmp_path / "demo")), rows_of(read_results(tmp_path / "out"))
    steps = len(again["event"])
    assert len(live["event"]) - steps in {0, 1}
    assert {name: column[:steps] for name, column in live.items()} == again
