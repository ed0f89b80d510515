"""Play and friction between the hand wheel and the road wheels: what of the steering is lost in them.

What is compared has passed a low-pass, and so has the steering, which a car that follows it linearly does not mind.
Play does: a hand that trembles within it moves nothing, and none of its trembling is left behind the low-pass. So the
angle goes through the play as it was recorded, and through the low-pass then. Friction takes the angle behind the
low-pass: a sensor's noise goes to and fro as far in a second as friction needs to turn round, and would wear it out.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.diagnose.recordings.recording import filtered

Floats = np.ndarray[Any, np.dtype[np.float64]]


@compiled
def played(angle_rad: Floats, width_rad: float, begins: float = 0.0) -> Floats:
    """Where what is dragged along with so much play stands (n,), at first by a share of half of it off its middle."""
    held, half = np.empty(len(angle_rad)), 0.5 * width_rad
    at = angle_rad[0] + begins * half
    for i in range(len(angle_rad)):
        at = min(max(at, angle_rad[i] - half), angle_rad[i] + half)
        held[i] = at
    return held


def geared(angle_rad: Floats, steering_ratio: float, scale: float, per_rad: float) -> Floats:
    """An angle (n,) at the road wheels by the configured ratio, by another one that may grow with the hand wheel's."""
    if scale == 0.0 and per_rad == 0.0:
        return angle_rad
    return angle_rad / (1.0 + scale + per_rad * steering_ratio * np.abs(angle_rad))


@compiled
def held_back(angle_rad: Floats, width_rad: float, softness: float) -> Floats:
    """By how much what is dragged against dry friction (n,) stands behind; it has stood in the middle at first.

    Dahl's friction (Aerospace Corp. TOR-0158(3107-18)-1, 1968, with exponent 1) against a spring: after each turn what
    is still to be lost goes down by e on a way of (1 + `softness`) width / 2. Play loses it evenly, on the width.
    """
    lost, half = np.zeros(len(angle_rad)), 0.5 * width_rad
    for i in range(1, len(angle_rad)):
        way = angle_rad[i] - angle_rad[i - 1]
        keeps = math.exp(-abs(way) / ((1.0 + softness) * half))
        lost[i] = keeps * lost[i - 1] + (1.0 - keeps) * math.copysign(half, way)
    return lost


def lost_in_play(
    dragging_rad: Floats, width_rad: float, kernel: Floats | None, centred: float = 0.0, begins: float = 0.0
) -> Floats:
    """By how much the road wheels (n,) stand behind what drags them, behind its low-pass if it has one.

    `begins`: where they stand in the play at first, -1 to 1, until the hand has gone all of its width.
    `centred`: of wheels that nothing pulls (0) the play is taken up as the hand turns round; wheels that pull
    themselves straight ahead as far as it lets them (1) stand nearer to the middle on either side, the sensor's zero.
    """
    lost: Floats = dragging_rad - played(dragging_rad, width_rad, begins)
    if centred != 0.0:
        lost = (1.0 - centred) * lost + centred * np.clip(dragging_rad, -0.5 * width_rad, 0.5 * width_rad)
    return lost if kernel is None else filtered(lost, kernel)
