"""What is at the place of the instruments: motion and gravity felt by the IMU, and what each wheel rolls."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.diagnose.simulation.angles import all_at_a_side, all_drawn, cos_sin_of
from dsz_daemon.signals import STANDARD_GRAVITY_MPS2

Floats = np.ndarray[Any, np.dtype[np.float64]]

G = STANDARD_GRAVITY_MPS2
# A drift that fades by less than this share all the way is even.
_EVEN = 1e-6
_PIECE = 512


@compiled
def rate_of(values: Floats, dt_s: float) -> Floats:
    """The values' rate of change (n,): central, at the ends one-sided."""
    n = len(values)
    found = np.zeros(n)
    if n < 2:
        return found
    found[0], found[n - 1] = (values[1] - values[0]) / dt_s, (values[n - 1] - values[n - 2]) / dt_s
    per_s = 1.0 / (2.0 * dt_s)
    for i in range(1, n - 1):
        found[i] = (values[i + 1] - values[i - 1]) * per_s
    return found


@compiled
def felt(
    moved: Floats,
    v_mps: Floats,
    v_rate: Floats,
    bank_rad: Floats,
    grade_rad: Floats,
    lever_m: Floats,
    body_m: Floats,
    axes: Floats,
    dt_s: float,
    small_turns: float = 0.0,
    flat_roads: float = 0.0,
    flat_bends: float = 0.0,
    flat_leans: float = 0.0,
) -> Floats:
    """The IMU's readings (n, 6) at `lever_m` (3,) from the C.G., which is `body_m` (3,) from what the body leans about.

    The last: above the roll axis, above and ahead of the pitch axis.

    Of motion (n, 12), speed, its rate, bank and grade (n,). `axes` (3, 3, 3) are the sensors': rates shown of
    rates and of forces, forces shown of forces. `small_turns`: of a body drawn for small angles (1) the vertical shows
    nothing of what it leans by; `flat_roads`: of a road drawn as a tilt alone (1) nothing of how the car follows it;
    `flat_bends`: of one whose tilts stay as they are as the car turns (1) the gyros show nothing of its turn;
    `flat_leans`: nor do they of a body that leans and dives and stays so (1).
    """
    n = len(v_mps)
    vy, r, r_rate, across = moved[:, 0], moved[:, 1], moved[:, 2], moved[:, 3]
    lean, lean_rate, dive, dive_rate = moved[:, 5], moved[:, 6], moved[:, 7], moved[:, 8]
    # Euler rates to body rates, first order in the angles; the body's lean turns with the car.
    p_roads, q_roads = rate_of(bank_rad, dt_s), rate_of(grade_rad, dt_s)
    p, q, roll, pitch = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    turns_too, leans_turn = 1.0 - flat_bends, 1.0 - flat_leans
    for i in range(n):
        p_roads[i] += turns_too * r[i] * grade_rad[i]
        q_roads[i] = turns_too * r[i] * bank_rad[i] - q_roads[i]
        p[i] = p_roads[i] + lean_rate[i] - leans_turn * r[i] * dive[i]
        q[i] = q_roads[i] + dive_rate[i] + leans_turn * r[i] * lean[i]
        roll[i], pitch[i] = bank_rad[i] + lean[i], dive[i] - grade_rad[i]
    p_rate, q_rate, rolling, diving = (
        rate_of(p, dt_s),
        rate_of(q, dt_s),
        rate_of(lean_rate, dt_s),
        rate_of(dive_rate, dt_s),
    )
    (cos_lean, sin_lean), (cos_dive, sin_dive) = cos_sin_of(lean), cos_sin_of(dive)
    (cos_roll, sin_roll), (cos_pitch, sin_pitch) = cos_sin_of(roll), cos_sin_of(pitch)
    x, y, z = lever_m[0], lever_m[1], lever_m[2]
    force_x, force_y, force_z = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        # Along the road's own axes first; the body is turned against these by its lean and its dive.
        along = v_rate[i] - r[i] * vy[i]
        ax = along * cos_dive[i] - G * sin_pitch[i]
        ay = across[i] * cos_lean[i] + G * sin_roll[i]
        az = (1.0 - flat_roads) * (p_roads[i] * vy[i] - q_roads[i] * v_mps[i]) + G * cos_roll[i] * cos_pitch[i]
        az += (1.0 - small_turns) * (along * sin_dive[i] - across[i] * sin_lean[i])
        ax += body_m[1] * diving[i]
        ay -= body_m[0] * rolling[i]
        az -= body_m[2] * diving[i]
        pp, qq, rr, pq, pr, qr = p[i] * p[i], q[i] * q[i], r[i] * r[i], p[i] * q[i], p[i] * r[i], q[i] * r[i]
        force_x[i] = ax - (qq + rr) * x + (pq - r_rate[i]) * y + (pr + q_rate[i]) * z
        force_y[i] = ay + (pq + r_rate[i]) * x - (pp + rr) * y + (qr - p_rate[i]) * z
        force_z[i] = az + (pr - q_rate[i]) * x + (qr + p_rate[i]) * y - (pp + qq) * z
    shown = np.empty((6, n))
    for k in range(3):
        of_p, of_q, of_r = axes[0, k, 0], axes[0, k, 1], axes[0, k, 2]
        by_x, by_y, by_z = axes[1, k, 0], axes[1, k, 1], axes[1, k, 2]
        of_x, of_y, of_z = axes[2, k, 0], axes[2, k, 1], axes[2, k, 2]
        for i in range(n):
            turned = of_p * p[i] + of_q * q[i] + of_r * r[i]
            shown[k, i] = turned + by_x * force_x[i] + by_y * force_y[i] + by_z * force_z[i]
        for i in range(n):
            shown[3 + k, i] = of_x * force_x[i] + of_y * force_y[i] + of_z * force_z[i]
    return shown.T


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
def swung(values: Floats, rate_radps: float, damping: float, dt_s: float, carried: float = 1.0) -> Floats:
    """How a mass on springs and dampers moves if what it stands on moves as each column of the values (n, c) does.

    y'' / w^2 = 2 d (c x' - y') / w + x - y, from rest at the first one on, by the bilinear transform that is right at
    w; `carried` (c) is how much of its dampers stands on that as well, and not still.
    """
    k = rate_radps / math.tan(0.5 * rate_radps * dt_s)
    square, drag = rate_radps**2, 2.0 * damping * rate_radps * k
    whole = k * k + drag + square
    one, two = 2.0 * (square - k * k) / whole, (k * k - drag + square) / whole
    moved = carried * drag
    now, before, last = (square + moved) / whole, 2.0 * square / whole, (square - moved) / whole
    found = np.empty_like(values)
    for j in range(values.shape[1]):
        x1 = x2 = y1 = y2 = values[0, j]
        for i in range(len(values)):
            x = values[i, j]
            y = now * x + before * x1 + last * x2 - one * y1 - two * y2
            x2, x1, y2, y1 = x1, x, y1, y
            found[i, j] = y
    return found


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
    middle_s, time_s = drifted_s(0.5 * n * dt_s, n * dt_s, fades_per_s), np.empty(n)
    for i in range(n):
        time_s[i] = drifted_s(dt_s * i, n * dt_s, fades_per_s) - middle_s
    for c in range(reads.shape[1]):
        offset, drift = offsets[c], drifts[c]
        for i in range(n):
            reads[i, c] += offset + time_s[i] * drift


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
    vy, yaw_rate, side, delta = moved[:, 0], moved[:, 1], moved[:, 3], moved[:, 9]
    cos, sin = all_drawn(delta, small, unturned)
    (left_cos, left_sin), (right_cos, right_sin) = all_at_a_side(cos, sin, nearer), all_at_a_side(cos, sin, -nearer)
    front_per_mps2 = 2.0 * load_height_m / (G * front_track_m)
    rear_per_mps2 = 2.0 * load_height_m / (G * rear_track_m)
    per_radius = 1.0 / radii
    shown = np.empty((4, len(v_mps)))
    for i in range(len(v_mps)):
        v, r = v_mps[i], yaw_rate[i]
        across = vy[i] + cg_to_front_axle_m * r
        front, rear = 0.5 * r * front_track_m, 0.5 * r * rear_track_m
        moved_front, moved_rear = front_per_mps2 * side[i], rear_per_mps2 * side[i]
        left = (v - front) * left_cos[i] + across * left_sin[i]
        right = (v + front) * right_cos[i] + across * right_sin[i]
        shown[0, i] = left * (1.0 + front_slip[i] * (1.0 + moved_front)) * per_radius[0]
        shown[1, i] = right * (1.0 + front_slip[i] * (1.0 - moved_front)) * per_radius[1]
        shown[2, i] = (v - rear) * (1.0 + rear_slip[i] * (1.0 + moved_rear)) * per_radius[2]
        shown[3, i] = (v + rear) * (1.0 + rear_slip[i] * (1.0 - moved_rear)) * per_radius[3]
    return shown.T


