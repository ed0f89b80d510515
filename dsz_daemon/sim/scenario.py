"""One call that drives a scenario of the catalogue, and hands out frames, truth and what reading them takes."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from dsz_daemon.errors import ConfigError, Fault
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES, WHEEL_SPEEDS
from dsz_daemon.sim.bus import configuration, dbc_files
from dsz_daemon.sim.catalogue import SCENARIOS, Scenario
from dsz_daemon.sim.coding import EPOCH_S, can_frames
from dsz_daemon.sim.drive import ROW_S, Columns, drive
from dsz_daemon.sim.imu import offset_columns
from dsz_daemon.sim.sensor_draws import draw_errors
from dsz_daemon.sim.sensors import SensorErrors
from dsz_daemon.sim.vehicle import TwoTrackCar, rolling

TRUTH_PERIOD_S = 0.01


@dataclass(frozen=True, eq=False)
class SimulatedDrive:
    """What one simulation hands out, ready to be written or played.

    `frames` in time order; `truth` columns of equal length, a row per 10 ms on the log's
    clock; `config` and `dbc_files` are all that reading `frames` takes; `parameters` is what
    was true (the car, the drawn sensor errors), as plain data.
    """

    name: str
    seed: int
    frames: list[Frame]
    truth: Columns
    config: dict[str, Any]
    dbc_files: dict[str, str]
    parameters: dict[str, Any]


def scenario_names() -> tuple[str, ...]:
    """Return the names that `simulate` knows."""
    return tuple(SCENARIOS)


def scenario_meaning(name: str) -> str:
    """Return one line on what a scenario is; ConfigError for an unknown name."""
    return _scenario(name).meaning


def simulate(name: str, seed: int, progress: Callable[[float], None] | None = None) -> SimulatedDrive:
    """Drive a scenario by name; the seed draws its sensors. `progress` hears the share done.

    Same name and seed, same result, bit by bit. ConfigError: unknown name, negative seed.
    """
    scenario = _scenario(name)
    if seed < 0:
        raise ConfigError("can't simulate", [Fault("--seed", f"{seed} is negative; expected 0 or more")])
    return simulate_scenario(name, scenario, seed, drawn_errors(seed), progress)


def drawn_errors(seed: int) -> SensorErrors:
    """Return the sensor errors that `simulate` draws by this seed."""
    return draw_errors(_generator(seed, 0))


def simulate_scenario(
    name: str,
    scenario: Scenario,
    seed: int,
    errors: SensorErrors,
    progress: Callable[[float], None] | None = None,
) -> SimulatedDrive:
    """Drive any scenario with any sensor errors; the seed only makes noise and foreign frames."""
    car, programme = scenario.car, scenario.programme
    if errors.imu_place_m is not None:
        x_m, y_m, z_m = errors.imu_place_m
        car = replace(car, imu_x_m=x_m, imu_y_m=y_m, imu_z_m=z_m)
    start = rolling(car, scenario.start_mps) if scenario.start_mps > 0.0 else None
    columns = drive(TwoTrackCar(car, scenario.road), programme, start=start, progress=progress)
    front_m, rear_m = car.front_wheel_radius_m, car.rear_wheel_radius_m
    radii_m = (front_m, front_m, rear_m, rear_m)
    frames = can_frames(columns, car.steering_ratio, radii_m, errors, _generator(seed, 1))
    if progress is not None:
        progress(1.0)
    parameters = {
        "meaning": scenario.meaning,
        "duration_s": programme.duration_s,
        "car": asdict(car),
        "sensors": asdict(errors),
    }
    truth = truth_columns(columns, errors)
    return SimulatedDrive(name, seed, frames, truth, configuration(car), dbc_files(), parameters)


def truth_columns(columns: Columns, errors: SensorErrors) -> Columns:
    """Return the truth, a row per 10 ms, offsets beside; the last instant is left out."""
    every = round(TRUTH_PERIOD_S / ROW_S)
    rows = (len(columns["time_s"]) - 1) // every
    truth: Columns = {name: column[: rows * every : every] for name, column in columns.items()}
    truth["time_s"] = EPOCH_S + TRUTH_PERIOD_S * np.arange(rows, dtype=np.float64)
    for channel, offset in offset_columns(errors, TRUTH_PERIOD_S * np.arange(rows, dtype=np.float64)).items():
        truth[f"{channel}_offset_{QUANTITIES[channel].suffix}"] = offset
    return {name: truth[name] for name in _TRUTH_COLUMNS}


_TRUTH_COLUMNS = (
    "time_s",
    *(f"{name}_{QUANTITIES[name].suffix}" for name in IMU_CHANNELS),
    *(f"{name}_offset_{QUANTITIES[name].suffix}" for name in IMU_CHANNELS),
    "speed_mps",
    "lateral_velocity_mps",
    "sideslip_rad",
    "roll_rad",
    "pitch_rad",
    "yaw_rad",
    "road_bank_rad",
    "road_grade_up_rad",
    "road_wheel_angle_rad",
    *(f"{name}_mps" for name in WHEEL_SPEEDS),
)


def _generator(seed: int, purpose: int) -> np.random.Generator:
    """Return a stream of its own for each purpose, so that a new one moves no older draw."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(purpose,)))


def _scenario(name: str) -> Scenario:
    scenario = SCENARIOS.get(name)
    if scenario is None:
        near = difflib.get_close_matches(name, SCENARIOS, 1, 0.0)
        known = ", ".join(SCENARIOS)
        raise ConfigError(
            "can't simulate",
            [Fault("SCENARIO", f"unknown scenario {name!r}; did you mean {near[0]!r}? Known: {known}")],
        )
    return scenario
