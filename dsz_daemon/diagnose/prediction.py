"""What the instruments would show if the simulation were right, with any of the effects in it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import lfilter

from dsz_daemon.compiled import compiled
from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose import motion
from dsz_daemon.diagnose.effects import COLUMNS, INDEX, KNOTS
from dsz_daemon.diagnose.motion import CarModel, moved
from dsz_daemon.diagnose.recording import ALONG_FILTER_S, DT_S, Recording, filter_kernel, filtered
from dsz_daemon.signals import IMU_CHANNELS, STANDARD_GRAVITY_MPS2

Floats = np.ndarray[Any, np.dtype[np.float64]]

G = STANDARD_GRAVITY_MPS2
# What is compared: the IMU, the wheels that don't give the speed, and the difference (right less left) of the others.
CHANNELS = (*IMU_CHANNELS, "wheel_other_left", "wheel_other_right", "wheel_difference")


_ALONG, _ALONG_KERNEL = 3, filter_kernel(ALONG_FILTER_S)


class Drive(NamedTuple):
    """One recording with the car as configured; `steer`, `wheels`, `measured` (n, 9) are the recording's own."""

    car: Car
    steering_ratio: float
    recording: Recording
    steer: Floats
    wheels: Floats
    measured: Floats
    front_gives_speed: bool


class Profiles(NamedTuple):
    """What the road and the air do, on the recording's grid (n,): bank and grade (uphill) in rad, side force in N."""

    bank_rad: Floats
    grade_rad: Floats
    side_n: Floats
    grip: Floats


def drive_of(recording: Recording, car: Car, steering_ratio: float) -> Drive:
    """A drive; short holes in steering and wheel speeds are bridged for the simulation's sake."""
    front = car.rear_driven and not car.front_driven
    steer = _bridged(recording.road_wheel_angle_rad)
    wheels = np.column_stack([_bridged(recording.wheels_mps[:, i]) for i in range(4)])
    own, other = ((0, 1), (2, 3)) if front else ((2, 3), (0, 1))
    raw = recording.wheels_mps
    measured = np.column_stack([recording.imu, raw[:, other[0]], raw[:, other[1]], raw[:, own[1]] - raw[:, own[0]]])
    measured[:, _ALONG] = filtered(measured[:, _ALONG], _ALONG_KERNEL)
    return Drive(car, steering_ratio, recording, steer, wheels, measured, front)


def flat(n: int) -> Profiles:
    """The nominal road and air."""
    nothing = np.zeros(n)
    return Profiles(nothing, nothing, nothing, nothing)


def _bridged(values: Floats) -> Floats:
    known = np.flatnonzero(np.isfinite(values))
    if len(known) == 0:
        return np.zeros(len(values))
    return np.asarray(np.interp(np.arange(len(values)), known, values[known]), dtype=np.float64)


def with_knots(road: Profiles, x: Floats) -> Profiles:
    """The road with the corrections that `x` puts on its profiles."""
    n = len(road.bank_rad)
    corrected = []
    for name, profile in (("road_bank", road.bank_rad), ("road_grade", road.grade_rad)):
        first = INDEX[f"{name}.knot_0"]
        knots = x[first : first + KNOTS]
        change = np.interp(np.arange(n), np.linspace(0, n - 1, KNOTS), knots) if knots.any() else 0.0
        corrected.append(profile + change)
    return road._replace(bank_rad=corrected[0], grade_rad=corrected[1])


def felt_road(drive: Drive, x: Floats, effects: tuple[str, ...]) -> Profiles:
    """The road that the roll and pitch gyros have felt, beyond what `x` says of them without any road.

    Both Euler angles at once, small angles: bank' = p + r slope, slope' = q - r bank, slope with the nose down.
    """
    n = len(drive.steer)
    road = flat(n)
    if not {"road_bank", "road_grade"} & set(effects):
        return road
    left = np.nan_to_num(drive.measured[:, :2] - predicted(drive, x, road)[:, :2])
    yaw = np.nan_to_num(drive.measured[:, 2] - x[INDEX["offset_gyro_z"]])
    bank, slope = _integrated(left[:, 0], left[:, 1], yaw, "road_bank" in effects, "road_grade" in effects)
    return road._replace(bank_rad=bank, grade_rad=-slope)


@compiled
def _integrated(p: Floats, q: Floats, r: Floats, banks: bool, climbs: bool) -> tuple[Floats, Floats]:
    bank, slope = np.zeros(len(p)), np.zeros(len(p))
    for i in range(1, len(p)):
        if banks:
            bank[i] = bank[i - 1] + DT_S * (0.5 * (p[i] + p[i - 1]) + r[i] * slope[i - 1])
        if climbs:
            slope[i] = slope[i - 1] + DT_S * (0.5 * (q[i] + q[i - 1]) - r[i] * bank[i - 1])
    return bank, slope


