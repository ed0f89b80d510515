"""Scenarios: what is recorded decodes back to what was true; one seed, one result."""

from __future__ import annotations

import importlib
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
import yaml
from cantools.database.can import Database
from numpy.typing import NDArray

from dsz_daemon.config.load import load_settings
from dsz_daemon.edge.scenario_files import write_scenario
from dsz_daemon.errors import ConfigError, MachineError
from dsz_daemon.sim.car import TUCSON
from dsz_daemon.sim.catalogue import SCENARIOS, Scenario
from dsz_daemon.sim.drive import drive
from dsz_daemon.sim.driver import Programme, SineSteer, SpeedChange
from dsz_daemon.sim.road import FLAT, constant_road
from dsz_daemon.sim.scenario import (
    SimulatedDrive,
    drawn_errors,
    scenario_names,
    simulate,
    simulate_scenario,
)
from dsz_daemon.sim.vehicle import TwoTrackCar

SHORT = Scenario(
    "a short drive for the tests",
    TUCSON,
    FLAT,
    Programme(4.0, (SpeedChange(0.5, 3.0, 6.0),), (SineSteer(2.0, 0.5, 1, math.radians(60.0)),)),
)
Series = tuple[NDArray[np.float64], NDArray[np.float64]]
IMU = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz"]


def suffix(channel: str) -> str:
    return "radps" if channel.startswith("gyro") else "mps2"


@pytest.fixture(scope="module")
def sine_steer() -> SimulatedDrive:
    return simulate("sine_steer", 7)


@pytest.fixture(scope="module")
def short() -> SimulatedDrive:
    return simulate_scenario("short", SHORT, 7, drawn_errors(7).offsets_only())


def decoded(drive: SimulatedDrive, role: str) -> Series:
    """A second decoder: the configuration read as `CONTRACT.md` has it, by cantools alone."""
    entry = drive.config["signals"][role]
    database = Database()
    for name in drive.config["signals"]["dbc"]:
        database.add_dbc_string(drive.dbc_files[name])
    message = database.get_message_by_name(entry["message"])
    frames = [f for f in drive.frames if f.can_id == message.frame_id and not f.is_extended]
    values = np.array([message.decode(f.data)[entry["signal"]] for f in frames], dtype=float)
    if "volts_per_count" in entry:
        values = (values * entry["volts_per_count"] - entry["null_volts"]) / entry["volts_per_unit"]
    factors = {"deg/s": math.pi / 180.0, "g": 9.80665, "km/h": 1.0 / 3.6, "deg": math.pi / 180.0}
    time_s = np.array([f.t_ns * 1e-9 for f in frames])
    known = time_s <= drive.truth["time_s"][-1]  # the last frames come after the truth's last row
    return time_s[known], values[known] * factors.get(entry.get("unit"), 1.0)


