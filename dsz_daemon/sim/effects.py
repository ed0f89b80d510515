"""Effects: what may be true instead of the nominal, one switch a row of the outside's vocabulary.

An effect puts one thing into a world, nominal or not; effects can be put on each other, and the order in which they
are given does not matter: `with_effects` puts them in as the table has them. The configuration knows none of them.
What they do is in `effects_of_sensors.py`, `effects_of_surroundings.py` and `effects_of_the_car.py`.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from dsz_daemon.errors import ConfigError, Fault
from dsz_daemon.signals import GYRO_CHANNELS
from dsz_daemon.sim import effects_of_sensors as sensors
from dsz_daemon.sim import effects_of_surroundings as surroundings
from dsz_daemon.sim import effects_of_the_car as cars
from dsz_daemon.sim.effects_of_sensors import CHANNELS, PutInto, Values
from dsz_daemon.sim.world import World

Value = float | str


class Parameter(NamedTuple):
    """One parameter of an effect.

    `default`: where the effect is named alone; None leaves it as it is in the world. Once any parameter is given,
    those that aren't stay as they are, too, but for those of which `always` is true: they have their default then as
    well (they say how, not how much). A parameter with `words` takes one of them, or its number.
    """

    unit: str
    default: float | None
    least: float
    most: float
    always: bool = False
    words: tuple[str, ...] = ()


def _nothing_wrong(_: Values) -> str:
    return ""


@dataclass(frozen=True)
class Effect:
    """One row: its name, what is true instead of the nominal, its parameters, and what puts it into a world.

    `wrong` tells what can't be of values that are good one by one; `repeats`: it may be there more than once.
    """

    name: str
    statement: str
    parameters: Mapping[str, Parameter]
    put_into: PutInto
    wrong: Callable[[Values], str] = _nothing_wrong
    repeats: bool = False


class Choice(NamedTuple):
    """An effect that was chosen, and the parameters that were given."""

    name: str
    given: Mapping[str, Value] = {}


_SHARE = Parameter("1", 0.05, -0.9, 10.0)
_SEED = {"seed": Parameter("1", 1.0, 0.0, 1e9, always=True)}
_TILT = {
    "rms_rad": Parameter("rad", 0.03, 0.0, 0.3, always=True),
    "correlation_m": Parameter("m", 60.0, 5.0, 1e4, always=True),
}
_DRIFT = {
    **{f"{name}_per_s": Parameter("rad/s/s" if name in GYRO_CHANNELS else "m/s^2/s",
                                  2e-5 if name in GYRO_CHANNELS else 1e-3, -1.0, 1.0) for name in CHANNELS},
    **{f"{name}_per_k": Parameter("rad/s/K" if name in GYRO_CHANNELS else "m/s^2/K", None, -1.0, 1.0)
       for name in CHANNELS},
    # The IMU's temperature: as that of a body that warms up. Chosen: a winter's morning would be more.
    "start_c": Parameter("degC", 20.0, -60.0, 150.0, always=True),
    "end_c": Parameter("degC", 45.0, -60.0, 150.0, always=True),
    "time_constant_s": Parameter("s", 300.0, 0.1, 1e6, always=True),
}  # fmt: skip


def _all(names: Iterable[str], parameter: Parameter) -> dict[str, Parameter]:
    return dict.fromkeys(names, parameter)


_ROWS = (
    Effect("imu_lever_arm", "the IMU sits off the C.G.: its place from there, x forward, y left, z up",
           {"x_m": Parameter("m", 0.5, -5.0, 5.0), "y_m": Parameter("m", 0.3, -5.0, 5.0),
            "z_m": Parameter("m", -0.2, -5.0, 5.0)}, sensors.lever_arm),
    Effect("imu_misalignment", "the IMU's axes are turned",
           {"roll_rad": Parameter("rad", 0.02, -1.5, 1.5), "pitch_rad": Parameter("rad", 0.02, -1.5, 1.5),
            "yaw_rad": Parameter("rad", 0.03, -3.2, 3.2)}, sensors.misalignment),
    Effect("axis_fault", "an axis is reversed, two are swapped (whole sensors: their plugs), or the unit is wrong",
           {"channel": Parameter("", 4.0, 0.0, 5.0, always=True, words=CHANNELS),
            "kind": Parameter("", 0.0, 0.0, 7.0, always=True, words=sensors.KINDS)},
           sensors.axis_fault, sensors.axis_fault_wrong, repeats=True),
    Effect("gyro_scale", "sensitivity error of the gyros", _all("xyz", _SHARE), sensors.scale("gyro_scale")),
    Effect("accel_scale", "sensitivity error of the accelerometers", _all("xyz", _SHARE),
           sensors.scale("accel_scale")),
    Effect("gyro_cross_axis", "one gyro's axis leaks into another's: xy is what x reads of y",
           _all(sensors.LEAKS, Parameter("1", 0.03, -1.0, 1.0)), sensors.cross_axis("gyro_cross_axis")),
    Effect("accel_cross_axis", "one accelerometer's axis leaks into another's: xy is what x reads of y",
           _all(sensors.LEAKS, Parameter("1", 0.03, -1.0, 1.0)), sensors.cross_axis("accel_cross_axis")),
    Effect("gyro_g_sensitivity", "acceleration moves the gyros: xy is what gyro x reads of acceleration y",
           _all(sensors.NINE, Parameter("(rad/s)/(m/s^2)", 5e-4, -0.1, 0.1)), sensors.g_sensitivity),
    Effect("bias_drift", "offsets move with time, or with the temperature of an IMU that warms up", _DRIFT,
           sensors.drift),
    Effect("imu_delay", "the IMU arrives late", {"delay_s": Parameter("s", 0.05, 0.0, 10.0)},
           sensors.sensor(imu_delay_s="delay_s")),
    Effect("steering_delay", "the steering angle arrives late", {"delay_s": Parameter("s", 0.08, 0.0, 10.0)},
           sensors.sensor(steering_delay_s="delay_s")),
    Effect("wheel_speed_delay", "the wheel speeds arrive late", {"delay_s": Parameter("s", 0.1, 0.0, 10.0)},
           sensors.sensor(wheel_speed_delay_s="delay_s")),
    Effect("sensor_bandwidth", "first-order low-pass on the IMU", {"cutoff_hz": Parameter("Hz", 2.0, 1e-3, 1e4)},
           sensors.sensor(imu_cutoff_hz="cutoff_hz")),
    Effect("sensor_saturation", "readings clip",
           {"accel_limit_mps2": Parameter("m/s^2", 3.0, 1e-3, 1e3),
            "gyro_limit_radps": Parameter("rad/s", None, 1e-4, 1e3)},
           sensors.sensor(accel_limit_mps2="accel_limit_mps2", gyro_limit_radps="gyro_limit_radps")),
    Effect("road_bank", "the road tilts sideways", _TILT | _SEED, surroundings.tilt(0)),
    Effect("road_grade", "the road goes up and down", _TILT | {"seed": _SEED["seed"]._replace(default=2.0)},
           surroundings.tilt(1)),
    Effect("suspension_roll", "the body leans and gravity leaks in",
           {"roll_gradient_rad_per_mps2": Parameter("rad/(m/s^2)", 0.0107, 5e-4, 0.03)}, cars.leaning),
    Effect("suspension_pitch", "the body dives and squats and gravity leaks in",
           {"pitch_gradient_rad_per_mps2": Parameter("rad/(m/s^2)", 0.006, 5e-4, 0.03)}, cars.diving),
    Effect("tyre_saturation", "grip is limited", {"friction_coefficient": Parameter("1", 0.9, 0.02, 10.0)},
           cars.field_of_the_car(friction="friction_coefficient")),
    Effect("low_friction", "grip is limited for a while",
           {"friction_coefficient": Parameter("1", 0.4, 0.02, 10.0, always=True),
            "start_s": Parameter("s", 10.0, 0.0, 1e6, always=True),
            "end_s": Parameter("s", 30.0, 0.0, 1e6, always=True)},
           surroundings.slippery, surroundings.slippery_wrong, repeats=True),
    Effect("tyre_relaxation", "lateral force builds up over distance",
           {"relaxation_length_m": Parameter("m", 0.8, 0.005, 20.0)},
           cars.field_of_the_car(lateral_relaxation_m="relaxation_length_m")),
    Effect("wheel_slip", "driven and braked wheels slip: slip over (longitudinal / vertical force)",
           {"slip_per_force": Parameter("1", 0.05, 1e-3, 1.0)}, cars.slip),
    Effect("wheel_radius", "radii are not as configured: true over configured",
           _all(("fl", "fr", "rl", "rr"), Parameter("1", 1.0, 0.5, 2.0))
           | {"fl": Parameter("1", 1.01, 0.5, 2.0), "rl": Parameter("1", 0.99, 0.5, 2.0)}, cars.radii),
    Effect("steering_offset", "zero is not straight ahead: road wheel angle = steering wheel / ratio + offset",
           {"offset_rad": Parameter("rad", 0.005, -0.3, 0.3)},
           cars.field_of_the_car(steering_offset_rad="offset_rad")),
    Effect("steering_ratio", "another ratio, or one that grows with the angle: true over configured",
           {"scale": Parameter("1", 1.1, 0.2, 5.0), "per_rad": Parameter("1/rad", None, -0.05, 0.5)},
           cars.field_of_the_car(steering_ratio_scale="scale", steering_ratio_per_rad="per_rad")),
    Effect("steering_compliance", "front wheels give way under load, per force of the axle",
           {"rad_per_n": Parameter("rad/N", 2e-6, 0.0, 5e-5)},
           cars.field_of_the_car(steering_compliance_rad_per_n="rad_per_n")),
    Effect("steering_backlash", "play, at the road wheel", {"width_rad": Parameter("rad", 0.01, 0.0, 0.2)},
           cars.field_of_the_car(steering_backlash_rad="width_rad")),
    Effect("side_wind", "an air side force",
           {"rms_n": Parameter("N", 400.0, 0.0, 5000.0, always=True),
            "correlation_s": Parameter("s", 0.5, 0.02, 1e4, always=True),
            "seed": _SEED["seed"]._replace(default=3.0)}, surroundings.wind),
    Effect("mass_loading", "mass and C.G. differ, forward positive (the IMU stays where it was)",
           {"added_mass_kg": Parameter("kg", 300.0, -800.0, 3000.0),
            "cg_shift_m": Parameter("m", -0.15, -0.8, 0.8)}, cars.loaded),
    Effect("cornering_stiffness", "stiffness differs",
           {"front_scale": Parameter("1", 0.8, 0.05, 20.0), "rear_scale": Parameter("1", 1.1, 0.05, 20.0)},
           cars.stiffness),
)  # fmt: skip

EFFECTS: Mapping[str, Effect] = {effect.name: effect for effect in _ROWS}


def with_effect(world: World, name: str, **parameters: Value) -> World:
    """Return the world with one effect in it; ConfigError: see `faults`."""
    return with_effects(world, [Choice(name, parameters)])


def with_effects(world: World, choices: Sequence[Choice]) -> World:
    """Return the world with these effects in it, whatever order they are given in.

    Of one that is there twice (two swapped plugs in a row) the order is that given. ConfigError: see `faults`.
    """
    wrong = faults(choices)
    if wrong:
        raise ConfigError("can't simulate", wrong)
    order = list(EFFECTS)
    for choice in sorted(choices, key=lambda choice: order.index(choice.name)):
        effect = EFFECTS[choice.name]
        world = effect.put_into(world, _values(effect, choice.given))
    return world


def described(choices: Sequence[Choice]) -> list[dict[str, Any]]:
    """Return the effects with all values that they put into a world, as plain data; choices without `faults`."""
    found = []
    for choice in choices:
        parameters = EFFECTS[choice.name].parameters
        values = _values(EFFECTS[choice.name], choice.given)
        told = {key: _told(parameters[key], value) for key, value in values.items()}
        found.append({"effect": choice.name, "parameters": told})
    return found


def faults(choices: Sequence[Choice]) -> list[Fault]:
    """Return all that is wrong: unknown effects and parameters, values out of bounds or not of this parameter."""
    found: list[Fault] = []
    seen: set[str] = set()
    for name, given in choices:
        effect = EFFECTS.get(name)
        if effect is None:
            found.append(Fault("--effect", f"unknown effect {name!r}{_near(name, EFFECTS)}"))
            continue
        if name in seen and not effect.repeats:
            found.append(Fault(f"--effect {name}", "given twice; expected all of its parameters in one"))
        seen.add(name)
        own = [
            Fault(f"--effect {name}: {key}", said)
            for key, value in given.items()
            if (said := _parameter_wrong(effect, key, value))
        ]
        if not own and (said := effect.wrong(_values(effect, given))):
            own = [Fault(f"--effect {name}", said)]
        found += own
    return found


def _near(word: str, names: Iterable[str]) -> str:
    known = list(names)
    close = difflib.get_close_matches(word.lower(), known, 3)
    meant = f"; did you mean {' or '.join(map(repr, close))}?" if close else ""
    # More than fit a line or two are another list's business.
    listed = ", ".join(known) if len(known) < 20 else "see `dsz simulate --effects`"
    return f"{meant} Known: {listed}" if close else f"; known: {listed}"


def _parameter_wrong(effect: Effect, key: str, value: Value) -> str:
    parameter = effect.parameters.get(key)
    if parameter is None:
        return f"unknown parameter{_near(key, effect.parameters)}"
    number = _number(parameter, value)
    if number is None and parameter.words:
        return f"{value!r} is none of its words{_near(str(value), parameter.words)}"
    if number is None:
        return f"{value!r} is no number; expected {parameter.least:g} to {parameter.most:g}"
    if not parameter.least <= number <= parameter.most or (parameter.words and number % 1.0):
        unit = "" if parameter.unit in ("", "1") else f" {parameter.unit}"
        return f"{number:g}{unit}; expected {parameter.least:g} to {parameter.most:g}"
    return ""


def _number(parameter: Parameter, value: Value) -> float | None:
    """The value as a number; a word's is its place."""
    if value in parameter.words:
        return float(parameter.words.index(str(value)))
    try:
        number = float(value)
    except ValueError:
        return None
    return None if math.isnan(number) else number


def _values(effect: Effect, given: Mapping[str, Value]) -> dict[str, float]:
    """What is put into a world: the defaults that hold, and what is given."""
    values: dict[str, float] = {}
    for key, parameter in effect.parameters.items():
        number = _number(parameter, given[key]) if key in given else None
        if number is None and (parameter.always or not given):
            number = parameter.default
        if number is not None:
            values[key] = number
    return values


def _told(parameter: Parameter, value: float) -> Value:
    return parameter.words[round(value)] if parameter.words else value
