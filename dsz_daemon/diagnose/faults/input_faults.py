"""Steering and wheels that are not what the configuration says: turned round, swapped, or in another unit.

They drive the simulation. A mistake in how they are mapped would make every channel wrong, and be taken for the IMU's.
So they are looked at first, by what a car can't help: wheels on both sides, yaw gyro and steering tell one and the same
yaw rate; the lateral acceleration is that times the speed, the longitudinal one its rate of change. Each of these is
one slope, 1 where all is as mapped. The fewest mistakes that explain all of them are chosen, those of the IMU among
them; which these are is asked later, and better (`axis_faults.py`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.core.bicycle import bicycle_model
from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose.faults.wiring import UNITS, AxisFault
from dsz_daemon.diagnose.recordings.recording import DT_S, Recording
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import WHEEL_SPEEDS

Floats = np.ndarray[Any, np.dtype[np.float64]]
Bools = np.ndarray[Any, np.dtype[np.bool_]]

_YAW, _ALONG, _ACROSS = 2, 3, 4
# What a wheel's reading is multiplied by if another unit is sent than the mapping says.
_WHEEL_UNITS = {
    "kmh_for_mps": 3.6,
    "mps_for_kmh": 1.0 / 3.6,
    "mph_for_mps": 3600.0 / 1609.344,
    "rpm_for_radps": 30.0 / math.pi,
    "radps_for_rpm": math.pi / 30.0,
}
BY_HAND, AT_THE_ROAD = "steering_wheel_angle", "road_wheel_angle"
# Means of so long, without what changes more slowly: signals that are late by some tenths of a second still agree.
_BIN_S, _SLOW_S = 0.5, 6.0
# So many means make a slope, and it is one if it is so many times its spread, and explains so much of what it is of.
_LEAST_BINS, _LEAST_T, _LEAST_CORRELATION = 30, 6.0, 0.3
_TOLD = 2.0
# Wheels roll faster than this share of the fastest.
_ROLLS = 0.1
# A slope may be off by this much (log) by physics: ratios, stiffness, limits of grip. No slope speaks louder than this.
_OFF, _LOUDEST = 0.4, 12.0
# What a mistake has to explain, in log likelihood; and how much better one of steering or wheels has to do so than all
# that an IMU's could be.
_PRICE, _BETTER = 6.0, 4.0
# What may be left of all that speaks against the wiring as mapped.
_UNSAID = 0.5
_MOST_WORDS = 3
# A car that oversteers turns no more than so many times as a neutral one.
_MOST_TURNED = 3.0


class InputWiring(NamedTuple):
    """How steering and wheels arrive, as factors of what they are; sides: whether left and right are each other."""

    steering: float = 1.0
    wheels: float = 1.0
    front_swapped: bool = False
    rear_swapped: bool = False

    def mended_signals(self, signals: Mapping[str, Signal]) -> dict[str, Signal]:
        """All samples by role, steering and wheels as if mapped right; others as they are."""
        right = dict(signals)
        for swapped, axle in ((self.front_swapped, "f"), (self.rear_swapped, "r")):
            left_name, right_name = (f"wheel_speed_{axle}{side}" for side in "lr")
            if swapped:
                right[left_name], right[right_name] = right[right_name], right[left_name]
        for name in WHEEL_SPEEDS:
            right[name] = _divided(right[name], self.wheels)
        for name in {BY_HAND, AT_THE_ROAD} & set(right):
            right[name] = _divided(right[name], self.steering)
        return right


class _Way(NamedTuple):
    """One way to read the inputs, and the mistakes that it takes by channel ("" for all wheels) and kind."""

    wiring: InputWiring
    mistakes: tuple[tuple[str, str], ...]


class _Slopes(NamedTuple):
    """What is seen, None where nothing is: yaw rates and accelerations over each other (`_WORDS`)."""

    turn: float | None
    front: float | None
    rear: float | None
    front_by_steering: float | None
    rear_by_steering: float | None
    across: float | None
    across_by_steering: float | None
    along: float | None


_WORDS = (
    "the yaw gyro shows {k:.3g} times the steering's yaw rate",
    "the front wheels' difference is {k:.3g} times the yaw gyro's",
    "the rear wheels' difference is {k:.3g} times the yaw gyro's",
    "the front wheels' difference is {k:.3g} times the steering's",
    "the rear wheels' difference is {k:.3g} times the steering's",
    "accel_y is {k:.3g} times the yaw gyro's rate times the speed",
    "accel_y is {k:.3g} times the steering's yaw rate times the speed",
    "accel_x is {k:.3g} times the speed's rate of change",
)


def found_input_faults(
    recording: Recording, car: Car, steering_ratio: float, role: str
) -> tuple[list[AxisFault], InputWiring]:
    """The faults of steering (`role`) and wheels, and how these are wired; none where it can't be told."""
    view = _View(recording, car)
    if not view.enough:
        return [], InputWiring()
    as_mapped = view.slopes(1.0)
    if _cost(as_mapped, InputWiring()) < _PRICE + _BETTER:
        return [], InputWiring()
    ways = list(_ways(steering_ratio, role))
    slopes = {1.0: as_mapped} | {factor: view.slopes(factor) for factor in _WHEEL_UNITS.values()}
    costs = [_cost(slopes[way.wiring.wheels], way.wiring) + _PRICE * len(way.mistakes) for way in ways]
    best = int(np.argmin(costs))
    # What is still as far off is another mistake than these.
    unsaid = costs[best] - _PRICE * len(ways[best].mistakes)
    if costs[best] + _BETTER > costs[0] or unsaid > _UNSAID * costs[0]:
        return [], InputWiring()
    words = [
        text.format(k=k) for text, k in zip(_WORDS, as_mapped, strict=True) if k is not None and _off(k, 1.0) > 1.0
    ]
    gain, evidence = costs[0] - costs[best], "; ".join(words[:_MOST_WORDS])
    # A unit is given by message, so that all wheels have it.
    each = [(one, kind) for channel, kind in ways[best].mistakes for one in ((channel,) if channel else WHEEL_SPEEDS)]
    return [AxisFault(channel, kind, gain, evidence) for channel, kind in each], ways[best].wiring


