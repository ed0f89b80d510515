"""A configuration against its DBC: sources, faults, warnings, notes."""

# ruff: noqa: E501 - messages and YAML lines stand as they are read

import math
from pathlib import Path

import pytest

from dsz_daemon.config.check import check_configuration, resolve
from dsz_daemon.config.load import load_settings
from dsz_daemon.errors import ConfigError, Fault, InputError
from dsz_daemon.pipeline.mapping import Part
from dsz_daemon.signals import QUANTITIES

CAR = """\
VERSION ""
BO_ 36 KINEMATICS: 8 X
 SG_ YAW_RATE : 0|16@1- (0.01,0) [-327|327] "deg/sec" X
 SG_ ACCEL_X : 16|16@1- (0.01,0) [-327|327] "m/s2" X
 SG_ ACCEL_Y : 32|16@1- (0.01,0) [-327|327] "m/s^2" X
 SG_ STATUS : 48|2@1+ (1,0) [0|3] "" X

BO_ 170 WHEEL_SPEEDS: 8 X
 SG_ WHEEL_FL : 0|16@1+ (0.01,0) [0|300] "KPH" X
 SG_ WHEEL_FR : 16|16@1+ (0.01,0) [0|300] "KPH" X
 SG_ WHEEL_RL : 32|16@1+ (0.01,0) [0|300] "rad/s" X
 SG_ WHEEL_RR : 48|16@1+ (0.01,0) [0|300] "rpm" X

BO_ 37 STEER: 8 X
 SG_ ANGLE : 0|16@1- (1.5,0) [-500|500] "Deg" X
 SG_ FRACTION : 16|4@1- (0.1,0) [-1|1] "degrees" X

BO_ 548 PEDALS: 8 X
 SG_ BRAKE_ON : 0|1@1+ (1,0) [0|1] "" X
 SG_ GEAR : 8|3@1+ (1,0) [0|7] "SED" X
"""
IMU = """\
VERSION ""
BO_ 768 IMU_RATE: 8 X
 SG_ ROLL_ADC : 0|16@1+ (1,0) [0|65535] "counts" X
"""
CONFIG = """\
vehicle:
  mass_kg: 1673
  yaw_inertia_kgm2: 2850
  cg_to_front_axle_m: 1.149
  cg_to_rear_axle_m: 1.491
  front_track_m: 1.585
  rear_track_m: 1.586
  front_cornering_stiffness_n_per_rad: 62000
  rear_cornering_stiffness_n_per_rad: 68000
  steering_ratio: 15.7
  driven_axle: front
  wheel_radius_m: {fl: 0.3, fr: 0.31, rl: 0.34, rr: 0.35}
signals:
  dbc: [car.dbc, imu.dbc]
  gyro_x: {message: IMU_RATE, signal: ROLL_ADC, volts_per_count: 7.63e-5, null_volts: 2.5, volts_per_unit: 0.007, unit: deg/s}
  gyro_z: {message: KINEMATICS, signal: YAW_RATE, unit: deg/s, sign: -1, channel: can0, valid_signal: STATUS, valid_values: 3}
  accel_x: {message: KINEMATICS, signal: ACCEL_X, unit: m/s^2}
  accel_y: {message: KINEMATICS, signal: ACCEL_Y, unit: m/s^2}
  wheel_speed_fl: {message: WHEEL_SPEEDS, signal: WHEEL_FL, unit: km/h}
  wheel_speed_fr: {message: WHEEL_SPEEDS, signal: WHEEL_FR, unit: km/h}
  wheel_speed_rl: {message: WHEEL_SPEEDS, signal: WHEEL_RL, unit: rad/s}
  wheel_speed_rr: {message: WHEEL_SPEEDS, signal: WHEEL_RR, unit: rpm}
  steering_wheel_angle: {message: STEER, signals: [{signal: ANGLE}, {signal: FRACTION, sign: -1}], unit: deg}
  brake: {message: PEDALS, signal: BRAKE_ON}
  reverse: {message: PEDALS, signal: GEAR, on_values: [1, 7]}
"""


@pytest.fixture
def check(tmp_path: Path):
    """Check CONFIG with replacements made in it or in its DBC files."""

    def run(*replacements: tuple[str, str], car: str = CAR, imu: str = IMU, extra=()):
        text = CONFIG
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        for name, content in (("config.yaml", text), ("car.dbc", car), ("imu.dbc", imu)):
            (tmp_path / name).write_text(content, encoding="utf-8")
        return check_configuration(tmp_path / "config.yaml", extra)

    return run


def faults(check, *replacements, **more) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        check(*replacements, **more)
    return [str(fault) for fault in caught.value.faults]


