"""The `estimator` section: every tuning constant with its unit, bound and the reason for its default.

The paper prints none of its thresholds. Each default below says what it was chosen from:
the sensors' data sheets (Tables 1-2), road statistics, or the calm driving that it must let
through. Degrees here, radians inside.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from dsz_daemon.core.parameters import DoubtTuning, Tuning, ZeroingTuning

_DEG = math.pi / 180.0


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


def _number(default: float, low: float, high: float, why: str) -> float:
    """A bounded setting with its default and the reason for it."""
    field: float = Field(default=default, ge=low, le=high, description=why)
    return field


class ZeroingSettings(_Section):
    """One zeroing law; units are deg/s for gyros and m/s^2 for accelerometers ("unit")."""

    window_s: Annotated[float, Field(ge=1, le=36000)]
    noise_density: Annotated[float, Field(gt=0, le=1e4)]
    noise_blocks: Annotated[float, Field(ge=1, le=1e6)]
    drift_density: Annotated[float, Field(ge=0, le=1)]
    floor_std: Annotated[float, Field(ge=0, le=10)]
    prior_std: Annotated[float, Field(gt=0, le=100)]
    goal_std: Annotated[float, Field(gt=0, le=100)]
    largest_offset: Annotated[float, Field(gt=0, le=100)]
    look_std: Annotated[float, Field(gt=0, le=1e6)] = 1e6
    start_density: Annotated[float, Field(ge=0, le=1e4)] = 0.0
    start_s: Annotated[float, Field(gt=0, le=600)] = 2.0
    standstill_density: Annotated[float, Field(gt=0, le=1e4)] = 0.01
    gain_limit_per_s: Annotated[float, Field(gt=0, le=1000)] = 50.0
    neglect_s: Annotated[float, Field(ge=0, le=3600)] = 0.0

    def law(self, to_si: float) -> ZeroingTuning:
        """The same law in SI."""
        return ZeroingTuning(
            window_s=self.window_s,
            gain_limit_per_s=self.gain_limit_per_s,
            noise_density=self.noise_density * to_si**2,
            noise_blocks=self.noise_blocks,
            look_std=self.look_std * to_si,
            start_density=self.start_density * to_si**2,
            start_s=self.start_s,
            standstill_density=self.standstill_density * to_si**2,
            drift_density=self.drift_density * to_si**2,
            floor_std=self.floor_std * to_si,
            prior_std=self.prior_std * to_si,
            goal_std=self.goal_std * to_si,
            largest_offset=self.largest_offset * to_si,
            neglect_s=self.neglect_s,
        )


# Roll and pitch angle stay within ~1.5 deg rms on roads, so over T seconds their rates' mean is about
# sqrt(2) 1.5 deg / T: 0.075 deg^2 s meets it at T = 60 s; the first seconds hold one change of angle, whose
# (2.1 deg)^2 are spread over 2 s. Drift: a gyro moves some 0.05 deg/s in 10 min of warming up. At rest:
# 0.03 deg/s/sqrt(Hz) (Table 1) is 0.0005 deg^2 s; people get in and engines shake, hence ten times that.
# Prior: null +-3 deg/s (Table 1).
_ROLL_PITCH_RATE = ZeroingSettings(
    window_s=120, noise_density=0.075, noise_blocks=10, start_density=2.2, standstill_density=0.005,
    drift_density=4e-6, floor_std=0.01, prior_std=3.0, goal_std=0.1, largest_offset=30,
)  # fmt: skip
# Inside the steering gate the car still follows gentle curves: some 0.5 deg/s rms, correlated over ~3 s.
# What was really seen outvotes this after a few blocks. A curve that steering and wheels agree on takes 5 s and more
# (R = 800 m turned by 10 deg at 30 m/s), and teaches that much less.
_YAW_RATE = ZeroingSettings(
    window_s=150, noise_density=1.5, noise_blocks=2, standstill_density=0.005,
    drift_density=4e-6, floor_std=0.01, prior_std=3.0, goal_std=0.1, largest_offset=30, neglect_s=10,
)  # fmt: skip
# Grade 1.5 deg rms over 300 m and bank 1.5 deg rms over 200 m at 15 m/s, as long-run densities
# (g sigma)^2 2 L / v; a single look is off by g sigma. A calm stretch says little about the next hill: hence
# 60 blocks. Floors: the net climb of a drive (1 %); the crossfall of 2 % that drains nearly every road to one side,
# the same one all the way, and that nothing tells from an offset.
# Prior: +-25 mg and +-1 deg (Table 2) and the mount. Drift: 0.1 m/s^2 an hour with temperature.
_LONGITUDINAL = ZeroingSettings(
    window_s=300, noise_density=2.6, look_std=0.26, noise_blocks=60, drift_density=3e-6, floor_std=0.1,
    prior_std=1.0, goal_std=0.2, largest_offset=6,
)  # fmt: skip
_LATERAL = ZeroingSettings(
    window_s=300, noise_density=1.8, look_std=0.26, noise_blocks=60, drift_density=3e-6, floor_std=0.2,
    prior_std=1.0, goal_std=0.25, largest_offset=6, gain_limit_per_s=1.0,
)  # fmt: skip
# g cos(slope) loses 0.05 m/s^2 at 6 deg, where a car may park; heave averages out within seconds.
_VERTICAL = ZeroingSettings(
    window_s=120, noise_density=0.02, look_std=0.1, noise_blocks=10, drift_density=3e-6, floor_std=0.05,
    prior_std=1.0, goal_std=0.1, largest_offset=6,
)  # fmt: skip


class GateSettings(_Section):
    """(15), (29) and Table 3."""

    yaw_max_road_wheel_angle_deg: float = _number(
        0.5, 0.01, 10, "k_r of (15). Wide enough for a steering zero error of some 5 deg at the hand wheel"
    )
    yaw_steering_zero_deg: float = _number(
        0.1, 0.0, 10, "at the road wheel: less than this (1.5 deg at the hand wheel) is no curve but the sensor's zero"
    )
    c1_longitudinal_max_tau: float = _number(0.5, 0.001, 1000, "c1: calm driving scatters below the scales of tau")
    c2_longitudinal_max_speed_variance_m2ps2: float = _number(
        0.25, 1e-4, 100, "c2: 0.5 m/s2 held over the window; wheels hardly slip"
    )
    c3_lateral_min_speed_mps: float = _number(
        8.0, 1, 60, "c3: below, side slip and steering play outweigh what is learnt"
    )
    c4_lateral_max_road_wheel_angle_deg: float = _number(1.0, 0.01, 20, "c4: straight and gentle curves")
    c5_lateral_max_steering_variance_deg2: float = _number(
        0.04, 1e-4, 100, "c5: 0.2 deg at the road wheel within the window"
    )
    c6_lateral_max_yaw_rate_degps: float = _number(2.0, 0.01, 60, "c6: superelevated curves stay out")
    c7_vertical_max_tau: float = _number(0.5, 0.001, 1000, "c7: as c1")
    longitudinal_min_speed_mps: float = _number(
        5.0, 0.5, 60, "at rest a slope looks like an offset; below this the car may be parking or reversing"
    )
    roll_pitch_max_yaw_rate_degps: float = _number(
        5.0, 0.1, 360, "in a turn theta' = q - r phi: the rates' means are not zero"
    )
    yaw_first_std_degps: float = _number(
        0.2, 0.001, 10, "a yaw rate offset error dr puts v dr into e_y: 0.07 m/s2 at 20 m/s"
    )
    tau_window_s: float = _number(1.0, 0.1, 30, "Dt_i of (29), the same for all seven")
    tau_smoothing_s: float = _number(0.25, 0.01, 5, "takes engine shake and sensor noise out of what counts as motion")
    tau_rate_scale_degps: float = _number(1.0, 0.01, 100, "1/sqrt(7 k_i) of p, q, r")
    tau_accel_scale_mps2: float = _number(0.3, 0.01, 10, "1/sqrt(7 k_i) of a_x, a_y")
    tau_vertical_scale_mps2: float = _number(0.5, 0.01, 10, "1/sqrt(7 k_i) of a_z: rough roads are no manoeuvre")
    tau_steering_scale_deg: float = _number(0.3, 0.01, 10, "1/sqrt(7 k_i) of delta_f")


class DoubtSettings(_Section):
    """When a standing car's gyro contradicts what was learnt."""

    sigmas: float = _number(
        5.0, 2, 1000, "of its own spread: what was learnt while driving may be off by three and a half"
    )
    look_s: float = _number(1.0, 0.05, 60, "as long as a rocking body takes to swing back")
    wait_s: float = _number(
        60.0, 1, 36000, "longer than a turntable or somebody who gets in; a sensor that really moved is zeroed after it"
    )
    memory_s: float = _number(
        300.0, 1, 1e6, "5 deg/s between two readings are down to 0.1 in the spread after 20 min of the later one"
    )


