"""Recording against prediction: which rows count, how much they differ, and what a parameter does to them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.diagnose.effects.nuisances import OFFSETS
from dsz_daemon.diagnose.effects.row import CAR, SENSORS
from dsz_daemon.diagnose.recordings.recording import ALONG_FILTER_S, DT_S, FILTER_S, REFERENCE, filter_kernel
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats
from dsz_daemon.diagnose.simulation.moving import ROLL, driven
from dsz_daemon.diagnose.simulation.prediction import SHOWN, predicted, shown
from dsz_daemon.diagnose.simulation.road import Profiles
from dsz_daemon.signals import IMU_CHANNELS, STANDARD_GRAVITY_MPS2

Bools = np.ndarray[Any, np.dtype[np.bool_]]
Ints = np.ndarray[Any, np.dtype[np.int64]]
# `map`, or one that works side by side; where that has `nests`, it may be asked inside its own works, too.
Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
One = TypeVar("One")
Done = TypeVar("Done")

# Compared at 25 Hz: the filter has left nothing above.
EVERY = 4
ROW_S = EVERY * DT_S
BLOCK_S = 5.0
FOLDS = 5
# Slip angles divide by speed: slow driving is left out, and as long after it as a transient lasts.
SLOW_MPS, GUARD_S = 3.0, 1.0
# Wheels are said to stand before the car does: sensors count teeth, and a body rocks on its springs for a while.
_SETTLED_S = 2.0
STILL_MPS = 0.05
# Sines for angles, counted poles, a message's milliseconds: of a channel's own movement, this much is no physics.
FORM = 0.003
_STEEPEST = 1e9
# Of a parameter's step, where it is there: a load, its place and stiffnesses turn a car alike but for so little that a
# secant a tenth as long points up where the valley goes down.
_CLOSE = 0.01
# One column at a time would be mostly waiting for each other.
_HEAPS = 6
WHEEL_FORM = 0.0004
# Of fewer rows nothing is said.
_FEWEST_ROWS = 10
# m/s^2: no accelerometer is so still.
_STILL_MPS2, _UPRIGHT, _AT_LIMIT, _OF_GRAVITY = 1e-5, 5, 0.05, 0.95
# Straight ahead, braking and speeding up, bends, hard bends; and how much of a kind is worth holding out.
_MPS2, _HARD_MPS2, _LEAST_S = 0.8, 2.0, 15.0

_IMU = len(IMU_CHANNELS)


def all_hands(task: Callable[[One, Each], Done], works: Sequence[One], each: Each) -> list[Done]:
    """Each work's task, side by side; inside, too, where one is alone or that may be: an executor waits for itself."""
    if len(works) == 1:
        return [task(works[0], each)]
    inside = each if getattr(getattr(each, "__self__", None), "nests", False) else map
    return list(each(lambda one: task(one, inside), works))


class Feels(Protocol):
    """What is felt of road and air, for given parameters."""

    def and_shown(self, x: Floats) -> tuple[Profiles, Floats | None]:
        """The profiles for these parameters, and what is predicted there (n, 13), if that is known."""

    def changes_with(self, effect: str) -> bool:
        """Whether another parameter of this effect makes another road of the same readings."""

    def changes_with_offset(self, column: int) -> bool:
        """Whether another constant offset of a sensor does."""


class Rows(NamedTuple):
    """The rows that are compared: `used` (k, 13) which channels of each count, `block` (k,) its block of BLOCK_S.

    `form` (13,) is what the simulation's form alone may be off by, in each channel's unit. `together`: by name, for
    each block of what it is one (a manoeuvre, a recording), where there is more than one of these. `piece` (k,): whose
    recording a row is of, where there are several.
    """

    at: Ints
    used: Bools
    block: Ints
    measured: Floats
    form: Floats
    together: Mapping[str, Ints] = MappingProxyType({})
    piece: Ints | None = None


