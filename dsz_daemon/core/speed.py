"""The reference speed v_car of section 3.1: four wheels, patched together, rate-limited.

"Merely a reference value": undriven wheels while accelerating, the fastest wheel while
braking, limited by what a car can do and by what the accelerometer says.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core.linear import relaxed
from dsz_daemon.core.parameters import Car, Inputs, Tuning

NAN = math.nan
# A tilted mount (10 deg) and a wheel that rolls: less than this and a wrong a_x could hold v_car for good.
_WHEELS_ALLOWED_MPS2 = 1.0
# Sensors fall silent below some 0.7 m/s; wheels that stop from faster than this within a step are locked or dead.
_IMPOSSIBLE_STOP_MPS = 1.5


class SpeedState(NamedTuple):
    """Reference speed (m/s), its smoothed copy and that copy's rate (v'), seconds at rest, doubt in the wheels.

    `valid` is 0 until wheels have been seen, and after they are lost. `doubt` is 1 from when they stopped
    faster than a car can (locked, or dead) until they turn again.
    """

    speed_mps: float = 0.0
    smoothed_mps: float = 0.0
    rate_mps2: float = 0.0
    rest_s: float = 0.0
    valid: float = 0.0
    doubt: float = 0.0


class Corners(NamedTuple):
    """Each wheel's speed carried to the C.G. (m/s); NaN where the wheel is missing."""

    fl: float
    fr: float
    rl: float
    rr: float


def corner_speeds(inputs: Inputs, car: Car, r: float, delta: float, vy: float) -> Corners:
    """Forward speed of the C.G. that each wheel alone stands for (no slip), m/s.

    A front wheel rolls along its own heading: v_w = (v_x -+ r t/2) cos(delta) + (v_y + l_f r) sin(delta);
    a rear one along the car's: v_w = v_x -+ r t/2 (upper sign: left).
    """
    r = 0.0 if math.isnan(r) else r
    delta = 0.0 if math.isnan(delta) else delta
    sideways = (vy + car.cg_to_front_axle_m * r) * math.sin(delta)
    cos = math.cos(delta)
    front, rear = 0.5 * r * car.front_track_m, 0.5 * r * car.rear_track_m
    return Corners(
        (inputs.wheel_speed_fl - sideways) / cos + front,
        (inputs.wheel_speed_fr - sideways) / cos - front,
        inputs.wheel_speed_rl + rear,
        inputs.wheel_speed_rr - rear,
    )


def wheel_yaw_rate(inputs: Inputs, car: Car) -> float:
    """Yaw rate from the undriven axle's speed difference, else the other axle's; NaN without both."""
    rear = (inputs.wheel_speed_rr - inputs.wheel_speed_rl) / car.rear_track_m
    front = (inputs.wheel_speed_fr - inputs.wheel_speed_fl) / car.front_track_m
    first, second = (front, rear) if car.rear_driven and not car.front_driven else (rear, front)
    return second if math.isnan(first) else first


def _present(values: tuple[float, ...]) -> list[float]:
    return [value for value in values if not math.isnan(value)]


def patched_speed(corners: Corners, car: Car, braking: bool) -> float:
    """The wheels patched together, 3.1: the fastest while braking, else the undriven wheels' mean.

    With all wheels driven the slowest stands for "undriven": spin only makes wheels faster.
    """
    wheels = _present((corners.fl, corners.fr, corners.rl, corners.rr))
    if len(wheels) == 0:
        return NAN
    if braking:
        return max(wheels)
    if car.front_driven and car.rear_driven:
        return min(wheels)
    undriven = _present((corners.fl, corners.fr) if car.rear_driven else (corners.rl, corners.rr))
    return sum(undriven) / len(undriven) if len(undriven) > 0 else min(wheels)


def is_braking(inputs: Inputs, acceleration_mps2: float, threshold_mps2: float) -> bool:
    """The brake switch where there is one, else the speed's own fall beyond the threshold."""
    if not math.isnan(inputs.brake):
        return inputs.brake != 0.0
    return acceleration_mps2 < -threshold_mps2


