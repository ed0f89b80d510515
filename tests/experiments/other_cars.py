"""Recordings of cars that nothing else in the project knows: another simulator, a car, sensors and a DBC by the seed.

    python tests/experiments/other_cars.py FOLDER --seed 7 --drive highway imu_lever_arm:x_m=0.4 road_grade

writes car.dbc, config.yaml, recording.log and truth.json (and profiles.npz). Without effects it is the nominal world:
a car that lies flat on a flat road, with linear tyres. How it is drawn beyond that is the seed's: two wheels or four,
sines or small angles, driving force along the wheels or the car, how sensors count and how often. It shares no formula
with the project. Steering and speed are given: nobody steers against what an effect does.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from other_drives import DT, rolling, smooth, wanted
from other_motion import leaning, simulated
from other_sensors import IMU, WHEELS, Get, sensed, write

Floats = np.ndarray[Any, np.dtype[np.float64]]
Effects = Mapping[str, Mapping[str, float]]

GRAVITY = 9.81

# What an effect is at size 1; what stands at 1 when nothing is left out is in `_AT_ONE`.
PLAIN: dict[str, dict[str, float]] = {
    "imu_lever_arm": {"x_m": 0.5, "y_m": 0.3, "z_m": -0.2},
    "imu_misalignment": {"roll_rad": 0.02, "pitch_rad": 0.02, "yaw_rad": 0.03},
    "gyro_scale": {"x": 0.05, "y": 0.05, "z": 0.05},
    "accel_scale": {"x": 0.05, "y": 0.05, "z": 0.05},
    "gyro_cross_axis": dict.fromkeys(("xy", "xz", "yx", "yz", "zx", "zy"), 0.03),
    "accel_cross_axis": dict.fromkeys(("xy", "xz", "yx", "yz", "zx", "zy"), 0.03),
    "gyro_g_sensitivity": {a + b: 5e-4 for a in "xyz" for b in "xyz"},
    "bias_drift": {name: 2e-5 if name.startswith("g") else 1e-3 for name in IMU},
    "imu_delay": {"delay_s": 0.05},
    "steering_delay": {"delay_s": 0.08},
    "wheel_speed_delay": {"delay_s": 0.1},
    "sensor_bandwidth": {"cutoff_hz": 2.0},
    "sensor_saturation": {"accel_limit_mps2": 2.0},
    "road_bank": {"rms_rad": 0.03},
    "road_grade": {"rms_rad": 0.03},
    "suspension_roll": {"roll_gradient_rad_per_mps2": 0.0107},
    "suspension_pitch": {"pitch_gradient_rad_per_mps2": 0.006},
    "tyre_saturation": {"friction_coefficient": 0.5},
    "low_friction": {"friction_coefficient": 0.35, "start_s": 50.0, "end_s": 95.0},
    "tyre_relaxation": {"relaxation_length_m": 0.8},
    "wheel_slip": {"slip_per_force": 0.05},
    "wheel_radius": {"fl": 1.01, "fr": 1.0, "rl": 0.99, "rr": 1.0},
    "steering_offset": {"offset_rad": 0.005},
    "steering_ratio": {"scale": 1.1},
    "steering_compliance": {"rad_per_n": 2e-6},
    "steering_backlash": {"width_rad": 0.01},
    "side_wind": {"rms_n": 400.0},
    "mass_loading": {"added_mass_kg": 300.0, "cg_shift_m": -0.15},
    "cornering_stiffness": {"front_scale": 0.75, "rear_scale": 1.15},
    # None of the vocabulary's.
    "unlisted_vibration": {"accel_x_per_v2": 4e-4},
    "unlisted_drag_of_trailer": {"yaw_per_ay_cubed": 4e-4},
    "unlisted_magnet": {"wheel_rl_per_v2": 1e-3},
}
_AT_ONE = {"wheel_radius", "steering_ratio", "cornering_stiffness"}


def at_size(effect: str, size: float) -> dict[str, float]:
    """The effect's parameters, so much nearer to nothing."""
    found = {}
    for key, value in PLAIN[effect].items():
        neutral = 1.0 if effect in _AT_ONE else 0.0
        found[key] = neutral + size * (value - neutral)
        if key == "cutoff_hz":
            found[key] = value / size
        elif key in {"friction_coefficient", "accel_limit_mps2"}:
            found[key] = value / size**0.5
        elif key in {"start_s", "end_s"}:
            found[key] = value
    return found


