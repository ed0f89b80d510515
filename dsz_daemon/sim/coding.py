"""From what truly happened to CAN frames: sample, disturb by the sensors, pack by the DBC."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.signals import WHEEL_SPEEDS
from dsz_daemon.sim.bus import ACCEL_SIGNALS, CHANNEL, RATE_SIGNALS, database
from dsz_daemon.sim.drive import Columns
from dsz_daemon.sim.sensors import (
    ACCELS,
    GYROS,
    Counts,
    SensorErrors,
    imu_counts,
    steering_counts,
    wheel_speed_counts,
)

# Any fixed start will do; this one is easy to recognise (14 November 2023, 22:13:20 UTC).
EPOCH_S = 1_700_000_000
IMU_PERIOD_MS = 10

# Chosen: less torque than this at the wheels is a foot that rests beside the pedals.
PEDAL_ABOVE_NM = 20.0

# What else is on the bus, in no DBC: id, whether extended, period in ms, phase in us.
_UNKNOWN = ((0x316, False, 10, 6100), (0x4F1, False, 100, 7300), (0x18FEF100, True, 100, 8500))


class _Series(NamedTuple):
    """One message over the whole drive: stamps since its start and raw signal values."""

    message: str
    stamps_us: NDArray[np.int64]
    raw: dict[str, Counts]


def can_frames(columns: Columns, steering_ratio: float, errors: SensorErrors, rng: np.random.Generator) -> list[Frame]:
    """Return all frames of a drive, in time order; `columns` as `drive` returns them.

    `rng` makes the IMU's noise and the content of the messages that no DBC describes.
    """
    packers = {message.name: message for message in database().messages}
    frames = []
    for series in _series(columns, steering_ratio, errors, rng):
        packer = packers[series.message]
        names = list(series.raw)
        values = np.column_stack([series.raw[name] for name in names]).tolist()
        for stamp_us, row in zip(series.stamps_us.tolist(), values, strict=True):
            data = packer.encode(dict(zip(names, row, strict=True)), scaling=False)
            frames.append(Frame(_stamp_ns(stamp_us), CHANNEL, packer.frame_id, data))
    frames += _unknown_frames(columns, rng)
    # Of two at the same instant the lower id wins the bus.
    return sorted(frames, key=lambda frame: (frame.t_ns, frame.can_id))


def _series(
    columns: Columns, steering_ratio: float, errors: SensorErrors, rng: np.random.Generator
) -> Iterator[_Series]:
    """Yield what each unit sends. Phases all differ: no two units of a car run in step."""
    noise = rng if errors.noisy else None
    rate_hz = 1000.0 / IMU_PERIOD_MS

    at = _stamps_us(columns, IMU_PERIOD_MS, 0)
    truth = _sampled(columns, [f"{name}_radps" for name in GYROS.channels], at)
    counts = imu_counts(GYROS, truth, errors.gyro_offset_radps, errors.gyro_matrix, rate_hz, noise)
    raw = dict(zip(RATE_SIGNALS, counts.T, strict=True))
    yield _Series("IMU_RATE", at, raw | {"RATE_COUNTER": _counter(at, 256)})

    at = _stamps_us(columns, IMU_PERIOD_MS, 240)  # the next frame on the wire, at 500 kbit/s
    truth = _sampled(columns, [f"{name}_mps2" for name in ACCELS.channels], at)
    counts = imu_counts(ACCELS, truth, errors.accel_offset_mps2, errors.accel_matrix, rate_hz, noise)
    raw = dict(zip(ACCEL_SIGNALS, counts.T, strict=True))
    yield _Series("IMU_ACCEL", at, raw | {"ACCEL_COUNTER": _counter(at, 256)})

    at = _stamps_us(columns, 10, 1700)
    angle_rad = steering_ratio * _sampled(columns, ["road_wheel_angle_rad"], at)[:, 0]
    raw = {"STEER_ANGLE": steering_counts(angle_rad), "STEER_STATUS": np.full(len(at), 7)}
    yield _Series("STEERING", at, raw | {"STEER_COUNTER": _counter(at, 16)})

    at = _stamps_us(columns, 20, 3100)
    counts = wheel_speed_counts(_sampled(columns, [f"{name}_mps" for name in WHEEL_SPEEDS], at))
    raw = {name.upper(): counts[:, i] for i, name in enumerate(WHEEL_SPEEDS)}
    yield _Series("WHEEL_SPEEDS", at, raw | {"WHEEL_COUNTER": _counter(at, 4)})

    at = _stamps_us(columns, 20, 5300)
    torques_nm = _sampled(columns, ["drive_torque_nm", "brake_torque_nm"], at)
    pressed = (torques_nm > PEDAL_ABOVE_NM).astype(np.int64)
    total = np.rint(torques_nm[:, 0] - torques_nm[:, 1]).astype(np.int64)
    yield _Series("PEDALS", at, {"BRAKE_ON": pressed[:, 1], "GAS_ON": pressed[:, 0], "WHEEL_TORQUE": total})


def _unknown_frames(columns: Columns, rng: np.random.Generator) -> list[Frame]:
    """Return the frames that nobody asked for."""
    return [
        Frame(_stamp_ns(stamp_us), CHANNEL, can_id, rng.bytes(8), is_extended)
        for can_id, is_extended, period_ms, phase_us in _UNKNOWN
        for stamp_us in _stamps_us(columns, period_ms, phase_us).tolist()
    ]


def _stamp_ns(stamp_us: int) -> int:
    return EPOCH_S * 1_000_000_000 + stamp_us * 1000


def _stamps_us(columns: Columns, period_ms: int, phase_us: int) -> NDArray[np.int64]:
    end_us = round(float(columns["time_s"][-1]) * 1e6)
    return np.arange(phase_us, end_us, period_ms * 1000, dtype=np.int64)


def _sampled(columns: Columns, names: list[str], at_us: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return n x len(names): the columns at these times, straight between the steps."""
    return np.column_stack([np.interp(at_us / 1e6, columns["time_s"], columns[name]) for name in names])


def _counter(at_us: NDArray[np.int64], size: int) -> Counts:
    return np.arange(len(at_us), dtype=np.int64) % size
