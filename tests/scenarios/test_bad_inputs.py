"""What a user gets for bad input: the exit code, one clear message, and all that could be read."""

from __future__ import annotations

import gzip
import json
import random
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest
import short_drive as sd
from scenario_results import Called, read_results
from short_drive import CONFIG, DBC, Sent, candump, edited

Dsz = Callable[..., Called]
FOUR_FILES = ("samples.parquet", "compensated.log", "summary.json", "report.html")
pytestmark = pytest.mark.usefixtures("without_report")


def configured(folder: Path, *edits: tuple[str, str], dbc: str | None = DBC) -> Path:
    """The drive's configuration with these edits, and its DBC, in a folder of their own."""
    folder.mkdir(parents=True, exist_ok=True)
    if dbc is not None:
        (folder / "car.dbc").write_text(dbc)
    path = folder / "config.yaml"
    path.write_text(edited(CONFIG, *edits))
    return path


def refused(called: Called, code: int, *words: str) -> None:
    """One message on standard error, with these words in it, and nothing on standard output."""
    assert called.code == code, called.err
    assert called.err.startswith("dsz: ")
    assert called.err.count("dsz: ") == 1
    for word in words:
        assert word in called.err, f"{word!r} is not in {called.err!r}"
    assert called.out == ""


def replayed(dsz: Dsz, folder: Path, sent: Sequence[Sent], config: str = CONFIG) -> dict[str, Any]:
    """Summary of a replay that must do its job."""
    log, path = sd.write(folder, sent, config)
    called = dsz("replay", log, "-c", path, "-o", folder / "out", "--json")
    assert called.code == 0, called.err
    summary: dict[str, Any] = json.loads(called.out)
    return summary


# Recordings


def test_a_recording_that_is_not_there(dsz: Dsz, recorded: tuple[Path, Path], tmp_path: Path) -> None:
    called = dsz("replay", tmp_path / "nope.log", "-c", recorded[1], "-o", tmp_path / "out")
    refused(called, 3, f"{tmp_path / 'nope.log'}: no such file")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty; expected candump text"),
        (None, "is a folder; expected a file"),
        (random.Random(1).randbytes(20_000), "no CAN frame in it; line 1 reads"),
        (b"rubbish\n" * 9, "no CAN frame in it; line 1 reads 'rubbish'; expected (epoch.seconds) channel ID#DATA"),
    ],
    ids=["empty", "folder", "junk", "text"],
)
def test_what_is_no_recording(
    dsz: Dsz, recorded: tuple[Path, Path], tmp_path: Path, content: bytes | None, words: str
) -> None:
    log = tmp_path / "drive.log"
    log.mkdir() if content is None else log.write_bytes(content)
    refused(dsz("replay", log, "-c", recorded[1], "-o", tmp_path / "out"), 3, str(log), words)


def test_several_bad_pieces_are_said_at_once(
    dsz: Dsz, recorded: tuple[Path, Path], start_of_drive: Path, tmp_path: Path
) -> None:
    (tmp_path / "empty.log").touch()
    called = dsz(
        "replay", start_of_drive, tmp_path / "empty.log", tmp_path / "gone.log", "-c", recorded[1], "-o", tmp_path
    )
    refused(called, 3, "2 of 3 recordings can't be read", "empty.log: is empty", "gone.log: no such file")


def test_a_recording_cut_in_the_middle_of_a_line(
    dsz: Dsz, recorded: tuple[Path, Path], drive: Sequence[Sent], tmp_path: Path
) -> None:
    lines = candump(drive[:2000])
    (tmp_path / "cut.log").write_text(lines[: lines.rindex("#")])  # a last line without its data
    called = dsz("replay", tmp_path / "cut.log", "-c", recorded[1], "-o", tmp_path / "out")
    assert called.code == 0
    assert "warning: 1 piece(s) of the recording end in the middle of a line" in called.out
    assert read_results(tmp_path / "out").summary["counts"]["frames"] == 1999


