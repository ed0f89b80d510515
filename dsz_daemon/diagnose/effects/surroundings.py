"""The road and the air: profiles over time, which no number tells."""

from __future__ import annotations

import math

from dsz_daemon.diagnose.effects.row import CAR, SPEED, Effect, Parameter

SIDE_WIND = Effect(
    "side_wind",
    "The air pushes sideways with {rms_n:.0f} N (rms)",
    "m (v_y' + r v) = F_y + F_air, I_z r' = M_z + x F_air",
    CAR,
    (Parameter("ahead_m", "m", 0.2, -1.5, 1.5, math.inf), Parameter("leans", "1", 0.2, 0.0, 2.0, math.inf)),
    source="Newton",
    needs=(SPEED,),
)

# The road's profiles: what the roll and pitch gyros have left over, integrated, and corrections between KNOTS.
KNOTS = 12
_KNOTS = tuple(Parameter(f"knot_{i}", "rad", 0.02, -0.35, 0.35, 0.0) for i in range(KNOTS))
ROAD = tuple(
    Effect(name, words, equation, CAR, _KNOTS, source="Euler angles", needs=(SPEED,))
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
