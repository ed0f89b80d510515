"""The road and the air over time, by what the sensors have left over: profiles that no formula gives."""

from __future__ import annotations

import math
from collections.abc import Collection
from copy import copy
from typing import Any

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.diagnose.effects.nuisances import OFFSETS
from dsz_daemon.diagnose.effects.surroundings import KNOTS
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import DT_S, sharp_kernel
from dsz_daemon.diagnose.residuals.comparison import FORM, Each, Rows, floors
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import Drive
from dsz_daemon.diagnose.simulation.instruments import low_passed
from dsz_daemon.diagnose.simulation.moving import Moving, of_roll, rolls_of
from dsz_daemon.diagnose.simulation.prediction import ALONG, forces_of, gyros_of, predicted
from dsz_daemon.diagnose.simulation.road import Profiles, correction, flat
from dsz_daemon.diagnose.simulation.rolling import Rolling
from dsz_daemon.diagnose.simulation.slow_sensors import in_time
from dsz_daemon.diagnose.surroundings.unfelt_banks import bank_by_the_turn, is_unfelt
from dsz_daemon.diagnose.surroundings.unfelt_grades import Climb, climbs_unfelt
from dsz_daemon.diagnose.surroundings.winds import (
    AGAIN,
    ROUNDS,
    by_the_lean,
    wind_and_shown,
    with_wind,
    with_wind_that_leans,
)

Floats = np.ndarray[Any, np.dtype[np.float64]]

_ACROSS, _FORCES = 4, slice(3, 6)
# A road bends over metres; what is quicker is the gyro's noise, which v q would bring into the vertical acceleration.
# All of a road passes that bends up and down within two seconds.
_ROAD_KERNEL = sharp_kernel(1.5)
_TILTS, _WIND = ("road_bank", "road_grade"), "side_wind"
# How a road is drawn: its tilts turn into each other as the car turns, or stay.
_FLAT_BENDS = "flat_bends"
# What makes another road of what the roll and pitch gyros show, and what tells of anything later than it was.
_TURN_THE_GYROS = frozenset(
    {"imu_misalignment", "gyro_scale", "gyro_cross_axis", "gyro_g_sensitivity", "bias_drift"}
    | {"suspension_roll", "suspension_pitch"}
)
_LATE = {"imu_delay": INDEX["imu_delay.delay_s"], "sensor_bandwidth": INDEX["sensor_bandwidth.time_constant_s"]}
_LEANS = INDEX["suspension_roll.roll_gradient_rad_per_mps2"]
_DIVES = INDEX["suspension_pitch.pitch_gradient_rad_per_mps2"]
# A lateral acceleration that is off by so many times what noise and form leave is a force that is in no simulation.
_NO_FORCE, _SURELY_A_FORCE = 2.0, 3.0
_MOST_MPS2 = 20.0
_AHEAD_SCALE = INDEX["accel_scale.x"]
_SIDEWAYS = INDEX["offset_accel_y"]
_SHOW_A_TURN = [INDEX["offset_gyro_z"], _SIDEWAYS]
_TILT_GYROS = [INDEX[f"offset_gyro_{axis}"] for axis in "xy"]
_BY_GRAVITY = [INDEX[f"gyro_g_sensitivity.{axis}z"] for axis in "xy"]
_WIND_AHEAD, _YAW = INDEX["side_wind.ahead_m"], 2
_AHEAD_M, _NEAR_M = np.array([-0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0]), 0.1


