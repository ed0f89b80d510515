"""Effects: what may be true instead of the nominal, one switch a row of the outside's vocabulary.

A `World` is a car on a road with a driver and sensors. `nominal` takes everything out of it that the nominal
simulation leaves out; an effect puts one thing back in, and effects can be put on each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.errors import ConfigError, Fault
from dsz_daemon.signals import ACCEL_CHANNELS, GYRO_CHANNELS, STANDARD_GRAVITY_MPS2
from dsz_daemon.sim.car import Car
from dsz_daemon.sim.driver import Programme
from dsz_daemon.sim.road import FLAT, Road
from dsz_daemon.sim.sensors import Angles, CrossAxis, SensorErrors, Vector3

Array = NDArray[np.float64]
Values = Mapping[str, float]

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
    """Return the same car and driver on a flat road, rigid, linear, without slip or delay; offsets and noise stay.

    The nominal simulation's set of assumptions, put together from mechanics instead of its formulas.
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
    )
    errors = world.errors
    kept = SensorErrors(errors.gyro_offset_radps, errors.accel_offset_mps2, noisy=errors.noisy)
    return World(car, FLAT, replace(world.programme, side_wind_n=None, friction_limit=None), kept)


@dataclass(frozen=True)
class Effect:
    """One row: its name, what it says, its parameters with units and what they are where not given."""

    name: str
    statement: str
    parameters: Mapping[str, tuple[str, float]]
    put_into: Callable[[World, Values], World]


def with_effect(world: World, name: str, **parameters: float) -> World:
    """Return the world with one effect in it; ConfigError for an unknown name or parameter."""
    effect = EFFECTS.get(name)
    if effect is None:
        raise ConfigError(
            "can't simulate", [Fault("effect", f"unknown {name!r}; expected one of {', '.join(EFFECTS)}")]
        )
    wrong = [
        Fault(name, f"unknown parameter {key!r}; expected {', '.join(effect.parameters)}")
        for key in parameters
        if key not in effect.parameters
    ]
    if wrong:
        raise ConfigError("can't simulate", wrong)
    values = {key: value for key, (_, value) in effect.parameters.items()} | parameters
    return effect.put_into(world, values)


# --- where the IMU sits, and what it reads


def _lever_arm(world: World, v: Values) -> World:
    return replace(world, car=replace(world.car, imu_x_m=v["x_m"], imu_y_m=v["y_m"], imu_z_m=v["z_m"]))


def _errors(world: World, **changes: object) -> World:
    return replace(world, errors=replace(world.errors, **changes))  # type: ignore[arg-type]


def _misalignment(world: World, v: Values) -> World:
    angles = Angles(v["roll_rad"], v["pitch_rad"], v["yaw_rad"])
    return _errors(world, imu_misalignment=angles)


def _three(v: Values) -> Vector3:
    return v["x"], v["y"], v["z"]


_LEAKS = ("xy", "xz", "yx", "yz", "zx", "zy")


def _leaks(v: Values) -> CrossAxis:
    return CrossAxis(*(v[name] for name in _LEAKS))


def _axis_fault(world: World, v: Values) -> World:
    """An axis reversed: it reads minus what it should; the offset stays what it is."""
    number = round(v["channel"])
    if not 0 <= number < 6:
        raise ConfigError(
            "can't simulate", [Fault("axis_fault", f"channel {number}; expected 0 (gyro_x) to 5 (accel_z)")]
        )
    factor = v["factor"]
    scale = tuple(factor - 1.0 if axis == number % 3 else 0.0 for axis in range(3))
    return _errors(world, **{"gyro_scale" if number < 3 else "accel_scale": scale})


_NINE = tuple(first + second for first in "xyz" for second in "xyz")


def _g_sensitivity(world: World, v: Values) -> World:
    rows = tuple(tuple(v[first + second] for second in "xyz") for first in "xyz")
    return _errors(world, gyro_g_sensitivity=rows)


_CHANNELS = (*GYRO_CHANNELS, *ACCEL_CHANNELS)


