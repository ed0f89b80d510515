"""Tyres: what they push with, up to what, and how soon."""

from __future__ import annotations

import math

from dsz_daemon.diagnose.effects.row import CAR, LATERAL, LONGITUDINAL, STEERING_RATE, WHEELS, Effect, Parameter

# How sharply force bends to its limit, of how much of that drive and brakes take a share, and how far it is a brush.
_CURVE = (
    Parameter("sharpness", "1", 0.5, -0.8, 9.0, math.inf),
    Parameter("ellipse", "1", 0.2, 0.0, 1.0, math.inf),
    Parameter("brush", "1", 0.2, -0.6, 1.0, math.inf),
)

CORNERING_STIFFNESS = Effect(
    "cornering_stiffness",
    "Cornering stiffness is {front_scale:.2f} of what is configured at the front and {rear_scale:.2f} at the rear",
    "F_y = C alpha",
    CAR,
    (
        Parameter("front_scale", "1", 0.1, -0.6, 1.5, 0.02),
        Parameter("rear_scale", "1", 0.1, -0.6, 1.5, 0.02),
    ),
    source="Pacejka, Tire and Vehicle Dynamics, chapter 1",
    needs=(LATERAL,),
    like=("mass_loading", "steering_compliance"),
)

TYRE_SATURATION = Effect(
    "tyre_saturation",
    "Grip ends at a friction coefficient of some {friction_coefficient:.2f}",
    "F = C alpha f(x), x = C alpha / (mu F_z), between (1 + x^n)^(-1/n) and a brush's 1 - x/3 + x^2/27",
    CAR,
    (Parameter("inverse_square", "1", 1.0, 0.0, 60.0, 0.3), *_CURVE),
    source="between a brush (Pacejka, Tire and Vehicle Dynamics, chapter 3) and a clamp",
    needs=(LATERAL,),
)

LOW_FRICTION = Effect(
    "low_friction",
    "Grip ends at a friction coefficient of some {friction_coefficient:.2f} from {start_s:.1f} to {end_s:.1f} s",
    "F = C alpha f(x), x = C alpha / (mu F_z), as for tyre_saturation, for a while",
    CAR,
    (
        Parameter("inverse_square", "1", 1.0, 0.0, 400.0, 0.3),
        *_CURVE,
        Parameter("start_s", "s", 5.0, 0.0, 1e5, math.inf),
        Parameter("end_s", "s", 5.0, 0.0, 1e5, math.inf),
    ),
    source="between a brush (Pacejka, Tire and Vehicle Dynamics, chapter 3) and a clamp",
    needs=(LATERAL,),
)

TYRE_RELAXATION = Effect(
    "tyre_relaxation",
    "Lateral force builds up over {relaxation_length_m:.2f} m",
    "sigma F' = v (F_static - F)",
    CAR,
    (Parameter("relaxation_length_m", "m", 0.5, 0.0, 2.5, 0.06),),
    source="Pacejka, Tire and Vehicle Dynamics, chapter 7",
    needs=(STEERING_RATE,),
)

WHEEL_SLIP = Effect(
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
    source="slip as its force; Pacejka, Tire and Vehicle Dynamics",
    needs=(LONGITUDINAL,),
)