def test_a_whole_car_resolves_without_a_word(check):
    result = check()
    assert result.warnings == ()
    assert [s.role for s in result.resolved.sources] == [r for r in QUANTITIES if r in result.settings.signals.roles]
    assert set(result.resolved.messages) == {"IMU_RATE", "KINEMATICS", "WHEEL_SPEEDS", "STEER", "PEDALS"}
    assert result.resolved.messages["KINEMATICS"].frame_id == 36


def test_sources_carry_units_signs_and_bounds(check):
    by_role = {s.role: s for s in check().resolved.sources}
    gyro = by_role["gyro_z"]
    assert gyro.to_si == pytest.approx(math.radians(1.0), rel=1e-12)
    assert (gyro.sign, gyro.channel, gyro.valid_signal, gyro.valid_values) == (-1.0, "can0", "STATUS", (3.0,))
    assert (gyro.low, gyro.high) == (QUANTITIES["gyro_z"].low, QUANTITIES["gyro_z"].high)
    assert by_role["steering_wheel_angle"].parts == (Part("ANGLE", 1.0), Part("FRACTION", -1.0))
    adc = by_role["gyro_x"]
    assert (adc.volts_per_count, adc.null_volts, adc.volts_per_unit) == (7.63e-5, 2.5, 0.007)
    assert (gyro.volts_per_count, gyro.null_volts, gyro.volts_per_unit) == (None, 0.0, 1.0)
    assert (by_role["brake"].is_switch, by_role["brake"].on_values) == (True, ())
    assert (by_role["reverse"].is_switch, by_role["reverse"].on_values) == (True, (1.0, 7.0))
    assert by_role["accel_x"].is_switch is False


def test_a_turning_wheel_is_carried_to_its_rim_by_its_own_radius(check):
    by_role = {s.role: s.to_si for s in check().resolved.sources}
    assert by_role["wheel_speed_fl"] == pytest.approx(1 / 3.6, rel=1e-12)  # 3.6 km/h = 1 m/s; no radius
    assert by_role["wheel_speed_rl"] == pytest.approx(0.34, rel=1e-12)  # 1 rad/s at 0.34 m
    # 60 rpm: one turn a second, a circumference of 2 pi 0.35 m a second.
    assert 60 * by_role["wheel_speed_rr"] == pytest.approx(2 * math.pi * 0.35, rel=1e-12)


MAPPING_FAULTS = [
    (
        ("message: STEER,", "message: STEERS,"),
        "config.yaml:23: signals.steering_wheel_angle.message: message 'STEERS' is not in car.dbc, imu.dbc; did you mean "
        "'STEER'?; signal 'ANGLE' is in message 'STEER'; signal 'FRACTION' is in message 'STEER'",
    ),
    (
        ("signal: ACCEL_X", "signal: ACELL_X"),
        "config.yaml:17: signals.accel_x.signal: message 'KINEMATICS' has no signal 'ACELL_X'; did you mean 'ACCEL_X' or "
        "'ACCEL_Y'?",
    ),
    (
        ("signal: ACCEL_X", "signal: accel_x"),
        "config.yaml:17: signals.accel_x.signal: message 'KINEMATICS' has no signal 'accel_x'; did you mean 'ACCEL_X' or "
        "'ACCEL_Y'?",
    ),
    (
        ("message: KINEMATICS, signal: ACCEL_X", "message: STEER, signal: ACCEL_X"),
        "config.yaml:17: signals.accel_x.signal: message 'STEER' has no signal 'ACCEL_X'; signal 'ACCEL_X' is in message "
        "'KINEMATICS'",
    ),
    (
        ("{signal: FRACTION,", "{signal: PART,"),
        "config.yaml:23: signals.steering_wheel_angle.signals.1.signal: message 'STEER' has no signal 'PART'",
    ),
    (
        ("valid_signal: STATUS", "valid_signal: STATE"),
        "config.yaml:16: signals.gyro_z.valid_signal: message 'KINEMATICS' has no signal 'STATE'; did you mean 'STATUS'?",
    ),
    (("[car.dbc, imu.dbc]", "[car.dbc, imu.dbc, more.dbc]"), "config.yaml:14: signals.dbc: more.dbc: no such file ("),
    (
        ("[car.dbc, imu.dbc]", "[car.dbc, imu.dbc, 'pkg:nosuchpackage/x.dbc']"),
        "config.yaml:14: signals.dbc: pkg:nosuchpackage/x.dbc: package 'nosuchpackage' is not installed; pip install "
        "nosuchpackage",
    ),
]