def test_a_compressed_recording_cut_in_the_middle(
    dsz: Dsz, recorded: tuple[Path, Path], drive: Sequence[Sent], tmp_path: Path
) -> None:
    packed = gzip.compress(candump(drive[:2000]).encode())
    (tmp_path / "cut.log.gz").write_bytes(packed[: len(packed) // 2])
    called = dsz("replay", tmp_path / "cut.log.gz", "-c", recorded[1], "-o", tmp_path / "out")
    assert called.code == 0
    assert "warning: cut.log.gz is not whole: its compressed data is cut off; read as far as that" in called.out
    # Half of the bytes hold at least a third of the frames of so regular a text.
    assert 2000 / 3 < read_results(tmp_path / "out").summary["counts"]["frames"] < 2000


def test_time_that_goes_backwards(dsz: Dsz, drive: Sequence[Sent], tmp_path: Path) -> None:
    summary = replayed(dsz, tmp_path, [f._replace(t_s=f.t_s - 5.0 * (f.t_s > 6.0)) for f in drive if f.t_s < 9.0])
    assert summary["counts"]["clock_steps"] == 1
    assert [event["event"] for event in summary["events"]] == ["clock_step"]
    assert any(re.match(r"stamps go backwards 1 times, by up to 4\.99", word) for word in summary["warnings"])
    # All frames of both stretches are used: 6 s and the 3 s after the step, at 50 Hz.
    assert summary["rows"] == pytest.approx(450, abs=2)


def test_pieces_in_the_wrong_order(
    dsz: Dsz, recorded: tuple[Path, Path], drive: Sequence[Sent], tmp_path: Path
) -> None:
    (tmp_path / "a.log").write_text(candump(drive[:1000]))
    (tmp_path / "b.log").write_text(candump(drive[1000:2000]))
    called = dsz(
        "replay", tmp_path / "b.log", tmp_path / "a.log", "-c", recorded[1], "-o", tmp_path / "out"
    )  # fmt: skip
    assert called.code == 0
    assert "warning: a.log starts" in called.out
    assert "expected the pieces in the order of time" in called.out


@pytest.mark.parametrize(
    ("changed", "words"),
    [({"can_id": 0x7AA}, "(channels can0, can1)"), ({"channel": "vcan7"}, "(channels vcan7)")],
    ids=["other ids", "other channel"],
)
def test_a_recording_without_any_wanted_frame(
    dsz: Dsz,
    recorded: tuple[Path, Path],
    drive: Sequence[Sent],
    tmp_path: Path,
    changed: dict[str, Any],
    words: str,
) -> None:
    (tmp_path / "other.log").write_text(candump([frame._replace(**changed) for frame in drive[:300]]))
    called = dsz("replay", tmp_path / "other.log", "-c", recorded[1], "-o", tmp_path / "out")
    refused(called, 3, "other.log", "none of its 300 frames", words, "expected ids 025, 0AA, 224, 310, 311")


def test_a_recording_too_short_for_one_step(
    dsz: Dsz, recorded: tuple[Path, Path], drive: Sequence[Sent], tmp_path: Path
) -> None:
    (tmp_path / "one.log").write_text(candump(drive[:1]))
    called = dsz("replay", tmp_path / "one.log", "-c", recorded[1], "-o", tmp_path / "out")
    refused(called, 3, "one.log: too short: 3 values")


def test_a_piece_that_fails_later_loses_nothing_of_those_before(
    dsz: Dsz, recorded: tuple[Path, Path], start_of_drive: Path, tmp_path: Path
) -> None:
    (tmp_path / "junk.log").write_text("rubbish\n")
    called = dsz("replay", start_of_drive, tmp_path / "junk.log", "-c", recorded[1], "-o", tmp_path / "out")
    refused(called, 3, "junk.log: no CAN frame in it")
    assert pyarrow.parquet.read_table(tmp_path / "out" / "samples.parquet").num_rows == pytest.approx(300, abs=2)
    assert (tmp_path / "out" / "compensated.log").read_text().endswith("\n")


# DBC and signals


@pytest.mark.parametrize(
    ("dbc", "code", "words"),
    [
        ("BO_ 12 X: 8 CAR\n SG_ nonsense\n", 3, "car.dbc: is cut short"),
        ("hello", 3, "car.dbc: can't be read: Invalid syntax at line 1"),
        ("", 3, "car.dbc: is empty"),
        (None, 2, "car.dbc: no such file"),
    ],
    ids=["cut", "no dbc", "empty", "missing"],
)
@pytest.mark.parametrize("verb", ["check", "replay"])
def test_a_dbc_that_cannot_be_read(
    dsz: Dsz, start_of_drive: Path, tmp_path: Path, verb: str, dbc: str | None, code: int, words: str
) -> None:
    config = configured(tmp_path / "c", dbc=dbc)
    arguments = (config,) if verb == "check" else (start_of_drive, "-c", config, "-o", tmp_path / "out")
    refused(dsz(verb, *arguments), code, f"{config}", "config.yaml:13: signals.dbc: ", words)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (
            ("signal: BRAKE_ON", "signal: BRAKE_NO"),
            "config.yaml:25: signals.brake.signal: message 'PEDALS' has no signal 'BRAKE_NO'; did you mean 'BRAKE_ON'?",
        ),
        (
            ("message: STEERING,", "message: STERING,"),
            "config.yaml:24: signals.steering_wheel_angle.message: message 'STERING' is not in car.dbc; "
            "did you mean 'STEERING'?",
        ),
        (("  gyro_y:", "  gyro_x:"), "config.yaml:15: signals.gyro_x: is mapped twice; a role has one source"),
        (("signal: Q,", "signal: P,"), "config.yaml:15: signals.gyro_y: is the same signal as gyro_x (IMU_RATES.P)"),
        (
            ("  mass_kg: 1673", "  mass_kgs: 1673"),
            "config.yaml:2: vehicle.mass_kgs: unknown key 'mass_kgs'; did you mean 'mass_kg'?",
        ),
        (("rate_hz: 50", "rate_hz: 0"), "config.yaml:29: loop.rate_hz: 0 is not a rate; expected 20 to 500 Hz"),
        (("rate_hz: 50", "rate_hz: 500.1"), "loop.rate_hz: 500.1 is not a rate; expected 20 to 500 Hz"),
        (("rate_hz: 50", "rate_hz: fast"), "loop.rate_hz: 'fast' is not a number; expected 20 to 500 Hz"),
        (
            ("loop:", "output: {base_id: 0x30E}\nloop:"),
            "output.base_id: 0x30E gives our own messages the ids of IMU_RATES (0x310)",
        ),
    ],
    ids=["signal", "message", "two IMUs", "one signal twice", "key", "0 Hz", "500.1 Hz", "fast", "own ids"],
)
def test_a_fault_of_the_configuration(dsz: Dsz, tmp_path: Path, edit: tuple[str, str], words: str) -> None:
    config = configured(tmp_path, edit)
    refused(dsz("check", config), 2, str(config), words)


