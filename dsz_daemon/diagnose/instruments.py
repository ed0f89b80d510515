"""What is at the place of the instruments: motion and gravity felt by the IMU, and what each wheel rolls."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.signals import STANDARD_GRAVITY_MPS2

Floats = np.ndarray[Any, np.dtype[np.float64]]

G = STANDARD_GRAVITY_MPS2


@compiled
def slope_at(values: Floats, i: int, dt_s: float) -> float:
    """The values' rate of change at i: central, at the ends one-sided."""
    n = len(values)
    before, after = max(i - 1, 0), min(i + 1, n - 1)
    return float((values[after] - values[before]) / (dt_s * (after - before)))


@compiled
def felt(
    moved: Floats,
    v_mps: Floats,
    v_rate: Floats,
    bank_rad: Floats,
    grade_rad: Floats,
    lever_m: Floats,
    body_m: Floats,
    rates_of_rates: Floats,
    rates_of_forces: Floats,
    forces_of_forces: Floats,
    dt_s: float,
) -> Floats:
    """The IMU's readings (n, 6) at `lever_m` (3,) from the C.G., which is `body_m` (3,) from what the body leans about.

    The last: above the roll axis, above and ahead of the pitch axis.

    Of motion (n, 12), speed, its rate, bank and grade (n,). The matrices (3, 3) are the sensors': rates shown of
    rates and of forces, forces shown of forces.
    """
    n = len(v_mps)
    p, q = np.empty(n), np.empty(n)
    for i in range(n):
        row = moved[i]
        r, bank, slope = row[1], bank_rad[i], -grade_rad[i]
        # Euler rates to body rates, first order in the angles; the body's lean turns with the car.
        p[i] = slope_at(bank_rad, i, dt_s) - r * slope + row[6] - r * row[7]
        q[i] = -slope_at(grade_rad, i, dt_s) + r * bank + row[8] + r * row[5]
    x, y, z = lever_m[0], lever_m[1], lever_m[2]
    shown = np.empty((n, 6))
    rate, force = np.empty(3), np.empty(3)
    for i in range(n):
        row = moved[i]
        vy, r, r_rate, across, lean, dive = row[0], row[1], row[2], row[3], row[5], row[7]
        v, bank, slope = v_mps[i], bank_rad[i], -grade_rad[i]
        p_road = slope_at(bank_rad, i, dt_s) - r * slope
        q_road = -slope_at(grade_rad, i, dt_s) + r * bank
        # Along the road's own axes first; the body is turned against these by its lean and its dive.
        along = v_rate[i] - r * vy
        roll, pitch = bank + lean, slope + dive
        ax = along * math.cos(dive) - G * math.sin(pitch)
        ay = across * math.cos(lean) + G * math.sin(roll)
        az = -q_road * v + p_road * vy + G * math.cos(roll) * math.cos(pitch)
        az += along * math.sin(dive) - across * math.sin(lean)
        p_rate, q_rate = slope_at(p, i, dt_s), slope_at(q, i, dt_s)
        before, after = max(i - 1, 0), min(i + 1, n - 1)
        rolling = (moved[after, 6] - moved[before, 6]) / (dt_s * (after - before))
        diving = (moved[after, 8] - moved[before, 8]) / (dt_s * (after - before))
        ax += body_m[1] * diving
        ay -= body_m[0] * rolling
        az -= body_m[2] * diving
        rate[0], rate[1], rate[2] = p[i], q[i], r
        force[0] = ax - (q[i] * q[i] + r * r) * x + (p[i] * q[i] - r_rate) * y + (p[i] * r + q_rate) * z
        force[1] = ay + (p[i] * q[i] + r_rate) * x - (p[i] * p[i] + r * r) * y + (q[i] * r - p_rate) * z
        force[2] = az + (p[i] * r - q_rate) * x + (q[i] * r + p_rate) * y - (p[i] * p[i] + q[i] * q[i]) * z
        for k in range(3):
            turned, pulled = 0.0, 0.0
            for j in range(3):
                turned += rates_of_rates[k, j] * rate[j] + rates_of_forces[k, j] * force[j]
                pulled += forces_of_forces[k, j] * force[j]
            shown[i, k], shown[i, 3 + k] = turned, pulled
    return shown


@compiled
def followed(values: Floats, time_constant_s: float, dt_s: float) -> Floats:
    """What follows each column of the values (n, c) by a first order, T y' = x - y, from its first one on.

    Exact for what is straight between two instants, so that the sampling adds no delay of its own.
    """
    keep = math.exp(-dt_s / time_constant_s)
    share = 1.0 + (keep - 1.0) * time_constant_s / dt_s
    rest = 1.0 - keep - share
    shown = np.empty_like(values)
    shown[0] = values[0]
    for i in range(1, len(values)):
        for c in range(values.shape[1]):
            shown[i, c] = keep * shown[i - 1, c] + share * values[i, c] + rest * values[i - 1, c]
    return shown


@compiled
def rolled(
    moved: Floats,
    v_mps: Floats,
    front_slip: Floats,
    rear_slip: Floats,
    cg_to_front_axle_m: float,
    front_track_m: float,
    rear_track_m: float,
    radii: Floats,
) -> Floats:
    """Each wheel's speed along its own heading (n, 4), slip (n,) included; `radii` (4,) over the configured."""
    shown = np.empty((len(v_mps), 4))
    for i in range(len(v_mps)):
        row = moved[i]
        v, r, delta = v_mps[i], row[1], row[9]
        cos, across = math.cos(delta), (row[0] + cg_to_front_axle_m * r) * math.sin(delta)
        front, rear = 0.5 * r * front_track_m, 0.5 * r * rear_track_m
        shown[i, 0] = ((v - front) * cos + across) * (1.0 + front_slip[i]) / radii[0]
        shown[i, 1] = ((v + front) * cos + across) * (1.0 + front_slip[i]) / radii[1]
        shown[i, 2] = (v - rear) * (1.0 + rear_slip[i]) / radii[2]
        shown[i, 3] = (v + rear) * (1.0 + rear_slip[i]) / radii[3]
    return shown


@compiled
def side_by_side(reads: Floats, wheels: Floats, moved: Floats, v_mps: Floats, grade_rad: Floats) -> Floats:
    """All channels (n, 13): the IMU's (n, 6), what is compared of the wheels (n, 3), v, v_y, r and grade."""
    shown = np.empty((len(v_mps), 13))
    for i in range(len(v_mps)):
        for c in range(6):
            shown[i, c] = reads[i, c]
        for c in range(3):
            shown[i, 6 + c] = wheels[i, c]
        shown[i, 9], shown[i, 10], shown[i, 11], shown[i, 12] = v_mps[i], moved[i, 0], moved[i, 1], grade_rad[i]
    return shown
