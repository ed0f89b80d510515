"""The car on its drive: from steering and wheel speeds to its motion, and to what its wheels roll."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, INDEX
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.car import car_of
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.instruments import (
    delayed,
    followed,
    rate_of,
    rolled,
)
from dsz_daemon.diagnose.simulation.motion import moved
from dsz_daemon.diagnose.simulation.own_courses import pushed_by, turned_by
from dsz_daemon.diagnose.simulation.play import geared, held_back, lost_in_play
from dsz_daemon.diagnose.simulation.road import Profiles, on_road
from dsz_daemon.diagnose.simulation.rolling import Rolling, Slip, earlier, rolling
from dsz_daemon.diagnose.simulation.wheel_readings import as_they_read, as_they_roll, locks_in_front

_WHEELS = ("fl", "fr", "rl", "rr")
# Whatever is known before the car moves sideways depends on these effects' parameters, on these of none, and the road.
ROLL = frozenset(
    {"steering_ratio", "steering_delay", "steering_offset", "wheel_radius", "wheel_square", "wheel_speed_delay"}
    | {"steering_lag", "wheel_growth", "wheels_more", "wheel_slip", "tyre_saturation", "low_friction", "road_grade"}
    | {"steering_skew_s", "large_angles", "drive_steer", "brake_steer", "steers_by_force"}
    | {"small_wheels", "unturned_wheels", "steering_backlash", "steering_friction", "steering_slip"}
)
_OF_ROLL = np.array([i for i, (effect, parameter) in enumerate(BUILT_IN.columns) if ROLL & {effect, parameter.name}])


# What jumps is there within so long.
_JUMPS_S = 0.2


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


def since(at_s: float, n: int) -> Floats:
    """What is nothing before a moment, and 1 from then on (n,), by a slope that has a derivative by when that is."""
    return np.clip((np.arange(n) * DT_S - at_s) / _JUMPS_S + 0.5, 0.0, 1.0)


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
        told, taken_up = geared(drive.told_steer, *ratio), (at(f"steering_backlash.{n}") for n in ("centred", "begins"))
        steer = steer - lost_in_play(told, width_rad, drive.recording.told_kernel, *taken_up)
    if at("steering_lag.time_constant_s") > 0.0:
        steer = followed(steer.reshape(-1, 1), at("steering_lag.time_constant_s"), DT_S)[:, 0]
    late_s = at("steering_delay.delay_s") + at("steering_skew_s")
    steer = earlier(steer / (1.0 + at("steering_ratio")), late_s) + at("steering_offset.offset_rad")
    if (jump_rad := at("steering_slip.jump_rad")) != 0.0:
        steer = steer + jump_rad * since(at("steering_slip.at_s"), len(steer))
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
