"""The IMU: each error by hand, by its sign in the table of effects, and by a second route."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dsz_daemon.sim.imu import (
    accel_readings,
    bent,
    converter_counts,
    gyro_readings,
    low_passed,
    offset_columns,
    turning,
)
from dsz_daemon.sim.imu_noise import FLICKER_LOWEST_HZ, flicker_noise, white_noise
from dsz_daemon.sim.sensors import (
    ACCELS,
    GYROS,
    Angles,
    CrossAxis,
    SensorErrors,
    Triad,
    WarmUp,
)

DEG = math.pi / 180.0
G = 9.80665
NOW = np.zeros(1)
NOTHING = SensorErrors()
FX, FY, FZ = FORCE = (1.3, -2.1, 9.5)
RATE = (0.11, -0.07, 0.31)


def rows(*vectors: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.array(vectors, dtype=np.float64)


def accel(errors: SensorErrors, force: tuple[float, float, float] = FORCE, at_s: float = 0.0) -> list[float]:
    return list(accel_readings(errors, rows(force), np.array([at_s]))[0])


def gyro(errors: SensorErrors, rate: tuple[float, float, float] = RATE, at_s: float = 0.0) -> list[float]:
    return list(gyro_readings(errors, rows(rate), rows(FORCE), np.array([at_s]))[0])


# Counts


def test_counts_are_the_volts_of_the_data_sheet() -> None:
    # 2.5 V, 2.57 V and 2.36 V over 7.63e-5 V.
    rates = rows((0.0, 10.0 * DEG, -20.0 * DEG))
    assert converter_counts(GYROS, rates, None, 16).tolist() == [[32765, 33683, 30931]]
    # 0 g, 1 g and -0.5 g: 2.5 V, 3.5 V and 2.0 V.
    forces = rows((0.0, 9.80665, -4.903325))
    assert converter_counts(ACCELS, forces, None, 16).tolist() == [[32765, 45872, 26212]]


def test_twelve_bits_are_steps_of_sixteen_counts_at_the_same_volts() -> None:
    # 2.5 V, 2.57 V and 2.36 V over 16 x 7.63e-5 V: 2047.8, 2105.2 and 1933.2.
    rates = rows((0.0, 10.0 * DEG, -20.0 * DEG))
    assert converter_counts(GYROS, rates, None, 12).tolist() == [[2048 * 16, 2105 * 16, 1933 * 16]]
    swept = np.repeat(np.linspace(-3.0, 3.0, 999)[:, None], 3, axis=1)
    volts = 2.5 + 0.007 * np.degrees(swept)
    for bits in (12, 16):
        counts = converter_counts(GYROS, swept, None, bits)
        step = 2 ** (16 - bits)
        assert np.all(counts % step == 0)
        assert np.abs(counts * 7.63e-5 - volts).max() <= 0.5001 * step * 7.63e-5


def test_the_converter_clips_at_its_own_ends() -> None:
    wide = Triad(GYROS.channels, 1.0, 1.0, 1e9, 0.0, 0.0)
    assert converter_counts(wide, rows((1e6, -1e6, 2.6)), None, 16).tolist() == [[65535, 0, 66841 - 1306]]
    assert converter_counts(wide, rows((1e6, -1e6, 0.0)), None, 12).tolist() == [[4095 * 16, 0, 2048 * 16]]


def test_readings_clip_at_the_range_or_at_a_lower_limit() -> None:
    # 300 deg/s clip at 250: 4.25 V; -300: 0.75 V.
    rates = rows((3.0 * DEG, 300.0 * DEG, -300.0 * DEG))
    assert converter_counts(GYROS, rates, None, 16).tolist() == [[33041, 55701, 9830]]
    # The limit is in SI: 100 deg/s is 3.2 V, 1.8 V. One above the range changes nothing.
    assert converter_counts(GYROS, rates, 100.0 * DEG, 16).tolist() == [[33041, 41940, 23591]]
    assert converter_counts(GYROS, rates, 400.0 * DEG, 16).tolist() == [[33041, 55701, 9830]]
    assert converter_counts(ACCELS, rows((0.5 * G, G, -G)), 0.7 * G, 16)[0, 1:].tolist() == [41940, 23591]


# The table of effects, row by row


def test_nothing_wrong_reads_the_truth_to_the_last_bit() -> None:
    assert accel(NOTHING) == list(FORCE)
    assert gyro(NOTHING) == list(RATE)


def test_offset_is_reading_minus_truth() -> None:
    wrong = SensorErrors((0.01, -0.02, 0.03), (0.1, 0.2, -0.3))
    assert np.array(accel(wrong)) - FORCE == pytest.approx([0.1, 0.2, -0.3])
    assert np.array(gyro(wrong)) - RATE == pytest.approx([0.01, -0.02, 0.03])


@pytest.mark.parametrize("axis", range(3))
def test_scale_multiplies_its_own_axis(axis: int) -> None:
    scale = tuple(0.04 if i == axis else 0.0 for i in range(3))
    expected = [1.04 * f if i == axis else f for i, f in enumerate(FORCE)]
    assert accel(replace(NOTHING, accel_scale=scale)) == pytest.approx(expected)
    expected = [1.04 * w if i == axis else w for i, w in enumerate(RATE)]
    assert gyro(replace(NOTHING, gyro_scale=scale)) == pytest.approx(expected)
    assert gyro(replace(NOTHING, accel_scale=scale)) == list(RATE)


@pytest.mark.parametrize("name", CrossAxis._fields)
def test_cross_axis_leaks_the_second_letter_into_the_first(name: str) -> None:
    cross = CrossAxis()._replace(**{name: 0.03})
    into, of = ("xyz".index(letter) for letter in name)
    for read, true in ((accel(replace(NOTHING, accel_cross_axis=cross)), FORCE),
                       (gyro(replace(NOTHING, gyro_cross_axis=cross)), RATE)):  # fmt: skip
        expected = list(true)
        expected[into] += 0.03 * true[of]
        assert read == pytest.approx(expected)


def test_misalignment_to_first_order_is_the_tables() -> None:
    roll, pitch, yaw = 2e-4, -3e-4, 5e-4
    turned = replace(NOTHING, imu_misalignment=Angles(roll, pitch, yaw))
    for read, (x, y, z) in ((accel(turned), FORCE), (gyro(turned), RATE)):
        expected = [x + yaw * y - pitch * z, y - yaw * x + roll * z, z + pitch * x - roll * y]
        assert read == pytest.approx(expected, abs=3e-6)
        assert read != pytest.approx([x, y, z], abs=3e-5)
    # The accelerometers alone: same signs, gyros unmoved.
    alone = replace(NOTHING, accel_alignment=Angles(roll, pitch, yaw))
    assert accel(alone) == pytest.approx(accel(turned), abs=1e-12)
    assert gyro(alone) == list(RATE)


def rotated(vector: NDArray[np.float64], axis: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Rodrigues' formula."""
    across = np.cross(axis, vector) * math.sin(angle)
    return np.asarray(vector * math.cos(angle) + across + axis * (axis @ vector) * (1.0 - math.cos(angle)))


