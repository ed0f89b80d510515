"""A drive of 26 s written by hand, as CAN frames with known offsets: what the scenarios are made of.

Its own small physics: a rigid body whose tyres slip in proportion to their force, each wheel rolling
at the speed of its own point. Standing, speeding up, straight ahead, a slalom, braking, straight ahead.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

G = 9.80665
DEG = math.pi / 180.0
START_S = 1_700_000_000
DURATION_S = 26.0
# When what happens; all else is straight ahead.
SPEEDS_UP_S, SLALOM_S, BRAKES_S = (4.0, 7.0), (12.5, 17.5), (18.0, 19.5)
OFFSETS = {
    "gyro_x": 0.8 * DEG,
    "gyro_y": -0.6 * DEG,
    "gyro_z": 0.5 * DEG,
    "accel_x": 0.15,
    "accel_y": -0.2,
    "accel_z": 0.1,
}
NOISE_STD = {"gyro": 0.05 * DEG, "accel": 0.02, "wheel": 0.01}

MASS_KG, FRONT_M, REAR_M, TRACK_M = 1673.0, 1.149, 1.491, 1.586
FRONT_N_PER_RAD, REAR_N_PER_RAD, STEERING_RATIO = 62000.0, 68000.0, 15.7

RATES, ACCELS, FLOATS, WHEELS, STEER, PEDALS = 0x310, 0x311, 0x321, 0x0AA, 0x025, 0x224

DBC = """\
VERSION ""

NS_ :

BS_:

BU_: CAR IMU

BO_ 784 IMU_RATES: 6 IMU
 SG_ P : 0|16@1- (0.01,0) [-327.68|327.67] "deg/s" CAR
 SG_ Q : 16|16@1- (0.01,0) [-327.68|327.67] "deg/s" CAR
 SG_ R : 32|16@1- (0.01,0) [-327.68|327.67] "deg/s" CAR

BO_ 785 IMU_ACCELS: 6 IMU
 SG_ AX : 0|16@1- (0.002,0) [-65.536|65.534] "m/s^2" CAR
 SG_ AY : 16|16@1- (0.002,0) [-65.536|65.534] "m/s^2" CAR
 SG_ AZ : 32|16@1- (0.002,0) [-65.536|65.534] "m/s^2" CAR

BO_ 801 IMU_FLOATS: 8 IMU
 SG_ R_FLOAT : 0|32@1- (1,0) [0|0] "deg/s" CAR
 SG_ AY_FLOAT : 32|32@1- (1,0) [0|0] "m/s^2" CAR

BO_ 170 WHEEL_SPEEDS: 8 CAR
 SG_ FL : 7|16@0+ (0.01,0) [0|655.35] "km/h" IMU
 SG_ FR : 23|16@0+ (0.01,0) [0|655.35] "km/h" IMU
 SG_ RL : 39|16@0+ (0.01,0) [0|655.35] "km/h" IMU
 SG_ RR : 55|16@0+ (0.01,0) [0|655.35] "km/h" IMU

BO_ 37 STEERING: 2 CAR
 SG_ ANGLE : 7|16@0- (0.1,0) [-3276.8|3276.7] "deg" IMU

BO_ 548 PEDALS: 1 CAR
 SG_ BRAKE_ON : 0|1@1+ (1,0) [0|1] "" IMU
 SG_ GAS_ON : 1|1@1+ (1,0) [0|1] "" IMU

SIG_VALTYPE_ 801 R_FLOAT : 1;
SIG_VALTYPE_ 801 AY_FLOAT : 1;
"""

CONFIG = """\
vehicle:
  mass_kg: 1673
  yaw_inertia_kgm2: 2850
  cg_to_front_axle_m: 1.149
  cg_to_rear_axle_m: 1.491
  front_track_m: 1.586
  rear_track_m: 1.586
  front_cornering_stiffness_n_per_rad: 62000
  rear_cornering_stiffness_n_per_rad: 68000
  steering_ratio: 15.7
  driven_axle: front
