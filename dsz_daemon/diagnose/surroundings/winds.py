"""The side force of the air over time, by what an accelerometer has left over, or by how a soft body leans."""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel, sharp_kernel
from dsz_daemon.diagnose.residuals.comparison import BLOCK_S, FOLDS, noises
from dsz_daemon.diagnose.residuals.correlation import quick_length
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.car import car_of
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.instruments import low_passed
from dsz_daemon.diagnose.simulation.motion import CarModel
from dsz_daemon.diagnose.simulation.moving import driven, rolls_of
from dsz_daemon.diagnose.simulation.prediction import Ints, predicted
from dsz_daemon.diagnose.simulation.road import Profiles
from dsz_daemon.diagnose.simulation.slow_sensors import in_time

# A wind changes over seconds; what is quicker is mostly the accelerometer's noise. A push would bring it into the yaw
# rate, and would be told to stand less far ahead, and to be stronger, for that.
GUSTS = sharp_kernel(0.8)
# The most rounds of a wind that is felt, and of one that was felt for other parameters or of which its place is asked;
# they end where one adds so little to what there is (power).
ROUNDS, AGAIN, _LITTLE = 6, 2, 1e-3
# The last round after one that left so little of what there was needs no look at what it leaves.
_QUICKLY = 0.25
_ROLL_RATE, _ACROSS = 0, 4
_LEANS = INDEX["suspension_roll.roll_gradient_rad_per_mps2"]
_WIND_LEANS = INDEX["side_wind.leans"]
# Pushed so little ahead of where a push turns no car, one drifts with a wind that nobody feels.
_LEAST_ARM_M = 0.1
# Of a wind's lean: at the C.G.'s height it is 1, at the road's 0.
_ON_THE_BODY = 0.5
# A wind knows nothing of the road: of its power what follows the car's own turning of the last seconds, on blocks that
# have not been seen. Winds that there were had up to 0.35 of it, a liquid that goes to and fro 0.45, 0.67 and 0.80;
# and from some time on, not before, up to 0.13 of it, a load that came on board on the way 0.67.
_FOLLOWS, _LATER_S, _SOON_S, _EVERY_ROWS, _RIDGE = 0.42, (0.0, 0.5, 1.0, 1.5, 2.0, 3.0), (0.0, 1.0), 20, 1e-3
_ENOUGH, _FROM = 200, (-0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6)
# And what changes once, from one push to another, at this speed or more: winds that there were had up to 0.40 of their
# power in it on the whole way, a steering sensor that slips on its shaft 0.996; in two changes winds had up to 0.52, a
# sensor that slips and slips back 0.82.
_ONCE, _TWICE, _FAST_MPS = 0.8, 0.7, 8.0
# So soft a body shows a wind by its lean first: g times it is more than what its tyres leave of the push.
_SOFT, _LEAN_ROUNDS, _SLOW_KERNEL, _LEAN = 0.004, 3, filter_kernel(6.0), sharp_kernel(1.5)


def with_wind(drive: Drive, x: Floats, road: Profiles, rounds: int = ROUNDS) -> Profiles:
    """The road with the side force that makes the car's lateral acceleration what the accelerometer shows."""
    return wind_and_shown(drive, x, road, rounds)[0]


# Pushed where a push spins it, a car may go anywhere: then more is left than before, and that round is none.
@np.errstate(over="ignore", invalid="ignore")
def wind_and_shown(drive: Drive, x: Floats, road: Profiles, rounds: int) -> tuple[Profiles, Floats | None]:
    """The road with that side force, and what is predicted on it (n, 13), where the last round has looked at that.

    Newton's way: what is left over is put right by the force that does so on the linear single-track car.
    """
    rolling, rolls = np.mean(drive.wheels, axis=1) > motion.ROLLING_MPS, rolls_of(drive, x, road)
    car = car_of(drive, x)

    def left_by(road: Profiles) -> tuple[Floats, Floats, float]:
        shown = predicted(drive, x, road, rolls)
        left_mps2 = np.nan_to_num(drive.measured[:, _ACROSS] - shown[:, _ACROSS])
        left_mps2 = np.where(rolling, left_mps2, 0.0)
        return shown, left_mps2, float(np.sum(left_mps2**2))

    (shown, left_mps2, before), share = left_by(road), 1.0
    for k in range(rounds):
        more_n = low_passed(_push_n(car, in_time(left_mps2, x), rolls.v_mps, DT_S), GUSTS)
        more = road._replace(side_n=road.side_n + more_n)
        if k == rounds - 1 and share < _QUICKLY:
            return more, None
        there, left, after = left_by(more)
        # Where tyres answer late, a round may take away more than there was.
        if after >= before:
            break
        road, shown, left_mps2, before, share = more, there, left, after, after / before
        if float(np.sum(more_n**2)) < _LITTLE * float(np.sum(road.side_n**2)):
            break
    return road, shown


