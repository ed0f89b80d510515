"""Ways by the seed: streets and highways of 150 s, as legs that a driver follows; and cars to drive them with."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dsz_daemon.sim.car import TUCSON, Car
from dsz_daemon.sim.journey import COMFORTABLE_MPS2, Leg


class Way(NamedTuple):
    """Legs, with a stand before the first, or rolling already."""

    legs: tuple[Leg, ...]
    stand_s: float
    start_mps: float


def way(rng: np.random.Generator, kind: str, seconds: float, may_stand: bool = True) -> Way:
    """A city's or a highway's way that takes at least so long; without any stand where a car can't."""
    rolls = kind == "highway" or not may_stand
    start_mps = (float(rng.uniform(22.0, 30.0)) if kind == "highway" else 9.0) if rolls else 0.0
    stand_s = 0.0 if rolls else float(rng.uniform(3.0, 6.0))
    legs: list[Leg] = []
    takes_s, speed_mps = stand_s, start_mps
    while takes_s < seconds + 5.0:
        leg = (_street if kind == "city" else _highway)(rng)
        if not may_stand:
            leg = leg._replace(stop_s=0.0)
        approach_m = _changing_m(speed_mps, leg.speed_mps)
        if approach_m:
            legs.append(Leg(approach_m, leg.speed_mps))
            takes_s += 2.0 * approach_m / (speed_mps + leg.speed_mps)
        legs.append(leg)
        takes_s += leg.length_m / leg.speed_mps + leg.stop_s
        speed_mps = 0.0 if leg.stop_s else leg.speed_mps
    # Every way ends at a standstill, which comes after what is driven here.
    return Way((*legs, Leg(20.0 * leg.speed_mps, leg.speed_mps)), stand_s, start_mps)


def _changing_m(from_mps: float, to_mps: float) -> float:
    """The way on which a driver changes speed, and a little more: straight ahead, before what comes."""
    return 0.0 if from_mps == to_mps else 0.8 * abs(to_mps**2 - from_mps**2) / COMFORTABLE_MPS2 + 5.0


def _street(rng: np.random.Generator) -> Leg:
    side, what = float(rng.choice([-1.0, 1.0])), rng.choice(["cruise", "corner", "corner", "bend", "bend", "stop"])
    if what == "cruise":
        return Leg(float(rng.uniform(20.0, 60.0)), float(rng.uniform(9.0, 15.0)))
    if what == "stop":
        return Leg(50.0, 8.0, stop_s=float(rng.uniform(2.0, 6.0)))
    if what == "corner":
        radius_m, across = float(rng.uniform(9.0, 18.0)), float(rng.uniform(1.5, 3.0))
        # The bend comes and goes on a part of its way: what is turned through is some 90 degrees.
        return Leg(2.0 * radius_m, math.sqrt(across * radius_m), side / radius_m)
    speed_mps = float(rng.uniform(9.0, 14.0))
    return Leg(float(rng.uniform(40.0, 90.0)), speed_mps, side * float(rng.uniform(1.0, 3.2)) / speed_mps**2)


def _highway(rng: np.random.Generator) -> Leg:
    side, what = float(rng.choice([-1.0, 1.0])), rng.choice(["cruise", "bend", "bend", "bend", "ramp"])
    if what == "cruise":
        return Leg(float(rng.uniform(50.0, 150.0)), float(rng.uniform(24.0, 34.0)))
    if what == "ramp":
        speed_mps = float(rng.uniform(14.0, 19.0))
        return Leg(float(rng.uniform(80.0, 150.0)), speed_mps, side * float(rng.uniform(1.5, 3.5)) / speed_mps**2)
    speed_mps = float(rng.uniform(22.0, 33.0))
    return Leg(float(rng.uniform(150.0, 350.0)), speed_mps, side * float(rng.uniform(0.6, 2.4)) / speed_mps**2)


def car(rng: np.random.Generator) -> Car:
    """A road car that understeers, as heavy and long as they are; all else is the simulated car's."""
    mass_kg, wheelbase_m = float(rng.uniform(1150.0, 2200.0)), float(rng.uniform(2.5, 3.0))
    front_m = wheelbase_m * float(rng.uniform(0.42, 0.50))
    rear_m = wheelbase_m - front_m
    rear_n_per_rad = 0.5 * mass_kg * 9.81 * front_m / wheelbase_m * float(rng.uniform(12.0, 17.0))
    # How much more steering a m/s2 takes: rad/(m/s2).
    gradient = float(rng.uniform(0.0015, 0.0045))
    half_kg = 0.5 * mass_kg / wheelbase_m
    front_n_per_rad = half_kg * rear_m / (gradient + half_kg * front_m / rear_n_per_rad)
    heavier = mass_kg / TUCSON.mass_kg
    radius_m = float(rng.uniform(0.30, 0.36))
    return replace(
        TUCSON,
        mass_kg=round(mass_kg),
        cg_to_front_axle_m=round(front_m, 3),
        cg_to_rear_axle_m=round(rear_m, 3),
        front_track_m=round(float(rng.uniform(1.48, 1.62)), 3),
        rear_track_m=round(float(rng.uniform(1.48, 1.62)), 3),
        front_wheel_radius_m=round(radius_m, 3),
        rear_wheel_radius_m=round(radius_m + float(rng.uniform(-0.004, 0.004)), 3),
        cg_height_m=round(float(rng.uniform(0.52, 0.68)), 2),
        yaw_inertia_kgm2=round(mass_kg * front_m * rear_m * float(rng.uniform(0.9, 1.15))),
        roll_inertia_kgm2=TUCSON.roll_inertia_kgm2 * heavier,
        pitch_inertia_kgm2=TUCSON.pitch_inertia_kgm2 * heavier,
        front_spring_n_per_m=TUCSON.front_spring_n_per_m * heavier,
        rear_spring_n_per_m=TUCSON.rear_spring_n_per_m * heavier,
        front_damper_ns_per_m=TUCSON.front_damper_ns_per_m * heavier,
        rear_damper_ns_per_m=TUCSON.rear_damper_ns_per_m * heavier,
        front_bar_nm_per_rad=TUCSON.front_bar_nm_per_rad * heavier,
        rear_bar_nm_per_rad=TUCSON.rear_bar_nm_per_rad * heavier,
        front_cornering_stiffness_n_per_rad=round(front_n_per_rad),
        rear_cornering_stiffness_n_per_rad=round(rear_n_per_rad),
        steering_ratio=round(float(rng.uniform(13.0, 18.0)), 2),
        engine_braking_mps2=round(float(rng.uniform(0.0, 2.0)), 2),
    )
