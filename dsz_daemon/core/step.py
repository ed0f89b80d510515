"""One tick of the estimator: `step(car, tuning, state, inputs, dt_s)` is the product.

All memory is in the state; saving it and resuming equals never stopping. No clock, no
randomness: time enters as dt_s. The order is the paper's data flow:
speed (3.1) -> gyros (10)-(15) -> attitude, (4) -> observer (1)-(9) -> references (20)-(22)
-> gates (29), Table 3 -> accelerometers (23)-(28) -> stiffness adaptation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.core import bicycle, curve, doubt, gates, kinematics, speed, stiffness, zeroing
from dsz_daemon.core.motion import (
    Motion,
    moved,
    observed_motion,
    reference_accelerations,
    turned_attitude,
    used_yaw_rate,
)
from dsz_daemon.core.outputs import ChannelOutput, ChannelState, Reason, StepOutput
from dsz_daemon.core.parameters import Car, Inputs, Tuning, ZeroingTuning
from dsz_daemon.core.state import EstimatorState
from dsz_daemon.core.zeroing import ZeroingState

NAN = math.nan

_Three = tuple[ZeroingState, ZeroingState, ZeroingState]
_Whys = tuple[Reason, Reason, Reason]


def step(
    car: Car, tuning: Tuning, state: EstimatorState, inputs: Inputs, dt_s: float
) -> tuple[EstimatorState, StepOutput]:
    """One tick: the new state, and what it says. dt_s > 0 in seconds; NaN inputs are never learnt from."""
    state, seen = advanced(car, tuning, state, inputs, dt_s)
    return state, _output(car, tuning, state, seen)


class Seen(NamedTuple):
    """What a tick went by: its inputs (finite, wheels signed), motion, references, and why which channel held."""

    inputs: Inputs
    motion: Motion
    references: tuple[float, float, float]
    reasons: tuple[Reason, Reason, Reason, Reason, Reason, Reason]


def advanced(
    car: Car, tuning: Tuning, state: EstimatorState, inputs: Inputs, dt_s: float
) -> tuple[EstimatorState, Seen]:
    """The new state after one tick."""
    inputs = speed.signed_wheels(_finite(inputs))
    before, speed_state = moved(car, tuning, state, inputs, dt_s)
    bend = curve.advanced_curve(state.curve, car, inputs, before.delta, dt_s)
    agreed = curve.agreed_yaw_rate(bend, car, before.v, tuning) if before.speed_valid else 0.0
    gyros, why_gyro = _zeroed_gyros(state, inputs, before, agreed, tuning, dt_s)
    motion = Motion(
        zeroing.compensated(inputs.gyro_x, gyros[0]),
        zeroing.compensated(inputs.gyro_y, gyros[1]),
        used_yaw_rate(zeroing.compensated(inputs.gyro_z, gyros[2]), inputs, car, before.v, before.delta),
        before.delta,
        before.v,
        before.v_rate,
        before.speed_valid,
        before.standstill,
        before.slip,
    )
    ax = zeroing.compensated(inputs.accel_x, state.accel_x)
    ay = zeroing.compensated(inputs.accel_y, state.accel_y)
    az = zeroing.compensated(inputs.accel_z, state.accel_z)
    lean = state.attitude
    ay_road = kinematics.road_lateral_acceleration(
        ay, lean.roll_rad, lean.pitch_rad, lean.suspension_roll_rad, lean.suspension_pitch_rad
    )
    observer = observed_motion(car, tuning, state, motion, ay_road, dt_s)
    references = reference_accelerations(motion, observer)
    watched = (
        motion.p,
        motion.q,
        motion.r,
        ax,
        ay,
        az,
        motion.delta,
        motion.v if motion.speed_valid else NAN,
    )
    transient = gates.watched(state.transient, watched, tuning, dt_s)
    accels, why_accel = _zeroed_accelerometers(state, gyros[2], transient, inputs, motion, references, tuning, dt_s)
    new = EstimatorState(
        gyros[0],
        gyros[1],
        gyros[2],
        accels[0],
        accels[1],
        accels[2],
        speed_state,
        observer,
        turned_attitude(state.attitude, car, tuning, motion, ax, ay, references, dt_s),
        transient,
        stiffness.adapted(
            state.stiffness,
            car,
            motion.v,
            inputs.gyro_z + gyros[2].correction,
            ay_road,
            inputs.road_wheel_angle,
            tuning,
            dt_s,
        ),
        bend,
    )
    return new, Seen(inputs, motion, references, why_gyro + why_accel)


def _finite(inputs: Inputs) -> Inputs:
    """What is no finite number is missing."""
    return Inputs(
        _number(inputs.gyro_x),
        _number(inputs.gyro_y),
        _number(inputs.gyro_z),
        _number(inputs.accel_x),
        _number(inputs.accel_y),
        _number(inputs.accel_z),
        _number(inputs.wheel_speed_fl),
        _number(inputs.wheel_speed_fr),
        _number(inputs.wheel_speed_rl),
        _number(inputs.wheel_speed_rr),
        _number(inputs.road_wheel_angle),
        _number(inputs.brake),
        _number(inputs.accelerator),
        _number(inputs.reverse),
    )


def _number(x: float) -> float:
    return x if math.isfinite(x) else NAN


def _learned(
    state: ZeroingState,
    law: ZeroingTuning,
    reading: float,
    reference: float,
    reason: Reason,
    standstill: bool,
    tuning: Tuning,
    dt_s: float,
    c: float,
    neglected: float,
) -> tuple[ZeroingState, Reason]:
    """One channel's zeroing: open gate, believable target, not contradicted -> learn; else hold."""
    target = reference - reading
    if math.isnan(reading):
        reason = Reason.STALE
    elif reason is Reason.NONE and not abs(target) <= law.largest_offset:
        reason = Reason.IMPLAUSIBLE
    if not standstill or tuning.as_printed or reason is not Reason.NONE:
        state = doubt.unlooked(state)
    else:
        state, believed = doubt.looked(state, target, law, tuning.doubt, dt_s)
        reason = Reason.NONE if believed else Reason.DOUBTED
    if reason is not Reason.NONE:
        return zeroing.held(state, law, dt_s), reason
    printed = tuning.as_printed
    return zeroing.zeroed(state, target, standstill, law, printed, tuning.block_s, dt_s, c, neglected), Reason.NONE