class Felt:
    """What is felt of road and air when these effects are in the model, from parameters `start` on.

    The wind is that of `start`, or felt `anew` for any parameters. The road is felt anew for any parameters, since what
    turns the gyros' axes or scales them makes another road of the same readings; constant offsets stay those of
    `start`: corrections are the knots'. What leans the body and is in no simulation is no road: see `leaning`. A late
    sensor's readings are of what was there before.
    """

    def __init__(self, drive: Drive, start: Floats, effects: tuple[str, ...]) -> None:
        self._drive, self._start, self._effects = drive, start, effects
        self.is_tilted = bool(set(_TILTS) & set(effects))
        self.profiles = set(effects) & {*_TILTS, _WIND}
        level = flat(len(drive.steer))
        self._left_mps2, self._tyres_mps2, self._lean_share = level.lean_mps2, level.lean_mps2, 0.0
        self.is_anew = False
        self._turned: tuple[bytes, Floats] | None = None
        self._banked: tuple[bytes, Floats] | None = None
        self._is_unfelt = "road_bank" in effects and is_unfelt(drive)
        self._climb = Climb(drive) if "road_grade" in effects and climbs_unfelt(drive) else None
        self._climbed: tuple[bytes, Floats] | None = None
        self._rolled: tuple[bytes, Rolling] | None = None
        self._first = self._tilted(flat(len(drive.steer)), start)
        if _WIND in effects:
            self._first = self.blown(start, effects)._first

    def __call__(self, x: Floats) -> Profiles:
        """The road and the air for these parameters."""
        return self.and_shown(x)[0]

    def and_shown(self, x: Floats) -> tuple[Profiles, Floats | None]:
        """The same, and what is predicted there (n, 13), where that had to be known to feel it."""
        leans_mps2 = self._lean_share * (in_time(self._left_mps2, x) + self._tyres_mps2)
        road = self._tilted(self._first._replace(lean_mps2=leans_mps2, lean_share=self._lean_share), x)
        return wind_and_shown(self._drive, x, road, AGAIN) if self.is_anew else (road, None)

    def blown(self, x: Floats, effects: tuple[str, ...], rounds: int = ROUNDS) -> Felt:
        """The same road, as it is corrected in `x`, and the wind that is felt on it."""
        found, soft = copy(self), by_the_lean(x)
        found.is_anew = False
        found._start, found._effects, found.profiles = x.copy(), effects, self.profiles | {_WIND}
        found._start[: len(OFFSETS)] = self._start[: len(OFFSETS)]
        if soft:
            found._lean_share = 0.0
        road = found(x)
        there = with_wind_that_leans(self._drive, x, road) if soft else with_wind(self._drive, x, road, rounds)
        found._first = found._first._replace(side_n=there.side_n)
        return found

    def anew(self) -> Felt | None:
        """The same with a wind that is another one for other parameters: what tyres do is no wind; None without one.

        A wind by the lean is what the gyro has left over, and stays.
        """
        if self.is_anew or _WIND not in self.profiles or by_the_lean(self._start):
            return None
        found = copy(self)
        found.is_anew = True
        return found

    def smoothed_anew(self) -> Felt | None:
        """The same with a grade that is as smooth as it is now, where no gyro feels it; None for any other road."""
        found = copy(self)
        found._climb = self._climb and self._climb.anew()
        return found if found._climb else None

    def changes_with(self, effect: str) -> bool:
        """Whether another parameter of this effect makes another road, or lean, of the same readings."""
        if self.is_anew:
            return True
        if self._is_unfelt or self._climb is not None:
            return True
        if effect in _LATE:
            return self.is_tilted or self._lean_share > 0.0
        if effect in _TILTS:
            return self._is_tilted_twice
        return self.is_tilted and effect in _TURN_THE_GYROS

    def changes_with_offset(self, column: int) -> bool:
        """Whether another constant offset makes another road, or wind: what is felt of either has that in it.

        A road by integrals keeps the offsets of `start`, and so does a climb that no gyro feels.
        """
        return (self.is_anew and column == _SIDEWAYS) or (self._is_unfelt and column in _SHOW_A_TURN)

    def leaning(self, x: Floats, moving: Moving, base: Floats, share: float = 1.0) -> Felt:
        """The same with a body that leans to forces, too, that are in no simulation.

        They are what the lateral accelerometer has left over of what is predicted, `base` (n, 13), for these parameters
        on the road felt, as far as that is more than noise and form. Together with what the tyres do there they are
        what the accelerometer told: other parameters lean the body no other way.
        """
        if x[_LEANS] == 0.0 or (_WIND in self._effects and by_the_lean(self._start)):
            return self
        found = copy(self)
        left_mps2, lean_share = _left_over(self._drive, base)
        tyres_mps2 = np.clip(np.nan_to_num(moving.moved[:, motion.LEANS]), -_MOST_MPS2, _MOST_MPS2)
        found._left_mps2 = self._left_mps2 + share * (left_mps2 - self._left_mps2)
        found._tyres_mps2 = self._tyres_mps2 + share * (tyres_mps2 - self._tyres_mps2)
        found._lean_share = self._lean_share + share * (lean_share - self._lean_share)
        return found

    def _tilted(self, road: Profiles, x: Floats) -> Profiles:
        if not self.is_tilted:
            return road
        alone = x.copy()
        alone[: len(OFFSETS)] = self._start[: len(OFFSETS)]
        # What gravity does to a gyro is the same all the way, as an offset is, and tilts no road either.
        alone[_TILT_GYROS] -= motion.G * (x[_BY_GRAVITY] - self._start[_BY_GRAVITY])
        for name in _TILTS:
            first = INDEX[f"{name}.knot_0"]
            alone[first : first + KNOTS] = 0.0
        turning = self._turning(road, alone)
        bank_rad, grade_rad = (correction(x, name, len(turning)) for name in _TILTS)
        of_rates, of_forces = gyros_of(alone)
        # What accelerometers show of the road is in `turning`.
        of_forces = np.where(np.isfinite(self._drive.measured[:, _FORCES]).any(axis=0), 0.0, of_forces)
        road = _with_tilt(alone, road, turning, (bank_rad, -grade_rad), (of_rates, of_forces), *self._gyros_feel)
        road = road._replace(bank_rad=self._unfelt_bank(road, x, alone)) if self._is_unfelt else road
        if self._climb is not None:
            shown_mps2 = motion.G * (1.0 + float(x[_AHEAD_SCALE])) * leans_too(x, road.lean_share)[1]
            up_rad = self._climb.up_rad(self._left_along(road, alone), shown_mps2)
            road = road._replace(grade_rad=in_time(up_rad, x))
        return road

    def _unfelt_bank(self, road: Profiles, x: Floats, alone: Floats) -> Floats:
        """A bank that no roll gyro feels, of these parameters, offsets included: no integral, so it does not drift."""
        alone = alone.copy()
        alone[_SHOW_A_TURN] = x[_SHOW_A_TURN]
        key = b"".join(each.tobytes() for each in (alone, road.side_n, road.lean_mps2, np.array(road.lean_share)))
        if self._banked is None or self._banked[0] != key:
            level = flat(len(self._drive.steer))
            level = level._replace(side_n=road.side_n, lean_mps2=road.lean_mps2, lean_share=road.lean_share)
            leant = leans_too(alone, road.lean_share)[0]
            bank = bank_by_the_turn(self._drive, alone, level, self._rolls(level, alone), _ROAD_KERNEL, leant)
            self._banked = key, in_time(bank, alone)
        return self._banked[1]

    def _left_along(self, road: Profiles, alone: Floats) -> Floats:
        """What the longitudinal accelerometer has left over on a road that does not climb (n,), m/s^2."""
        key = b"".join(each.tobytes() for each in (alone, road.side_n, road.bank_rad))
        if self._climbed is None or self._climbed[0] != key:
            level = road._replace(grade_rad=np.zeros(len(road.grade_rad)))
            shown = predicted(self._drive, alone, level, self._rolls(level, alone))
            self._climbed = key, np.nan_to_num(self._drive.measured[:, ALONG] - shown[:, ALONG])
        return self._climbed[1]

    def unseen_along(self, x: Floats, rows: Rows) -> tuple[Floats, float] | None:
        """What of a grade that no pitch gyro feels other places do not tell, see there; None for any other road."""
        return None if self._climb is None else self._climb.unseen(rows, self._left_along(self(x), x))

    @property
    def _gyros_feel(self) -> tuple[bool, bool]:
        """Whether the road banks, and climbs, by what a gyro feels."""
        banks, climbs = (name in self._effects for name in _TILTS)
        return banks and not self._is_unfelt, climbs and self._climb is None

    @property
    def _is_tilted_twice(self) -> bool:
        """Whether the road banks and climbs: in a bend the one becomes the other, and so does an error of it."""
        return set(_TILTS) <= set(self._effects)

    def _turning(self, road: Profiles, alone: Floats) -> Floats:
        """What the roll and pitch gyros have left over on a level road, rad/s, and what the car turns and rolls (n, 4).

        Of a road that neither feels the first two are not looked at, and 0. Kept for the next call, of this or a copy,
        which may differ in corrections only.
        """
        key = b"".join(each.tobytes() for each in (alone, road.side_n, road.lean_mps2, np.array(road.lean_share)))
        if self._turned is None or self._turned[0] != key:
            level = flat(len(self._drive.steer))
            level = level._replace(side_n=road.side_n, lean_mps2=road.lean_mps2, lean_share=road.lean_share)
            rolls = self._rolls(level, alone)
            left = np.zeros((len(rolls.v_mps), 2))
            if any(self._gyros_feel):
                shown = predicted(self._drive, alone, level, rolls)
                left = np.nan_to_num(self._drive.measured[:, :2] - shown[:, :2] - self._forces(shown, alone))
            yaw = np.nan_to_num(self._drive.measured[:, 2] - alone[INDEX["offset_gyro_z"]]) / gyros_of(alone)[0][2, 2]
            self._turned = key, np.column_stack([left, yaw, rolls.v_mps])
        return self._turned[1]

    def _forces(self, shown: Floats, x: Floats) -> Floats:
        """What roll and pitch gyros show (n, 2) of the forces that accelerometers show beyond what is `shown`.

        Gravity along the road is in these. By those that the road itself makes it would go round: a hill makes more
        hill, and what an integral has wrong at first grows e times in 30 s.
        """
        of_forces = gyros_of(x)[1][:2]
        if not of_forces.any():
            return np.zeros((len(shown), 2))
        more = np.nan_to_num(self._drive.measured[:, _FORCES] - shown[:, _FORCES])
        return np.asarray(more @ (of_forces @ np.linalg.inv(forces_of(x))).T)

    def _rolls(self, level: Profiles, x: Floats) -> Rolling:
        """What is known on a level road before the car moves sideways; kept for the next call, as `_turning` is."""
        key = of_roll(x).tobytes()
        if self._rolled is None or self._rolled[0] != key:
            self._rolled = key, rolls_of(self._drive, x, level)
        return self._rolled[1]


