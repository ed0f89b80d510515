"""How people and DBC files spell units."""

from __future__ import annotations

# Canonical spelling (that of dsz_daemon.signals) -> other spellings, in lower case without spaces.
_SPELLINGS: dict[str, tuple[str, ...]] = {
    "deg/s": ("deg/s", "degree/s", "degrees/s", "deg/sec", "degree/sec", "degrees/sec", "degrees/second",
              "°/s", "°/sec", "dps", "degps", "deg/second", "deg_per_s", "grad/s"),
    "rad/s": ("rad/s", "rad/sec", "radian/s", "radians/s", "radians/sec", "radians/second", "radps", "rad/second"),
    "m/s^2": ("m/s^2", "m/s2", "m/s²", "m/s/s", "m/ss", "m/s**2", "m/sec^2", "m/sec2", "m/sec²", "mps2",
              "meter/s^2", "meters/s^2", "metres/s^2", "m/(s^2)", "m*s^-2", "ms-2"),
    "g": ("g", "gs", "g's", "g_n", "gravity"),
    "rad": ("rad", "radian", "radians"),
    "deg": ("deg", "degree", "degrees", "°", "grad", "degs"),
    "m/s": ("m/s", "m/sec", "mps", "meter/s", "meters/s", "meter/sec", "meters/sec"),
    "km/h": ("km/h", "kph", "kmh", "km/hr", "kmph", "km/hour", "kmh-1", "kilometerperhour"),
    "mph": ("mph", "mi/h", "miles/h", "mile/h", "miles/hour"),
    "rpm": ("rpm", "1/min", "/min", "min-1", "r/min", "rev/min", "u/min", "revolution/min", "revs/min"),
    "degC": ("degc", "°c", "c", "celsius", "degreec", "degreesc", "degreecelsius", "degreescelsius", "deg.c"),
    "V": ("v", "volt", "volts"),
    "mV": ("mv", "millivolt", "millivolts"),
    "counts": ("count", "counts", "lsb", "adc"),
}  # fmt: skip
_CANONICAL = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}


def canonical_unit(spelling: str | None) -> str | None:
    """Our spelling of a unit; None for an empty or unknown one, which can't be compared.

    >>> canonical_unit("degrees/sec"), canonical_unit("KPH"), canonical_unit("Deg"), canonical_unit("SED")
    ('deg/s', 'km/h', 'deg', None)
    """
    return _CANONICAL.get((spelling or "").lower().replace(" ", ""))
