"""Sensors on a drive: the drawn place, drifting nulls in the truth, pole counting and clocks in whole scenarios."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsz_daemon.sim.car import TUCSON
from dsz_daemon.sim.driver import Programme, SineSteer, SpeedChange
from dsz_daemon.sim.road import FLAT
from dsz_daemon.sim.scenario import Scenario, SimulatedDrive, drawn_errors, simulate_scenario
from dsz_daemon.sim.sensor_draws import draw_datasheet_errors
from dsz_daemon.sim.sensors import SensorErrors, WarmUp

SHORT = Scenario(
    "a short drive for the tests",
    TUCSON,
    FLAT,
    Programme(6.0, (SpeedChange(0.2, 3.7, 7.0),), (SineSteer(4.0, 0.6, 1, math.radians(90.0)),)),
)


def driven(errors: SensorErrors, seed: int = 1) -> SimulatedDrive:
    return simulate_scenario("short", SHORT, seed, errors)


def test_another_place_feels_the_bodys_turning() -> None:
    near, far = (
        driven(SensorErrors(imu_place_m=(0.0, 0.0, 0.0))).truth,
        driven(SensorErrors(imu_place_m=(0.8, -0.3, 0.2))).truth,
    )
    p, q, r = (near[f"gyro_{axis}_radps"] for axis in "xyz")
    p_rate, q_rate, r_rate = (np.gradient(rate, 0.01) for rate in (p, q, r))
    x, y, z = 0.8, -0.3, 0.2
    # a + w' x d + w x (w x d), axis by axis.
    expected = {
        "x": q_rate * z - r_rate * y - (q * q + r * r) * x + p * q * y + p * r * z,
        "y": r_rate * x - p_rate * z - (p * p + r * r) * y + p * q * x + q * r * z,
        "z": p_rate * y - q_rate * x - (p * p + q * q) * z + p * r * x + q * r * y,
    }
    turning = near["time_s"] - near["time_s"][0] > 3.9
    for axis, difference in expected.items():
        felt = far[f"accel_{axis}_mps2"] - near[f"accel_{axis}_mps2"]
        assert felt[turning] == pytest.approx(difference[turning], abs=0.02)
        assert np.abs(difference[turning]).max() > 0.05
    # Without a place of its own the IMU sits where the car has it.
    at_home = driven(SensorErrors()).truth
    same = driven(SensorErrors(imu_place_m=(TUCSON.imu_x_m, TUCSON.imu_y_m, TUCSON.imu_z_m))).truth
    assert all(np.array_equal(same[name], column) for name, column in at_home.items())


def test_the_truth_follows_the_drifting_null_error() -> None:
    wrong = SensorErrors(
        gyro_offset_radps=(0.01, 0.0, 0.0),
        gyro_drift_radps_per_s=(2e-4, 0.0, 0.0),
        accel_drift_mps2_per_k=(0.0, 0.0, 0.01),
        warm_up=WarmUp(20.0, 30.0, 2.0),
    )
    truth = driven(wrong).truth
    t = truth["time_s"] - truth["time_s"][0]
    assert truth["gyro_x_offset_radps"] == pytest.approx(0.01 + 2e-4 * t, abs=1e-9)
    assert truth["accel_z_offset_mps2"] == pytest.approx(0.1 * (1.0 - np.exp(-t / 2.0)), abs=1e-7)
    assert not truth["accel_x_offset_mps2"].any()


def test_a_car_that_nobody_calibrated_drives_the_same_way_every_time() -> None:
    errors = draw_datasheet_errors(np.random.default_rng(5))
    one, other = driven(errors), driven(errors)
    assert one.frames == other.frames
    assert driven(errors, seed=2).frames != one.frames
    assert one.parameters["sensors"]["converter_bits"] == errors.converter_bits


def test_the_drawn_scenario_counts_poles() -> None:
    drive = driven(drawn_errors(1))
    plain = driven(drawn_errors(1).offsets_only())

    def rear_left_kmh(which: SimulatedDrive) -> list[float]:
        frames = [frame for frame in which.frames if frame.can_id == 902]
        return [(int.from_bytes(frame.data[4:6], "little") & 0x3FFF) * 0.03125 for frame in frames]

    counted, sampled = np.array(rear_left_kmh(drive)), np.array(rear_left_kmh(plain))
    rolling = sampled > 4.0
    # At 4 km/h one pole takes 40 ms: late by up to one and a half, which at 3 m/s^2 is 0.65 km/h.
    assert counted[rolling] == pytest.approx(sampled[rolling], abs=0.65)
    # Later by 10 to 25 ms, which at 2 m/s^2 and more is 0.07 to 0.25 km/h.
    speeding = rolling & (np.arange(len(sampled)) < 3.2 / 0.02)
    assert 0.07 < np.mean(sampled[speeding] - counted[speeding]) < 0.25
    assert len(drive.frames) == len(plain.frames)
