"""The sensors: what true motion becomes on its way into a CAN frame's bits.

IMU: gyroscopes ADW22307 and accelerometers ADXL103 (the paper's Tables 1 and 2) behind a
16-bit converter. Volts = null + sensitivity x (matrix x truth + null error + noise), clipped
to the sensor's range, rounded to counts. Wheel speeds and steering angle are rounded to the
quantum of their messages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.signals import ACCEL_CHANNELS, GYRO_CHANNELS, STANDARD_GRAVITY_MPS2

Counts = NDArray[np.int64]
Vector3 = tuple[float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]

VOLTS_PER_COUNT = 7.63e-5  # 5 V over 16 bits
NULL_VOLTS = 2.5  # half the supply: both data sheets' nominal null at 5 V
MOST_COUNTS = 0xFFFF


class Triad(NamedTuple):
    """One kind of sensor, three of them at right angles; `unit` is the data sheet's, in SI."""

    channels: tuple[str, str, str]
    unit: float
    volts_per_unit: float
    range_unit: float
    null_error_unit: float
    noise_per_root_hz: float


GYROS = Triad(GYRO_CHANNELS, math.pi / 180.0, 0.007, 250.0, 3.0, 0.03)  # deg/s; Table 1
ACCELS = Triad(ACCEL_CHANNELS, STANDARD_GRAVITY_MPS2, 1.0, 1.7, 0.025, 110e-6)  # g; Table 2

# Chosen: what is left after a calibration of scale and alignment at the end of the line, one
# standard deviation each. The paper zeroes offsets and assumes the rest; the data sheets'
# uncalibrated spreads (11 % and 4 %, 3 %) are a later scenario's. At these levels gravity
# leaks 10 and 5 mm/s^2, a twentieth of the accelerometer's null error.
SCALE_ERROR_STD = 1.0e-3
CROSS_AXIS_STD = 0.5e-3

WHEEL_SPEED_QUANTUM_KMH = 0.03125
STEERING_QUANTUM_DEG = 0.1
# Chosen: pulses come too seldom below a walking pace; makers' units report 0 there.
WHEEL_SILENT_BELOW_KMH = 1.0

IDENTITY: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """One car's draw: constant null errors (SI) and the matrix from truth to reading."""

    gyro_offset_radps: Vector3 = (0.0, 0.0, 0.0)
    accel_offset_mps2: Vector3 = (0.0, 0.0, 0.0)
    gyro_matrix: Matrix3 = IDENTITY
    accel_matrix: Matrix3 = IDENTITY
    noisy: bool = True

    def offsets_only(self) -> SensorErrors:
        """Return the same null errors with perfect scale and alignment; noise stays."""
        return replace(self, gyro_matrix=IDENTITY, accel_matrix=IDENTITY)

    def offsets(self) -> dict[str, float]:
        """Return the null error of each IMU channel, SI."""
        values = (*self.gyro_offset_radps, *self.accel_offset_mps2)
        return dict(zip(GYRO_CHANNELS + ACCEL_CHANNELS, values, strict=True))


def draw_errors(rng: np.random.Generator) -> SensorErrors:
    """Draw null errors evenly within the data sheets' limits, scale and cross-axis as above."""
    gyro = [float(x) for x in rng.uniform(-1.0, 1.0, 3) * GYROS.null_error_unit * GYROS.unit]
    accel = [float(x) for x in rng.uniform(-1.0, 1.0, 3) * ACCELS.null_error_unit * ACCELS.unit]
    return SensorErrors(
        (gyro[0], gyro[1], gyro[2]), (accel[0], accel[1], accel[2]), _draw_matrix(rng), _draw_matrix(rng)
    )


def _draw_matrix(rng: np.random.Generator) -> Matrix3:
    draws = [float(x) for x in rng.normal(size=9)]

    def row(i: int) -> Vector3:
        a, b, c = (
            1.0 + SCALE_ERROR_STD * draws[3 * i + j] if i == j else CROSS_AXIS_STD * draws[3 * i + j] for j in range(3)
        )
        return (a, b, c)

    return (row(0), row(1), row(2))


def imu_counts(
    triad: Triad,
    truth: NDArray[np.float64],
    offset: Vector3,
    matrix: Matrix3,
    rate_hz: float,
    rng: np.random.Generator | None,
) -> Counts:
    """Return the converter's counts for `truth` (n x 3, SI) sampled at `rate_hz`; n x 3.

    Noise is white up to half the sampling rate, as behind an ideal anti-aliasing filter; none
    without `rng`. Written out per axis: a matrix product may round differently elsewhere.
    """
    counts = np.empty(truth.shape, dtype=np.int64)
    noise_unit = triad.noise_per_root_hz * math.sqrt(rate_hz / 2.0)
    for i in range(3):
        a, b, c = matrix[i]
        seen = (a * truth[:, 0] + b * truth[:, 1] + c * truth[:, 2] + offset[i]) / triad.unit
        if rng is not None:
            seen = seen + noise_unit * rng.normal(size=len(seen))
        volts = NULL_VOLTS + triad.volts_per_unit * np.clip(seen, -triad.range_unit, triad.range_unit)
        counts[:, i] = np.clip(np.rint(volts / VOLTS_PER_COUNT), 0, MOST_COUNTS)
    return counts


def wheel_speed_counts(speed_mps: NDArray[np.float64]) -> Counts:
    """Return wheel speeds in quanta; unsigned, as usual, and 0 below a walking pace."""
    kmh = np.abs(speed_mps) * 3.6
    quanta = np.rint(kmh / WHEEL_SPEED_QUANTUM_KMH).astype(np.int64)
    return np.where(kmh < WHEEL_SILENT_BELOW_KMH, 0, quanta)


def steering_counts(steering_wheel_rad: NDArray[np.float64]) -> Counts:
    """Return the steering wheel angle in quanta, left positive."""
    return np.rint(np.degrees(steering_wheel_rad) / STEERING_QUANTUM_DEG).astype(np.int64)