def _drift(world: World, v: Values) -> World:
    per_s = tuple(v[f"{channel}_per_s"] for channel in _CHANNELS)
    return _errors(world, gyro_drift_radps_per_s=per_s[:3], accel_drift_mps2_per_s=per_s[3:])


def _clipped(world: World, v: Values) -> World:
    changes = {key: v[key] for key in ("accel_limit_mps2", "gyro_limit_radps") if math.isfinite(v[key])}
    return _errors(world, **changes)


# --- road and air


def random_profile(rms: float, correlation: float, seed: float) -> Callable[[Array], Array]:
    """Return a smooth zero-mean profile of this root mean square over a distance or a time.

    Forty sines of random phase; their density falls as that of a second-order low-pass at 1/correlation.
    """
    rng = np.random.default_rng(round(seed))
    waves = np.geomspace(0.1, 5.0, 40) / correlation
    density = np.sqrt(np.gradient(waves)) / (1.0 + (waves * correlation) ** 2)
    heights = rms * math.sqrt(2.0) * density / math.sqrt(float(sum((density**2).tolist())))
    phases = rng.uniform(0.0, 2.0 * math.pi, len(waves))

    def profile(at: Array) -> Array:
        total = np.zeros(len(at))
        for wave, height, phase in zip(waves.tolist(), heights.tolist(), phases.tolist(), strict=True):
            total += height * np.sin(wave * at + phase)
        return total

    return profile


def _tilted(road: Road, columns: tuple[int, int], profile: Callable[[Array], Array]) -> Road:
    """The road with a profile added to an angle and its slope; a table fine and long enough is laid under it."""
    step_m, rows = 1.0, 30_000
    at_m: Array = step_m * np.arange(rows, dtype=np.float64)
    tilt, bend, rough = np.zeros((rows, 4)), np.zeros(rows), np.zeros((rows, 4))
    place = np.minimum(at_m / road.step_m, len(road.tilt) - 1.0)
    known = np.arange(len(road.tilt), dtype=np.float64)
    for i in range(4):
        tilt[:, i] = np.interp(place, known, road.tilt[:, i])
        rough[:, i] = np.interp(place, known, road.rough[:, i])
    bend[:] = np.interp(place, known, road.bend_per_m)
    angle, slope = columns
    tilt[:, angle] += profile(at_m)
    tilt[:, slope] += (profile(at_m + 0.01) - profile(at_m - 0.01)) / 0.02
    return Road(step_m, tilt, bend, rough)


def _bank(world: World, v: Values) -> World:
    profile = random_profile(v["rms_rad"], v["correlation_m"], v["seed"])
    return replace(world, road=_tilted(world.road, (0, 2), profile))


def _grade(world: World, v: Values) -> World:
    profile = random_profile(v["rms_rad"], v["correlation_m"], v["seed"])
    return replace(world, road=_tilted(world.road, (1, 3), profile))


def _wind(world: World, v: Values) -> World:
    gusts = random_profile(v["rms_n"], v["correlation_s"], v["seed"])
    return replace(world, programme=replace(world.programme, side_wind_n=gusts))


# --- body, tyres, wheels and steering


def _leaning(world: World, v: Values) -> World:
    """Springs and bars for this gradient: K k = m h (1 + g k), the springs' part left as it is."""
    car, k = world.car, v["roll_gradient_rad_per_mps2"]
    stiffness = car.mass_kg * car.cg_height_m * (1.0 + STANDARD_GRAVITY_MPS2 * k) / k
    springs = 0.5 * (car.front_spring_n_per_m * car.front_track_m**2 + car.rear_spring_n_per_m * car.rear_track_m**2)
    share = car.front_bar_nm_per_rad / (car.front_bar_nm_per_rad + car.rear_bar_nm_per_rad)
    bars = stiffness - springs
    changed = replace(car, leans=True, front_bar_nm_per_rad=share * bars, rear_bar_nm_per_rad=(1.0 - share) * bars)
    return replace(world, car=changed)


