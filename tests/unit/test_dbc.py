"""DBC files: where they are found, what is let pass in them, what is refused."""

import importlib
import sys
from pathlib import Path

import pytest

from dsz_daemon.edge.dbc import load_dbc, locate_dbc
from dsz_daemon.errors import ConfigError, InputError

GOOD = """\
VERSION ""
BO_ 36 KINEMATICS: 8 X
 SG_ YAW_RATE : 0|16@1- (0.01,0) [-327|327] "deg/s" X
"""


@pytest.fixture
def write(tmp_path: Path):
    def write_file(content: str | bytes, name: str = "car.dbc") -> Path:
        raw = content if isinstance(content, bytes) else content.encode()
        (tmp_path / name).write_bytes(raw)
        return tmp_path

    return write_file


@pytest.fixture
def package(tmp_path: Path, monkeypatch):
    """A package with DBC files, whose code must not run."""
    root = tmp_path / "site" / "cardata"
    (root / "dbc" / "old").mkdir(parents=True)
    (root / "__init__.py").write_text("raise RuntimeError('imported')\n")
    (root / "dbc" / "car_2015.dbc").write_text(GOOD)
    (root / "dbc" / "twice.dbc").write_text(GOOD)
    (root / "dbc" / "old" / "twice.dbc").write_text(GOOD)
    (root / "dbc" / "_common.dbc").write_text(GOOD)
    (root / "dbc" / "whole.dbc").write_text(
        'CM_ "IMPORT _common.dbc";\nBO_ 37 STEER: 8 X\n SG_ A : 0|8@1+ (1,0) [0|1] "" X\n'
        'CM_ SG_ 36 YAW_RATE "of the other file";\n'
    )
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    importlib.invalidate_caches()
    return root


def names(loaded) -> list[str]:
    return [message.name for message in loaded.database.messages]


def test_a_path_is_relative_to_the_configuration(write):
    loaded = load_dbc("car.dbc", write(GOOD))
    assert names(loaded) == ["KINEMATICS"]
    assert loaded.warnings == ()


def test_a_package_is_found_but_not_imported(package):
    assert names(load_dbc("pkg:cardata/dbc/car_2015.dbc", Path("/nowhere"))) == ["KINEMATICS"]
    assert "cardata" not in sys.modules


def test_the_files_name_alone_is_enough(package):
    assert locate_dbc("pkg:cardata/car_2015.dbc", Path()) == package / "dbc" / "car_2015.dbc"
    assert locate_dbc("pkg:cardata/car_2015", Path()) == package / "dbc" / "car_2015.dbc"


def test_files_that_import_others_are_read_whole_by_either_name(package):
    for name in ("pkg:cardata/dbc/whole.dbc", "pkg:cardata/whole_generated"):
        assert names(load_dbc(name, Path())) == ["KINEMATICS", "STEER"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("pkg:cardata/car_2016.dbc", "package 'cardata' has no such file; did you mean 'car_2015.dbc'?"),
        (
            "pkg:cardata/twice.dbc",
            "is ambiguous; expected one of pkg:cardata/dbc/old/twice.dbc, pkg:cardata/dbc/twice.dbc",
        ),
        ("pkg:carddata/car.dbc", "package 'carddata' is not installed; pip install carddata"),
        ("pkg:cardata", "expected pkg:PACKAGE/FILE, e.g. pkg:opendbc/dbc/hyundai_2015_ccan.dbc"),
        ("pkg:cardata/../secret.dbc", "expected pkg:PACKAGE/FILE"),
        ("pkg:a.b/c.dbc", "expected pkg:PACKAGE/FILE"),
    ],
)
def test_what_is_in_no_package_is_refused(package, name, words):
    with pytest.raises(ConfigError) as caught:
        load_dbc(name, Path())
    (fault,) = caught.value.faults
    assert (fault.where, fault.what[: len(words)]) == (name, words)