def test_large_mounting_angles_turn_the_axes_one_after_the_other() -> None:
    # The instrument's axes, turned by yaw about up, then pitch about its own left, then roll
    # about its own ahead; a reading is the truth's share along each.
    roll, pitch, yaw = 0.7, -0.4, 2.1
    x, y, z = np.eye(3)
    x, y = rotated(x, z, yaw), rotated(y, z, yaw)
    x, z = rotated(x, y, pitch), rotated(z, y, pitch)
    y, z = rotated(y, x, roll), rotated(z, x, roll)
    matrix = np.array(turning(Angles(roll, pitch, yaw)))
    assert matrix == pytest.approx(np.array([x, y, z]), abs=1e-15)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-15)
    # Looking left (yaw 90 deg) it reads on x what comes from the left, on y the rear.
    looking_left = replace(NOTHING, imu_misalignment=Angles(yaw_rad=math.pi / 2.0))
    assert accel(looking_left) == pytest.approx([FY, -FX, FZ])


def test_mounting_comes_before_alignment_before_scale() -> None:
    wrong = replace(
        NOTHING,
        imu_misalignment=Angles(yaw_rad=math.pi / 2.0),
        accel_alignment=Angles(roll_rad=math.pi / 2.0),
        accel_scale=(0.0, 0.1, 0.0),
    )
    # Yaw: (fy, -fx, fz); then its y looks up and its z to where -y was: (fy, fz, fx).
    assert accel(wrong) == pytest.approx([FY, 1.1 * FZ, FX])


