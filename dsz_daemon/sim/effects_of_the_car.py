"""Effects of body, tyres, wheels and steering. The true car changes, never what its configuration says."""

from __future__ import annotations

import math
from dataclasses import replace

from dsz_daemon.signals import STANDARD_GRAVITY_MPS2, WHEELS
from dsz_daemon.sim.car import Car
from dsz_daemon.sim.effects_of_sensors import PutInto, Values, given
from dsz_daemon.sim.world import World


def _axles_nm_per_rad(car: Car) -> tuple[float, float]:
    """What front and rear axle resist a lean with: springs and bar."""
    return (
        0.5 * car.front_spring_n_per_m * car.front_track_m**2 + car.front_bar_nm_per_rad,
        0.5 * car.rear_spring_n_per_m * car.rear_track_m**2 + car.rear_bar_nm_per_rad,
    )


def _with_bars_for(car: Car, front_nm_per_rad: float, rear_nm_per_rad: float) -> Car:
    """The car with what bars these sums take beside its springs: less than none, where springs alone are more."""
    return replace(
        car,
        front_bar_nm_per_rad=front_nm_per_rad - 0.5 * car.front_spring_n_per_m * car.front_track_m**2,
        rear_bar_nm_per_rad=rear_nm_per_rad - 0.5 * car.rear_spring_n_per_m * car.rear_track_m**2,
    )


def leaning(world: World, v: Values) -> World:
    """Bars for this gradient, K k = m h (1 + g k); front and rear share as before."""
    car, k = world.car, v["roll_gradient_rad_per_mps2"]
    wanted = car.mass_kg * car.cg_height_m * (1.0 + STANDARD_GRAVITY_MPS2 * k) / k
    front, rear = _axles_nm_per_rad(car)
    factor = wanted / (front + rear)
    return replace(world, car=_with_bars_for(replace(car, leans=True), factor * front, factor * rear))


def diving(world: World, v: Values) -> World:
    """All springs and dampers by one factor, for this gradient against the C.G. over the axles' springs.

    The bars make up for it: the car leans as before.
    """
    car, k = world.car, v["pitch_gradient_rad_per_mps2"]
    front, rear = 2.0 * car.front_spring_n_per_m, 2.0 * car.rear_spring_n_per_m
    # Around the point that doesn't heave when the nose dips.
    now = front * rear / (front + rear) * car.wheelbase_m**2
    wanted = car.mass_kg * car.cg_height_m * (1.0 + STANDARD_GRAVITY_MPS2 * k) / k
    factor = wanted / now
    changed = replace(
        car,
        dives=True,
        front_spring_n_per_m=car.front_spring_n_per_m * factor,
        rear_spring_n_per_m=car.rear_spring_n_per_m * factor,
        front_damper_ns_per_m=car.front_damper_ns_per_m * math.sqrt(factor),
        rear_damper_ns_per_m=car.rear_damper_ns_per_m * math.sqrt(factor),
    )
    return replace(world, car=_with_bars_for(changed, *_axles_nm_per_rad(car)))


def loaded(world: World, v: Values) -> World:
    """Another mass and C.G. along the car, at the same height and with the same inertias.

    The IMU stays where it was on the car: further from, or nearer to, the C.G. that moved.
    """
    car, shift_m = world.car, v.get("cg_shift_m", 0.0)
    changed = replace(
        car,
        mass_kg=car.mass_kg + v.get("added_mass_kg", 0.0),
        cg_to_front_axle_m=car.cg_to_front_axle_m - shift_m,
        cg_to_rear_axle_m=car.cg_to_rear_axle_m + shift_m,
        imu_x_m=car.imu_x_m - shift_m,
    )
    return replace(world, car=changed)


def slip(world: World, v: Values) -> World:
    """Wheels that slip by this share for as much longitudinal as (static) vertical force, at small slips."""
    car, slip_per_force = world.car, v["slip_per_force"]
    changed = replace(
        car,
        slips=True,
        front_slip_stiffness_n=car.front_static_load_n / slip_per_force,
        rear_slip_stiffness_n=car.rear_static_load_n / slip_per_force,
    )
    return replace(world, car=changed)


def stiffness(world: World, v: Values) -> World:
    """Other tyres, at both axles."""
    car = world.car
    changed = replace(
        car,
        front_cornering_stiffness_n_per_rad=car.front_cornering_stiffness_n_per_rad * v.get("front_scale", 1.0),
        rear_cornering_stiffness_n_per_rad=car.rear_cornering_stiffness_n_per_rad * v.get("rear_scale", 1.0),
    )
    return replace(world, car=changed)


def radii(world: World, v: Values) -> World:
    """Radii against those that the controller turns spin into speed by."""
    fl, fr, rl, rr = given(v, WHEELS, world.car.wheel_radius_scale)
    return replace(world, car=replace(world.car, wheel_radius_scale=(fl, fr, rl, rr)))


def field_of_the_car(**fields: str) -> PutInto:
    """Return what sets fields of the car to parameters."""

    def put_into(world: World, v: Values) -> World:
        changes = {field: v[name] for field, name in fields.items() if name in v}
        return replace(world, car=replace(world.car, **changes))  # type: ignore[arg-type]

    return put_into
