"""What is wrong with a configuration, in words: each fault alone, and all of them at once."""

# ruff: noqa: E501 - messages and YAML lines stand as they are read

from pathlib import Path

import pytest

from dsz_daemon.config.load import load_settings
from dsz_daemon.errors import ConfigError

# Line numbers of the faults below are counted from here.
GOOD = """\
vehicle:
  mass_kg: 1673
  yaw_inertia_kgm2: 2850
  cg_to_front_axle_m: 1.149
  cg_to_rear_axle_m: 1.491
  front_cornering_stiffness_n_per_rad: 62000
  rear_cornering_stiffness_n_per_rad: 68000
  steering_ratio: 15.7
  driven_axle: front
signals:
  dbc: car.dbc
  gyro_z: {message: KINEMATICS, signal: YAW_RATE, unit: deg/s}
  accel_x: {message: KINEMATICS, signal: ACCEL_X, unit: m/s^2}
  wheel_speed_fl: {message: WHEELS, signal: FL, unit: km/h}
  steering_wheel_angle: {message: STEER, signal: ANGLE, unit: deg}
  brake: {message: PEDALS, signal: BRAKE}
bus:
  can0: {interface: virtual}
"""

# (what stands there, what it is replaced by, the whole line of the message)
ONE_FAULT = [
    ("mass_kg: 1673", "mass_kg: -5", ":2: vehicle.mass_kg: -5 is not a mass; expected 100 to 60000 kg"),
    ("mass_kg: 1673", "mass_kg: 1673 kg", ":2: vehicle.mass_kg: '1673 kg' is not a number; expected 100 to 60000 kg"),
    ("mass_kg: 1673", 'mass_kg: "1673"', ":2: vehicle.mass_kg: '1673' is not a number; expected 100 to 60000 kg"),
    ("mass_kg: 1673", "mass_kg: true", ":2: vehicle.mass_kg: true is not a number; expected 100 to 60000 kg"),
    ("mass_kg: 1673", "mass_kg: .nan", ":2: vehicle.mass_kg: nan is not a finite number; expected 100 to 60000 kg"),
    ("mass_kg: 1673", "mass_kg:", ":2: vehicle.mass_kg: is empty; expected 100 to 60000 kg"),
    ("  mass_kg: 1673\n", "", ":1: vehicle.mass_kg: is missing; expected 100 to 60000 kg"),
    (
        "  mass_kg: 1673\n",
        "  mass_kg: 1673\n  mas_kg: 1673\n",
        ":3: vehicle.mas_kg: unknown key 'mas_kg'; did you mean 'mass_kg'?",
    ),
    (
        "  mass_kg: 1673\n",
        "  mass_kg: 1673\n  mass_kg: 1700\n",
        ":3: vehicle.mass_kg: is given twice (first at line 2)",
    ),
    (
        "driven_axle: front",
        "driven_axle: fornt",
        ":9: vehicle.driven_axle: 'fornt' is not a driven axle; expected front, rear or all",
    ),
    (
        "driven_axle: front",
        "rate_hz: 100",
        ":9: vehicle.rate_hz: unknown key 'rate_hz'; it belongs in 'loop'",
    ),
    (
        "driven_axle: front",
        "wheel_radius_m: {fl: 33, fr: 0.33, rl: 0.33, rr: 0.33}",
        ":9: vehicle.wheel_radius_m.fl: 33 is not a rolling radius; expected 0.1 to 1 m",
    ),
    (
        "  steering_ratio: 15.7\n",
        "",
        ":1: vehicle.steering_ratio: is missing; expected 1 to 50, since signals.steering_wheel_angle needs it "
        "(or map road_wheel_angle instead)",
    ),
    ("steering_ratio: 15.7", "steering_ratio:", ":8: vehicle.steering_ratio: is empty; expected 1 to 50"),
    (
        "YAW_RATE, unit: deg/s",
        "YAW_RATE, unit: km/h",
        ":12: signals.gyro_z.unit: 'km/h' is not a unit; expected rad/s or deg/s",
    ),
    (
        "YAW_RATE, unit: deg/s",
        "YAW_RATE",
        ":12: signals.gyro_z.unit: is missing; expected rad/s or deg/s",
    ),
    (
        "unit: km/h",
        "unit: rpm",
        ":1: vehicle.wheel_radius_m: is missing; expected {fl, fr, rl, rr} in m, since wheel_speed_fl come in rpm",
    ),
    ("YAW_RATE,", "YAW_RATE, sign: 2,", ":12: signals.gyro_z.sign: 2 is not a sign; expected 1 or -1"),
    (
        "YAW_RATE,",
        "YAW_RATE, channel: can1,",
        ":12: signals.gyro_z.channel: 'can1' is not a bus; expected can0; did you mean 'can0'?",
    ),
    (
        "signal: YAW_RATE, ",
        "",
        ":12: signals.gyro_z: signal is missing; expected signal: NAME, or signals: a list to be summed",
    ),
    (
        "signal: YAW_RATE, ",
        "signal: YAW_RATE, signals: [{signal: A}], ",
        ":12: signals.gyro_z: both signal and signals are given; expected signal: NAME, or signals: a list to be summed",
    ),
    (
        "signal: YAW_RATE, ",
        "signals: [], ",
        ":12: signals.gyro_z.signals: is an empty list; expected the signals to be summed",
    ),
    (
        "signal: YAW_RATE, ",
        "signals: [{signal: A}, {sign: -1}], ",
        ":12: signals.gyro_z.signals.1.signal: is missing; expected signal name in the DBC",
    ),
    (
        "YAW_RATE,",
        "YAW_RATE, valid_signal: STATUS,",
        ":12: signals.gyro_z.valid_signal: is given without valid_values; expected both or neither",
    ),
    (
        "YAW_RATE,",
        "YAW_RATE, volts_per_count: 7.63e-5,",
        ":12: signals.gyro_z.volts_per_count: is only a part of an ADC's scale; expected volts_per_count and "
        "volts_per_unit (and null_volts, if it is not 0)",
    ),
    (
        "YAW_RATE,",
        "YAW_RATE, volts_per_count: 7.63e-5, volts_per_unit: 0,",
        ":12: signals.gyro_z.volts_per_unit: 0 is not a volts per unit; expected 1e-9 to 1000",
    ),
    (
        "YAW_RATE,",
        "YAW_RATE, on_values: [1],",
        ":12: signals.gyro_z.on_values: unknown key 'on_values'; did you mean 'valid_values'?",
    ),
    (
        "signal: BRAKE",
        "signal: BRAKE, on_values: [pressed]",
        ":16: signals.brake.on_values.0: 'pressed' is not a number",
    ),
    (
        "  gyro_z: {message: KINEMATICS, signal: YAW_RATE, unit: deg/s}\n",
        "  gyro_z: {message: KINEMATICS, signal: YAW_RATE, unit: deg/s}\n"
        "  gyro_z: {message: IMU, signal: RATE, unit: deg/s}\n",
        ":13: signals.gyro_z: is mapped twice; a role has one source (first at line 12)",
    ),
    (
        "signal: ACCEL_X, unit: m/s^2}",
        "signal: ACCEL_X, unit: m/s^2}\n  accel_y: {message: KINEMATICS, signal: ACCEL_X, unit: m/s^2, sign: -1}",
        ":14: signals.accel_y: is the same signal as accel_x (KINEMATICS.ACCEL_X); expected a source of its own",
    ),
    (
        "signal: ACCEL_X, unit: m/s^2}",
        "signal: ACCEL_X, unit: m/s^2}\n  accel_y:",
        ":14: signals.accel_y: is empty; expected a message and a signal, or no such line",
    ),
    (
        "unit: m/s^2}",
        "unit: m/s^2}\n  gyro_w: {message: A, signal: B, unit: deg/s}",
        ":14: signals.gyro_w: unknown key 'gyro_w'; did you mean 'gyro_z' or 'gyro_y' or 'gyro_x'?",
    ),
    (
        "unit: m/s^2}",
        "unit: m/s^2}\n  road_wheel_angle: {message: STEER, signal: ROAD, unit: deg}",
        ":14: signals.road_wheel_angle: steering_wheel_angle is mapped too; expected one of the two, they say the same",
    ),
    ("dbc: car.dbc", "dbc: []", ":11: signals.dbc: is empty; expected a list with at least one entry"),
    ("dbc: car.dbc", "dbc: [5]", ":11: signals.dbc.0: 5 is not text"),
    ("  dbc: car.dbc\n", "", ":10: signals.dbc: is missing; expected a list with at least one entry"),
    ("interface: virtual", "channel: can0", ":18: bus.can0.interface: is missing; expected python-can interface"),
    (
        "{interface: virtual}",
        "socketcan",
        ":18: bus.can0: 'socketcan' is not a mapping; expected a mapping with interface",
    ),
    (
        "bus:\n",
        "output: {bus: can7}\nbus:\n",
        ":17: output.bus: 'can7' is not a bus; expected can0; did you mean 'can0'?",
    ),
    (
        "bus:\n",
        "output: {base_id: 0x7FF}\nbus:\n",
        ":17: output.base_id: 0x7FF is too high for 11-bit ids; expected 0 to 0x7F0, or extended: true",
    ),
    ("bus:\n", "output: {extended: maybe}\nbus:\n", ":17: output.extended: 'maybe' is not true or false"),
    (
        "bus:\n",
        "output: {base_id: 1.5}\nbus:\n",
        ":17: output.base_id: 1.5 is not a whole number; expected 0 to 0x1FFFFFFF",
    ),
    ("bus:\n", "loop: {rate_hz: 0}\nbus:\n", ":17: loop.rate_hz: 0 is not a rate; expected 20 to 500 Hz"),
    ("bus:\n", "loop: {rate_hz: 501}\nbus:\n", ":17: loop.rate_hz: 501 is not a rate; expected 20 to 500 Hz"),
    ("bus:\n", "loop: [100]\nbus:\n", ":17: loop: a list is not a mapping; expected a mapping with rate_hz"),
    ("bus:\n", "loops: {}\nbus:\n", ":17: loops: unknown key 'loops'; did you mean 'loop'?"),
    (
        "bus:\n",
        "estimator: {method: kalman}\nbus:\n",
        ":17: estimator.method: 'kalman' is not a method; expected paper",
    ),
    (
        "bus:\n",
        "diagnose: {tolerance: {mas_kg: 0.1}}\nbus:\n",
        ":17: diagnose.tolerance.mas_kg: unknown vehicle parameter 'mas_kg'; did you mean 'mass_kg'?",
    ),
    (
        "bus:\n",
        "diagnose: {tolerance: {mass_kg: 10}}\nbus:\n",
        ":17: diagnose.tolerance.mass_kg: 10 is not a tolerance; expected 0 to 1",
    ),
]


