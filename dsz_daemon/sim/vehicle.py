"""The two-track car: a rigid body on four springs and four tyres, by Newton and Euler.

Body axes are ISO 8855 (x forward, y left, z up) at the C.G. and move with the sprung mass,
so all six degrees of freedom are there; the unsprung mass is lumped into the body. What is
felt at any point of the body follows from the forces that act on it, not from derivatives of
speed: `specific_force`.

State and rates are plain tuples that no function keeps: the same source is compiled (`compiled.py`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.compiled import compiled
from dsz_daemon.signals import STANDARD_GRAVITY_MPS2
from dsz_daemon.sim.axle import Axle, axle_load, axles, loads_n, side_force_n
from dsz_daemon.sim.car import Car
from dsz_daemon.sim.pose import Pose, cross, pose
from dsz_daemon.sim.road import Road, Vector, road_bend_per_m, road_point, road_rough_m

AIR_KG_PER_M3 = 1.2  # at 20 degC and sea level
# A body that can't lean follows the road within this time.
_HELD_S = 0.005


class State(NamedTuple):
    """The car at one instant; roll and pitch are the body's against the road."""

    forward_mps: float  # velocity of the C.G. in body axes
    left_mps: float
    up_mps: float
    roll_rate_radps: float  # angular velocity in body axes
    pitch_rate_radps: float
    yaw_rate_radps: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    height_m: float  # of the C.G. over the road
    distance_m: float
    spin_fl_radps: float
    spin_fr_radps: float
    spin_rl_radps: float
    spin_rr_radps: float
    kappa_fl: float  # longitudinal slip
    kappa_fr: float
    kappa_rl: float
    kappa_rr: float
    slip_fl: float  # lateral slip: minus the tangent of the slip angle
    slip_fr: float
    slip_rl: float
    slip_rr: float
    windup_fl: float  # of the brakes, -1 to 1
    windup_fr: float
    windup_rl: float
    windup_rr: float
    off_middle_m: float  # of the road, left positive
    off_heading_rad: float


class Inputs(NamedTuple):
    """What driver and surroundings do; torques are per wheel, `friction_limit` is the road's own."""

    road_wheel_angle_rad: float = 0.0
    front_drive_nm: float = 0.0
    front_brake_nm: float = 0.0
    rear_brake_nm: float = 0.0
    rear_drive_nm: float = 0.0
    side_wind_n: float = 0.0
    friction_limit: float = math.inf


class Body(NamedTuple):
    """The constants of what stands on the axles."""

    mass_kg: float
    roll_inertia_kgm2: float
    pitch_inertia_kgm2: float
    yaw_inertia_kgm2: float
    cg_height_m: float
    air_kg_per_m: float
    wind_ahead_m: float
    wind_up_m: float
    steering_compliance_rad_per_n: float
    leans: bool
    dives: bool


class Motion(NamedTuple):
    """The rates of the state, and what goes with them."""

    rates: State
    specific_force_mps2: Vector  # in body axes: what an accelerometer at the C.G. would feel
    pose: Pose
    loads_n: tuple[float, float, float, float]
    hubs_mps: tuple[float, float, float, float]  # speed of the hubs, ahead in their wheels' own directions
    road_wheel_angle_rad: float  # with what the steering gives way


def body(car: Car) -> Body:
    """Return the body of a car."""
    return Body(
        car.mass_kg,
        car.roll_inertia_kgm2,
        car.pitch_inertia_kgm2,
        car.yaw_inertia_kgm2,
        car.cg_height_m,
        0.5 * AIR_KG_PER_M3 * car.drag_area_m2,
        car.wind_ahead_m,
        car.wind_up_m,
        car.steering_compliance_rad_per_n,
        car.leans,
        car.dives,
    )


def rolling(car: Car, speed_mps: float = 0.0) -> State:
    """Return the car in balance on level ground, straight ahead, its wheels rolling freely."""
    front = speed_mps / car.front_wheel_radius_m
    rear = speed_mps / car.rear_wheel_radius_m
    return State(speed_mps, *(0.0,) * 8, car.cg_height_m, 0.0, front, front, rear, rear, *(0.0,) * 14)


