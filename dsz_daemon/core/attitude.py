"""Suspension angles and total attitude, both needed by (4).

Suspension: the paper's open-loop spring and damper. Total: the paper takes Oh & Choi 2011,
which it does not print; here gyros (with the turning coupling phi' = p + r theta,
theta' = q - r phi, small angles) are pulled towards what (17), (18) say, within a window.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core.linear import stepped_2x2


class AttitudeState(NamedTuple):
    """Suspension angles with their rates, and total roll and pitch (rad, rad/s)."""

    suspension_roll_rad: float = 0.0
    suspension_roll_rate_radps: float = 0.0
    suspension_pitch_rad: float = 0.0
    suspension_pitch_rate_radps: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0


def suspension_angle(
    angle: float, rate: float, steady: float, frequency_radps: float, damping: float, dt_s: float
) -> tuple[float, float]:
    """Angle and rate after dt_s of angle'' = w^2 (steady - angle) - 2 d w angle'."""
    w = frequency_radps
    return stepped_2x2(0.0, 1.0, -w * w, -2.0 * damping * w, 0.0, w * w * steady, angle, rate, dt_s)


def leaned(
    state: AttitudeState,
    lateral_mps2: float,
    longitudinal_mps2: float,
    roll_gradient: float,
    pitch_gradient: float,
    frequency_radps: float,
    damping: float,
    dt_s: float,
) -> AttitudeState:
    """Suspension angles one step on: a left turn lifts the left side, braking drops the nose."""
    roll, roll_rate = suspension_angle(
        state.suspension_roll_rad,
        state.suspension_roll_rate_radps,
        roll_gradient * lateral_mps2,
        frequency_radps,
        damping,
        dt_s,
    )
    pitch, pitch_rate = suspension_angle(
        state.suspension_pitch_rad,
        state.suspension_pitch_rate_radps,
        -pitch_gradient * longitudinal_mps2,
        frequency_radps,
        damping,
        dt_s,
    )
    return AttitudeState(roll, roll_rate, pitch, pitch_rate, state.roll_rad, state.pitch_rad)


def turned(
    state: AttitudeState,
    p: float,
    q: float,
    r: float,
    roll_seen: float,
    pitch_seen: float,
    window_s: float,
    dt_s: float,
) -> AttitudeState:
    """Total attitude one step on: (phi, theta)' = (p + r theta, q - r phi) + (seen - angle)/window.

    NaN in a rate counts as zero, NaN in `seen` leaves that angle to decay to zero (it is zero
    in the long run, the paper's own assumption).
    """
    k = 1.0 / window_s
    u = (0.0 if math.isnan(p) else p) + (0.0 if math.isnan(roll_seen) else k * roll_seen)
    w = (0.0 if math.isnan(q) else q) + (0.0 if math.isnan(pitch_seen) else k * pitch_seen)
    yaw = 0.0 if math.isnan(r) else r
    roll, pitch = stepped_2x2(-k, yaw, -yaw, -k, u, w, state.roll_rad, state.pitch_rad, dt_s)
    return AttitudeState(
        state.suspension_roll_rad,
        state.suspension_roll_rate_radps,
        state.suspension_pitch_rad,
        state.suspension_pitch_rate_radps,
        roll,
        pitch,
    )
