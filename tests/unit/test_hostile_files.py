"""Files made to hurt whoever reads them: each ends in one clear message, in bounded time and memory."""

# ruff: noqa: E501 - files stand as they are written

from __future__ import annotations

import json
import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest

from dsz_daemon.config.check import check_configuration
from dsz_daemon.config.load import load_settings
from dsz_daemon.edge import dbc
from dsz_daemon.edge.dbc import load_dbc
from dsz_daemon.edge.logs import LogReport, read_frames
from dsz_daemon.errors import ConfigError, DszError, Fault, InputError
from dsz_daemon.pipeline.decode import Decoder
from dsz_daemon.runs.setup import set_up

VEHICLE = """\
vehicle: {mass_kg: 1673, yaw_inertia_kgm2: 2850, cg_to_front_axle_m: 1.149, cg_to_rear_axle_m: 1.491,
  front_cornering_stiffness_n_per_rad: 62000, rear_cornering_stiffness_n_per_rad: 68000}
"""
GOOD_DBC = 'VERSION ""\nBO_ 36 K: 8 X\n SG_ R : 0|16@1- (0.01,0) [-327|327] "deg/s" X\n'
# Nine to the ninth: 387 million words, out of 500 bytes.
LAUGHS = "".join(
    f"{name}: &{name} [{', '.join(['x' if i == 0 else '*' + 'abcdefghi'[i - 1]] * 9)}]\n"
    for i, name in enumerate("abcdefghi")
)


def refused(folder: Path, text: str | bytes) -> ConfigError:
    path = folder / "config.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigError) as caught:
        check_configuration(path)
    return caught.value


def decoder(path: Path) -> Decoder:
    prepared = set_up(path)
    return prepared.decoder(prepared.encoder())


@pytest.mark.parametrize(
    "use",
    [
        "signals: {dbc: *i, gyro_z: {message: *i, signal: *i, unit: *i}}",
        "signals: {wheel_speed_fl: {message: m, signals: *i, unit: *i}, wheel_speed_fr: {message: m, signals: *i}}",
        "bus: {can0: {interface: virtual, more: *i}}",
        "diagnose: {tolerance: {mass_kg: *i}}",
    ],
)
def test_a_billion_laughs_are_one_short_refusal(tmp_path, use):
    error = refused(tmp_path, LAUGHS + VEHICLE + use)
    assert "unfolds to more than 100000 values" in str(error)
    assert len(str(error)) < 500


def test_an_alias_that_is_used_a_few_times_is_welcome(tmp_path):
    (tmp_path / "car.dbc").write_text(GOOD_DBC)
    text = (
        VEHICLE
        + "signals: {dbc: car.dbc, gyro_z: &z {message: K, signal: R, unit: deg/s}, yaw_rate_reference: {<<: *z, sign: -1}}"
    )
    assert "is the same signal as gyro_z (K.R)" in str(refused(tmp_path, text))


def test_twenty_thousand_unknown_keys_are_told_as_two_hundred_and_how_many_more(tmp_path):
    keys = ", ".join(f"k{i}: 1" for i in range(20_000))
    error = refused(tmp_path, VEHICLE + f"signals: {{dbc: car.dbc, {keys}}}")
    assert len(error.faults) < 410
    assert "19800 faults more" in str(error)


def test_a_key_of_any_length_makes_a_line_that_one_can_read(tmp_path):
    error = refused(tmp_path, VEHICLE + "signals: {" + "k" * 100_000 + ": {}, dbc: x}")
    assert max(map(len, str(error).splitlines())) < 1000


