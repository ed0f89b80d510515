"""The linear single-track car and its observer, eqs. (1)-(3) and (5)-(9).

x = [beta, r], u = delta_f, y = [r, a_y]; C_f and C_r belong to ONE tyre, hence the factors 2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core.linear import stepped_2x2


class Bicycle(NamedTuple):
    """A and B of eq. (1) at one speed."""

    a11: float
    a12: float
    a21: float
    a22: float
    b1: float
    b2: float


class ObserverGain(NamedTuple):
    """K of eq. (6): rows beta and r, columns yaw rate and lateral acceleration."""

    k1: float
    k2: float
    k3: float
    k4: float


class ObserverState(NamedTuple):
    """Estimated sideslip (rad) and yaw rate (rad/s), and the sideslip's rate at the last step."""

    sideslip_rad: float = 0.0
    yaw_rate_radps: float = 0.0
    sideslip_rate_radps: float = 0.0


def bicycle_model(m: float, Iz: float, lf: float, lr: float, Cf: float, Cr: float, v: float) -> Bicycle:
    """A and B of eq. (1); v > 0 in m/s."""
    return Bicycle(
        a11=-2.0 * (Cf + Cr) / (m * v),
        a12=-2.0 * (Cf * lf - Cr * lr) / (m * v * v) - 1.0,
        a21=-2.0 * (Cf * lf - Cr * lr) / Iz,
        a22=-2.0 * (Cf * lf * lf + Cr * lr * lr) / (Iz * v),
        b1=2.0 * Cf / (m * v),
        b2=2.0 * Cf * lf / Iz,
    )


def lateral_acceleration(model: Bicycle, v: float, beta: float, r: float, delta: float) -> float:
    """a_y of eq. (3), m/s^2: relative to the road surface, as the tyres make it."""
    return model.a11 * v * beta + (model.a12 + 1.0) * v * r + model.b1 * v * delta


def steady_yaw_rate(model: Bicycle, delta: float) -> float:
    """Yaw rate (rad/s) at which (1) comes to rest, 0 = A x + B delta; NaN for a car that has no such state."""
    det = model.a11 * model.a22 - model.a12 * model.a21
    return (model.a21 * model.b1 - model.a11 * model.b2) / det * delta if det > 0.0 else math.nan


def steer_margin(lf: float, lr: float, Cf: float, Cr: float) -> float:
    """(C_f l_f - C_r l_r) / (C_f l_f + C_r l_r): negative understeers, zero is neutral."""
    return (Cf * lf - Cr * lr) / (Cf * lf + Cr * lr)


def observer_gain(
    m: float,
    Iz: float,
    lf: float,
    lr: float,
    Cf: float,
    Cr: float,
    v: float,
    pole: float,
    neutral_margin: float,
) -> ObserverGain:
    """K of eq. (8), which puts both observer poles at `pole` (< 0, 1/s).

    Where the paper switches K2 and K4 to zero "as their denominators approach zero": K4's is
    the steer margin. We then drop K2 together with K4: with K2 = 1/v alone the observer's first
    column vanishes (a11 - K2 a11 v = 0) and sideslip becomes an open integrator of a_y's error.
    Without both, the car's own stable a11 brings sideslip home. (K2's denominator is v; below
    `observer_min_speed_mps` the caller does not use the observer at all.)
    """
    N = Cf * lf - Cr * lr
    k1 = Iz * N * pole * pole / (2.0 * Cf * Cr * (lf + lr) ** 2) - 1.0
    k3 = -2.0 * pole
    if abs(steer_margin(lf, lr, Cf, Cr)) < neutral_margin:
        return ObserverGain(k1, 0.0, k3, 0.0)
    return ObserverGain(k1, 1.0 / v, k3, m * (Cf * lf * lf + Cr * lr * lr) / (Iz * N))


class ErrorMatrix(NamedTuple):
    """A - K C of eq. (7)."""

    m11: float
    m12: float
    m21: float
    m22: float


def observer_matrix(model: Bicycle, gain: ObserverGain, v: float) -> ErrorMatrix:
    """The observer's own matrix, eq. (7): A - K C with C = [[0, 1], [a11 v, (a12 + 1) v]]."""
    return ErrorMatrix(
        model.a11 - gain.k2 * model.a11 * v,
        model.a12 - gain.k1 - gain.k2 * (model.a12 + 1.0) * v,
        model.a21 - gain.k4 * model.a11 * v,
        model.a22 - gain.k3 - gain.k4 * (model.a12 + 1.0) * v,
    )


def observer_input(
    model: Bicycle, gain: ObserverGain, v: float, r: float, ay: float, delta: float
) -> tuple[float, float]:
    """(B - K D) delta + K y of eq. (7), with D = [0, b1 v]."""
    return (
        (model.b1 - gain.k2 * model.b1 * v) * delta + gain.k1 * r + gain.k2 * ay,
        (model.b2 - gain.k4 * model.b1 * v) * delta + gain.k3 * r + gain.k4 * ay,
    )


def observed(
    state: ObserverState,
    model: Bicycle,
    gain: ObserverGain,
    v: float,
    r: float,
    ay: float,
    delta: float,
    dt_s: float,
) -> ObserverState:
    """One step of eq. (7) with the inputs held; `sideslip_rate_radps` is that of (7) now.

    The rate is taken before the step, at the state that the inputs meet.
    """
    M = observer_matrix(model, gain, v)
    u, w = observer_input(model, gain, v, r, ay, delta)
    rate = M.m11 * state.sideslip_rad + M.m12 * state.yaw_rate_radps + u
    beta, yaw = stepped_2x2(M.m11, M.m12, M.m21, M.m22, u, w, state.sideslip_rad, state.yaw_rate_radps, dt_s)
    return ObserverState(beta, yaw, rate)


def kinematic_sideslip(lf: float, lr: float, delta: float) -> float:
    """Sideslip at walking pace, where tyres roll where they point: atan(l_r tan(delta) / L)."""
    return math.atan(lr * math.tan(delta) / (lf + lr))


def lateral_velocity(v: float, beta: float) -> float:
    """v_y of eq. (9), m/s."""
    return v * math.tan(beta)


def lateral_velocity_rate(v: float, v_rate: float, beta: float, beta_rate: float) -> float:
    """Derivative of eq. (9): v' tan(beta) + v beta' / cos(beta)^2, m/s^2."""
    tan = math.tan(beta)
    return v_rate * tan + v * (1.0 + tan * tan) * beta_rate
