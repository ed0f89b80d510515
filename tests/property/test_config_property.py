"""Whatever a configuration file holds: settings come out, or faults; never anything else."""

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dsz_daemon.config.document import read_document
from dsz_daemon.config.load import load_settings, parsed_bus
from dsz_daemon.config.nearest import nearest
from dsz_daemon.errors import ConfigError

DATA: dict = {
    "vehicle": {
        "mass_kg": 1673,
        "yaw_inertia_kgm2": 2850,
        "cg_to_front_axle_m": 1.149,
        "cg_to_rear_axle_m": 1.491,
        "front_cornering_stiffness_n_per_rad": 62000,
        "rear_cornering_stiffness_n_per_rad": 68000,
        "steering_ratio": 15.7,
    },
    "signals": {
        "dbc": ["car.dbc"],
        "gyro_z": {"message": "K", "signal": "R", "unit": "deg/s"},
        "accel_x": {"message": "K", "signal": "AX", "unit": "g"},
        "brake": {"message": "P", "signal": "B"},
    },
    "loop": {"rate_hz": 100},
}
SLOW_FILES = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


_MARKS = [
    "vehicle",
    "signals",
    ": ",
    "- ",
    "{",
    "}",
    "[",
    "]",
    "\n",
    "  ",
    "&a ",
    "*a",
    "1",
    "x",
    "!t ",
    "<<",
    "|",
    "'",
]
_MARKS += ["? "]
_NAMES = st.text(st.characters(codec="ascii", categories=["L", "N"]), min_size=1)
_PRINTABLE = st.text(st.characters(codec="ascii", exclude_categories=["Cc"]))


def written(folder: Path, text: str) -> Path:
    path = folder / "config.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def faults(folder: Path, data: object) -> list[str]:
    """Fault messages of `data`, written as JSON, which is YAML too."""
    try:
        load_settings(written(folder, json.dumps(data)))
    except ConfigError as error:
        return [str(fault) for fault in error.faults] or [error.message]
    return []


@SLOW_FILES
@given(text=st.text(alphabet=st.characters(exclude_categories=["Cs"]), max_size=200))
def test_any_text_is_settings_or_a_configuration_error(tmp_path, text):
    with pytest.raises(ConfigError):
        load_settings(written(tmp_path, text))


@SLOW_FILES
@given(text=st.lists(st.sampled_from(_MARKS), max_size=25).map("".join))
def test_any_yaml_punctuation_is_settings_or_a_configuration_error(tmp_path, text):
    with pytest.raises(ConfigError):
        load_settings(written(tmp_path, text))


_JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
_PLACES = [("vehicle",), ("signals",), ("bus",), ("output",), ("loop",), ("estimator",), ("service",), ("diagnose",)]
_PLACES += [("vehicle", key) for key in (*DATA["vehicle"], "wheel_radius_m", "driven_axle")]
_PLACES += [("signals", key) for key in ("dbc", "gyro_z", "accel_x", "brake", "wheel_speed_fl")]
_PLACES += [("signals", "gyro_z", key) for key in ("message", "signals", "unit", "sign", "valid_values", "channel")]
_PLACES += [("estimator", "yaw_rate"), ("diagnose", "tolerance"), ("bus", "can0"), ("output", "base_id")]


@SLOW_FILES
@given(place=st.sampled_from(_PLACES), junk=_JUNK)
def test_any_value_anywhere_is_settings_or_faults_that_name_a_line(tmp_path, place, junk):
    data = json.loads(json.dumps(DATA))
    node = data
    for key in place[:-1]:
        node = node.setdefault(key, {})
    node[place[-1]] = junk
    for fault in faults(tmp_path, data):
        assert fault.startswith("config.yaml:1: "), fault
        assert "\n" not in fault


@SLOW_FILES
@given(mass=st.floats(100, 60000), spelling=st.sampled_from(["{!r}", "{:e}", "{:.17g}", "+{:.3f}", "{:.6E}"]))
def test_a_number_in_bounds_is_read_as_python_reads_it(tmp_path, mass, spelling):
    text = spelling.format(mass)
    if not 100 <= float(text) <= 60000:
        return
    data = {**DATA, "vehicle": {**DATA["vehicle"], "mass_kg": "MASS"}}
    path = written(tmp_path, json.dumps(data).replace('"MASS"', text))
    assert load_settings(path).vehicle.mass_kg == float(text)


@SLOW_FILES
@given(mass=st.floats(allow_nan=False).filter(lambda m: not 100 <= m <= 60000))
def test_a_number_out_of_bounds_is_one_fault_with_the_bounds(tmp_path, mass):
    text = {float("inf"): ".inf", float("-inf"): "-.inf"}.get(mass, repr(mass))
    data = {**DATA, "vehicle": {**DATA["vehicle"], "mass_kg": "MASS"}}
    with pytest.raises(ConfigError) as caught:
        load_settings(written(tmp_path, json.dumps(data).replace('"MASS"', text)))
    (fault,) = caught.value.faults
    assert str(fault).endswith("expected 100 to 60000 kg")


# Each spoils the data in its own place and must give exactly one fault, alone or with others.
_SPOILS = {
    "vehicle.mass_kg": lambda d: d["vehicle"].update(mass_kg=-1),
    "vehicle.steering_ratio": lambda d: d["vehicle"].update(steering_ratio="15:1"),
    "vehicle.colour": lambda d: d["vehicle"].update(colour="red"),
    "vehicle.cg_to_rear_axle_m": lambda d: d["vehicle"].pop("cg_to_rear_axle_m"),
    "signals.gyro_z.unit": lambda d: d["signals"]["gyro_z"].update(unit="m/s"),
    "signals.accel_x.signal": lambda d: d["signals"]["accel_x"].update(signal=7),
    "signals.brake.on_values": lambda d: d["signals"]["brake"].update(on_values={}),
    "signals.gyro_y": lambda d: d["signals"].update(gyro_y=None),
    "loop.rate_hz": lambda d: d["loop"].update(rate_hz=1000),
    "bus.can0.interface": lambda d: d.update(bus={"can0": {}}),
    "service.state": lambda d: d.update(service={"state": 1}),
}


@SLOW_FILES
@given(spoiled=st.sets(st.sampled_from(sorted(_SPOILS))))
def test_faults_never_hide_one_another(tmp_path, spoiled):
    data = json.loads(json.dumps(DATA))
    for name in spoiled:
        _SPOILS[name](data)
    assert sorted(fault.split(": ")[1] for fault in faults(tmp_path, data)) == sorted(spoiled)


@SLOW_FILES
@given(data=st.dictionaries(_NAMES, st.integers() | _PRINTABLE, min_size=1))
def test_json_reads_as_json_does(tmp_path, data):
    """A JSON document is a YAML 1.2 document with the same meaning."""
    assert read_document(written(tmp_path, json.dumps(data))).data == data


@given(
    name=st.from_regex(r"[a-z0-9]+", fullmatch=True),
    interface=st.from_regex(r"[a-z_]+", fullmatch=True),
    channel=st.text(min_size=1).map(str.strip).filter(bool),
)
def test_a_bus_argument_is_taken_apart_at_its_first_marks(name, interface, channel):
    parsed, bus = parsed_bus(f"{name}={interface}:{channel}")
    assert (parsed, bus.interface, bus.channel) == (name, interface, channel)


@given(names=st.lists(st.text(min_size=1), min_size=1, unique_by=str.lower), data=st.data())
def test_a_name_is_nearest_to_itself(names, data):
    word = data.draw(st.sampled_from(names))
    assert nearest(word, names)[0] == word