@pytest.mark.parametrize("key", ["base_id", "spare_base_id"])
def test_output_ids_that_are_none_are_found_by_the_check(tmp_path, key):
    (tmp_path / "car.dbc").write_text(GOOD_DBC)
    good = VEHICLE + "signals: {dbc: car.dbc, gyro_z: {message: K, signal: R, unit: deg/s}}\n"
    error = refused(tmp_path, good + f"output: {{{key}: 0x9900}}")
    assert f"output.{key}: 0x9900 is too high for 11-bit ids; expected 0 to 0x7F0" in str(error)
    error = refused(tmp_path, good + f"output: {{{key}: 0x1FFFFFFF, extended: true}}")
    assert f"output.{key}: 0x1FFFFFFF is too high for 29-bit ids; expected 0 to 0x1FFFFFF0" in str(error)
    (tmp_path / "config.yaml").write_text(good + f"output: {{{key}: 0x9900, extended: true}}")
    assert decoder(tmp_path / "config.yaml").wanted_ids() == {(36, False)}


@pytest.mark.parametrize("number", ["0x" + "f" * 5000, "-" + "9" * 5000, "0o" + "7" * 20_000, "0x" + "f" * 900_000])
@pytest.mark.parametrize("place", ["mass_kg: 1673", "dbc: imu.dbc", "message: K"])
def test_a_whole_number_of_thousands_of_digits_is_refused_in_short(tmp_path, number, place):
    good = VEHICLE + "signals: {dbc: imu.dbc, gyro_z: {message: K, signal: R, unit: deg/s}}"
    error = refused(tmp_path, good.replace(place, f"{place.partition(':')[0]}: {number}"))
    assert max(map(len, str(error).splitlines())) < 300


@pytest.mark.parametrize("repeated", ["a: &a [xxxxxxxx" + ", xxxxxxxx" * 5000 + "]", f"a: &a {{{'x' * 50_000}: 1}}"])
def test_a_message_name_that_is_no_name_is_not_quoted(tmp_path, repeated):
    source = "{message: *a, signal: *a, unit: deg/s}"
    error = refused(tmp_path, f"{repeated}\n{VEHICLE}signals: {{dbc: x, gyro_x: {source}, gyro_y: {source}}}")
    assert max(map(len, str(error).splitlines())) < 300


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ("signal: null", "signal is missing; expected signal: NAME"),
        ("signal: R, valid_signal: null, valid_values: [1]", "valid_values: is given without valid_signal"),
        ("signal: R, volts_per_count: null, volts_per_unit: 1", "volts_per_unit: is only a part of an ADC's scale"),
        ("signal: R, volts_per_count: 1, volts_per_unit: null", "volts_per_count: is only a part of an ADC's scale"),
    ],
)
def test_a_key_without_a_value_is_as_good_as_none(tmp_path, source, fault):
    (tmp_path / "car.dbc").write_text(GOOD_DBC)
    error = refused(tmp_path, VEHICLE + f"signals: {{dbc: car.dbc, gyro_z: {{message: K, {source}, unit: deg/s}}}}")
    assert len(error.faults) == 1
    assert fault in str(error)


@pytest.mark.parametrize("text", ["\x1b]0;title\a", "\x1b[2J", "\u202e", "a\nb", "\x9b31m"])
def test_no_word_of_a_file_reaches_the_terminal_as_an_order(tmp_path, text):
    for error in (
        refused(tmp_path, VEHICLE + f"signals: {{dbc: {json.dumps(text)}, {json.dumps(text)}: 1}}"),
        DszError(f"file {text}", [Fault(text, text)]),
    ):
        assert all(line.isprintable() for line in str(error).split("\n"))
        assert str(error).count("\n") <= len(error.faults) + 1


@pytest.mark.parametrize(
    "name",
    [
        "pkg:__main__/a.dbc",
        "~nobody_of_that_name/a.dbc",
        "a\0b",
        "a" * 5000,
        "pkg:can/" + "a" * 5000,
        "\ud800",
        "/",
        "..",
    ],
)
def test_a_dbc_name_that_is_none_is_a_configuration_error(tmp_path, name):
    with pytest.raises(ConfigError):
        load_dbc(name, tmp_path)