def of_noise_n(drive: Drive, x: Floats, road: Profiles) -> Floats:
    """As what wind (n,) the accelerometer's noise alone, drawn once, is felt: slow noise pushes as slow winds do."""
    noise = low_passed(np.random.default_rng(0).normal(size=len(drive.steer)), filter_kernel())
    noise *= float(np.nan_to_num(noises(drive))[_ACROSS]) / max(float(np.std(noise)), 1e-12)
    return low_passed(_push_n(car_of(drive, x), noise, rolls_of(drive, x, road).v_mps, DT_S), GUSTS)


def arm_m(drive: Drive, x: Floats) -> float:
    """How far ahead of where a push turns no car a wind of these parameters is taken to push, m."""
    car = car_of(drive, x)
    return max(car.wind_ahead_m - _neutral_m(car), _LEAST_ARM_M)


@compiled
def _neutral_m(car: CarModel) -> float:
    """How far ahead of the C.G. a push turns no car: the neutral steer point."""
    cf, cr = car.front_stiffness, car.rear_stiffness
    return (cf * car.cg_to_front_axle_m - cr * car.cg_to_rear_axle_m) / (cf + cr)


@compiled
def _push_n(car: CarModel, across_mps2: Floats, v_mps: Floats, dt_s: float) -> Floats:
    """The side force (n,) under which a linear car has so much more lateral acceleration (n,), m/s^2, of (1).

    v_y' = a - r v, the tyres answer, the push is m a less their answer, and turns the car. A push further behind than
    `_LEAST_ARM_M` ahead of the neutral steer point is taken to be there: before it, no slow wind can be told.
    """
    lf, lr = car.cg_to_front_axle_m, car.cg_to_rear_axle_m
    cf, cr = car.front_stiffness, car.rear_stiffness
    ahead_m = max(car.wind_ahead_m, _neutral_m(car) + _LEAST_ARM_M)
    push = np.zeros(len(v_mps))
    vy, r = 0.0, 0.0
    for i in range(len(v_mps)):
        v = v_mps[i]
        if v < motion.ROLLING_MPS:
            vy, r = 0.0, 0.0
            push[i] = car.mass_kg * across_mps2[i]
            continue
        front, rear = -cf * (vy + lf * r) / v, -cr * (vy - lr * r) / v
        push[i] = car.mass_kg * across_mps2[i] - front - rear
        r_rate = (front * lf - rear * lr + ahead_m * push[i]) / car.yaw_inertia_kgm2
        # A midpoint rule, as for the car itself: the push is held.
        vy_mid, r_mid = vy + 0.5 * dt_s * (across_mps2[i] - r * v), r + 0.5 * dt_s * r_rate
        front, rear = -cf * (vy_mid + lf * r_mid) / v, -cr * (vy_mid - lr * r_mid) / v
        vy += dt_s * ((front + rear + push[i]) / car.mass_kg - r_mid * v)
        r += dt_s * (front * lf - rear * lr + ahead_m * push[i]) / car.yaw_inertia_kgm2
    return push


def follows_the_car(drive: Drive, x: Floats, road: Profiles) -> bool:
    """Whether a wind is what the car's own lateral acceleration and yaw rate were just before: then it is none.

    As much all the way, or more and more, or less and less: tyres that warm up push as a wind does that follows them.
    Or from some time on: passengers get in.
    """
    moving = driven(drive, x, road)
    rolling = np.flatnonzero(moving.v_mps > motion.ROLLING_MPS)[::_EVERY_ROWS]
    if len(rolling) < _ENOUGH:
        return False
    courses = [low_passed(moving.moved[:, c], GUSTS) for c in (motion.AY, motion.R)]

    def before(late_s: float) -> list[Floats]:
        return [course[np.maximum(rolling - round(late_s / DT_S), 0)] for course in courses]

    evenly = [one for late_s in _LATER_S for one in before(late_s)]
    lately = [one for late_s in _SOON_S for one in before(late_s)]
    way = np.linspace(-1.0, 1.0, len(rolling))
    ways = (way, *(np.where(way > since, 1.0, 0.0) for since in _FROM))
    tables = (evenly, *([*lately, *(more * one for one in lately)] for more in ways))
    side_n, fold = road.side_n[rolling], folds_of(rolling)
    return any(told_by(np.column_stack(table), side_n, fold) > _FOLLOWS for table in tables)


