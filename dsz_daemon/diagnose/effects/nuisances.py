"""What is no effect: offsets, what is configured within its tolerance, and how a car is drawn."""

from __future__ import annotations

import math

from dsz_daemon.diagnose.effects.row import Parameter, even

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
    *(Parameter(name, "1", 0.5, 0.0, 1.2, math.inf) for name in ("flat_roads", "flat_bends", "flat_leans")),
    Parameter("parallel_steer", "1", 0.5, -0.2, 2.0, math.inf),
    Parameter("load_height_m", "m", 0.1, 0.0, 1.2, math.inf),
    *(*even("large_angles", "1/rad2", 0.2, 0.4, math.inf), *even("steering_skew_s", "s", 0.002, 0.003, math.inf)),
    *even("hasty_s", "s", 0.002, 0.005, math.inf),
    *even("drive_steer brake_steer", "rad/(m/s2)", 1e-4, 2e-2, math.inf),
    Parameter("steers_by_force", "1", 0.5, 0.0, 1.2, math.inf),
    Parameter("small_wheels", "1", 0.5, -0.2, 1.2, math.inf),
    Parameter("unturned_wheels", "1", 0.5, -0.2, 1.2, math.inf),
    Parameter("wheels_apart", "1", 0.5, -0.5, 1.5, math.inf),
)