@pytest.mark.parametrize("content", [b"\xa0\xa0", b"\x1c\n", b"\xef\xbb\xbf \n", "\u2003".encode()])
def test_a_dbc_of_nothing_but_odd_blanks_is_empty(tmp_path, content):
    (tmp_path / "car.dbc").write_bytes(content)
    with pytest.raises(InputError, match="empty"):
        load_dbc("car.dbc", tmp_path)


@pytest.mark.parametrize("file", ["../secret.dbc", "/etc/hostname", "sub/x.dbc", "a" * 300, "\x1b[2J"])
def test_a_dbc_imports_only_what_lies_beside_it(tmp_path, file):
    (tmp_path / "secret.dbc").write_text("the secret")
    folder = tmp_path / "car"
    folder.mkdir()
    (folder / "car.dbc").write_text(f'CM_ "IMPORT {file}";\n{GOOD_DBC}')
    with pytest.raises(InputError) as caught:
        load_dbc("car.dbc", folder)
    assert "the secret" not in str(caught.value)
    assert "imports" in str(caught.value)


def test_an_import_that_is_named_a_thousand_times_is_read_once(tmp_path):
    (tmp_path / "part.dbc").write_text('BO_ 37 S: 8 X\n SG_ A : 0|8@1+ (1,0) [0|1] "" X\n')
    (tmp_path / "car.dbc").write_text('CM_ "IMPORT part.dbc";\n' * 1000 + GOOD_DBC)
    loaded = load_dbc("car.dbc", tmp_path)
    assert [message.name for message in loaded.database.messages] == ["S", "K"]


def test_a_message_that_is_there_twice_prints_nothing(tmp_path):
    # In a process of its own: here the test runner has set logging up.
    (tmp_path / "car.dbc").write_text(GOOD_DBC + GOOD_DBC.partition("\n")[2])
    code = "from pathlib import Path; from dsz_daemon.edge.dbc import load_dbc; load_dbc('car.dbc', Path())"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b"", b"")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0|16@", "0|4294967295@"),
        ("0|16@", f"{'9' * 5000}|16@"),
        ("0|16@", "0 | 99999999 @"),
        ("K: 8", "K: 4294967295"),
        ("K: 8", f"K: {'9' * 5000}"),
    ],
)
def test_a_dbc_with_more_bits_than_any_bus_has_is_refused_at_once(tmp_path, old, new):
    assert old in GOOD_DBC
    (tmp_path / "car.dbc").write_text(GOOD_DBC.replace(old, new))
    with pytest.raises(InputError, match="expected at most") as caught:
        load_dbc("car.dbc", tmp_path)
    assert len(str(caught.value)) < 200


def test_multiplexer_ranges_of_millions_are_refused_at_once(tmp_path):
    text = 'BO_ 5 M: 8 X\n SG_ S M : 0|32@1+ (1,0) [0|0] "" X\n SG_ V m0 : 32|8@1+ (1,0) [0|0] "" X\nSG_MUL_VAL_ 5 V S RANGE;\n'
    (tmp_path / "car.dbc").write_text(text.replace("RANGE", "0-4, 8-9"))
    assert len(load_dbc("car.dbc", tmp_path).database.messages[0].signals[1].multiplexer_ids) == 7
    (tmp_path / "car.dbc").write_text(text.replace("RANGE", "0-4294967295"))
    with pytest.raises(InputError, match="multiplexer values"):
        load_dbc("car.dbc", tmp_path)


@pytest.mark.parametrize("place", ["0|0@1+", "7|0@0-", "-8|8@0+", "0|513@1+"])
def test_a_signal_that_is_in_no_frame_is_no_signal(tmp_path, place):
    (tmp_path / "car.dbc").write_text(GOOD_DBC.replace("0|16@1-", place))
    (tmp_path / "config.yaml").write_text(
        VEHICLE + "signals: {dbc: car.dbc, gyro_z: {message: K, signal: R, unit: deg/s}}"
    )
    with pytest.raises(DszError):
        decoder(tmp_path / "config.yaml")


