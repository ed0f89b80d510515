"""What may be there, and has no name in the vocabulary: fitted as the named effects are, told as a shape."""

from __future__ import annotations

import math

from dsz_daemon.diagnose.effects.row import CAR, SENSORS, WHEELS, Effect, Parameter, even

OUTER_LOAD = "outer_load"

NAMELESS = (
    Effect(
        "wheel_square",
        "Wheel speeds are off by {fl:.1e}, {fr:.1e}, {rl:.1e}, {rr:.1e} of their squares (front left to rear right)",
        "reading = omega r + k v^2",
        WHEELS,
        even("fl fr rl rr", "s/m", 3e-4, 0.02, 2e-5),
    ),
    Effect(
        "wheel_growth",
        "All tyres' radii grow by {per_v2:.1e} of the square of the speed",
        "reading = v / (1 + k v^2)",
        CAR,
        even("per_v2", "s2/m2", 3e-6, 2e-4, 1e-6),
    ),
    Effect(
        "imu_clock",
        "The IMU's clock is off: its readings come later by {per_s:.1e} of the time",
        "reading(t) = y(t - d - k t)",
        SENSORS,
        (Parameter("per_s", "s/s", 1e-4, -5e-3, 5e-3, 2e-5), Parameter("late_s", "s", 0.02, -0.5, 0.5, math.inf)),
    ),
    Effect(
        "yaw_inertia",
        "The yaw inertia is off by {share:.2f} of what is configured",
        "(1 + k) I_z r' = M_z",
        CAR,
        (Parameter("share", "1", 0.1, -0.7, 2.0, 0.03),),
    ),
    Effect(
        "locked_axle",
        "The driven axle's wheels turn alike, by {share:.2f} of what they differ by in a bend",
        "v = v_x -+ (1 - k) r track / 2",
        WHEELS,
        (Parameter("share", "1", 0.1, 0.0, 1.2, 0.05),),
    ),
    # How a car is drawn, and no physics left out: it is never told. It has a rival's place and no nuisance's, for few
    # simulations have it, and beside what they leave out it would be anything.
    Effect(
        OUTER_LOAD,
        "Outer tyres do more with the load that a bend moves to them, by a C.G. {height_m:.2f} m high",
        "an axle acts h a_y / g outwards of its middle",
        CAR,
        (Parameter("height_m", "m", 0.1, 0.0, 1.2, 0.1),),
    ),
    Effect(
        "steering_lag",
        "The front wheels follow the hand wheel by {time_constant_s:.3f} s",
        "T delta' = hand / ratio - delta",
        CAR,
        (Parameter("time_constant_s", "s", 0.02, 0.0, 0.5, 0.005),),
        # Beside wheel speeds that are late.
        like=("sensor_bandwidth", "imu_delay"),
    ),
    Effect(
        "steering_friction",
        "The front wheels stay {width_rad:.4f} rad apart by the way that they are turned, softly",
        "delta = hand / ratio - z width/2, z' = (sign(delta') - z) |delta'| / s, s = (1 + k) width/2",
        CAR,
        (
            Parameter("width_rad", "rad", 0.005, 0.0, 0.05, 6e-4),
            Parameter("softness", "1", 0.5, -0.9, 3.0, math.inf),
        ),
    ),
    Effect(
        "steering_slip",
        "The steering sensor's zero jumps by {jump_rad:.4f} rad of road wheel at {at_s:.1f} s",
        "delta = (hand - z(t)) / ratio, z another from a moment on",
        CAR,
        (Parameter("jump_rad", "rad", 0.002, -0.1, 0.1, 5e-4), Parameter("at_s", "s", 0.1, 0.0, 1e5, math.inf)),
    ),
    Effect(
        "nose_lift",
        "The nose lifts by {rad_per_v2:.1e} rad of the square of the speed",
        "theta = -k v^2",
        SENSORS,
        (Parameter("rad_per_v2", "rad s2/m2", 3e-6, -2e-4, 2e-4, 1e-6),),
    ),
    Effect(
        "wheels_more",
        "All wheels that roll show {offset_mps:+.2f} m/s more than they do",
        "reading = omega r + k",
        CAR,
        even("offset_mps", "m/s", 0.02, 3.0, 0.05),
    ),
    Effect(
        "soft_mount",
        "The IMU swings on its mount, by 1/omega^2 = {per_w2_s2:.4f} s2 and {damping:.2f} of critical damping",
        "y''/omega^2 = 2 zeta (c x' - y')/omega + x - y; reading = x + k (y - x)",
        SENSORS,
        (
            Parameter("per_w2_s2", "s2", 5e-4, 1.2e-3, 0.05, math.inf),
            Parameter("damping", "1", 0.05, 0.005, 0.4, math.inf),
            # Of dampers that stand still, or of a sensor itself that swings, none.
            Parameter("carried", "1", 0.5, 0.0, 1.0, math.inf),
            # How much of that gyros and each accelerometer show: a bracket may be soft to one side.
            *(Parameter(name, "1", 0.1, 0.0, 1.5, 0.1) for name in ("gyros", "accel_x", "accel_y", "accel_z")),
        ),
        source="Den Hartog, Mechanical Vibrations, 4th ed., section 2.12: transmissibility",
    ),
)