def _ways(steering_ratio: float, role: str) -> Iterator[_Way]:
    """As mapped, and all others."""
    place = ("road_wheel_for_steering_wheel", 1.0 / steering_ratio)
    if role == AT_THE_ROAD:
        place = ("steering_wheel_for_road_wheel", steering_ratio)
    units = [("", 1.0), *UNITS[0].items(), place]
    wheel_units, sides = [("", 1.0), *_WHEEL_UNITS.items()], (False, True)
    for wheel, front, rear, sign, unit in itertools.product(wheel_units, sides, sides, (1.0, -1.0), units):
        mistakes = [
            (role, "reversed" if sign < 0.0 else ""),
            (role, unit[0]),
            ("", wheel[0]),
            ("wheel_speed_fl", "swapped_with_fr" if front else ""),
            ("wheel_speed_rl", "swapped_with_rr" if rear else ""),
        ]
        wiring = InputWiring(sign * unit[1], wheel[1], front, rear)
        yield _Way(wiring, tuple(mistake for mistake in mistakes if mistake[1]))


def _cost(slopes: _Slopes, wiring: InputWiring) -> float:
    """What the slopes speak against this wiring, with the IMU's yaw and two accelerations as well as they can be."""
    front, rear = (-1.0 if swapped else 1.0 for swapped in (wiring.front_swapped, wiring.rear_swapped))
    steering = wiring.steering

    def by_gyro(gyro: float) -> float:
        across = ((slopes.across, 1.0 / gyro), (slopes.across_by_steering, 1.0 / steering))
        found = _off(slopes.turn, gyro / steering) + _off(slopes.front, front / gyro) + _off(slopes.rear, rear / gyro)
        return found + _fewest(1, lambda factor: sum(_off(slope, factor * right) for slope, right in across))

    by_steering = ((slopes.front_by_steering, front), (slopes.rear_by_steering, rear))
    found = sum(_off(slope, side / steering) for slope, side in by_steering)
    return found + _fewest(0, by_gyro) + _fewest(1, lambda factor: _off(slopes.along, factor))


def _fewest(triad: int, cost: Callable[[float], float]) -> float:
    """The least cost of a gyro (0) or an accelerometer (1), which may be turned round, and in another unit."""
    units = [(1.0, 0.0), *((factor, _PRICE) for factor in UNITS[triad].values())]
    return min(
        cost(sign * factor) + price + turned for factor, price in units for sign, turned in ((1.0, 0.0), (-1.0, _PRICE))
    )


def _off(slope: float | None, right: float) -> float:
    """What a slope speaks against its being this: the square of how far it is off, and no more than the loudest."""
    if slope is None:
        return 0.0
    ratio = slope / right
    return min(0.5 * (math.log(ratio) / _OFF) ** 2, _LOUDEST) if ratio > 0.0 else _LOUDEST


def _divided(signal: Signal, factor: float) -> Signal:
    return signal._replace(values=signal.values / factor)


def _least_deviations(y: Floats, x: Floats) -> tuple[float, float]:
    """By least absolute deviations how many times `x` (n,) `y` is, and the spread; infinite where nothing moves.

    That is a weighted median of ratios, which what happens for a moment does not move.
    """
    there = x != 0.0
    if not there.any():
        return 0.0, math.inf
    by_ratio = np.argsort(ratios := y[there] / x[there])
    weight = np.cumsum(np.abs(x[there])[by_ratio])
    slope = float(ratios[by_ratio[np.searchsorted(weight, 0.5 * weight[-1])]])
    left = y - slope * x
    lasts = max(float(left[1:] @ left[:-1]) / max(float(left @ left), 1e-30), 0.0)
    return slope, math.sqrt(float(left @ left) / float(x @ x) * (1.0 + lasts) / (len(x) * max(1.0 - lasts, 1e-3)))


