"""What stands on the wheels: a body on its springs, and what is on board."""

from __future__ import annotations

import math

from dsz_daemon.diagnose.effects.row import CAR, LATERAL, LONGITUDINAL, Effect, Parameter

# How quickly a body leans, how soon it is still, how far the IMU is above (and ahead of) its axis, and what the C.G. is
# above it: never told.
_BODY = (
    Parameter("frequency_share", "1", 0.1, -0.7, 1.0, math.inf),
    Parameter("damping", "1", 0.1, -0.25, 0.6, math.inf),
    Parameter("above_m", "m", 0.2, -0.5, 1.0, math.inf),
)
_SWINGS = Parameter("swings_m", "m", 0.2, 0.0, 1.2, math.inf)
# What the air slows a car by, over the square of its speed: rho c_d A / 2 over the mass.
_AIR = Parameter("air_per_m", "1/m", 2e-4, 0.0, 1e-3, math.inf)
_PITCH = (*_BODY, Parameter("ahead_m", "m", 0.2, -1.5, 1.5, math.inf), _AIR)

SUSPENSION_ROLL = Effect(
    "suspension_roll",
    "The body leans by {roll_gradient_rad_per_mps2:.4f} rad per m/s2 of lateral acceleration",
    "reading_y = a_y + g phi, phi = k a_y when steady",
    CAR,
    (Parameter("roll_gradient_rad_per_mps2", "rad/(m/s2)", 0.005, 0.0, 0.04, 5e-4), *_BODY, _SWINGS),
    source="a body on springs; Milliken and Milliken, Race Car Vehicle Dynamics",
    needs=(LATERAL,),
)

SUSPENSION_PITCH = Effect(
    "suspension_pitch",
    "The body dives by {pitch_gradient_rad_per_mps2:.4f} rad per m/s2 of braking",
    "reading_x = a_x - g theta, theta = -k a_x when steady",
    CAR,
    (Parameter("pitch_gradient_rad_per_mps2", "rad/(m/s2)", 0.005, 0.0, 0.04, 5e-4), *_PITCH),
    source="a body on springs; Milliken and Milliken, Race Car Vehicle Dynamics",
    needs=(LONGITUDINAL,),
)

MASS_LOADING = Effect(
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
    source="two bodies as one; Pacejka, Tire and Vehicle Dynamics, chapter 1",
    needs=(LATERAL,),
    like=("cornering_stiffness", "steering_compliance"),
)
