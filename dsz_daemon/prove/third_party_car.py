"""The third party's car as a recording: sensors, road and CAN coding of the simulated car on another's mechanics.

Its body leans and dives, load goes from wheel to wheel, wheels slip and tyres bend: what the nominal simulation leaves
out of it at any time is `BY_CONSTRUCTION`. The IMU is at the sprung mass's C.G., level on the
car at rest (ISO 8855), which is what a mount is told against.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.compiled import compiled
from dsz_daemon.prove import third_party_model as model
from dsz_daemon.prove.own_car import Changed
from dsz_daemon.prove.ways import Way
from dsz_daemon.sim.bus import configuration, dbc_files
from dsz_daemon.sim.car import TUCSON, Car
from dsz_daemon.sim.coding import can_frames
from dsz_daemon.sim.drive import Columns
from dsz_daemon.sim.effects import Choice, described, with_effects
from dsz_daemon.sim.journey import programme_along, road_along
from dsz_daemon.sim.road import FLAT
from dsz_daemon.sim.scenario import SimulatedDrive
from dsz_daemon.sim.sensors import SensorErrors
from dsz_daemon.sim.world import World

Array = NDArray[np.float64]

# What this car has and the nominal simulation has not, whatever is planted: naming it is right. The stiffness of its
# axles changes with camber, load and lean, which is what mass, stiffness and compliance can't be told from; its axles
# hang on springs sideways, which delays its forces.
BY_CONSTRUCTION = frozenset(
    {"suspension_roll", "suspension_pitch", "wheel_slip", "tyre_saturation", "tyre_relaxation"}
    | {"mass_loading", "cornering_stiffness", "steering_compliance", "track_width"}
)
# What can be put into it: sensors, steering, wheels, road and air. Nobody steers against a slide: no ice.
PLANTED = (
    *("imu_lever_arm", "imu_misalignment", "gyro_scale", "accel_scale", "gyro_cross_axis", "accel_cross_axis"),
    *("gyro_g_sensitivity", "bias_drift", "imu_delay", "steering_delay", "wheel_speed_delay", "sensor_bandwidth"),
    *("sensor_saturation", "road_bank", "road_grade", "wheel_radius", "steering_offset", "steering_ratio"),
    *("steering_backlash", "side_wind"),
)
# Of the drive every second step is kept.
_EVERY = 2
# A driver's hand is never still: rms at the steering wheel, and how long it takes to move.
_WANDER_RAD, _WANDER_S = 0.012, 0.4


class _Course(NamedTuple):
    """What happens at each step: the model's states and their rates (n, 29), front wheels' angle (n,), road, wind.

    `resting_rad`: its body's pitch at rest, nose up, against which the IMU is level.
    """

    states: Array
    changes: Array
    steer_rad: Array
    bank_rad: Array
    grade_rad: Array
    wind_n: Array
    resting_rad: float = 0.0


def simulated(
    way: Way,
    seed: int,
    seconds: float,
    effects: Sequence[Choice],
    errors: SensorErrors,
    changed: Changed = lambda columns: columns,
    as_published: bool = False,
) -> SimulatedDrive:
    """The drive's first seconds, with these effects in it; `errors` are what its sensors get wrong in any case.

    `as_published`: with tyres that shake the car, see the model.
    """
    rng = np.random.default_rng([seed, 7])
    parameters = model.bmw_320i(as_published)
    known = _configured(parameters, round(float(rng.uniform(13.0, 18.0)), 2))
    programme = programme_along(way.legs, way.stand_s, way.start_mps)
    world = with_effects(World(known, FLAT, programme, errors), effects)
    time_s = model.STEP_S * np.arange(round(seconds / model.STEP_S), dtype=np.float64)
    speed_mps, _ = programme.wanted(time_s)
    way_m = np.cumsum(speed_mps) * model.STEP_S
    road = road_along(way.legs)
    bend = np.interp(way_m, road.step_m * np.arange(len(road.bend_per_m)), road.bend_per_m)
    hand_rad = known.steering_ratio * bend * known.wheelbase_m + _wander_rad(rng, len(time_s))
    course = _driven(parameters, world, hand_rad, speed_mps, way_m, time_s)
    columns = _columns(course, world, time_s, hand_rad, parameters)
    kept = changed({name: np.ascontiguousarray(column[::_EVERY]) for name, column in columns.items()})
    frames = can_frames(kept, known.steering_ratio, (parameters.R_w,) * 4, world.errors, rng)
    config = configuration(known)
    config["vehicle"]["driven_axle"] = "rear"
    told: dict[str, Any] = {"effects": described(effects), "sensors": asdict(world.errors)}
    return SimulatedDrive("sealed", seed, frames, kept, config, dbc_files(), told)


def _configured(p: Any, ratio: float) -> Car:
    """What a configuration would say of that car: its mass, axles and inertia, its tyres' slope at the static load."""
    slope = abs(p.tire.p_ky1) * p.m * model.G / (2.0 * (p.a + p.b))
    return replace(
        TUCSON,
        mass_kg=round(p.m, 1),
        cg_to_front_axle_m=round(p.a, 4),
        cg_to_rear_axle_m=round(p.b, 4),
        front_track_m=round(p.T_f, 4),
        rear_track_m=round(p.T_r, 4),
        cg_height_m=round(p.h_cg, 3),
        yaw_inertia_kgm2=round(p.I_z, 1),
        front_cornering_stiffness_n_per_rad=round(slope * p.b),
        rear_cornering_stiffness_n_per_rad=round(slope * p.a),
        front_wheel_radius_m=p.R_w,
        rear_wheel_radius_m=p.R_w,
        steering_ratio=ratio,
        imu_x_m=0.0,
        imu_y_m=0.0,
        imu_z_m=0.0,
    )


