"""What is at the place of the instruments: motion and gravity felt by the IMU, and what each wheel rolls."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.diagnose.angles import at_a_side, cos_of, drawn, sin_of
from dsz_daemon.signals import STANDARD_GRAVITY_MPS2

Floats = np.ndarray[Any, np.dtype[np.float64]]

G = STANDARD_GRAVITY_MPS2
# A drift that fades by less than this share all the way is even.
_EVEN = 1e-6
_PIECE = 256


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
    small_turns: float = 0.0,
    flat_roads: float = 0.0,
) -> Floats:
    """The IMU's readings (n, 6) at `lever_m` (3,) from the C.G., which is `body_m` (3,) from what the body leans about.

    The last: above the roll axis, above and ahead of the pitch axis.

    Of motion (n, 12), speed, its rate, bank and grade (n,). The matrices (3, 3) are the sensors': rates shown of
    rates and of forces, forces shown of forces. `small_turns`: of a body drawn for small angles (1) the vertical shows
    nothing of what it leans by; `flat_roads`: of a road drawn as a tilt alone (1) nothing of how the car follows it.
    """
    n = len(v_mps)
    p, q, p_roads, q_roads = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        row, before, after = moved[i], max(i - 1, 0), min(i + 1, n - 1)
        r, per_s = row[1], 1.0 / (dt_s * (after - before))
        # Euler rates to body rates, first order in the angles; the body's lean turns with the car.
        p_roads[i] = (bank_rad[after] - bank_rad[before]) * per_s + r * grade_rad[i]
        q_roads[i] = (grade_rad[before] - grade_rad[after]) * per_s + r * bank_rad[i]
        p[i], q[i] = p_roads[i] + row[6] - r * row[7], q_roads[i] + row[8] + r * row[5]
    x, y, z = lever_m[0], lever_m[1], lever_m[2]
    shown = np.empty((n, 6))
    rate, force = np.empty(3), np.empty(3)
    for i in range(n):
        row, before, after = moved[i], max(i - 1, 0), min(i + 1, n - 1)
        per_s = 1.0 / (dt_s * (after - before))
        vy, r, r_rate, across, lean, dive = row[0], row[1], row[2], row[3], row[5], row[7]
        # Along the road's own axes first; the body is turned against these by its lean and its dive.
        along = v_rate[i] - r * vy
        roll, pitch = bank_rad[i] + lean, dive - grade_rad[i]
        ax = along * cos_of(dive) - G * sin_of(pitch)
        ay = across * cos_of(lean) + G * sin_of(roll)
        az = (1.0 - flat_roads) * (p_roads[i] * vy - q_roads[i] * v_mps[i]) + G * cos_of(roll) * cos_of(pitch)
        az += (1.0 - small_turns) * (along * sin_of(dive) - across * sin_of(lean))
        p_rate, q_rate = (p[after] - p[before]) * per_s, (q[after] - q[before]) * per_s
        rolling, diving = (moved[after, 6] - moved[before, 6]) * per_s, (moved[after, 8] - moved[before, 8]) * per_s
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
def delayed(values: Floats, by_s: float, dt_s: float, later: float = 0.0) -> Floats:
    """Each column of the values (n, c) as it comes `by_s` late (early, if negative); level beyond the ends.

    `later`: by how much it comes later and later, of the time since the middle.
    """
    n, c = values.shape
    found = np.empty((n, c))
    for i in range(n):
        place = min(max(i - by_s / dt_s - later * (i - 0.5 * n), 0.0), n - 1.0)
        k = min(int(place), max(n - 2, 0))
        after, share = min(k + 1, n - 1), place - k
        for j in range(c):
            found[i, j] = values[k, j] + share * (values[after, j] - values[k, j])
    return found


@compiled
def add_offsets(reads: Floats, offsets: Floats, drifts: Floats, fades_per_s: float, dt_s: float) -> None:
    """Adds offsets (6,) and what they drift by in a second (6,), on average, about the middle, to the readings (n, 6).

    The first of them are the fastest, or the last: at the time t the rate has gone down by exp(-`fades_per_s` t).
    """
    n = len(reads)
    middle_s = drifted_s(0.5 * n * dt_s, n * dt_s, fades_per_s)
    for i in range(n):
        time_s = drifted_s(dt_s * i, n * dt_s, fades_per_s) - middle_s
        for c in range(reads.shape[1]):
            reads[i, c] += offsets[c] + time_s * drifts[c]


@compiled
def drifted_s(time_s: float, whole_s: float, fades_per_s: float) -> float:
    """For how long at its mean rate a drift that fades would have gone to be as far; `whole_s` after the whole."""
    if abs(fades_per_s) * whole_s < _EVEN:
        return time_s
    return whole_s * math.expm1(-fades_per_s * time_s) / math.expm1(-fades_per_s * whole_s)


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
    load_height_m: float,
    small: float = 0.0,
    unturned: float = 0.0,
    nearer: float = 0.0,
) -> Floats:
    """Each wheel's speed along its own heading (n, 4), slip (n,) included; `radii` (4,) over the configured.

    `small`, `unturned`: how far the front wheels' are drawn for small angles, or as if they were not turned; `nearer`:
    see `angles.at_a_side`, 0 where both are turned alike.

    The inner wheel of an axle carries less, and slips more by the same force: m a h / t of m g / 2 each.
    """
    per_mps2 = 2.0 * load_height_m / G
    shown = np.empty((len(v_mps), 4))
    for i in range(len(v_mps)):
        row = moved[i]
        v, r, delta = v_mps[i], row[1], row[9]
        cos, sin = drawn(delta, small, unturned)
        (left_cos, left_sin), (right_cos, right_sin) = at_a_side(cos, sin, nearer), at_a_side(cos, sin, -nearer)
        across = row[0] + cg_to_front_axle_m * r
        front, rear = 0.5 * r * front_track_m, 0.5 * r * rear_track_m
        moved_front, moved_rear = per_mps2 * row[3] / front_track_m, per_mps2 * row[3] / rear_track_m
        left, right = (v - front) * left_cos + across * left_sin, (v + front) * right_cos + across * right_sin
        shown[i, 0] = left * (1.0 + front_slip[i] * (1.0 + moved_front)) / radii[0]
        shown[i, 1] = right * (1.0 + front_slip[i] * (1.0 - moved_front)) / radii[1]
        shown[i, 2] = (v - rear) * (1.0 + rear_slip[i] * (1.0 + moved_rear)) / radii[2]
        shown[i, 3] = (v + rear) * (1.0 + rear_slip[i] * (1.0 - moved_rear)) / radii[3]
    return shown


@compiled
def low_passed(values: Floats, kernel: Floats) -> Floats:
    """The values (n,) behind a low-pass that looks as far ahead as back (odd number of weights); level beyond the ends.

    Piece by piece, so that what is added up stays at hand.
    """
    n, reach = len(values), len(kernel) // 2
    padded, found = np.empty(n + 2 * reach), np.zeros(n)
    padded[:reach], padded[reach : n + reach], padded[n + reach :] = values[0], values, values[n - 1]
    for first in range(0, n, _PIECE):
        after = min(first + _PIECE, n)
        mine = found[first:after]
        for j in range(reach):
            before, behind = padded[first + j :], padded[first + 2 * reach - j :]
            for i in range(after - first):
                mine[i] += kernel[j] * (before[i] + behind[i])
        middle = padded[first + reach :]
        for i in range(after - first):
            mine[i] += kernel[reach] * middle[i]
    return found


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