def faults_of(path: Path, text: str) -> list[str]:
    """Messages of the faults of `text`, none if it is right."""
    path.write_text(text, encoding="utf-8")
    try:
        load_settings(path)
    except ConfigError as error:
        return [str(fault) for fault in error.faults]
    return []


def test_the_good_one_is_good(tmp_path):
    assert faults_of(tmp_path / "config.yaml", GOOD) == []


@pytest.mark.parametrize(("old", "new", "message"), ONE_FAULT, ids=[m[:60] for _, _, m in ONE_FAULT])
def test_one_fault_one_message(tmp_path, old, new, message):
    assert old in GOOD
    faults = faults_of(tmp_path / "config.yaml", GOOD.replace(old, new, 1))
    assert len(faults) == 1, faults
    assert faults[0].startswith("config.yaml" + message)


def test_no_imu_at_all_is_a_fault(tmp_path):
    text = "".join(line for line in GOOD.splitlines(keepends=True) if not line.startswith(("  gyro", "  accel")))
    (fault,) = faults_of(tmp_path / "config.yaml", text)
    assert fault == (
        "config.yaml:10: signals: no gyro or accelerometer is mapped (mapped: wheel_speed_fl, steering_wheel_angle, "
        "brake); expected one of gyro_x, gyro_y, gyro_z, accel_x, accel_y, accel_z"
    )