@compiled
def specific_force(state: State, motion: Motion, place_m: Vector) -> Vector:
    """Return what an accelerometer at `place_m` (from the C.G., body axes) feels, m/s^2."""
    turn = (state.roll_rate_radps, state.pitch_rate_radps, state.yaw_rate_radps)
    rates = motion.rates
    whirl = cross(turn, cross(turn, place_m))
    swing = cross((rates.roll_rate_radps, rates.pitch_rate_radps, rates.yaw_rate_radps), place_m)
    felt = motion.specific_force_mps2
    return (
        felt[0] + whirl[0] + swing[0],
        felt[1] + whirl[1] + swing[1],
        felt[2] + whirl[2] + swing[2],
    )


@compiled
def car_motion(body: Body, front: Axle, rear: Axle, road: Road, state: State, inputs: Inputs) -> Motion:
    """Return rates and forces of a car in `state` on `road` under `inputs`."""
    g, mass, limit, zero = STANDARD_GRAVITY_MPS2, body.mass_kg, inputs.friction_limit, 0.0
    u, v, w = state.forward_mps, state.left_mps, state.up_mps
    p, q, r = state.roll_rate_radps, state.pitch_rate_radps, state.yaw_rate_radps
    point = road_point(road, state.distance_m)
    stance = pose((u, v, w), (p, q, r), state.roll_rad, state.pitch_rad, state.height_m, body.cg_height_m, point)
    fl = (state.spin_fl_radps, state.kappa_fl, state.slip_fl, state.windup_fl)
    fr = (state.spin_fr_radps, state.kappa_fr, state.slip_fr, state.windup_fr)
    rl = (state.spin_rl_radps, state.kappa_rl, state.slip_rl, state.windup_rl)
    rr = (state.spin_rr_radps, state.kappa_rr, state.slip_rr, state.windup_rr)
    front_n = loads_n(front, stance, road_rough_m(road, state.distance_m + front.ahead_m))
    rear_n = loads_n(rear, stance, road_rough_m(road, state.distance_m + rear.ahead_m))
    steer_rad = inputs.road_wheel_angle_rad
    if body.steering_compliance_rad_per_n > zero:
        steer_rad -= body.steering_compliance_rad_per_n * side_force_n(front, front_n, fl, fr, limit)
    ahead = axle_load(front, stance, front_n, fl, fr, steer_rad, inputs.front_drive_nm, inputs.front_brake_nm, limit)
    behind = axle_load(rear, stance, rear_n, rl, rr, zero, inputs.rear_drive_nm, inputs.rear_brake_nm, limit)
    up, (roll_rate, pitch_rate, yaw_rate) = stance.vertical, stance.angle_rates_radps
    air_n, wind_n = -body.air_kg_per_m * u * abs(u), inputs.side_wind_n
    felt_x = (ahead.force_n[0] + behind.force_n[0] + air_n) / mass
    felt_y = (ahead.force_n[1] + behind.force_n[1] + wind_n) / mass
    felt_z = (ahead.force_n[2] + behind.force_n[2]) / mass
    jx, jy, jz = body.roll_inertia_kgm2, body.pitch_inertia_kgm2, body.yaw_inertia_kgm2
    roll_nm = ahead.moment_nm[0] + behind.moment_nm[0] - wind_n * body.wind_up_m
    pitch_nm = ahead.moment_nm[1] + behind.moment_nm[1]
    yaw_nm = ahead.moment_nm[2] + behind.moment_nm[2] + wind_n * body.wind_ahead_m
    p_rate = (roll_nm + (jy - jz) * q * r) / jx
    q_rate = (pitch_nm + (jz - jx) * r * p) / jy
    r_rate = (yaw_nm + (jx - jy) * p * q) / jz
    rising = stance.rising_mps
    if not body.leans:
        p_rate, roll_rate = -roll_rate / _HELD_S, zero
    if not body.dives:
        q_rate, pitch_rate = -pitch_rate / _HELD_S, zero
        felt_z, rising = g * up[2] + p * v - q * u - w / _HELD_S, zero
    rates = State(
        felt_x - g * up[0] - q * w + r * v,
        felt_y - g * up[1] - r * u + p * w,
        felt_z - g * up[2] - p * v + q * u,
        p_rate,
        q_rate,
        r_rate,
        roll_rate,
        pitch_rate,
        yaw_rate,
        rising,
        stance.along_mps,
        ahead.left[0],
        ahead.right[0],
        behind.left[0],
        behind.right[0],
        ahead.left[1],
        ahead.right[1],
        behind.left[1],
        behind.right[1],
        ahead.left[2],
        ahead.right[2],
        behind.left[2],
        behind.right[2],
        ahead.left[3],
        ahead.right[3],
        behind.left[3],
        behind.right[3],
        stance.across_mps + stance.along_mps * state.off_heading_rad,
        yaw_rate - road_bend_per_m(road, state.distance_m) * stance.along_mps,
    )
    return Motion(
        rates,
        (felt_x, felt_y, felt_z),
        stance,
        (front_n[0], front_n[1], rear_n[0], rear_n[1]),
        (ahead.left_mps, ahead.right_mps, behind.left_mps, behind.right_mps),
        steer_rad,
    )


