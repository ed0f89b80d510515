"""What the wheels that give the speed roll, and what drive and brakes make of it: speed, slip, what is left of grip."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel
from dsz_daemon.diagnose.simulation.angles import all_drawn, cos_sin_of
from dsz_daemon.diagnose.simulation.instruments import delayed, low_passed, rate_of
from dsz_daemon.signals import STANDARD_GRAVITY_MPS2

Floats = np.ndarray[Any, np.dtype[np.float64]]

G = STANDARD_GRAVITY_MPS2
_PULL_KERNEL = filter_kernel(0.07)
# Of an axle's side force, however it is driven or braked.
_LEAST_FREE = 0.05
# Of an axle's load, however hard a car speeds up or brakes.
_MOST_MOVED = 0.7
# An engine's drag is told from brakes where a car brakes by more, m/s^2, for so long; else by their shares alone.
_BRAKES_MPS2, _FOR_S = -1.5, 4.0
# What a usual car is slowed by: tyres that roll (0.012 of its weight), and the air (over the square of its speed).
_ROLLS_MPS2, _AIR_PER_M = 0.12, 2.6e-4


class Rolling(NamedTuple):
    """What of a drive is known before the car moves sideways (n,): the road wheels' angle, the speed, its rate.

    `front_mps` (n,) or (0,): what the front axle rolls, where that gives the speed. `front_slip`, `rear_slip`: shares
    that the wheels turn faster. `front_free`, `rear_free`: what drive and brakes leave of an axle's side force.
    """

    steer_rad: Floats
    v_mps: Floats
    v_rate: Floats
    front_mps: Floats
    front_slip: Floats
    rear_slip: Floats
    front_free: Floats
    rear_free: Floats


class Slip(NamedTuple):
    """Slip over the force along (over load), how much more the front brakes, resistance in parts of the usual one.

    The usual one is of tyres that roll, and the air. `spun_share`: of the car's mass, what wheels that nothing drives
    are as they are spun up by the road. `front_drives_more` than its load, where both axles are driven. What slows the
    car by no more than `engine_brakes_mps2` does it by the axles that drive it. `ahead_load_m`: how high the C.G.
    counts for the load that goes from axle to axle as the speed changes.
    """

    slip_per_force: float
    front_brakes_more: float = 0.0
    resistance: float = 0.0
    spun_share: float = 0.0
    front_drives_more: float = 0.0
    engine_brakes_mps2: float = 0.0
    ahead_load_m: float = 0.0


class _Shares(NamedTuple):
    """Of drive and of brakes what the front axle has, and of the car's weight; up to where the engine brakes."""

    drive: float
    brakes: float
    load: float
    engine_brakes_mps2: float = 0.0


def earlier(values: Floats, by_s: float) -> Floats:
    """What the values (n,) will be `by_s` later (what a late sensor has not told yet); level beyond the ends."""
    if by_s == 0.0:
        return values
    return np.asarray(delayed(values.reshape(-1, 1), -by_s, DT_S)[:, 0])


def rolling(
    car: Car,
    steer_rad: Floats,
    rolled_mps: Floats,
    by_front: bool,
    slip: Slip,
    ellipse: Floats,
    grade_rad: Floats,
    aside: tuple[float, float, float] = (0.0, 0.0, 0.0),
    wheels: tuple[float, float] = (0.0, 0.0),
) -> Rolling:
    """Of what the axle that gives the speed rolls, along its wheels (n,); that is the front one if `by_front`.

    `ellipse` (n,): 1/friction^2, of which drive and brakes take their part. `aside`: by how much the front wheels seem
    turned over the speed's rate, as the car is driven and as it is braked, rad/(m/s^2); and how much of what slows a
    car by itself is in that rate: all, where it is the force at the wheels that does it. `wheels`: how far the
    front ones are drawn for small angles, and as if they were not turned.
    """
    v, shares = rolled_mps, _shares(car, slip)
    if by_front:
        v = rolled_mps * _of_the_front(car, steer_rad, rolled_mps, *wheels)
    front_slip, rear_slip, before = np.zeros(len(v)), np.zeros(len(v)), v
    if slip.slip_per_force != 0.0:
        against_mps2 = G * grade_rad + slip.resistance * (_ROLLS_MPS2 + _AIR_PER_M * v * v)
        driven, braked = _per_pull(slip, shares, by_front)
        lightens = _lightens(car, shares, v, slip.ahead_load_m)[0 if by_front else 1]
        v = _unslipped(v, against_mps2, lightens, max(driven, 0.0), braked, shares.engine_brakes_mps2, DT_S)
        if driven < 0.0:
            pull_mps2 = np.maximum(rate_of(v, DT_S) + against_mps2, -shares.engine_brakes_mps2)
            v = v * (1.0 - driven * lightens * pull_mps2)
        front_slip, rear_slip = _slips(rate_of(v, DT_S) + against_mps2, slip.slip_per_force, shares)
        front_lightens, rear_lightens = _lightens(car, shares, v, slip.ahead_load_m)
        front_slip, rear_slip = front_slip * front_lightens, rear_slip * rear_lightens
    front_mps = rolled_mps if by_front else np.zeros(0)
    if by_front and v is not before:
        front_mps = rolled_mps * np.divide(v, before, out=np.ones(len(v)), where=before > 0.0)
    free = free_of(car, slip.front_brakes_more, v, ellipse, grade_rad)
    rate = rate_of(v, DT_S)
    if any(aside[:2]):
        pull_mps2 = rate + aside[2] * (G * grade_rad + _ROLLS_MPS2 + _AIR_PER_M * v * v)
        steer_rad = steer_rad + np.where(pull_mps2 > 0.0, aside[0], aside[1]) * pull_mps2
    return Rolling(steer_rad, v, rate, front_mps, front_slip, rear_slip, *free)


