"""From what truly happened to CAN frames: sample, disturb by the sensors, pack by the DBC."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.signals import WHEEL_SPEEDS
from dsz_daemon.sim.bus import ACCEL_SIGNALS, CHANNEL, RATE_SIGNALS, database
from dsz_daemon.sim.clocks import Stamps, due_us, stamped_us
from dsz_daemon.sim.drive import Columns
from dsz_daemon.sim.imu import accel_readings, converter_counts, gyro_readings, low_passed
from dsz_daemon.sim.imu_noise import flicker_noise, white_noise
from dsz_daemon.sim.sensors import ACCELS, GYROS, Counts, SensorErrors, Triad, UnitClock
from dsz_daemon.sim.steering_sensor import steering_counts, steering_reading_rad
from dsz_daemon.sim.wheel_sensors import counted_speed_mps, edge_times_s, pitch_m, wheel_speed_counts

# Any fixed start will do; this one is easy to recognise (14 November 2023, 22:13:20 UTC).
EPOCH_S = 1_700_000_000
IMU_PERIOD_MS = 10

# Chosen: less torque than this at the wheels is a foot that rests beside the pedals.
PEDAL_ABOVE_NM = 20.0

# What else is on the bus, in no DBC: id, whether extended, period in ms, phase in us.
_UNKNOWN = ((0x316, False, 10, 6100), (0x4F1, False, 100, 7300), (0x18FEF100, True, 100, 8500))

Array = NDArray[np.float64]
WheelRadii = tuple[float, float, float, float]  # front left, front right, rear left, rear right


class Series(NamedTuple):
    """One message over the whole drive: stamps in us since its start, and raw signal values."""

    message: str
    stamp_us: Stamps
    raw: dict[str, Counts]


def stamps_ns(stamp_us: Stamps) -> Stamps:
    """Return stamps on the log's clock."""
    return EPOCH_S * 1_000_000_000 + stamp_us * 1000


def can_frames(
    columns: Columns,
    steering_ratio: float,
    wheel_radii_m: WheelRadii,
    errors: SensorErrors,
    rng: np.random.Generator,
) -> list[Frame]:
    """Return all frames of a drive, in time order; `columns` as `drive` returns them.

    `steering_ratio` and `wheel_radii_m` are what the controllers reckon with. `rng` makes the
    IMU's noise and the content of the messages that no DBC describes; jitter and flicker noise
    have streams of their own.
    """
    packers = {message.name: message for message in database().messages}
    frames = []
    for each in signal_series(columns, steering_ratio, wheel_radii_m, errors, rng):
        packer = packers[each.message]
        names = list(each.raw)
        values = np.column_stack([each.raw[name] for name in names]).tolist()
        for t_ns, row in zip(stamps_ns(each.stamp_us).tolist(), values, strict=True):
            data = packer.encode(dict(zip(names, row, strict=True)), scaling=False)
            frames.append(Frame(t_ns, CHANNEL, packer.frame_id, data))
    frames += _unknown_frames(columns, rng)
    # Of two at the same instant the lower id wins the bus.
    return sorted(frames, key=lambda frame: (frame.t_ns, frame.can_id))


def signal_series(
    columns: Columns,
    steering_ratio: float,
    wheel_radii_m: WheelRadii,
    errors: SensorErrors,
    rng: np.random.Generator,
) -> list[Series]:
    """Return what the car's own units send, message by message; arguments as of `can_frames`."""
    jitter, flicker = rng.spawn(2)
    series = [
        *_imu_series(columns, errors, rng, flicker),
        _steering_series(columns, steering_ratio, errors),
        _wheel_series(columns, wheel_radii_m, errors),
        _pedal_series(columns, errors),
    ]
    return [each._replace(stamp_us=stamped_us(each.stamp_us, errors.stamp_jitter_s, jitter)) for each in series]


# What each unit sends. Phases all differ: no two units of a car run in step.


def _imu_series(
    columns: Columns, errors: SensorErrors, rng: np.random.Generator, flicker: np.random.Generator
) -> Iterator[Series]:
    rates = [f"{name}_radps" for name in GYROS.channels]
    forces = [f"{name}_mps2" for name in ACCELS.channels]
    motion = columns
    if errors.imu_cutoff_hz is not None:
        time_s = columns["time_s"]
        passed = {name: low_passed(time_s, columns[name], errors.imu_cutoff_hz) for name in rates + forces}
        motion = columns | passed

    at = _due_us(columns, errors.clocks.imu, IMU_PERIOD_MS, 0)
    at_s = at / 1e6 - errors.imu_delay_s
    readings = gyro_readings(errors, _sampled(motion, rates, at_s), _sampled(motion, forces, at_s), at_s)
    if errors.noisy:
        readings += _noise(GYROS, errors.gyro_noise_gain, errors.gyro_flicker_radps, len(at), rng, flicker)
    counts = converter_counts(GYROS, readings, errors.gyro_limit_radps, errors.converter_bits, errors.gyro_wiring)
    raw = dict(zip(RATE_SIGNALS, counts.T, strict=True))
    yield Series("IMU_RATE", at, raw | {"RATE_COUNTER": _counter(at, 256)})

    at = _due_us(columns, errors.clocks.imu, IMU_PERIOD_MS, 240)  # the next frame on the wire, at 500 kbit/s
    at_s = at / 1e6 - errors.imu_delay_s
    readings = accel_readings(errors, _sampled(motion, forces, at_s), at_s)
    if errors.noisy:
        readings += _noise(ACCELS, errors.accel_noise_gain, errors.accel_flicker_mps2, len(at), rng, flicker)
    counts = converter_counts(ACCELS, readings, errors.accel_limit_mps2, errors.converter_bits, errors.accel_wiring)
    raw = dict(zip(ACCEL_SIGNALS, counts.T, strict=True))
    yield Series("IMU_ACCEL", at, raw | {"ACCEL_COUNTER": _counter(at, 256)})