def rows_of(drive: Drive) -> Rows:
    """Driving rows count in all channels, standing ones for what the IMU shows at rest."""
    n = len(drive.steer)
    speed = np.nanmean(np.where(np.isfinite(drive.wheels), drive.wheels, 0.0), axis=1)
    guard, settled = round(GUARD_S / DT_S), round(_SETTLED_S / DT_S)
    slow = (speed < SLOW_MPS).astype(np.float64)
    near = np.convolve(slow, np.ones(2 * guard + 1), mode="same") > 0.5
    turning = (np.max(drive.wheels, axis=1) > STILL_MPS).astype(np.float64)
    standing = np.convolve(turning, np.ones(settled + guard + 1))[guard : guard + n] < 0.5
    # Beyond the ends nothing is known: what the filters make of that is not compared.
    at = np.arange(guard, n - guard, EVERY, dtype=np.int64)
    measured = drive.measured[at]
    used = np.isfinite(measured)
    used &= (~near | standing)[at][:, np.newaxis]
    used[standing[at], 6:] = False
    # What the simulation is driven by has to be there, too.
    inputs = np.column_stack([drive.recording.road_wheel_angle_rad, drive.recording.wheels_mps])
    given = np.isfinite(np.sum(inputs, axis=1))[at]
    used[~given & ~standing[at]] = False
    if _stands_at_the_limit(measured, used):
        used[:, _UPRIGHT] = False
    form = np.full(len(CHANNELS), WHEEL_FORM * float(np.sqrt(np.mean(speed**2))))
    for c in (*range(6), *range(10, len(CHANNELS))):
        mine = measured[used[:, c], c]
        form[c] = FORM * float(np.std(mine)) if len(mine) else 0.0
    block = (at * DT_S / BLOCK_S).astype(np.int64)
    together, piece = _together(drive, at, used, block), drive.recording.piece
    own = piece[at] if piece is not None and piece[-1] > 0 else None
    return Rows(at, used, block, np.where(used, measured, 0.0), form, together, own)


def _stands_at_the_limit(measured: Floats, used: Bools) -> bool:
    """Whether gravity alone is beyond the limit of a vertical accelerometer that reaches as far as the others do.

    It shows one number all the way, which any simulation that clips there matches to the last digit. One that is dead
    shows another (less than the others, or gravity), and is compared.
    """
    upright, level = measured[used[:, _UPRIGHT], _UPRIGHT], measured[:, _UPRIGHT - 2 : _UPRIGHT]
    if not len(upright) or not np.isfinite(level).any():
        return False
    furthest = float(np.nanmax(np.abs(level)))
    low, high = (1.0 - _AT_LIMIT) * furthest, _OF_GRAVITY * STANDARD_GRAVITY_MPS2
    return bool(np.ptp(upright) < _STILL_MPS2 and low < upright[0] < high)


def _together(drive: Drive, at: Ints, used: Bools, block: Ints) -> dict[str, Ints]:
    """Blocks of one manoeuvre, by how much the car brakes and turns; and blocks of one recording."""
    v, n = np.mean(drive.wheels, axis=1), int(block[-1]) + 1
    turns = drive.steer / drive.car.wheelbase_m
    counted = used.any(axis=1)

    def most(values: Floats) -> Floats:
        found = np.zeros(n)
        np.maximum.at(found, block[counted], np.abs(values[at][counted]))
        return found

    across, along = most(turns * v * v), most(np.gradient(v, DT_S))
    kinds = {"manoeuvres": np.where(across > _HARD_MPS2, 3, np.where(across > _MPS2, 2, np.where(along > _MPS2, 1, 0)))}
    piece = drive.recording.piece
    if piece is not None:
        kinds["recordings"] = np.zeros(n, dtype=np.int64)
        np.maximum.at(kinds["recordings"], block, piece[at])
    rows = np.bincount(block[counted], minlength=n)
    return {name: kind for name, kind in kinds.items() if _is_held_out(kind, rows)}


