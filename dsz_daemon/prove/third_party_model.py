"""CommonRoad's multi-body car (29 states), compiled as it stands, under a road and a driver of our own.

M. Althoff, G. Wuersching, "CommonRoad: Vehicle Models", 2020: sprung mass and two axles on springs, tyres by the Magic
Formula with combined slip, spinning wheels; x ahead, y right, z down. The package's functions are compiled without a
change: only what they call is put beside them. What it leaves out is put on top: gravity along a tilted road, wind.

Four of its tyre's numbers are 0 here. The package multiplies what a tyre pushes without any slip (its conicity and ply
steer) by the camber's sign: straight ahead, where camber passes 0, that car shakes itself at 1.6 Hz for ever.
"""

from __future__ import annotations

import importlib
from collections import namedtuple
from functools import cache
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.errors import MachineError

Array = NDArray[np.float64]

G = 9.81
STEP_S = 0.001
# Its body comes to rest within this, at this speed.
_SETTLED_S, _SLOW_MPS = 5.0, 5.0
STATES = 29
# Of the states, as the package counts them.
STEER, ALONG, YAW_RATE, ROLL, ROLL_RATE, PITCH, PITCH_RATE, ACROSS, SINKING = 2, 3, 5, 6, 7, 8, 9, 10, 12
WHEELS = (23, 24, 25, 26)
# The sprung mass and both axles go sideways.
_SIDEWAYS = (10, 15, 20)


@cache
def packages() -> dict[str, ModuleType]:
    """What this takes of others, by short names. MachineError where it is not installed."""
    try:
        return {
            "numba": importlib.import_module("numba"),
            "car": importlib.import_module("vehiclemodels.parameters_vehicle2"),
            "start": importlib.import_module("vehiclemodels.init_mb"),
            "whole": importlib.import_module("vehiclemodels.vehicle_dynamics_mb"),
            "slow": importlib.import_module("vehiclemodels.utils.vehicle_dynamics_ks_cog"),
            "tires": importlib.import_module("vehiclemodels.utils.tire_model"),
            "steering": importlib.import_module("vehiclemodels.utils.steering_constraints"),
            "acceleration": importlib.import_module("vehiclemodels.utils.acceleration_constraints"),
        }
    except ImportError:
        what = "the third party's car needs commonroad-vehicle-models and numba"
        raise MachineError(f"{what}: pip install dsz-daemon[prove]") from None


def _numbers(name: str, record: Any, **more: Any) -> Any:
    """A record's numbers as a named tuple, which compiled functions can read."""
    found = {
        key: float(value)
        for key in dir(record)
        if not key.startswith("_") and isinstance(value := getattr(record, key), int | float)
    }
    found |= more
    return namedtuple(name, sorted(found))(**found)


def as_numbers(parameters: Any) -> Any:
    """The package's parameters, to be handed to `courses`."""
    return _numbers(
        "Numbers",
        parameters,
        tire=_numbers("Tire", parameters.tire),
        steering=_numbers("Steering", parameters.steering),
        longitudinal=_numbers("Longitudinal", parameters.longitudinal),
    )


def bmw_320i(as_published: bool = False) -> Any:
    """The package's vehicle 2, without what its tyres push at no slip, or with it `as_published`."""
    parameters = packages()["car"].parameters_vehicle2()
    if not as_published:
        for name in ("p_hy1", "p_hy3", "p_vy1", "p_vy3"):
            setattr(parameters.tire, name, 0.0)
    return parameters


@cache
def _model() -> Any:
    """The package's right-hand side, compiled: f(state, (steering rate, acceleration), numbers)."""
    package = packages()
    numba, tires = package["numba"], package["tires"]

    def compiled(function: Any, **beside: Any) -> Any:
        known = {**function.__globals__, **beside}
        return numba.njit(nogil=True)(FunctionType(function.__code__, known, function.__name__))

    sign = compiled(tires.sign)
    tire = ModuleType("tire")
    for name in ("longitudinal", "lateral", "longitudinal_comb", "lateral_comb"):
        setattr(tire, f"formula_{name}", compiled(getattr(tires, f"formula_{name}"), sign=sign))
    limits = {
        "steering_constraints": compiled(package["steering"].steering_constraints),
        "acceleration_constraints": compiled(package["acceleration"].acceleration_constraints),
    }
    slow = compiled(package["slow"].vehicle_dynamics_ks_cog, **limits)
    whole = package["whole"].vehicle_dynamics_mb
    return compiled(whole, tireModel=tire, vehicle_dynamics_ks_cog=slow, **limits)


