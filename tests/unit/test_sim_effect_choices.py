"""Effects as they are chosen: on the command line, in any order; and what stays as it is whatever is chosen."""

from __future__ import annotations

import json
import math
import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dsz_daemon.cli import main
from dsz_daemon.edge.scenario_files import write_scenario
from dsz_daemon.errors import ConfigError
from dsz_daemon.sim.car import TUCSON
from dsz_daemon.sim.catalogue import SCENARIOS, Scenario
from dsz_daemon.sim.drive import drive
from dsz_daemon.sim.driver import Programme, SineSteer, SpeedChange
from dsz_daemon.sim.effect_words import choices, vocabulary
from dsz_daemon.sim.effects import EFFECTS, Choice, described, faults, with_effect, with_effects
from dsz_daemon.sim.road import FLAT, tabled_road
from dsz_daemon.sim.scenario import drawn_errors, simulate, simulate_scenario
from dsz_daemon.sim.sensors import SensorErrors
from dsz_daemon.sim.vehicle import TwoTrackCar, rolling
from dsz_daemon.sim.world import World, nominal

SHORT = Scenario(
    "a moment of a turn",
    TUCSON,
    FLAT,
    Programme(0.6, (SpeedChange(-2.0, -1.0, 10.0),), (SineSteer(0.1, 1.0, 1, math.radians(60.0)),)),
    start_mps=10.0,
)
WORLD = World(SHORT.car, SHORT.road, SHORT.programme, SensorErrors(noisy=False))


def written(folder: Path, effects: list[Choice], from_nominal: bool = False) -> dict[str, bytes]:
    write_scenario(simulate_scenario("short", SHORT, 7, drawn_errors(7), None, effects, from_nominal), folder)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return written(tmp_path_factory.mktemp("plain"), [])


# In these six tenths of a second they have nothing to do, or say nothing else than the nominal car's default.
QUIET = {"low_friction", "wheel_speed_delay", "tyre_saturation"}


@pytest.mark.parametrize("name", EFFECTS)
def test_the_configuration_stays_the_nominal_cars_to_the_byte(
    name: str, plain: dict[str, bytes], tmp_path: Path
) -> None:
    files = written(tmp_path, [Choice(name)])
    for kept in ("config.yaml", "car.dbc", "imu.dbc"):
        assert files[kept] == plain[kept]
    if name not in QUIET:
        assert files["recording.log"] != plain["recording.log"]


def test_a_nominal_drive_keeps_the_configuration_too(plain: dict[str, bytes], tmp_path: Path) -> None:
    everything = [Choice(name) for name in EFFECTS]
    files = written(tmp_path, everything, from_nominal=True)
    assert files["config.yaml"] == plain["config.yaml"]
    assert files["recording.log"] != plain["recording.log"]


def everything_about(world: World) -> list[np.ndarray]:
    """The motion in this world, and all of its sensors' errors."""
    columns = drive(TwoTrackCar(world.car, world.road), world.programme, start=rolling(world.car, 10.0))
    return list(columns.values())


def test_effects_in_any_order_are_the_same_world() -> None:
    chosen = [Choice(name) for name in EFFECTS]
    chosen.append(Choice("axis_fault", {"channel": "gyro_z", "kind": "rad_for_deg"}))
    in_order = with_effects(WORLD, chosen)
    motion = everything_about(in_order)
    assert all(np.isfinite(column).all() for column in motion)
    for seed in (1, 2):
        random.Random(seed).shuffle(chosen)
        shuffled = with_effects(WORLD, chosen)
        assert (shuffled.car, shuffled.errors) == (in_order.car, in_order.errors)
        for one, other in zip(motion, everything_about(shuffled), strict=True):
            np.testing.assert_array_equal(one, other)


def test_what_is_not_given_stays_as_it_is() -> None:
    car = with_effect(WORLD, "imu_lever_arm", x_m=1.0).car
    assert (car.imu_x_m, car.imu_y_m, car.imu_z_m) == (1.0, TUCSON.imu_y_m, TUCSON.imu_z_m)
    scaled = replace(WORLD, errors=SensorErrors(gyro_scale=(0.01, 0.02, 0.03)))
    assert with_effect(scaled, "gyro_scale", y=0.5).errors.gyro_scale == (0.01, 0.5, 0.03)
    assert with_effect(WORLD, "wheel_radius", rl=1.02).car.wheel_radius_scale == (1.0, 1.0, 1.02, 1.0)
    assert with_effect(WORLD, "steering_ratio", per_rad=0.05).car.steering_ratio_scale == 1.0
    assert with_effect(WORLD, "mass_loading", added_mass_kg=100.0).car.cg_to_front_axle_m == TUCSON.cg_to_front_axle_m
    assert with_effect(WORLD, "cornering_stiffness", rear_scale=0.5).car == replace(
        TUCSON, rear_cornering_stiffness_n_per_rad=34000.0
    )
    assert with_effect(WORLD, "sensor_saturation", gyro_limit_radps=1.0).errors.accel_limit_mps2 is None
    # How, not how much: as the table says.
    told = described([Choice("side_wind", {"rms_n": "300"}), Choice("imu_delay")])
    assert told == [
        {"effect": "side_wind", "parameters": {"rms_n": 300.0, "correlation_s": 0.5, "seed": 3.0}},
        {"effect": "imu_delay", "parameters": {"delay_s": 0.05}},
    ]


