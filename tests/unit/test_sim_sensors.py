"""Sensors: hand-computed counts, noise levels and draws against the data sheets."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsz_daemon.sim.sensors import (
    ACCELS,
    GYROS,
    IDENTITY,
    SensorErrors,
    Triad,
    draw_errors,
    imu_counts,
    steering_counts,
    wheel_speed_counts,
)

ZERO = (0.0, 0.0, 0.0)
DEG = math.pi / 180.0


def test_counts_are_the_volts_of_the_data_sheet() -> None:
    truth = np.array([[0.0, 10.0 * DEG, -20.0 * DEG]])
    # 2.5 V, 2.57 V and 2.36 V over 7.63e-5 V.
    assert imu_counts(GYROS, truth, ZERO, IDENTITY, 100.0, None).tolist() == [[32765, 33683, 30931]]
    # 0 g, 1 g and -0.5 g: 2.5 V, 3.5 V and 2.0 V.
    truth = np.array([[0.0, 9.80665, -4.903325]])
    assert imu_counts(ACCELS, truth, ZERO, IDENTITY, 100.0, None).tolist() == [[32765, 45872, 26212]]


def test_offset_is_added_and_clipping_is_at_the_sensors_range() -> None:
    # 3 deg/s of null error alone: 2.521 V. 300 deg/s clip at 250: 4.25 V; -300: 0.75 V.
    truth = np.array([[0.0, 300.0 * DEG, -300.0 * DEG]])
    counts = imu_counts(GYROS, truth, (3.0 * DEG, 0.0, 0.0), IDENTITY, 100.0, None)
    assert counts.tolist() == [[33041, 55701, 9830]]


def test_matrix_leaks_the_column_into_the_row() -> None:
    matrix = ((1.0, 0.02, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.01))
    truth = np.array([[0.0, 100.0 * DEG, 50.0 * DEG]])
    x, y, z = imu_counts(GYROS, truth, ZERO, matrix, 100.0, None)[0]
    per_deg = 0.007 / 7.63e-5
    assert (x - 32765) / per_deg == pytest.approx(2.0, abs=0.01)
    assert (y - 32765) / per_deg == pytest.approx(100.0, abs=0.01)
    assert (z - 32765) / per_deg == pytest.approx(50.5, abs=0.01)


@pytest.mark.parametrize(
    ("triad", "volts_rms"),
    [(GYROS, 0.03 * math.sqrt(50.0) * 0.007), (ACCELS, 110e-6 * math.sqrt(50.0))],
    ids=["gyro", "accel"],
)
def test_noise_is_the_density_up_to_half_the_sampling_rate(triad: Triad, volts_rms: float) -> None:
    counts = imu_counts(triad, np.zeros((20000, 3)), ZERO, IDENTITY, 100.0, np.random.default_rng(5))
    quantised = math.sqrt(volts_rms**2 + 7.63e-5**2 / 12.0)
    assert counts.std(axis=0) * 7.63e-5 == pytest.approx([quantised] * 3, rel=0.03)
    correlation = np.atleast_2d(np.corrcoef(counts.T))
    assert correlation[np.triu_indices(3, 1)] == pytest.approx([0.0] * 3, abs=0.04)


def test_draws_fill_the_data_sheets_limits_and_stay_inside() -> None:
    draws = [draw_errors(np.random.default_rng(seed)) for seed in range(400)]
    gyro = np.array([d.gyro_offset_radps for d in draws]) / DEG
    accel = np.array([d.accel_offset_mps2 for d in draws]) / 9.80665e-3
    for values, limit in ((gyro, 3.0), (accel, 25.0)):
        assert np.abs(values).max() <= limit
        assert np.abs(values).max() > 0.95 * limit
        # Evenly drawn: standard deviation limit / sqrt(3).
        assert values.std() == pytest.approx(limit / math.sqrt(3.0), rel=0.05)
    matrices = np.array([d.accel_matrix for d in draws]) - np.eye(3)
    assert matrices[:, [0, 1, 2], [0, 1, 2]].std() == pytest.approx(1e-3, rel=0.1)
    assert matrices[:, [0, 0, 1], [1, 2, 0]].std() == pytest.approx(0.5e-3, rel=0.1)


def test_offsets_only_keeps_the_offsets_and_nothing_else() -> None:
    drawn = draw_errors(np.random.default_rng(0))
    pure = drawn.offsets_only()
    assert pure == SensorErrors(drawn.gyro_offset_radps, drawn.accel_offset_mps2)
    assert drawn.gyro_matrix != IDENTITY
    assert list(pure.offsets()) == ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    assert pure.offsets()["accel_y"] == drawn.accel_offset_mps2[1]


def test_wheel_speeds_and_steering_come_in_quanta() -> None:
    # 10 m/s = 36 km/h = 1152 quanta; below 1 km/h nothing; direction is not seen.
    assert wheel_speed_counts(np.array([10.0, 0.27, 0.28, -10.0])).tolist() == [1152, 0, 32, 1152]
    assert steering_counts(np.array([0.1, -0.1]) * DEG * 12.34).tolist() == [12, -12]
