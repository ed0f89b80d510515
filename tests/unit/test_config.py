"""A configuration that is right: what is read, what has defaults, how a bus is overridden."""

# ruff: noqa: E501 - messages and YAML lines stand as they are read

import json
from pathlib import Path

import pytest

from dsz_daemon import signals
from dsz_daemon.config.load import load_settings, override_bus
from dsz_daemon.config.schema import schema_text
from dsz_daemon.config.settings import Settings
from dsz_daemon.config.signal_settings import SWITCHES, SignalsSettings
from dsz_daemon.errors import ConfigError
from dsz_daemon.shipped import shipped

CONTRACT = """
vehicle:
  mass_kg: 1673
  yaw_inertia_kgm2: 2850
  cg_to_front_axle_m: 1.149
  cg_to_rear_axle_m: 1.491
  front_track_m: 1.585
  rear_track_m: 1.586
  cg_height_m: 0.66
  front_cornering_stiffness_n_per_rad: 62000     # one tyre
  rear_cornering_stiffness_n_per_rad: 68000
  steering_ratio: 15.7                            # steering wheel over road wheel
  driven_axle: front                              # front, rear, all
  wheel_radius_m: {fl: 0.337, fr: 0.337, rl: 0.340, rr: 0.340}
signals:
  dbc: [car.dbc, imu.dbc]
  gyro_x: {message: IMU_RATE, signal: ROLL_ADC, volts_per_count: 7.63e-5, null_volts: 2.5, volts_per_unit: 0.007, unit: deg/s}
  gyro_y: {message: IMU_RATE, signal: PITCH, unit: deg/s}
  gyro_z: {message: KINEMATICS, signal: YAW_RATE, unit: deg/s, sign: -1, channel: can0}
  accel_x: {message: KINEMATICS, signal: AX, unit: m/s^2}   # also g
  accel_y: {message: KINEMATICS, signal: AY, unit: g}
  accel_z: {message: KINEMATICS, signal: AZ, unit: m/s^2}
  wheel_speed_fl: {message: WHEEL_SPEEDS, signal: WHEEL_SPEED_FL, unit: km/h}   # also m/s, rad/s, rpm
  wheel_speed_fr: {message: WHEEL_SPEEDS, signal: WHEEL_SPEED_FR, unit: rpm}
  wheel_speed_rl: {message: WHEEL_SPEEDS, signal: WHEEL_SPEED_RL, unit: rad/s}
  wheel_speed_rr: {message: WHEEL_SPEEDS, signal: WHEEL_SPEED_RR, unit: m/s}
  steering_wheel_angle: {message: STEER, signals: [{signal: STEER_ANGLE}, {signal: STEER_FRACTION}], unit: deg}
  brake: {message: PEDALS, signal: BRAKE_ON}          # nonzero = braking; optional
  accelerator: {message: PEDALS, signal: GAS_ON}      # optional
"""


@pytest.fixture
def write(tmp_path: Path):
    def write_file(text: str) -> Path:
        path = tmp_path / "config.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write_file


def test_the_contracts_two_sections_are_a_complete_configuration(write):
    settings = load_settings(write(CONTRACT))
    assert settings.vehicle.mass_kg == 1673
    assert settings.vehicle.wheel_radius_m.rr == 0.340
    assert settings.signals.dbc == ("car.dbc", "imu.dbc")
    gyro_x = settings.signals.roles["gyro_x"]
    assert (gyro_x.volts_per_count, gyro_x.null_volts, gyro_x.volts_per_unit) == (7.63e-5, 2.5, 0.007)
    steering = settings.signals.roles["steering_wheel_angle"]
    assert [(p.signal, p.sign) for p in steering.parts] == [("STEER_ANGLE", 1), ("STEER_FRACTION", 1)]
    assert settings.signals.roles["gyro_z"].sign == -1
    assert settings.loop.rate_hz == 100
    assert settings.estimator.method == "paper"


def test_the_live_buses_default_to_can0_on_socketcan(write):
    settings = load_settings(write(CONTRACT))
    assert settings.buses["can0"].arguments == {"interface": "socketcan", "channel": "can0"}
    assert settings.output_bus == "can0"


