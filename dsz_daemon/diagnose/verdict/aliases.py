"""What one recording can't tell apart: effects that come near, a mount or a road and an offset, radii and slip."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.nameless import NAMELESS
from dsz_daemon.diagnose.effects.shape_names import is_shape
from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, INDEX
from dsz_daemon.diagnose.fitting.model import SAME_TURN, Fit
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import BLOCK_S, SLOW_MPS, Rows
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.selection.trials import Step
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.instruments import rate_of
from dsz_daemon.signals import STANDARD_GRAVITY_MPS2

# Of two explanations so close on unseen data, the recording does not choose: in log likelihood, and of what is gained.
_ALIKE, _ALIKE_SHARE = 3.0, 0.02
_NAMELESS = frozenset(effect.name for effect in NAMELESS)
# An accelerometer's offset that is no more is what data sheets have.
MUCH_MPS2 = 0.3
# How much further the front wheels turn has to be told by so many of its spreads; and from so many blocks on.
_TOLD, _LEAST_BLOCKS = 3.0, 5
# What leans a body by as much as an accelerometer shows more of the same axis; and the gyro that tells.
_SCALE = "accel_scale"
_LEANS = {"suspension_roll": (0, INDEX[f"{_SCALE}.y"]), "suspension_pitch": (1, INDEX[f"{_SCALE}.x"])}
_LEAST_SCALE = next(p.least for p in BUILT_IN.described(_SCALE).parameters)
_LEAST_RADIUS = next(p.least for p in BUILT_IN.described("wheel_radius").parameters)


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
    group += sorted(known_classes(found.drive, found.best, effect) - {effect, *group})
    group = [name for name in group if name not in _NAMELESS and not is_shape(name)]
    # What was not taken for another reason than what it gains is no likelier than what was.
    weights = {name: math.exp(min((step.gain - top) / doubt, 0.0)) for name, step in steps.items()}
    total = sum(weights.values())
    return group, [
        {"effect": name, "probability": weight / total}
        for name, weight in weights.items()
        if name != effect and name not in _NAMELESS and weight > 1e-6 * total
    ]


def known_classes(drive: Drive, fit: Fit, effect: str) -> set[str]:
    """What an effect is to the last digit of what is recorded, or nearly: of what this car has no gyro for.

    A body that leans, or dives, shows a_y and a_x times 1 + g k, as an accelerometer of another scale does.
    """
    if effect in SAME_TURN:
        return set(SAME_TURN)
    unseen = {lean for lean, (c, _) in _LEANS.items() if not np.isfinite(drive.measured[:, c]).any()}
    if effect in unseen:
        return {_SCALE}
    more = {lean for lean in unseen if fit.x[_LEANS[lean][1]] >= _LEAST_SCALE}
    return more if effect == _SCALE else set()


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
        if abs(value) < MUCH_MPS2:
            continue
        turn = sign * value / STANDARD_GRAVITY_MPS2
        words = (
            f"The offset of {value:+.2f} m/s2 of {channel} may as well be an IMU mounted with "
            f"{math.degrees(turn):+.2f} deg of {parameter.removesuffix('_rad')}, or a road that {road} "
            f"{math.degrees(value / STANDARD_GRAVITY_MPS2):+.2f} deg: on one drive these are the same"
        )
        found.append(SameAsOffset(f"offset_{channel}", value, "imu_misalignment", parameter, turn, words))
    return found


class SameAsSlip(NamedTuple):
    """Front wheels that turn faster than rear ones by a share of their speed: all the way, and where that is steady.

    `effect`: what would be the same as their slip there.
    """

    front_over_rear: float
    when_steady: float
    std: float
    effect: str
    statement: str


def same_as_slip(drive: Drive, rows: Rows) -> list[SameAsSlip]:
    """What of the slip of driven wheels radii might be as well: what is there at a steady speed, too.

    By a regression of the share on what speeds the car up and on what brakes it, each by itself; its spread is that of
    the blocks. In a bend the front wheels go v / cos(delta).
    """
    front, rear = (np.mean(drive.wheels[:, axle], axis=1) for axle in (slice(0, 2), slice(2, 4)))
    # Of wheels that are dead there is no share.
    at = rows.at[rows.used[:, 6:9].any(axis=1) & (np.minimum(front, rear)[rows.at] > SLOW_MPS)]
    pull_mps2 = rate_of(np.ascontiguousarray(0.5 * (front + rear)), DT_S)[at]
    share = front[at] * np.cos(drive.steer[at]) / rear[at] - 1.0
    blocks, block = np.unique((at * DT_S / BLOCK_S).astype(np.int64), return_inverse=True)
    if len(blocks) < _LEAST_BLOCKS:
        return []
    table = np.column_stack([np.ones(len(at)), np.maximum(pull_mps2, 0.0), np.minimum(pull_mps2, 0.0)])
    bread = np.linalg.pinv(table.T @ table)
    found: Floats = bread @ (table.T @ share)
    left = share - table @ found
    pulls = np.column_stack([np.bincount(block, left * column) for column in table.T])
    steady, std = float(found[0]), math.sqrt(float((bread @ pulls.T @ pulls @ bread)[0, 0]))
    if abs(steady) < max(_LEAST_RADIUS, _TOLD * std):
        return []
    faster, slower = ("front", "rear") if steady > 0.0 else ("rear", "front")
    mean = float(np.mean(share))
    words = (
        f"The {faster} wheels turn {math.copysign(mean, mean * steady):.2%} faster than the {slower} ones, "
        f"{abs(steady):.2%} where the speed hardly changes: slip against rolling, air and a climb that lasts would do "
        f"the latter, and so would wheel radii that are as much smaller there than configured: on one drive these are "
        f"the same"
    )
    return [SameAsSlip(mean, steady, std, "wheel_radius", words)]