def test_a_page_of_a_multiplexer_that_is_not_there_is_a_fault_of_its_signal(tmp_path):
    (tmp_path / "car.dbc").write_text('BO_ 5 M: 8 X\n SG_ V m0 : 32|8@1+ (1,0) [0|0] "" X\nSG_MUL_VAL_ 5 V GONE 0-4;\n')
    (tmp_path / "config.yaml").write_text(
        VEHICLE + "signals: {dbc: car.dbc, gyro_z: {message: M, signal: V, unit: deg/s}}"
    )
    with pytest.raises(DszError, match="GONE"):
        decoder(tmp_path / "config.yaml")


def test_a_line_of_a_dbc_of_any_length_is_quoted_in_short(tmp_path):
    (tmp_path / "car.dbc").write_text(GOOD_DBC.replace("0|16@1-", "0|16@1- ((" + "x" * 50_000))
    with pytest.raises(InputError) as caught:
        load_dbc("car.dbc", tmp_path)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("piece", [":()[]", ":()", ":(", '(1)[2]"3"', ':(1)[]""', ' "'])
def test_a_last_line_of_any_brackets_is_judged_at_once(tmp_path, piece):
    # A pattern that tried all ways to read them took a minute for four hundred of the first, and days for these.
    (tmp_path / "car.dbc").write_text(GOOD_DBC + " SG_ A" + piece * 20_000)
    with pytest.raises(InputError) as caught:
        load_dbc("car.dbc", tmp_path)
    assert "cut short" in str(caught.value) or "can't be read" in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("end", [1, 10, 20, 30, 37])
def test_a_last_signal_that_is_cut_is_noticed(tmp_path, end):
    last = ' SG_ R : 0|16@1- (0.01,0) [-327|327] "deg/s" X'
    cut = last[: len(last) - end]
    (tmp_path / "car.dbc").write_text(GOOD_DBC.replace(last, cut))
    with pytest.raises(InputError, match="cut short"):
        load_dbc("car.dbc", tmp_path)


@pytest.mark.parametrize("key", ["BO_", "SG_MUL_VAL_", "SIG_VALTYPE_"])
def test_an_id_of_thousands_of_digits_is_no_id(tmp_path, key):
    (tmp_path / "car.dbc").write_text(GOOD_DBC + f"{key} {'9' * 5000} K: 8 X\n")
    with pytest.raises(InputError, match="can't be read") as caught:
        load_dbc("car.dbc", tmp_path)
    assert len(str(caught.value)) < 500


def test_a_dbc_that_never_ends_is_not_read(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe.dbc")
    for name in ("pipe.dbc", "/dev/zero"):
        with pytest.raises(InputError, match="is no file"):
            load_dbc(name, tmp_path)
    monkeypatch.setattr(dbc, "_MOST_BYTES", 1000)
    (tmp_path / "car.dbc").write_text(GOOD_DBC + "\n" * 1000)
    with pytest.raises(InputError, match="more than"):
        load_dbc("car.dbc", tmp_path)


def test_a_configuration_from_a_device_ends_at_a_megabyte(tmp_path):
    with pytest.raises(ConfigError, match="more than 1 MB"):
        load_settings(Path("/dev/zero"))


@pytest.mark.parametrize("kind", ["gz", "zst"])
def test_a_recording_that_unfolds_a_thousandfold_stays_small_in_memory(tmp_path, kind):
    line = b"(1700000000.000000) can0 123#00\n"
    if kind == "gz":
        import gzip

        data = gzip.compress(line + b"\0" * 200_000_000)
    else:
        zstandard = pytest.importorskip("zstandard", reason="zstandard is not installed")
        data = zstandard.compress(line + b"\0" * 200_000_000)
    path = tmp_path / f"bomb.log.{kind}"
    path.write_bytes(data)
    tracemalloc.start()
    try:
        report = LogReport()
        assert len(list(read_frames([path], report))) == 1
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 64 * 2**20