def test_g_sensitivity_moves_gyro_rows_by_columns_of_force() -> None:
    matrix = ((1e-4, 2e-4, 3e-4), (-4e-4, 5e-4, 6e-4), (7e-4, -8e-4, 9e-4))
    wrong = replace(NOTHING, gyro_g_sensitivity=matrix)
    moved = np.array(gyro(wrong)) - RATE
    assert moved[0] == pytest.approx(1e-4 * FX + 2e-4 * FY + 3e-4 * FZ)
    assert moved[1] == pytest.approx(-4e-4 * FX + 5e-4 * FY + 6e-4 * FZ)
    assert moved[2] == pytest.approx(7e-4 * FX - 8e-4 * FY + 9e-4 * FZ)
    assert accel(wrong) == list(FORCE)


def test_drift_and_warming_move_the_null_error() -> None:
    wrong = replace(
        NOTHING,
        gyro_offset_radps=(0.01, 0.0, 0.0),
        gyro_drift_radps_per_s=(1e-5, 0.0, 0.0),
        accel_offset_mps2=(0.0, 0.2, 0.0),
        accel_drift_mps2_per_k=(0.0, 0.004, 0.0),
        warm_up=WarmUp(10.0, 30.0, 300.0),
    )
    # After one time constant 63.2 % of 20 K, after ten all of it.
    assert gyro(wrong, at_s=300.0)[0] - RATE[0] == pytest.approx(0.01 + 0.003)
    assert accel(wrong)[1] - FY == pytest.approx(0.2)
    assert accel(wrong, at_s=300.0)[1] - FY == pytest.approx(0.2 + 0.004 * 20.0 * 0.6321206, abs=1e-7)
    assert accel(wrong, at_s=3000.0)[1] - FY == pytest.approx(0.28, abs=1e-5)
    # Before the drive nothing has moved yet.
    assert gyro(wrong, at_s=-5.0)[0] - RATE[0] == pytest.approx(0.01)
    columns = offset_columns(wrong, np.array([0.0, 300.0]))
    assert list(columns) == [*GYROS.channels, *ACCELS.channels]
    assert columns["gyro_x"] == pytest.approx([0.01, 0.013])
    assert columns["accel_y"] == pytest.approx([0.2, 0.2505696], abs=1e-7)
    assert columns["gyro_y"].tolist() == [0.0, 0.0]


def test_nonlinearity_is_its_share_of_full_scale_at_full_scale_and_none_at_rest() -> None:
    values = np.repeat(np.array([0.0, 5.0, 10.0, -10.0, -5.0])[:, None], 3, axis=1)
    error = bent(values, 10.0, (0.01, -0.02, 0.0)) - values
    # u = 0.5: (0.25 + 0.125) / 2; u = -0.5: (0.25 - 0.125) / 2.
    assert error[:, 0] == pytest.approx([0.0, 0.01875, 0.1, 0.0, 0.00625], abs=1e-12)
    assert error[:, 1] == pytest.approx([0.0, -0.0375, -0.2, 0.0, -0.0125], abs=1e-12)
    assert not error[:, 2].any()
    # In place: 1 g on an accelerometer of 1.7 g with 1 %: u = 0.588235, 0.274781 of 1 % of 1.7 g.
    read = accel(replace(NOTHING, accel_nonlinearity=(0.0, 0.0, 0.01)), (0.0, 0.0, G))
    assert (read[2] - G) / G == pytest.approx(0.017 * 0.274781, rel=1e-5)
    read = gyro(replace(NOTHING, gyro_nonlinearity=(0.001, 0.0, 0.0)), (250.0 * DEG, 0.0, 0.0))
    assert read[0] / DEG == pytest.approx(250.25)


# Bandwidth


def test_low_pass_answers_a_ramp_as_the_differential_equation_does() -> None:
    # tau y' + y = t: y = t - tau + tau exp(-t / tau), exact at any step.
    tau = 1.0 / (2.0 * math.pi * 5.0)
    for step in (0.002, 0.05):
        t = np.arange(0.0, 0.5, step)
        assert low_passed(t, t, 5.0) == pytest.approx(t - tau + tau * np.exp(-t / tau), abs=1e-12)