@compiled
def low_passed(values: Floats, kernel: Floats) -> Floats:
    """The values (n,) behind a low-pass that looks as far ahead as back (odd number of weights); level beyond the ends.

    Piece by piece, so that what is added up stays at hand, and four weights at a time, so that it is fetched less.
    """
    n, reach = len(values), len(kernel) // 2
    padded, found = np.empty(n + 2 * reach), np.empty(n)
    padded[:reach], padded[reach : n + reach], padded[n + reach :] = values[0], values, values[n - 1]
    for first in range(0, n, _PIECE):
        count = min(_PIECE, n - first)
        mine, middle = found[first : first + count], padded[first + reach :]
        for i in range(count):
            mine[i] = kernel[reach] * middle[i]
        j = 0
        while j + 4 <= reach:
            before, behind = padded[first + j :], padded[first + 2 * reach - j - 3 :]
            a, b, c, d = kernel[j], kernel[j + 1], kernel[j + 2], kernel[j + 3]
            for i in range(count):
                outer = a * (before[i] + behind[i + 3]) + b * (before[i + 1] + behind[i + 2])
                mine[i] += outer + c * (before[i + 2] + behind[i + 1]) + d * (before[i + 3] + behind[i])
            j += 4
        while j < reach:
            before, behind = padded[first + j :], padded[first + 2 * reach - j :]
            for i in range(count):
                mine[i] += kernel[j] * (before[i] + behind[i])
            j += 1
    return found


@compiled
def side_by_side(reads: Floats, wheels: Floats, moved: Floats, v_mps: Floats, grade_rad: Floats) -> Floats:
    """All channels (n, 13): the IMU's (n, 6), what is compared of the wheels (n, 3), v, v_y, r and grade."""
    shown = np.empty((13, len(v_mps)))
    for c in range(6):
        shown[c] = reads[:, c]
    for c in range(3):
        shown[6 + c] = wheels[:, c]
    shown[9], shown[10], shown[11], shown[12] = v_mps, moved[:, 0], moved[:, 1], grade_rad
    return shown.T