def test_all_faults_are_said_at_once(dsz: Dsz, tmp_path: Path) -> None:
    config = configured(
        tmp_path,
        ("mass_kg: 1673", "mass_kg: -5"),
        ("driven_axle: front", "driven_axel: front"),
        ("signal: BRAKE_ON", "signal: BRAKE_NO"),
        ("  gyro_y:", "  gyro_x:"),
        ("signal: AX, unit: m/s^2", "signal: AX, unit: km/h"),
        ("rate_hz: 50", "rate_hz: 5"),
    )
    called = dsz("check", config)
    refused(called, 2, "config.yaml: 6 faults in the configuration")
    places = ("vehicle.mass_kg", "driven_axel", "signals.gyro_x", "signals.accel_x.unit", "signals.brake.signal")
    lines = called.err.splitlines()[1:]
    assert [place in line for place, line in zip((*places, "loop.rate_hz"), lines, strict=True)] == [True] * 6


def test_500_hz_is_not_too_much(dsz: Dsz, drive: Sequence[Sent], tmp_path: Path) -> None:
    summary = replayed(
        dsz, tmp_path, [f for f in drive if f.t_s < 2.0], edited(CONFIG, ("rate_hz: 50", "rate_hz: 500"))
    )
    assert summary["rows"] == pytest.approx(1000, abs=10)
    assert summary["warnings"] == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vehicle: {mass_kg: 3\nsignals: [\n", ":2:8: not valid YAML: expected ',' or '}'"),
        ("vehicle:\n\tmass_kg: 3\n", ":2:1: not valid YAML: found character '\\t'"),
        ("", ": is empty; expected the sections vehicle and signals"),
        ("- 1\n- 2\n", ": holds a list; expected the sections vehicle and signals"),
        ("vehicle: \xe9\n".encode("latin-1"), ": is not UTF-8 text (byte 0xe9 at offset 9)"),
    ],
    ids=["bracket", "tab", "empty", "list", "latin-1"],
)
def test_a_file_that_is_no_configuration(dsz: Dsz, tmp_path: Path, text: str | bytes, words: str) -> None:
    config = tmp_path / "config.yaml"
    config.write_bytes(text if isinstance(text, bytes) else text.encode())
    refused(dsz("check", config), 2, f"{config}{words}")


