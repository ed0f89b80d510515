"""What one step of the estimator says, per channel and as a whole."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class ChannelState(IntEnum):
    """How far one channel's offset can be trusted; the names are those of `samples.parquet`."""

    INVALID = 0
    HOLDING = 1
    LEARNING = 2
    CONVERGED = 3


class Reason(IntEnum):
    """Why a channel is not learning at this step (or why its input is invalid)."""

    NONE = 0
    NOT_MAPPED = 1
    STALE = 2
    TRANSIENT = 3
    SPEED_VARIES = 4
    TOO_SLOW = 5
    STEERING_LARGE = 6
    STEERING_MOVES = 7
    TURNING = 8
    NO_SPEED = 9
    NO_STEERING = 10
    REVERSING = 11
    WHEELS_SLIP = 12
    SETTLING = 13
    IMPLAUSIBLE = 14
    DOUBTED = 15


class ChannelOutput(NamedTuple):
    """One IMU channel after a step, in rad/s or m/s^2; NaN where there is no reading.

    `offset` is reading minus truth (the paper's e is its negative): compensated = raw - offset.
    `gate` tells whether the offset was learning during this step.
    """

    raw: float
    compensated: float
    offset: float
    offset_std: float
    state: ChannelState
    gate: bool
    reason: Reason


class StepOutput(NamedTuple):
    """Everything that one step says. Angles: roll left side up, pitch nose down positive."""

    gyro_x: ChannelOutput
    gyro_y: ChannelOutput
    gyro_z: ChannelOutput
    accel_x: ChannelOutput
    accel_y: ChannelOutput
    accel_z: ChannelOutput
    speed_mps: float
    sideslip_rad: float
    lateral_velocity_mps: float
    yaw_rate_model_radps: float
    road_wheel_angle_rad: float
    accel_x_reference_mps2: float
    accel_y_reference_mps2: float
    accel_z_reference_mps2: float
    tau: float
    roll_rad: float
    pitch_rad: float
    suspension_roll_rad: float
    suspension_pitch_rad: float
    front_cornering_stiffness_n_per_rad: float
    rear_cornering_stiffness_n_per_rad: float
    standstill: bool

    @property
    def channels(self) -> tuple[ChannelOutput, ...]:
        """The six channels in the order of `signals.IMU_CHANNELS`."""
        return self[:6]