signals:
  dbc: [car.dbc]
  gyro_x: {message: IMU_RATES, signal: P, unit: deg/s, channel: can1}
  gyro_y: {message: IMU_RATES, signal: Q, unit: deg/s, channel: can1}
  gyro_z: {message: IMU_RATES, signal: R, unit: deg/s, channel: can1}
  accel_x: {message: IMU_ACCELS, signal: AX, unit: m/s^2, channel: can1}
  accel_y: {message: IMU_ACCELS, signal: AY, unit: m/s^2, channel: can1}
  accel_z: {message: IMU_ACCELS, signal: AZ, unit: m/s^2, channel: can1}
  wheel_speed_fl: {message: WHEEL_SPEEDS, signal: FL, unit: km/h, channel: can0}
  wheel_speed_fr: {message: WHEEL_SPEEDS, signal: FR, unit: km/h, channel: can0}
  wheel_speed_rl: {message: WHEEL_SPEEDS, signal: RL, unit: km/h, channel: can0}
  wheel_speed_rr: {message: WHEEL_SPEEDS, signal: RR, unit: km/h, channel: can0}
  steering_wheel_angle: {message: STEERING, signal: ANGLE, unit: deg, channel: can0}
  brake: {message: PEDALS, signal: BRAKE_ON, channel: can0}
bus:
  can0: {interface: virtual, channel: short-drive-0}
  can1: {interface: virtual, channel: short-drive-1}
