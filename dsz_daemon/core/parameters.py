"""What the estimator is told once: the car and the tuning. SI and radians throughout.

Defaults of the tuning, their bounds and the reasons for them stand in `config/estimator.py`,
where a user sets them; this file only names them.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Car(NamedTuple):
    """The vehicle of eq. (1). Stiffnesses are those of ONE tyre, as in the paper."""

    mass_kg: float
    yaw_inertia_kgm2: float
    cg_to_front_axle_m: float
    cg_to_rear_axle_m: float
    front_track_m: float
    rear_track_m: float
    front_cornering_stiffness_n_per_rad: float
    rear_cornering_stiffness_n_per_rad: float
    front_driven: bool
    rear_driven: bool
    roll_gradient_rad_per_mps2: float
    pitch_gradient_rad_per_mps2: float

    @property
    def wheelbase_m(self) -> float:
        """Distance between the axles."""
        return self.cg_to_front_axle_m + self.cg_to_rear_axle_m


class ZeroingTuning(NamedTuple):
    """One channel's zeroing law, (11)-(15) and (24)-(28).

    `window_s` is the printed law's 1/gamma. Densities are long-run spectral densities (unit^2 s) of
    target minus offset: `noise_density` while driving, `start_density` more of it at first (fading
    over `start_s`), `standstill_density` at rest; `noise_blocks` is how many blocks of observed scatter
    it takes to outvote the first. `drift_density` is the offset's random walk (unit^2/s), `floor_std`
    what no averaging removes, `prior_std` the data sheet's word before anything was learnt. `look_std`
    is how far off a single look of some `look_s` may be (the slow process's own scatter): where less than
    that is known, one look tells it. What a target takes as zero though other sensors tell it lasts for some
    `neglect_s` (twice the time over which it hangs together).
    """

    window_s: float
    gain_limit_per_s: float
    noise_density: float
    noise_blocks: float
    start_density: float
    start_s: float
    standstill_density: float
    drift_density: float
    floor_std: float
    prior_std: float
    goal_std: float
    largest_offset: float
    look_std: float = math.inf
    look_s: float = 1.0
    neglect_s: float = 0.0


class DoubtTuning(NamedTuple):
    """When a standing car's gyro contradicts what was learnt, see `doubt`.

    Beyond `sigmas` of its own spread, smoothed over `look_s`, a reading is not learnt from; for less than
    `wait_s` at a time. What was believed after all counts as contradicted for some `memory_s`.
    """

    sigmas: float
    look_s: float
    wait_s: float
    memory_s: float


class Tuning(NamedTuple):
    """All of the paper's tuning constants, and those that it leaves open."""

    # zeroing, one law a channel
    gyro_x: ZeroingTuning
    gyro_y: ZeroingTuning
    gyro_z: ZeroingTuning
    accel_x: ZeroingTuning
    accel_y: ZeroingTuning
    accel_z: ZeroingTuning
    doubt: DoubtTuning
    block_s: float
    as_printed: bool
    c_y: float
    # (15), Table 3
    k_r_rad: float
    yaw_steering_zero_rad: float
    c1: float
    c2_m2ps2: float
    c3_mps: float
    c4_rad: float
    c5_rad2: float
    c6_radps: float
    c7: float
    x_min_speed_mps: float
    turn_limit_radps: float
    yaw_first_std_radps: float
    # (29)
    tau_window_s: float
    tau_smoothing_s: float
    tau_rate_scale_radps: float
    tau_accel_scale_mps2: float
    tau_vertical_scale_mps2: float
    tau_steering_scale_rad: float
    # (6)-(8)
    observer_pole_per_s: float
    observer_min_speed_mps: float
    neutral_steer_margin: float
    # 3.1
    largest_acceleration_mps2: float
    largest_deceleration_mps2: float
    imu_acceleration_margin_mps2: float
    braking_threshold_mps2: float
    speed_smoothing_s: float
    wheel_disagreement: float
    wheel_disagreement_mps: float
    standstill_speed_mps: float
    standstill_wait_s: float
    # (4)
    suspension_frequency_radps: float
    suspension_damping: float
    attitude_window_s: float
    # stiffness adaptation
    adapt_stiffness: bool
    stiffness_spread: float
    stiffness_bound: float
    steering_offset_spread_rad: float
    stiffness_noise_density_rad2s: float
    stiffness_min_ay_mps2: float
    stiffness_max_ay_mps2: float
    stiffness_min_speed_mps: float


class Inputs(NamedTuple):
    """One tick's aligned inputs in SI; NaN where a value is missing, stale or refused."""

    gyro_x: float
    gyro_y: float
    gyro_z: float
    accel_x: float
    accel_y: float
    accel_z: float
    wheel_speed_fl: float
    wheel_speed_fr: float
    wheel_speed_rl: float
    wheel_speed_rr: float
    road_wheel_angle: float
    brake: float
    accelerator: float
    reverse: float
