"""Numbers of a diagnosis for people: display units by SI unit, as many digits as the spread leaves. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from dsz_daemon.report.display import DEGREE, DEGREE_PER_SECOND, MINUS, NOTHING, SPEED, Unit
from dsz_daemon.report.results import NAN

_SQUARED = "\N{SUPERSCRIPT TWO}"
_POWERS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_DEG = DEGREE.per_si
_G_MPS2 = 9.80665

# By what stands in the diagnosis; a unit that is not here is shown as it is.
_SHOWN = {
    "rad": DEGREE,
    "rad/s": DEGREE_PER_SECOND,
    "m/s": SPEED,
    "s": Unit("ms", 1e3),
    "rad/s/s": Unit("deg/s per minute", 60.0 * _DEG),
    "m/s2/s": Unit(f"m/s{_SQUARED} per minute", 60.0),
    "rad/s/K": Unit("deg/s per K", _DEG),
    "rad/(m/s2)": Unit("deg per g", _DEG * _G_MPS2),
    "(rad/s)/(m/s2)": Unit("deg/s per g", _DEG * _G_MPS2),
    "rad/N": Unit("deg/kN", 1e3 * _DEG),
    "1/rad": Unit("% per 100 deg", 100.0 * 100.0 / _DEG),
    "N/rad": Unit("kN/rad", 1e-3),
}
_PERCENT = Unit("%", 100.0)
# Pure numbers that are shares of something.
_SHARES = ("gyro_scale", "accel_scale", "gyro_cross_axis", "accel_cross_axis")
# True over configured: 1 where nothing is left out; what is more than that is shown.
_OVER_CONFIGURED = {("wheel_radius", wheel) for wheel in ("fl", "fr", "rl", "rr")} | {
    ("steering_ratio", "scale"),
    ("cornering_stiffness", "front_scale"),
    ("cornering_stiffness", "rear_scale"),
    ("track_width", "front"),
    ("track_width", "rear"),
}


class Shown(NamedTuple):
    """How a parameter is shown: (SI value - `nothing`) * `unit.per_si`."""

    unit: Unit
    nothing: float = 0.0


def shown_as(effect: str, parameter: str, si_unit: str) -> Shown:
    """Unit of a parameter for people.

    >>> shown_as("imu_delay", "delay_s", "s").unit.label, shown_as("wheel_radius", "fl", "1").nothing
    ('ms', 1.0)
    >>> shown_as("configuration", "cg_to_rear_axle_m", "1").unit.label
    '% more than configured'
    """
    if (effect, parameter) in _OVER_CONFIGURED or effect == "configuration":
        return Shown(Unit("% more than configured", 100.0), 1.0)
    if si_unit == "1" and effect in _SHARES:
        return Shown(_PERCENT)
    if parameter in ("start_s", "end_s"):
        return Shown(Unit("s"))
    return Shown(_SHOWN.get(si_unit, Unit(unit_text(si_unit))))


def unit_text(si_unit: str) -> str:
    """An SI unit as it is written: 1 is none, powers stand high.

    >>> unit_text("m/s2"), unit_text("m/s^2"), unit_text("1"), unit_text("(rad/s)/(m2/s4)")
    ('m/s²', 'm/s²', '', '(rad/s)/(m²/s⁴)')
    """
    if si_unit == "1":
        return ""
    return re.sub(r"(?<=[A-Za-z])\^?(\d)", lambda power: power[1].translate(_POWERS), si_unit)


def significant(value: float, digits: int = 3, sign: bool = False) -> str:
    """So many significant digits, with a typographic minus; a dash where there is no value.

    >>> significant(0.0123456), significant(61234.0), significant(2.5e-7), significant(0.0)
    ('0.0123', '61234', '2.50·10⁻⁷', '0')
    """
    if not math.isfinite(value):
        return NOTHING
    if value == 0.0:
        return "0"
    before = MINUS if value < 0.0 else "+" if sign else ""
    size = abs(value)
    mantissa, exponent = f"{size:.{digits - 1}e}".split("e")
    if -5 < int(exponent) < 7:
        return f"{before}{size:.{max(digits - 1 - int(exponent), 0)}f}"
    return f"{before}{mantissa}·10{str(int(exponent)).translate(_POWERS)}"


def to_spread(values: Sequence[float], spread: float) -> list[str]:
    """The values with as many decimals as give the spread two digits; without a spread four digits each.

    >>> to_spread([0.48123, 0.44], 0.0212), to_spread([1234.5], 30.0), to_spread([0.0021], float("nan"))
    (['0.481', '0.440'], ['1234'], ['0.002100'])
    """
    if not (math.isfinite(spread) and spread > 0.0):
        return [significant(value, 4) for value in values]
    decimals = 1 - math.floor(math.log10(spread))
    if decimals > 7:
        # A spread of next to nothing is a bound's, not knowledge.
        return [significant(value, 4) for value in values]
    return [_fixed(value, max(decimals, 0)) for value in values]


def with_interval(value: float, half: float) -> tuple[str, str]:
    """The interval and the value, as people read them; a dash where there is no spread."""
    if not (math.isfinite(half) and half > 0.0):
        return NOTHING, to_spread([value], half)[0]
    low, shown, high = to_spread([value - half, value, value + half], half)
    return f"{low} to {high}", shown


def _fixed(value: float, decimals: int) -> str:
    if not math.isfinite(value):
        return NOTHING
    text = f"{abs(value):.{decimals}f}"
    return MINUS + text if value < 0.0 and float(text) else text


def real(value: Any) -> float:
    """`value` as a number; NaN for anything that is none (missing, null, a text).

    >>> real(1), real("1"), real(None), real(True)
    (1.0, nan, nan, nan)
    """
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else NAN


def told(value: Any) -> str:
    """A text of the diagnosis; "" where there is none."""
    return "" if value is None else str(value)


def entries(value: Any) -> list[Mapping[str, Any]]:
    """The mappings of a list; none where it is missing or something else."""
    return [one for one in value if isinstance(one, Mapping)] if isinstance(value, (list, tuple)) else []


def listed(names: Sequence[str]) -> str:
    """Names in a row, as a sentence has them.

    >>> listed(["a", "b", "c"]), listed([])
    ('a, b and c', '')
    """
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)