class ObserverSettings(_Section):
    """(6)-(8)."""

    pole_per_s: float = _number(
        -10.0,
        -100,
        -0.1,
        "p_o < 0: settles within 0.5 s. An a_y offset b shows in r^ as b/(v (1 + K1)), and 1 + K1 ~ p_o^2",
    )
    min_speed_mps: float = _number(3.0, 0.5, 20, "below, rolling kinematics: (1) divides by v")
    neutral_steer_margin: float = _number(
        0.05, 0.001, 0.5, "K4 divides by C_f l_f - C_r l_r: switched off (with K2) below this share"
    )


class SpeedSettings(_Section):
    """Section 3.1."""

    largest_acceleration_mps2: float = _number(6.0, 1, 30, "what the strongest production cars reach")
    largest_deceleration_mps2: float = _number(11.0, 1, 30, "dry asphalt, mu 1.1")
    imu_acceleration_margin_mps2: float = _number(
        3.0, 0.5, 20, "round a_x: a 12 deg grade (2.0) and the offset (up to 1.0)"
    )
    braking_threshold_mps2: float = _number(0.5, 0.05, 5, "without a brake signal: beyond engine braking's start")
    smoothing_s: float = _number(0.2, 0.01, 2, "for v': several wheel speed frames of 10 to 20 ms")
    wheel_disagreement: float = _number(
        0.03, 0.001, 0.5, "share of speed by which wheels may differ unslipped: radii within 1 %, curves corrected"
    )
    wheel_disagreement_mps: float = _number(0.3, 0.0, 5, "quantisation and sampling of the wheel speeds")
    standstill_speed_mps: float = _number(0.1, 0.001, 1, "below what production wheel sensors resolve")
    standstill_wait_s: float = _number(1.0, 0.1, 60, "the body's rocking after the stop")


