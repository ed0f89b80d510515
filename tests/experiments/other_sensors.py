"""What other cars' sensors show, and how it gets onto a bus: counts, noise, offsets and a DBC by the seed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from other_drives import DT
from other_motion import low_passed

Floats = np.ndarray[Any, np.dtype[np.float64]]
# A parameter of an effect, 0 (or what is given) where it is not left out.
Get = Callable[..., float]

IMU = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
WHEELS = ("fl", "fr", "rl", "rr")


def sensed(rates: Floats, force: Floats, time: Floats, get: Get) -> Floats:
    """The IMU's readings (n, 6) of rates and specific force at its place."""
    roll, pitch, yaw = (get("imu_misalignment", f"{a}_rad") for a in ("roll", "pitch", "yaw"))
    turn = np.array([[1.0, yaw, -pitch], [-yaw, 1.0, roll], [pitch, -roll, 1.0]])
    rates, force = rates @ turn.T, force @ turn.T

    def matrix(scale: str, cross: str) -> Floats:
        cells = [[1.0 + get(scale, a) if a == b else get(cross, a + b) for b in "xyz"] for a in "xyz"]
        return np.array(cells, dtype=np.float64)

    pulls = np.array([[get("gyro_g_sensitivity", a + b) for b in "xyz"] for a in "xyz"])
    found = np.column_stack(
        [
            rates @ matrix("gyro_scale", "gyro_cross_axis").T + force @ pulls.T,
            force @ matrix("accel_scale", "accel_cross_axis").T,
        ]
    )
    for i, name in enumerate(IMU):
        if get("sensor_bandwidth", "cutoff_hz"):
            found[:, i] = low_passed(np.ascontiguousarray(found[:, i]), get("sensor_bandwidth", "cutoff_hz"))
        found[:, i] = np.interp(time - get("imu_delay", "delay_s"), time, found[:, i])
        found[:, i] += get("bias_drift", name) * time
    return found


class Entry(NamedTuple):
    """One signal of 16 bits."""

    name: str
    factor: float
    signed: bool
    unit: str
    noise: float
    offset: float


class Message(NamedTuple):
    """One message, sent at a rate."""

    name: str
    can_id: int
    rate_hz: int
    entries: tuple[Entry, ...]


def messages(rng: np.random.Generator) -> tuple[Message, ...]:
    """What a car sends."""
    level = math.exp(rng.uniform(math.log(0.3), math.log(3.0)))
    imu_hz, wheel_hz, hand_hz = (int(rng.choice(hz)) for hz in ([50, 100, 200], [25, 50, 100], [50, 100]))
    ids = [0x100 * (k + 1) + int(rng.integers(256)) for k in range(4)]
    force, wheel, hand = rng.choice([0.001, 0.0025, 0.01]), rng.choice([0.01, 0.03125]), rng.choice([0.1, 0.1, 0.5])
    return (
        Message(
            "RATES",
            ids[0],
            imu_hz,
            tuple(Entry(name, 0.01, True, "deg/s", 0.08 * level, rng.normal(0.0, 0.7)) for name in IMU[:3]),
        ),
        Message(
            "FORCES",
            ids[1],
            imu_hz,
            tuple(Entry(name, float(force), True, "m/s^2", 0.025 * level, rng.normal(0.0, 0.15)) for name in IMU[3:]),
        ),
        Message(
            "WHEELS",
            ids[2],
            wheel_hz,
            tuple(Entry(f"wheel_speed_{w}", float(wheel), False, "km/h", 0.02 * level**0.5, 0.0) for w in WHEELS),
        ),
        Message("HAND", ids[3], hand_hz, (Entry("steering_wheel_angle", float(hand), True, "deg", 0.02, 0.0),)),
    )


def write(rng: np.random.Generator, folder: Path, channels: Mapping[str, Floats], limit_mps2: float) -> dict[str, Any]:
    """car.dbc and recording.log; returns the configuration's section of signals. Accelerometers clip at the limit."""
    dbc, frames = ['VERSION ""', "", "BU_: CAR", ""], []
    signals: dict[str, Any] = {"dbc": "car.dbc"}
    seconds, late_s = len(channels["gyro_x"]) * DT, rng.uniform(0.0, 0.003)
    for message in messages(rng):
        at = np.arange(rng.uniform(0.0, 1.0 / message.rate_hz), seconds, 1.0 / message.rate_hz)
        stamps = at + rng.uniform(0.0, late_s, len(at))
        dbc.append(f"BO_ {message.can_id} {message.name}: {2 * len(message.entries)} CAR")
        columns = []
        for place, entry in enumerate(message.entries):
            sign = "-" if entry.signed else "+"
            dbc.append(
                f' SG_ {entry.name.upper()} : {16 * place}|16@1{sign} ({entry.factor},0) [0|0] "{entry.unit}" CAR'
            )
            values = np.interp(at, DT * np.arange(len(channels[entry.name])), channels[entry.name])
            columns.append(_counts(rng, entry, values, limit_mps2))
            signals[entry.name] = {"message": message.name, "signal": entry.name.upper(), "unit": entry.unit}
        dbc.append("")
        for k, stamp in enumerate(stamps.tolist()):
            data = b"".join(int(column[k] & 0xFFFF).to_bytes(2, "little") for column in columns)
            frames.append((stamp, f"{message.can_id:03X}#{data.hex().upper()}"))
    frames.sort()
    first = 1_700_000_000.0
    (folder / "recording.log").write_text("".join(f"({first + at:.6f}) can0 {frame}\n" for at, frame in frames))
    (folder / "car.dbc").write_text("\n".join(dbc))
    return signals


def _counts(rng: np.random.Generator, entry: Entry, values: Floats, limit_mps2: float) -> Any:
    if entry.unit in {"deg", "deg/s"}:
        values = np.degrees(values)
    elif entry.unit == "km/h":
        values = values * 3.6
    noise = rng.normal(0.0, entry.noise, len(values))
    # Wheels that stand are counted as standing.
    values = values + entry.offset + np.where((entry.unit == "km/h") & (values < 0.5), 0.0, noise)
    if entry.name in IMU[3:5]:
        values = np.clip(values, -limit_mps2, limit_mps2)
    low, high = (-32768, 32767) if entry.signed else (0, 65535)
    return np.clip(np.round(values / entry.factor), low, high).astype(np.int64)
