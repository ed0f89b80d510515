"""What an inertial measurement unit may be: where it sits, how it is turned, and what its sensors make of motion."""

from __future__ import annotations

import math

from dsz_daemon.diagnose.effects.row import (
    DURATION,
    LATERAL,
    LONGITUDINAL,
    SENSORS,
    YAW_ACCELERATION,
    YAW_RATE,
    Effect,
    Parameter,
    even,
)

_LEAKS = "xy xz yx yz zx zy"
_NINE = " ".join(first + second for first in "xyz" for second in "xyz")

IMU_LEVER_ARM = Effect(
    "imu_lever_arm",
    "The IMU sits {x_m:+.2f} m ahead of the C.G., {y_m:+.2f} m to the left and {z_m:+.2f} m above it",
    "a_IMU = a + w' x rho + w x (w x rho)",
    SENSORS,
    (
        Parameter("x_m", "m", 0.3, -2.5, 2.5, 0.03),
        Parameter("y_m", "m", 0.3, -1.0, 1.0, 0.03),
        Parameter("z_m", "m", 0.3, -1.0, 1.5, 0.1),
    ),
    source="a rigid body; Titterton and Weston, Strapdown Inertial Navigation Technology",
    needs=(YAW_ACCELERATION,),
)

IMU_MISALIGNMENT = Effect(
    "imu_misalignment",
    "The IMU is turned by {roll_rad:+.4f} rad in roll, {pitch_rad:+.4f} in pitch and {yaw_rad:+.4f} in yaw",
    "x = fx + yaw fy - pitch fz, y = fy - yaw fx + roll fz, z = fz + pitch fx - roll fy",
    SENSORS,
    even("roll_rad pitch_rad yaw_rad", "rad", 0.02, 0.3, 0.0015),
    source="a rotation vector; Titterton and Weston, Strapdown Inertial Navigation Technology",
    needs=(LATERAL, LONGITUDINAL),
)

GYRO_SCALE = Effect(
    "gyro_scale",
    "The gyros' sensitivity is off by {x:+.2%}, {y:+.2%}, {z:+.2%} (x, y, z)",
    "reading = (1 + k) rate",
    SENSORS,
    even("x y z", "1", 0.03, 0.25, 0.003),
    source="Titterton and Weston, Strapdown Inertial Navigation Technology",
    needs=(YAW_RATE,),
)

ACCEL_SCALE = Effect(
    "accel_scale",
    "The accelerometers' sensitivity is off by {x:+.2%}, {y:+.2%}, {z:+.2%} (x, y, z)",
    "reading = (1 + k) force",
    SENSORS,
    even("x y z", "1", 0.03, 0.25, 0.003),
    source="Titterton and Weston, Strapdown Inertial Navigation Technology",
    needs=(LATERAL, LONGITUDINAL),
)

GYRO_CROSS_AXIS = Effect(
    "gyro_cross_axis",
    "One gyro axis leaks into another",
    "reading_i += k_ij rate_j",
    SENSORS,
    even(_LEAKS, "1", 0.02, 0.2, 0.002),
    source="Titterton and Weston, Strapdown Inertial Navigation Technology",
    needs=(YAW_RATE,),
)

ACCEL_CROSS_AXIS = Effect(
    "accel_cross_axis",
    "One accelerometer axis leaks into another",
    "reading_i += k_ij force_j",
    SENSORS,
    even(_LEAKS, "1", 0.02, 0.2, 0.002),
    source="Titterton and Weston, Strapdown Inertial Navigation Technology",
    needs=(LATERAL, LONGITUDINAL),
)

GYRO_G_SENSITIVITY = Effect(
    "gyro_g_sensitivity",
    "Acceleration moves the gyros",
    "reading_i += k_ij force_j",
    SENSORS,
    even(_NINE, "(rad/s)/(m/s2)", 1e-3, 0.02, 3e-5),
    source="Titterton and Weston, Strapdown Inertial Navigation Technology",
    needs=(LATERAL, LONGITUDINAL),
)

BIAS_DRIFT = Effect(
    "bias_drift",
    "Offsets move with time",
    "reading += k T (1 - exp(-f t)) / (1 - exp(-f T)), of all of T k T",
    SENSORS,
    (
        *even("gyro_x gyro_y gyro_z", "rad/s/s", 3e-5, 3e-3, 3e-6),
        *even("accel_x accel_y accel_z", "m/s2/s", 1e-3, 0.05, 1e-4),
        Parameter("fades_per_s", "1/s", 0.01, -0.02, 0.07, math.inf),
    ),
    source="a body that warms up: Newton's law of cooling",
    needs=(DURATION,),
)

IMU_DELAY = Effect(
    "imu_delay",
    "The IMU's readings come {delay_s:.3f} s late",
    "reading(t) = y(t - d)",
    SENSORS,
    # In which millisecond of its frame a reading is taken is no delay.
    (Parameter("delay_s", "s", 0.02, 0.0, 0.5, 0.004),),
    source="a transport delay",
    needs=(YAW_ACCELERATION,),
    like=("sensor_bandwidth",),
)

SENSOR_BANDWIDTH = Effect(
    "sensor_bandwidth",
    "The IMU is a first-order low-pass with a time constant of {time_constant_s:.3f} s",
    "T y' = x - y, T = 1/(2 pi f)",
    SENSORS,
    (Parameter("time_constant_s", "s", 0.03, 0.0, 0.4, 0.004),),
    source="a low-pass of first order",
    needs=(YAW_ACCELERATION,),
    like=("imu_delay",),
)

SENSOR_SATURATION = Effect(
    "sensor_saturation",
    "Readings clip",
    "|reading - s offset| <= limit, s from 0 to 1: clipped with its offset or before",
    SENSORS,
    (
        Parameter("accel_limit_mps2", "m/s2", 0.2, 0.0, 100.0, 0.1),
        Parameter("gyro_limit_radps", "rad/s", 0.01, 0.0, 10.0, 0.01),
        Parameter("before_offset", "1", 0.5, 0.0, 1.0, math.inf),
    ),
    source="Titterton and Weston, Strapdown Inertial Navigation Technology",
    needs=(LATERAL, YAW_RATE),
)