def test_output_goes_to_the_first_bus_unless_it_is_named(write):
    two = CONTRACT + "bus: {can0: {interface: virtual}, imu: {interface: pcan, channel: PCAN_USBBUS1, fd: true}}\n"
    assert load_settings(write(two)).output_bus == "can0"
    assert load_settings(write(two + "output: {bus: imu}\n")).output_bus == "imu"


def test_a_bus_hands_unknown_arguments_on(write):
    text = CONTRACT + "bus: {can0: {interface: slcan, channel: /dev/ttyUSB0, ttyBaudrate: 115200, bitrate: 500000}}\n"
    assert load_settings(write(text)).buses["can0"].arguments == {
        "interface": "slcan", "channel": "/dev/ttyUSB0", "ttyBaudrate": 115200, "bitrate": 500000,
    }  # fmt: skip


def test_tolerances_keep_the_stiffnesses_where_others_are_given(write):
    text = CONTRACT + "diagnose: {tolerance: {mass_kg: 0.05, rear_cornering_stiffness_n_per_rad: 0.2}}\n"
    assert load_settings(write(text)).diagnose.tolerance == {
        "front_cornering_stiffness_n_per_rad": 0.1,
        "rear_cornering_stiffness_n_per_rad": 0.2,
        "mass_kg": 0.05,
    }


def test_one_value_of_a_zeroing_law_can_be_set_alone(write):
    default = load_settings(write(CONTRACT)).estimator
    changed = load_settings(write(CONTRACT + "estimator: {yaw_rate: {window_s: 77}}\n")).estimator
    assert changed.yaw_rate.window_s == 77
    assert changed.yaw_rate.noise_density == default.yaw_rate.noise_density
    assert changed.lateral == default.lateral


@pytest.mark.parametrize(
    ("spelling", "value"),
    [("1e3", 1000.0), ("1.5E+3", 1500.0), ("0x640", 1600.0), ("+1673", 1673.0), ("1673.", 1673.0), ("01673", 1673.0)],
)
def test_numbers_may_be_spelled_as_yaml_1_2_has_them(write, spelling, value):
    assert load_settings(write(CONTRACT.replace("1673", spelling, 1))).vehicle.mass_kg == value


def test_yes_no_on_are_names_and_only_a_switch_takes_them_for_true_or_false(write):
    text = CONTRACT.replace("signal: BRAKE_ON", "signal: on").replace("message: PEDALS", "message: no")
    settings = load_settings(write(text + "estimator: {as_printed: yes}\noutput: {extended: off}\n"))
    brake = settings.signals.roles["brake"]
    assert (brake.message, brake.signal) == ("no", "on")
    assert settings.estimator.as_printed is True
    assert settings.output.extended is False


def test_other_spellings_of_a_unit_are_welcome(write):
    text = CONTRACT.replace("AX, unit: m/s^2", "AX, unit: m/s2").replace("unit: km/h", "unit: kph")
    roles = load_settings(write(text)).signals.roles
    assert roles["accel_x"].unit == "m/s^2"
    assert roles["wheel_speed_fl"].unit == "km/h"


def test_anchors_and_merges_work(write):
    text = CONTRACT.replace("{message: KINEMATICS, signal: AX,", "&ax {message: KINEMATICS, signal: AX,").replace(
        "{message: KINEMATICS, signal: AZ, unit: m/s^2}", "{<<: *ax, signal: AZ}"
    )
    roles = load_settings(write(text)).signals.roles
    assert (roles["accel_z"].signal, roles["accel_z"].unit) == ("AZ", "m/s^2")


def test_a_car_with_only_yaw_rate_and_accelerations_is_a_configuration(write):
    lines = [
        line for line in CONTRACT.splitlines() if not line.strip().startswith(("wheel", "steer", "brake", "acceler"))
    ]
    settings = load_settings(write("\n".join(lines)))
    assert "steering_wheel_angle" not in settings.signals.roles


def test_settings_cannot_be_changed(write):
    settings = load_settings(write(CONTRACT))
    with pytest.raises(ValueError, match="frozen"):
        settings.vehicle.mass_kg = 1.0


def test_the_settings_used_are_json_and_read_back_as_the_same(write):
    settings = load_settings(write(CONTRACT + "bus: {can0: {interface: virtual, rx_queue_size: 5}}\n"))
    assert Settings.model_validate(json.loads(json.dumps(settings.used()))) == settings


