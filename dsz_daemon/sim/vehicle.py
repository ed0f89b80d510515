"""The two-track car: a rigid body on four springs and four tyres, by Newton and Euler.

Body axes are ISO 8855 (x forward, y left, z up) at the C.G. and move with the sprung mass,
so all six degrees of freedom are there; the unsprung mass is lumped into the body. What is
felt at any point of the body follows from the forces that act on it, not from derivatives of
speed: `specific_force`.

State and rates are plain tuples: the inner loop is called a few hundred thousand times.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from dsz_daemon.signals import STANDARD_GRAVITY_MPS2
from dsz_daemon.sim.axle import axle_load, axles
from dsz_daemon.sim.car import Car
from dsz_daemon.sim.pose import Pose, cross, pose
from dsz_daemon.sim.road import Road, Vector

AIR_KG_PER_M3 = 1.2  # at 20 degC and sea level


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


class Inputs(NamedTuple):
    """What the driver does; torques are per wheel."""

    road_wheel_angle_rad: float = 0.0
    front_drive_nm: float = 0.0
    front_brake_nm: float = 0.0
    rear_brake_nm: float = 0.0


Driver = Callable[[float, float], Inputs]  # time in s, speed in m/s -> what the driver does


class Motion(NamedTuple):
    """The rates of the state, and what goes with them."""

    rates: tuple[float, ...]
    specific_force_mps2: Vector  # in body axes: what an accelerometer at the C.G. would feel
    pose: Pose
    loads_n: tuple[float, float, float, float]


def rolling(car: Car, speed_mps: float = 0.0) -> State:
    """Return the car in balance on level ground, straight ahead, its wheels rolling freely."""
    front = speed_mps / car.front_wheel_radius_m
    rear = speed_mps / car.rear_wheel_radius_m
    body = (speed_mps, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, car.cg_height_m, 0.0)
    return State(*body, front, front, rear, rear, *(0.0,) * 8)


def specific_force(state: State, motion: Motion, place_m: Vector) -> Vector:
    """Return what an accelerometer at `place_m` (from the C.G., body axes) feels, m/s^2."""
    turn = (state.roll_rate_radps, state.pitch_rate_radps, state.yaw_rate_radps)
    whirl = cross(turn, cross(turn, place_m))
    swing = cross((motion.rates[3], motion.rates[4], motion.rates[5]), place_m)
    felt = motion.specific_force_mps2
    return (
        felt[0] + whirl[0] + swing[0],
        felt[1] + whirl[1] + swing[1],
        felt[2] + whirl[2] + swing[2],
    )


class TwoTrackCar:
    """The equations of motion of one car on one road; it holds constants only."""

    def __init__(self, car: Car, road: Road) -> None:
        self.car = car
        self.road = road
        self._front, self._rear = axles(car)

    def motion(self, state: State, inputs: Inputs) -> Motion:
        """Return rates and forces of the car in `state` under `inputs`."""
        car = self.car
        u, v, w, p, q, r, roll, pitch = state[:8]
        point = self.road(state.distance_m)
        stance = pose((u, v, w), (p, q, r), roll, pitch, state.height_m, car.cg_height_m, point)
        front = axle_load(
            self._front,
            stance,
            (state.spin_fl_radps, state.kappa_fl, state.slip_fl),
            (state.spin_fr_radps, state.kappa_fr, state.slip_fr),
            inputs.road_wheel_angle_rad,
            inputs.front_drive_nm,
            inputs.front_brake_nm,
        )
        rear = axle_load(
            self._rear,
            stance,
            (state.spin_rl_radps, state.kappa_rl, state.slip_rl),
            (state.spin_rr_radps, state.kappa_rr, state.slip_rr),
            0.0,
            0.0,
            inputs.rear_brake_nm,
        )
        mass, g, up = car.mass_kg, STANDARD_GRAVITY_MPS2, stance.vertical
        air_n = -0.5 * AIR_KG_PER_M3 * car.drag_area_m2 * u * abs(u)
        felt = (
            (front.force_n[0] + rear.force_n[0] + air_n) / mass,
            (front.force_n[1] + rear.force_n[1]) / mass,
            (front.force_n[2] + rear.force_n[2]) / mass,
        )
        moment = [f + b for f, b in zip(front.moment_nm, rear.moment_nm, strict=True)]
        jx, jy, jz = car.roll_inertia_kgm2, car.pitch_inertia_kgm2, car.yaw_inertia_kgm2
        wheel_rates = zip(front.left, front.right, rear.left, rear.right, strict=True)
        spin_rates, kappa_rates, slip_rates = wheel_rates
        rates = (
            felt[0] - g * up[0] - q * w + r * v,
            felt[1] - g * up[1] - r * u + p * w,
            felt[2] - g * up[2] - p * v + q * u,
            (moment[0] + (jy - jz) * q * r) / jx,
            (moment[1] + (jz - jx) * r * p) / jy,
            (moment[2] + (jx - jy) * p * q) / jz,
            *stance.angle_rates_radps,
            stance.rising_mps,
            stance.along_mps,
            *spin_rates,
            *kappa_rates,
            *slip_rates,
        )
        return Motion(rates, felt, stance, front[4:6] + rear[4:6])


def next_state(car: TwoTrackCar, driver: Driver, t_s: float, state: State, dt_s: float, now: Motion) -> State:
    """Return the state after one Runge-Kutta step of order 4; `now` is the motion at `t_s`."""
    half_s = 0.5 * dt_s

    def slope(at_s: float, at: State) -> tuple[float, ...]:
        return car.motion(at, driver(at_s, at.forward_mps)).rates

    def ahead(along: tuple[float, ...], by_s: float) -> State:
        return State._make([y + by_s * k for y, k in zip(state, along, strict=True)])

    k1 = now.rates
    k2 = slope(t_s + half_s, ahead(k1, half_s))
    k3 = slope(t_s + half_s, ahead(k2, half_s))
    k4 = slope(t_s + dt_s, ahead(k3, dt_s))
    mean = [(a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]
    return ahead(tuple(mean), dt_s)