def test_a_missing_file_is_named_with_near_misses(write):
    base = write(GOOD)
    with pytest.raises(ConfigError) as caught:
        load_dbc("cars.dbc", base)
    assert caught.value.faults[0].what == f"no such file ({base / 'cars.dbc'}); did you mean 'car.dbc'?"
    with pytest.raises(ConfigError) as caught:
        load_dbc(".", base)
    assert caught.value.faults[0].what == "is a folder; expected a DBC file"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "car.dbc: is empty; expected a DBC file"),
        (b" \n\n", "car.dbc: is empty; expected a DBC file"),
        (bytes(range(256)), "car.dbc: is binary; expected a DBC file"),
        (b'VERSION ""\n', "car.dbc: has no messages; expected a DBC file"),
        (b"(1.0) can0 091#00\n", "car.dbc: can't be read: Invalid syntax at line 1"),
        (GOOD.replace("0|16", "0|").encode(), "car.dbc: can't be read: Invalid syntax at line 3"),
        (GOOD.replace("BO_ 36 ", "BO_ ").encode(), "car.dbc: can't be read: Invalid syntax at line 2"),
        (GOOD[:60].encode(), "car.dbc: is cut short: it ends in 'SG_ YAW_RATE : 0|16@1- (0'"),
        (b'CM_ "IMPORT other.dbc";\n', "car.dbc: imports 'other.dbc', which is not beside it"),
    ],
)
def test_what_is_no_dbc_is_an_input_error_in_one_line(write, content, words):
    with pytest.raises(InputError) as caught:
        load_dbc("car.dbc", write(content))
    assert str(caught.value).startswith(words)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 3


def test_cp1252_and_utf8_are_both_read(write):
    for encoding in ("cp1252", "utf-8", "utf-8-sig"):
        base = write(GOOD.replace("deg/s", "°/s").encode(encoding))
        loaded = load_dbc("car.dbc", base)
        assert loaded.database.get_message_by_name("KINEMATICS").signals[0].unit == "°/s"


def test_overlapping_signals_are_let_pass_with_a_warning(write):
    text = GOOD + ' SG_ OVER : 8|16@1- (1,0) [0|1] "" X\n'
    loaded = load_dbc("car.dbc", write(text))
    assert loaded.warnings == (
        "car.dbc: read leniently: The signals OVER and YAW_RATE are overlapping in message KINEMATICS.",
    )


def test_faults_outside_of_messages_are_let_pass_with_a_warning(write):
    text = GOOD + 'VAL_ 99 GONE 0 "off";\nCM_ SG_ 36 "no name";\n'
    loaded = load_dbc("car.dbc", write(text))
    assert names(loaded) == ["KINEMATICS"]
    assert "read without comments, value names and attributes" in loaded.warnings[0]


def test_an_extended_id_without_its_mark_is_extended(write):
    wide = f'BO_ {0x1E36001E} CAM: 8 X\n SG_ F : 0|32@1- (1,0) [0|0] "" X\n'
    text = f"{GOOD}{wide}SIG_VALTYPE_ {0x1E36001E} F : 1;\n"
    loaded = load_dbc("car.dbc", write(text))
    message = loaded.database.get_message_by_name("CAM")
    assert (message.frame_id, message.is_extended_frame) == (0x1E36001E, True)
    assert message.decode(bytes.fromhex("0000c03f00000000"))["F"] == 1.5  # IEEE 754: 0x3FC00000
    assert loaded.database.get_message_by_name("KINEMATICS").is_extended_frame is False


def test_what_no_frame_can_be_is_left_out_and_named(write):
    text = GOOD.replace("(0.01,", "(.01,") + (
        'BO_ 1075054137 WIDE: 8 X\n SG_ F : 0|8@1- (1,0) [0|0] "" X\n'
        'BO_ 37 9LIVES: 8 X\n SG_ G : 0|8@1- (1,0) [0|0] "" X\n'
        'BO_ 38 FINE: 8 X\n SG_ 0_CRC : 0|8@1- (1,0) [0|0] "" X\n SG_ H : 8|8@1- (1,0) [0|0] "" X\n'
    )
    loaded = load_dbc("car.dbc", write(text))
    assert names(loaded) == ["KINEMATICS", "FINE"]
    assert [s.name for s in loaded.database.get_message_by_name("FINE").signals] == ["H"]
    assert loaded.database.get_message_by_name("KINEMATICS").signals[0].scale == 0.01
    assert loaded.warnings[1] == "car.dbc: left out, for impossible ids or names: WIDE, 9LIVES, 0_CRC"


def test_multiplexing_survives_the_lenient_reading(write):
    text = (
        'BO_ 36 MUX: 8 X\n SG_ A m1 : 8|8@1+ (1,0) [0|0] "" X\n SG_ B m2 : 8|8@1+ (2,0) [0|0] "" X\n'
        ' SG_ M M : 0|8@1+ (1,0) [0|0] "" X\nVAL_ 99 GONE 0 "off";\n'
    )
    message = load_dbc("car.dbc", write(text)).database.get_message_by_name("MUX")
    assert message.decode(bytes([2, 7, 0, 0, 0, 0, 0, 0])) == {"M": 2, "B": 14}