def undrawn(effects: Collection[str]) -> set[int]:
    """Of how a road is drawn what is not asked beside these effects: nothing where it tilts."""
    return set() if set(_TILTS) & set(effects) else {INDEX[name] for name in ("flat_roads", _FLAT_BENDS)}


def _with_tilt(
    x: Floats,
    road: Profiles,
    turning: Floats,
    corrections: tuple[Floats, Floats],
    shows: tuple[Floats, Floats],
    banks: bool,
    climbs: bool,
) -> Profiles:
    """Both Euler angles at once, small angles: bank' = p + r slope, slope' = q - r bank, slope with the nose down.

    As far as a road's tilts turn into each other, see `felt`.
    `turning`: what the gyros show of p and q, r, and speed (n, 4). `corrections` (n,) or (1,), rad, are what knots add
    to bank and slope after this: so much more turns into the other angle. `shows`: what gyros show of rates and of
    forces that are not in `turning` (3, 3).
    """
    leans, n = leans_too(x, road.lean_share), len(turning)
    more = [np.ascontiguousarray(np.broadcast_to(lean * c, n)) for lean, c in zip(leans, corrections, strict=True)]
    turns_too = 1.0 - float(x[INDEX[_FLAT_BENDS]])
    tilts = _integrated(np.ascontiguousarray(turning), more[0], more[1], *shows, banks, climbs, turns_too)
    bank, slope = (
        low_passed(in_time(tilt, x) / lean, _ROAD_KERNEL) if there else tilt
        for tilt, lean, there in zip(tilts, leans, (banks, climbs), strict=True)
    )
    return road._replace(bank_rad=bank, grade_rad=-slope)