def test_the_nominal_world_takes_everything_out_and_keeps_the_bends() -> None:
    bend = tabled_road(100.0, lambda s: 0.01 * s, lambda s: 0.001 * s, lambda s: 1e-3 * s)
    heights = 1e-3 * np.ones(len(bend.bend_per_m))
    rough = bend._replace(rough=np.column_stack([heights] * 4))
    world = replace(WORLD, road=rough)
    # Of these the springs, tyres and masses stay, where they are what the car is; its road is flat in any case.
    stays = {"road_bank", "road_grade", "suspension_roll", "suspension_pitch", "wheel_slip", "mass_loading"}
    out = EFFECTS.keys() - stays - {"cornering_stiffness"}
    clean, full = nominal(world), nominal(with_effects(world, [Choice(name) for name in out]))
    assert (full.car, full.errors, full.programme) == (clean.car, clean.errors, clean.programme)
    assert not clean.road.tilt.any()
    assert not clean.road.rough.any()
    np.testing.assert_array_equal(clean.road.bend_per_m, bend.bend_per_m)
    assert (clean.road.step_m, len(clean.road.tilt)) == (bend.step_m, len(bend.tilt))


def test_offsets_and_noise_stay_in_the_nominal_world() -> None:
    errors = drawn_errors(3)
    kept = nominal(replace(WORLD, errors=errors)).errors
    assert kept == SensorErrors(errors.gyro_offset_radps, errors.accel_offset_mps2)


def test_an_icy_while_on_snow_leaves_the_snow_where_it_was() -> None:
    snow = replace(WORLD, programme=replace(SHORT.programme, friction_limit=lambda t: np.full(len(t), 0.3)))
    limit = with_effect(snow, "low_friction", friction_coefficient=0.1, start_s=2.0, end_s=4.0).programme.friction_limit
    assert limit is not None
    assert limit(np.array([0.0, 2.0, 3.9, 4.0])).tolist() == [0.3, 0.1, 0.1, 0.3]


def test_words_become_choices() -> None:
    found, wrong = choices(["imu_lever_arm:x_m=0.5,z_m=0.2", "imu_delay", "axis_fault: kind = reversed , channel=4"])
    assert not wrong
    assert found == [
        Choice("imu_lever_arm", {"x_m": "0.5", "z_m": "0.2"}),
        Choice("imu_delay", {}),
        Choice("axis_fault", {"kind": "reversed", "channel": "4"}),
    ]
    assert not faults(found)
    for text in ("imu_delay:", "imu_delay:delay_s", "imu_delay:delay_s=", "imu_delay:=1", "imu_delay:delay_s=1,,"):
        assert "expected NAME or NAME:KEY=VALUE" in str(choices([text])[1][0])
    assert "there twice" in str(choices(["imu_delay:delay_s=1,delay_s=2"])[1][0])


@pytest.mark.parametrize(
    ("name", "given", "says"),
    [
        ("side_wnd", {}, "unknown effect 'side_wnd'; did you mean 'side_wind'"),
        ("imu_lever_arm", {"xm": "1"}, "xm: unknown parameter; did you mean 'x_m'"),
        ("imu_lever_arm", {"x_m": "half"}, "x_m: 'half' is no number; expected -5 to 5"),
        ("imu_lever_arm", {"x_m": "nan"}, "x_m: 'nan' is no number"),
        ("imu_lever_arm", {"x_m": "inf"}, "x_m: inf m; expected -5 to 5"),
        ("sensor_bandwidth", {"cutoff_hz": "0"}, "cutoff_hz: 0 Hz; expected 0.001 to 10000"),
        ("axis_fault", {"kind": "reverse"}, "'reverse' is none of its words; did you mean 'reversed'"),
        ("axis_fault", {"channel": "4.5"}, "channel: 4.5; expected 0 to 5"),
        ("axis_fault", {"channel": "gyro_y", "kind": "swapped_with_y"}, "gyro_y can't be swapped with itself"),
        ("axis_fault", {"channel": "gyro_y", "kind": "g_for_mps2"}, "no unit of gyro_y; expected rad_for_deg or deg"),
        ("axis_fault", {"channel": "accel_y", "kind": "deg_for_rad"}, "no unit of accel_y; expected mps2_for_g or g"),
        ("low_friction", {"start_s": "40"}, "ends at 30 s; expected after its start, 40 s"),
    ],
)
def test_what_is_wrong_is_said_with_what_was_expected(name: str, given: dict[str, str], says: str) -> None:
    assert [says in str(fault) for fault in faults([Choice(name, given)])] == [True]
    with pytest.raises(ConfigError):
        with_effects(WORLD, [Choice(name, given)])