def test_roles_and_units_are_those_of_the_vocabulary():
    assert [name for name in SignalsSettings.model_fields if name != "dbc"] == list(signals.QUANTITIES)
    for role, quantity in signals.QUANTITIES.items():
        definition = SignalsSettings.model_json_schema()["properties"][role]["anyOf"][0]["$ref"].rpartition("/")[2]
        unit = SignalsSettings.model_json_schema()["$defs"][definition]["properties"]["unit"]
        assert set(unit.get("enum", [unit.get("const")])) == set(quantity.units), role
    assert set(SWITCHES) == {r for r, q in signals.QUANTITIES.items() if q.meaning.startswith("nonzero = ")}


def test_the_car_is_what_the_core_takes(write):
    car = load_settings(write(CONTRACT)).vehicle.car()
    assert car.wheelbase_m == pytest.approx(2.640)
    assert (car.front_driven, car.rear_driven) == (True, False)
    rear = load_settings(write(CONTRACT.replace("driven_axle: front", "driven_axle: rear"))).vehicle.car()
    assert (rear.front_driven, rear.rear_driven) == (False, True)


def test_the_schema_in_the_tree_is_current():
    tree = (shipped("config") / "dsz.schema.json").read_text(encoding="utf-8")
    assert tree == schema_text(), "run: python -m dsz_daemon.config.schema"


def test_the_schema_offers_units_and_required_keys():
    schema = json.loads(schema_text())
    assert schema["$defs"]["RateSignal"]["properties"]["unit"]["enum"] == ["rad/s", "deg/s"]
    assert "mass_kg" in schema["$defs"]["VehicleSettings"]["required"]
    assert schema["required"] == ["vehicle", "signals"]
    assert schema["$defs"]["VehicleSettings"]["properties"]["mass_kg"]["maximum"] == 60000
    assert schema["additionalProperties"] is False
    # Laws have defaults as a whole: one value may be given alone.
    assert "required" not in schema["$defs"]["ZeroingSettings"]


def test_a_bus_is_overridden_from_the_command_line(write):
    settings = load_settings(
        write(CONTRACT + "bus: {can0: {interface: pcan, channel: PCAN_USBBUS1, bitrate: 500000}}\n")
    )
    live = override_bus(settings, ["can0=socketcan:vcan0"])
    assert live.buses["can0"].arguments == {"interface": "socketcan", "channel": "vcan0"}
    assert settings.buses["can0"].arguments["interface"] == "pcan"


def test_a_channel_may_have_colons_and_a_further_bus_may_be_added(write):
    live = override_bus(load_settings(write(CONTRACT)), ["can0=udp_multicast:ff15:7079::1", "imu=virtual:x"])
    assert live.buses["can0"].arguments["channel"] == "ff15:7079::1"
    assert list(live.buses) == ["can0", "imu"]


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["vcan0"], "--bus vcan0: expected NAME=INTERFACE:CHANNEL, e.g. can0=socketcan:vcan0"),
        (["can0=socketcan"], "--bus can0=socketcan: expected NAME=INTERFACE:CHANNEL"),
        (["=socketcan:vcan0"], "expected NAME=INTERFACE:CHANNEL"),
        (["can0=virtual:a", "can0=virtual:b"], "bus 'can0' is given twice"),
        (
            ["imu=virtual:a"],
            "signals.gyro_z.channel: 'can0' is not a bus; expected imu, or --bus can0=INTERFACE:CHANNEL",
        ),
    ],
)
def test_a_bus_that_cannot_be_is_refused(write, overrides, words):
    with pytest.raises(ConfigError) as caught:
        override_bus(load_settings(write(CONTRACT)), overrides)
    assert words in str(caught.value)


def test_all_wrong_overrides_are_named_at_once(write):
    with pytest.raises(ConfigError) as caught:
        override_bus(load_settings(write(CONTRACT)), ["a", "b=c"])
    assert len(caught.value.faults) == 2


def test_a_live_run_needs_a_bus_for_every_channel(write):
    settings = load_settings(write(CONTRACT.replace("channel: can0", "channel: can1")))
    with pytest.raises(ConfigError, match=r"signals\.gyro_z\.channel: 'can1' is not a bus; expected can0"):
        override_bus(settings, [])