def wheels_agree(corners: Corners, tuning: Tuning) -> bool:
    """Whether all wheels tell the same speed within the tolerance: no slip worth speaking of."""
    wheels = _present((corners.fl, corners.fr, corners.rl, corners.rr))
    if len(wheels) < 2:
        return True
    low, high = min(wheels), max(wheels)
    return high - low <= tuning.wheel_disagreement_mps + tuning.wheel_disagreement * abs(high)


def limited_speed(previous: float, wanted: float, ax: float, tuning: Tuning, dt_s: float) -> float:
    """The rate limiter of 3.1: physical limits, narrowed round a_x where the IMU has one.

    The margin round a_x covers its offset and the gravity of the steepest road. The wheels' word is
    always allowed some rate either way: an accelerometer that is wrong for long doesn't outvote them.
    """
    low, high = -tuning.largest_deceleration_mps2, tuning.largest_acceleration_mps2
    if not math.isnan(ax):
        low = max(low, min(ax - tuning.imu_acceleration_margin_mps2, -_WHEELS_ALLOWED_MPS2))
        high = min(high, max(ax + tuning.imu_acceleration_margin_mps2, _WHEELS_ALLOWED_MPS2))
    return min(max(wanted, previous + low * dt_s), previous + high * dt_s)


def wheels_at_rest(inputs: Inputs, limit_mps: float) -> bool:
    """Whether all wheels that report (at least one) report less than the limit."""
    wheels = _present(inputs[6:10])
    return len(wheels) > 0 and max([abs(wheel) for wheel in wheels]) < limit_mps


def signed_wheels(inputs: Inputs) -> Inputs:
    """The wheels with the sign of the gear: sensors that can't tell direction count up in reverse too."""
    fl, fr, rl, rr = inputs[6:10]
    if math.isnan(inputs.reverse) or inputs.reverse == 0.0 or fl < 0.0 or fr < 0.0 or rl < 0.0 or rr < 0.0:
        return inputs
    return Inputs(
        inputs.gyro_x,
        inputs.gyro_y,
        inputs.gyro_z,
        inputs.accel_x,
        inputs.accel_y,
        inputs.accel_z,
        -fl,
        -fr,
        -rl,
        -rr,
        inputs.road_wheel_angle,
        inputs.brake,
        inputs.accelerator,
        inputs.reverse,
    )


def advanced_speed(
    state: SpeedState, inputs: Inputs, corners: Corners, car: Car, ax: float, tuning: Tuning, dt_s: float
) -> SpeedState:
    """One step of v_car. Without any wheel the speed is not valid; it starts afresh when they return."""
    braking = is_braking(inputs, state.rate_mps2, tuning.braking_threshold_mps2)
    wanted = patched_speed(corners, car, braking)
    if math.isnan(wanted):
        return SpeedState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if state.valid == 0.0:
        return SpeedState(wanted, wanted, 0.0, 0.0, 1.0, 0.0)
    if state.speed_mps * wanted < 0.0 and abs(wanted) < 3.0:
        # Changing direction at walking pace: a sign of the gear, not an acceleration.
        return SpeedState(wanted, wanted, 0.0, 0.0, 1.0, 0.0)
    speed = limited_speed(state.speed_mps, wanted, ax, tuning, dt_s)
    limit = tuning.standstill_speed_mps
    standing = wheels_at_rest(inputs, limit)
    doubt = 1.0 if standing and (state.doubt != 0.0 or abs(speed - wanted) > _IMPOSSIBLE_STOP_MPS) else 0.0
    rest = state.rest_s + dt_s if standing and doubt == 0.0 and abs(speed) < limit else 0.0
    smoothed = relaxed(state.smoothed_mps, speed, tuning.speed_smoothing_s, dt_s)
    return SpeedState(speed, smoothed, (smoothed - state.smoothed_mps) / dt_s, min(rest, 3600.0), 1.0, doubt)


def at_standstill(state: SpeedState, tuning: Tuning) -> bool:
    """Whether the car has stood long enough for the gyros' own truth: p = q = r = 0."""
    return state.valid != 0.0 and state.rest_s >= tuning.standstill_wait_s
