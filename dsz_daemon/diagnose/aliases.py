"""What one recording can't tell apart: effects that come near, and mounts and roads that are the same as an offset."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from dsz_daemon.diagnose.effects import NAMELESS
from dsz_daemon.diagnose.search import Search, Step
from dsz_daemon.signals import STANDARD_GRAVITY_MPS2

# Of two explanations so close on unseen data, the recording does not choose: in log likelihood, and of what is gained.
_ALIKE, _ALIKE_SHARE = 3.0, 0.02
# No recording of yaw rate and lateral acceleration can split these: they turn the car alike.
SAME_TURN = frozenset({"mass_loading", "cornering_stiffness", "steering_compliance"})
_NAMELESS = frozenset(effect.name for effect in NAMELESS)
# An accelerometer's offset that is no more is what data sheets have.
_MUCH_MPS2 = 0.3


def alternatives(found: Search, effect: str, doubt: float = 1.0) -> tuple[list[str], list[dict[str, float | str]]]:
    """What an effect can't be told from, and all that could stand in its place, with their probabilities.

    `doubt`: how many times more is left than noise and form may leave; so much less a gain says.
    """
    steps: dict[str, Step] = {}
    for step in found.rivals[effect]:
        if step.effect not in steps and (step.effect == effect or step.effect not in found.best.effects):
            steps[step.effect] = step
    top = steps[effect].gain
    near = max(_ALIKE * doubt, _ALIKE_SHARE * top)
    group = [name for name, step in steps.items() if name != effect and step.gain > top - near]
    if effect in SAME_TURN:
        group += sorted(SAME_TURN - {effect, *group})
    group = [name for name in group if name not in _NAMELESS]
    # What was not taken for another reason than what it gains is no likelier than what was.
    weights = {name: math.exp(min((step.gain - top) / doubt, 0.0)) for name, step in steps.items()}
    total = sum(weights.values())
    return group, [
        {"effect": name, "probability": weight / total}
        for name, weight in weights.items()
        if name != effect and name not in _NAMELESS and weight > 1e-6 * total
    ]


class SameAsOffset(NamedTuple):
    """An offset that another cause would show as well: `value_rad` of this parameter of this effect."""

    offset: str
    value_mps2: float
    effect: str
    parameter: str
    value_rad: float
    statement: str


def same_as_offsets(offsets_mps2: Mapping[str, float]) -> list[SameAsOffset]:
    """What large offsets of `accel_x` and `accel_y` may be instead: a mount that is turned, a road that tilts evenly.

    reading_x = fx - pitch fz, reading_y = fy + roll fz with fz = g: constants, which no flat drive tells from offsets.
    """
    found = []
    for channel, parameter, sign, road in (
        ("accel_x", "pitch_rad", -1.0, "climbs all the way by"),
        ("accel_y", "roll_rad", 1.0, "banks all the way by"),
    ):
        value = offsets_mps2.get(f"offset_{channel}", 0.0)
        if abs(value) < _MUCH_MPS2:
            continue
        turn = sign * value / STANDARD_GRAVITY_MPS2
        words = (
            f"The offset of {value:+.2f} m/s2 of {channel} may as well be an IMU mounted with "
            f"{math.degrees(turn):+.2f} deg of {parameter.removesuffix('_rad')}, or a road that {road} "
            f"{math.degrees(value / STANDARD_GRAVITY_MPS2):+.2f} deg: on one drive these are the same"
        )
        found.append(SameAsOffset(f"offset_{channel}", value, "imu_misalignment", parameter, turn, words))
    return found
