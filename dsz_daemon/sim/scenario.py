"""One call that drives a scenario of the catalogue, and hands out frames, truth and what reading them takes.

With effects (`effects.py`) another car drives, or another road or sensor; the configuration stays that of the
catalogue's car.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from dsz_daemon.errors import ConfigError, Fault
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES, WHEEL_SPEEDS
from dsz_daemon.sim.bus import configuration, dbc_files
from dsz_daemon.sim.car import Car
from dsz_daemon.sim.catalogue import SCENARIOS, Scenario
from dsz_daemon.sim.coding import EPOCH_S, Series, can_frames, signal_series
from dsz_daemon.sim.drive import ROW_S, Columns, drive
from dsz_daemon.sim.effect_words import choices
from dsz_daemon.sim.effects import Choice, described, faults, with_effects
from dsz_daemon.sim.imu import offset_columns
from dsz_daemon.sim.path import path
from dsz_daemon.sim.sensor_draws import draw_errors
from dsz_daemon.sim.sensors import SensorErrors
from dsz_daemon.sim.vehicle import TwoTrackCar, rolling
from dsz_daemon.sim.world import World, nominal

TRUTH_PERIOD_S = 0.01
# Chosen: five times g; no car that keeps to a road feels more.
MOST_FELT_MPS2 = 50.0


@dataclass(frozen=True, eq=False)
class SimulatedDrive:
    """What one simulation hands out, ready to be written or played.

    `frames` in time order; `truth` columns of equal length, a row per 10 ms on the log's
    clock; `config` and `dbc_files` are all that reading `frames` takes; `parameters` is what
    was true (the car, the drawn sensor errors, the effects), as plain data.
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
    return checked(name, 0)[0].meaning


def simulate(
    name: str,
    seed: int,
    progress: Callable[[float], None] | None = None,
    effects: Sequence[str] = (),
    from_nominal: bool = False,
) -> SimulatedDrive:
    """Drive a scenario by name; the seed draws its sensors. `progress` hears the share done.

    `effects`: each as `effect_words.choices` reads it; with `from_nominal` they are put into the nominal world.
    Same call, same result, bit by bit. ConfigError: see `checked`.
    """
    scenario, chosen = checked(name, seed, effects)
    return simulate_scenario(name, scenario, seed, drawn_errors(seed), progress, chosen, from_nominal)


def checked(name: str, seed: int, effects: Sequence[str] = ()) -> tuple[Scenario, list[Choice]]:
    """Return the scenario and the effects. ConfigError, all at once: unknown names, negative seed, wrong effects."""
    found = SCENARIOS.get(name)
    wrong = [] if found is not None else [_unknown(name)]
    if seed < 0:
        wrong.append(Fault("--seed", f"{seed} is negative; expected 0 or more"))
    chosen, no_form = choices(effects)
    wrong += no_form + faults(chosen)
    if wrong or found is None:
        raise ConfigError("can't simulate", wrong)
    return found, chosen


def drawn_errors(seed: int) -> SensorErrors:
    """Return the sensor errors that `simulate` draws by this seed."""
    return draw_errors(_generator(seed, 0))


def simulate_scenario(
    name: str,
    scenario: Scenario,
    seed: int,
    errors: SensorErrors,
    progress: Callable[[float], None] | None = None,
    effects: Sequence[Choice] = (),
    from_nominal: bool = False,
) -> SimulatedDrive:
    """Drive any scenario with any sensor errors; the seed only makes noise and foreign frames.

    ConfigError: wrong effects, or such that the car flies apart.
    """
    known = scenario.car  # what controllers reckon with, and the configuration says
    world = _world(scenario, errors)
    world = with_effects(nominal(world) if from_nominal else world, effects)
    car, errors = world.car, world.errors
    start = rolling(car, scenario.start_mps) if scenario.start_mps > 0.0 else None
    columns = drive(TwoTrackCar(car, world.road), world.programme, start=start, progress=progress)
    _holds(columns)
    frames = can_frames(columns, known.steering_ratio, _radii_m(known), errors, _generator(seed, 1))
    if progress is not None:
        progress(1.0)
    parameters = {
        "meaning": scenario.meaning,
        "duration_s": scenario.programme.duration_s,
        "nominal": from_nominal,
        "effects": described(effects),
        "car": asdict(car),
        "sensors": asdict(errors),
    }
    truth = truth_columns(columns, errors)
    return SimulatedDrive(name, seed, frames, truth, configuration(known), dbc_files(), parameters)