def _wander_rad(rng: np.random.Generator, size: int) -> Array:
    """A random course of the steering wheel, low-passed twice."""
    found, keep = rng.normal(0.0, 1.0, size), float(np.exp(-model.STEP_S / _WANDER_S))
    for _ in range(2):
        found = _followed(found, keep)
    return np.asarray(_WANDER_RAD * found / np.std(found), dtype=np.float64)


@compiled
def _followed(values: Array, keep: float) -> Array:
    """One pole."""
    found, state = np.zeros(len(values)), 0.0
    for i in range(len(values)):
        state = keep * state + (1.0 - keep) * values[i]
        found[i] = state
    return found


@compiled
def _played(wanted: Array, play: float) -> Array:
    """What follows through play of this width."""
    found, held = np.zeros(len(wanted)), wanted[0]
    for i in range(len(wanted)):
        held = min(max(held, wanted[i] - 0.5 * play), wanted[i] + 0.5 * play)
        found[i] = held
    return found


def _driven(p: Any, world: World, hand_rad: Array, speed_mps: Array, way_m: Array, time_s: Array) -> _Course:
    """The model's drive; what is left of the model's own axes, is to the right here."""
    car, road = world.car, world.road
    ratio = car.steering_ratio * car.steering_ratio_scale * (1.0 + car.steering_ratio_per_rad * np.abs(hand_rad))
    wheels_rad = _played(hand_rad / ratio, car.steering_backlash_rad) + car.steering_offset_rad
    bank, grade = (np.interp(way_m, road.step_m * np.arange(len(road.tilt)), road.tilt[:, i]) for i in (0, 1))
    wind_n = np.zeros(len(time_s)) if world.programme.side_wind_n is None else world.programme.side_wind_n(time_s)
    states, changes, steer = model.courses(
        *(model.as_numbers(p), -wheels_rad, speed_mps, model.G * np.sin(grade), model.G * np.sin(bank), -wind_n),
        car.steering_compliance_rad_per_n,
    )
    resting_rad = model.resting_rad(model.as_numbers(p))
    return _Course(states, changes, -steer, bank, grade, wind_n, resting_rad)