def test_twice_the_same_is_said_but_for_faults_of_several_axes() -> None:
    assert "given twice" in str(faults([Choice("imu_delay"), Choice("imu_delay")])[0])
    assert not faults([Choice("axis_fault"), Choice("axis_fault", {"channel": "gyro_x"})])


def test_a_wrong_command_line_says_everything_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    words = ["simulate", "sinesteer", "-o", str(folder), "--seed", "-1"]
    effects = ["side_wnd", "imu_lever_arm:x_m=9", "imu_delay:delay_s", "imu_misalignment:yaw=1"]
    code = main([*words, *(word for effect in effects for word in ("--effect", effect))])
    said = capsys.readouterr().err
    assert code == 2
    assert not folder.exists()
    for part in ("sine_steer", "-1 is negative", "side_wind", "9 m; expected -5 to 5", "KEY=VALUE", "yaw_rad"):
        assert part in said


def test_effects_are_listed_with_all_there_is_to_know(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["simulate", "--effects"])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert said == vocabulary()
    for effect in EFFECTS.values():
        block = said.split(f"\n{effect.name}", 1)[1].split("\n\n", 1)[0]
        assert effect.statement in block
        for key, parameter in effect.parameters.items():
            line = next(line for line in block.splitlines() if line.split()[0] == key)
            assert (parameter.unit if parameter.unit != "1" else "") in line
            assert parameter.default is None or parameter.words or f"{parameter.default:g}" in line


def test_effects_on_the_command_line_are_in_the_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SCENARIOS, "short", SHORT)
    effects = ["--effect", "imu_lever_arm:x_m=0.5,z_m=0.2", "--effect", "axis_fault:channel=gyro_x,kind=reversed"]
    assert main(["simulate", "short", "-o", str(tmp_path), "--nominal", *effects, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["parameters"]
    assert told["effects"] == [
        {"effect": "imu_lever_arm", "parameters": {"x_m": 0.5, "z_m": 0.2}},
        {"effect": "axis_fault", "parameters": {"channel": "gyro_x", "kind": "reversed"}},
    ]
    assert told["nominal"] is True
    assert (told["car"]["imu_x_m"], told["car"]["imu_y_m"], told["car"]["imu_z_m"]) == (0.5, 0.0, 0.2)
    kept = json.loads((tmp_path / "parameters.json").read_text())
    assert {key: kept[key] for key in told} == told
    assert (kept["scenario"], kept["seed"]) == ("short", 1)


ICY = [Choice("low_friction", {"friction_coefficient": 0.02, "start_s": 0.0, "end_s": 3.0})]


def test_a_car_that_is_thrown_about_is_refused() -> None:
    """One that slides sideways, and then finds the nominal world's endless grip."""
    swerve = SineSteer(0.1, 0.5, 1, math.radians(400.0))
    wet = [Choice("low_friction", {"friction_coefficient": 0.2, "start_s": 0.0, "end_s": 3.0})]
    sliding = Scenario("sliding", TUCSON, FLAT, Programme(4.0, (), (swerve,)), start_mps=30.0)
    with pytest.raises(ConfigError, match=r"--effect: the car is thrown about at 3\.0 s.*expected weaker effects"):
        simulate_scenario("sliding", sliding, 1, SensorErrors(), None, wet, from_nominal=True)


def test_wheels_spin_on_ice_where_they_slip_at_all() -> None:
    pulling = Scenario("driving off", TUCSON, FLAT, Programme(4.0, (SpeedChange(0.0, 1.0, 10.0),)))
    # First on ice, then on asphalt.
    spinning = simulate_scenario("pulling", pulling, 1, SensorErrors(), None, ICY)
    assert spinning.truth["wheel_speed_fl_mps"].max() > 10.0
    felt = np.abs(spinning.truth["accel_x_mps2"])
    assert felt[1] == pytest.approx(0.02 * 9.80665 * 1.491 / 2.64, rel=0.05)
    assert felt.max() < 9.80665
    # Wheels that are said not to slip store nothing unseen, that endless grip would set free.
    rolling_off = simulate_scenario("pulling", pulling, 1, SensorErrors(), None, ICY, from_nominal=True)
    assert np.abs(rolling_off.truth["accel_x_mps2"]).max() < 15.0
    braking = Scenario("stopping", TUCSON, FLAT, Programme(4.0, (SpeedChange(0.0, 2.0, -2.0),)), start_mps=20.0)
    stopping = simulate_scenario("stopping", braking, 1, SensorErrors(), None, ICY, from_nominal=True)
    # The driver makes up for it with 17 m/s^2; with wheels that had locked it was more than 50.
    assert np.abs(stopping.truth["accel_x_mps2"]).max() < 40.0


def test_simulate_takes_effects_by_their_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SCENARIOS, "short", SHORT)
    late = simulate("short", 7, effects=["imu_delay:delay_s=0.02"])
    plain = simulate("short", 7)
    assert late.frames != plain.frames
    for name, column in plain.truth.items():  # what truly happened is not late
        np.testing.assert_array_equal(late.truth[name], column)