def predicted(drive: Drive, x: Floats, road: Profiles) -> Floats:
    """All channels (n, 9) for the parameters `x` (in the order of `COLUMNS`), on this road and `x`'s corrections."""
    road = with_knots(road, x)

    def at(name: str) -> float:
        return float(x[INDEX[name]])

    car, n = drive.car, len(drive.steer)
    hand = np.abs(drive.steer) * drive.steering_ratio
    ratio = 1.0 + at("steering_ratio.scale") + at("steering_ratio.per_rad") * hand
    steer = earlier(drive.steer / ratio, at("steering_delay.delay_s")) + at("steering_offset.offset_rad")
    radii = np.array([1.0 + at(f"wheel_radius.{wheel}") for wheel in ("fl", "fr", "rl", "rr")])
    wheels = drive.wheels * radii
    delay_s = at("wheel_speed_delay.delay_s")
    if delay_s > 0.0:
        wheels = np.column_stack([earlier(wheels[:, i], delay_s) for i in range(4)])
    v = np.mean(wheels[:, :2] if drive.front_gives_speed else wheels[:, 2:], axis=1)
    if drive.front_gives_speed:
        v = v / np.cos(steer)
    slips = _slips(car, at("wheel_slip.slip_per_force"), np.gradient(v, DT_S) + G * road.grade_rad)
    own = slips[:, :2] if drive.front_gives_speed else slips[:, 2:]
    v = v / (1.0 + own[:, 0])
    v_rate = np.gradient(v, DT_S)
    shift, added = at("mass_loading.cg_shift_m"), at("mass_loading.added_mass_kg")
    lf, lr = car.cg_to_front_axle_m - shift, car.cg_to_rear_axle_m + shift
    model = CarModel(
        car.mass_kg + added,
        car.yaw_inertia_kgm2,
        lf,
        lr,
        2.0 * car.front_cornering_stiffness_n_per_rad * (1.0 + at("front_cornering_stiffness")),
        2.0 * car.rear_cornering_stiffness_n_per_rad * (1.0 + at("rear_cornering_stiffness")),
        at("tyre_relaxation.relaxation_length_m"),
        at("steering_compliance.rad_per_n"),
        at("steering_backlash.width_rad"),
        at("suspension_roll.roll_gradient_rad_per_mps2"),
        motion.BODY_RADPS * (1.0 + at("suspension_roll.frequency_share")),
        motion.BODY_DAMPING + at("suspension_roll.damping"),
        at("suspension_pitch.pitch_gradient_rad_per_mps2"),
        motion.BODY_RADPS * (1.0 + at("suspension_pitch.frequency_share")),
        motion.BODY_DAMPING + at("suspension_pitch.damping"),
    )
    grip = road.grip + at("tyre_saturation.inverse_square")
    m = moved(model, steer, v, v_rate, grip, road.side_n, road.bank_rad, DT_S)
    imu = _imu(m, v, v_rate, road, at, shift)
    r, vy, delta = m[:, motion.R], m[:, motion.VY], m[:, motion.DELTA]
    shown = _wheels(car, v, vy, r, delta, lf, slips) / radii
    if delay_s > 0.0:
        shown = np.column_stack([earlier(shown[:, i], -delay_s) for i in range(4)])
    own_at, other_at = ((0, 1), (2, 3)) if drive.front_gives_speed else ((2, 3), (0, 1))
    out = np.empty((n, len(CHANNELS)))
    out[:, :6] = imu
    out[:, 6], out[:, 7] = shown[:, other_at[0]], shown[:, other_at[1]]
    out[:, _ALONG] = filtered(out[:, _ALONG], _ALONG_KERNEL)
    out[:, 8] = shown[:, own_at[1]] - shown[:, own_at[0]]
    return out


def earlier(values: Floats, by_s: float) -> Floats:
    """What the values will be `by_s` later (what a late sensor has not told yet); level beyond the ends."""
    if by_s == 0.0:
        return values
    place = np.arange(len(values)) + by_s / DT_S
    return np.asarray(np.interp(place, np.arange(len(values)), values), dtype=np.float64)


def _slips(car: Car, slip: float, pull_mps2: Floats) -> Floats:
    """Each wheel's slip (n, 4): drive on the driven axles, brakes by load (the same share of load everywhere)."""
    slips = np.zeros((len(pull_mps2), 4))
    if slip == 0.0:
        return slips
    wheelbase = car.cg_to_front_axle_m + car.cg_to_rear_axle_m
    front_load, rear_load = car.cg_to_rear_axle_m / wheelbase, car.cg_to_front_axle_m / wheelbase
    front_share = front_load if car.front_driven and car.rear_driven else 1.0 if car.front_driven else 0.0
    driving = np.maximum(pull_mps2, 0.0) / G
    braking = np.minimum(pull_mps2, 0.0) / G
    slips[:, :2] = (slip * (braking + driving * front_share / front_load))[:, np.newaxis]
    slips[:, 2:] = (slip * (braking + driving * (1.0 - front_share) / rear_load))[:, np.newaxis]
    return slips