class Style(NamedTuple):
    """How a car is drawn that has nothing left out."""

    four_wheels: bool
    small_angles: bool
    pull_with_wheels: bool
    hasty: bool


class Car(NamedTuple):
    """A car; stiffness in N/rad of one tyre."""

    mass: float
    inertia: float
    to_front: float
    to_rear: float
    track_front: float
    track_rear: float
    height: float
    stiff_front: float
    stiff_rear: float
    ratio: float
    driven: str
    radius_front: float
    radius_rear: float


def drawn_car(rng: np.random.Generator) -> Car:
    """A car that understeers."""
    mass, base = rng.uniform(1100.0, 2300.0), rng.uniform(2.45, 3.05)
    front = base * rng.uniform(0.41, 0.52)
    rear = base - front
    stiff_rear = 0.5 * mass * GRAVITY * front / base * rng.uniform(12.0, 18.0)
    gradient = rng.uniform(0.0015, 0.005)
    stiff_front = 0.5 * mass * rear / base / (gradient + 0.5 * mass * front / base / stiff_rear)
    return Car(
        round(mass),
        round(mass * front * rear * rng.uniform(0.9, 1.15)),
        round(front, 3),
        round(rear, 3),
        round(rng.uniform(1.46, 1.64), 3),
        round(rng.uniform(1.46, 1.64), 3),
        round(rng.uniform(0.5, 0.7), 2),
        round(stiff_front),
        round(stiff_rear),
        round(rng.uniform(12.0, 18.0), 2),
        str(rng.choice(["front", "rear", "all"])),
        round(rng.uniform(0.29, 0.36), 3),
        round(rng.uniform(0.29, 0.36), 3),
    )


class Road(NamedTuple):
    """Over time (n,): bank (left side high) and grade (uphill), rad; the air's side force, N."""

    bank: Floats
    grade: Floats
    wind: Floats


