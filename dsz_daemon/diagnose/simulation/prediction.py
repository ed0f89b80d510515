"""What the instruments would show if the simulation were right, with any of the effects in it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose.effects.row import Motion, Parameter
from dsz_daemon.diagnose.effects.surroundings import KNOTS
from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, INDEX, Vocabulary
from dsz_daemon.diagnose.recordings.recording import ALONG_FILTER_S, DT_S, REFERENCE, Recording, filter_kernel
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.instruments import (
    add_offsets,
    delayed,
    felt,
    followed,
    low_passed,
    rate_of,
    rolled,
    side_by_side,
)
from dsz_daemon.diagnose.simulation.loads import inertia_of_a_load_kgm2
from dsz_daemon.diagnose.simulation.motion import CarModel, moved
from dsz_daemon.diagnose.simulation.own_courses import pushed_by, turned_by
from dsz_daemon.diagnose.simulation.play import geared, held_back, lost_in_play
from dsz_daemon.diagnose.simulation.rolling import Rolling, Slip, earlier, rolling
from dsz_daemon.diagnose.simulation.slow_sensors import smoothed
from dsz_daemon.diagnose.simulation.wheel_readings import as_they_read, as_they_roll, locks_in_front
from dsz_daemon.signals import IMU_CHANNELS, STANDARD_GRAVITY_MPS2

Floats = np.ndarray[Any, np.dtype[np.float64]]
Ints = np.ndarray[Any, np.dtype[np.int64]]

G = STANDARD_GRAVITY_MPS2
# What is compared: the IMU, the wheels that don't give the speed, the difference (right less left) of the others, and
# what a reference brings.
CHANNELS = (
    *IMU_CHANNELS,
    "wheel_other_left",
    "wheel_other_right",
    "wheel_difference",
    *(f"reference_{name}" for name in REFERENCE),
)


def _places(effect: str, names: str) -> Ints:
    return np.array([INDEX[(f"{effect}." if effect else "") + name] for name in names.split()])


def _matrix(scale: str, cross: str) -> Ints:
    """Places (3, 3) of what axes show of each other; on the diagonal those of `scale`, if there is one."""
    rows = [[f"{scale}.{i}" if scale and i == j else f"{cross}.{i}{j}" for j in "xyz"] for i in "xyz"]
    return np.array([[INDEX[name] for name in row] for row in rows])


ALONG, ALONG_KERNEL = 3, filter_kernel(ALONG_FILTER_S)
_WHEELS = ("fl", "fr", "rl", "rr")
# Whatever is known before the car moves sideways depends on these effects' parameters, on these of none, and the road.
ROLL = frozenset(
    {"steering_ratio", "steering_delay", "steering_offset", "wheel_radius", "wheel_square", "wheel_speed_delay"}
    | {"steering_lag", "wheel_growth", "wheels_more", "wheel_slip", "tyre_saturation", "low_friction", "road_grade"}
    | {"steering_skew_s", "large_angles", "drive_steer", "brake_steer", "steers_by_force"}
    | {"small_wheels", "unturned_wheels", "steering_backlash", "steering_friction"}
)
_OF_ROLL = np.array([i for i, (effect, parameter) in enumerate(BUILT_IN.columns) if ROLL & {effect, parameter.name}])
# Where an IMU's numbers stand among all of them; of matrices (3, 3) what is shown of what.
_LIFT = INDEX["nose_lift.rad_per_v2"]
_LEVER, _TURN = _places("imu_lever_arm", "x_m y_m z_m"), _places("imu_misalignment", "roll_rad pitch_rad yaw_rad")
_SMALL_TURNS, _AS_DRAWN = INDEX["small_turns"], _places("", "small_turns flat_roads flat_bends")
_BODY = np.concatenate([_places("suspension_roll", "above_m"), _places("suspension_pitch", "above_m ahead_m")])
# What instruments alone make of the motion, though the effects that have these move the car, too.
SHOWN = frozenset([*_BODY.tolist(), *_AS_DRAWN.tolist()])
_RATES_OF_RATES, _FORCES_OF_FORCES = (_matrix(f"{kind}_scale", f"{kind}_cross_axis") for kind in ("gyro", "accel"))
_SHOWN_OF = np.stack([_RATES_OF_RATES, _matrix("", "gyro_g_sensitivity"), _FORCES_OF_FORCES])
_OFFSETS = _places("", " ".join(f"offset_{channel}" for channel in IMU_CHANNELS))
_DRIFTS, _FADES = _places("bias_drift", " ".join(IMU_CHANNELS)), INDEX["bias_drift.fades_per_s"]
_ONES = np.eye(3)
_OWN = np.stack([_ONES, 0.0 * _ONES, _ONES])
_AT_LIMIT = 1.05
# Of the configured stiffness: less is no tyre.
_SOFTEST = 0.05
_NONE = np.zeros(len(CHANNELS))


class Drive(NamedTuple):
    """One recording with the car as configured; `steer`, `wheels`, `measured` (n, 13) are the recording's own.

    `theirs` (n, 13): what the user's simulation has more than the nominal one, taken off `measured`. `steps` (13,):
    what the steering's resolution leaves in each channel, rms, which is the same for `steps_rows` (13,). `noise`
    (n, 6): what more noise on wheel speeds and steering, as much as they have, does to the IMU's channels. `told_steer`
    (n,): `steer` before its low-pass.
    """

    car: Car
    steering_ratio: float
    recording: Recording
    steer: Floats
    wheels: Floats
    measured: Floats
    front_gives_speed: bool
    vocabulary: Vocabulary = BUILT_IN
    theirs: Floats | None = None
    steps: Floats = _NONE
    steps_rows: Floats = _NONE
    noise: Floats | None = None
    told_steer: Floats = np.zeros(0)


class Profiles(NamedTuple):
    """What the road and the air do, on the recording's grid (n,): bank and grade (uphill) in rad, side force in N.

    `lean_mps2`: what leans the body, whatever the simulated tyres do; `lean_share` of what these do is in it. The rest
    is lateral acceleration that is in no simulation, and leans the body all the same.
    """

    bank_rad: Floats
    grade_rad: Floats
    side_n: Floats
    grip: Floats
    lean_mps2: Floats
    lean_share: float = 0.0


def flat(n: int) -> Profiles:
    """The nominal road and air."""
    nothing = np.zeros(n)
    return Profiles(nothing, nothing, nothing, nothing, nothing)


def on_road(road: Profiles, x: Floats) -> Profiles:
    """The road with the corrections that `x` puts on its profiles, and with its slippery stretch."""
    n, tilts = len(road.bank_rad), (("road_bank", road.bank_rad), ("road_grade", road.grade_rad))
    more = [correction(x, name, n) for name, _ in tilts]
    corrected = [tilt + own if len(own) == n else tilt for (_, tilt), own in zip(tilts, more, strict=True)]
    ends = x[INDEX["tyre_saturation.inverse_square"]]
    grip = road.grip + ends if ends != 0.0 else road.grip
    slippery = x[INDEX["low_friction.inverse_square"]]
    if slippery != 0.0:
        start, end = x[INDEX["low_friction.start_s"]] / DT_S, x[INDEX["low_friction.end_s"]] / DT_S
        place = np.arange(n)
        inside = np.clip(place - start + 0.5, 0.0, 1.0) * np.clip(end - place + 0.5, 0.0, 1.0)
        grip = np.maximum(grip, slippery * inside)
    return road._replace(bank_rad=corrected[0], grade_rad=corrected[1], grip=grip)


def correction(x: Floats, profile: str, n: int) -> Floats:
    """What the knots of a road's profile add to it, rad: (n,), or (1,) where that is nothing."""
    first = INDEX[f"{profile}.knot_0"]
    knots = x[first : first + KNOTS]
    return np.interp(np.arange(n), np.linspace(0, n - 1, KNOTS), knots) if knots.any() else np.zeros(1)