def _diving(world: World, v: Values) -> World:
    """All springs and dampers by one factor, for this gradient against the C.G. over the axles' springs."""
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
    return replace(world, car=changed)


def _slippery(world: World, v: Values) -> World:
    start_s, end_s, level = v["start_s"], v["end_s"], v["friction_coefficient"]

    def limit(t_s: Array) -> Array:
        return np.where((t_s >= start_s) & (t_s < end_s), level, math.inf)

    return replace(world, programme=replace(world.programme, friction_limit=limit))


def _loaded(world: World, v: Values) -> World:
    car, shift = world.car, v["cg_shift_m"]
    changed = replace(
        car,
        mass_kg=car.mass_kg + v["added_mass_kg"],
        cg_to_front_axle_m=car.cg_to_front_axle_m - shift,
        cg_to_rear_axle_m=car.cg_to_rear_axle_m + shift,
        imu_x_m=car.imu_x_m - shift,
    )
    return replace(world, car=changed)


def _slip(world: World, v: Values) -> World:
    car = world.car
    mean_n = 0.5 * (car.front_static_load_n + car.rear_static_load_n)
    return replace(world, car=replace(car, slips=True, slip_stiffness_n=mean_n / v["slip_per_force"]))


def _stiffness(world: World, v: Values) -> World:
    car = world.car
    changed = replace(
        car,
        front_cornering_stiffness_n_per_rad=car.front_cornering_stiffness_n_per_rad * v["front_scale"],
        rear_cornering_stiffness_n_per_rad=car.rear_cornering_stiffness_n_per_rad * v["rear_scale"],
    )
    return replace(world, car=changed)


def _car(**fields: str) -> Callable[[World, Values], World]:
    """What sets fields of the car to parameters."""

    def put_into(world: World, v: Values) -> World:
        changes = {field: v[parameter] for field, parameter in fields.items()}
        return replace(world, car=replace(world.car, **changes))  # type: ignore[arg-type]

    return put_into


def _delayed(field: str) -> Callable[[World, Values], World]:
    return lambda world, v: _errors(world, **{field: v["delay_s"]})


def _radii(world: World, v: Values) -> World:
    return replace(world, car=replace(world.car, wheel_radius_scale=(v["fl"], v["fr"], v["rl"], v["rr"])))


