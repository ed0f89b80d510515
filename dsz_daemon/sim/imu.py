"""The IMU: what true motion becomes on its way to the converter's counts.

Truth -> first-order low-pass -> turned by the mounting -> scale and cross-axis, facing -> nonlinearity
-> g-sensitivity and null error (drifting) added -> noise -> plugged -> clipped -> in its unit -> counts.
Everything is written out per axis: a matrix product of a library may round differently elsewhere. A
column of times gives no `np.exp` for the same reason.
"""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.sim.sensors import (
    ACCELS,
    AS_MEANT,
    GYROS,
    NULL_VOLTS,
    VOLTS_PER_COUNT,
    Angles,
    Counts,
    CrossAxis,
    Matrix3,
    SensorErrors,
    Triad,
    Vector3,
    WarmUp,
    Wiring,
)

Array = NDArray[np.float64]

FIELD_BITS = 16  # of the message


def turning(angles: Angles) -> Matrix3:
    """Return the matrix from the car's axes to those of an instrument turned by `angles`.

    To first order its rows are (1, yaw, -pitch), (-yaw, 1, roll), (pitch, -roll, 1).
    """
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(angle), math.cos(angle)) for angle in angles)
    return (
        (cp * cy, cp * sy, -sp),
        (sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp),
        (cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp),
    )


def sensitivity(scale: Vector3, cross: CrossAxis) -> Matrix3:
    """Return the matrix from truth in the instrument's axes to its readings."""
    return (
        (1.0 + scale[0], cross.xy, cross.xz),
        (cross.yx, 1.0 + scale[1], cross.yz),
        (cross.zx, cross.zy, 1.0 + scale[2]),
    )


def applied(matrix: Matrix3, vectors: Array) -> Array:
    """Return matrix x vector for each row of `vectors` (n x 3)."""
    x, y, z = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    return np.column_stack([a * x + b * y + c * z for a, b, c in matrix])


def bent(values: Array, full_scale: float, nonlinearity: Vector3) -> Array:
    """Return what a bent characteristic makes of `values` (n x 3), in their unit.

    Chosen curve: error = nonlinearity x full scale x (u^2 + u^3) / 2 with u = value / full
    scale: none at rest (null error and sensitivity there keep their meaning), all of it at
    + full scale, none at - full scale; a part that rectifies vibration and one that doesn't.
    """
    u = np.clip(values / full_scale, -1.0, 1.0)
    return values + np.array(nonlinearity) * full_scale * (0.5 * u * u * (1.0 + u))


def low_passed(time_s: Array, values: Array, cutoff_hz: float) -> Array:
    """Return `values` (n, on the times `time_s`) behind a first-order low-pass; it starts settled.

    Exact for a signal that is straight between the times.
    """
    steps: list[float] = (np.diff(time_s) * (2.0 * math.pi * cutoff_hz)).tolist()
    # Times are multiples of a step only up to rounding: few different steps, one exp for each.
    weights = {h: (math.exp(-h), -math.expm1(-h) / h) for h in set(steps)}
    points: list[float] = values.tolist()

    def after(y: float, step: tuple[float, float, float]) -> float:
        h, before, now = step
        kept, mean = weights[h]
        return kept * y + (mean - kept) * before + (1.0 - mean) * now

    steps_between = zip(steps, points[:-1], points[1:], strict=True)
    return np.array(list(accumulate(steps_between, after, initial=points[0])))


def temperature_rise_k(warm_up: WarmUp, time_s: Array) -> Array:
    """Return how much warmer the IMU is at `time_s` (s from the drive's begin) than at 0."""
    span_k = warm_up.end_c - warm_up.start_c
    return np.array([-span_k * math.expm1(-t / warm_up.time_constant_s) for t in time_s.tolist()])


def null_errors(errors: SensorErrors, time_s: Array) -> tuple[Array, Array]:
    """Return null errors at `time_s` (s from the drive's begin): gyros, accelerometers; n x 3, SI."""
    time = np.maximum(time_s, 0.0)
    rise_k = temperature_rise_k(errors.warm_up, time)

    def moved(offset: Vector3, per_s: Vector3, per_k: Vector3) -> Array:
        return np.column_stack([offset[i] + per_s[i] * time + per_k[i] * rise_k for i in range(3)])

    return (
        moved(errors.gyro_offset_radps, errors.gyro_drift_radps_per_s, errors.gyro_drift_radps_per_k),
        moved(errors.accel_offset_mps2, errors.accel_drift_mps2_per_s, errors.accel_drift_mps2_per_k),
    )


def offset_columns(errors: SensorErrors, time_s: Array) -> dict[str, Array]:
    """Return what each IMU channel reads at `time_s` (s from the drive's begin) of no motion at all, SI.

    The null error of the sensor that is plugged in there, in the unit that it is read in.
    """
    gyro, accel = null_errors(errors, time_s)
    return {
        channel: nulls[:, wiring.plugs[i]] * wiring.factors[i]
        for triad, nulls, wiring in ((GYROS, gyro, errors.gyro_wiring), (ACCELS, accel, errors.accel_wiring))
        for i, channel in enumerate(triad.channels)
    }


def gyro_readings(errors: SensorErrors, rates_radps: Array, forces_mps2: Array, time_s: Array) -> Array:
    """Return what the gyros put out, n x 3 in rad/s, before noise and clipping.

    `rates_radps`, `forces_mps2`: n x 3, true motion in the car's axes at the IMU's place.
    """
    mounting = turning(errors.imu_misalignment)
    seen = applied(sensitivity(errors.gyro_scale, errors.gyro_cross_axis), applied(mounting, rates_radps))
    seen = bent(seen * np.array(errors.gyro_wiring.facing), GYROS.range_unit * GYROS.unit, errors.gyro_nonlinearity)
    pulled = applied(errors.gyro_g_sensitivity, applied(mounting, forces_mps2))
    return seen + pulled + null_errors(errors, time_s)[0]


def accel_readings(errors: SensorErrors, forces_mps2: Array, time_s: Array) -> Array:
    """Return what the accelerometers put out, n x 3 in m/s^2, before noise and clipping."""
    felt = applied(turning(errors.accel_alignment), applied(turning(errors.imu_misalignment), forces_mps2))
    seen = applied(sensitivity(errors.accel_scale, errors.accel_cross_axis), felt)
    seen = bent(seen * np.array(errors.accel_wiring.facing), ACCELS.range_unit * ACCELS.unit, errors.accel_nonlinearity)
    return seen + null_errors(errors, time_s)[1]


def converter_counts(
    triad: Triad, readings: Array, limit: float | None, bits: int, wiring: Wiring = AS_MEANT
) -> Counts:
    """Return the converter's counts for the sensors' `readings` (SI), clipped to `limit` (SI) and their range.

    A column per channel. Fewer than 16 bits are left-justified in the message's field: the same volts per count.
    """
    most = triad.range_unit if limit is None else min(limit / triad.unit, triad.range_unit)
    arrived = np.clip(readings[:, list(wiring.plugs)] / triad.unit, -most, most)
    volts = NULL_VOLTS + triad.volts_per_unit * (arrived * np.array(wiring.factors))
    step = 1 << (FIELD_BITS - bits)
    counts: Counts = np.clip(np.rint(volts / (step * VOLTS_PER_COUNT)), 0, (1 << bits) - 1).astype(np.int64)
    return counts * step