def _noise(
    triad: Triad,
    gain: float,
    level: float,
    size: int,
    rng: np.random.Generator,
    flicker: np.random.Generator,
) -> Array:
    rate_hz = 1000.0 / IMU_PERIOD_MS
    noise = white_noise(triad, gain, size, rate_hz, rng)
    return noise + flicker_noise(level, size, rate_hz, flicker) if level else noise


def _steering_series(columns: Columns, steering_ratio: float, errors: SensorErrors) -> Series:
    at = _due_us(columns, errors.clocks.steering, 10, 1700)
    wheel_rad = _sampled(columns, ["steering_wheel_angle_rad"], at / 1e6 - errors.steering_delay_s)[:, 0]
    reading_rad = steering_reading_rad(wheel_rad, errors.steering_offset_rad, steering_ratio)
    raw = {"STEER_ANGLE": steering_counts(reading_rad, errors.steering_quantum_deg)}
    return Series("STEERING", at, raw | {"STEER_STATUS": np.full(len(at), 7), "STEER_COUNTER": _counter(at, 16)})


def _wheel_series(columns: Columns, wheel_radii_m: WheelRadii, errors: SensorErrors) -> Series:
    at = _due_us(columns, errors.clocks.wheel_speeds, 20, 3100)
    at_s = at / 1e6 - errors.wheel_speed_delay_s
    names = [f"{name}_mps" for name in WHEEL_SPEEDS]
    ring = errors.pole_ring
    if ring is None:
        speeds = _sampled(columns, names, at_s)
    else:
        pitches = [pitch_m(radius_m, ring.poles) for radius_m in wheel_radii_m]
        counted = (
            counted_speed_mps(edge_times_s(columns["time_s"], columns[name], pitch, start, off), pitch, at_s)
            for name, pitch, start, off in zip(names, pitches, ring.starts, ring.off_pitches, strict=True)
        )
        speeds = np.column_stack(list(counted))
    counts = wheel_speed_counts(speeds)
    raw = {name.upper(): counts[:, i] for i, name in enumerate(WHEEL_SPEEDS)}
    return Series("WHEEL_SPEEDS", at, raw | {"WHEEL_COUNTER": _counter(at, 4)})


def _pedal_series(columns: Columns, errors: SensorErrors) -> Series:
    at = _due_us(columns, errors.clocks.pedals, 20, 5300)
    torques_nm = _sampled(columns, ["drive_torque_nm", "brake_torque_nm"], at / 1e6)
    pressed = (torques_nm > PEDAL_ABOVE_NM).astype(np.int64)
    total = np.clip(np.rint(torques_nm[:, 0] - torques_nm[:, 1]), -(1 << 15), (1 << 15) - 1).astype(np.int64)
    return Series("PEDALS", at, {"BRAKE_ON": pressed[:, 1], "GAS_ON": pressed[:, 0], "WHEEL_TORQUE": total})


def _unknown_frames(columns: Columns, rng: np.random.Generator) -> list[Frame]:
    """Return the frames that nobody asked for."""
    return [
        Frame(t_ns, CHANNEL, can_id, rng.bytes(8), is_extended)
        for can_id, is_extended, period_ms, phase_us in _UNKNOWN
        for t_ns in stamps_ns(_due_us(columns, UnitClock(), period_ms, phase_us)).tolist()
    ]


def _due_us(columns: Columns, clock: UnitClock, period_ms: int, phase_us: int) -> Stamps:
    return due_us(clock, period_ms, phase_us, float(columns["time_s"][-1]))


def _sampled(columns: Columns, names: list[str], at_s: Array) -> Array:
    """Return n x len(names): the columns at these times, straight between the steps, level outside."""
    time_s = columns["time_s"]
    after = np.clip(np.searchsorted(time_s, at_s, side="right"), 1, len(time_s) - 1)
    share = np.clip((at_s - time_s[after - 1]) / (time_s[after] - time_s[after - 1]), 0.0, 1.0)
    ends = ((columns[name][after - 1], columns[name][after]) for name in names)
    return np.column_stack([start + share * (end - start) for start, end in ends])


def _counter(at_us: Stamps, size: int) -> Counts:
    return np.arange(len(at_us), dtype=np.int64) % size
