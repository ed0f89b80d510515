"""A world: a car on a road with a driver and sensors, all that is true in one drive; and the nominal one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dsz_daemon.sim.car import Car
from dsz_daemon.sim.driver import Programme
from dsz_daemon.sim.road import Road
from dsz_daemon.sim.sensors import SensorErrors

# A body, tyres and a steering without any of what the effects bring: grip without an end, slip that builds up at
# once (within two steps), stiffness that no load changes.
_ENDLESS_GRIP = 1e6
_SHORTEST_M = 0.02


@dataclass(frozen=True)
class World:
    """What is true in one drive."""

    car: Car
    road: Road
    programme: Programme
    errors: SensorErrors


def nominal(world: World) -> World:
    """Return the same car and driver, rigid, linear, without slip, play or delay; offsets and noise stay.

    The nominal simulation's set of assumptions, put together from mechanics instead of its formulas. The road keeps
    its bends, and is flat.
    """
    car = replace(
        world.car,
        imu_x_m=0.0,
        imu_y_m=0.0,
        imu_z_m=0.0,
        friction=_ENDLESS_GRIP,
        load_sensitivity=0.0,
        lateral_relaxation_m=_SHORTEST_M,
        leans=False,
        dives=False,
        slips=False,
        steering_compliance_rad_per_n=0.0,
        steering_backlash_rad=0.0,
        steering_offset_rad=0.0,
        steering_ratio_scale=1.0,
        steering_ratio_per_rad=0.0,
        wheel_radius_scale=(1.0, 1.0, 1.0, 1.0),
    )
    road = world.road
    level = Road(road.step_m, np.zeros_like(road.tilt), road.bend_per_m, np.zeros_like(road.rough))
    errors = world.errors
    kept = SensorErrors(errors.gyro_offset_radps, errors.accel_offset_mps2, noisy=errors.noisy)
    return World(car, level, replace(world.programme, side_wind_n=None, friction_limit=None), kept)