def _world(scenario: Scenario, errors: SensorErrors) -> World:
    """The scenario's world; a place of the IMU that was drawn is the car's then."""
    car = scenario.car
    if errors.imu_place_m is not None:
        x_m, y_m, z_m = errors.imu_place_m
        car = replace(car, imu_x_m=x_m, imu_y_m=y_m, imu_z_m=z_m)
        errors = replace(errors, imu_place_m=None)
    return World(car, scenario.road, scenario.programme, errors)


def _holds(columns: Columns) -> None:
    """ConfigError where the car is none any more: the equations are those of one that keeps to its road."""
    felt = np.column_stack([columns[f"accel_{axis}_mps2"] for axis in "xyz"])
    # Turned round: what isn't a number is no less than anything.
    lost = ~(np.abs(felt).max(axis=1) < MOST_FELT_MPS2)
    if lost.any():
        t_s = columns["time_s"][int(np.argmax(lost))]
        what = f"the car is thrown about at {t_s:.1f} s (more than {MOST_FELT_MPS2:g} m/s^2)"
        raise ConfigError("can't simulate", [Fault("--effect", f"{what}; expected weaker effects")])


def series_of(scenario: Scenario, columns: Columns, errors: SensorErrors, seed: int) -> list[Series]:
    """Return what `simulate_scenario` packs into frames: raw values and stamps, message by message."""
    car = scenario.car
    return signal_series(columns, car.steering_ratio, _radii_m(car), errors, _generator(seed, 1))


def _radii_m(car: Car) -> tuple[float, float, float, float]:
    return car.front_wheel_radius_m, car.front_wheel_radius_m, car.rear_wheel_radius_m, car.rear_wheel_radius_m


def truth_columns(columns: Columns, errors: SensorErrors) -> Columns:
    """Return the truth, a row per 10 ms, offsets beside; the last instant is left out.

    Motion is that of the true car, whatever the effects. `gyro_*` and `accel_*` are what a perfect instrument would
    show at the IMU's true place (with a lever arm: there, not at the C.G.) along the vehicle's axes (not those of an
    IMU that is turned). `speed_mps`, `lateral_velocity_mps` and `sideslip_rad` are those of the true C.G. (with a
    load: where that is now). `wheel_speed_*` are what its controller would show without poles and noise: the wheel's
    spin times the configured radius. `road_wheel_angle_rad` is that of the front wheels themselves. `*_offset_*` is
    what a channel reads of no motion: the null error as drawn and drifting, of the sensor that is plugged in there;
    scale, leaks, misalignment and delay are in no column. `east_m`, `north_m` and `height_m` are the way of the C.G.
    over the ground, the first heading being east.
    """
    every = round(TRUTH_PERIOD_S / ROW_S)
    rows = (len(columns["time_s"]) - 1) // every
    truth: Columns = {name: column[: rows * every : every] for name, column in columns.items()}
    truth["time_s"] = EPOCH_S + TRUTH_PERIOD_S * np.arange(rows, dtype=np.float64)
    for channel, offset in offset_columns(errors, TRUTH_PERIOD_S * np.arange(rows, dtype=np.float64)).items():
        truth[f"{channel}_offset_{QUANTITIES[channel].suffix}"] = offset
    truth |= path(
        truth["speed_mps"],
        truth["lateral_velocity_mps"],
        truth["yaw_rad"],
        truth["road_bank_rad"],
        truth["road_grade_up_rad"],
        TRUTH_PERIOD_S,
    )
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
    "steering_wheel_angle_rad",
    "distance_m",
    "east_m",
    "north_m",
    "height_m",
    "side_wind_n",
    "friction",
)


def _generator(seed: int, purpose: int) -> np.random.Generator:
    """Return a stream of its own for each purpose, so that a new one moves no older draw."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(purpose,)))


def _unknown(name: str) -> Fault:
    near = difflib.get_close_matches(name, SCENARIOS, 1, 0.0)
    known = ", ".join(SCENARIOS)
    return Fault("SCENARIO", f"unknown scenario {name!r}; did you mean {near[0]!r}? Known: {known}")