@pytest.mark.parametrize(("replacement", "message"), MAPPING_FAULTS, ids=[m[13:60] for _, m in MAPPING_FAULTS])
def test_each_fault_of_the_mapping_has_its_message(check, replacement, message):
    (fault,) = faults(check, replacement)
    assert fault.startswith(message)


def test_all_faults_come_at_once_those_of_the_file_and_those_of_the_mapping(check):
    found = faults(
        check,
        ("mass_kg: 1673", "mass_kg: 1673 kg"),
        ("signal: YAW_RATE, unit: deg/s", "signal: YAW, unit: deg/s"),
        ("signal: ACCEL_X, unit: m/s^2", "signal: ACCEL_X, unit: deg/s"),
        ("message: PEDALS, signal: BRAKE_ON", "message: PEDAL, signal: BRAKE_ON"),
    )
    assert [fault.split(": ")[1] for fault in found] == [
        "vehicle.mass_kg", "signals.gyro_z.signal", "signals.accel_x.unit", "signals.brake.message",
    ]  # fmt: skip


def test_nothing_is_said_to_be_missing_while_a_dbc_is(check):
    (fault,) = faults(check, ("imu.dbc]", "imus.dbc]"))
    assert "imus.dbc: no such file" in fault


def test_a_dbc_that_cannot_be_read_is_an_input_error(check):
    with pytest.raises(InputError) as caught:
        check(imu="hello\n")
    assert caught.value.exit_code == 3
    assert "config.yaml:14: signals.dbc: imu.dbc: can't be read: Invalid syntax at line 1" in str(caught.value)
    # With a fault of the configuration beside it, both are told.
    both = faults(check, ("signal: ACCEL_X", "signal: NOPE"), imu="hello\n")
    assert len(both) == 2


def test_the_extra_checks_faults_join_the_others_with_file_and_line(check):
    extra = [lambda settings: [Fault("vehicle.mass_kg", f"{settings.vehicle.mass_kg:g} is no good")]]
    assert faults(check, extra=extra) == ["config.yaml:2: vehicle.mass_kg: 1673 is no good"]
    found = faults(check, ("signal: ACCEL_X", "signal: NOPE"), extra=extra)
    assert len(found) == 2


@pytest.mark.parametrize(
    ("replacement", "warning"),
    [
        (
            ("signal: ACCEL_X, unit: m/s^2", "signal: ACCEL_X, unit: g"),
            "config.yaml:17: signals.accel_x.unit: configured as g, but the DBC says 'm/s2' for KINEMATICS.ACCEL_X",
        ),
        (
            ("signal: WHEEL_FL, unit: km/h", "signal: WHEEL_FL, unit: m/s"),
            "config.yaml:19: signals.wheel_speed_fl.unit: configured as m/s, but the DBC says 'KPH' for "
            "WHEEL_SPEEDS.WHEEL_FL",
        ),
        (
            ("signal: YAW_RATE, unit: deg/s", "signal: YAW_RATE, unit: rad/s"),
            "config.yaml:16: signals.gyro_z.unit: configured as rad/s, but the DBC says 'deg/sec' for KINEMATICS.YAW_RATE",
        ),
        (
            ("ROLL_ADC, volts_per_count: 7.63e-5, null_volts: 2.5, volts_per_unit: 0.007,", "ROLL_ADC,"),
            "config.yaml:15: signals.gyro_x.unit: configured as deg/s, but the DBC says 'counts' for IMU_RATE.ROLL_ADC",
        ),
        (
            ("yaw_inertia_kgm2: 2850", "yaw_inertia_kgm2: 28500"),
            "vehicle.yaw_inertia_kgm2: 28500 is unusual for this mass and wheelbase; most cars have about mass * "
            "cg_to_front * cg_to_rear = 2866",
        ),
    ],
)
def test_likely_mistakes_are_warned_of(check, replacement, warning):
    assert check(replacement).warnings == (warning,)


def without(*roles: str) -> list[tuple[str, str]]:
    lines = [line for line in CONFIG.splitlines(keepends=True) if line.strip().startswith(roles)]
    return [(line, "") for line in lines]


@pytest.mark.parametrize(
    ("roles", "warning"),
    [
        (
            ("wheel_speed_rl", "wheel_speed_rr"),
            "no wheel speed of rl, rr: the speed rests on driven wheels alone and is off whenever they slip under power",
        ),
        (
            ("wheel_speed_fl",),
            "no wheel speed of fl: a slipping wheel can't be told from the others as well, least of all when braking",
        ),
    ],
)
def test_a_part_of_the_wheels_costs_something_and_it_is_said(check, roles, warning):
    assert check(*without(*roles)).warnings == (warning,)