def make(folder: Path, seed: int, kind: str, effects: Effects, seconds: float = 150.0) -> None:
    """Writes car.dbc, config.yaml, recording.log, truth.json and profiles.npz."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    car = drawn_car(rng)
    style = Style(*(bool(rng.random() < share) for share in (0.5, 0.3, 0.5, 0.3)))
    speed, bend = wanted(rng, kind, seconds)
    base = car.to_front + car.to_rear
    understeer = 0.5 * car.mass / base * (car.to_rear / car.stiff_front - car.to_front / car.stiff_rear)
    wander = smooth(rng.normal(0.0, 1.0, len(speed)), 0.4)
    hand = car.ratio * bend * (base + understeer * speed**2)
    hand += math.radians(0.7) * wander / np.std(wander) * np.minimum(speed / 5.0, 1.0)

    def get(effect: str, key: str, default: float = 0.0) -> float:
        return float(effects.get(effect, {}).get(key, default))

    own = np.random.default_rng([seed, 1])
    along, time = np.cumsum(speed) * DT, DT * np.arange(len(speed))
    road = Road(
        *(
            smooth(rolling(own, over, get(effect, key), scale), 0.1)
            for effect, key, over, scale in (
                ("road_bank", "rms_rad", along, 30.0),
                ("road_grade", "rms_rad", along, 30.0),
                ("side_wind", "rms_n", time, 1.0),
            )
        )
    )
    channels = world(own, car, style, speed, hand, road, get)
    limit = get("sensor_saturation", "accel_limit_mps2", math.inf)
    signals = write(np.random.default_rng([seed, 2]), folder, channels, limit)
    vehicle = _configured(car)
    (folder / "config.yaml").write_text(yaml.safe_dump({"vehicle": vehicle, "signals": signals}))
    told = {name: dict(values) for name, values in effects.items()}
    moving = speed > 3.0
    for effect, key, course in zip(
        ("road_bank", "road_grade", "side_wind"), ("rms_rad", "rms_rad", "rms_n"), road, strict=True
    ):
        if effect in told:
            told[effect][key] = float(np.sqrt(np.mean(course[moving if effect == "side_wind" else slice(None)] ** 2)))
    (folder / "truth.json").write_text(json.dumps(told))
    every = slice(None, None, 5)
    np.savez(
        folder / "profiles.npz", **{name: course[every] for name, course in road._asdict().items()}, time=time[every]
    )


def world(
    rng: np.random.Generator, car: Car, style: Style, speed: Floats, hand: Floats, road: Road, get: Get
) -> dict[str, Floats]:
    """What each sensor would show if it were ideal but for the effects (n,), at DT."""
    time = DT * np.arange(len(speed))
    added, shift = get("mass_loading", "added_mass_kg"), get("mass_loading", "cg_shift_m")
    mass, lf, lr = car.mass + added, car.to_front - shift, car.to_rear + shift
    accel = np.gradient(speed, DT)
    friction = np.full(len(speed), get("tyre_saturation", "friction_coefficient"))
    inside = (time >= get("low_friction", "start_s")) & (time < get("low_friction", "end_s"))
    friction = np.where(inside, get("low_friction", "friction_coefficient"), friction)
    driven = {"front": 1.0, "rear": 0.0, "all": lr / (lf + lr)}[car.driven]
    push = mass * (accel + GRAVITY * np.sin(road.grade))
    front_push = np.where(push > 0.0, driven, lr / (lf + lr)) * push
    numbers = np.array(
        [
            *(mass, car.inertia, lf, lr),
            car.stiff_front * get("cornering_stiffness", "front_scale", 1.0),
            car.stiff_rear * get("cornering_stiffness", "rear_scale", 1.0),
            *(car.track_front, car.track_rear),
            get("tyre_relaxation", "relaxation_length_m"),
            get("steering_compliance", "rad_per_n"),
            get("steering_backlash", "width_rad"),
        ]
    )
    steer = hand / (car.ratio * get("steering_ratio", "scale", 1.0)) + get("steering_offset", "offset_rad")
    m = simulated(
        *(steer, speed, road.bank, road.wind, friction, front_push, numbers, int(rng.integers(3))),
        *(style.four_wheels, style.small_angles, style.pull_with_wheels, 0 if style.hasty else 1),
    )
    rates, force = _felt(rng, speed, accel, m, road, shift, get)
    channels = dict(zip(IMU, sensed(rates, force, time, get).T, strict=True))
    vy, r, delta = m[:, 0], m[:, 1], m[:, 5]
    slips = get("wheel_slip", "slip_per_force") / (mass * GRAVITY)
    front_slip = slips * front_push * (lf + lr) / lr
    rear_slip = slips * (push - front_push) * (lf + lr) / lf
    magnet = get("unlisted_magnet", "wheel_rl_per_v2") * speed**2
    wheels = {
        "fl": ((speed - 0.5 * car.track_front * r) * np.cos(delta) + (vy + lf * r) * np.sin(delta))
        * (1.0 + front_slip),
        "fr": ((speed + 0.5 * car.track_front * r) * np.cos(delta) + (vy + lf * r) * np.sin(delta))
        * (1.0 + front_slip),
        "rl": (speed - 0.5 * car.track_rear * r) * (1.0 + rear_slip) + magnet,
        "rr": (speed + 0.5 * car.track_rear * r) * (1.0 + rear_slip),
    }
    late_s = get("wheel_speed_delay", "delay_s")
    for wheel, rolled in wheels.items():
        channels[f"wheel_speed_{wheel}"] = np.interp(time - late_s, time, rolled / get("wheel_radius", wheel, 1.0))
    channels["steering_wheel_angle"] = np.interp(time - get("steering_delay", "delay_s"), time, hand)
    channels["accel_x"] = channels["accel_x"] + get("unlisted_vibration", "accel_x_per_v2") * speed**2
    across = m[:, 2] + r * speed
    channels["gyro_z"] = channels["gyro_z"] + get("unlisted_drag_of_trailer", "yaw_per_ay_cubed") * across**3
    return channels


def _felt(
    rng: np.random.Generator, speed: Floats, accel: Floats, m: Floats, road: Road, shift: float, get: Get
) -> tuple[Floats, Floats]:
    """Rates and specific force (n, 3) at the IMU's place, in the body's axes."""
    vy, r, vy_rate, r_rate, _, _ = m.T
    ax, ay = accel - r * vy, vy_rate + r * speed
    roll_gradient = get("suspension_roll", "roll_gradient_rad_per_mps2")
    springs = rng.uniform([8.0, 0.2], [12.0, 0.5], (2, 2)).tolist()
    lean = leaning(roll_gradient * ay, *springs[0])
    dive = leaning(-get("suspension_pitch", "pitch_gradient_rad_per_mps2") * ax, *springs[1])
    # Body angles against the horizon: left side up, nose down.
    phi, theta = road.bank + lean[:, 0], dive[:, 0] - road.grade
    road_p = np.gradient(road.bank, DT) + r * road.grade
    road_q = r * road.bank - np.gradient(road.grade, DT)
    rates = np.column_stack([road_p + lean[:, 1] - r * dive[:, 0], road_q + dive[:, 1] + r * lean[:, 0], r])
    az = road_p * vy - road_q * speed
    force = np.column_stack(
        [
            ax - GRAVITY * np.sin(theta) - az * dive[:, 0],
            ay + GRAVITY * np.sin(phi) + az * lean[:, 0],
            az + GRAVITY * np.cos(phi) * np.cos(theta) + ax * dive[:, 0] - ay * lean[:, 0],
        ]
    )
    height_m = float(rng.choice([0.0, 0.35]))
    if roll_gradient:
        force[:, 1] -= height_m * lean[:, 2]
    lever = np.array([get("imu_lever_arm", f"{a}_m") for a in "xyz"]) - np.array([shift, 0.0, 0.0])
    turning = np.column_stack([np.gradient(rates[:, 0], DT), np.gradient(rates[:, 1], DT), r_rate])
    return rates, force + np.cross(turning, lever) + np.cross(rates, np.cross(rates, lever))


def _configured(car: Car) -> dict[str, Any]:
    return {
        "mass_kg": car.mass,
        "yaw_inertia_kgm2": car.inertia,
        "cg_to_front_axle_m": car.to_front,
        "cg_to_rear_axle_m": car.to_rear,
        "front_track_m": car.track_front,
        "rear_track_m": car.track_rear,
        "cg_height_m": car.height,
        "front_cornering_stiffness_n_per_rad": car.stiff_front,
        "rear_cornering_stiffness_n_per_rad": car.stiff_rear,
        "steering_ratio": car.ratio,
        "driven_axle": car.driven,
        "wheel_radius_m": {w: car.radius_front if w[0] == "f" else car.radius_rear for w in WHEELS},
    }


def parsed(words: Sequence[str]) -> dict[str, dict[str, float]]:
    """NAME, NAME@SIZE or NAME:key=value,... as parameters."""
    found = {}
    for word in words:
        name, _, rest = word.partition(":")
        name, _, size = name.partition("@")
        found[name] = at_size(name, float(size or 1.0))
        if rest:
            found[name] = {key: float(value) for key, value in (pair.split("=") for pair in rest.split(","))}
    return found


def main() -> None:
    """Makes one recording."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path)
    parser.add_argument("effects", nargs="*", metavar="EFFECT")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--drive", choices=["city", "highway"], default="city")
    asked = parser.parse_intermixed_args()
    make(asked.folder, asked.seed, asked.drive, parsed(asked.effects))


if __name__ == "__main__":
    main()