def test_low_pass_answers_a_step_and_starts_settled() -> None:
    t = np.arange(1000) * 0.001
    y = low_passed(t, np.where(t < 0.2, 3.0, 4.0), 5.0)
    assert y[t < 0.199] == pytest.approx(np.full((t < 0.199).sum(), 3.0), abs=1e-12)
    # The step is a ramp from 0.199 to 0.2 s: the difference of two ramps' answers.
    tau, h = 1.0 / (2.0 * math.pi * 5.0), 0.001
    since = t[t >= 0.2] - 0.199
    expected = 4.0 - tau / h * (np.exp(-(since - h) / tau) - np.exp(-since / tau))
    assert y[t >= 0.2] == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("frequency_hz", [2.0, 10.0, 30.0])
def test_low_pass_has_gain_and_phase_of_first_order(frequency_hz: float) -> None:
    t = np.arange(4000) * 0.0005
    turn = 2.0 * math.pi * frequency_hz * t
    y = low_passed(t, np.sin(turn), 10.0)
    late = t >= 1.0
    in_phase = 2.0 * np.mean(y[late] * np.sin(turn[late]))
    behind = 2.0 * np.mean(y[late] * np.cos(turn[late]))
    ratio = frequency_hz / 10.0
    assert math.hypot(in_phase, behind) == pytest.approx(1.0 / math.sqrt(1.0 + ratio**2), rel=2e-3)
    assert math.atan2(behind, in_phase) == pytest.approx(-math.atan(ratio), abs=2e-3)


# Noise


@pytest.mark.parametrize(
    ("triad", "rms"),
    [(GYROS, 0.03 * DEG * math.sqrt(50.0)), (ACCELS, 110e-6 * G * math.sqrt(50.0))],
    ids=["gyro", "accel"],
)
def test_white_noise_is_the_density_up_to_half_the_sampling_rate(triad: Triad, rms: float) -> None:
    noise = white_noise(triad, 1.0, 20000, 100.0, np.random.default_rng(5))
    assert noise.std(axis=0) == pytest.approx([rms] * 3, rel=0.03)
    correlation = np.atleast_2d(np.corrcoef(noise.T))
    assert correlation[np.triu_indices(3, 1)] == pytest.approx([0.0] * 3, abs=0.04)
    # Allan deviation over 1 s: density / sqrt(2 x 1 s).
    means = noise.reshape(200, 100, 3).mean(axis=1)
    allan = np.sqrt(0.5 * np.mean(np.diff(means, axis=0) ** 2))
    assert allan == pytest.approx(rms / math.sqrt(50.0) / math.sqrt(2.0), rel=0.1)
    hot = white_noise(triad, 2.0, 20000, 100.0, np.random.default_rng(5))
    assert hot == pytest.approx(2.0 * noise)


def test_flicker_noise_has_the_density_of_its_level_over_frequency() -> None:
    size, rate_hz, level = 1 << 15, 50.0, 0.02
    noise = flicker_noise(level, size, rate_hz, np.random.default_rng(3))
    power = np.mean(np.abs(np.fft.rfft(noise, axis=0)) ** 2, axis=1) * 2.0 / (size * rate_hz)
    frequency = np.fft.rfftfreq(size, 1.0 / rate_hz)
    for low_hz in (0.01, 0.03, 0.1, 0.3, 1.0):
        band = (frequency >= low_hz) & (frequency < 3.0 * low_hz)
        assert np.mean(power[band] * frequency[band]) == pytest.approx(level**2, rel=0.3), low_hz
    # Two decades together, where chance matters less: the level itself.
    band = (frequency >= 0.02) & (frequency < 2.0)
    assert np.mean(power[band] * frequency[band]) == pytest.approx(level**2, rel=0.06)
    assert flicker_noise(level, 0, rate_hz, np.random.default_rng(3)).shape == (0, 3)


def test_flicker_noise_is_settled_from_the_first_sample() -> None:
    # Variance: an equal part, level^2 ln 2, for each of the octaves from the lowest to 25 Hz.
    first = np.concatenate([flicker_noise(1.0, 1, 50.0, np.random.default_rng(s))[0] for s in range(700)])
    octaves = math.ceil(math.log2(25.0 / FLICKER_LOWEST_HZ))
    assert first.var() == pytest.approx(octaves * math.log(2.0), rel=0.1)
