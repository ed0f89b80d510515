"""One car's sensor errors by one seed: as calibrated at the end of the line, or as the data sheet lets them be.

Each purpose has a stream of its own, so that a new draw moves no older one: what is drawn
from the generator itself (null errors, scale, cross-axis) stays as it is, and a new purpose is
added at the end of `_PURPOSES`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dsz_daemon.sim.sensors import (
    ACCELS,
    GYROS,
    Angles,
    Clocks,
    CrossAxis,
    PoleRing,
    SensorErrors,
    UnitClock,
    Vector3,
    WarmUp,
)

# Chosen: what is left after a calibration of scale and alignment at the end of the line, one
# standard deviation each. The paper zeroes offsets and assumes the rest. At these levels
# gravity leaks 10 and 5 mm/s^2, a twentieth of the accelerometer's null error.
SCALE_ERROR_STD = 1.0e-3
CROSS_AXIS_STD = 0.5e-3

# Tables 1 and 2. A number alone, or least and most, is drawn evenly inside; a typical value
# with a most is the standard deviation of a normal draw that ends at the most.
GYRO_SCALE_MOST, ACCEL_SCALE_MOST = 0.8 / 7.0, 0.04
GYRO_CROSS_AXIS, ACCEL_CROSS_AXIS = (0.01, 0.03), (0.015, 0.03)
GYRO_NONLINEARITY_MOST, ACCEL_NONLINEARITY = 0.001, (0.002, 0.0125)
G_SENSITIVITY_MOST = 0.1 * GYROS.unit / ACCELS.unit
ALIGNMENT_MOST_RAD = math.radians(1.0)
GYRO_NOISE_GAIN_MOST = 0.06 / 0.03  # cold to hot
ACCEL_NOISE_GAIN_MOST = 3.0 / 1.0  # its output noise, most over typical

# Chosen: magnetised encoder rings are good to one or two per cent of a pitch, milled ones to less.
POLE_PITCH_ERROR_STD = 0.01
# The tables are silent on the rest. Chosen: of the size that parts of this class have.
MOUNTING_MOST_RAD = math.radians(2.0)
PLACE_LEAST_M, PLACE_MOST_M = (-0.8, -0.4, -0.4), (0.8, 0.4, 0.2)  # floor, tunnel, under a seat
FLICKER_CORNER_HZ = 0.1  # where 1/f noise meets the data sheet's white noise
GYRO_DRIFT_MOST_RADPS_PER_S = 0.01 * GYROS.unit / 60.0
ACCEL_DRIFT_MOST_MPS2_PER_S = 0.1e-3 * ACCELS.unit / 60.0
GYRO_DRIFT_MOST_RADPS_PER_K = 0.03 * GYROS.unit
ACCEL_DRIFT_MOST_MPS2_PER_K = 0.3e-3 * ACCELS.unit
START_C, WARMER_BY_K, WARM_UP_S = (-10.0, 30.0), (5.0, 30.0), (300.0, 1200.0)
CUTOFF_HZ = (20.0, 50.0)
DELAY_MOST_S = 0.02
JITTER_MOST_S = 0.0005
STEERING_OFFSET_MOST_RAD = math.radians(3.0 / 15.7)  # 3 deg of steering wheel
STEERING_QUANTA_DEG = (0.1, 0.5, 1.0, 1.5)
CLOCK_MOST_PPM = 100.0
PHASE_MOST_S = 0.01

_PURPOSES = (
    "pole ring",
    "clocks",
    "scale",
    "cross-axis",
    "nonlinearity",
    "g-sensitivity",
    "alignment",
    "place",
    "noise",
    "drift",
    "warm-up",
    "converter",
    "delay",
    "steering",
    "pole pitch",
)
_Streams = dict[str, np.random.Generator]


def draw_errors(rng: np.random.Generator) -> SensorErrors:
    """Draw a calibrated car: null errors evenly within the data sheets' limits, scale and cross-axis as above.

    Wheel speeds come from pole rings. Everything else is left out.
    """
    return _calibrated(rng, _streams(rng))


def draw_clocks(rng: np.random.Generator) -> Clocks:
    """Draw the clocks that `draw_datasheet_errors` gives with the same generator, for any other draw."""
    return _clocks(_streams(rng)["clocks"])


def draw_datasheet_errors(rng: np.random.Generator) -> SensorErrors:
    """Draw a car that nobody calibrated: every error within the data sheet's spread, or the chosen one.

    Null errors are those that `draw_errors` draws with the same generator.
    """
    streams = _streams(rng)
    scale, cross, bend = streams["scale"], streams["cross-axis"], streams["nonlinearity"]
    noise, drift, warm, delay = streams["noise"], streams["drift"], streams["warm-up"], streams["delay"]
    pull, align, steering = streams["g-sensitivity"], streams["alignment"], streams["steering"]
    place = streams["place"].uniform(PLACE_LEAST_M, PLACE_MOST_M)
    start_c = float(warm.uniform(*START_C))
    corner, most_pull = math.sqrt(FLICKER_CORNER_HZ), G_SENSITIVITY_MOST
    return replace(
        _calibrated(rng, streams),
        gyro_scale=_even(scale, GYRO_SCALE_MOST),
        accel_scale=_even(scale, ACCEL_SCALE_MOST),
        gyro_cross_axis=CrossAxis(*_cut(cross, *GYRO_CROSS_AXIS, 6)),
        accel_cross_axis=CrossAxis(*_cut(cross, *ACCEL_CROSS_AXIS, 6)),
        imu_misalignment=Angles(*_even(align, MOUNTING_MOST_RAD)),
        accel_alignment=Angles(*_even(align, ALIGNMENT_MOST_RAD)),
        imu_place_m=_vector(place.tolist()),
        gyro_nonlinearity=_even(bend, GYRO_NONLINEARITY_MOST),
        accel_nonlinearity=_vector(_cut(bend, *ACCEL_NONLINEARITY, 3)),
        gyro_g_sensitivity=(_even(pull, most_pull), _even(pull, most_pull), _even(pull, most_pull)),
        gyro_noise_gain=float(noise.uniform(1.0, GYRO_NOISE_GAIN_MOST)),
        accel_noise_gain=float(noise.uniform(1.0, ACCEL_NOISE_GAIN_MOST)),
        gyro_flicker_radps=GYROS.noise_per_root_hz * GYROS.unit * corner,
        accel_flicker_mps2=ACCELS.noise_per_root_hz * ACCELS.unit * corner,
        gyro_drift_radps_per_s=_even(drift, GYRO_DRIFT_MOST_RADPS_PER_S),
        accel_drift_mps2_per_s=_even(drift, ACCEL_DRIFT_MOST_MPS2_PER_S),
        gyro_drift_radps_per_k=_even(drift, GYRO_DRIFT_MOST_RADPS_PER_K),
        accel_drift_mps2_per_k=_even(drift, ACCEL_DRIFT_MOST_MPS2_PER_K),
        warm_up=WarmUp(start_c, start_c + float(warm.uniform(*WARMER_BY_K)), float(warm.uniform(*WARM_UP_S))),
        imu_cutoff_hz=float(streams["converter"].uniform(*CUTOFF_HZ)),
        converter_bits=(12, 16)[int(streams["converter"].integers(2))],
        imu_delay_s=float(delay.uniform(0.0, DELAY_MOST_S)),
        wheel_speed_delay_s=float(delay.uniform(0.0, DELAY_MOST_S)),
        steering_delay_s=float(delay.uniform(0.0, DELAY_MOST_S)),
        stamp_jitter_s=float(delay.uniform(0.0, JITTER_MOST_S)),
        steering_offset_rad=float(steering.uniform(-1.0, 1.0)) * STEERING_OFFSET_MOST_RAD,
        steering_quantum_deg=STEERING_QUANTA_DEG[int(steering.integers(len(STEERING_QUANTA_DEG)))],
        clocks=_clocks(streams["clocks"]),
    )


def _streams(rng: np.random.Generator) -> _Streams:
    return dict(zip(_PURPOSES, rng.spawn(len(_PURPOSES)), strict=True))


def _calibrated(rng: np.random.Generator, streams: _Streams) -> SensorErrors:
    gyro = _even(rng, GYROS.null_error_unit, GYROS.unit)
    accel = _even(rng, ACCELS.null_error_unit, ACCELS.unit)
    gyro_scale, gyro_cross = _residual_sensitivity(rng)
    accel_scale, accel_cross = _residual_sensitivity(rng)
    fl, fr, rl, rr = (float(x) for x in streams["pole ring"].random(4))
    perfect = PoleRing(starts=(fl, fr, rl, rr))
    off = (POLE_PITCH_ERROR_STD * streams["pole pitch"].normal(size=(4, perfect.poles))).tolist()
    return SensorErrors(
        gyro,
        accel,
        gyro_scale=gyro_scale,
        accel_scale=accel_scale,
        gyro_cross_axis=gyro_cross,
        accel_cross_axis=accel_cross,
        pole_ring=perfect._replace(off_pitches=tuple(tuple(wheel) for wheel in off)),
    )


def _residual_sensitivity(rng: np.random.Generator) -> tuple[Vector3, CrossAxis]:
    """Return scale and cross-axis errors; nine draws, row by row of the matrix."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = (float(x) for x in rng.normal(size=9))
    cross = (CROSS_AXIS_STD * x for x in (xy, xz, yx, yz, zx, zy))
    return (SCALE_ERROR_STD * xx, SCALE_ERROR_STD * yy, SCALE_ERROR_STD * zz), CrossAxis(*cross)


def _clocks(rng: np.random.Generator) -> Clocks:
    ppm = rng.uniform(-CLOCK_MOST_PPM, CLOCK_MOST_PPM, len(Clocks._fields)).tolist()
    phase_s = rng.uniform(0.0, PHASE_MOST_S, len(Clocks._fields)).tolist()
    return Clocks(*(UnitClock(*pair) for pair in zip(ppm, phase_s, strict=True)))


def _even(rng: np.random.Generator, most: float, unit: float = 1.0) -> Vector3:
    """Return three values, even within +-`most` of `unit`."""
    return _vector((rng.uniform(-1.0, 1.0, 3) * most * unit).tolist())


def _cut(rng: np.random.Generator, typical: float, most: float, size: int) -> list[float]:
    """Return normal draws of standard deviation `typical` that end at +-`most`."""
    drawn: list[float] = np.clip(rng.normal(size=size) * typical, -most, most).tolist()
    return drawn


def _vector(values: list[float]) -> Vector3:
    x, y, z = values
    return (x, y, z)
