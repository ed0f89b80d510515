"""Reference accelerations (20)-(22) from the rigid body's kinematics (16)-(19), and (4).

(17)-(19) with v_z = 0 and no attitude: the paper's assumption that what is left averages out.
"""

from __future__ import annotations

import math

from dsz_daemon.signals import STANDARD_GRAVITY_MPS2 as G


def longitudinal_reference(v_rate: float, r: float, vy: float) -> float:
    """a_x,ref of (20) = v' - r v_y. (Printed with v_y' by slip; (17) has v_y.)"""
    return v_rate - r * vy


def lateral_reference(vy_rate: float, r: float, v: float) -> float:
    """a_y,ref of (21) = v_y' + r v."""
    return vy_rate + r * v


def vertical_reference(q: float, v: float, p: float, vy: float) -> float:
    """a_z,ref of (22) = -q v + p v_y + g."""
    return -q * v + p * vy + G


def road_lateral_acceleration(
    ay: float, roll: float, pitch: float, suspension_roll: float, suspension_pitch: float
) -> float:
    """a_y of (4): the lean's gravity taken out of the reading, the road's left in.

    `roll`, `pitch` are total, so the road's are total minus suspension.
    """
    road_roll = roll - suspension_roll
    road_pitch = pitch - suspension_pitch
    return ay - G * math.sin(roll) * math.cos(pitch) + G * math.sin(road_roll) * math.cos(road_pitch)


def roll_from_acceleration(ay: float, lateral_reference_mps2: float) -> float:
    """Roll angle that (18) needs to explain the reading (cos(theta) = 1, v_z = 0)."""
    return math.asin(max(-0.5, min(0.5, (ay - lateral_reference_mps2) / G)))


def pitch_from_acceleration(ax: float, longitudinal_reference_mps2: float) -> float:
    """Pitch angle (nose down positive) that (17) needs to explain the reading."""
    return math.asin(max(-0.5, min(0.5, (longitudinal_reference_mps2 - ax) / G)))