def leans_too(x: Floats, lean_share: float) -> tuple[float, float]:
    """What a body turns on a bank and on a climb, over what the road does: it leans on its springs to them, too.

    On a bank only as far as no measured acceleration leans it.
    """
    return 1.0 + (1.0 - lean_share) * motion.G * float(x[_LEANS]), 1.0 + motion.G * float(x[_DIVES])


def _left_over(drive: Drive, base: Floats) -> tuple[Floats, float]:
    """Lateral acceleration (n,) that the simulation has not, and what share is no noise and no matter of form."""
    if not np.isfinite(drive.measured[:, _ACROSS]).any():
        return np.zeros(len(drive.steer)), 0.0
    rolling = np.mean(drive.wheels, axis=1) > motion.ROLLING_MPS
    left = drive.measured[:, _ACROSS] - base[:, _ACROSS]
    left = np.where(rolling, np.clip(np.nan_to_num(left), -_MOST_MPS2, _MOST_MPS2), 0.0)
    usual = np.hypot(np.nan_to_num(floors(drive)[_ACROSS]), FORM * float(np.nanstd(drive.measured[:, _ACROSS])))
    rms = math.sqrt(float(np.sum(left**2)) / max(int(np.count_nonzero(rolling)), 1))
    share = (rms / max(float(usual), 1e-9) - _NO_FORCE) / (_SURELY_A_FORCE - _NO_FORCE)
    return np.asarray(left), min(max(share, 0.0), 1.0)