class Moving(NamedTuple):
    """The car on its drive: motion (n, 12), speed and its rate (n,), what is compared of the wheels (n, 3), the road.

    `rolling`: what is known before the car moves sideways. `imu_ahead_m`: how far the IMU stands ahead of where the
    C.G. is, without being moved itself.
    """

    moved: Floats
    v_mps: Floats
    v_rate: Floats
    wheels: Floats
    imu_ahead_m: float
    road: Profiles
    rolling: Rolling


def predicted(drive: Drive, x: Floats, road: Profiles, rolls: Rolling | None = None) -> Floats:
    """All channels (n, 13) for the parameters `x` (in the order of `COLUMNS`), on this road and `x`'s corrections."""
    return shown(drive, x, driven(drive, x, road, rolls))


# A car that has become unstable is infinitely wrong; whoever compares looks at that.
@np.errstate(over="ignore", invalid="ignore")
def driven(drive: Drive, x: Floats, road: Profiles, rolls: Rolling | None = None) -> Moving:
    """The car's motion for the parameters `x`; of those that `touches` calls the sensors' it knows nothing.

    `rolls`: of another `x` on the same road that differs in none of `ROLL`.
    """
    rolls, road = rolls_of(drive, x, road) if rolls is None else rolls, on_road(road, x)

    def at(name: str) -> float:
        return float(x[INDEX[name]])

    radii = np.array([1.0 + at(f"wheel_radius.{wheel}") for wheel in _WHEELS])
    model = car_of(drive, x)
    given = (rolls.steer_rad, rolls.v_mps, rolls.v_rate, rolls.front_mps, road.grip, road.side_n)
    leaning = (road.bank_rad, road.grade_rad, road.lean_mps2)
    pushes = pushed_by(drive.vocabulary, x, len(drive.steer))
    m = moved(model, *given, *leaning, road.lean_share, rolls.front_free, rolls.rear_free, pushes, DT_S)
    v, v_rate = rolls.v_mps, rolls.v_rate
    if drive.front_gives_speed:
        v = m[:, motion.SPEED].copy()
        v_rate = rate_of(v, DT_S)
    rear_track_m = drive.car.rear_track_m * (1.0 + at("rear_track_m") + at("track_width.rear"))
    apart = 1.0 - at("locked_axle.share")
    in_front = locks_in_front(drive.car)
    tracks_m = (model.front_track_m * (apart if in_front else 1.0), rear_track_m * (1.0 if in_front else apart))
    wheels_mps = rolled(
        m,
        v,
        rolls.front_slip,
        rolls.rear_slip,
        model.cg_to_front_axle_m,
        *tracks_m,
        radii,
        at("wheel_slip.side_load_m"),
        *(model.small_wheels, model.unturned_wheels, model.nearer),
    )
    compared = _compared(drive, as_they_read(wheels_mps, x), at("wheel_speed_delay.delay_s"))
    return Moving(m, v, v_rate, compared, -at("mass_loading.cg_shift_m"), road, rolls)