def test_which_wheels_are_driven_decides_what_their_absence_costs(check):
    rear_only = without("wheel_speed_fl", "wheel_speed_fr")
    (warning,) = check(*rear_only, ("driven_axle: front", "driven_axle: rear")).warnings
    assert "rests on driven wheels alone" in warning
    (warning,) = check(*rear_only).warnings
    assert "least of all when braking" in warning


def test_what_cannot_be_done_is_noted(check):
    assert check().notes == ("not mapped, so not zeroed: gyro_y, accel_z",)
    notes = check(
        *without("wheel_speed", "steering_wheel_angle", "brake", "gyro_z"), ("  driven_axle: front\n", "")
    ).notes
    assert notes == (
        "no wheel speeds, so no reference speed and no standstill: offsets of accel_x, accel_y can't be learnt",
        "no steering angle: straight-ahead driving is judged without it, and there is no observer",
        "no gyro_z: the yaw rate is taken from wheels or steering, which is coarser",
        "no brake signal: braking is told from deceleration, which is later",
        "not mapped, so not zeroed: gyro_y, accel_z",
    )


def test_what_is_assumed_is_noted(check):
    notes = check(("  driven_axle: front\n", ""), ("  front_track_m: 1.585\n", "")).notes
    assert "vehicle.driven_axle is not given: all is assumed" in notes
    assert "vehicle.front_track_m is not given: 1.55 is assumed" in notes


def test_a_channel_of_a_log_needs_no_bus_but_it_is_noted(check):
    notes = check(("channel: can0", "channel: can4")).notes
    assert "no bus for channel can4: enough for a log; dsz run needs it (bus: or --bus)" in notes


def test_an_unknown_interface_is_warned_of(check):
    buses = "bus: {can0: {interface: soketcan}, can1: {interface: virtual}}\n"
    (warning,) = check(("on_values: [1, 7]}\n", f"on_values: [1, 7]}}\n{buses}")).warnings
    assert warning.startswith(
        "bus.can0.interface: 'soketcan' is not known to python-can here; did you mean 'socketcan'"
    )


def test_the_first_dbc_wins_and_a_second_layout_is_warned_of(check):
    again = IMU + 'BO_ 36 KINEMATICS: 8 X\n SG_ YAW_RATE : 8|16@1- (0.01,0) [-327|327] "deg/s" X\n'
    result = check(imu=again)
    assert result.warnings == ("message 'KINEMATICS' differs between car.dbc and imu.dbc; the first is used",)
    assert len(result.resolved.messages["KINEMATICS"].signals) == 4
    same = IMU + CAR.split("\n\n")[2] + "\n"
    assert check(imu=same).warnings == ()


def test_two_messages_of_one_id_are_warned_of_unless_channels_part_them(check):
    shared = IMU.replace("BO_ 768", "BO_ 36")
    (warning,) = check(imu=shared).warnings
    assert warning == (
        "messages 'IMU_RATE' and 'KINEMATICS' share id 0x24: every such frame is read as both; give their signals a "
        "channel each"
    )
    apart = [("0.007, unit: deg/s}", "0.007, unit: deg/s, channel: can1}")]
    apart += [(f"signal: ACCEL_{axis}, ", f"signal: ACCEL_{axis}, channel: can0, ") for axis in "XY"]
    assert check(*apart, imu=shared).warnings == ()


def test_a_lenient_dbc_is_a_note_and_a_warning_only_where_it_is_used(check):
    unused = CAR + '\nBO_ 900 OTHER: 8 X\n SG_ A : 0|8@1+ (1,0) [0|1] "" X\n SG_ B : 4|8@1+ (1,0) [0|1] "" X\n'
    result = check(car=unused)
    assert result.warnings == ()
    assert any("read leniently" in note for note in result.notes)
    used = CAR.replace("SG_ BRAKE_ON : 0|1", "SG_ BRAKE_ON : 8|1")
    (warning,) = check(car=used).warnings
    assert warning.startswith("message 'PEDALS' of car.dbc is in doubt: The signals")


def test_resolve_checks_settings_made_in_code_as_well(check, tmp_path):
    check()
    settings = load_settings(tmp_path / "config.yaml")
    assert resolve(settings, tmp_path).sources == check().resolved.sources
    roles = settings.signals.model_copy(update={"accel_y": settings.signals.accel_x})
    with pytest.raises(ConfigError, match=r"signals\.accel_y: is the same signal as accel_x"):
        resolve(settings.model_copy(update={"signals": roles}), tmp_path)
