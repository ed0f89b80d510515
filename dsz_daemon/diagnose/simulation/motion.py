"""The car of the simulation: single-track, driven by recorded steering and speed, with what may have been left out.

Every parameter beyond the nominal is a number that takes nothing away at 0. ISO 8855: roll with the left side up and
pitch with the nose down are positive. One step is a midpoint rule; lateral forces follow their static value over the
relaxation length exactly (Pacejka, Tire and Vehicle Dynamics, 3rd ed., section 7.2).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.diagnose.simulation.angles import at_a_side, atan_of, cos_of, drawn, sin_of
from dsz_daemon.diagnose.simulation.tyre_curve import Curve, curve_of, limited
from dsz_daemon.signals import STANDARD_GRAVITY_MPS2

Floats = np.ndarray[Any, np.dtype[np.float64]]

G = STANDARD_GRAVITY_MPS2
# Below, tyres roll where they point: slip angles divide by speed.
ROLLING_MPS = 2.5
# Where grip ends each leaves a third of what the one before did.
_GIVES_WAY_ROUNDS = 4
# A body on its springs, of a passenger car.
BODY_RADPS, BODY_DAMPING = 2.0 * math.pi * 1.5, 0.35
# Load comes through these springs: so long after the force.
LOAD_S = 2.0 * BODY_DAMPING / BODY_RADPS
# Of an axle's static load.
LIGHTEST, HEAVIEST = 0.3, 1.7

# How long a tyre stays linear, see `tyre_curve`.
SHARPNESS = 2.5

# Columns of what `moved` returns.
VY, R, R_RATE, AY, FRONT_N, ROLL, ROLL_RATE, PITCH, PITCH_RATE, DELTA, SPEED, LEANS = range(12)


class CarModel(NamedTuple):
    """What moves the car; axle stiffnesses in N/rad (two tyres), loads in N of an axle.

    `swings_m`: how far the C.G. is above what the body leans about; there the wheels stand. `small_wheels`,
    `unturned_wheels`: how far what the front wheels roll is drawn for small angles, or as if they were not turned;
    `nearer`: how far they are beside the middle, over the wheelbase, 0 where they are turned alike. `load_across_m`:
    the height of the C.G., as far as what a tyre does goes with the load that bends move to the outer ones.
    """

    mass_kg: float
    yaw_inertia_kgm2: float
    cg_to_front_axle_m: float
    cg_to_rear_axle_m: float
    front_stiffness: float
    rear_stiffness: float
    relaxation_m: float
    compliance_rad_per_n: float
    roll_gradient: float
    roll_radps: float
    roll_damping: float
    pitch_gradient: float
    pitch_radps: float
    pitch_damping: float
    air_per_m: float
    sharpness: float
    brush: float
    wind_ahead_m: float
    wind_leans: float
    steered_pull: float
    steered_brake: float
    parallel_steer: float
    front_track_m: float
    hasty_s: float
    load_height_m: float
    swings_m: float
    small_wheels: float = 0.0
    unturned_wheels: float = 0.0
    nearer: float = 0.0
    load_across_m: float = 0.0


@compiled
def _pulled(car: CarModel, front_n: float, along_mps2: float, sin: float, tan: float) -> float:
    """What the front wheels' share of drive and brakes does sideways: m a_x = F_x cos delta - F_y sin delta.

    `along_mps2` is a_x and what a climb takes; `sin` and `cos` are those of delta. Front wheels may brake that nothing
    drives.
    """
    along_n = car.mass_kg * along_mps2 + front_n * sin
    share = car.steered_pull if along_n > 0.0 else car.steered_brake
    return along_n * tan * share


@compiled
def _scrubbed(car: CarModel, heading: float, curvature: float, sin: float) -> tuple[float, float]:
    """What front wheels that steer alike do beyond one in the middle: force to the left, and yaw moment.

    With e = (track / 2) r / v the inner one rolls at v (1 - e), the outer one at v (1 + e): their headings are
    heading / (1 -+ e), on average heading (1 + e^2), and F_outer - F_inner = C heading e, each with a part
    F sin(delta) along, track / 2 from the middle.
    """
    half = 0.5 * car.front_track_m
    e = half * curvature
    one = car.parallel_steer * car.front_stiffness * heading * e
    return -one * e, -one * half * sin - one * e * car.cg_to_front_axle_m


@compiled
def _outwards(
    car: CarModel, across_mps2: float, heading: float, curvature: float, sin: float, front_n: float, rear_n: float
) -> tuple[float, float]:
    """What the outer tyres' load does beyond that of two alike on an axle: force to the left, and yaw moment.

    An axle's force is h a_y / g outwards of its middle. There a front wheel is turned by sin^2(delta) / L less for each
    metre, as far as both point to where the car turns, and goes by heading r / v less; a rear one by F_r r / v.
    """
    outside_m = car.load_across_m * across_mps2 / G
    wheelbase_m = car.cg_to_front_axle_m + car.cg_to_rear_axle_m
    less = sin * sin / wheelbase_m - heading * curvature
    front, rear = -outside_m * car.front_stiffness * less, -outside_m * curvature * rear_n
    return front + rear, front * car.cg_to_front_axle_m - rear * car.cg_to_rear_axle_m - outside_m * front_n * sin


@compiled
def _loaded(car: CarModel, along_mps2: float) -> tuple[float, float]:
    """What the front and the rear tyres' forces are times, for the load that drive and brakes move to the rear.

    m a h / L of m g l_r / L in front; h counts as far as stiffness follows load (an exponent of 1 is all of it).
    """
    moved_m = car.load_height_m * along_mps2 / G
    front, rear = 1.0 - moved_m / car.cg_to_rear_axle_m, 1.0 + moved_m / car.cg_to_front_axle_m
    return min(max(front, LIGHTEST), HEAVIEST), min(max(rear, LIGHTEST), HEAVIEST)


@compiled
def _given_way(
    car: CarModel, steer_rad: float, heading_rad: float, share: float, ends_per_n: float, curve: Curve
) -> float:
    """The angle of front wheels that give way to the force which they have at just that angle, rad.

    delta = steer - c F(delta), F = C (delta - heading) times `share` as far as grip goes: by a step of Newton at once
    where it goes all the way, else by some.
    """
    rad_per_n = car.compliance_rad_per_n * share
    delta = (steer_rad + rad_per_n * car.front_stiffness * heading_rad) / (1.0 + rad_per_n * car.front_stiffness)
    if ends_per_n > 0.0:
        for _ in range(_GIVES_WAY_ROUNDS):
            linear_n = car.front_stiffness * (delta - heading_rad)
            off = delta - steer_rad + rad_per_n * limited(linear_n, ends_per_n, curve)
            delta -= off / (1.0 + rad_per_n * car.front_stiffness)
    return delta


@compiled
def moved(  # noqa: PLR0915 - one loop, that a compiler and a reader can follow
    car: CarModel,
    steer_rad: Floats,
    v_mps: Floats,
    v_rate: Floats,
    front_mps: Floats,
    grip: Floats,
    side_n: Floats,
    bank_rad: Floats,
    grade_rad: Floats,
    lean_mps2: Floats,
    lean_share: float,
    front_free: Floats,
    rear_free: Floats,
    pushes: Floats,
    dt_s: float,
) -> Floats:
    """Motion (n, 12) by the columns above, of steering, speed, its rate, 1/friction^2, wind, bank and grade (n,).

    `AY` is v_y' + r v, m/s^2; `ROLL` and `PITCH` are the body's on the road; `DELTA` is the angle of the front wheels.
    `LEANS` is what the tyres do of it, which leans the body; of what leans it `lean_mps2` (n,) is told, which has
    `lean_share` of the tyres' in it. `front_free`, `rear_free` (n,): what drive and brakes leave of an axle's side
    force. `pushes` (n, 2): what pushes at the C.G., N, and turns the car, N m, and has no name. `front_mps` (n,) or
    (0,): what the front axle rolls, along its wheels, where that tells the speed; `v_mps` is then what is near it, for
    its course between two steps.
    """
    lf, lr = car.cg_to_front_axle_m, car.cg_to_rear_axle_m
    front_load = car.mass_kg * G * lr / (lf + lr)
    rear_load = car.mass_kg * G * lf / (lf + lr)
    rows = np.empty((12, len(v_mps)))
    by_front = len(front_mps) > 0
    vy, r, front, rear, ay, r_rate = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    # The body has come to rest on its springs when a recording begins.
    held_mps2 = G * sin_of(bank_rad[0]) - car.wind_leans * side_n[0] / car.mass_kg
    roll = car.roll_gradient * ((1.0 - lean_share) * held_mps2 + lean_mps2[0])
    pitch = -car.pitch_gradient * (v_rate[0] + G * sin_of(grade_rad[0]) + car.air_per_m * v_mps[0] * v_mps[0])
    roll_rate, pitch_rate = 0.0, 0.0
    front_loaded, rear_loaded, carried_mps2, taken = 1.0, 1.0, 0.0, -math.expm1(-dt_s / LOAD_S)
    curve = curve_of(car.sharpness, car.brush)
    roll_spring, roll_damper = car.roll_radps**2, 2.0 * car.roll_damping * car.roll_radps
    pitch_spring, pitch_damper = car.pitch_radps**2, 2.0 * car.pitch_damping * car.pitch_radps
    per_kg, per_kgm2 = 1.0 / car.mass_kg, 1.0 / car.yaw_inertia_kgm2
    for i in range(len(v_mps)):
        v = v_mps[i]
        delta = steer_rad[i] - car.compliance_rad_per_n * front
        cos, sin = cos_of(delta), sin_of(delta)
        tan = sin / cos
        if by_front:
            along, across = drawn(delta, car.small_wheels, car.unturned_wheels)
            if car.nearer == 0.0:
                v = (front_mps[i] - (vy + lf * r) * across) / along
            else:
                left, right = at_a_side(along, across, car.nearer), at_a_side(along, across, -car.nearer)
                turned_mps = 0.25 * car.front_track_m * r * (right[0] - left[0])
                v = 2.0 * (front_mps[i] - turned_mps) - (vy + lf * r) * (left[1] + right[1])
                v /= left[0] + right[0]
        if v < ROLLING_MPS:
            r_before = r
            r = v * delta / (lf + lr)
            vy = lr * r
            front, rear = 0.0, 0.0
            ay, r_rate = r * v, (r - r_before) / dt_s
        # Of an axle's load, what its force ends at is 1 / `ends`.
        ends = math.sqrt(grip[i])
        tilted = sin_of(bank_rad[i])
        outside = side_n[i] - car.mass_kg * G * tilted
        uphill = G * sin_of(grade_rad[i])
        # A body leans to what its tyres do: the road's tilt, and a wind at the C.G.'s height, pull at all of it alike.
        pulled_mps2 = car.wind_leans * side_n[i] * per_kg - G * tilted
        if car.load_height_m != 0.0:
            carried_mps2 += taken * (v_rate[i] - r * vy + uphill - carried_mps2)
            front_loaded, rear_loaded = _loaded(car, carried_mps2)
        per_v = 1.0 / max(v, ROLLING_MPS)
        ground = vy + car.swings_m * roll_rate
        heading = (ground + lf * r) * per_v
        if v >= ROLLING_MPS and car.relaxation_m <= 0.0:
            if car.compliance_rad_per_n > 0.0:
                share = front_loaded * front_free[i]
                delta = _given_way(car, steer_rad[i], atan_of(heading), share, ends / front_load, curve)
                cos, sin = cos_of(delta), sin_of(delta)
                tan = sin / cos
            slips = atan_of(heading) - delta, atan_of((ground - lr * r) * per_v)
            linear = -car.front_stiffness * slips[0], -car.rear_stiffness * slips[1]
            front = front_loaded * front_free[i] * limited(linear[0], ends / front_load, curve)
            rear = rear_loaded * rear_free[i] * limited(linear[1], ends / rear_load, curve)
        if v >= ROLLING_MPS:
            steered = front * cos + _pulled(car, front, v_rate[i] - r * vy + uphill, sin, tan)
            scrub_n, scrub_nm = _scrubbed(car, heading, r * per_v, sin)
            if car.load_across_m != 0.0:
                outer_n, outer_nm = _outwards(car, ay, heading, r * per_v, sin, front, rear)
                scrub_n, scrub_nm = scrub_n + outer_n, scrub_nm + outer_nm
            ay = (rear + outside + scrub_n + steered + pushes[i, 0]) * per_kg
            turning = car.wind_ahead_m * side_n[i] + scrub_nm - rear * lr + steered * lf + pushes[i, 1]
            r_rate = turning * per_kgm2
        # A hasty simulation shows the force of this moment's steering on motion that is half a step behind it.
        ahead = 0.0
        if v >= ROLLING_MPS:
            turned = steer_rad[min(i + 1, len(v_mps) - 1)] - steer_rad[max(i - 1, 0)]
            ahead = car.front_stiffness * car.hasty_s * turned / (2.0 * dt_s)
        rows[0, i], rows[1, i], rows[4, i] = vy, r, front
        rows[2, i], rows[3, i] = r_rate + ahead * lf * per_kgm2, ay + ahead * per_kg
        rows[5, i], rows[6, i], rows[7, i], rows[8, i], rows[9, i] = roll, roll_rate, pitch, pitch_rate, delta
        rows[10, i], rows[11, i] = v, ay - pulled_mps2
        # The body on its springs, to the next row.
        swung = roll_rate
        lean = car.roll_gradient * ((1.0 - lean_share) * (ay - pulled_mps2) + lean_mps2[i])
        roll_rate += dt_s * (roll_spring * (lean - roll) - roll_damper * roll_rate)
        roll += dt_s * roll_rate
        # To what its tyres do, too: a climb and the air pull at all of it alike.
        dive = -car.pitch_gradient * (v_rate[i] - r * vy + uphill + car.air_per_m * v * v)
        pitch_rate += dt_s * (pitch_spring * (dive - pitch) - pitch_damper * pitch_rate)
        pitch += dt_s * pitch_rate
        if v < ROLLING_MPS:
            continue
        # To the middle of the step, then all of it with what acts there.
        after = min(i + 1, len(v_mps) - 1)
        delta_mid = delta + 0.5 * (steer_rad[after] - steer_rad[i])
        v_mid = v + 0.5 * (v_mps[after] - v_mps[i])
        vy_mid = vy + 0.5 * dt_s * (ay - r * v)
        r_mid = r + 0.5 * dt_s * r_rate
        per_v = 1.0 / v_mid
        ground = vy_mid + 0.5 * car.swings_m * (swung + roll_rate)
        heading = (ground + lf * r_mid) * per_v
        if car.relaxation_m <= 0.0 and car.compliance_rad_per_n > 0.0:
            share, middle_rad = front_loaded * front_free[i], 0.5 * (steer_rad[i] + steer_rad[after])
            delta_mid = _given_way(car, middle_rad, atan_of(heading), share, ends / front_load, curve)
        slips = atan_of(heading) - delta_mid, atan_of((ground - lr * r_mid) * per_v)
        linear = -car.front_stiffness * slips[0], -car.rear_stiffness * slips[1]
        front_goal = front_loaded * front_free[i] * limited(linear[0], ends / front_load, curve)
        rear_goal = rear_loaded * rear_free[i] * limited(linear[1], ends / rear_load, curve)
        front_mid, rear_mid = front_goal, rear_goal
        if car.relaxation_m > 0.0:
            share = -math.expm1(-0.5 * v_mid * dt_s / car.relaxation_m)
            front_mid = front + share * (front_goal - front)
            rear_mid = rear + share * (rear_goal - rear)
            share = -math.expm1(-v_mid * dt_s / car.relaxation_m)
            front += share * (front_goal - front)
            rear += share * (rear_goal - rear)
        along = 0.5 * (v_rate[i] + v_rate[after]) - r_mid * vy_mid + uphill
        cos, sin = cos_of(delta_mid), sin_of(delta_mid)
        steered = front_mid * cos + _pulled(car, front_mid, along, sin, sin / cos)
        scrub_n, scrub_nm = _scrubbed(car, heading, r_mid * per_v, sin)
        if car.load_across_m != 0.0:
            outer_n, outer_nm = _outwards(car, ay, heading, r_mid * per_v, sin, front_mid, rear_mid)
            scrub_n, scrub_nm = scrub_n + outer_n, scrub_nm + outer_nm
        vy += dt_s * ((rear_mid + outside + scrub_n + steered + pushes[i, 0]) * per_kg - r_mid * v_mid)
        turning = car.wind_ahead_m * side_n[i] + scrub_nm - rear_mid * lr + steered * lf + pushes[i, 1]
        r += dt_s * turning * per_kgm2
    return rows.T