loop: {rate_hz: 50}
"""


class Sent(NamedTuple):
    """One frame of the drive: `t_s` since its start."""

    t_s: float
    channel: str
    can_id: int
    data: bytes


class Motion(NamedTuple):
    """What truly happens: columns over `t_s`, SI, ISO 8855."""

    t_s: np.ndarray
    v: np.ndarray
    v_rate: np.ndarray
    r: np.ndarray
    vy: np.ndarray
    ay: np.ndarray
    delta: np.ndarray

    def at(self, column: str, t_s: float) -> float:
        return float(np.interp(t_s, self.t_s, getattr(self, column)))


def motion() -> Motion:
    """At rest, 4 m/s^2 to 12 m/s, four slalom bends of up to 18 deg/s, -2 m/s^2 to 9 m/s."""
    t = np.arange(0.0, DURATION_S + 0.5, 0.002)
    v_rate = np.where((t >= SPEEDS_UP_S[0]) & (t < SPEEDS_UP_S[1]), 4.0, 0.0)
    v_rate = np.where((t >= BRAKES_S[0]) & (t < BRAKES_S[1]), -2.0, v_rate)
    v = np.concatenate([[0.0], np.cumsum(v_rate[:-1]) * 0.002])
    phase = (t - SLALOM_S[0]) / (SLALOM_S[1] - SLALOM_S[0])
    # A sine within half of one: neither a jump in yaw acceleration at its ends nor a turn that is left.
    r = np.where((phase > 0.0) & (phase < 1.0), 0.35 * np.sin(4 * np.pi * phase) * np.sin(np.pi * phase), 0.0)
    length = FRONT_M + REAR_M
    vy = REAR_M * r - v * MASS_KG * FRONT_M * r * v / (2.0 * length * REAR_N_PER_RAD)
    ay = np.gradient(vy, t) + r * v
    understeer = MASS_KG / length * (REAR_M / (2.0 * FRONT_N_PER_RAD) - FRONT_M / (2.0 * REAR_N_PER_RAD))
    delta = length * r / np.maximum(v, 1.0) + understeer * ay
    return Motion(t, v, v_rate, r, vy, ay, delta)


def frames(seed: int = 7, floats: bool = False) -> list[Sent]:
    """The drive as frames: IMU on can1 at 100 Hz, wheels and steering on can0 at 50 Hz, pedals at 20 Hz.

    `floats`: yaw rate and lateral acceleration come a second time, as IEEE 754 numbers.
    """
    true, noise = motion(), np.random.default_rng(seed)
    sent: list[Sent] = []
    for k in range(round(DURATION_S * 100)):
        sent += _imu(true, 0.01 * k + 0.002, noise)
    for k in range(round(DURATION_S * 50)):
        sent += _car(true, 0.02 * k + 0.005, noise)
    for k in range(round(DURATION_S * 20)):
        t_s = 0.05 * k + 0.008
        rate = true.at("v_rate", t_s)
        sent.append(Sent(t_s, "can0", PEDALS, bytes([(rate < 0.0) | (rate > 0.0) << 1])))
    return sorted(frame for frame in sent if floats or frame.can_id != FLOATS)


def _imu(true: Motion, t_s: float, noise: np.random.Generator) -> list[Sent]:
    r, vy = true.at("r", t_s), true.at("vy", t_s)
    rates = [0.0, 0.0, r]
    accels = [true.at("v_rate", t_s) - r * vy, true.at("ay", t_s), G]
    names = list(OFFSETS)
    rates = [x + OFFSETS[n] + noise.normal(0.0, NOISE_STD["gyro"]) for x, n in zip(rates, names[:3], strict=True)]
    accels = [x + OFFSETS[n] + noise.normal(0.0, NOISE_STD["accel"]) for x, n in zip(accels, names[3:], strict=True)]
    rate_data = struct.pack("<3h", *(round(x / DEG / 0.01) for x in rates))
    return [
        Sent(t_s, "can1", RATES, rate_data),
        Sent(t_s + 0.0003, "can1", ACCELS, struct.pack("<3h", *(round(x / 0.002) for x in accels))),
        Sent(t_s + 0.0006, "can1", FLOATS, struct.pack("<2f", rates[2] / DEG, accels[1])),
    ]


def _car(true: Motion, t_s: float, noise: np.random.Generator) -> list[Sent]:
    v, r, vy, delta = (true.at(name, t_s) for name in ("v", "r", "vy", "delta"))
    wheels = []
    for ahead_m, left_m, turned in ((FRONT_M, 1, delta), (FRONT_M, -1, delta), (-REAR_M, 1, 0.0), (-REAR_M, -1, 0.0)):
        forward, sideways = v - r * left_m * TRACK_M / 2.0, vy + ahead_m * r
        rolling = forward * math.cos(turned) + sideways * math.sin(turned)
        wheels.append(rolling + noise.normal(0.0, NOISE_STD["wheel"]) if rolling > 0.5 else rolling)
    hand_wheel_deg = delta * STEERING_RATIO / DEG
    return [
        Sent(t_s, "can0", WHEELS, struct.pack(">4H", *(round(max(0.0, w) * 3.6 / 0.01) for w in wheels))),
        Sent(t_s + 0.0004, "can0", STEER, struct.pack(">h", round(hand_wheel_deg / 0.1))),
    ]


def candump(sent: Sequence[Sent]) -> str:
    """Candump text, formatted here and not by the product."""
    lines = []
    for frame in sent:
        microseconds = round(frame.t_s * 1e6)
        seconds = START_S + microseconds // 1_000_000
        lines.append(
            f"({seconds}.{microseconds % 1_000_000:06d}) {frame.channel} {frame.can_id:03X}#{frame.data.hex().upper()}"
        )
    return "\n".join(lines) + "\n"


def edited(text: str, *edits: tuple[str, str]) -> str:
    """`text` with each (old, new) replaced once; an edit that finds nothing is a fault of the test."""
    for old, new in edits:
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times"
        text = text.replace(old, new)
    return text


def words_changed(sent: Sequence[Sent], can_id: int, layout: str, change: Callable[..., Sequence[float]]) -> list[Sent]:
    """The same frames with those of `can_id` unpacked by `layout`, changed (t_s, *values) and packed again."""

    def changed(frame: Sent) -> Sent:
        values = change(frame.t_s, *struct.unpack(layout, frame.data))
        return frame._replace(data=struct.pack(layout, *values))

    return [changed(frame) if frame.can_id == can_id else frame for frame in sent]


def write(folder: Path, sent: Sequence[Sent], config: str = CONFIG, dbc: str = DBC) -> tuple[Path, Path]:
    """Recording, configuration and DBC into `folder`; the paths of the first two."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "car.dbc").write_text(dbc)
    (folder / "config.yaml").write_text(config)
    (folder / "drive.log").write_text(candump(sent))
    return folder / "drive.log", folder / "config.yaml"