def _is_held_out(kind: Ints, rows: Ints) -> bool:
    """Whether there are two kinds of blocks or more, each with enough rows."""
    return int(np.count_nonzero(np.bincount(kind, rows) * ROW_S > _LEAST_S)) > 1


def driven_s(drive: Drive, rows: Rows) -> float:
    """For how long the car drives, s, in the rows that are compared."""
    moving = np.mean(drive.wheels, axis=1)[rows.at] >= SLOW_MPS
    return float(np.count_nonzero(rows.used.any(axis=1) & moving) * ROW_S)


def residual(rows: Rows, prediction: Floats) -> Floats:
    """Measured less predicted (k, 13), 0 where a row does not count."""
    return _with_own_offsets(rows, _less(rows.measured, prediction, rows.at, rows.used))


@compiled
def _less(measured: Floats, prediction: Floats, at: Ints, used: Bools) -> Floats:
    """A prediction that is no number is off by as much as can be."""
    left = np.zeros(used.shape)
    for k in range(len(at)):
        for c in range(used.shape[1]):
            if used[k, c]:
                off = measured[k, c] - prediction[at[k], c]
                left[k, c] = _STEEPEST if math.isnan(off) else min(max(off, -_STEEPEST), _STEEPEST)
    return left


def own_offsets(rows: Rows, values: Floats) -> Floats:
    """How much more the values (k, 13, ...) are in each recording than in all of them: (recordings, 6, ...)."""
    if rows.piece is None:
        return np.zeros((1, _IMU, *values.shape[2:]))
    found = np.zeros((int(rows.piece[-1]) + 1, _IMU, *values.shape[2:]))
    for c in range(_IMU):
        used = rows.used[:, c]
        for k in range(len(found)):
            mine = used & (rows.piece == k)
            if mine.any():
                found[k, c] = values[mine, c].mean(axis=0) - values[used, c].mean(axis=0)
    return found


def _with_own_offsets(rows: Rows, values: Floats) -> Floats:
    """The values as they are where an IMU wakes up with offsets of its own for each recording."""
    if rows.piece is not None:
        values[:, :_IMU] -= own_offsets(rows, values)[rows.piece]
        values[~rows.used] = 0.0
    return values


def robust_std(rows: Rows, left: Floats, floor: Floats) -> Floats:
    """Each channel's scatter (13,): the larger of the robust deviation and the sensor's own floor."""
    return _robust_std(left, rows.used, floor)


@compiled
def _robust_std(left: Floats, used: Bools, floor: Floats) -> Floats:
    found, mine = np.ones(left.shape[1]), np.empty(len(left))
    for c in range(left.shape[1]):
        count, power = 0, 0.0
        for k in range(len(left)):
            if used[k, c]:
                mine[count] = abs(left[k, c])
                power += left[k, c] ** 2
                count += 1
        if count > _FEWEST_ROWS:
            found[c] = max(1.4826 * np.median(mine[:count]), 0.3 * math.sqrt(power / count), 1e-9)
        if math.isfinite(floor[c]):
            found[c] = max(found[c], floor[c])
    return found


def floors(drive: Drive) -> Floats:
    """What white noise of the sensors leaves in each channel (13,)."""
    floor = drive.recording.floor
    kernel, both = filter_kernel(), filter_kernel(math.hypot(FILTER_S, ALONG_FILTER_S))
    # Speed is differentiated: its noise is the longitudinal acceleration's, too.
    power = float(np.sum(kernel**2))
    less = math.sqrt(float(np.sum(both**2)) / power)
    steeper = math.sqrt(float(np.sum(np.gradient(both, DT_S) ** 2)) / power)
    own, other = ((0, 1), (2, 3)) if drive.front_gives_speed else ((2, 3), (0, 1))
    wheels = floor[6:]
    pair = float(np.hypot(*wheels[list(own)]))
    along = float(np.hypot(floor[3] * less, 0.5 * pair * steeper))
    beside = drive.recording.reference_floor
    if beside is None:
        beside = np.full(len(REFERENCE), np.nan)
    return np.array([*floor[:3], along, *floor[4:6], wheels[other[0]], wheels[other[1]], pair, *beside])