def changes_once(drive: Drive, road: Profiles) -> bool:
    """Whether a wind is one push up to some time, and another from then on."""
    return _in_steps(drive, road)[0] > _ONCE


def changes_twice(drive: Drive, road: Profiles) -> bool:
    """Whether a wind is one push between two moments, and others before and after."""
    return _in_steps(drive, road)[1] > _TWICE


def _in_steps(drive: Drive, road: Profiles) -> tuple[float, float]:
    """The share of a wind's power that is in one change of it, and in two."""
    side_n = road.side_n[np.mean(drive.wheels, axis=1) > _FAST_MPS][::_EVERY_ROWS]
    if len(side_n) < _ENOUGH:
        return 0.0, 0.0
    side_n = side_n - np.mean(side_n)
    n, power = len(side_n), max(float(side_n @ side_n), 1e-30)
    sums = np.concatenate([[0.0], np.cumsum(side_n)])
    first, second = np.arange(1, n - 1)[:, np.newaxis], np.arange(2, n)
    # Of two means, and of three, against one.
    once = sums[1:n] ** 2 * (1.0 / np.arange(1, n) + 1.0 / np.arange(n - 1, 0, -1))
    twice = sums[first] ** 2 / first + sums[second] ** 2 / (n - second)
    twice += (sums[second] - sums[first]) ** 2 / np.maximum(second - first, 1)
    return float(np.max(once)) / power, float(np.max(np.where(second > first, twice, 0.0))) / power


def folds_of(rows: Ints) -> Ints:
    """Which fold each row (n,) is of: blocks in turn."""
    return np.asarray((rows * DT_S // BLOCK_S).astype(np.int64) % FOLDS)


def told_by(table: Floats, course: Floats, fold: Ints) -> float:
    """The share of a course's power (n,) that is linear in these (n, p), on unseen folds; below 0 where none is."""
    table = (table - np.mean(table, axis=0)) / np.maximum(np.std(table, axis=0), 1e-12)
    course = course - np.mean(course)
    left = course.copy()
    for k in range(int(np.max(fold)) + 1):
        seen, own = table[fold != k], table[fold == k]
        squares = seen.T @ seen + _RIDGE * len(seen) * np.eye(table.shape[1])
        left[fold == k] -= own @ np.linalg.solve(squares, seen.T @ course[fold != k])
    return 1.0 - float(left @ left) / max(float(course @ course), 1e-30)


def by_the_lean(x: Floats) -> bool:
    """Whether the wind is what leans the body: what its tyres hold against it, a soft one shows first by its roll."""
    return bool(x[_LEANS] > _SOFT and x[_WIND_LEANS] > _ON_THE_BODY)


def with_wind_that_leans(drive: Drive, x: Floats, road: Profiles) -> Profiles:
    """The side force of which the lean is what the roll gyro has left over, slowly what the accelerometer has.

    Tyres that answer at once hold all of it: v_y' + r v = 0, lean = -k F/m, and reading_y = g lean.
    """
    rolling = np.mean(drive.wheels, axis=1) > motion.ROLLING_MPS
    force_per_lean, least, rolls = -drive.car.mass_kg / float(x[_LEANS]), math.inf, rolls_of(drive, x, road)
    for _ in range(_LEAN_ROUNDS):
        left = np.where(rolling[:, np.newaxis], np.nan_to_num(drive.measured - predicted(drive, x, road, rolls)), 0.0)
        tilt, shown = np.cumsum(left[:, _ROLL_RATE]) * DT_S, left[:, _ACROSS] / motion.G
        lean = low_passed(tilt + _slow_part(shown - tilt), _LEAN)
        if (size := float(np.sum(lean**2))) > least:
            break
        least = size
        road = road._replace(side_n=road.side_n + force_per_lean * np.where(rolling, in_time(lean, x), 0.0))
    return road


def _slow_part(values: Floats) -> Floats:
    """What a Gaussian leaves of the values (n,), which are reflected at both ends."""
    reach = len(_SLOW_KERNEL) // 2
    padded = np.pad(values, reach, mode="symmetric")
    n = quick_length(len(padded))
    smooth = np.fft.irfft(np.fft.rfft(padded, n) * np.fft.rfft(_SLOW_KERNEL, n), n)
    # What comes before has gone round from the end to the beginning.
    return np.asarray(smooth[2 * reach : len(padded)])