def test_missing_sections_are_named_with_what_belongs_in_them(tmp_path):
    faults = faults_of(tmp_path / "config.yaml", "loop: {rate_hz: 50}\n")
    assert faults[0].startswith("config.yaml:1: vehicle: is missing; expected a mapping with mass_kg, yaw_inertia_kgm2")
    assert faults[1] == "config.yaml:1: signals: is missing; expected a mapping with dbc"
    assert len(faults) == 2


def test_all_faults_are_reported_at_once_in_the_order_of_the_file(tmp_path):
    text = (
        GOOD.replace("mass_kg: 1673", "mass_kg: -5")
        .replace("yaw_inertia_kgm2: 2850", "yaw_inertia_kgm2: 2850 kgm2")
        .replace("cg_to_front_axle_m: 1.149", "cg_to_front_axle_m: 1149")
        .replace("  cg_to_rear_axle_m: 1.491\n", "")
        .replace("steering_ratio", "steering_ration")
        .replace("driven_axle: front", "driven_axle: both")
        .replace("YAW_RATE, unit: deg/s", "YAW_RATE, unit: g, sign: 0, chanel: can0")
        .replace("signal: ACCEL_X, ", "")
        .replace("signal: FL, unit: km/h", "signal: FL, unit: knots, channel: can9")
        .replace("  brake:", "  gyro_z: {message: X, signal: Y, unit: deg/s}\n  brake:")
        .replace("BRAKE}", "BRAKE, valid_values: [1]}")
        .replace("interface: virtual", "interfce: virtual")
    ) + "loop: {rate_hz: 0, gap: 1}\noutput: {bus: nope}\nestimatr: {}\ndiagnose: {tolerance: {mass_kg: -1, cg: 0}}\n"
    faults = faults_of(tmp_path / "config.yaml", text)
    expected = [
        "vehicle.cg_to_rear_axle_m: is missing",
        "vehicle.steering_ratio: is missing",
        "vehicle.mass_kg: -5 is not a mass",
        "vehicle.yaw_inertia_kgm2: '2850 kgm2' is not a number",
        "vehicle.cg_to_front_axle_m: 1149 is not a distance from C.G. to front axle; expected 0.1 to 10 m",
        "vehicle.steering_ration: unknown key 'steering_ration'; did you mean 'steering_ratio'?",
        "vehicle.driven_axle: 'both'",
        "signals.gyro_z.unit: 'g'",
        "signals.gyro_z.sign: 0",
        "signals.gyro_z.chanel: unknown key 'chanel'; did you mean 'channel'?",
        "signals.accel_x: signal is missing",
        "signals.wheel_speed_fl.unit: 'knots' is not a unit; expected m/s, km/h, mph, rad/s or rpm",
        "signals.wheel_speed_fl.channel: 'can9'",
        "signals.gyro_z: is mapped twice",
        "signals.brake.valid_values: is given without valid_signal",
        "bus.can0.interface: is missing",
        "loop.rate_hz: 0",
        "loop.gap: unknown key 'gap'; did you mean 'gap_s'?",
        "output.bus: 'nope' is not a bus",
        "estimatr: unknown key 'estimatr'; did you mean 'estimator'?",
        "diagnose.tolerance.mass_kg: -1",
        "diagnose.tolerance.cg: unknown parameter 'cg'",
    ]
    unmatched = [words for words in expected if not any(words in fault for fault in faults)]
    assert unmatched == []
    assert len(faults) == len(expected), faults
    lines = [int(fault.split(":")[1]) for fault in faults]
    assert lines == sorted(lines)
    (tmp_path / "config.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_settings(tmp_path / "config.yaml")
    assert caught.value.message.endswith("config.yaml: 22 faults in the configuration")


def test_a_gear_lever_may_serve_two_roles(tmp_path):
    text = GOOD.replace(
        "  brake:",
        "  gear: {message: PEDALS, signal: GEAR}\n  reverse: {message: PEDALS, signal: GEAR, on_values: [1]}\n  brake:",
    )
    assert faults_of(tmp_path / "config.yaml", text) == []


def test_one_signal_name_on_two_buses_is_two_sources(tmp_path):
    text = GOOD.replace(
        "ACCEL_X, unit: m/s^2}",
        "A, unit: g, channel: can0}\n  accel_y: {message: KINEMATICS, signal: A, unit: g, channel: can1}",
    )
    text = text.replace("  can0: {", "  can1: {interface: virtual}\n  can0: {")
    assert faults_of(tmp_path / "config.yaml", text) == []
    # One that names no channel takes frames from any.
    for channel in (", channel: can0", ", channel: can1"):
        (fault,) = faults_of(tmp_path / "config.yaml", text.replace(channel, ""))
        assert "signals.accel_y: is the same signal as accel_x" in fault
    (fault,) = faults_of(tmp_path / "config.yaml", text.replace("channel: can1", "channel: can0"))
    assert "signals.accel_y: is the same signal as accel_x" in fault