def _zeroed_gyros(
    state: EstimatorState, inputs: Inputs, motion: Motion, agreed: float, tuning: Tuning, dt_s: float
) -> tuple[_Three, _Whys]:
    """(10)-(15): targets -p*, -q*, -r*; `agreed` is the yaw rate that the last one neglects."""
    still = motion.standstill
    tilt = gates.roll_pitch_gate(motion.r, still, tuning)
    yaw = gates.yaw_gate(motion.delta, still, tuning)
    neglected = 0.0 if tuning.as_printed else agreed
    x, why_x = _learned(state.gyro_x, tuning.gyro_x, inputs.gyro_x, 0.0, tilt, still, tuning, dt_s, 1.0, 0.0)
    y, why_y = _learned(state.gyro_y, tuning.gyro_y, inputs.gyro_y, 0.0, tilt, still, tuning, dt_s, 1.0, 0.0)
    z, why_z = _learned(state.gyro_z, tuning.gyro_z, inputs.gyro_z, 0.0, yaw, still, tuning, dt_s, 1.0, neglected)
    return (x, y, z), (why_x, why_y, why_z)


def _zeroed_accelerometers(
    state: EstimatorState,
    yaw: ZeroingState,
    transient: gates.TransientState,
    inputs: Inputs,
    motion: Motion,
    references: tuple[float, float, float],
    tuning: Tuning,
    dt_s: float,
) -> tuple[_Three, _Whys]:
    """(23)-(28) through the gates of Table 3; `yaw` is the yaw rate's state at this tick."""
    yaw_std = zeroing.offset_std(yaw, tuning.gyro_z)
    if tuning.as_printed or math.isnan(inputs.gyro_z):
        yaw_std = 0.0
    valid, v = motion.speed_valid, motion.v
    z_x = gates.longitudinal_gate(transient, v, valid, motion.slip, tuning)
    z_y = gates.lateral_gate(transient, v, valid, motion.delta, motion.r, yaw_std, tuning)
    z_z = gates.vertical_gate(transient, valid, tuning)
    c_y = tuning.c_y
    x, why_x = _learned(
        state.accel_x, tuning.accel_x, inputs.accel_x, references[0], z_x, False, tuning, dt_s, 1.0, 0.0
    )
    y, why_y = _learned(
        state.accel_y, tuning.accel_y, inputs.accel_y, references[1], z_y, False, tuning, dt_s, c_y, 0.0
    )
    z, why_z = _learned(
        state.accel_z, tuning.accel_z, inputs.accel_z, references[2], z_z, False, tuning, dt_s, 1.0, 0.0
    )
    return (x, y, z), (why_x, why_y, why_z)