class AttitudeSettings(_Section):
    """(4)."""

    suspension_frequency_hz: float = _number(1.5, 0.3, 10, "roll and pitch of a passenger car's body")
    suspension_damping: float = _number(0.4, 0.05, 2, "share of critical")
    window_s: float = _number(5.0, 0.5, 100, "gyros above, accelerometers below")


class StiffnessSettings(_Section):
    """Adaptation after You et al. 2009."""

    adapt: bool = Field(default=True, description="off: the configured stiffnesses are used as they are")
    spread: float = _number(0.1, 0.001, 1, "standard deviation of the configured values")
    bound: float = _number(0.3, 0.01, 0.8, "largest change either way")
    steering_zero_spread_deg: float = _number(0.5, 0.001, 5, "at the road wheel: 8 deg at the hand wheel")
    noise_density_deg2s: float = _number(
        0.04, 1e-6, 10, "0.3 deg of road wheel (bank, play, roll steer), correlated over ~0.5 s"
    )
    min_lateral_acceleration_mps2: float = _number(1.0, 0.1, 5, "below, noise and bank outweigh the tyres")
    max_lateral_acceleration_mps2: float = _number(4.0, 1, 10, "above, tyres are not linear")
    min_speed_mps: float = _number(8.0, 1, 60, "below, slip angles are geometry")