def noises(drive: Drive) -> Floats:
    """What white noise and the steering's resolution leave in each channel (13,)."""
    return np.asarray(np.hypot(floors(drive), drive.steps), dtype=np.float64)


def sensitivities(
    drive: Drive,
    rows: Rows,
    x: Floats,
    road: Profiles,
    base: Floats,
    columns: Sequence[int],
    felt: Feels | None = None,
    each: Each = map,
    known: Floats | None = None,
) -> Floats:
    """Secants (k, 13, len(columns)) of the prediction over each parameter's step, away from its nearer bound.

    `felt`: the road that is felt for other parameters; None where it is the same for all. `known` (k, 13, q), of other
    parameters, come before them.
    """
    moving = driven(drive, x, road)
    touches = {effect.name: effect.touches for effect in drive.vocabulary.effects}
    rolls = ROLL | {effect.name for effect in drive.vocabulary.own() if effect.steers is not None}

    found = np.zeros((len(columns), *rows.used.shape))

    def take(at: int) -> None:
        i = columns[at]
        # A wind that is felt anew is another one for an offset, too.
        if i < len(OFFSETS) and not (felt is not None and felt.changes_with_offset(i)):
            found[at, :, i] = rows.used[:, i]
            return
        effect, parameter = drive.vocabulary.columns[i]
        step = parameter.step if x[i] + parameter.step <= parameter.high else -parameter.step
        # Close to the value: an effect that is there already is not stepped over, and a valley is followed to its end.
        if x[i] != 0.0:
            step *= _CLOSE
        moved = x.copy()
        moved[i] += step
        stays = not rolls & {effect, parameter.name}
        if felt is not None and felt.changes_with(effect):
            other, known_there = felt.and_shown(moved)
            stays &= np.array_equal(other.grade_rad, road.grade_rad) and np.array_equal(other.grip, road.grip)
            rolling = moving.rolling if stays else None
            there = predicted(drive, moved, other, rolling) if known_there is None else known_there
        elif i in SHOWN or touches.get(effect, CAR) == SENSORS:
            there = shown(drive, moved, moving)
        else:
            there = predicted(drive, moved, road, moving.rolling if stays else None)
        _per_step(there, base, rows.at, rows.used, step, found[at])

    def take_some(first: int) -> None:
        for at in range(first, len(columns), _HEAPS):
            take(at)

    for _ in each(take_some, range(_HEAPS)):
        pass
    known = np.empty((*rows.used.shape, 0)) if known is None else known
    return _with_own_offsets(rows, _by_row(known, found))


@compiled
def _by_row(before: Floats, values: Floats) -> Floats:
    """Those (k, c, q), and the same (p, k, c) as (k, c, p)."""
    q = before.shape[2]
    found = np.empty((*values.shape[1:], q + len(values)))
    for k in range(values.shape[1]):
        for c in range(values.shape[2]):
            for i in range(q):
                found[k, c, i] = before[k, c, i]
            for i in range(len(values)):
                found[k, c, q + i] = values[i, k, c]
    return found


@compiled
def _per_step(there: Floats, base: Floats, at: Ints, used: Bools, step: float, found: Floats) -> None:
    """Writes how much more there is (k, 13) in the rows that count, over the step, to `found` (k, 13).

    Beside a car that is about to spin a step further is anything; nothing is learnt from that.
    """
    for k in range(len(at)):
        for c in range(used.shape[1]):
            slope = (there[at[k], c] - base[at[k], c]) / step
            if used[k, c] and math.isfinite(slope):
                found[k, c] = min(max(slope, -_STEEPEST), _STEEPEST)
