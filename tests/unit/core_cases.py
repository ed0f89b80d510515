"""What the core's tests share: the paper's car, inputs of a car on the road, short laws, RK4."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from dsz_daemon.config.estimator import EstimatorSettings
from dsz_daemon.core.outputs import StepOutput
from dsz_daemon.core.parameters import Car, Inputs, Tuning, ZeroingTuning
from dsz_daemon.core.state import EstimatorState, initial_state
from dsz_daemon.core.step import step

NAN = math.nan
G = 9.80665
DEG = math.pi / 180.0

# Tucson ix of the paper's Tables 4-5; inertia and stiffnesses are those of the contract's example.
TUCSON = Car(
    mass_kg=1673.0,
    yaw_inertia_kgm2=2850.0,
    cg_to_front_axle_m=1.149,
    cg_to_rear_axle_m=1.491,
    front_track_m=1.585,
    rear_track_m=1.586,
    front_cornering_stiffness_n_per_rad=62000.0,
    rear_cornering_stiffness_n_per_rad=68000.0,
    front_driven=True,
    rear_driven=False,
    roll_gradient_rad_per_mps2=0.008,
    pitch_gradient_rad_per_mps2=0.004,
)
DEFAULTS = EstimatorSettings().tuning()
NOTHING = Inputs(*[NAN] * len(Inputs._fields))
WHEELS = ("wheel_speed_fl", "wheel_speed_fr", "wheel_speed_rl", "wheel_speed_rr")


def straight(v: float, **changed: float) -> Inputs:
    """A level road, straight ahead at v, a perfect IMU; no pedal signals."""
    here = NOTHING._replace(
        gyro_x=0.0, gyro_y=0.0, gyro_z=0.0, accel_x=0.0, accel_y=0.0, accel_z=G, road_wheel_angle=0.0
    )
    return here._replace(**dict.fromkeys(WHEELS, v))._replace(**changed)


def law(**changed: float) -> ZeroingTuning:
    """A zeroing law with round numbers, in units of whatever it zeroes; white noise only, no drift, a wide prior."""
    plain = DEFAULTS.accel_x._replace(
        window_s=10.0,
        gain_limit_per_s=1e18,
        noise_density=1.0,
        look_std=math.inf,
        noise_blocks=1e15,
        start_density=0.0,
        standstill_density=0.1,
        drift_density=0.0,
        floor_std=0.0,
        prior_std=1e6,
    )
    return plain._replace(**changed)


def drive(
    inputs: Inputs | Callable[[float], Inputs],
    seconds: float,
    dt_s: float = 0.02,
    tuning: Tuning = DEFAULTS,
    car: Car = TUCSON,
    state: EstimatorState | None = None,
) -> tuple[EstimatorState, list[StepOutput]]:
    """Runs `step` over `seconds`; `inputs` is constant or a function of the time of the tick."""
    state = initial_state(tuning) if state is None else state
    outputs = []
    for k in range(1, round(seconds / dt_s) + 1):
        now = inputs(k * dt_s) if callable(inputs) else inputs
        state, output = step(car, tuning, state, now, dt_s)
        outputs.append(output)
    return state, outputs


def rk4(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, seconds: float, steps: int) -> np.ndarray:
    """x after `seconds` of x' = f(x), by classical Runge-Kutta."""
    h = seconds / steps
    for _ in range(steps):
        k1 = f(x)
        k2 = f(x + 0.5 * h * k1)
        k3 = f(x + 0.5 * h * k2)
        k4 = f(x + h * k3)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return x
