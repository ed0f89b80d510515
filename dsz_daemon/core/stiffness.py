"""Cornering stiffness adaptation, after You, Hahn & Lee 2009: recursive, only under excitation, bounded.

The paper takes C_f, C_r from that scheme without printing it. Sideslip is eliminated here, so
that the adaptation does not lean on the observer that it serves: with axle side forces from the
lateral and yaw balances, F_f = (m a_y l_r + I_z r')/L and F_r = (m a_y l_f - I_z r')/L, and
F = -2 C alpha, the slip angles' difference alpha_f - alpha_r = L r/v - delta gives

    delta - L r / v = F_f / (2 C_f) - F_r / (2 C_r) + delta_0,

linear in the compliances and in the steering's zero error delta_0. Estimated by recursive least
squares from the configured values (as compliance factors 1, 1) with their spread as prior.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core.linear import relaxed
from dsz_daemon.core.parameters import Car, Tuning


class StiffnessState(NamedTuple):
    """Factors on the front and rear compliance, steering zero error, and their covariance."""

    front: float = 1.0
    rear: float = 1.0
    steering_zero_rad: float = 0.0
    p11: float = 0.0
    p12: float = 0.0
    p13: float = 0.0
    p22: float = 0.0
    p23: float = 0.0
    p33: float = 0.0
    smoothed_yaw_radps: float = math.nan
    smoothed_ay_mps2: float = 0.0
    smoothed_delta_rad: float = 0.0


def initial_stiffness(tuning: Tuning) -> StiffnessState:
    """The configured stiffnesses with their spread."""
    variance = tuning.stiffness_spread**2
    return StiffnessState(p11=variance, p22=variance, p33=tuning.steering_offset_spread_rad**2)


def axle_side_forces(car: Car, ay: float, yaw_acceleration: float) -> tuple[float, float]:
    """Front and rear side force (N) from the lateral and the yaw balance."""
    m, Iz, L = car.mass_kg, car.yaw_inertia_kgm2, car.wheelbase_m
    front = (m * ay * car.cg_to_rear_axle_m + Iz * yaw_acceleration) / L
    rear = (m * ay * car.cg_to_front_axle_m - Iz * yaw_acceleration) / L
    return front, rear


def _excited(v: float, ay: float, tuning: Tuning) -> bool:
    return v > tuning.stiffness_min_speed_mps and tuning.stiffness_min_ay_mps2 < abs(ay) < tuning.stiffness_max_ay_mps2


def _smoothed(s: StiffnessState, yaw: float, ay: float, delta: float) -> StiffnessState:
    return StiffnessState(
        s.front, s.rear, s.steering_zero_rad, s.p11, s.p12, s.p13, s.p22, s.p23, s.p33, yaw, ay, delta
    )


def adapted(
    state: StiffnessState, car: Car, v: float, r: float, ay: float, delta: float, tuning: Tuning, dt_s: float
) -> StiffnessState:
    """One recursive least-squares step; a step without excitation only tracks the smoothing."""
    if math.isnan(r) or math.isnan(ay) or math.isnan(delta) or not tuning.adapt_stiffness:
        return state
    tau = tuning.speed_smoothing_s
    if math.isnan(state.smoothed_yaw_radps):
        return _smoothed(state, r, ay, delta)
    yaw = relaxed(state.smoothed_yaw_radps, r, tau, dt_s)
    # Force, angle and yaw rate pass the same smoothing, so that their balance still holds.
    smooth = _smoothed(
        state,
        yaw,
        relaxed(state.smoothed_ay_mps2, ay, tau, dt_s),
        relaxed(state.smoothed_delta_rad, delta, tau, dt_s),
    )
    if not _excited(v, smooth.smoothed_ay_mps2, tuning):
        return smooth
    # The yaw rate's change over the step belongs to the step's middle; so must all that it is held against.
    yaw_mid = 0.5 * (state.smoothed_yaw_radps + yaw)
    ay_mid = 0.5 * (state.smoothed_ay_mps2 + smooth.smoothed_ay_mps2)
    delta_mid = 0.5 * (state.smoothed_delta_rad + smooth.smoothed_delta_rad)
    front, rear = axle_side_forces(car, ay_mid, (yaw - state.smoothed_yaw_radps) / dt_s)
    h1 = front / (2.0 * car.front_cornering_stiffness_n_per_rad)
    h2 = -rear / (2.0 * car.rear_cornering_stiffness_n_per_rad)
    slip_difference = delta_mid - car.wheelbase_m * yaw_mid / v
    return _updated(smooth, h1, h2, slip_difference, tuning.stiffness_noise_density_rad2s / dt_s, tuning)


def _updated(s: StiffnessState, h1: float, h2: float, measured: float, noise: float, tuning: Tuning) -> StiffnessState:
    """Least-squares update of (front, rear, zero) by measured = h1 front + h2 rear + zero."""
    g1 = s.p11 * h1 + s.p12 * h2 + s.p13
    g2 = s.p12 * h1 + s.p22 * h2 + s.p23
    g3 = s.p13 * h1 + s.p23 * h2 + s.p33
    scale = 1.0 / (h1 * g1 + h2 * g2 + g3 + noise)
    error = measured - h1 * s.front - h2 * s.rear - s.steering_zero_rad
    low, high = 1.0 / (1.0 + tuning.stiffness_bound), 1.0 / (1.0 - tuning.stiffness_bound)
    return StiffnessState(
        front=min(high, max(low, s.front + scale * g1 * error)),
        rear=min(high, max(low, s.rear + scale * g2 * error)),
        steering_zero_rad=s.steering_zero_rad + scale * g3 * error,
        p11=s.p11 - scale * g1 * g1,
        p12=s.p12 - scale * g1 * g2,
        p13=s.p13 - scale * g1 * g3,
        p22=s.p22 - scale * g2 * g2,
        p23=s.p23 - scale * g2 * g3,
        p33=s.p33 - scale * g3 * g3,
        smoothed_yaw_radps=s.smoothed_yaw_radps,
        smoothed_ay_mps2=s.smoothed_ay_mps2,
        smoothed_delta_rad=s.smoothed_delta_rad,
    )


def front_stiffness(state: StiffnessState, car: Car) -> float:
    """Adapted C_f of one tyre, N/rad."""
    return car.front_cornering_stiffness_n_per_rad / state.front


def rear_stiffness(state: StiffnessState, car: Car) -> float:
    """Adapted C_r of one tyre, N/rad."""
    return car.rear_cornering_stiffness_n_per_rad / state.rear
