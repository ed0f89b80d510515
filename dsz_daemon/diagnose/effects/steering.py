"""Between the hand wheel and the front wheels, and the sensor that tells of it."""

from __future__ import annotations

import math

from dsz_daemon.diagnose.effects.row import CAR, LATERAL, SPEED, STEERING_RATE, YAW_RATE, Effect, Parameter, even

STEERING_DELAY = Effect(
    "steering_delay",
    "The steering angle comes {delay_s:.3f} s late",
    "reading(t) = delta(t - d)",
    CAR,
    (Parameter("delay_s", "s", 0.02, 0.0, 0.5, 0.005),),
    source="a transport delay",
    needs=(STEERING_RATE,),
)

STEERING_OFFSET = Effect(
    "steering_offset",
    "Straight ahead is {offset_rad:+.4f} rad of road wheel away from the steering sensor's zero",
    "delta = delta_sensor / ratio + delta_0",
    CAR,
    even("offset_rad", "rad", 0.005, 0.1, 3e-4),
    source="ISO 8855",
    needs=(SPEED,),
)

STEERING_RATIO = Effect(
    "steering_ratio",
    "The steering ratio is {scale:.3f} of what is configured, and grows by {per_rad:+.3f} per rad of hand wheel",
    "delta = delta_sensor / (ratio (1 + k + k_1 |delta_sensor|))",
    CAR,
    (Parameter("scale", "1", 0.05, -0.4, 0.4, 0.006), Parameter("per_rad", "1/rad", 0.03, -0.2, 0.2, 0.004)),
    source="ISO 8855",
    needs=(YAW_RATE,),
)

STEERING_COMPLIANCE = Effect(
    "steering_compliance",
    "Front wheels give way by {rad_per_n:.2e} rad per N of lateral force",
    "delta -= k F_yf",
    CAR,
    (Parameter("rad_per_n", "rad/N", 5e-7, 0.0, 1e-5, 1e-7),),
    source="a spring; Milliken and Milliken, Race Car Vehicle Dynamics",
    needs=(LATERAL,),
    like=("mass_loading", "cornering_stiffness"),
)

STEERING_BACKLASH = Effect(
    "steering_backlash",
    "The steering has {width_rad:.4f} rad of play at the road wheels",
    "delta follows within +- width/2",
    CAR,
    # How much of it wheels that want to go straight ahead take up, and where in it a drive begins: never told.
    (
        Parameter("width_rad", "rad", 0.005, 0.0, 0.05, 6e-4),
        Parameter("centred", "1", 0.5, 0.0, 1.0, math.inf),
        Parameter("begins", "1", 0.5, -1.0, 1.0, math.inf),
    ),
    source="dry play: what drags stands while what it drags may move",
    needs=(STEERING_RATE,),
)
