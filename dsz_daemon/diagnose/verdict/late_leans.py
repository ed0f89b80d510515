"""A body that leans, or dives, later than any on its springs: what follows by a second is no suspension."""

from __future__ import annotations

from collections.abc import Collection

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.simulation.motion import G

# Surely (2 spreads) slower than half of 1.5 Hz: right ones of seven simulators were at -0.48 +- 0.10 and -0.05 +- 0.02
# at least (dives at -0.38 +- 0.03), bodies that follow by a first order of 1 and 3 s at -0.63 +- 0.02 and less.
_SLOWEST, _SURELY = -0.5, 2.0
# Of each: its number, how quickly it swings, what shows it, and the road that its gyro would feel as well.
_OF = {
    "suspension_roll": ("roll_gradient_rad_per_mps2", "accel_y", "ay", "road_bank"),
    "suspension_pitch": ("pitch_gradient_rad_per_mps2", "accel_x", "ax", "road_grade"),
}


def leans_late(fit: Fit) -> dict[str, Shape]:
    """The leans of a fit that are none of a body on springs, and what is told of them."""
    found = dict[str, Shape]()
    for effect, (gradient, channel, course, _) in _OF.items():
        share, number = INDEX[f"{effect}.frequency_share"], INDEX[f"{effect}.{gradient}"]
        if effect not in fit.effects or share not in fit.columns:
            continue
        if fit.x[share] + _SURELY * fit.std[fit.columns.index(share)] < _SLOWEST:
            k, std = float(fit.x[number]), float(fit.std[fit.columns.index(number)])
            found[effect] = Shape(channel, f"k*{course}, slowly", Coefficient(G * k, G * std, "1"), 1.0)
    return found


def with_their_roads(leans: Collection[str]) -> set[str]:
    """These, and the roads that take of what such a lean shows what no body on springs does."""
    return {*leans, *(_OF[effect][3] for effect in leans)}