def car_of(drive: Drive, x: Floats) -> CarModel:
    """What moves the car, for the parameters `x`."""

    def at(name: str) -> float:
        return float(x[INDEX[name]])

    car = drive.car
    shift, added = at("mass_loading.cg_shift_m"), at("mass_loading.added_mass_kg")
    lf = car.cg_to_front_axle_m * (1.0 + at("cg_to_front_axle_m")) - shift
    lr = car.cg_to_rear_axle_m * (1.0 + at("cg_to_rear_axle_m")) + shift
    front = at("front_cornering_stiffness_n_per_rad") + at("cornering_stiffness.front_scale")
    rear = at("rear_cornering_stiffness_n_per_rad") + at("cornering_stiffness.rear_scale")
    front_track_m = car.front_track_m * (1.0 + at("front_track_m") + at("track_width.front"))
    return CarModel(
        car.mass_kg * (1.0 + at("mass_kg")) + added,
        car.yaw_inertia_kgm2 * (1.0 + at("yaw_inertia_kgm2") + at("yaw_inertia.share"))
        + at("mass_loading.turns") * inertia_of_a_load_kgm2(car, added, shift),
        lf,
        lr,
        2.0 * car.front_cornering_stiffness_n_per_rad * max(1.0 + front, _SOFTEST),
        2.0 * car.rear_cornering_stiffness_n_per_rad * max(1.0 + rear, _SOFTEST),
        at("tyre_relaxation.relaxation_length_m"),
        at("steering_compliance.rad_per_n"),
        at("suspension_roll.roll_gradient_rad_per_mps2"),
        motion.BODY_RADPS * (1.0 + at("suspension_roll.frequency_share")),
        motion.BODY_DAMPING + at("suspension_roll.damping"),
        at("suspension_pitch.pitch_gradient_rad_per_mps2"),
        motion.BODY_RADPS * (1.0 + at("suspension_pitch.frequency_share")),
        motion.BODY_DAMPING + at("suspension_pitch.damping"),
        at("suspension_pitch.air_per_m"),
        motion.SHARPNESS + at("tyre_saturation.sharpness") + at("low_friction.sharpness"),
        at("side_wind.ahead_m"),
        at("side_wind.leans"),
        at("steered_pull"),
        at("steered_brake"),
        at("parallel_steer"),
        front_track_m,
        at("hasty_s"),
        at("load_height_m"),
        at("suspension_roll.swings_m"),
        at("small_wheels"),
        at("unturned_wheels"),
        at("wheels_apart") * 0.5 * front_track_m / (lf + lr),
    )


