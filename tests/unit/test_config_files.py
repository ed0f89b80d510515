"""Files that are no configuration at all: one clear message each, never a traceback."""

import pytest

from dsz_daemon.config.document import read_document
from dsz_daemon.config.load import load_settings
from dsz_daemon.errors import ConfigError

NO_CONFIGURATION = {
    "empty": (b"", "is empty; expected the sections vehicle and signals"),
    "only comments": (b"# nothing\n", "is empty; expected the sections vehicle and signals"),
    "null": (b"~\n", "is empty; expected the sections vehicle and signals"),
    "a list": (b"- vehicle\n- signals\n", "holds a list; expected the sections vehicle and signals"),
    "words": (b"just words\n", "holds the text 'just words'; expected the sections vehicle and signals"),
    "binary": (bytes(range(256)), "is not UTF-8 text (byte 0x80 at offset 128)"),
    "latin-1": (b"vehicle: {}\n# \xe9t\xe9\n", "is not UTF-8 text (byte 0xe9 at offset 14)"),
    "a nul byte": (b"vehicle: {a: 1\0}\n", "unacceptable character #x0000"),
    "UTF-16": ("vehicle: {}".encode("utf-16"), "is not UTF-8 text (byte 0xff at offset 0)"),
    "a tab": (b"vehicle:\n\tmass_kg: 5\n", ":2:1: not valid YAML: found character '\\t'"),
    "unclosed": (b"vehicle: {mass_kg: 5\nsignals: 3\n", ":2:8: not valid YAML: "),
    "bad indent": (b"vehicle:\n    a: 1\n  b: 2\n", ":3:3: not valid YAML: "),
    "two documents": (b"vehicle: {}\n---\nsignals: {}\n", ":2:1: not valid YAML: but found another document"),
    "unknown alias": (b"vehicle: *car\n", ":1:10: not valid YAML: found undefined alias 'car'"),
    "nested": (b"a: " + b"[" * 5000, "nested too deeply to be a configuration"),
    "a candump log": (
        b"(1.0) can0 091#7F247EDD7388F000\n(1.1) can0 092#00\n",
        "holds the text '(1.0) can0 091#7F247EDD7388F000",
    ),
    "too large": (b"#" * 2_000_000, "has 2 MB; a configuration is a small YAML file"),
}


@pytest.mark.parametrize("name", NO_CONFIGURATION)
def test_a_file_that_is_no_configuration_is_refused_in_one_line(tmp_path, name):
    content, words = NO_CONFIGURATION[name]
    path = tmp_path / "config.yaml"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        load_settings(path)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert words in text
    assert "\n" not in text
    assert caught.value.exit_code == 2


def test_a_missing_file_is_named_with_what_is_beside_it(tmp_path):
    (tmp_path / "config.yaml").touch()
    with pytest.raises(ConfigError, match=r"confg\.yaml: no such file; did you mean 'config\.yaml'\?"):
        load_settings(tmp_path / "confg.yaml")
    with pytest.raises(ConfigError, match=r"no such file$"):
        load_settings(tmp_path / "nowhere" / "config.yaml")


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="is a folder; expected a YAML file"):
        load_settings(tmp_path)


def test_a_byte_order_mark_is_no_harm(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_bytes(b"\xef\xbb\xbfvehicle: {}\n")
    assert read_document(path).data == {"vehicle": {}}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001), ("7.63e-5", 7.63e-5), ("-.5", -0.5), ("1.", 1.0), ("0x6D0", 1744), ("0o17", 15), ("010", 10),
        ("+3", 3), ("yes", "yes"), ("No", "No"), ("on", "on"), ("true", True), ("False", False), ("null", None),
        ("~", None), ("", None), ("1:30", "1:30"), ("2020-01-01", "2020-01-01"), ("1_000", "1_000"), ("'1'", "1"),
        ("!!str 1", "1"), (".inf", float("inf")), ("e3", "e3"), ("1e", "1e"), ("0x", "0x"), ("[1, a]", [1, "a"]),
    ],
)  # fmt: skip
def test_values_are_those_of_yaml_1_2(tmp_path, text, value):
    path = tmp_path / "config.yaml"
    path.write_text(f"key: {text}\n")
    read = read_document(path).data["key"]
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vehicle: !!python/object/apply:os.system [echo]", ":1: vehicle: has the tag"),
        ("vehicle: {mass_kg: !!binary aGk=}", ":1: vehicle.mass_kg: tag 'tag:yaml.org,2002:binary' on 'aGk='"),
        ("vehicle: &v {a: *v}", ":1: vehicle.a: contains itself"),
        ("? [a, b]\n: 1", ":1: a key is a list or mapping; expected a name"),
        ("a: 1\nb: 2\na: 3", ":3: a: is given twice (first at line 1)"),
    ],
)
def test_odd_yaml_is_a_fault_and_constructs_nothing(tmp_path, text, words):
    path = tmp_path / "config.yaml"
    path.write_text(text)
    assert any(words in str(fault) for fault in read_document(path).faults)


def test_an_alias_is_the_anchors_data_and_no_copy(tmp_path):
    """Copies would double with every level: sixty short lines could fill any memory."""
    path = tmp_path / "config.yaml"
    path.write_text("a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n")
    data = read_document(path).data
    assert data["c"] == [[["x", "x"], ["x", "x"]], [["x", "x"], ["x", "x"]]]
    assert data["c"][0] is data["c"][1]
    assert data["c"][0][0] is data["a"]