def channel_output(reading: float, state: ZeroingState, law: ZeroingTuning, reason: Reason) -> ChannelOutput:
    """What one channel says after a tick."""
    std = zeroing.offset_std(state, law)
    gate = reason is Reason.NONE
    if math.isnan(reading):
        verdict = ChannelState.INVALID
    elif std <= law.goal_std:
        verdict = ChannelState.CONVERGED
    else:
        verdict = ChannelState.LEARNING if gate else ChannelState.HOLDING
    return ChannelOutput(
        reading, zeroing.compensated(reading, state), 0.0 - state.correction, std, verdict, gate, reason
    )


def _output(car: Car, tuning: Tuning, state: EstimatorState, seen: Seen) -> StepOutput:
    inputs, motion, references, reasons = seen
    known = motion.speed_valid
    beta = state.observer.sideslip_rad if known else NAN
    return StepOutput(
        gyro_x=channel_output(inputs.gyro_x, state.gyro_x, tuning.gyro_x, reasons[0]),
        gyro_y=channel_output(inputs.gyro_y, state.gyro_y, tuning.gyro_y, reasons[1]),
        gyro_z=channel_output(inputs.gyro_z, state.gyro_z, tuning.gyro_z, reasons[2]),
        accel_x=channel_output(inputs.accel_x, state.accel_x, tuning.accel_x, reasons[3]),
        accel_y=channel_output(inputs.accel_y, state.accel_y, tuning.accel_y, reasons[4]),
        accel_z=channel_output(inputs.accel_z, state.accel_z, tuning.accel_z, reasons[5]),
        speed_mps=motion.v if known else NAN,
        sideslip_rad=beta,
        lateral_velocity_mps=bicycle.lateral_velocity(motion.v, beta) if known else NAN,
        yaw_rate_model_radps=state.observer.yaw_rate_radps if known else NAN,
        road_wheel_angle_rad=motion.delta,
        accel_x_reference_mps2=references[0],
        accel_y_reference_mps2=references[1],
        accel_z_reference_mps2=references[2],
        tau=gates.transient(state.transient, tuning),
        roll_rad=state.attitude.roll_rad,
        pitch_rad=state.attitude.pitch_rad,
        suspension_roll_rad=state.attitude.suspension_roll_rad,
        suspension_pitch_rad=state.attitude.suspension_pitch_rad,
        front_cornering_stiffness_n_per_rad=stiffness.front_stiffness(state.stiffness, car),
        rear_cornering_stiffness_n_per_rad=stiffness.rear_stiffness(state.stiffness, car),
        standstill=motion.standstill,
    )
