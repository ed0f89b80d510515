"""The vocabulary: each row a statement, an equation, its parameters, and how much of it is plausible.

A parameter is 0 where nothing is left out. `step` is a plain size of it: sensitivities are secants over a step, so
that effects whose slope vanishes at 0 (play, grip) show, too. Below `least` no name is given: sines for angles, a
message's own few milliseconds, wheels with inertia, counted poles and a differentiated speed do as much.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.diagnose.effect_row import CAR, SENSORS, WHEELS, Effect, Parameter, even
from dsz_daemon.diagnose.nameless_effects import NAMELESS

_LEAKS = "xy xz yx yz zx zy"
_NINE = " ".join(first + second for first in "xyz" for second in "xyz")

# How quickly a body leans, how soon it is still, how far the IMU is above (and ahead of) its axis, and what the C.G. is
# above it: never told.
_BODY = (
    Parameter("frequency_share", "1", 0.1, -0.7, 1.0, math.inf),
    Parameter("damping", "1", 0.1, -0.25, 0.6, math.inf),
    Parameter("above_m", "m", 0.2, -0.5, 1.0, math.inf),
)
_SWINGS = Parameter("swings_m", "m", 0.2, 0.0, 1.2, math.inf)
# How sharply force bends to its limit, and of how much of that drive and brakes take their share.
_CURVE = (Parameter("sharpness", "1", 0.5, -0.8, 9.0, math.inf), Parameter("ellipse", "1", 0.2, 0.0, 1.0, math.inf))
# What the air slows a car by, over the square of its speed: rho c_d A / 2 over the mass.
_AIR = Parameter("air_per_m", "1/m", 2e-4, 0.0, 1e-3, math.inf)
_PITCH = (*_BODY, Parameter("ahead_m", "m", 0.2, -1.5, 1.5, math.inf), _AIR)

EFFECTS: tuple[Effect, ...] = (
    Effect(
        "imu_lever_arm",
        "The IMU sits {x_m:+.2f} m ahead of the C.G., {y_m:+.2f} m to the left and {z_m:+.2f} m above it",
        "a_IMU = a + w' x rho + w x (w x rho)",
        SENSORS,
        (
            Parameter("x_m", "m", 0.3, -2.5, 2.5, 0.03),
            Parameter("y_m", "m", 0.3, -1.0, 1.0, 0.03),
            Parameter("z_m", "m", 0.3, -1.0, 1.5, 0.1),
        ),
    ),
    Effect(
        "imu_misalignment",
        "The IMU is turned by {roll_rad:+.4f} rad in roll, {pitch_rad:+.4f} in pitch and {yaw_rad:+.4f} in yaw",
        "x = fx + yaw fy - pitch fz, y = fy - yaw fx + roll fz, z = fz + pitch fx - roll fy",
        SENSORS,
        even("roll_rad pitch_rad yaw_rad", "rad", 0.02, 0.3, 0.0015),
    ),
    Effect(
        "gyro_scale",
        "The gyros' sensitivity is off by {x:+.2%}, {y:+.2%}, {z:+.2%} (x, y, z)",
        "reading = (1 + k) rate",
        SENSORS,
        even("x y z", "1", 0.03, 0.25, 0.003),
    ),
    Effect(
        "accel_scale",
        "The accelerometers' sensitivity is off by {x:+.2%}, {y:+.2%}, {z:+.2%} (x, y, z)",
        "reading = (1 + k) force",
        SENSORS,
        even("x y z", "1", 0.03, 0.25, 0.003),
    ),
    Effect(
        "gyro_cross_axis",
        "One gyro axis leaks into another",
        "reading_i += k_ij rate_j",
        SENSORS,
        even(_LEAKS, "1", 0.02, 0.2, 0.002),
    ),
    Effect(
        "accel_cross_axis",
        "One accelerometer axis leaks into another",
        "reading_i += k_ij force_j",
        SENSORS,
        even(_LEAKS, "1", 0.02, 0.2, 0.002),
    ),
    Effect(
        "gyro_g_sensitivity",
        "Acceleration moves the gyros",
        "reading_i += k_ij force_j",
        SENSORS,
        even(_NINE, "(rad/s)/(m/s2)", 1e-3, 0.02, 3e-5),
    ),
    Effect(
        "bias_drift",
        "Offsets move with time",
        "reading += k T (1 - exp(-f t)) / (1 - exp(-f T)), of all of T k T",
        SENSORS,
        (
            *even("gyro_x gyro_y gyro_z", "rad/s/s", 3e-5, 3e-3, 3e-6),
            *even("accel_x accel_y accel_z", "m/s2/s", 1e-3, 0.05, 1e-4),
            Parameter("fades_per_s", "1/s", 0.01, -0.02, 0.07, math.inf),
        ),
    ),
    Effect(
        "imu_delay",
        "The IMU's readings come {delay_s:.3f} s late",
        "reading(t) = y(t - d)",
        SENSORS,
        (Parameter("delay_s", "s", 0.02, 0.0, 0.5, 0.003),),
    ),
    Effect(
        "steering_delay",
        "The steering angle comes {delay_s:.3f} s late",
        "reading(t) = delta(t - d)",
        CAR,
        (Parameter("delay_s", "s", 0.02, 0.0, 0.5, 0.005),),
    ),
    Effect(
        "wheel_speed_delay",
        "The wheel speeds come {delay_s:.3f} s late",
        "reading(t) = v(t - d)",
        CAR,
        (Parameter("delay_s", "s", 0.02, -0.02, 0.5, 0.008),),
    ),
    Effect(
        "sensor_bandwidth",
        "The IMU is a first-order low-pass with a time constant of {time_constant_s:.3f} s",
        "T y' = x - y, T = 1/(2 pi f)",
        SENSORS,
        (Parameter("time_constant_s", "s", 0.03, 0.0, 0.4, 0.004),),
    ),
    Effect(
        "suspension_roll",
        "The body leans by {roll_gradient_rad_per_mps2:.4f} rad per m/s2 of lateral acceleration",
        "reading_y = a_y + g phi, phi = k a_y when steady",
        CAR,
        (Parameter("roll_gradient_rad_per_mps2", "rad/(m/s2)", 0.005, 0.0, 0.04, 5e-4), *_BODY, _SWINGS),
    ),
    Effect(
        "suspension_pitch",
        "The body dives by {pitch_gradient_rad_per_mps2:.4f} rad per m/s2 of braking",
        "reading_x = a_x - g theta, theta = -k a_x when steady",
        CAR,
        (Parameter("pitch_gradient_rad_per_mps2", "rad/(m/s2)", 0.005, 0.0, 0.04, 5e-4), *_PITCH),
    ),
    Effect(
        "tyre_saturation",
        "Grip ends at a friction coefficient of some {friction_coefficient:.2f}",
        "F = C alpha / (1 + x^n)^(1/n), x = C alpha / (mu F_z)",
        CAR,
        (Parameter("inverse_square", "1", 1.0, 0.0, 60.0, 0.3), *_CURVE),
    ),
    Effect(
        "tyre_relaxation",
        "Lateral force builds up over {relaxation_length_m:.2f} m",
        "sigma F' = v (F_static - F)",
        CAR,
        (Parameter("relaxation_length_m", "m", 0.5, 0.0, 4.0, 0.06),),
    ),
    Effect(
        "wheel_slip",
        "Driven and braked wheels slip by {slip_per_force:.3f} per (longitudinal over vertical force)",
        "r omega = v (1 + k F_x / F_z)",
        WHEELS,
        (
            Parameter("slip_per_force", "1", 0.03, 0.0, 0.5, 0.004),
            Parameter("front_brakes_more", "1", 0.2, -0.8, 0.8, math.inf),
            Parameter("resistance", "1", 0.5, 0.0, 2.0, math.inf),
            Parameter("spun_share", "1", 0.01, 0.0, 0.035, math.inf),
            Parameter("front_drives_more", "1", 0.2, -0.8, 0.8, math.inf),
            Parameter("engine_brakes_mps2", "m/s^2", 0.5, 0.0, 3.0, math.inf),
            # How high the C.G. counts for the load that goes to the rear axle, and to a bend's outer wheels.
            Parameter("ahead_load_m", "m", 0.2, 0.0, 1.2, math.inf),
            Parameter("side_load_m", "m", 0.2, 0.0, 1.2, math.inf),
        ),
    ),
    Effect(
        "wheel_radius",
        "Wheel radii are {fl:.4f}, {fr:.4f}, {rl:.4f}, {rr:.4f} of what is configured (front left to rear right)",
        "v = (1 + k) r omega",
        WHEELS,
        even("fl fr rl rr", "1", 0.01, 0.15, 8e-4),
    ),
    Effect(
        "steering_offset",
        "Straight ahead is {offset_rad:+.4f} rad of road wheel away from the steering sensor's zero",
        "delta = delta_sensor / ratio + delta_0",
        CAR,
        even("offset_rad", "rad", 0.005, 0.1, 3e-4),
    ),
    Effect(
        "steering_ratio",
        "The steering ratio is {scale:.3f} of what is configured, and grows by {per_rad:+.3f} per rad of hand wheel",
        "delta = delta_sensor / (ratio (1 + k + k_1 |delta_sensor|))",
        CAR,
        (Parameter("scale", "1", 0.05, -0.4, 0.4, 0.006), Parameter("per_rad", "1/rad", 0.03, -0.2, 0.2, 0.004)),
    ),
    Effect(
        "steering_compliance",
        "Front wheels give way by {rad_per_n:.2e} rad per N of lateral force",
        "delta -= k F_yf",
        CAR,
        (Parameter("rad_per_n", "rad/N", 5e-7, 0.0, 1e-5, 1e-7),),
    ),
    Effect(
        "steering_backlash",
        "The steering has {width_rad:.4f} rad of play at the road wheels",
        "delta follows within +- width/2",
        CAR,
        (Parameter("width_rad", "rad", 0.005, 0.0, 0.05, 6e-4),),
    ),
    Effect(
        "mass_loading",
        "{added_mass_kg:+.0f} kg are on board that nobody configured, the C.G. is {cg_shift_m:+.2f} m further ahead",
        "m, l_f, l_r, I_z of (1)",
        CAR,
        (
            Parameter("added_mass_kg", "kg", 100.0, -400.0, 1500.0, 25.0),
            Parameter("cg_shift_m", "m", 0.1, -0.8, 0.8, 0.03),
            # The share of what the load has to turn with it that it adds to the yaw inertia.
            Parameter("turns", "1", 0.2, 0.0, 1.3, math.inf),
        ),
    ),
    Effect(
        "cornering_stiffness",
        "Cornering stiffness is {front_scale:.2f} of what is configured at the front and {rear_scale:.2f} at the rear",
        "F_y = C alpha",
        CAR,
        (
            Parameter("front_scale", "1", 0.1, -0.6, 1.5, 0.02),
            Parameter("rear_scale", "1", 0.1, -0.6, 1.5, 0.02),
        ),
    ),
    Effect(
        "track_width",
        "Tracks are {front:.3f} (front) and {rear:.3f} (rear) of what is configured",
        "v = v_x -+ r track / 2",
        WHEELS,
        even("front rear", "1", 0.05, 0.5, 0.01),
    ),
    Effect(
        "sensor_saturation",
        "Readings clip",
        "|reading| <= limit",
        SENSORS,
        (
            Parameter("accel_limit_mps2", "m/s2", 0.2, 0.0, 100.0, 0.1),
            Parameter("gyro_limit_radps", "rad/s", 0.01, 0.0, 10.0, 0.01),
        ),
    ),
    Effect(
        "low_friction",
        "Grip ends at a friction coefficient of some {friction_coefficient:.2f} from {start_s:.1f} to {end_s:.1f} s",
        "F = C alpha / (1 + x^n)^(1/n), x = C alpha / (mu F_z), for a while",
        CAR,
        (
            Parameter("inverse_square", "1", 1.0, 0.0, 400.0, 0.3),
            *_CURVE,
            Parameter("start_s", "s", 5.0, 0.0, 1e5, math.inf),
            Parameter("end_s", "s", 5.0, 0.0, 1e5, math.inf),
        ),
    ),
    Effect(
        "side_wind",
        "The air pushes sideways with {rms_n:.0f} N (rms)",
        "m (v_y' + r v) = F_y + F_air, I_z r' = M_z + x F_air",
        CAR,
        (Parameter("ahead_m", "m", 0.2, -1.5, 1.5, math.inf), Parameter("leans", "1", 0.2, 0.0, 2.0, math.inf)),
    ),
)

# What has no slope at 0: really fitted from a guess, never screened by a secant.
GUESSED = ("sensor_saturation", "low_friction")

# The road's profiles: what the roll and pitch gyros have left over, integrated, and corrections between KNOTS.
KNOTS = 12
_KNOTS = tuple(Parameter(f"knot_{i}", "rad", 0.02, -0.35, 0.35, 0.0) for i in range(KNOTS))
ROAD = tuple(
    Effect(name, words, equation, CAR, _KNOTS)
    for name, words, equation in (
        (
            "road_bank",
            "The road banks by {rms_rad:.4f} rad (rms)",
            "reading_y = a_y + g phi, p = phi', F = m (a_y - g phi)",
        ),
        (
            "road_grade",
            "The road climbs and falls by {rms_rad:.4f} rad (rms)",
            "reading_x = a_x + g gamma, q = -gamma'",
        ),
    )
)

# Refitted before any effect is thought of: constant offsets, and configured parameters within their tolerance (shares).
OFFSETS = (
    *even("offset_gyro_x offset_gyro_y offset_gyro_z", "rad/s", 0.01, 0.5),
    *even("offset_accel_x offset_accel_y offset_accel_z", "m/s2", 0.1, 5.0),
)
TOLERATED = (
    *even("front_cornering_stiffness_n_per_rad rear_cornering_stiffness_n_per_rad", "1", 0.05, 1.0),
    *even("mass_kg yaw_inertia_kgm2 cg_to_front_axle_m cg_to_rear_axle_m steering_ratio", "1", 0.02, 1.0),
    *even("front_track_m rear_track_m", "1", 0.02, 1.0),
)
# Drawn with or without: a pull along steered wheels, small turns, wheels alike, load on tyres, sines, held inputs, and
# wheels that roll as if they were turned by next to nothing, or by nothing; or each about where the car turns.
FORM = (
    *(Parameter(name, "1", 0.5, 0.0, 1.2, math.inf) for name in ("steered_pull", "steered_brake", "small_turns")),
    *(Parameter(name, "1", 0.5, 0.0, 1.2, math.inf) for name in ("flat_roads", "flat_bends")),
    Parameter("parallel_steer", "1", 0.5, -0.2, 2.0, math.inf),
    Parameter("load_height_m", "m", 0.1, 0.0, 0.8, math.inf),
    *(*even("large_angles", "1/rad2", 0.2, 0.4, math.inf), *even("steering_skew_s", "s", 0.002, 0.003, math.inf)),
    *even("hasty_s", "s", 0.002, 0.005, math.inf),
    *even("drive_steer brake_steer", "rad/(m/s2)", 1e-4, 2e-2, math.inf),
    Parameter("steers_by_force", "1", 0.5, 0.0, 1.2, math.inf),
    Parameter("small_wheels", "1", 0.5, -0.2, 1.2, math.inf),
    Parameter("unturned_wheels", "1", 0.5, -0.2, 1.2, math.inf),
    Parameter("wheels_apart", "1", 0.5, -0.5, 1.5, math.inf),
)


_BUILT_IN_ROWS = len(EFFECTS) + len(ROAD) + len(NAMELESS)


class Vocabulary(NamedTuple):
    """What may have been left out: the rows above, and those of one's own behind them.

    `columns`: all parameters in a row, (effect, parameter), effect "" for what is refitted first.
    """

    effects: tuple[Effect, ...]
    columns: tuple[tuple[str, Parameter], ...]

    def columns_of(self, effect: str) -> tuple[int, ...]:
        """Where the parameters of one effect stand."""
        return tuple(i for i, (name, _) in enumerate(self.columns) if name == effect)

    def described(self, effect: str) -> Effect:
        """The row of this name."""
        return next(row for row in self.effects if row.name == effect)

    def own(self) -> tuple[Effect, ...]:
        """The rows behind the built-in ones."""
        return self.effects[_BUILT_IN_ROWS:]


def _does_something(effect: Effect) -> bool:
    """Whether a row says itself what it does, as those behind the built-in ones do."""
    return any(there is not None for there in (effect.shows, effect.steers, effect.pushes))


def vocabulary(own: tuple[Effect, ...] = ()) -> Vocabulary:
    """The built-in rows and one's own; ValueError: a name that is there already, or nothing that it shows."""
    for effect in own:
        if not _does_something(effect):
            raise ValueError(f"effect {effect.name!r} shows nothing; expected a function of the motion in `shows`")
    effects = (*EFFECTS, *ROAD, *NAMELESS, *own)
    names = [effect.name for effect in effects]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"effects {', '.join(twice)} are there twice; expected names of their own")
    first = tuple(("", parameter) for parameter in (*OFFSETS, *TOLERATED, *FORM))
    return Vocabulary(effects, (*first, *((e.name, parameter) for e in effects for parameter in e.parameters)))


BUILT_IN = vocabulary()
COLUMNS = BUILT_IN.columns
INDEX = {(f"{effect}." if effect else "") + parameter.name: i for i, (effect, parameter) in enumerate(COLUMNS)}
NUISANCES = tuple(range(len(OFFSETS) + len(TOLERATED) + len(FORM)))