@compiled
def _ahead(state: State, rates: State, by_s: float) -> State:
    """The state after so long at these rates."""
    y = state
    k = rates
    return State(
        y[0] + by_s * k[0],
        y[1] + by_s * k[1],
        y[2] + by_s * k[2],
        y[3] + by_s * k[3],
        y[4] + by_s * k[4],
        y[5] + by_s * k[5],
        y[6] + by_s * k[6],
        y[7] + by_s * k[7],
        y[8] + by_s * k[8],
        y[9] + by_s * k[9],
        y[10] + by_s * k[10],
        y[11] + by_s * k[11],
        y[12] + by_s * k[12],
        y[13] + by_s * k[13],
        y[14] + by_s * k[14],
        y[15] + by_s * k[15],
        y[16] + by_s * k[16],
        y[17] + by_s * k[17],
        y[18] + by_s * k[18],
        y[19] + by_s * k[19],
        y[20] + by_s * k[20],
        y[21] + by_s * k[21],
        y[22] + by_s * k[22],
        y[23] + by_s * k[23],
        y[24] + by_s * k[24],
        y[25] + by_s * k[25],
        y[26] + by_s * k[26],
        y[27] + by_s * k[27],
        y[28] + by_s * k[28],
    )


@compiled
def next_state(
    body: Body,
    front: Axle,
    rear: Axle,
    road: Road,
    state: State,
    now: Motion,
    halfway: Inputs,
    then: Inputs,
    dt_s: float,
) -> State:
    """Return the state after one Runge-Kutta step of order 4; `now` is the motion at its beginning."""
    half_s = 0.5 * dt_s
    k1 = now.rates
    k2 = car_motion(body, front, rear, road, _ahead(state, k1, half_s), halfway).rates
    k3 = car_motion(body, front, rear, road, _ahead(state, k2, half_s), halfway).rates
    k4 = car_motion(body, front, rear, road, _ahead(state, k3, dt_s), then).rates
    sixth_s, third_s = dt_s / 6.0, dt_s / 3.0
    return _ahead(_ahead(_ahead(_ahead(state, k1, sixth_s), k2, third_s), k3, third_s), k4, sixth_s)


class TwoTrackCar:
    """One car on one road; it holds constants only."""

    def __init__(self, car: Car, road: Road) -> None:
        self.car = car
        self.road = road
        self.body = body(car)
        self.front, self.rear = axles(car)

    def motion(self, state: State, inputs: Inputs) -> Motion:
        """Return rates and forces of the car in `state` under `inputs`."""
        return car_motion(self.body, self.front, self.rear, self.road, state, inputs)

    def next_state(self, state: State, now: Motion, halfway: Inputs, then: Inputs, dt_s: float) -> State:
        """Return the state one step later; `now` is the motion in `state`."""
        return next_state(self.body, self.front, self.rear, self.road, state, now, halfway, then, dt_s)