def wind_ahead_m(drive: Drive, x: Floats, felt: Felt, effects: tuple[str, ...], each: Each = map) -> float:
    """How far ahead of the C.G. the wind pushes, by which the yaw rate is told best: another place is another wind."""
    rolling = np.mean(drive.wheels, axis=1) > motion.ROLLING_MPS
    if not np.isfinite(drive.measured[rolling, _YAW]).any():
        return 0.0

    # Pushed elsewhere, a car may spin: that place is no answer.
    @np.errstate(over="ignore", invalid="ignore")
    def left_at(ahead_m: float) -> float:
        there = x.copy()
        there[_WIND_AHEAD] = ahead_m
        left = drive.measured[:, _YAW] - predicted(drive, there, felt.blown(there, effects, AGAIN)(there))[:, _YAW]
        return float(np.nanvar(left[rolling]))

    # Every other place first, then those beside the best of these: the best of all, too, has one on each side.
    left = np.full(len(_AHEAD_M), math.inf)
    first = [*range(1, len(_AHEAD_M), 2)]
    left[first] = list(each(left_at, _AHEAD_M[first]))
    best = int(np.argmin(left))
    beside = [best - 1, best + 1]
    left[beside] = list(each(left_at, _AHEAD_M[beside]))
    if not np.isfinite(left[[*first, *beside]]).all():
        return 0.0
    best = min(max(int(np.argmin(left)), 1), len(_AHEAD_M) - 2)
    lowest_m = _lowest(_AHEAD_M[best - 1 : best + 2], left[best - 1 : best + 2])
    if lowest_m is None:
        return 0.0
    # The yaw rate is right where a push turns the car as much as this one does, which bends more on one side.
    near_m = lowest_m + np.array([-_NEAR_M, 0.0, _NEAR_M])
    near = np.array(list(each(left_at, near_m)))
    nearer_m = _lowest(near_m, near) if np.isfinite(near).all() else None
    return lowest_m if nearer_m is None else nearer_m


def _lowest(at: Floats, values: Floats) -> float | None:
    """Where a parabola through three points is lowest, on the way between the outer ones; None where it is not."""
    curve, slope, _ = np.polyfit(at, values, 2)
    return float(np.clip(-0.5 * slope / curve, at[0], at[2])) if curve > 0.0 else None


@compiled
def _integrated(
    turning: Floats,
    more_bank: Floats,
    more_slope: Floats,
    of_rates: Floats,
    of_forces: Floats,
    banks: bool,
    climbs: bool,
    turns_too: float,
) -> tuple[Floats, Floats]:
    """Bank and slope (n,) of what the gyros show: what they show of others' rates and of forces is taken off.

    Forces are what the tilt itself makes: gravity along the road, and what the car rises by, a_z = g - q v.
    """
    bank, slope = np.zeros(len(turning)), np.zeros(len(turning))
    for i in range(1, len(turning)):
        yaw, v = turns_too * turning[i, 2], turning[i, 3]
        bank_too, slope_too = bank[i - 1] + more_bank[i - 1], slope[i - 1] + more_slope[i - 1]
        ahead, aside = -motion.G * slope_too, motion.G * bank_too
        shown_p = 0.5 * (turning[i, 0] + turning[i - 1, 0]) - of_forces[0, 0] * ahead - of_forces[0, 1] * aside
        shown_q = 0.5 * (turning[i, 1] + turning[i - 1, 1]) - of_forces[1, 0] * ahead - of_forces[1, 1] * aside
        p_of_p, p_of_q = of_rates[0, 0], of_rates[0, 1] - of_forces[0, 2] * v
        q_of_p, q_of_q = of_rates[1, 0], of_rates[1, 1] - of_forces[1, 2] * v
        if banks and climbs:
            both = p_of_p * q_of_q - p_of_q * q_of_p
            p, q = (q_of_q * shown_p - p_of_q * shown_q) / both, (p_of_p * shown_q - q_of_p * shown_p) / both
        else:
            # What turns about the axis of the other tilt turns with the car.
            p = (shown_p - p_of_q * yaw * bank_too) / p_of_p
            q = (shown_q + q_of_p * yaw * slope_too) / q_of_q
        if banks:
            bank[i] = bank[i - 1] + DT_S * (p + yaw * slope_too)
        if climbs:
            slope[i] = slope[i - 1] + DT_S * (q - yaw * bank_too)
    return bank, slope
