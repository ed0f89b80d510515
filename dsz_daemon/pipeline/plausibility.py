"""Mounting, sign and unit mistakes, found by what the channels say of each other.

Physics relates the channels: forward acceleration and the wheels' speeding up, yaw rate and
the wheels' difference, lateral acceleration and yaw rate times speed, g on the vertical axis.
A wrong sign, unit or axis breaks a relation by far more than any offset or road does. Only
warnings come of it: the estimator is not told.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from dsz_daemon.core.linear import relaxed
from dsz_daemon.core.parameters import Car
from dsz_daemon.pipeline.rows import Refusal, Row
from dsz_daemon.signals import ACCEL_CHANNELS, IMU_CHANNELS, STANDARD_GRAVITY_MPS2, WHEEL_SPEEDS

# Both sides of a relation pass the same smoothing; it also differentiates the wheels' speed.
_SMOOTHING_S = 0.4
# Fewer rows than this (half a minute at 100 Hz) are no evidence for a sign or a unit.
_ROWS_NEEDED = 500
_SLOPE_LOW, _SLOPE_HIGH = 0.55, 1.8
# Of what the steering says a car turns by no less: one that understeers by half, and less.
_STEERED_LOW = 0.3
# A wheel that reads no more than this stands; one alone does not for so long while the others turn so quickly.
_STANDS_MPS, _OTHERS_MPS, _ALONE_S = 0.1, 5.0, 5.0
# A car that is felt to move by this scatter, rad/s and m/s^2, does not stand.
_FELT = {"gyro_z": 0.03, "accel_x": 0.7, "accel_y": 0.7}
_REFUSED = {
    "spike": "single samples that jump off and back, further than a car can move: a loose contact?",
    "frozen": "it repeated itself while the wheels' speed changed: a frozen sensor?",
    "frozen wheel": "all wheels repeated themselves to the last digit while driving: a frozen unit or gateway?",
    "stamp": "their time is far ahead of all others'",
}


@dataclass
class Relation:
    """Running sums of y against x: slope through the means, correlation, scatter of x."""

    n: int = 0
    x: float = 0.0
    y: float = 0.0
    xx: float = 0.0
    xy: float = 0.0
    yy: float = 0.0

    def add(self, x: float, y: float) -> None:
        """One pair; a pair with NaN is left out."""
        if math.isnan(x + y):
            return
        self.n += 1
        self.x += x
        self.y += y
        self.xx += x * x
        self.xy += x * y
        self.yy += y * y

    @property
    def x_std(self) -> float:
        """Scatter of x."""
        return math.sqrt(max(0.0, self.xx / self.n - (self.x / self.n) ** 2)) if self.n else 0.0

    @property
    def slope(self) -> float:
        """Regression slope of y on x."""
        sxx = self.xx - self.x * self.x / self.n
        return (self.xy - self.x * self.y / self.n) / sxx

    @property
    def correlation(self) -> float:
        """Correlation of x and y; 0 where one never moves."""
        if self.n < 2:
            return 0.0
        sxx = self.xx - self.x * self.x / self.n
        syy = self.yy - self.y * self.y / self.n
        sxy = self.xy - self.x * self.y / self.n
        return sxy / math.sqrt(sxx * syy) if sxx > 1e-12 and syy > 1e-12 else 0.0


@dataclass
class Plausibility:
    """Watches rows as they pass; `findings` says in words what can't be right."""

    car: Car
    period_s: float
    smoothed: dict[str, float] = field(default_factory=dict)
    relations: dict[str, Relation] = field(default_factory=dict)
    sums: dict[str, Relation] = field(default_factory=dict)
    changes: dict[str, int] = field(default_factory=dict)
    last: dict[str, float] = field(default_factory=dict)
    fast_rows: int = 0
    fastest_mps: float = 0.0
    others_turn: dict[str, int] = field(default_factory=dict)
    stands_alone: dict[str, int] = field(default_factory=dict)
    refused: dict[Refusal, int] = field(default_factory=dict)

    def watch(self, row: Row) -> None:
        """Takes one row into account."""
        for refusal in row.refused:
            self.refused[refusal] = self.refused.get(refusal, 0) + 1
        if row.event:
            self.smoothed.clear()
        values = row.inputs
        get = values.get
        speeds = [get(wheel, math.nan) for wheel in WHEEL_SPEEDS]
        known = [speed for speed in speeds if not math.isnan(speed)]
        speed = sum(known) / len(known) if known else math.nan
        for name in IMU_CHANNELS:
            self._count(name, get(name, math.nan), speed)
        if math.isnan(speed):
            return
        self.fast_rows += speed > 70.0
        self.fastest_mps = max(self.fastest_mps, *known)
        self._count_wheels(speeds)
        old = self.smoothed.get("speed", speed)
        speed_rate = (speed - old) / _SMOOTHING_S
        self._smooth("speed", speed)
        r, ax, ay = (self._smooth(name, get(name, math.nan)) for name in ("gyro_z", "accel_x", "accel_y"))
        wheels = self._smooth("wheels", (speeds[3] - speeds[2]) / self.car.rear_track_m)
        steer = self._smooth("steer", row.output.road_wheel_angle_rad * speed / self.car.wheelbase_m)
        if speed < 2.0:
            return
        self._relate("accel_x on speeding up", speed_rate, ax)
        self._relate("accel_y on speeding up", speed_rate, ay)
        self._relate("gyro_z on wheels", wheels, r)
        self._relate("gyro_z on steering", steer, r)
        self._relate("accel_y on turning", r * speed, ay)
        self._relate("accel_x on turning", r * speed, ax)

    def _count(self, name: str, value: float, speed: float) -> None:
        if math.isnan(value):
            return
        self.sums.setdefault(name, Relation()).add(0.0, value)
        if not math.isnan(speed) and speed > 1.0:
            moved = self.changes.setdefault(name, 0)
            self.changes[name] = moved + (value != self.last.get(name))
            self.last[name] = value

    def _count_wheels(self, speeds: list[float]) -> None:
        for i, name in enumerate(WHEEL_SPEEDS):
            others = speeds[:i] + speeds[i + 1 :]
            if not math.isnan(speeds[i]) and all(speed > _OTHERS_MPS for speed in others):
                self.others_turn[name] = self.others_turn.get(name, 0) + 1
                self.stands_alone[name] = self.stands_alone.get(name, 0) + (speeds[i] < _STANDS_MPS)

    def _smooth(self, name: str, value: float) -> float:
        if math.isnan(value):
            return math.nan
        old = self.smoothed.get(name, value)
        self.smoothed[name] = relaxed(old, value, _SMOOTHING_S, self.period_s)
        return self.smoothed[name]

    def _relate(self, name: str, x: float, y: float) -> None:
        self.relations.setdefault(name, Relation()).add(x, y)

    def _strong(self, name: str, least_x_std: float) -> Relation | None:
        relation = self.relations.get(name)
        if relation is None or relation.n < _ROWS_NEEDED or relation.x_std < least_x_std:
            return None
        return relation

    def findings(self) -> list[str]:
        """All warnings so far, in words with figures; empty when nothing contradicts physics."""
        said = (
            self._vertical(),
            self._dead(),
            self._dead_wheels(),
            self._refused(),
            self._speed(),
            self._yaw(),
            self._forces(),
        )
        return [words for found in said for words in found]

    def _vertical(self) -> list[str]:
        means = {n: self.sums[n].y / self.sums[n].n for n in ACCEL_CHANNELS if n in self.sums and self.sums[n].n > 50}
        g = STANDARD_GRAVITY_MPS2
        words = []
        for name, mean in means.items():
            if name == "accel_z" and abs(mean - g) > 3.0:
                words.append(
                    f"accel_z reads {mean:.2f} m/s^2 on average where +{g:.2f} is expected: sign, unit or axis"
                )
            elif name != "accel_z" and abs(abs(mean) - g) < 3.0:
                words.append(f"{name} reads {mean:.2f} m/s^2 on average: that is gravity; are the axes swapped?")
        return words

    def _dead(self) -> list[str]:
        return [
            f"{name} never changed while the car moved ({self.last[name]:.4g} throughout): a dead sensor?"
            for name, count in self.changes.items()
            if count <= 1 and self.sums[name].n > _ROWS_NEEDED
        ]

    def _alone(self) -> list[str]:
        """Wheels that stood whenever the other three turned."""
        rows = _ALONE_S / self.period_s
        return [name for name, n in self.stands_alone.items() if n > max(rows, 0.9 * self.others_turn[name])]

    def _dead_wheels(self) -> list[str]:
        words = [f"{name} reads 0 while the other wheels turn: a dead sensor?" for name in self._alone()]
        if "speed" in self.smoothed and self.fastest_mps < _STANDS_MPS:
            moved = [name for name, least in _FELT.items() if self._scatter(name) > least]
            if moved:
                words.append(
                    f"the wheels never turned while {' and '.join(moved)} moved as in a car that drives: dead sensors? "
                    "Offsets are learnt as at a standstill"
                )
        return words

    def _scatter(self, name: str) -> float:
        felt = self.sums.get(name)
        if felt is None or felt.n < _ROWS_NEEDED:
            return 0.0
        return math.sqrt(max(0.0, felt.yy / felt.n - (felt.y / felt.n) ** 2))

    def _refused(self) -> list[str]:
        def words(role: str, why: str) -> str:
            return _REFUSED["frozen wheel" if why == "frozen" and role in WHEEL_SPEEDS else why]

        return [f"{role}: {count} values not used: {words(role, why)}" for (role, why), count in self.refused.items()]

    def _speed(self) -> list[str]:
        words = []
        if self.fast_rows * self.period_s > 1.0:
            words.append(
                f"the wheels say more than 252 km/h for {self.fast_rows * self.period_s:.0f} s: is their unit right?"
            )
        found = self._strong("accel_x on speeding up", 0.3)
        if found is None:
            return words
        if found.correlation < -0.5:
            words.append(
                f"accel_x runs against the wheels' speeding up (slope {found.slope:.2f}): its sign seems reversed"
            )
        elif found.correlation > 0.8 and not _SLOPE_LOW < found.slope < _SLOPE_HIGH:
            words.append(
                f"accel_x is {found.slope:.2f} times the wheels' speeding up: "
                "the unit of wheel speeds or of accel_x seems wrong (km/h as m/s gives 0.28, m/s as km/h 3.6)"
            )
        return words

    def _yaw(self) -> list[str]:
        words = []
        found = self._strong("gyro_z on wheels", 0.04)
        # What one dead wheel says of a turn is half of it.
        if found is not None and not {"wheel_speed_rl", "wheel_speed_rr"} & set(self._alone()):
            if found.correlation < -0.5:
                words.append(
                    f"gyro_z runs against the rear wheels' difference (slope {found.slope:.2f}): "
                    "its sign seems reversed, or left and right are swapped"
                )
            elif found.correlation > 0.8 and not _SLOPE_LOW < found.slope < _SLOPE_HIGH:
                words.append(
                    f"gyro_z is {found.slope:.3g} times the yaw rate of the rear wheels: "
                    "a unit seems wrong (deg/s as rad/s gives 57, the reverse 0.017)"
                )
        steered = self._strong("gyro_z on steering", 0.04)
        if steered is not None and steered.correlation < -0.5:
            words.append(
                f"gyro_z runs against the steering (slope {steered.slope:.2f}): one of the two signs seems reversed"
            )
        elif steered is not None and steered.correlation > 0.8 and not _STEERED_LOW < steered.slope < _SLOPE_HIGH:
            words.append(
                f"gyro_z is {steered.slope:.3g} times the yaw rate that the steering says: a ratio or unit seems wrong "
                "(the hand wheel's angle as the road wheels' gives 0.06, the reverse 16)"
            )
        return words

    def _forces(self) -> list[str]:
        words = []
        found = self._strong("accel_y on turning", 0.4)
        crossed = self._strong("accel_x on turning", 0.4)
        lengthwise = self._strong("accel_y on speeding up", 0.3)
        if (
            crossed is not None
            and lengthwise is not None
            and abs(crossed.correlation) > 0.8
            and abs(lengthwise.correlation) > 0.8
        ):
            return ["accel_x follows the turning and accel_y the speeding up: the two seem swapped"]
        if found is not None and found.correlation < -0.5:
            words.append(
                f"accel_y runs against yaw rate times speed (slope {found.slope:.2f}): "
                "its sign or gyro_z's seems reversed"
            )
        elif found is not None and found.correlation > 0.8 and not _SLOPE_LOW < found.slope < _SLOPE_HIGH:
            words.append(
                f"accel_y is {found.slope:.2f} times yaw rate times speed: a unit seems wrong (g as m/s^2 gives 0.10)"
            )
        return words