def rolls_of(drive: Drive, x: Floats, road: Profiles) -> Rolling:
    """What is known before the car moves sideways, for the parameters of `ROLL` on this road with `x`'s corrections."""
    road = on_road(road, x)

    def at(name: str) -> float:
        return float(x[INDEX[name]])

    ratio = drive.steering_ratio, at("steering_ratio.scale"), at("steering_ratio.per_rad")
    steer = geared(drive.steer, *ratio)
    if (width_rad := at("steering_friction.width_rad")) > 0.0:
        steer = steer - held_back(steer, width_rad, at("steering_friction.softness"))
    if (width_rad := at("steering_backlash.width_rad")) > 0.0:
        steer = steer - lost_in_play(geared(drive.told_steer, *ratio), width_rad, drive.recording.told_kernel)
    if at("steering_lag.time_constant_s") > 0.0:
        steer = followed(steer.reshape(-1, 1), at("steering_lag.time_constant_s"), DT_S)[:, 0]
    late_s = at("steering_delay.delay_s") + at("steering_skew_s")
    steer = earlier(steer / (1.0 + at("steering_ratio")), late_s) + at("steering_offset.offset_rad")
    if at("large_angles") != 0.0:
        # An angle for its sine, or for its tangent.
        steer = steer + at("large_angles") * (steer * steer * steer)
    steer = steer + turned_by(drive.vocabulary, x)
    radii = np.array([1.0 + at(f"wheel_radius.{wheel}") for wheel in _WHEELS])
    own = slice(0, 2) if drive.front_gives_speed else slice(2, 4)
    wheels = as_they_roll(drive.wheels, x)
    rolled_mps = earlier(wheels[:, own] @ (0.5 * radii[own]), at("wheel_speed_delay.delay_s"))
    slip = Slip(*(at(f"wheel_slip.{name}") for name in Slip._fields))
    ellipse = max(at("tyre_saturation.ellipse"), at("low_friction.ellipse")) * road.grip
    aside = at("drive_steer"), at("brake_steer"), at("steers_by_force")
    by_front, front = drive.front_gives_speed, (at("small_wheels"), at("unturned_wheels"))
    return rolling(drive.car, steer, rolled_mps, by_front, slip, ellipse, road.grade_rad, aside, front)


def of_roll(x: Floats) -> Floats:
    """The parameters of `ROLL`, and of what is behind the built-in rows."""
    return np.concatenate([x[_OF_ROLL], x[len(BUILT_IN.columns) :]])


def _compared(drive: Drive, wheels_mps: Floats, late_s: float) -> Floats:
    """Of what the wheels (n, 4) roll, what is shown of those that don't give the speed, and the others' difference."""
    if late_s != 0.0:
        wheels_mps = delayed(wheels_mps, late_s, DT_S)
    left, right, own_left, own_right = (2, 3, 0, 1) if drive.front_gives_speed else (0, 1, 2, 3)
    return np.column_stack(
        [wheels_mps[:, left], wheels_mps[:, right], wheels_mps[:, own_right] - wheels_mps[:, own_left]]
    )