@cache
def _loop() -> Any:
    """One drive, compiled."""
    numba, model, sideways = packages()["numba"], _model(), _SIDEWAYS

    def rates(state: Array, steer: float, wanted: float, numbers: Any, uphill: float, right: float) -> Array:
        state = state.copy()
        state[STEER] = steer
        found = np.array(model(state, np.array([0.0, wanted]), numbers))
        found[ALONG] -= uphill
        for i in sideways:
            found[i] += right
        return found

    rates_of = numba.njit(nogil=True)(rates)

    def driven(
        state: Array, hand: Array, speed: Array, accel: Array, uphill: Array, right: Array, wind: Array,
        soft: float, numbers: Any,
    ) -> tuple[Array, Array, Array]:  # fmt: skip
        n = len(hand)
        states, changes, steers = np.zeros((n, STATES)), np.zeros((n, STATES)), np.zeros(n)
        front_n = 0.0
        for i in range(n):
            steer = hand[i] - soft * front_n
            side = right[i] + wind[i] / numbers.m
            wanted = accel[i] + uphill[i] + (speed[i] - state[ALONG])
            k1 = rates_of(state, steer, wanted, numbers, uphill[i], side)
            states[i], changes[i], steers[i] = state, k1, steer
            states[i, STEER] = steer
            # The moment about the rear axle tells the force of the front one (to the right).
            across = k1[ACROSS] + state[YAW_RATE] * state[ALONG] - side
            front_n = (numbers.m * numbers.b * across + numbers.I_z * k1[YAW_RATE]) / (numbers.a + numbers.b)
            k2 = rates_of(state + 0.5 * STEP_S * k1, steer, wanted, numbers, uphill[i], side)
            k3 = rates_of(state + 0.5 * STEP_S * k2, steer, wanted, numbers, uphill[i], side)
            k4 = rates_of(state + STEP_S * k3, steer, wanted, numbers, uphill[i], side)
            state = state + STEP_S / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return states, changes, steers

    return numba.njit(nogil=True)(driven)


def courses(
    numbers: Any,
    hand_rad: Array,
    speed_mps: Array,
    uphill_mps2: Array,
    right_mps2: Array,
    wind_n: Array,
    soft_rad_per_n: float,
) -> tuple[Array, Array, Array]:
    """States (n, 29), their rates (n, 29) and the front wheels' angle (n,), at STEP_S; the package's axes.

    `hand_rad` (n,): the front wheels' angle without compliance, to the right; `speed_mps` (n,) what the driver wants;
    `uphill_mps2`, `right_mps2` (n,): gravity against the car and to its right; `wind_n` (n,) to the right;
    `soft_rad_per_n`: how far the front axle's lateral force turns its wheels back.
    """
    init = packages()["start"].init_mb
    start = np.array(init([0.0, 0.0, float(hand_rad[0]), float(speed_mps[0]), 0.0, 0.0, 0.0], bmw_320i()))
    start[list(WHEELS)] = speed_mps[0] / numbers.R_w
    accel = np.gradient(speed_mps, STEP_S)
    found: tuple[Array, Array, Array] = _loop()(
        start, hand_rad, speed_mps, accel, uphill_mps2, right_mps2, wind_n, soft_rad_per_n, numbers
    )
    return found


def resting_rad(numbers: Any) -> float:
    """The body's pitch, nose up, of a car that rolls straight ahead: its springs don't hold it quite level."""
    one = np.ones(round(_SETTLED_S / STEP_S))
    states, _, _ = courses(numbers, 0.0 * one, _SLOW_MPS * one, 0.0 * one, 0.0 * one, 0.0 * one, 0.0)
    return float(states[-1, PITCH])
