"""The project's simulated car as a recording: nominal but for what is put into it, on any way and in any car."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dsz_daemon.prove.ways import Way
from dsz_daemon.sim.bus import configuration, dbc_files
from dsz_daemon.sim.car import Car
from dsz_daemon.sim.coding import can_frames
from dsz_daemon.sim.drive import Columns, drive
from dsz_daemon.sim.effects import Choice, described, with_effects
from dsz_daemon.sim.journey import programme_along, road_along
from dsz_daemon.sim.scenario import SimulatedDrive
from dsz_daemon.sim.sensors import SensorErrors
from dsz_daemon.sim.vehicle import TwoTrackCar, rolling
from dsz_daemon.sim.world import World, nominal

# What is done to the true motion before sensors see it.
Changed = Callable[[Columns], Columns]


def simulated(
    car: Car,
    way: Way,
    seed: int,
    seconds: float,
    effects: Sequence[Choice],
    errors: SensorErrors,
    changed: Changed = lambda columns: columns,
) -> SimulatedDrive:
    """The drive's first seconds, with these effects in an otherwise nominal world; `errors` are its sensors'."""
    programme = programme_along(way.legs, way.stand_s, way.start_mps)
    plain = nominal(World(car, road_along(way.legs), programme, errors))
    world = with_effects(World(plain.car, plain.road, plain.programme, errors), effects)
    start = rolling(world.car, way.start_mps) if way.start_mps > 0.0 else None
    columns = changed(_cut(drive(TwoTrackCar(world.car, world.road), world.programme, start=start), seconds))
    radii = (car.front_wheel_radius_m,) * 2 + (car.rear_wheel_radius_m,) * 2
    frames = can_frames(columns, car.steering_ratio, radii, world.errors, np.random.default_rng([seed, 1]))
    told: dict[str, Any] = {"effects": described(effects)}
    return SimulatedDrive("sealed", seed, frames, columns, configuration(car), dbc_files(), told)


def _cut(columns: Columns, seconds: float) -> Columns:
    kept = columns["time_s"] <= seconds
    return {name: column[kept] for name, column in columns.items()}
