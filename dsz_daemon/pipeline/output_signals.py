"""What each signal of dbc/dsz.dbc says of a row, in SI; NaN where it can't be given."""

from __future__ import annotations

import math
from collections.abc import Callable

from dsz_daemon.pipeline.rows import Row
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

# The paper's letters for the six channels, in the order of `signals.IMU_CHANNELS`.
AXES = ("P", "Q", "R", "AX", "AY", "AZ")

# Roles whose ages make up one published age.
_AGE_GROUPS = {
    "AGE_IMU": IMU_CHANNELS,
    "AGE_WHEELS": WHEEL_SPEEDS,
    "AGE_STEERING": ("steering_wheel_angle", "road_wheel_angle"),
}

# SI -> the unit that the DBC names.
UNIT_FACTORS = {
    "deg/s": math.degrees(1.0),
    "deg": math.degrees(1.0),
    "m/s^2": 1.0,
    "km/h": 3.6,
    "ms": 1000.0,
    "": 1.0,
}


def _axis_signals(index: int, axis: str) -> dict[str, Callable[[Row], float]]:
    return {
        axis: lambda row: row.output.channels[index].compensated,
        f"{axis}_OFFSET": lambda row: row.output.channels[index].offset,
        f"{axis}_STD": lambda row: row.output.channels[index].offset_std,
        f"STATE_{axis}": lambda row: row.output.channels[index].state,
        f"GATE_{axis}": lambda row: row.output.channels[index].gate,
        f"REASON_{axis}": lambda row: row.output.channels[index].reason,
    }


def _oldest(roles: tuple[str, ...]) -> Callable[[Row], float]:
    """Age of the oldest of `roles` that have been seen; NaN before any has."""

    def age_s(row: Row) -> float:
        return max((row.ages_s[role] for role in roles if role in row.ages_s), default=math.nan)

    return age_s


def _signals() -> dict[str, Callable[[Row], float]]:
    signals: dict[str, Callable[[Row], float]] = {
        "STANDSTILL": lambda row: row.output.standstill,
        "SPEED": lambda row: row.output.speed_mps,
        "SIDESLIP": lambda row: row.output.sideslip_rad,
        "ROAD_WHEEL_ANGLE": lambda row: row.output.road_wheel_angle_rad,
        "FRAMES": lambda row: row.counters.frames,
        "REJECTED": lambda row: row.counters.rejected,
        "MISSED_TICKS": lambda row: row.counters.missed_ticks,
        "GAPS": lambda row: row.counters.gaps,
        "CLOCK_STEPS": lambda row: row.counters.clock_steps,
    }
    for index, axis in enumerate(AXES):
        signals |= _axis_signals(index, axis)
    return signals | {name: _oldest(roles) for name, roles in _AGE_GROUPS.items()}


SIGNALS: dict[str, Callable[[Row], float]] = _signals()
