"""How fast can whoever controls an input signal move a converged offset? Measured, not derived.

A synthetic car drives until its offsets are learnt, then one signal is falsified, as cleverly as the range
and the gates allow: its reading is shifted so that the estimator goes on believing it. Only published offsets
are looked at, and no formula of the estimator is used. `python tests/fuzz/poisoning.py` prints the table;
`--quick` drives less.
"""

from __future__ import annotations

import argparse
import copy
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
for folder in (HERE, HERE.parents[1]):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

from synthetic_car import SyntheticCar, gentle_drive  # noqa: E402

from dsz_daemon.runs.setup import Setup, set_up  # noqa: E402
from dsz_daemon.signals import IMU_CHANNELS  # noqa: E402

CONFIG = HERE.parents[1] / "config" / "example.yaml"
_START_NS = 1_700_000_000_000_000_000
_DEG = math.pi / 180.0
_PERIOD_NS = 10_000_000
Falsified = Callable[[float, dict[str, float]], dict[str, float]]


class Attack(NamedTuple):
    """What is falsified: (seconds since the attack began, true values) to values; what it aims at and how."""

    channel: str
    meaning: str
    change: Falsified


class Measured(NamedTuple):
    """What an attack did to its channel's offset: in its first minute, over all, and the steepest minute."""

    attack: Attack
    first_minute: float
    total: float
    steepest_minute: float
    spread: float


def _shifted(role: str, by: float) -> Falsified:
    return lambda _t, values: {**values, role: values[role] + by}


def _ramped(role: str, per_s: float, most: float) -> Falsified:
    return lambda t, values: {**values, role: values[role] + math.copysign(min(abs(per_s) * t, most), per_s)}


def _standing(role: str, by: float) -> Falsified:
    """The wheels are said to stand still, so that a standstill's certainty counts for the reading."""

    def change(t: float, values: dict[str, float]) -> dict[str, float]:
        wheels = {name: 0.0 for name in values if name.startswith("wheel_speed")}
        return {**values, **wheels, role: values[role] + (by if t > 3.0 else 0.0)}

    return change


ATTACKS = (
    Attack("gyro_z", "yaw rate + 5 deg/s at once", _shifted("gyro_z", 5.0 * _DEG)),
    Attack("gyro_z", "yaw rate + 28 deg/s at once", _shifted("gyro_z", 28.0 * _DEG)),
    Attack("gyro_z", "yaw rate ramped by 1 deg/s a second to + 28", _ramped("gyro_z", _DEG, 28.0 * _DEG)),
    Attack("gyro_z", "wheels at 0 and yaw rate + 28 deg/s", _standing("gyro_z", 28.0 * _DEG)),
    Attack("gyro_x", "roll rate + 28 deg/s at once", _shifted("gyro_x", 28.0 * _DEG)),
    Attack("gyro_x", "wheels at 0 and roll rate + 28 deg/s", _standing("gyro_x", 28.0 * _DEG)),
    Attack("accel_x", "accel x + 5.5 m/s2 at once", _shifted("accel_x", 5.5)),
    Attack("accel_x", "accel x ramped by 0.1 m/s2 a second to + 5.5", _ramped("accel_x", 0.1, 5.5)),
    Attack("accel_y", "accel y + 5.5 m/s2 at once", _shifted("accel_y", 5.5)),
    Attack("accel_y", "accel y ramped by 0.1 m/s2 a second to + 5.5", _ramped("accel_y", 0.1, 5.5)),
    Attack("accel_y", "steering angle + 12 deg at the hand wheel", _shifted("steering_wheel_angle", 12.0 * _DEG)),
    Attack("accel_z", "accel z + 5.5 m/s2 at once", _shifted("accel_z", 5.5)),
)


class _Drive:
    """A daemon's loop behind a synthetic car."""

    def __init__(self, setup: Setup) -> None:
        self.car = SyntheticCar(setup)
        self.loop = setup.loop(setup.decoder(setup.encoder()))
        self.tick = 0

    def copy(self) -> _Drive:
        """Another one that goes on from here; decoder's counts, which nothing here reads, are shared."""
        other = copy.copy(self)
        other.loop = copy.copy(self.loop)
        other.loop.memory = copy.deepcopy(self.loop.memory)
        return other

    def drive(self, duration_s: float, change: Falsified | None = None) -> list[tuple[float, ...]]:
        """The six published offsets at every tick."""
        offsets: list[tuple[float, ...]] = []
        for k in range(round(duration_s * 100)):
            t_s = 0.01 * self.tick
            values = gentle_drive(t_s)
            if change is not None:
                values = change(0.01 * k, values)
            for frame in self.car.frames(_START_NS + self.tick * _PERIOD_NS, values):
                rows = self.loop.frame(frame)
                offsets += [tuple(channel.offset for channel in row.output.channels) for row in rows]
            self.tick += 1
        return offsets


def measured(setup: Setup, learnt_s: float, attacked_s: float, attacks: Sequence[Attack] = ATTACKS) -> list[Measured]:
    """Every attack after `learnt_s` of honest driving, each from the same state."""
    drive = _Drive(setup)
    before = drive.drive(learnt_s)[-1]
    spreads = [channel.offset_std for channel in drive.loop.memory.output.channels] if drive.loop.memory.output else []
    results = []
    for attack in attacks:
        i = IMU_CHANNELS.index(attack.channel)
        moved = [row[i] - before[i] for row in drive.copy().drive(attacked_s, attack.change)]
        minute = min(6000, len(moved) - 1)
        steepest = max(abs(moved[k + minute] - moved[k]) for k in range(0, len(moved) - minute, 100))
        first = max(abs(x) for x in moved[: minute + 1])
        results.append(Measured(attack, first, max(map(abs, moved)), steepest, spreads[i]))
    return results


def table(results: Sequence[Measured], learnt_s: float, attacked_s: float) -> str:
    """The results as Markdown."""
    lines = [
        f"After {learnt_s:.0f} s of honest driving at 72 km/h, {attacked_s:.0f} s of attack (`config/example.yaml`):",
        "",
        "| falsified | offset of | unit | spread before | moved in 1st minute | in the steepest minute | in all |",
        "|---|---|---|---|---|---|---|",
    ]
    for m in results:
        unit, scale = ("deg/s", 1.0 / _DEG) if m.attack.channel.startswith("gyro") else ("m/s2", 1.0)
        numbers = " | ".join(f"{x * scale:.3f}" for x in (m.spread, m.first_minute, m.steepest_minute, m.total))
        lines.append(f"| {m.attack.meaning} | {m.attack.channel} | {unit} | {numbers} |")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description="How fast a falsified input moves a learnt offset.")
    parser.add_argument("--quick", action="store_true", help="2 min of honest driving and 1 min of attack")
    parser.add_argument("--learn", type=float, default=600.0, metavar="S")
    parser.add_argument("--attack", type=float, default=180.0, metavar="S")
    arguments = parser.parse_args(argv)
    learnt_s, attacked_s = (120.0, 60.0) if arguments.quick else (arguments.learn, arguments.attack)
    print(table(measured(set_up(CONFIG), learnt_s, attacked_s), learnt_s, attacked_s))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