_ROWS = (
    Effect("imu_lever_arm", "the IMU sits off the C.G.",
           {"x_m": ("m", 0.5), "y_m": ("m", 0.3), "z_m": ("m", -0.2)}, _lever_arm),
    Effect("imu_misalignment", "its axes are turned",
           {"roll_rad": ("rad", 0.02), "pitch_rad": ("rad", 0.02), "yaw_rad": ("rad", 0.03)}, _misalignment),
    Effect("axis_fault", "an axis is reversed, or its unit is wrong: it reads this multiple",
           {"channel": ("number, gyro_x 0 to accel_z 5", 4.0), "factor": ("1", -1.0)}, _axis_fault),
    Effect("gyro_scale", "sensitivity error of the gyros", dict.fromkeys("xyz", ("1", 0.05)),
           lambda world, v: _errors(world, gyro_scale=_three(v))),
    Effect("accel_scale", "sensitivity error of the accelerometers", dict.fromkeys("xyz", ("1", 0.05)),
           lambda world, v: _errors(world, accel_scale=_three(v))),
    Effect("gyro_cross_axis", "one gyro's axis leaks into another's", dict.fromkeys(_LEAKS, ("1", 0.03)),
           lambda world, v: _errors(world, gyro_cross_axis=_leaks(v))),
    Effect("accel_cross_axis", "one accelerometer's axis leaks into another's", dict.fromkeys(_LEAKS, ("1", 0.03)),
           lambda world, v: _errors(world, accel_cross_axis=_leaks(v))),
    Effect("gyro_g_sensitivity", "acceleration moves the gyros", dict.fromkeys(_NINE, ("rad s/m", 5e-4)),
           _g_sensitivity),
    Effect("bias_drift", "offsets move with time",
           {f"{channel}_per_s": ("unit/s", 2e-5 if channel in GYRO_CHANNELS else 1e-3) for channel in _CHANNELS},
           _drift),
    Effect("imu_delay", "the IMU arrives late", {"delay_s": ("s", 0.05)}, _delayed("imu_delay_s")),
    Effect("steering_delay", "the steering angle arrives late", {"delay_s": ("s", 0.08)},
           _delayed("steering_delay_s")),
    Effect("wheel_speed_delay", "the wheel speeds arrive late", {"delay_s": ("s", 0.1)},
           _delayed("wheel_speed_delay_s")),
    Effect("sensor_bandwidth", "first-order low-pass on the IMU", {"cutoff_hz": ("Hz", 2.0)},
           lambda world, v: _errors(world, imu_cutoff_hz=v["cutoff_hz"])),
    Effect("sensor_saturation", "readings clip",
           {"accel_limit_mps2": ("m/s^2", 3.0), "gyro_limit_radps": ("rad/s", math.inf)}, _clipped),
    Effect("road_bank", "the road tilts sideways",
           {"rms_rad": ("rad", 0.03), "correlation_m": ("m", 60.0), "seed": ("1", 1.0)}, _bank),
    Effect("road_grade", "the road goes up and down",
           {"rms_rad": ("rad", 0.03), "correlation_m": ("m", 60.0), "seed": ("1", 2.0)}, _grade),
    Effect("suspension_roll", "the body leans and gravity leaks in",
           {"roll_gradient_rad_per_mps2": ("rad s^2/m", 0.0107)}, _leaning),
    Effect("suspension_pitch", "the body dives and squats and gravity leaks in",
           {"pitch_gradient_rad_per_mps2": ("rad s^2/m", 0.006)}, _diving),
    Effect("tyre_saturation", "grip is limited", {"friction_coefficient": ("1", 0.9)},
           _car(friction="friction_coefficient")),
    Effect("low_friction", "grip is limited for a while",
           {"friction_coefficient": ("1", 0.4), "start_s": ("s", 10.0), "end_s": ("s", 30.0)}, _slippery),
    Effect("tyre_relaxation", "lateral force builds up over distance", {"relaxation_length_m": ("m", 0.8)},
           _car(lateral_relaxation_m="relaxation_length_m")),
    Effect("wheel_slip", "driven and braked wheels slip", {"slip_per_force": ("1", 0.05)}, _slip),
    Effect("wheel_radius", "radii are not as configured",
           {"fl": ("1", 1.01), "fr": ("1", 1.0), "rl": ("1", 0.99), "rr": ("1", 1.0)}, _radii),
    Effect("steering_offset", "zero is not straight ahead", {"offset_rad": ("rad", 0.005)},
           _car(steering_offset_rad="offset_rad")),
    Effect("steering_ratio", "another, or a varying, ratio", {"scale": ("1", 1.1), "per_rad": ("1/rad", 0.0)},
           _car(steering_ratio_scale="scale", steering_ratio_per_rad="per_rad")),
    Effect("steering_compliance", "front wheels give way under load", {"rad_per_n": ("rad/N", 2e-6)},
           _car(steering_compliance_rad_per_n="rad_per_n")),
    Effect("steering_backlash", "play", {"width_rad": ("rad at the road wheel", 0.01)},
           _car(steering_backlash_rad="width_rad")),
    Effect("side_wind", "an air side force",
           {"rms_n": ("N", 400.0), "correlation_s": ("s", 0.5), "seed": ("1", 3.0)}, _wind),
    Effect("mass_loading", "mass and C.G. differ", {"added_mass_kg": ("kg", 300.0), "cg_shift_m": ("m", -0.15)},
           _loaded),
    Effect("cornering_stiffness", "stiffness differs", {"front_scale": ("1", 0.8), "rear_scale": ("1", 1.1)},
           _stiffness),
)  # fmt: skip

EFFECTS: Mapping[str, Effect] = {effect.name: effect for effect in _ROWS}