def free_of(
    car: Car, front_brakes_more: float, v_mps: Floats, grip: Floats, grade_rad: Floats
) -> tuple[Floats, Floats]:
    """What drive and brakes leave of each axle's side force (n,), where grip ends: sqrt(1 - (F_x / (mu F_z))^2).

    The friction ellipse (Milliken and Milliken, Race Car Vehicle Dynamics, chapter 2), of `grip` = 1 / mu^2 (n,).
    """
    if not grip.any():
        whole = np.ones(len(v_mps))
        return whole, whole
    pull_mps2 = low_passed(rate_of(v_mps, DT_S), _PULL_KERNEL)
    free: tuple[Floats, Floats] = _free(pull_mps2, grade_rad, grip, _shares(car, Slip(0.0, front_brakes_more)))
    return free


def tells_engine_from_brakes(wheels_mps: Floats) -> bool:
    """Whether a car with these wheel speeds (n, 4) brakes harder than engines do."""
    rate_mps2 = low_passed(rate_of(np.ascontiguousarray(np.mean(wheels_mps, axis=1)), DT_S), _PULL_KERNEL)
    return bool(np.count_nonzero(rate_mps2 < _BRAKES_MPS2) * DT_S > _FOR_S)


def _shares(car: Car, slip: Slip) -> _Shares:
    wheelbase_m = car.cg_to_front_axle_m + car.cg_to_rear_axle_m
    load = car.cg_to_rear_axle_m / wheelbase_m
    # What spins up the wheels of one axle is a force against the car there, and more to drive on the other.
    one = 1.0 + slip.spun_share if car.front_driven else -slip.spun_share
    drive = load * (1.0 + slip.front_drives_more) if car.front_driven and car.rear_driven else one
    return _Shares(drive, load * (1.0 + slip.front_brakes_more), load, slip.engine_brakes_mps2)


@compiled
def _uses(pull_mps2: float, shares: _Shares) -> tuple[float, float]:
    """Each axle's force along over its load: drive on the driven ones, brakes by load but for what the front has more.

    That is of the front's share of the brakes. What the engine brakes by is drive, the other way.
    """
    driving = max(pull_mps2, -shares.engine_brakes_mps2) / G
    braking = min(pull_mps2 + shares.engine_brakes_mps2, 0.0) / G
    front = (braking * shares.brakes + driving * shares.drive) / shares.load
    rear = (braking * (1.0 - shares.brakes) + driving * (1.0 - shares.drive)) / (1.0 - shares.load)
    return front, rear


def _per_pull(slip: Slip, shares: _Shares, by_front: bool) -> tuple[float, float]:
    """What the axle that gives the speed slips over what pulls the car, m/s^2, when driven and when braked."""
    brakes = shares._replace(engine_brakes_mps2=0.0)
    (front_driven, rear_driven), (front_braked, rear_braked) = _uses(1.0, brakes), _uses(-1.0, brakes)
    driven, braked = (front_driven, front_braked) if by_front else (rear_driven, rear_braked)
    return slip.slip_per_force * driven, -slip.slip_per_force * braked


def _lightens(car: Car, shares: _Shares, v_mps: Floats, height_m: float) -> tuple[Floats, Floats]:
    """Each axle's load as the car stands over what it is as the speed changes (n,): h v'/(g l) of the weight moves."""
    if height_m == 0.0:
        return np.ones(len(v_mps)), np.ones(len(v_mps))
    moved = height_m / (G * car.wheelbase_m) * low_passed(rate_of(v_mps, DT_S), _PULL_KERNEL)
    moved = np.clip(moved, -_MOST_MOVED * (1.0 - shares.load), _MOST_MOVED * shares.load)
    return shares.load / (shares.load - moved), (1.0 - shares.load) / (1.0 - shares.load + moved)


