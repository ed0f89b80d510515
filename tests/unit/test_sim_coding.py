"""From columns to frames: delays, clocks, jitter and streams, on motion known in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.sim.bus import database
from dsz_daemon.sim.coding import EPOCH_S, can_frames
from dsz_daemon.sim.drive import COLUMNS, Columns
from dsz_daemon.sim.sensor_draws import draw_datasheet_errors, draw_errors
from dsz_daemon.sim.sensors import Clocks, PoleRing, SensorErrors, UnitClock

DEG = math.pi / 180.0
G = 9.80665
QUIET = SensorErrors(noisy=False)
RADII_M = (0.337, 0.337, 0.340, 0.340)
RATIO = 15.7
COUNT_RADPS, COUNT_MPS2 = 7.63e-5 / 0.007 * DEG, 7.63e-5 * G
# Everything grows evenly, each by its own rate per second; the wheels are at 20 m/s to begin with.
RISE = {
    "gyro_x_radps": 0.1,
    "gyro_y_radps": -0.2,
    "gyro_z_radps": 0.3,
    "accel_x_mps2": 1.0,
    "accel_y_mps2": -2.0,
    "accel_z_mps2": 0.5,
    "steering_wheel_angle_rad": 0.6,
    "wheel_speed_fl_mps": 1.0,
    "wheel_speed_fr_mps": 1.5,
    "wheel_speed_rl_mps": 2.0,
    "wheel_speed_rr_mps": 2.5,
}
Series = tuple[NDArray[np.float64], NDArray[np.float64]]


def begin(name: str) -> float:
    return 20.0 if name.startswith("wheel_speed") else 0.0


@pytest.fixture(scope="module")
def columns() -> Columns:
    time_s = np.arange(2001) * 0.002
    rising = {name: begin(name) + RISE.get(name, 0.0) * time_s for name in COLUMNS}
    return rising | {"time_s": time_s}


def sent(columns: Columns, errors: SensorErrors, seed: int = 5) -> list[Frame]:
    return can_frames(columns, RATIO, RADII_M, errors, np.random.default_rng(seed))


def decoded(frames: list[Frame], message: str, signal: str) -> Series:
    packer: Any = database().get_message_by_name(message)
    mine = [frame for frame in frames if frame.can_id == packer.frame_id and not frame.is_extended]
    values = [float(packer.decode(frame.data)[signal]) for frame in mine]
    return np.array([frame.t_ns - EPOCH_S * 10**9 for frame in mine]) * 1e-9, np.array(values)


# Message, signal, column, how the signal's unit becomes SI, half a quantum.
SIGNALS = [
    ("IMU_RATE", "ROLL_ADC", "gyro_x_radps", (COUNT_RADPS, 2.5 / 7.63e-5), COUNT_RADPS),
    ("IMU_RATE", "YAW_ADC", "gyro_z_radps", (COUNT_RADPS, 2.5 / 7.63e-5), COUNT_RADPS),
    ("IMU_ACCEL", "LAT_ADC", "accel_y_mps2", (COUNT_MPS2, 2.5 / 7.63e-5), COUNT_MPS2),
    ("STEERING", "STEER_ANGLE", "steering_wheel_angle_rad", (DEG, 0.0), 0.1 * DEG),
    ("WHEEL_SPEEDS", "WHEEL_SPEED_RR", "wheel_speed_rr_mps", (1.0 / 3.6, 0.0), 0.03125 / 3.6),
]


@pytest.mark.parametrize(("message", "signal", "column", "to_si", "quantum"), SIGNALS)
def test_a_late_value_is_the_truth_a_delay_ago(
    columns: Columns, message: str, signal: str, column: str, to_si: tuple[float, float], quantum: float
) -> None:
    late = replace(QUIET, imu_delay_s=0.05, steering_delay_s=0.03, wheel_speed_delay_s=0.08)
    delay_s = {"STEERING": 0.03, "WHEEL_SPEEDS": 0.08}.get(message, 0.05)
    for errors, by_s in ((QUIET, 0.0), (late, delay_s)):
        t_s, raw = decoded(sent(columns, errors), message, signal)
        values = (raw - to_si[1]) * to_si[0]
        expected = begin(column) + RISE[column] * np.maximum(t_s - by_s, 0.0)  # before the drive: as it begins
        assert np.abs(values - expected).max() <= 0.51 * quantum
    # More than the quantum could hide.
    assert abs(RISE[column]) * delay_s > 2.0 * quantum


def test_pole_rings_give_each_wheel_its_own_speed_by_the_controllers_radius(columns: Columns) -> None:
    frames = sent(columns, replace(QUIET, pole_ring=PoleRing(starts=(0.1, 0.3, 0.6, 0.9))))
    delayed = sent(columns, replace(QUIET, pole_ring=PoleRing(), wheel_speed_delay_s=0.1))
    for wheel in ("fl", "fr", "rl", "rr"):
        rise = RISE[f"wheel_speed_{wheel}_mps"]
        t_s, kmh = decoded(frames, "WHEEL_SPEEDS", f"WHEEL_SPEED_{wheel.upper()}")
        settled = t_s > 0.1
        late_s = t_s - (kmh / 3.6 - 20.0) / rise
        # Half of 20 ms and half a pitch of 44 mm at 20 to 30 m/s: 11 ms.
        assert late_s[settled].mean() == pytest.approx(0.011, abs=1e-3)
        t_s, kmh = decoded(delayed, "WHEEL_SPEEDS", f"WHEEL_SPEED_{wheel.upper()}")
        late_s = t_s - (kmh / 3.6 - 20.0) / rise
        assert late_s[t_s > 0.3].mean() == pytest.approx(0.111, abs=1e-3)


def test_a_larger_wheel_shows_its_edges_later(columns: Columns) -> None:
    # One pole, half a turn to the first edge: the second comes after 1.5 turns, 2.83 and 5.65 m
    # at 20 m/s and a little more: at 141 and 279 ms; the next messages are those of 143 and 283 ms.
    errors = replace(QUIET, pole_ring=PoleRing(poles=1))
    frames = can_frames(columns, RATIO, (0.3, 0.3, 0.6, 0.6), errors, np.random.default_rng(1))
    for wheel, first_s in (("FL", 0.1431), ("FR", 0.1431), ("RL", 0.2831), ("RR", 0.2831)):
        t_s, kmh = decoded(frames, "WHEEL_SPEEDS", f"WHEEL_SPEED_{wheel}")
        assert t_s[kmh > 0.0][0] == pytest.approx(first_s, abs=1e-9), wheel


def test_steering_offset_is_that_of_the_road_wheel(columns: Columns) -> None:
    t_s, deg = decoded(sent(columns, replace(QUIET, steering_offset_rad=0.01)), "STEERING", "STEER_ANGLE")
    expected_rad = 0.6 * t_s - RATIO * 0.01
    assert np.abs(deg * DEG - expected_rad).max() <= 0.051 * DEG
    _, coarse = decoded(sent(columns, replace(QUIET, steering_quantum_deg=1.5)), "STEERING", "STEER_ANGLE")
    assert np.unique(np.round(coarse, 6) % 1.5).tolist() == [0.0]


def test_each_sender_keeps_its_own_time_on_the_receivers_stamps(columns: Columns) -> None:
    clocks = Clocks(
        imu=UnitClock(100.0, 0.001),
        steering=UnitClock(-100.0, 0.002),
        wheel_speeds=UnitClock(50.0, 0.003),
        pedals=UnitClock(-50.0, 0.004),
    )
    frames = sent(columns, replace(QUIET, clocks=clocks))
    for message, signal, first_us, last_us in (
        ("IMU_RATE", "YAW_ADC", 1000, 1000 + 390 * 10001),
        ("IMU_ACCEL", "LAT_ADC", 1240, 1240 + 390 * 10001),
        ("STEERING", "STEER_ANGLE", 3700, 3700 + 390 * 9999),
        ("WHEEL_SPEEDS", "WHEEL_SPEED_FL", 6100, 6100 + 195 * 20001),
        ("PEDALS", "BRAKE_ON", 9300, 9300 + 195 * 19999),
    ):
        t_s, _ = decoded(frames, message, signal)
        nth = 195 if message in {"WHEEL_SPEEDS", "PEDALS"} else 390
        assert t_s[[0, nth]] == pytest.approx([first_us * 1e-6, last_us * 1e-6], abs=1e-9)
    # What is sampled is the truth of that instant, not of the sender's idea of it.
    t_s, raw = decoded(frames, "IMU_RATE", "YAW_ADC")
    assert np.abs((raw - 2.5 / 7.63e-5) * COUNT_RADPS - 0.3 * t_s).max() <= 0.51 * COUNT_RADPS


def test_jitter_moves_stamps_and_no_value(columns: Columns) -> None:
    even, uneven = sent(columns, SensorErrors()), sent(columns, SensorErrors(stamp_jitter_s=0.003))
    for message, signal, *_ in SIGNALS:
        t_s, values = decoded(even, message, signal)
        stamped_s, same = decoded(uneven, message, signal)
        assert np.array_equal(values, same)
        assert (stamped_s - t_s).min() >= 0.0
        assert 0.0025 < (stamped_s - t_s).max() < 0.003
    stamps = [frame.t_ns for frame in uneven]
    assert stamps == sorted(stamps)
    assert all(t % 1000 == 0 for t in stamps)


def test_bandwidth_delays_a_ramp_by_its_time_constant(columns: Columns) -> None:
    t_s, raw = decoded(sent(columns, replace(QUIET, imu_cutoff_hz=2.0)), "IMU_ACCEL", "LAT_ADC")
    settled = t_s > 1.0
    expected = -2.0 * (t_s - 1.0 / (2.0 * math.pi * 2.0))
    assert np.abs((raw - 2.5 / 7.63e-5) * COUNT_MPS2 - expected)[settled].max() <= 0.52 * COUNT_MPS2
    t_s, raw = decoded(sent(columns, replace(QUIET, imu_cutoff_hz=2.0)), "IMU_RATE", "YAW_ADC")
    expected = 0.3 * (t_s - 1.0 / (2.0 * math.pi * 2.0))
    assert np.abs((raw - 2.5 / 7.63e-5) * COUNT_RADPS - expected)[t_s > 1.0].max() <= 0.52 * COUNT_RADPS


def test_gyros_feel_the_force_of_their_own_instant(columns: Columns) -> None:
    # rate reading_x += xy x accel_y: 0.001 x -2 t.
    pulled = replace(QUIET, gyro_g_sensitivity=((0.0, 1e-3, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    t_s, raw = decoded(sent(columns, pulled), "IMU_RATE", "ROLL_ADC")
    assert np.abs((raw - 2.5 / 7.63e-5) * COUNT_RADPS - (0.1 - 0.002) * t_s).max() <= 0.51 * COUNT_RADPS


def test_limits_are_the_triads_own(columns: Columns) -> None:
    frames = sent(columns, replace(QUIET, gyro_limit_radps=0.25, accel_limit_mps2=3.0))
    _, raw = decoded(frames, "IMU_RATE", "YAW_ADC")
    assert (raw.max() - 2.5 / 7.63e-5) * COUNT_RADPS == pytest.approx(0.25, abs=COUNT_RADPS)
    _, raw = decoded(frames, "IMU_ACCEL", "LAT_ADC")
    assert (raw.min() - 2.5 / 7.63e-5) * COUNT_MPS2 == pytest.approx(-3.0, abs=COUNT_MPS2)


def test_noise_gain_and_flicker_reach_the_frames_and_noisy_switches_both_off(columns: Columns) -> None:
    def error(errors: SensorErrors, signal: tuple[str, str]) -> NDArray[np.float64]:
        return decoded(sent(columns, errors), *signal)[1] - decoded(sent(columns, QUIET), *signal)[1]

    gyro, accel = ("IMU_RATE", "ROLL_ADC"), ("IMU_ACCEL", "LONG_ADC")
    white = error(SensorErrors(), gyro)
    assert error(SensorErrors(gyro_noise_gain=2.0), gyro).std() == pytest.approx(2.0 * white.std(), rel=0.02)
    assert np.array_equal(error(SensorErrors(accel_noise_gain=2.0), gyro), white)
    assert error(SensorErrors(accel_noise_gain=2.0), accel).std() > 1.5 * error(SensorErrors(), accel).std()
    # Flicker comes on top of the same white noise; 1 deg/s is 92 counts.
    flicker = error(SensorErrors(gyro_flicker_radps=DEG), gyro) - white
    assert np.abs(flicker).max() > 50.0
    assert np.abs(error(SensorErrors(accel_flicker_mps2=0.5), accel) - error(SensorErrors(), accel)).max() > 50.0
    silent = SensorErrors(noisy=False, gyro_noise_gain=2.0, gyro_flicker_radps=DEG, accel_flicker_mps2=0.5)
    assert sent(columns, silent) == sent(columns, QUIET)


def test_white_noise_does_not_depend_on_what_else_is_wrong(columns: Columns) -> None:
    plain = SensorErrors()
    more = replace(plain, stamp_jitter_s=0.001, gyro_flicker_radps=1e-5, accel_flicker_mps2=1e-4, pole_ring=PoleRing())
    _, before = decoded(sent(columns, plain), "IMU_ACCEL", "VERT_ADC")
    _, after = decoded(sent(columns, more), "IMU_ACCEL", "VERT_ADC")
    # Such flicker is a count or two; noise of 10 counts from another stream would be tens apart.
    assert 0.0 < np.abs(after - before).max() <= 4.0
    strange = [frame.data for frame in sent(columns, plain) if frame.is_extended]
    assert strange == [frame.data for frame in sent(columns, more) if frame.is_extended]


def test_same_seed_same_bytes_for_everything_at_once(columns: Columns) -> None:
    errors = draw_datasheet_errors(np.random.default_rng(11))
    first = sent(columns, errors)
    assert first == sent(columns, draw_datasheet_errors(np.random.default_rng(11)))
    assert first != sent(columns, errors, seed=6)
    assert first != sent(columns, draw_errors(np.random.default_rng(11)))
