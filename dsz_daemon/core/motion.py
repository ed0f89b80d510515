"""The car's motion at one tick: speed, steering, yaw rate, sideslip, attitude, references.

Each quantity has a first source and, where a car lacks it, a second one; what that costs
stands in `docs/equations.md`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core import attitude, bicycle, kinematics, speed, stiffness
from dsz_daemon.core.parameters import Car, Inputs, Tuning
from dsz_daemon.core.state import EstimatorState

NAN = math.nan


class Motion(NamedTuple):
    """The car's motion as this tick knows it (rad, rad/s, m/s, m/s^2); NaN where unknown."""

    p: float
    q: float
    r: float
    delta: float
    v: float
    v_rate: float
    speed_valid: bool
    standstill: bool
    slip: bool


def used_yaw_rate(r: float, inputs: Inputs, car: Car, v: float, delta: float) -> float:
    """Compensated yaw rate, else that of the wheels, else that of a rolling car, v delta / L."""
    if not math.isnan(r):
        return r
    wheels = speed.wheel_yaw_rate(inputs, car)
    return v * delta / car.wheelbase_m if math.isnan(wheels) else wheels


def used_steering(inputs: Inputs, car: Car, v: float, tuning: Tuning) -> float:
    """Road wheel angle, else the one that the wheels' speed difference stands for, L r / v."""
    if not math.isnan(inputs.road_wheel_angle):
        return inputs.road_wheel_angle
    wheels = speed.wheel_yaw_rate(inputs, car)
    if abs(v) < tuning.observer_min_speed_mps or math.isnan(wheels):
        return NAN
    return max(-0.6, min(0.6, car.wheelbase_m * wheels / v))


def moved(
    car: Car, tuning: Tuning, state: EstimatorState, inputs: Inputs, dt_s: float
) -> tuple[Motion, speed.SpeedState]:
    """3.1, with the gyros' offsets as known before this tick."""
    delta = used_steering(inputs, car, state.speed.speed_mps, tuning)
    r = used_yaw_rate(inputs.gyro_z + state.gyro_z.correction, inputs, car, state.speed.speed_mps, delta)
    vy = bicycle.lateral_velocity(state.speed.speed_mps, state.observer.sideslip_rad)
    corners = speed.corner_speeds(inputs, car, r, delta, vy)
    ax = inputs.accel_x + state.accel_x.correction
    new = speed.advanced_speed(state.speed, inputs, corners, car, ax, tuning, dt_s)
    motion = Motion(
        p=inputs.gyro_x + state.gyro_x.correction,
        q=inputs.gyro_y + state.gyro_y.correction,
        r=r,
        delta=delta,
        v=new.speed_mps,
        v_rate=new.rate_mps2,
        speed_valid=new.valid != 0.0,
        standstill=speed.at_standstill(new, tuning),
        slip=new.doubt != 0.0 or not speed.wheels_agree(corners, tuning),
    )
    return motion, new


def observed_motion(
    car: Car, tuning: Tuning, state: EstimatorState, motion: Motion, ay: float, dt_s: float
) -> bicycle.ObserverState:
    """(1)-(8) with the adapted stiffnesses; below its speed, and without its inputs, rolling kinematics."""
    delta = 0.0 if math.isnan(motion.delta) else motion.delta
    if motion.v < tuning.observer_min_speed_mps or math.isnan(motion.r) or math.isnan(ay) or math.isnan(motion.delta):
        beta = bicycle.kinematic_sideslip(car.cg_to_front_axle_m, car.cg_to_rear_axle_m, delta)
        return bicycle.ObserverState(beta, motion.v * delta / car.wheelbase_m, 0.0)
    Cf, Cr = stiffness.front_stiffness(state.stiffness, car), stiffness.rear_stiffness(state.stiffness, car)
    body = (
        car.mass_kg,
        car.yaw_inertia_kgm2,
        car.cg_to_front_axle_m,
        car.cg_to_rear_axle_m,
        Cf,
        Cr,
        motion.v,
    )
    model = bicycle.bicycle_model(*body)
    gain = bicycle.observer_gain(*body, tuning.observer_pole_per_s, tuning.neutral_steer_margin)
    return bicycle.observed(state.observer, model, gain, motion.v, motion.r, ay, delta, dt_s)


def reference_accelerations(motion: Motion, observer: bicycle.ObserverState) -> tuple[float, float, float]:
    """(20)-(22) with (9); a rate that no gyro gives counts as zero."""
    if not motion.speed_valid:
        return NAN, NAN, NAN
    vy = bicycle.lateral_velocity(motion.v, observer.sideslip_rad)
    vy_rate = bicycle.lateral_velocity_rate(
        motion.v, motion.v_rate, observer.sideslip_rad, observer.sideslip_rate_radps
    )
    p = 0.0 if math.isnan(motion.p) else motion.p
    q = 0.0 if math.isnan(motion.q) else motion.q
    r = 0.0 if math.isnan(motion.r) else motion.r
    return (
        kinematics.longitudinal_reference(motion.v_rate, r, vy),
        kinematics.lateral_reference(vy_rate, motion.r, motion.v),
        kinematics.vertical_reference(q, motion.v, p, vy),
    )


def turned_attitude(
    lean: attitude.AttitudeState,
    car: Car,
    tuning: Tuning,
    motion: Motion,
    ax: float,
    ay: float,
    references: tuple[float, float, float],
    dt_s: float,
) -> attitude.AttitudeState:
    """Suspension angles from the modelled accelerations, total attitude from gyros and readings."""
    longitudinal = 0.0 if math.isnan(references[0]) else references[0]
    lateral = 0.0 if math.isnan(references[1]) else references[1]
    lean = attitude.leaned(
        lean,
        lateral,
        longitudinal,
        car.roll_gradient_rad_per_mps2,
        car.pitch_gradient_rad_per_mps2,
        tuning.suspension_frequency_radps,
        tuning.suspension_damping,
        dt_s,
    )
    # NaN passes through min and max unseen: ask first.
    roll_seen = NAN if math.isnan(ay - references[1]) else kinematics.roll_from_acceleration(ay, references[1])
    pitch_seen = NAN if math.isnan(ax - references[0]) else kinematics.pitch_from_acceleration(ax, references[0])
    return attitude.turned(lean, motion.p, motion.q, motion.r, roll_seen, pitch_seen, tuning.attitude_window_s, dt_s)