def _moved(values: Floats, used: Bools) -> Floats:
    """Those that are used, without their offset."""
    return np.asarray(values[used] - np.median(values[used]))


class _View:
    """Means of what is driven, and what changes quickly in them."""

    def __init__(self, recording: Recording, car: Car) -> None:
        self._car, per = car, round(_BIN_S / DT_S)
        columns = np.column_stack([recording.road_wheel_angle_rad, recording.wheels_mps, recording.imu])
        bins = columns[: len(columns) // per * per].reshape(-1, per, columns.shape[1]).mean(axis=1)
        self._steer_rad, self._wheels_mps, self._imu = bins[:, 0], bins[:, 1:5], bins[:, 5:]
        v_mps = np.mean(self._wheels_mps, axis=1)
        driven = np.isfinite(self._steer_rad + v_mps)
        driven[driven] = v_mps[driven] > _ROLLS * np.max(v_mps[driven], initial=0.0)
        self._driven = driven
        self.enough = int(np.count_nonzero(driven)) >= _LEAST_BINS
        reach = np.arange(-3.0 * _SLOW_S, 3.0 * _SLOW_S + _BIN_S / 2.0, _BIN_S)
        self._kernel = np.exp(-0.5 * (reach / _SLOW_S) ** 2)

    def slopes(self, wheels: float) -> _Slopes:
        """All that is seen, with wheels whose readings are so many times what they are."""
        v, gyro, across = np.mean(self._wheels_mps, axis=1) / wheels, self._imu[:, _YAW], self._imu[:, _ACROSS]
        by_steering = np.array([self._turned(*pair) for pair in zip(v, self._steer_rad, strict=True)])
        left, right = self._wheels_mps[:, 0::2] / wheels, self._wheels_mps[:, 1::2] / wheels
        front, rear = ((right - left) / (self._car.front_track_m, self._car.rear_track_m)).T
        return _Slopes(
            turn=self._slope(gyro, by_steering),
            front=self._slope(front, gyro),
            rear=self._slope(rear, gyro),
            front_by_steering=self._slope(front, by_steering),
            rear_by_steering=self._slope(rear, by_steering),
            across=self._slope(across, gyro * v, self._quick),
            across_by_steering=self._slope(across, by_steering * v, self._quick),
            along=self._slope(self._imu[:, _ALONG], np.gradient(v, _BIN_S), self._quick),
        )

    def _turned(self, v_mps: float, steer_rad: float) -> float:
        """The yaw rate that the car as configured has at last, rad/s: (1) with both derivatives 0."""
        car = self._car
        if not (math.isfinite(v_mps + steer_rad) and v_mps > 0.0):
            return math.nan
        a = bicycle_model(
            car.mass_kg,
            car.yaw_inertia_kgm2,
            car.cg_to_front_axle_m,
            car.cg_to_rear_axle_m,
            car.front_cornering_stiffness_n_per_rad,
            car.rear_cornering_stiffness_n_per_rad,
            v_mps,
        )
        rolls, at_rest = v_mps / car.wheelbase_m, a.a11 * a.a22 - a.a12 * a.a21
        gain = (a.a21 * a.b1 - a.a11 * a.b2) / at_rest if at_rest > 0.0 else math.inf
        return min(gain, _MOST_TURNED * rolls) * steer_rad

    def _slope(self, target: Floats, course: Floats, of: Callable[[Floats, Bools], Floats] = _moved) -> float | None:
        """How many times the course the target is, in what is `of` both; None where that is not seen."""
        used = self._driven & np.isfinite(target) & np.isfinite(course)
        if np.count_nonzero(used) < _LEAST_BINS:
            return None
        y, x = of(target, used), of(course, used)
        power = float(x @ x)
        if power <= 0.0 or not y.any():
            return None
        slope, std = _least_deviations(y, x)
        # What a braked wheel does in hard bends is no wiring: it is not so in gentle ones.
        gentle = np.abs(x) < np.median(np.abs(x))
        gently, gently_std = _least_deviations(y[gentle], x[gentle])
        if gently * slope < 0.0 and abs(gently) > _TOLD * gently_std:
            return None
        likeness = abs(slope) * math.sqrt(power / float(y @ y))
        return slope if abs(slope) > _LEAST_T * std and likeness > _LEAST_CORRELATION else None

    def _quick(self, values: Floats, used: Bools) -> Floats:
        """Those that are used, without what changes slowly: hills and banks are in accelerometers."""
        known, there = (
            np.pad(one, len(self._kernel) // 2) for one in (np.where(used, values, 0.0), used.astype(float))
        )
        slow, weight = (np.convolve(one, self._kernel, mode="valid") for one in (known, there))
        return np.asarray(values[used] - (slow / np.maximum(weight, 1e-12))[used])
