"""Axes that are not what the configuration says: turned round, on another's plug, in another unit.

Looked at before anything is fitted, so that no physics has to explain a mapping's mistake. What is asked of each
channel is only what the nominal simulation is sure of: which way and roughly how much it must move with the driving,
and where gravity is. A channel that follows nothing proves nothing.

What a channel follows is seen in what changes within seconds: offsets, drift and long hills are taken off. What the
roll and pitch gyros say of the road's tilt is explained by the tilt first: on a hill a car may well slow down while
its accelerometer is pressed forward. Late signals are granted `_LATEST_S` either way.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.diagnose.faults.wiring import UNITS, AxisFault, mended
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.evidence import Box, solved
from dsz_daemon.signals import IMU_CHANNELS, STANDARD_GRAVITY_MPS2

Floats = np.ndarray[Any, np.dtype[np.float64]]
Bools = np.ndarray[Any, np.dtype[np.bool_]]

G = STANDARD_GRAVITY_MPS2
_YAW, _ALONG = 2, 3
# All below are chosen, and tried on the simulated car (no effect at its plain size is called an axis fault) and on the
# recordings of three real ones.
# A fault has to gain this in log likelihood. An axis with the same wrong unit as its neighbour needs less: units are
# given by sensor.
_LEAST_GAIN, _LEAST_GAIN_ALIKE = 10.0, 4.0
# Scale errors, leaning bodies and wrong stiffnesses stay within; the nearest unit is 9.8 times off.
_SLOPE_LOW, _SLOPE_HIGH = 0.4, 2.5
_BIN_S, _SECONDS = 0.2, 4.0
_LATEST_S, _LAG_STEP_S = 0.5, 0.1
_SHORTEST_S = 15.0
# The tilt that a gyro's integral tells pulls an accelerometer by 1 g per rad; a bit more is granted.
_TILT_G = 1.5
# What a thing counts that is so or isn't: where gravity is, a rate that no car has.
_CLEAR_GAIN = 20.0
# Gravity: more than half of it is on the vertical axis and less on the others, however tilted, up to 30 deg. What is
# twice as much and more can only be m/s^2 taken for g, which a range may clip, and counts half as much again.
_HALF = 0.5
_GRAVITY = {
    "": (_HALF, 1.0 + _HALF, _CLEAR_GAIN),
    "mps2_for_g": (2.0, math.inf, 1.5 * _CLEAR_GAIN),
    "g_for_mps2": (_HALF / G, (1.0 + _HALF) / G, _CLEAR_GAIN),
}
# Roll and pitch rates of a car with their offsets, rms: as good as all of them.
_TURN_RADPS = 0.1
# What a channel must move by, rms, to be followed: a road's small tilts and steering in steps do as much.
_LEAST_MOVED = (math.inf, math.inf, 0.001, 0.03, 0.03, math.inf)
# What follows its own sensor so well (its power over what is left of it, log) is nobody else's.
_ITS_OWN = math.log(4.0)
# Rms of what a road hardly tilts by within seconds: an accelerometer that moves by less, for all its unit makes of it,
# may show the road. Where no gyro tells the tilt, a car that gives way to hills looks turned round on gentler ones.
_STEEP_RAD, _HILLY_RAD = 0.04, 0.02
# What a fault has to explain of a channel's power: of what the tilt leaves (less where a sensor is only turned round:
# a phone shakes, and what it shows is moved the wrong way by as much as it should), and of all.
_LEAST_SHARE, _LEAST_TURNED, _LEAST_OF_ALL = 0.4, 0.3, 0.1
# Correlation to one side of a channel that does there what no fault of wiring does; a side with less than such a share
# of all that there is to be followed tells nothing.
_AGAINST, _A_SIDE = -0.5, 0.01


class _Said(NamedTuple):
    """What speaks for one reading of a channel: log likelihood gained over "follows nothing", and the words for it."""

    gain: float
    words: str


class _Way(NamedTuple):
    """One way to read a channel: as which sensor of its triad (0..2), which way round, in which unit ("" as mapped)."""

    sensor: int
    sign: float
    unit: str


_Table = list[dict[_Way, _Said]]
_NOTHING = _Said(0.0, "")


def found_faults(imu: Floats, nominal: Floats, used: Bools) -> list[AxisFault]:
    """The fewest faults that explain what is measured; none where it can't be told.

    `imu` (n, 6) is measured, `nominal` (n, 6) the nominal simulation without offsets, SI, on a grid of DT_S and
    filtered alike; `used` (n, 6) says which values count (every few rows will do).
    """
    used = used & np.isfinite(imu) & np.isfinite(nominal)
    views = [_View(imu, used, channel) for channel in range(3)]
    yaw = _followers(views, nominal, _YAW, 0)
    gyros = _fewest(0, [_gyro_ways(view, one) for view, one in zip(views, yaw, strict=True)])
    # What the gyros say of the road's tilt, they say as if wired right.
    views = [_View(imu, used, channel, mended(imu, gyros)[:, :2]) for channel in range(3, 6)]
    along, across = (_followers(views, nominal, sensor, 1) for sensor in (0, 1))
    accels = [_accel_ways(view, x | y) for view, x, y in zip(views, along, across, strict=True)]
    return [*gyros, *_fewest(1, accels)]


def _ways(triad: int) -> Iterator[_Way]:
    for sensor, sign, unit in itertools.product(range(3), (1.0, -1.0), ("", *UNITS[triad])):
        yield _Way(sensor, sign, unit)


def _gyro_ways(view: _View, following: dict[_Way, _Said]) -> dict[_Way, _Said]:
    """Yaw rate must be followed; of roll and pitch rates only what no car does is known."""
    rms = float(np.sqrt(np.mean(view.values**2))) if view.enough else 0.0
    ways = dict(following)
    for way in _ways(0):
        if way.sensor != _YAW:
            factor = UNITS[0].get(way.unit, 1.0)
            gain = 0.5 * (rms / _TURN_RADPS) ** 2 * (1.0 - factor**-2) - math.log(factor)
            said = _Said(min(gain, _CLEAR_GAIN), f"shows {rms:.2g} rad/s rms, more than any car rolls or pitches")
            ways[way] = said if gain > 0.0 and way.unit == "deg_for_rad" else _NOTHING
    return ways


def _accel_ways(view: _View, following: dict[_Way, _Said]) -> dict[_Way, _Said]:
    """Gravity must be on the vertical axis; what drives and turns the car must be followed by the other two."""
    if not view.enough:
        return dict.fromkeys(_ways(1), _NOTHING)
    mean = float(np.median(view.values))
    shows = f"shows {mean:.3g} m/s^2 on average, where gravity is {G:.2f} upward"
    ways = {}
    for way in _ways(1):
        if way.sensor == 2:
            low, high, gain = _GRAVITY[way.unit]
            ways[way] = _Said(gain if low <= way.sign * mean / G <= high else 0.0, shows)
        else:
            said = following[way]
            # A unit that nothing else speaks for is no excuse for gravity.
            factor = UNITS[1].get(way.unit, 1.0) if said.gain > 0.0 else 1.0
            upright = abs(mean) <= _HALF * G * factor
            ways[way] = _Said(said.gain + (_CLEAR_GAIN if upright else 0.0), said.words)
    return ways


class _Fit(NamedTuple):
    """How one channel follows a nominal one: log of the squares' ratio, rows, rows that say as much as one; words."""

    log_ratio: float
    rows: int
    correlated: float
    words: str