@np.errstate(over="ignore", invalid="ignore")
def shown(drive: Drive, x: Floats, moving: Moving) -> Floats:
    """What the instruments make of the motion: all channels (n, 13)."""
    reads = _imu(x, moving, moving.imu_ahead_m)
    out = side_by_side(reads, moving.wheels, moving.moved, moving.v_mps, moving.road.grade_rad)
    _clip(drive, x, out)
    _add_own(drive, x, moving, out)
    out[:, ALONG] = low_passed(out[:, ALONG], ALONG_KERNEL)
    return out


def _clip(drive: Drive, x: Floats, out: Floats) -> None:
    """Limits the IMU's channels; az only if it stands at the limit: a sensor's z may well reach further than 1 g."""
    gyro, accel = x[INDEX["sensor_saturation.gyro_limit_radps"]], x[INDEX["sensor_saturation.accel_limit_mps2"]]
    if gyro > 0.0:
        np.clip(out[:, :3], -gyro, gyro, out=out[:, :3])
    if accel > 0.0:
        upright = float(np.nanmedian(np.abs(drive.measured[:, 5]))) if np.isfinite(drive.measured[:, 5]).any() else 0.0
        last = 6 if upright < _AT_LIMIT * accel else 5
        np.clip(out[:, 3:last], -accel, accel, out=out[:, 3:last])


def _add_own(drive: Drive, x: Floats, moving: Moving, out: Floats) -> None:
    """What the user's own effects show."""
    m = moving.moved
    for effect in drive.vocabulary.own():
        values = {p.name: float(x[i]) for i, p in _own_parameters(drive, effect.name)}
        if effect.shows is None or not any(values.values()):
            continue
        motion_ = Motion(
            drive.recording.time_s,
            moving.v_mps,
            moving.v_rate - m[:, motion.R] * m[:, motion.VY],
            m[:, motion.VY],
            m[:, motion.R],
            m[:, motion.AY],
            m[:, motion.DELTA],
        )
        for channel, values_of in effect.shows(motion_, values).items():
            out[:, CHANNELS.index(channel)] += values_of


def _own_parameters(drive: Drive, name: str) -> list[tuple[int, Parameter]]:
    return [(i, drive.vocabulary.columns[i][1]) for i in drive.vocabulary.columns_of(name)]


def _imu(x: Floats, moving: Moving, ahead_m: float) -> Floats:
    """The IMU's readings (n, 6); the C.G. is `ahead_m` less far from the front axle than it is configured."""
    m = moving.moved
    if (lift := float(x[_LIFT])) != 0.0:
        m = m.copy(order="F")
        m[:, motion.PITCH] -= lift * moving.v_mps**2
        m[:, motion.PITCH_RATE] -= 2.0 * lift * moving.v_mps * moving.v_rate
    reads: Floats = felt(
        m,
        moving.v_mps,
        moving.v_rate,
        moving.road.bank_rad,
        moving.road.grade_rad,
        x[_LEVER] + np.array([ahead_m, 0.0, 0.0]),
        x[_BODY],
        _axes_of(x),
        DT_S,
        *x[_AS_DRAWN].tolist(),
    )
    reads = smoothed(reads, x)
    add_offsets(reads, x[_OFFSETS], x[_DRIFTS], float(x[_FADES]), DT_S)
    return reads


def _turned(x: Floats) -> Floats:
    """What the sensors' axes (3, 3) see of the car's: turned wholly (to second order), or by small angles."""
    turn_x, turn_y, turn_z = x[_TURN].tolist()
    turn = np.array([[0.0, turn_z, -turn_y], [-turn_z, 0.0, turn_x], [turn_y, -turn_x, 0.0]])
    return np.asarray(_ONES + turn + 0.5 * (1.0 - x[_SMALL_TURNS]) * (turn @ turn))


def gyros_of(x: Floats) -> tuple[Floats, Floats]:
    """What the gyros show of the car's rates, and of the forces that the IMU feels (3, 3)."""
    of_rates, of_forces, _ = _axes_of(x)
    return of_rates, of_forces


def _axes_of(x: Floats) -> Floats:
    """What is shown of what (3, 3, 3): rates of rates, rates of forces, forces of forces."""
    return np.asarray((_OWN + x[_SHOWN_OF]) @ _turned(x))


def nothing(vocabulary: Vocabulary = BUILT_IN) -> Floats:
    """All parameters at 0: the nominal simulation."""
    return np.zeros(len(vocabulary.columns))