def test_a_configuration_that_is_not_there(dsz: Dsz, recorded: tuple[Path, Path], tmp_path: Path) -> None:
    near = recorded[1].with_name("confg.yaml")
    refused(dsz("check", near), 2, f"{near}: no such file; did you mean 'config.yaml'?")
    called = dsz("replay", recorded[0], "-c", tmp_path / "config.yaml", "-o", tmp_path / "out")
    refused(called, 2, f"{tmp_path / 'config.yaml'}: no such file")


@pytest.mark.parametrize("method", ["as_printed: true, c_y: 3", "c_y: 3"])
def test_an_unstable_tuning(dsz: Dsz, tmp_path: Path, method: str) -> None:
    """With c_y > 1 and a gain above the observer's poles, e_y feeds itself through K2: c v K2 = c > 1 in (37)."""
    tuning = f"estimator: {{{method}, lateral: {{window_s: 1, gain_limit_per_s: 1000}}}}"
    config = configured(tmp_path, ("loop:", f"{tuning}\nloop:"))
    refused(dsz("check", config), 2, "config.yaml:29: estimator: not stable", "c_y 3", "expected all below 0")
    slow = configured(tmp_path / "slow", ("loop:", "estimator: {c_y: 1}\nloop:"))
    assert dsz("check", slow).code == 0


# Where results go


@pytest.mark.parametrize("verb", ["replay", "run", "simulate"])
@pytest.mark.parametrize("where", ["below a file", "a file", "read-only"])
def test_a_folder_that_cannot_be_written(
    dsz: Dsz, recorded: tuple[Path, Path], start_of_drive: Path, tmp_path: Path, verb: str, where: str
) -> None:
    (tmp_path / "file").write_text("precious")
    out = {"below a file": tmp_path / "file" / "out", "a file": tmp_path / "file", "read-only": Path("/proc/dsz")}[
        where
    ]
    arguments: dict[str, tuple[object, ...]] = {
        "replay": (start_of_drive, "-c", recorded[1]),
        "run": ("-c", recorded[1], "--duration", "0.2"),
        "simulate": ("sine_steer",),
    }
    called = dsz(verb, *arguments[verb], "-o", out)
    assert called.code == 4
    assert f"dsz: {out}: can't write results here: " in called.err
    assert (tmp_path / "file").read_text() == "precious"


def test_results_never_replace_their_own_recording(
    dsz: Dsz, recorded: tuple[Path, Path], start_of_drive: Path, tmp_path: Path
) -> None:
    log = tmp_path / "compensated.log"
    log.write_bytes(start_of_drive.read_bytes())
    called = dsz("replay", log, "-c", recorded[1], "-o", tmp_path)
    refused(called, 2, f"{log}: the results would be written over it", "expected another folder")
    assert log.read_bytes() == start_of_drive.read_bytes()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here to stand for a full disk")