@compiled
def _unslipped(
    rolls_mps: Floats,
    against_mps2: Floats,
    lightens: Floats,
    driven: float,
    braked: float,
    engine_brakes_mps2: float,
    dt_s: float,
) -> Floats:
    """The speed (n,) of a car whose wheels roll this fast (n,), as they slip by so much over what pulls the car.

    They roll v (1 + k (v' + against)), which is ahead of the speed by k v: it lags behind them. Wheels that roll faster
    than a car left alone, or than one that its engine brakes, are driven, others braked by what is beyond. All slip so
    many times more as their axle `lightens` (n,). Exact for wheels that speed up evenly from row to row.
    """
    v = rolls_mps.copy()
    for i in range(1, len(v)):
        # Where brakes begin wheels slip as driven ones do, and from there on otherwise: so much faster they would roll.
        begins = 1.0 - driven * lightens[i] * engine_brakes_mps2
        more = 1.0 + (driven - braked) * lightens[i] * engine_brakes_mps2
        slowed_mps = (v[i - 1] - (against_mps2[i] + engine_brakes_mps2) * dt_s) * begins
        by_drive = rolls_mps[i] > slowed_mps
        rolls = rolls_mps[i] if by_drive else rolls_mps[i] * more
        rolled = rolls_mps[i - 1] if by_drive else rolls_mps[i - 1] * more
        after_s = (driven if by_drive else braked) * lightens[i] * rolls
        behind_mps = after_s * ((rolls - rolled) / dt_s + against_mps2[i])
        v[i] = rolls - behind_mps
        if after_s > 0.0:
            v[i] += (v[i - 1] - rolled + behind_mps) * math.exp(-dt_s / after_s)
    return v


@compiled
def _slips(pull_mps2: Floats, per_force: float, shares: _Shares) -> tuple[Floats, Floats]:
    """Both axles' slip (n,) at what pulls the car (n,)."""
    front, rear = np.empty(len(pull_mps2)), np.empty(len(pull_mps2))
    for i in range(len(pull_mps2)):
        front_use, rear_use = _uses(pull_mps2[i], shares)
        front[i], rear[i] = per_force * front_use, per_force * rear_use
    return front, rear


@compiled
def _free(pull_mps2: Floats, grade_rad: Floats, grip: Floats, shares: _Shares) -> tuple[Floats, Floats]:
    front, rear = np.ones(len(pull_mps2)), np.ones(len(pull_mps2))
    for i in range(len(pull_mps2)):
        front_use, rear_use = _uses(pull_mps2[i] + G * grade_rad[i], shares)
        front[i] = math.sqrt(max(1.0 - front_use * front_use * grip[i], _LEAST_FREE**2))
        rear[i] = math.sqrt(max(1.0 - rear_use * rear_use * grip[i], _LEAST_FREE**2))
    return front, rear


def _of_the_front(car: Car, steer: Floats, front_mps: Floats, small: float, unturned: float) -> Floats:
    """The car's speed (n,) over what its front wheels roll, as in a steady bend: cos(delta - alpha) / cos(alpha).

    The front axle goes at delta - alpha, alpha its slip angle; the wheels roll along delta. `small`, `unturned`:
    how far they are drawn for small angles, or as if they were not turned.
    """
    wheelbase = car.wheelbase_m
    front_alpha = 0.5 * car.mass_kg * car.cg_to_rear_axle_m / wheelbase / car.front_cornering_stiffness_n_per_rad
    rear_alpha = 0.5 * car.mass_kg * car.cg_to_front_axle_m / wheelbase / car.rear_cornering_stiffness_n_per_rad
    found: Floats = _along_over_rolled(steer, front_mps, wheelbase, front_alpha, rear_alpha, small, unturned)
    return found


@compiled
def _along_over_rolled(
    steer: Floats,
    front_mps: Floats,
    wheelbase_m: float,
    front_alpha: float,
    rear_alpha: float,
    small: float,
    unturned: float,
) -> Floats:
    r = front_mps * steer / (wheelbase_m + (front_alpha - rear_alpha) * front_mps * front_mps)
    cos, sin = all_drawn(steer, small, unturned)
    goes_cos, goes_sin = cos_sin_of(steer - front_alpha * front_mps * r)
    # The front axle goes across by the tangent of delta - alpha of what it goes along.
    along: Floats = 1.0 / (cos + sin * goes_sin / goes_cos)
    return along