def _wheels(car: Car, v: Floats, vy: Floats, r: Floats, delta: Floats, lf: float, slips: Floats) -> Floats:
    """Each wheel's speed along its own heading (n, 4), slip included."""
    front = np.column_stack([v - 0.5 * r * car.front_track_m, v + 0.5 * r * car.front_track_m])
    front = front * np.cos(delta)[:, np.newaxis] + ((vy + lf * r) * np.sin(delta))[:, np.newaxis]
    rear = np.column_stack([v - 0.5 * r * car.rear_track_m, v + 0.5 * r * car.rear_track_m])
    return np.column_stack([front, rear]) * (1.0 + slips)


def _imu(m: Floats, v: Floats, v_rate: Floats, road: Profiles, at: Any, shift_m: float) -> Floats:
    """The IMU's readings (n, 6): motion and gravity at its place, then the sensors' own faults."""
    r, r_rate, vy = m[:, motion.R], m[:, motion.R_RATE], m[:, motion.VY]
    bank, slope = road.bank_rad, -road.grade_rad
    # Euler rates to body rates, first order in the angles; the body's lean turns with the car.
    roll, pitch = bank + m[:, motion.ROLL], slope + m[:, motion.PITCH]
    p_road, q_road = np.gradient(bank, DT_S) - r * slope, np.gradient(slope, DT_S) + r * bank
    p = p_road + m[:, motion.ROLL_RATE] - r * m[:, motion.PITCH]
    q = q_road + m[:, motion.PITCH_RATE] + r * m[:, motion.ROLL]
    # Along the road's own axes first; the body is turned against these by its lean and its dive.
    along, across = v_rate - r * vy, m[:, motion.AY]
    lean, dive = m[:, motion.ROLL], m[:, motion.PITCH]
    ax = along * np.cos(dive) - G * np.sin(pitch)
    ay = across * np.cos(lean) + G * np.sin(roll)
    az = -q_road * v + p_road * vy + G * np.cos(roll) * np.cos(pitch) - across * np.sin(lean) + along * np.sin(dive)
    x, y, z = at("imu_lever_arm.x_m") - shift_m, at("imu_lever_arm.y_m"), at("imu_lever_arm.z_m")
    p_rate, q_rate = np.gradient(p, DT_S), np.gradient(q, DT_S)
    force = np.column_stack(
        [
            ax - (q * q + r * r) * x + (p * q - r_rate) * y + (p * r + q_rate) * z,
            ay + (p * q + r_rate) * x - (p * p + r * r) * y + (q * r - p_rate) * z,
            az + (p * r - q_rate) * x + (q * r + p_rate) * y - (p * p + q * q) * z,
        ]
    )
    rate = np.column_stack([p, q, r])
    turn_x, turn_y, turn_z = (at(f"imu_misalignment.{axis}_rad") for axis in ("roll", "pitch", "yaw"))
    turn = np.array([[1.0, turn_z, -turn_y], [-turn_z, 1.0, turn_x], [turn_y, -turn_x, 1.0]])
    force, rate = force @ turn.T, rate @ turn.T
    pulled = rate @ _matrix(at, "gyro_scale", "gyro_cross_axis").T
    pulled = pulled + force @ np.array([[at(f"gyro_g_sensitivity.{i}{j}") for j in "xyz"] for i in "xyz"]).T
    felt = force @ _matrix(at, "accel_scale", "accel_cross_axis").T
    shown = np.column_stack([pulled, felt])
    time_constant_s = at("sensor_bandwidth.time_constant_s")
    if time_constant_s > 0.0:
        keep = math.exp(-DT_S / time_constant_s)
        # Exact for what is straight between two instants, so that the sampling adds no delay of its own.
        share = 1.0 + (keep - 1.0) * time_constant_s / DT_S
        rest = 1.0 - keep - share
        shown = lfilter([share, rest], [1.0, -keep], shown, axis=0, zi=(shown[0] * (1.0 - share))[np.newaxis])[0]
    if at("imu_delay.delay_s") > 0.0:
        shown = np.column_stack([earlier(shown[:, i], -at("imu_delay.delay_s")) for i in range(6)])
    time_s = DT_S * np.arange(len(r)) - 0.5 * DT_S * len(r)
    for i, channel in enumerate(IMU_CHANNELS):
        shown[:, i] += at(f"offset_{channel}") + at(f"bias_drift.{channel}") * time_s
    return np.asarray(shown, dtype=np.float64)


def _matrix(at: Any, scale: str, cross: str) -> Floats:
    rows = [[at(f"{scale}.{i}") if i == j else at(f"{cross}.{i}{j}") for j in "xyz"] for i in "xyz"]
    return np.asarray(np.eye(3) + np.array(rows), dtype=np.float64)


def nothing() -> Floats:
    """All parameters at 0: the nominal simulation."""
    return np.zeros(len(COLUMNS))
