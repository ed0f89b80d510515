"""A daemon's answer in words and units for people: deg, deg/s, km/h; shared by status and monitor."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from dsz_daemon.report.display import CHANNEL_WORDS, duration, words

NOTHING = "-"
# The band of a normal distribution that holds 95 %.
SPREADS_95 = 1.96
# Factor, unit and decimals by SI unit.
_SHOWN = {
    "rad/s": (180.0 / math.pi, "deg/s", 3),
    "rad": (180.0 / math.pi, "deg", 2),
    "m/s^2": (1.0, "m/s^2", 3),
    "m/s": (3.6, "km/h", 2),
    "degC": (1.0, "degC", 1),
    "1": (1.0, "", 0),
}
# Colour only underlines what the word says.
STATE_STYLES = {"converged": "green", "learning": "cyan", "holding": "yellow", "invalid": "red"}
PHASE_STYLES = {"running": "bold green", "waiting": "bold yellow", "silent": "bold red"}


class ChannelWords(NamedTuple):
    """One IMU channel as it is shown; `why` says why it is not learning, empty while it is."""

    name: str
    unit: str
    raw: str
    compensated: str
    offset: str
    spread: str
    state: str
    why: str


def shown(value: float | None, si_unit: str, sign: bool = True) -> str:
    """A value in the unit for people.

    >>> shown(0.01, "rad/s"), shown(10.0, "m/s", sign=False), shown(None, "rad")
    ('+0.573', '36.00', '-')
    """
    if value is None:
        return NOTHING
    factor, _, decimals = _SHOWN[si_unit]
    return f"{value * factor:{'+' if sign else ''}.{decimals}f}"


def shown_unit(si_unit: str) -> str:
    """The unit in which `shown` shows."""
    return _SHOWN[si_unit][1]


def channel_words(name: str, channel: dict[str, Any]) -> ChannelWords:
    """One channel of a snapshot in words."""
    unit, std = channel["unit"], channel["offset_std"]
    return ChannelWords(
        name=CHANNEL_WORDS.get(name, name),
        unit=shown_unit(unit),
        raw=shown(channel["raw"], unit),
        compensated=shown(channel["compensated"], unit),
        offset=shown(channel["offset"], unit),
        spread=shown(None if std is None else SPREADS_95 * std, unit, sign=False),
        state=channel["state"],
        why="" if channel["gate"] or channel["reason"] == "none" else words(channel["reason"]),
    )


def ago(age_s: float | None) -> str:
    """An age, coarse.

    >>> ago(0.0042), ago(3.14), ago(4000.0), ago(None)
    ('4 ms', '3.1 s', '1 h 6 min', '-')
    """
    if age_s is None:
        return NOTHING
    return f"{1000.0 * age_s:.0f} ms" if abs(age_s) < 1.0 else duration(age_s)


def microseconds(value_us: float | None) -> str:
    """A short time.

    >>> microseconds(63.1), microseconds(1234.0), microseconds(2.5e6), microseconds(None)
    ('63 us', '1.2 ms', '2.50 s', '-')
    """
    if value_us is None:
        return NOTHING
    if value_us < 1e3:
        return f"{value_us:.0f} us"
    return f"{value_us * 1e-3:.1f} ms" if value_us < 1e6 else f"{value_us * 1e-6:.2f} s"


def motion_words(motion: dict[str, Any]) -> str:
    """How the car moves, on one line."""
    if not motion:
        return "not known"
    if motion["standstill"]:
        return "standstill"
    return (
        f"{shown(motion['speed_mps'], 'm/s', sign=False)} km/h, sideslip {shown(motion['sideslip_rad'], 'rad')} deg, "
        f"roll {shown(motion['roll_rad'], 'rad')} deg, pitch {shown(motion['pitch_rad'], 'rad')} deg"
    )


def lateness_words(answer: dict[str, Any]) -> str:
    """Ticks: how many were missed, how late the others came."""
    late = answer["lateness"]
    times = ", ".join(f"{name} {microseconds(late[f'{name}_us'])}" for name in ("p50", "p99", "max"))
    return f"{answer['missed_ticks']} missed, {answer['timer_overruns']} timer overruns; late by {times}"


def state_file_words(state: dict[str, Any]) -> str:
    """Where the offsets are kept and how that goes."""
    if not state["path"]:
        return "none: offsets are lost when the daemon ends"
    restored = state["restored_age_s"]
    parts = [
        state["problem"],
        "not saved yet" if state["saved_age_s"] is None else f"saved {ago(state['saved_age_s'])} ago",
        "begun with nothing learnt" if restored is None else f"begun with offsets {duration(restored)} old",
        state["path"],
    ]
    return "; ".join(part for part in parts if part)


def uptime_words(answer: dict[str, Any]) -> str:
    """How long it has been running and what it has made of it."""
    row = answer["row"]
    last = "no row yet" if row is None else f"last row {ago(row['age_s'])} ago"
    reloads = f", {answer['reloads']} reloads" if answer["reloads"] else ""
    return f"up {duration(answer['uptime_s'])}, {answer['rows']} rows at {answer['rate_hz']:g} Hz, {last}{reloads}"