def test_a_disk_that_is_full(dsz: Dsz, recorded: tuple[Path, Path], start_of_drive: Path, tmp_path: Path) -> None:
    (tmp_path / "compensated.log").symlink_to("/dev/full")
    (tmp_path / "summary.json").write_text("of an older run")
    called = dsz("replay", start_of_drive, "-c", recorded[1], "-o", tmp_path)
    refused(called, 4, f"{tmp_path / 'compensated.log'}: can't be written (No space left on device)")
    assert pyarrow.parquet.read_table(tmp_path / "samples.parquet").num_rows > 0
    assert not (tmp_path / "summary.json").exists(), "an older run's summary stands beside this one's rows"


def test_a_truth_that_is_not_there_is_found_before_the_run(
    dsz: Dsz, recorded: tuple[Path, Path], start_of_drive: Path, tmp_path: Path
) -> None:
    called = dsz("replay", start_of_drive, "-c", recorded[1], "-o", tmp_path / "out", "--truth", tmp_path / "t.parquet")
    refused(called, 3, f"{tmp_path / 't.parquet'}: no such file")
    assert not (tmp_path / "out").exists()


# The command line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("rpelay",), "invalid choice: 'rpelay' (choose from 'run', 'replay', "),
        ((), "the following arguments are required: VERB; see `dsz --help`"),
        (("replay", "LOG", "-c", "CONFIG", "-o", "OUT", "--sped", "1"), "unrecognized arguments: --sped 1"),
        (("replay", "LOG", "-o", "OUT"), "required: -c/--config; see `dsz replay --help`"),
        (("replay", "-c", "CONFIG", "-o", "OUT"), "required: LOG"),
        (("replay", "LOG", "-c", "CONFIG", "-o", "OUT", "--speed", "0"), "--speed: '0' is not a number above 0"),
        (("run", "-c", "CONFIG", "--duration", "inf"), "argument --duration: 'inf' is not a number above 0"),
        (("run", "-c", "CONFIG", "--bus", "can0"), "--bus can0: expected NAME=INTERFACE:CHANNEL, e.g. can0="),
        (("run", "-c", "CONFIG", "--bus", "can0=virtual"), "--bus can0=virtual: expected NAME=INTERFACE:CHANNEL"),
        (("run", "-c", "CONFIG", "--bus", "can0=a:b", "--bus", "can0=c:d"), "can0=c:d: bus 'can0' is given twice"),
        (
            ("run", "-c", "CONFIG", "--bus", "can0=nosuch:x", "--duration", "0.1"),
            'bus can0: nosuch channel x did not open: Unknown interface type "nosuch"; expected a python-can interface',
        ),
        (("replay", "LOG", "-c", "CONFIG", "-o", "OUT", "--to", "nosuch:x"), 'Unknown interface type "nosuch"'),
        (("replay", "LOG", "-c", "CONFIG", "-o", "OUT", "--to", ""), "--to '': expected a SocketCAN interface, or "),
        (("simulate", "sine", "-o", "OUT"), "unknown scenario 'sine'; did you mean 'sine_steer'?"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_a_bad_command_line(
    dsz: Dsz,
    recorded: tuple[Path, Path],
    start_of_drive: Path,
    tmp_path: Path,
    arguments: tuple[str, ...],
    words: str,
) -> None:
    paths = {"LOG": start_of_drive, "CONFIG": recorded[1], "OUT": tmp_path / "out"}
    refused(dsz(*(paths.get(argument, argument) for argument in arguments)), 2, words)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="SocketCAN is Linux's")
def test_a_bus_that_is_not_there(dsz: Dsz, recorded: tuple[Path, Path], start_of_drive: Path, tmp_path: Path) -> None:
    called = dsz("run", "-c", recorded[1], "--bus", "can0=socketcan:nosuch0", "--duration", "0.1")
    refused(called, 4, "bus can0: socketcan channel nosuch0 did not open: ", "is the interface up?")
    called = dsz("replay", start_of_drive, "-c", recorded[1], "-o", tmp_path, "--to", "nosuch0")
    refused(called, 4, "socketcan channel nosuch0 did not open: ")