def truth_at(drive: SimulatedDrive, column: str, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.interp(time_s, drive.truth["time_s"], drive.truth[column])


@pytest.mark.parametrize("channel", IMU)
def test_reading_is_truth_plus_offset_plus_noise_of_the_data_sheet(short: SimulatedDrive, channel: str) -> None:
    time_s, reading = decoded(short, channel)
    offset = short.truth[f"{channel}_offset_{suffix(channel)}"]
    assert np.ptp(offset) == 0.0
    error = reading - truth_at(short, f"{channel}_{suffix(channel)}", time_s) - offset[0]
    gyro, accel = 0.03 * math.sqrt(50.0) * math.pi / 180.0, 110e-6 * math.sqrt(50.0) * 9.80665
    noise = gyro if channel.startswith("gyro") else accel
    assert error.std() == pytest.approx(noise, rel=0.15)
    assert abs(error.mean()) < 5.0 * noise / math.sqrt(len(error))


def test_wheels_steering_and_pedals_decode_to_the_truth(short: SimulatedDrive) -> None:
    for wheel in ("fl", "fr", "rl", "rr"):
        time_s, speed = decoded(short, f"wheel_speed_{wheel}")
        true = truth_at(short, f"wheel_speed_{wheel}_mps", time_s)
        rolling = true > 0.4
        assert rolling.sum() > 50
        error = np.abs(speed - true)[rolling]
        assert np.quantile(error, 0.95) < 0.5 * 0.03125 / 3.6 + 2e-4
        assert error.max() < 0.03125 / 3.6  # wheels swing at 30 Hz where the torque's slope jumps
        assert np.all(speed[true < 0.25] == 0.0)
    time_s, wheel_rad = decoded(short, "steering_wheel_angle")
    road_rad = truth_at(short, "road_wheel_angle_rad", time_s)
    assert np.abs(wheel_rad / 15.7 - road_rad).max() < math.radians(0.05 / 15.7) + 3e-5
    assert wheel_rad.max() > 1.0
    assert wheel_rad.min() < -1.0
    time_s, brake = decoded(short, "brake")
    assert np.array_equal(brake == 1.0, time_s - 1.7e9 < 0.5)
    _, gas = decoded(short, "accelerator")
    assert not np.any((gas == 1.0) & (brake == 1.0))
    assert gas.sum() > 50


def test_truth_is_a_row_per_10_ms_and_at_rest_it_is_gravity_alone(sine_steer: SimulatedDrive) -> None:
    truth = sine_steer.truth
    assert {len(column) for column in truth.values()} == {6000}
    assert np.diff(truth["time_s"]) == pytest.approx(np.full(5999, 0.01), abs=3e-7)
    assert truth["time_s"][0] == 1.7e9
    assert all(np.isfinite(column).all() for column in truth.values())
    rest = truth["time_s"] - 1.7e9 < 5.0
    for channel, value in zip(IMU, [0.0] * 5 + [9.80665], strict=True):
        assert truth[f"{channel}_{suffix(channel)}"][rest] == pytest.approx(np.full(rest.sum(), value), abs=1e-9)
    assert np.all(truth["road_bank_rad"] == 0.0)
    assert truth["roll_rad"][rest] == pytest.approx(np.zeros(rest.sum()), abs=1e-9)


def test_sine_steer_is_the_papers_experiment(sine_steer: SimulatedDrive) -> None:
    truth, t = sine_steer.truth, sine_steer.truth["time_s"] - 1.7e9
    assert 16.6 < truth["speed_mps"].max() < 19.5
    assert truth["speed_mps"][t < 5.0].max() == pytest.approx(0.0, abs=1e-9)
    assert abs(truth["speed_mps"][-1]) < 0.01
    steering = np.abs(truth["road_wheel_angle_rad"]) > 1e-6
    assert steering[(t > 11.05) & (t < 12.2)].all()
    straight_fast = ~steering & (truth["speed_mps"] > 10.0)
    assert straight_fast[(t > 14.0) & (t < 18.9)].all()
    assert straight_fast.mean() > 0.25
    assert np.abs(truth["accel_y_mps2"]).max() > 4.0
    # Integrating yaw rate gives yaw, and the true side acceleration is that of the motion.
    yaw = np.cumsum(truth["gyro_z_radps"]) * 0.01
    assert yaw == pytest.approx(truth["yaw_rad"], abs=0.01)


def test_frames_are_in_time_order_and_some_are_nobodys(sine_steer: SimulatedDrive) -> None:
    stamps = [frame.t_ns for frame in sine_steer.frames]
    assert stamps == sorted(stamps)
    assert all(t % 1000 == 0 for t in stamps)
    described = {0x500, 0x501, 688, 902, 809}
    ids = {(frame.can_id, frame.is_extended) for frame in sine_steer.frames}
    assert ids > {(i, False) for i in described}
    assert (0x18FEF100, True) in ids
    counts = {i: sum(f.can_id == i for f in sine_steer.frames) for i in described}
    assert counts == {0x500: 6000, 0x501: 6000, 688: 6000, 902: 3000, 809: 3000}


def test_same_seed_same_frames_other_seed_other_offsets(short: SimulatedDrive) -> None:
    again = simulate_scenario("short", SHORT, 7, drawn_errors(7).offsets_only())
    assert again.frames == short.frames
    assert all(np.array_equal(again.truth[name], column) for name, column in short.truth.items())
    other = simulate_scenario("short", SHORT, 8, drawn_errors(8).offsets_only())
    for channel in IMU:
        name = f"{channel}_offset_{suffix(channel)}"
        assert other.truth[name][0] != short.truth[name][0]
    assert other.frames != short.frames
    assert np.array_equal(other.truth["speed_mps"], short.truth["speed_mps"])


def test_without_noise_the_error_is_less_than_a_count(short: SimulatedDrive) -> None:
    quiet = simulate_scenario("short", SHORT, 7, replace(drawn_errors(7).offsets_only(), noisy=False))
    time_s, reading = decoded(quiet, "accel_y")
    error = reading - truth_at(short, "accel_y_mps2", time_s) - short.truth["accel_y_offset_mps2"][0]
    assert len(error) == 399
    assert np.abs(error).max() < 7.63e-5 * 9.80665 / 2 + 1e-4


def test_unknown_name_and_negative_seed_are_the_users_errors() -> None:
    assert "sine_steer" in scenario_names()
    with pytest.raises(ConfigError) as caught:
        simulate("sinesteer", 0)
    assert "'sinesteer'" in str(caught.value)
    assert "did you mean 'sine_steer'?" in str(caught.value)
    with pytest.raises(ConfigError, match="-1 is negative"):
        simulate("sine_steer", -1)


def test_files_are_complete_and_the_same_every_time(short: SimulatedDrive, tmp_path: Path) -> None:
    first, second = tmp_path / "a" / "deep", tmp_path / "b"
    write_scenario(short, first)
    write_scenario(simulate_scenario("short", SHORT, 7, drawn_errors(7).offsets_only()), second)
    names = ["car.dbc", "config.yaml", "imu.dbc", "recording.log", "truth.parquet"]
    assert sorted(path.name for path in first.iterdir()) == names
    for name in names:
        assert (first / name).read_bytes() == (second / name).read_bytes(), name
    config = yaml.safe_load((first / "config.yaml").read_text())
    assert config == short.config
    assert load_settings(first / "config.yaml").vehicle.mass_kg == 1673.0
    for name in config["signals"]["dbc"]:
        database = Database()
        database.add_dbc_file(first / name)
        assert database.messages
    truth = pyarrow.parquet.read_table(first / "truth.parquet").to_pydict()
    assert list(truth) == list(short.truth)
    assert truth["accel_z_mps2"] == short.truth["accel_z_mps2"].tolist()
    lines = (first / "recording.log").read_text().splitlines()
    assert len(lines) == len(short.frames)
    assert lines[0].startswith("(1700000000.000000) can0 500#")
    assert any(" 18FEF100#" in line for line in lines)


def test_configuration_is_the_contracts(short: SimulatedDrive) -> None:
    config = short.config
    assert set(config) == {"vehicle", "signals", "bus"}
    assert config["vehicle"] == {
        "mass_kg": 1673,
        "yaw_inertia_kgm2": 2850,
        "cg_to_front_axle_m": 1.149,
        "cg_to_rear_axle_m": 1.491,
        "front_track_m": 1.585,
        "rear_track_m": 1.586,
        "cg_height_m": 0.66,
        "front_cornering_stiffness_n_per_rad": 62000,
        "rear_cornering_stiffness_n_per_rad": 68000,
        "steering_ratio": 15.7,
        "driven_axle": "front",
        "wheel_radius_m": {"fl": 0.337, "fr": 0.337, "rl": 0.340, "rr": 0.340},
    }
    assert config["signals"]["gyro_x"] == {
        "message": "IMU_RATE",
        "signal": "ROLL_ADC",
        "volts_per_count": 7.63e-5,
        "null_volts": 2.5,
        "volts_per_unit": 0.007,
        "unit": "deg/s",
    }
    wheels = [f"wheel_speed_{w}" for w in ("fl", "fr", "rl", "rr")]
    assert list(config["signals"]) == ["dbc", *IMU, *wheels, "steering_wheel_angle", "brake", "accelerator"]


def test_missing_pyarrow_and_unwritable_folder_are_said(
    short: SimulatedDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(MachineError, match=r"file.*can't make the folder"):
        write_scenario(short, tmp_path / "file")
    (tmp_path / "taken" / "config.yaml").mkdir(parents=True)
    with pytest.raises(MachineError, match=r"config\.yaml: can't write the file"):
        write_scenario(short, tmp_path / "taken")
    real = importlib.import_module

    def without_pyarrow(name: str, package: str | None = None) -> Any:
        if name.startswith("pyarrow"):
            raise ImportError(name)
        return real(name, package)

    monkeypatch.setattr(importlib, "import_module", without_pyarrow)
    with pytest.raises(MachineError, match=r"pip install dsz-daemon\[desk\]"):
        write_scenario(short, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_the_second_experiment_is_the_papers() -> None:
    """Section 6.3: more than 6 deg down from about 25 s on, nearly 6 deg of bank on the way, zeroing at 20.9 s."""
    hill = SCENARIOS["bank_and_incline"]
    columns = drive(TwoTrackCar(hill.car, hill.road), hill.programme)
    time_s, grade = columns["time_s"], np.degrees(columns["road_grade_up_rad"])
    bank = np.degrees(columns["road_bank_rad"])
    assert time_s[np.argmax(grade < -6.0)] == pytest.approx(25.0, abs=0.2)
    assert np.all(grade[(time_s > 25.5) & (time_s < 40.0)] == pytest.approx(-6.5))
    assert bank.max() == pytest.approx(5.8)
    assert np.all(grade[bank > 5.0] < -6.0)
    assert time_s[np.argmax(columns["speed_mps"] > 8.0)] == pytest.approx(20.9, abs=0.1)
    assert np.abs(columns["off_middle_m"]).max() < 0.5
    # Gravity along the slope and across the bank, and with it the lean of a body on springs.
    banked = (time_s > 31.0) & (time_s < 35.0)
    down, aside = 9.80665 * math.sin(math.radians(-6.5)), 9.80665 * math.sin(math.radians(5.8))
    assert 1.0 < columns["accel_x_mps2"][banked].mean() / down < 1.06
    assert 1.1 < columns["accel_y_mps2"][banked].mean() / aside < 1.2
    assert columns["speed_mps"][-1] == pytest.approx(0.0, abs=1e-3)


def test_a_parked_car_stays_on_its_slope() -> None:
    """Brakes hold like a spring: nothing creeps in half a minute on a grade of 20 % with a bank."""
    standing = Programme(30.0, ())
    columns = drive(TwoTrackCar(TUCSON, constant_road(0.05, 0.2)), standing)
    assert abs(columns["distance_m"][-1]) < 0.05
    assert np.abs(columns["speed_mps"][-5000:]).max() < 1e-4
    # `pitch_rad` is all of the attitude: road and suspension.
    assert columns["accel_x_mps2"][-1] == pytest.approx(-9.80665 * math.sin(columns["pitch_rad"][-1]), abs=1e-3)
    assert columns["pitch_rad"][-1] < -0.2
