"""The simulated car's bus on paper: its DBC files and the configuration that reads them.

Wheel speeds and steering are laid out like a Hyundai's of the Tucson's age (little endian,
14 and signed 16 bit); the IMU sends converter counts, rates little and accelerations big
endian, so that a decoder meets all of these.
"""

from __future__ import annotations

from typing import Any

from cantools.database.can import Database

from dsz_daemon.sim.car import Car
from dsz_daemon.sim.sensors import ACCELS, GYROS, NULL_VOLTS, VOLTS_PER_COUNT, Triad

CHANNEL = "can0"

IMU_DBC = """VERSION ""

NS_ :

BS_:

BU_: IMU

BO_ 1280 IMU_RATE: 8 IMU
 SG_ ROLL_ADC : 0|16@1+ (1,0) [0|65535] "count" Vector__XXX
 SG_ PITCH_ADC : 16|16@1+ (1,0) [0|65535] "count" Vector__XXX
 SG_ YAW_ADC : 32|16@1+ (1,0) [0|65535] "count" Vector__XXX
 SG_ RATE_COUNTER : 48|8@1+ (1,0) [0|255] "" Vector__XXX

BO_ 1281 IMU_ACCEL: 8 IMU
 SG_ LONG_ADC : 7|16@0+ (1,0) [0|65535] "count" Vector__XXX
 SG_ LAT_ADC : 23|16@0+ (1,0) [0|65535] "count" Vector__XXX
 SG_ VERT_ADC : 39|16@0+ (1,0) [0|65535] "count" Vector__XXX
 SG_ ACCEL_COUNTER : 55|8@0+ (1,0) [0|255] "" Vector__XXX

CM_ BO_ 1280 "ADW22307 gyroscopes: 7.63e-5 V per count, 2.5 V at rest, 7 mV per deg/s.";
CM_ BO_ 1281 "ADXL103 accelerometers: 7.63e-5 V per count, 2.5 V at 0 g, 1 V per g.";
"""

CAR_DBC = """VERSION ""

NS_ :

BS_:

BU_: ESC SAS EMS

BO_ 688 STEERING: 5 SAS
 SG_ STEER_ANGLE : 0|16@1- (0.1,0) [-3276.8|3276.7] "deg" Vector__XXX
 SG_ STEER_STATUS : 24|8@1+ (1,0) [0|255] "" Vector__XXX
 SG_ STEER_COUNTER : 32|4@1+ (1,0) [0|15] "" Vector__XXX

BO_ 902 WHEEL_SPEEDS: 8 ESC
 SG_ WHEEL_SPEED_FL : 0|14@1+ (0.03125,0) [0|511.96875] "km/h" Vector__XXX
 SG_ WHEEL_SPEED_FR : 16|14@1+ (0.03125,0) [0|511.96875] "km/h" Vector__XXX
 SG_ WHEEL_SPEED_RL : 32|14@1+ (0.03125,0) [0|511.96875] "km/h" Vector__XXX
 SG_ WHEEL_SPEED_RR : 48|14@1+ (0.03125,0) [0|511.96875] "km/h" Vector__XXX
 SG_ WHEEL_COUNTER : 14|2@1+ (1,0) [0|3] "" Vector__XXX

BO_ 809 PEDALS: 8 EMS
 SG_ BRAKE_ON : 7|1@0+ (1,0) [0|1] "" Vector__XXX
 SG_ GAS_ON : 6|1@0+ (1,0) [0|1] "" Vector__XXX
 SG_ WHEEL_TORQUE : 15|16@0- (1,0) [-32768|32767] "Nm" Vector__XXX
"""

RATE_SIGNALS = ("ROLL_ADC", "PITCH_ADC", "YAW_ADC")
ACCEL_SIGNALS = ("LONG_ADC", "LAT_ADC", "VERT_ADC")


def dbc_files() -> dict[str, str]:
    """Return the DBC files' text by name."""
    return {"car.dbc": CAR_DBC, "imu.dbc": IMU_DBC}


def database() -> Database:
    """Return both DBCs as one database."""
    both = Database()
    for text in dbc_files().values():
        both.add_dbc_string(text)
    return both


def configuration(car: Car) -> dict[str, Any]:
    """Return a complete configuration for the recordings of this car, as plain data.

    It holds the nominal car and sensors: neither the drawn errors nor the IMU's place nor any effect.
    """
    signals: dict[str, Any] = {"dbc": list(dbc_files())}
    signals |= _imu_signals(GYROS, "IMU_RATE", RATE_SIGNALS, "deg/s")
    signals |= _imu_signals(ACCELS, "IMU_ACCEL", ACCEL_SIGNALS, "g")
    for wheel in ("fl", "fr", "rl", "rr"):
        name = f"wheel_speed_{wheel}"
        signals[name] = {"message": "WHEEL_SPEEDS", "signal": name.upper(), "unit": "km/h"}
    signals["steering_wheel_angle"] = {"message": "STEERING", "signal": "STEER_ANGLE", "unit": "deg"}
    signals["brake"] = {"message": "PEDALS", "signal": "BRAKE_ON"}
    signals["accelerator"] = {"message": "PEDALS", "signal": "GAS_ON"}
    return {
        "vehicle": _vehicle(car),
        "signals": signals,
        "bus": {CHANNEL: {"interface": "socketcan", "channel": "vcan0"}},
    }


def _imu_signals(triad: Triad, message: str, signals: tuple[str, ...], unit: str) -> dict[str, Any]:
    return {
        channel: {
            "message": message,
            "signal": signal,
            "volts_per_count": VOLTS_PER_COUNT,
            "null_volts": NULL_VOLTS,
            "volts_per_unit": triad.volts_per_unit,
            "unit": unit,
        }
        for channel, signal in zip(triad.channels, signals, strict=True)
    }


def _vehicle(car: Car) -> dict[str, Any]:
    copied = (
        "mass_kg",
        "yaw_inertia_kgm2",
        "cg_to_front_axle_m",
        "cg_to_rear_axle_m",
        "front_track_m",
        "rear_track_m",
        "cg_height_m",
        "front_cornering_stiffness_n_per_rad",
        "rear_cornering_stiffness_n_per_rad",
        "steering_ratio",
    )
    front, rear = car.front_wheel_radius_m, car.rear_wheel_radius_m
    return {
        **{name: getattr(car, name) for name in copied},
        "driven_axle": "front",
        "wheel_radius_m": {"fl": front, "fr": front, "rl": rear, "rr": rear},
    }