class EstimatorSettings(_Section):
    """How the offsets are found. `as_printed` gives the paper's law to the letter: c_y > 1, constant gamma."""

    method: Literal["paper"] = "paper"
    as_printed: bool = False
    c_y: Annotated[float, Field(gt=0, le=3)] | None = Field(
        default=None, description="of (26); 1 unless as_printed (1.2), since e_y settles at c_y times the offset"
    )
    block_s: float = _number(
        5.0, 0.5, 600, "scatter is judged from means over this long: the slow part is what an average can't remove"
    )
    roll_pitch_rate: ZeroingSettings = _ROLL_PITCH_RATE
    yaw_rate: ZeroingSettings = _YAW_RATE
    longitudinal: ZeroingSettings = _LONGITUDINAL
    lateral: ZeroingSettings = _LATERAL
    vertical: ZeroingSettings = _VERTICAL
    gates: GateSettings = GateSettings()
    doubt: DoubtSettings = DoubtSettings()
    observer: ObserverSettings = ObserverSettings()
    speed: SpeedSettings = SpeedSettings()
    attitude: AttitudeSettings = AttitudeSettings()
    stiffness: StiffnessSettings = StiffnessSettings()

    @property
    def lateral_gain(self) -> float:
        """c_y in force."""
        return self.c_y if self.c_y is not None else (1.2 if self.as_printed else 1.0)

    def tuning(self) -> Tuning:
        """The same in SI, as the core takes it."""
        gate, speed, stiff = self.gates, self.speed, self.stiffness
        return Tuning(
            gyro_x=self.roll_pitch_rate.law(_DEG),
            gyro_y=self.roll_pitch_rate.law(_DEG),
            gyro_z=self.yaw_rate.law(_DEG),
            accel_x=self.longitudinal.law(1.0),
            accel_y=self.lateral.law(1.0),
            accel_z=self.vertical.law(1.0),
            doubt=DoubtTuning(self.doubt.sigmas, self.doubt.look_s, self.doubt.wait_s, self.doubt.memory_s),
            block_s=self.block_s,
            as_printed=self.as_printed,
            c_y=self.lateral_gain,
            k_r_rad=gate.yaw_max_road_wheel_angle_deg * _DEG,
            yaw_steering_zero_rad=gate.yaw_steering_zero_deg * _DEG,
            c1=gate.c1_longitudinal_max_tau,
            c2_m2ps2=gate.c2_longitudinal_max_speed_variance_m2ps2,
            c3_mps=gate.c3_lateral_min_speed_mps,
            c4_rad=gate.c4_lateral_max_road_wheel_angle_deg * _DEG,
            c5_rad2=gate.c5_lateral_max_steering_variance_deg2 * _DEG**2,
            c6_radps=gate.c6_lateral_max_yaw_rate_degps * _DEG,
            c7=gate.c7_vertical_max_tau,
            x_min_speed_mps=gate.longitudinal_min_speed_mps,
            turn_limit_radps=gate.roll_pitch_max_yaw_rate_degps * _DEG,
            yaw_first_std_radps=gate.yaw_first_std_degps * _DEG,
            tau_window_s=gate.tau_window_s,
            tau_smoothing_s=gate.tau_smoothing_s,
            tau_rate_scale_radps=gate.tau_rate_scale_degps * _DEG,
            tau_accel_scale_mps2=gate.tau_accel_scale_mps2,
            tau_vertical_scale_mps2=gate.tau_vertical_scale_mps2,
            tau_steering_scale_rad=gate.tau_steering_scale_deg * _DEG,
            observer_pole_per_s=self.observer.pole_per_s,
            observer_min_speed_mps=self.observer.min_speed_mps,
            neutral_steer_margin=self.observer.neutral_steer_margin,
            largest_acceleration_mps2=speed.largest_acceleration_mps2,
            largest_deceleration_mps2=speed.largest_deceleration_mps2,
            imu_acceleration_margin_mps2=speed.imu_acceleration_margin_mps2,
            braking_threshold_mps2=speed.braking_threshold_mps2,
            speed_smoothing_s=speed.smoothing_s,
            wheel_disagreement=speed.wheel_disagreement,
            wheel_disagreement_mps=speed.wheel_disagreement_mps,
            standstill_speed_mps=speed.standstill_speed_mps,
            standstill_wait_s=speed.standstill_wait_s,
            suspension_frequency_radps=2.0 * math.pi * self.attitude.suspension_frequency_hz,
            suspension_damping=self.attitude.suspension_damping,
            attitude_window_s=self.attitude.window_s,
            adapt_stiffness=stiff.adapt,
            stiffness_spread=stiff.spread,
            stiffness_bound=stiff.bound,
            steering_offset_spread_rad=stiff.steering_zero_spread_deg * _DEG,
            stiffness_noise_density_rad2s=stiff.noise_density_deg2s * _DEG**2,
            stiffness_min_ay_mps2=stiff.min_lateral_acceleration_mps2,
            stiffness_max_ay_mps2=stiff.max_lateral_acceleration_mps2,
            stiffness_min_speed_mps=stiff.min_speed_mps,
        )
