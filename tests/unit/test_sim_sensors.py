"""What can be wrong with sensors: draws against the data sheets, and the steering angle sensor."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
import pytest

from dsz_daemon.sim.sensor_draws import draw_clocks, draw_datasheet_errors, draw_errors
from dsz_daemon.sim.sensors import NONE, CrossAxis, SensorErrors
from dsz_daemon.sim.steering_sensor import steering_counts, steering_reading_rad

DEG = math.pi / 180.0
G = 9.80665


def generator(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def calibrated() -> list[SensorErrors]:
    return [draw_errors(generator(seed)) for seed in range(400)]


@pytest.fixture(scope="module")
def uncalibrated() -> list[SensorErrors]:
    return [draw_datasheet_errors(generator(seed)) for seed in range(400)]


def even(values: np.ndarray, most: float) -> None:
    """Evenly drawn up to +-most: standard deviation most / sqrt(3)."""
    assert np.abs(values).max() <= most
    assert np.abs(values).max() > 0.95 * most
    assert values.std() == pytest.approx(most / math.sqrt(3.0), rel=0.06)


def test_null_errors_fill_the_data_sheets_limits_and_stay_inside(calibrated: list[SensorErrors]) -> None:
    even(np.array([d.gyro_offset_radps for d in calibrated]) / DEG, 3.0)
    even(np.array([d.accel_offset_mps2 for d in calibrated]) / (1e-3 * G), 25.0)


def test_null_errors_are_the_first_draws_of_the_generator() -> None:
    # What a seed meant before there were other errors it still means.
    first = generator(7).uniform(-1.0, 1.0, 6)
    drawn = draw_errors(generator(7))
    assert drawn.gyro_offset_radps == pytest.approx(first[:3] * 3.0 * DEG, rel=1e-15)
    assert drawn.accel_offset_mps2 == pytest.approx(first[3:] * 0.025 * G, rel=1e-15)
    rest = generator(7)
    rest.uniform(-1.0, 1.0, 6)
    gyro = rest.normal(size=9).reshape(3, 3)
    assert drawn.gyro_scale == pytest.approx(1e-3 * gyro.diagonal())
    cross = drawn.gyro_cross_axis
    assert [cross.xy, cross.xz, cross.yx] == pytest.approx(0.5e-3 * gyro[[0, 0, 1], [1, 2, 0]])
    assert [cross.yz, cross.zx, cross.zy] == pytest.approx(0.5e-3 * gyro[[1, 2, 2], [2, 0, 1]])


def test_calibration_leaves_little_and_nothing_else(calibrated: list[SensorErrors]) -> None:
    scales = np.array([d.gyro_scale + d.accel_scale for d in calibrated])
    cross = np.array([d.gyro_cross_axis + d.accel_cross_axis for d in calibrated])
    assert scales.std() == pytest.approx(1e-3, rel=0.06)
    assert cross.std() == pytest.approx(0.5e-3, rel=0.06)
    drawn, nothing = calibrated[0], SensorErrors()
    differing = {f.name for f in fields(nothing) if getattr(drawn, f.name) != getattr(nothing, f.name)}
    assert differing == {
        "gyro_offset_radps",
        "accel_offset_mps2",
        "gyro_scale",
        "accel_scale",
        "gyro_cross_axis",
        "accel_cross_axis",
        "pole_ring",
    }


def test_uncalibrated_draws_are_the_tables_spreads(uncalibrated: list[SensorErrors]) -> None:
    def drawn(name: str) -> np.ndarray:
        return np.array([getattr(d, name) for d in uncalibrated])

    even(drawn("gyro_scale") * 7.0, 0.8)  # 6.2 to 7.8 mV per deg/s around 7
    even(drawn("accel_scale"), 0.04)  # 960 to 1040 mV per g
    even(drawn("gyro_g_sensitivity") / DEG * G, 0.1)  # deg/s per g
    even(drawn("accel_alignment") / DEG, 1.0)
    even(drawn("gyro_nonlinearity"), 0.001)
    for name, typical, most in (
        ("gyro_cross_axis", 0.01, 0.03),
        ("accel_cross_axis", 0.015, 0.03),
        ("accel_nonlinearity", 0.002, 0.0125),
    ):
        values = drawn(name)
        assert np.abs(values).max() <= most
        # The normal draw's own spread; cutting at two deviations takes off 4 %.
        assert values.std() == pytest.approx(typical, rel=0.07)
    assert 1.0 < drawn("gyro_noise_gain").min() < 1.1
    assert 1.9 < drawn("gyro_noise_gain").max() < 2.0
    assert 2.9 < drawn("accel_noise_gain").max() < 3.0
    assert set(drawn("converter_bits").tolist()) == {12, 16}
    ppm = np.array([[clock.period_error_ppm for clock in d.clocks] for d in uncalibrated])
    even(ppm, 100.0)
    correlation = np.atleast_2d(np.corrcoef(ppm.T))
    assert np.abs(correlation[np.triu_indices(4, 1)]).max() < 0.2
    place = drawn("imu_place_m")
    assert place.min(axis=0) == pytest.approx([-0.8, -0.4, -0.4], abs=0.02)
    assert place.max(axis=0) == pytest.approx([0.8, 0.4, 0.2], abs=0.02)


def test_uncalibrated_draws_leave_no_field_at_its_default_but_the_limits(uncalibrated: list[SensorErrors]) -> None:
    nothing = SensorErrors()
    same = {
        f.name for f in fields(nothing) if all(getattr(d, f.name) == getattr(nothing, f.name) for d in uncalibrated)
    }
    # A lower limit than the sensors' ranges is an effect of its own, and so is a fault of an axis.
    assert same == {"noisy", "gyro_limit_radps", "accel_limit_mps2", "gyro_wiring", "accel_wiring"}


def test_one_seed_one_car_and_its_null_errors_do_not_depend_on_the_calibration() -> None:
    assert draw_errors(generator(3)) == draw_errors(generator(3))
    assert draw_datasheet_errors(generator(3)) == draw_datasheet_errors(generator(3))
    assert draw_datasheet_errors(generator(3)) != draw_datasheet_errors(generator(4))
    one, other = draw_errors(generator(3)), draw_datasheet_errors(generator(3))
    assert one.offsets() == other.offsets()
    assert one.pole_ring == other.pole_ring
    assert one.accel_scale != other.accel_scale
    assert draw_clocks(generator(3)) == other.clocks


def test_offsets_only_keeps_the_offsets_and_nothing_else() -> None:
    drawn = draw_datasheet_errors(generator(0))
    pure = drawn.offsets_only()
    assert pure == SensorErrors(drawn.gyro_offset_radps, drawn.accel_offset_mps2)
    assert drawn.gyro_cross_axis != CrossAxis()
    assert drawn.gyro_scale != NONE
    assert list(pure.offsets()) == ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    assert pure.offsets()["accel_y"] == drawn.accel_offset_mps2[1]


# The steering angle sensor


def test_steering_comes_in_quanta() -> None:
    assert steering_counts(np.array([0.1, -0.1]) * DEG * 12.34).tolist() == [12, -12]
    # A sensor of 1.5 deg: 2.2 deg are 1.5, 2.3 are 3; in quanta of the message.
    assert steering_counts(np.array([2.2, 2.3, -2.3, 0.7]) * DEG, 1.5).tolist() == [15, 30, -30, 0]
    # Nine turns, and the message's 16 bits are full.
    assert steering_counts(np.array([57.0, 58.0, -58.0])).tolist() == [32659, 32767, -32768]
    swept = np.linspace(-1.0, 1.0, 999)
    for quantum_deg in (0.1, 0.5, 1.0, 1.5):
        counts = steering_counts(swept, quantum_deg)
        assert np.abs(counts * 0.1 - np.degrees(swept)).max() <= 0.5001 * quantum_deg


def test_the_road_wheel_stands_at_reading_over_ratio_plus_offset() -> None:
    road_rad, ratio, offset_rad = np.array([0.02, -0.01]), 15.7, 0.003
    reading = steering_reading_rad(ratio * road_rad, offset_rad, ratio)
    assert reading / ratio + offset_rad == pytest.approx(road_rad)
    # Zero is not straight ahead: it reads right where the wheels stand left of what it says.
    assert steering_reading_rad(np.zeros(1), offset_rad, ratio)[0] == pytest.approx(-0.0471)