def _columns(course: _Course, world: World, time_s: Array, hand_rad: Array, p: Any) -> Columns:
    """What perfect instruments would show, ISO 8855: the model's y and z point the other way."""
    states, changes = course.states, course.changes
    along, across, turn = states[:, model.ALONG], -states[:, model.ACROSS], -states[:, model.YAW_RATE]
    ax = changes[:, model.ALONG] - turn * across
    ay = -changes[:, model.ACROSS] + turn * along
    rates, force = _felt(course, ax, ay, -changes[:, model.SINKING], turn)
    place = np.array([world.car.imu_x_m, world.car.imu_y_m, world.car.imu_z_m])
    turning = np.gradient(rates, model.STEP_S, axis=0)
    force = force + np.cross(turning, place) + np.cross(rates, np.cross(rates, place))
    push_nm = p.m * (changes[:, model.ALONG] + model.G * np.sin(course.grade_rad)) * p.R_w
    columns: Columns = {"time_s": time_s}
    for i, axis in enumerate("xyz"):
        columns[f"gyro_{axis}_radps"], columns[f"accel_{axis}_mps2"] = rates[:, i].copy(), force[:, i].copy()
    # Seen from above and behind, the model's left wheels are on the left, too.
    for wheel, state, scale in zip(("fl", "fr", "rl", "rr"), model.WHEELS, world.car.wheel_radius_scale, strict=True):
        columns[f"wheel_speed_{wheel}_mps"] = states[:, state] * p.R_w / scale
    return columns | {
        "steering_wheel_angle_rad": hand_rad,
        "road_wheel_angle_rad": course.steer_rad,
        "drive_torque_nm": np.maximum(push_nm, 0.0),
        "brake_torque_nm": np.maximum(-push_nm, 0.0),
        "speed_mps": along.copy(),
        "lateral_velocity_mps": across.copy(),
        "road_bank_rad": course.bank_rad,
        "road_grade_up_rad": course.grade_rad,
        "side_wind_n": course.wind_n,
        "roll_rad": states[:, model.ROLL].copy(),
        "pitch_rad": _pitch(course),
    }


def _felt(course: _Course, ax: Array, ay: Array, az: Array, turn: Array) -> tuple[Array, Array]:
    """Rates and specific force (n, 3) of the sprung mass along its own axes."""
    states = course.states
    roll, pitch = states[:, model.ROLL], _pitch(course)
    bank, grade = course.bank_rad, course.grade_rad
    # The road's frame tilts under the car, and turns with it.
    tilting = np.column_stack(
        [
            np.gradient(bank, model.STEP_S) + turn * grade,
            turn * bank - np.gradient(grade, model.STEP_S),
            np.zeros(len(turn)),
        ]
    )
    climbing = -tilting[:, 0] * states[:, model.ACROSS] - tilting[:, 1] * states[:, model.ALONG]
    level = np.cos(grade) * np.cos(bank)
    force = np.column_stack(
        [ax + model.G * np.sin(grade), ay + model.G * np.sin(bank), az + climbing + model.G * level]
    )
    # The model's own turning is about its upright axes, one angle after the other.
    turning = np.column_stack([np.zeros(len(turn)), np.zeros(len(turn)), turn])
    own = np.column_stack(
        [states[:, model.ROLL_RATE], -states[:, model.PITCH_RATE] * np.cos(roll), np.zeros(len(turn))]
    )
    own[:, 2] = states[:, model.PITCH_RATE] * np.sin(roll)
    return _in_body(turning + tilting, roll, pitch) + own, _in_body(force, roll, pitch)


def _pitch(course: _Course) -> Array:
    """The body's (n,), nose down, against the car at rest."""
    return np.asarray(course.resting_rad - course.states[:, model.PITCH])


def _in_body(vectors: Array, roll: Array, pitch: Array) -> Array:
    """From axes of the road to the body's: pitched (nose down positive), then rolled (left up positive)."""
    x, y, z = vectors.T
    ahead, up = np.cos(pitch) * x - np.sin(pitch) * z, np.sin(pitch) * x + np.cos(pitch) * z
    return np.column_stack([ahead, np.cos(roll) * y + np.sin(roll) * up, np.cos(roll) * up - np.sin(roll) * y])