_NO_FIT = _Fit(0.0, 0, 1.0, "")


def _followers(views: Sequence[_View], nominal: Floats, sensor: int, triad: int) -> list[dict[_Way, _Said]]:
    """For each channel of a triad, what speaks for its showing this sensor, each way round and in each unit.

    The channels compete for the sensor: what the best one leaves tells for all of them how many rows are independent.
    """
    table = [view.follows(nominal, sensor, triad) for view in views]
    own = max(fit.log_ratio for way, fit in table[sensor].items() if not way.unit)
    if own > _ITS_OWN:
        # Whatever else moves in time with it has a leak of it.
        table = [fits if fits is table[sensor] else dict.fromkeys(fits, _NO_FIT) for fits in table]
    best = max((fit for fits in table for fit in fits.values()), key=lambda fit: fit.log_ratio)
    return [
        {way: _Said(0.5 * fit.rows / best.correlated * fit.log_ratio, fit.words) for way, fit in fits.items()}
        for fits in table
    ]


class _View:
    """One channel: its values that count, and what changes quickly in it, beyond what tilts the road."""

    def __init__(self, imu: Floats, used: Bools, channel: int, tilts_radps: Floats | None = None) -> None:
        self._channel, self._used = channel, used[:, channel]
        self.values: Floats = imu[self._used, channel]
        self._bins = (np.arange(len(imu)) // round(_BIN_S / DT_S))[self._used]
        self._count = np.bincount(self._bins)
        self._seen = self._count > 0
        self.enough = bool(np.count_nonzero(self._seen) * _BIN_S >= _SHORTEST_S)
        if self.enough:
            reach = np.arange(-3.0 * _SECONDS, 3.0 * _SECONDS + _BIN_S / 2.0, _BIN_S)
            self._kernel = np.exp(-0.5 * (reach / _SECONDS) ** 2)
            self._weight = np.maximum(self._smooth(self._seen.astype(np.float64)), 1e-12)
            self._measured = self._quick(imu[:, channel])
            rates = () if tilts_radps is None else tilts_radps.T
            self._tilts = [self._quick(_turned(rate)) for rate in rates]

    def _smooth(self, values: Floats) -> Floats:
        return np.convolve(np.pad(values, len(self._kernel) // 2), self._kernel, mode="valid")

    def _quick(self, values: Floats) -> Floats:
        """Means of the bins that count, less what changes slowly."""
        means = np.bincount(self._bins, values[self._used]) / np.maximum(self._count, 1)
        return np.asarray((means - self._smooth(means) / self._weight)[self._seen])

    def follows(self, nominal: Floats, sensor: int, triad: int) -> dict[_Way, _Fit]:
        """How well "this channel shows that sensor, so wired" fits, give or take a scale error."""
        ways = [way for way in _ways(triad) if way.sensor == sensor]
        if not self.enough:
            return dict.fromkeys(ways, _NO_FIT)
        followed = 3 * triad + sensor
        lagged = [self._quick(_late(nominal[:, followed], lag_s)) for lag_s in _lags_s()]
        if max(float(np.std(one)) for one in lagged) < _LEAST_MOVED[followed]:
            return dict.fromkeys(ways, _NO_FIT)
        fits = {way: self._fit(way, lagged, followed) for way in ways}
        if followed == _YAW:
            fits |= {way: _NO_FIT for way in ways if self._goes_back(nominal[self._used, followed], way)}
        return fits

    def _goes_back(self, followed: Floats, way: _Way) -> bool:
        """Whether the channel goes against what it is to follow on one side: it shows a size that has lost its sign."""
        shown, least = way.sign * self.values, _A_SIDE * float(followed @ followed)
        sides = (side for side in (followed > 0.0, followed < 0.0) if float(followed[side] @ followed[side]) > least)
        return any(
            _correlation(followed[side] - followed[side].mean(), shown[side] - shown[side].mean()) < _AGAINST
            for side in sides
        )

    def _fit(self, way: _Way, lagged: Sequence[Floats], followed: int) -> _Fit:
        factor = way.sign * UNITS[followed // 3].get(way.unit, 1.0)
        unsure = followed == _ALONG and way.sign < 0.0 and not np.any(self._tilts)
        least_rad = _STEEP_RAD if way.unit == "mps2_for_g" else _HILLY_RAD if unsure else 0.0
        if float(np.std(self._measured)) < least_rad * G * min(abs(factor), 1.0):
            return _NO_FIT
        likeness = [_correlation(one, self._measured) for one in lagged]
        best = int(np.argmax(np.array(likeness) * way.sign))
        tilt, slopes = _TILT_G * G * abs(factor), sorted((_SLOPE_LOW * factor, _SLOPE_HIGH * factor))
        bounds = [*[(-tilt, tilt)] * len(self._tilts), (slopes[0], slopes[1])]
        free, _ = _fitted(self._measured, self._tilts, bounds[:-1])
        left, slope = _fitted(self._measured, [*self._tilts, lagged[best]], bounds)
        moved, beyond, unknown = (float(one @ one) for one in (self._measured, free, left))
        as_mapped = factor == 1.0 and followed == self._channel
        # At a bound it is something else that moves the channel.
        inside = 1.001 * _SLOPE_LOW < slope / factor < 0.999 * _SLOPE_HIGH
        share = _LEAST_TURNED if followed == self._channel and not way.unit else _LEAST_SHARE
        least = 0.0 if as_mapped else max(share * beyond, _LEAST_OF_ALL * moved)
        if beyond - unknown <= least or not inside:
            return _NO_FIT
        words = (
            f"moves {slope:.3g} times the simulated {IMU_CHANNELS[followed]} (correlation {likeness[best]:.2f}, "
            f"{len(left) * _BIN_S:.0f} s)"
        )
        return _Fit(math.log(beyond / max(unknown, 1e-12 * beyond)), len(left), _correlated_rows(left), words)


def _lags_s() -> list[float]:
    steps = round(_LATEST_S / _LAG_STEP_S)
    return [step * _LAG_STEP_S for step in range(-steps, steps + 1)]


def _late(values: Floats, lag_s: float) -> Floats:
    at = np.arange(len(values)) - round(lag_s / DT_S)
    return np.asarray(values[np.clip(at, 0, len(at) - 1)])


def _turned(rate_radps: Floats) -> Floats:
    """The angle (n,) that a rate adds up to, without the mean rate; as if still where nothing is known."""
    known = np.isfinite(rate_radps)
    mean = float(np.mean(rate_radps[known])) if known.any() else 0.0
    return np.asarray(np.cumsum(np.where(known, rate_radps - mean, 0.0)) * DT_S)


def _correlation(a: Floats, b: Floats) -> float:
    size = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / size if size > 0.0 else 0.0


def _fitted(target: Floats, columns: Sequence[Floats], bounds: Sequence[tuple[float, float]]) -> tuple[Floats, float]:
    """What bounded least squares leave of the target, and the last column's coefficient; one of zeros has none."""
    if not columns:
        return target, 0.0
    matrix = np.column_stack(columns)
    low, high = np.array(bounds, dtype=np.float64).T
    found = solved(matrix.T @ matrix, matrix.T @ target, Box(low, high, np.full(len(low), 1e-9)))
    return np.asarray(target - matrix @ found), float(found[-1])


def _correlated_rows(left: Floats) -> float:
    """How many rows say as much as one independent one: 1 + 2 sum of the autocorrelation, up to where it ends."""
    total, power = 1.0, float(left @ left)
    if power <= 0.0:
        return total
    for lag in range(1, len(left) // 4):
        one = float(left[lag:] @ left[:-lag]) / power
        if one < 0.05:
            break
        total += 2.0 * one
    return total


def _fewest(triad: int, table: _Table) -> list[AxisFault]:
    """The faults of one triad whose reading is worth most, each at its price."""
    best: tuple[float, tuple[_Way, ...]] = (-math.inf, ())
    for plugs in itertools.permutations(range(3)):
        choices = [[way for way in table[channel] if way.sensor == plugs[channel]] for channel in range(3)]
        for ways in itertools.product(*choices):
            worth = _worth(table, ways) - _price(ways)
            # Of equals the first: as mapped.
            if worth > best[0] + 1e-9:
                best = (worth, ways)
    ways = best[1]
    return [
        AxisFault(name, kind, _worth(table, ways) - _worth(table, without), words)
        for name, kind, without, words in _described(triad, table, ways)
    ]


def _worth(table: _Table, ways: Sequence[_Way]) -> float:
    return sum(table[channel][way].gain for channel, way in enumerate(ways))


def _price(ways: Sequence[_Way]) -> float:
    units = [way.unit for way in ways if way.unit]
    again = len(units) - len(set(units))
    ones = len(set(units)) + sum(way.sign < 0.0 for way in ways) + len(_swaps([way.sensor for way in ways]))
    return ones * _LEAST_GAIN + again * _LEAST_GAIN_ALIKE


def _swaps(plugs: Sequence[int]) -> list[tuple[int, int]]:
    """The fewest swaps of two plugs that lead from "as mapped" to these, in order."""
    now, swaps = [0, 1, 2], []
    for channel in range(3):
        if now[channel] != plugs[channel]:
            other = now.index(plugs[channel])
            now[channel], now[other] = now[other], now[channel]
            swaps.append((channel, other))
    return swaps


def _described(triad: int, table: _Table, ways: Sequence[_Way]) -> Iterator[tuple[str, str, tuple[_Way, ...], str]]:
    """Each fault's channel and kind, all ways without it, and its evidence."""
    names = IMU_CHANNELS[3 * triad : 3 * triad + 3]
    said = [table[channel][way].words for channel, way in enumerate(ways)]
    for channel, other in _swaps([way.sensor for way in ways]):
        pair = {channel: ways[other].sensor, other: ways[channel].sensor}
        without = tuple(way._replace(sensor=pair.get(c, way.sensor)) for c, way in enumerate(ways))
        words = "; ".join(f"{names[c]} {said[c]}" for c in (channel, other) if said[c])
        yield names[channel], f"swapped_with_{'xyz'[other]}", without, words
    for channel, way in enumerate(ways):
        words = f"{names[channel]} {said[channel]}"
        if way.sign < 0.0:
            without = tuple(one._replace(sign=1.0) if one is way else one for one in ways)
            yield names[way.sensor], "reversed", without, words
        if way.unit:
            without = tuple(one._replace(unit="") if one is way else one for one in ways)
            yield names[channel], way.unit, without, words
