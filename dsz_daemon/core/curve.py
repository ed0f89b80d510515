"""The yaw rate that steering and wheels agree on: a curve that (15)'s gate takes for straight.

The gate is open for a road wheel angle of half a degree, because a steering sensor's zero may be that far off; at
30 m/s this is a curve of R = 800 m, 2.15 deg/s. Two witnesses know: the steering, by the steady turn of (1), and
the wheels' speed difference. A zero error of the one looks like a curve, and so does a difference of radii of the
other; both at once, to the same side and as large, seldom do. What neither says less of is no truth to zero to,
but it tells how little there is to learn: see `neglected` in `zeroing`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core import bicycle, speed
from dsz_daemon.core.linear import relaxed
from dsz_daemon.core.parameters import Car, Inputs, Tuning

# The wheels need it: a step of their counts alone is 1 deg/s. A slower one would lag behind a winding road, and both
# of its sides would teach otherwise; a quicker one takes the driver's own corrections for curves.
_SMOOTHING_S = 2.0


class CurveState(NamedTuple):
    """Road wheel angle (rad) and the wheels' yaw rate (rad/s), smoothed; zero until they are seen."""

    road_wheel_angle_rad: float = 0.0
    wheels_radps: float = 0.0


def advanced_curve(state: CurveState, car: Car, inputs: Inputs, delta: float, dt_s: float) -> CurveState:
    """One step of the smoothing; a witness that is missing tells nothing."""
    wheels = speed.wheel_yaw_rate(inputs, car)
    return CurveState(
        0.0 if math.isnan(delta) else relaxed(state.road_wheel_angle_rad, delta, _SMOOTHING_S, dt_s),
        0.0 if math.isnan(wheels) else relaxed(state.wheels_radps, wheels, _SMOOTHING_S, dt_s),
    )


def agreed_yaw_rate(state: CurveState, car: Car, v: float, tuning: Tuning) -> float:
    """Yaw rate (rad/s) of which neither witness says less; 0 where they disagree, or the car is slow.

    The steering counts beyond its own zero error, from twice that in full.
    """
    beyond = abs(state.road_wheel_angle_rad) - tuning.yaw_steering_zero_rad
    if v < tuning.observer_min_speed_mps or beyond <= 0.0:
        return 0.0
    model = bicycle.bicycle_model(
        car.mass_kg,
        car.yaw_inertia_kgm2,
        car.cg_to_front_axle_m,
        car.cg_to_rear_axle_m,
        car.front_cornering_stiffness_n_per_rad,
        car.rear_cornering_stiffness_n_per_rad,
        v,
    )
    share = min(1.0, beyond / max(tuning.yaw_steering_zero_rad, 1e-9))
    steered = share * bicycle.steady_yaw_rate(model, state.road_wheel_angle_rad)
    if math.isnan(steered) or steered * state.wheels_radps <= 0.0:
        return 0.0
    return math.copysign(min(abs(steered), abs(state.wheels_radps)), steered)
