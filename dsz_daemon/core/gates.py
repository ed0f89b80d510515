"""When to learn: the transient measure tau (29) and Table 3.

(29) integrates over a window that lies ahead (t to t + Dt); a live filter has only the past.
The windowed mean square about the windowed mean is kept recursively (exponential window of
Dt, after a first-order smoothing that takes sensor noise and engine shake out of "motion").
The seven signals are p, q, r, a_x, a_y, a_z and delta_f; k_i = 1/(7 scale_i^2).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core.linear import relaxed
from dsz_daemon.core.outputs import Reason
from dsz_daemon.core.parameters import Tuning

SIGNALS = 7


class TransientState(NamedTuple):
    """Per signal: smoothed value, window mean and window mean square, time seen; v_car's last."""

    smoothed: tuple[float, ...] = (math.nan,) * (SIGNALS + 1)
    mean: tuple[float, ...] = (0.0,) * (SIGNALS + 1)
    square: tuple[float, ...] = (0.0,) * (SIGNALS + 1)
    filled_s: tuple[float, ...] = (0.0,) * (SIGNALS + 1)


class _Window(NamedTuple):
    smoothed: float
    mean: float
    square: float
    filled_s: float


def _watched(state: TransientState, i: int, x: float, tuning: Tuning, dt_s: float) -> _Window:
    smoothed, mean, square = state.smoothed[i], state.mean[i], state.square[i]
    if math.isnan(x):
        return _Window(smoothed, mean, square, 0.0)
    filled_s = min(state.filled_s[i] + dt_s, 1e6)
    if math.isnan(smoothed):
        return _Window(x, x, x * x, filled_s)
    smoothed = relaxed(smoothed, x, tuning.tau_smoothing_s, dt_s)
    mean = relaxed(mean, smoothed, tuning.tau_window_s, dt_s)
    return _Window(smoothed, mean, relaxed(square, smoothed**2, tuning.tau_window_s, dt_s), filled_s)


def watched(state: TransientState, signals: tuple[float, ...], tuning: Tuning, dt_s: float) -> TransientState:
    """One step of the windows over (p, q, r, a_x, a_y, a_z, delta_f, v_car); NaN leaves its own still."""
    a = _watched(state, 0, signals[0], tuning, dt_s)
    b = _watched(state, 1, signals[1], tuning, dt_s)
    c = _watched(state, 2, signals[2], tuning, dt_s)
    d = _watched(state, 3, signals[3], tuning, dt_s)
    e = _watched(state, 4, signals[4], tuning, dt_s)
    f = _watched(state, 5, signals[5], tuning, dt_s)
    g = _watched(state, 6, signals[6], tuning, dt_s)
    h = _watched(state, 7, signals[7], tuning, dt_s)
    return TransientState(
        (a[0], b[0], c[0], d[0], e[0], f[0], g[0], h[0]),
        (a[1], b[1], c[1], d[1], e[1], f[1], g[1], h[1]),
        (a[2], b[2], c[2], d[2], e[2], f[2], g[2], h[2]),
        (a[3], b[3], c[3], d[3], e[3], f[3], g[3], h[3]),
    )


def window_variance(state: TransientState, i: int) -> float:
    """Mean square about the mean of signal i over its window, (29)'s bracket without k_i."""
    return max(0.0, state.square[i] - state.mean[i] ** 2)


def transient(state: TransientState, tuning: Tuning) -> float:
    """Tau of (29), dimensionless: 1 where all seven signals scatter by their scale; absent ones count as still."""
    rate, accel = tuning.tau_rate_scale_radps, tuning.tau_accel_scale_mps2
    scales = (rate, rate, rate, accel, accel, tuning.tau_vertical_scale_mps2, tuning.tau_steering_scale_rad)
    tau = 0.0
    for i in range(SIGNALS):
        if state.filled_s[i] > 0.0:
            tau += window_variance(state, i) / (SIGNALS * scales[i] ** 2)
    return tau


def steering_variance(state: TransientState) -> float:
    """Var(delta_f) of Table 3, rad^2."""
    return window_variance(state, 6)


def speed_variance(state: TransientState) -> float:
    """Var(v_car) of Table 3, (m/s)^2."""
    return window_variance(state, 7)


def settled(state: TransientState, tuning: Tuning) -> bool:
    """Whether the windows of all signals that are there have filled: before that their variance means nothing."""
    seen = [filled for filled in state.filled_s if filled > 0.0]
    return len(seen) > 0 and min(seen) >= 2.0 * tuning.tau_window_s


def yaw_gate(delta: float, standstill: bool, tuning: Tuning) -> Reason:
    """Z_r of (15); NONE opens it. At a standstill the yaw rate is zero whatever the wheel does."""
    if standstill:
        return Reason.NONE
    if math.isnan(delta):
        return Reason.NO_STEERING
    return Reason.NONE if abs(delta) <= tuning.k_r_rad else Reason.STEERING_LARGE


def roll_pitch_gate(r: float, standstill: bool, tuning: Tuning) -> Reason:
    """Open, as (11), (13) are, but for turning: theta' = q - r phi makes q's mean nonzero then."""
    if standstill or tuning.as_printed or math.isnan(r) or abs(r) <= tuning.turn_limit_radps:
        return Reason.NONE
    return Reason.TURNING


def longitudinal_gate(state: TransientState, v: float, valid: bool, slip: bool, tuning: Tuning) -> Reason:
    """Z_x of Table 3: tau < c1 and Var(v_car) < c2. And rolling: at rest a slope looks like offset."""
    if not valid:
        return Reason.NO_SPEED
    if v < tuning.x_min_speed_mps:
        return Reason.REVERSING if v < -tuning.standstill_speed_mps else Reason.TOO_SLOW
    if slip:
        return Reason.WHEELS_SLIP
    if not settled(state, tuning):
        return Reason.SETTLING
    if speed_variance(state) >= tuning.c2_m2ps2:
        return Reason.SPEED_VARIES
    return Reason.NONE if transient(state, tuning) < tuning.c1 else Reason.TRANSIENT


def lateral_gate(
    state: TransientState, v: float, valid: bool, delta: float, r: float, yaw_std: float, tuning: Tuning
) -> Reason:
    """Z_y of Table 3: v_car > c3, |delta_f| < c4, Var(delta_f) < c5, |r| < c6.

    And yaw first: a yaw rate offset error dr puts v dr into e_y.
    """
    if not valid:
        return Reason.NO_SPEED
    if v <= tuning.c3_mps:
        return Reason.REVERSING if v < -tuning.standstill_speed_mps else Reason.TOO_SLOW
    if math.isnan(delta) or math.isnan(r):
        return Reason.NO_STEERING
    if not settled(state, tuning) or yaw_std > tuning.yaw_first_std_radps:
        return Reason.SETTLING
    if abs(delta) >= tuning.c4_rad:
        return Reason.STEERING_LARGE
    if steering_variance(state) >= tuning.c5_rad2:
        return Reason.STEERING_MOVES
    return Reason.NONE if abs(r) < tuning.c6_radps else Reason.TURNING


def vertical_gate(state: TransientState, valid: bool, tuning: Tuning) -> Reason:
    """Z_z of Table 3: tau < c7."""
    if not valid:
        return Reason.NO_SPEED
    if not settled(state, tuning):
        return Reason.SETTLING
    return Reason.NONE if transient(state, tuning) < tuning.c7 else Reason.TRANSIENT
