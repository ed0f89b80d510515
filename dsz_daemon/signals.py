"""The vocabulary: every quantity that a car can hand us, with unit, sign and plausible range.

Axes are ISO 8855 (x forward, y left, z up), inside everything is SI and radians. Read this
file first: all other rooms use these names.
"""

from __future__ import annotations

import math
from typing import NamedTuple

STANDARD_GRAVITY_MPS2 = 9.80665

GYRO_CHANNELS = ("gyro_x", "gyro_y", "gyro_z")
ACCEL_CHANNELS = ("accel_x", "accel_y", "accel_z")
IMU_CHANNELS = GYRO_CHANNELS + ACCEL_CHANNELS
WHEELS = ("fl", "fr", "rl", "rr")
WHEEL_SPEEDS = tuple(f"wheel_speed_{wheel}" for wheel in WHEELS)

_RATE = {"rad/s": 1.0, "deg/s": math.pi / 180.0}
_ACCELERATION = {"m/s^2": 1.0, "g": STANDARD_GRAVITY_MPS2}
_ANGLE = {"rad": 1.0, "deg": math.pi / 180.0}
_SPEED = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}
# A turning wheel: the factor gives rad/s, the configured wheel radius turns it into m/s.
WHEEL_ROTATION_UNITS = {"rad/s": 1.0, "rpm": 2.0 * math.pi / 60.0}
_NUMBER = {"1": 1.0}
_TEMPERATURE = {"degC": 1.0}


class Quantity(NamedTuple):
    """One role in the vocabulary.

    `units` maps each unit that a configuration may name to its factor into `si_unit`.
    Values outside [`low`, `high`] (in `si_unit`) are impossible for a road vehicle and its
    sensors: they are counted and never used. `suffix` is what column names carry.
    """

    name: str
    si_unit: str
    suffix: str
    units: dict[str, float]
    low: float
    high: float
    meaning: str


def _quantities() -> dict[str, Quantity]:
    rows: list[Quantity] = []
    rates = (
        "roll rate, left side rising positive",
        "pitch rate, nose falling positive",
        "yaw rate, to the left positive",
    )
    forces = ("specific force forward", "specific force to the left", "specific force up, +g at rest")
    # 35 rad/s = 2000 deg/s: the widest range of any consumer gyro; 16 g likewise.
    rows += [Quantity(n, "rad/s", "radps", _RATE, -35.0, 35.0, m) for n, m in zip(GYRO_CHANNELS, rates, strict=True)]
    rows += [
        Quantity(n, "m/s^2", "mps2", _ACCELERATION, -160.0, 160.0, m)
        for n, m in zip(ACCEL_CHANNELS, forces, strict=True)
    ]
    # 120 m/s = 432 km/h; negative where a car's sensors tell the direction.
    speed_units = _SPEED | WHEEL_ROTATION_UNITS
    rows += [
        Quantity(n, "m/s", "mps", speed_units, -30.0, 120.0, f"speed of the {n[-2:]} wheel's rim") for n in WHEEL_SPEEDS
    ]
    rows += [
        Quantity(
            "steering_wheel_angle",
            "rad",
            "rad",
            _ANGLE,
            -35.0,
            35.0,
            "hand wheel angle, to the left positive",
        ),
        Quantity(
            "road_wheel_angle",
            "rad",
            "rad",
            _ANGLE,
            -1.2,
            1.2,
            "front road wheel angle, to the left positive",
        ),
        Quantity("brake", "1", "", _NUMBER, -math.inf, math.inf, "nonzero = braking"),
        Quantity("accelerator", "1", "", _NUMBER, -math.inf, math.inf, "nonzero = accelerating"),
        Quantity("reverse", "1", "", _NUMBER, -math.inf, math.inf, "nonzero = reverse gear"),
        Quantity("gear", "1", "", _NUMBER, -math.inf, math.inf, "gear lever or gear, as coded by the car"),
        Quantity("temperature", "degC", "degc", _TEMPERATURE, -60.0, 150.0, "temperature of the IMU"),
        Quantity(
            "speed_reference",
            "m/s",
            "mps",
            _SPEED,
            -30.0,
            120.0,
            "another unit's vehicle speed, never used by the estimator",
        ),
    ]
    names = ("roll", "pitch", "yaw")
    rows += [
        Quantity(
            f"{n}_rate_reference",
            "rad/s",
            "radps",
            _RATE,
            -35.0,
            35.0,
            f"another unit's {n} rate, only compared",
        )
        for n in names
    ]
    rows += [
        Quantity(
            f"{n}_reference",
            "m/s^2",
            "mps2",
            _ACCELERATION,
            -160.0,
            160.0,
            "another unit's acceleration, only compared",
        )
        for n in ACCEL_CHANNELS
    ]
    return {row.name: row for row in rows}


QUANTITIES: dict[str, Quantity] = _quantities()

# The reference of each IMU channel: what another unit (a maker's ESC sensor, a GNSS/INS)
# reports for the same quantity. It is shown beside the result and never used by it.
REFERENCE_OF = {
    "gyro_x": "roll_rate_reference",
    "gyro_y": "pitch_rate_reference",
    "gyro_z": "yaw_rate_reference",
    "accel_x": "accel_x_reference",
    "accel_y": "accel_y_reference",
    "accel_z": "accel_z_reference",
}
