"""Refuses a tuning whose observer and lateral zeroing, attached, are not stable at every speed."""

from __future__ import annotations

from itertools import product

from dsz_daemon.config.settings import Settings
from dsz_daemon.core.bicycle import bicycle_model, observer_gain
from dsz_daemon.core.stability import closed_loop_poles
from dsz_daemon.errors import Fault

_TOP_SPEED_MPS = 70.0
_SPEEDS = 40


def stability_faults(settings: Settings) -> list[Fault]:
    """The first speed at which a pole of (30)-(39), corrected, is not in the left half plane.

    Looked at: from the observer's lowest speed to 70 m/s, the configured stiffnesses and the
    extremes that adaptation may reach, the slowest gain (1/window) and the fastest one.
    """
    car, tuning = settings.vehicle.car(), settings.estimator.tuning()
    bound = tuning.stiffness_bound if tuning.adapt_stiffness else 0.0
    factors = (1.0, 1.0 + bound, 1.0 - bound) if bound else (1.0,)
    gains = (1.0 / tuning.accel_y.window_s, max(tuning.accel_y.gain_limit_per_s, 1.0 / tuning.accel_y.window_s))
    low = tuning.observer_min_speed_mps
    for i in range(_SPEEDS):
        v = low + (_TOP_SPEED_MPS - low) * i / (_SPEEDS - 1)
        for front, rear, gamma in product(factors, factors, gains):
            body = (
                car.mass_kg,
                car.yaw_inertia_kgm2,
                car.cg_to_front_axle_m,
                car.cg_to_rear_axle_m,
                car.front_cornering_stiffness_n_per_rad * front,
                car.rear_cornering_stiffness_n_per_rad * rear,
                v,
            )
            gain = observer_gain(*body, tuning.observer_pole_per_s, tuning.neutral_steer_margin)
            worst = float(closed_loop_poles(bicycle_model(*body), gain, v, gamma, tuning.c_y)[-1].real)
            if worst >= 0.0:
                what = (
                    f"not stable: with gain {gamma:.3g} 1/s, c_y {tuning.c_y:g} and stiffness factors "
                    f"{front:g}, {rear:g} a pole lies at {worst:+.3g} 1/s at {v:.1f} m/s; "
                    f"expected all below 0 up to {_TOP_SPEED_MPS:.0f} m/s"
                )
                return [Fault("estimator", what)]
    return []
