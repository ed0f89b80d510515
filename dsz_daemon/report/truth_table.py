"""What was true in a simulated drive, in plain units: effects, the sensors' errors, the car. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from dsz_daemon.report.display import MINUS, NOTHING, Unit, words
from dsz_daemon.report.markup import element
from dsz_daemon.report.results import mapping
from dsz_daemon.sim.car import Car
from dsz_daemon.sim.effects import EFFECTS
from dsz_daemon.sim.sensors import SensorErrors

_DEG = 180.0 / np.pi
_AXES = ("x", "y", "z")

# By the end of a name; the first that fits.
_UNITS = {
    "_radps_per_s": Unit("deg/s per minute", 60.0 * _DEG),
    "_mps2_per_s": Unit("m/s\N{SUPERSCRIPT TWO} per minute", 60.0),
    "_radps_per_k": Unit("deg/s per K", _DEG),
    "_mps2_per_k": Unit("m/s\N{SUPERSCRIPT TWO} per K"),
    "_nm_per_rad": Unit("Nm/rad"),
    "_ns_per_m": Unit("N s/m"),
    "_rad_per_n": Unit("deg/kN", 1e3 * _DEG),
    "_n_per_rad": Unit("N/rad"),
    "_n_per_m": Unit("N/m"),
    "_per_rad": Unit("1/rad"),
    "_radps": Unit("deg/s", _DEG),
    "_mps2": Unit("m/s\N{SUPERSCRIPT TWO}"),
    "_kgm2": Unit("kg m\N{SUPERSCRIPT TWO}"),
    "_rad": Unit("deg", _DEG),
    "_deg": Unit("deg"),
    "_ppm": Unit("ppm"),
    "_kg": Unit("kg"),
    "_hz": Unit("Hz"),
    "_m2": Unit("m\N{SUPERSCRIPT TWO}"),
    "_m": Unit("m"),
    "_n": Unit("N"),
    "_s": Unit("s"),
    "_c": Unit("\N{DEGREE SIGN}C"),
}
# Whole names that carry no unit in them.
_SHARES = Unit("%", 100.0)
_NAMED_UNITS = {
    "gyro_scale": _SHARES,
    "accel_scale": _SHARES,
    "gyro_cross_axis": _SHARES,
    "accel_cross_axis": _SHARES,
    "gyro_nonlinearity": Unit("% of full scale", 100.0),
    "accel_nonlinearity": Unit("% of full scale", 100.0),
    "gyro_g_sensitivity": Unit("deg/s per m/s\N{SUPERSCRIPT TWO}", _DEG),
}
# Names that lose too much without their unit, or say little with it.
_WORDS = {
    "gyro_drift_radps_per_s": "gyro drift over time",
    "gyro_drift_radps_per_k": "gyro drift with temperature",
    "accel_drift_mps2_per_s": "accel drift over time",
    "accel_drift_mps2_per_k": "accel drift with temperature",
    "noisy": "noise of the data sheets",
    "friction": "friction of its tyres on a dry road",
}
_BARE = Unit("")


class _Row(NamedTuple):
    """One error of a triad: what it is, three numbers, their unit."""

    what: str
    values: tuple[float | None, float | None, float | None]
    unit: str


def truth_tables(parameters: Mapping[str, Any]) -> list[Element]:
    """Build what `SimulatedDrive.parameters` says: effects, errors of the sensors that there are, the whole car."""
    return [
        *_effects(parameters),
        *_sensors(mapping(parameters.get("sensors"))),
        *_car(mapping(parameters.get("car"))),
    ]


def named_unit(name: str) -> tuple[str, Unit]:
    """A field's name as words without its unit, and the unit it is shown in.

    >>> named_unit("gyro_offset_radps")[0], named_unit("mass_kg")[1].label, named_unit("friction")[1].label
    ('gyro offset', 'kg', '')
    """
    if name in _NAMED_UNITS:
        return words(name), _NAMED_UNITS[name]
    for ending, unit in _UNITS.items():
        if name.endswith(ending):
            return _WORDS.get(name, words(name.removesuffix(ending))), unit
    return _WORDS.get(name, words(name)), _BARE


def _shown(value: Any, unit: Unit) -> str:
    """One value in its unit; four figures, no zeros at the end.

    >>> _shown(0.5, Unit("deg", 2.0)), _shown(-1673.0, _BARE) == MINUS + "1673", _shown(True, _BARE)
    ('1', True, 'yes')
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        number = unit.per_si * value
        text = f"{abs(number):.0f}" if abs(number) >= 1000.0 else f"{abs(number):.4g}"
        return MINUS + text if number < 0.0 and float(text) != 0.0 else text
    if isinstance(value, (tuple, list)):
        return " / ".join(_shown(part, unit) for part in value)
    return NOTHING if value is None else str(value)


def _effects(parameters: Mapping[str, Any]) -> Iterator[Element]:
    if parameters.get("nominal"):
        yield element("p", "Driven by the nominal car: all that the nominal simulation leaves out is left out.")
    chosen = parameters.get("effects") or []
    if not chosen:
        return
    yield element("h2", "Effects put in")
    items = []
    for effect in chosen:
        name = str(effect["effect"])
        known = EFFECTS.get(name)
        values = ", ".join(f"{key} = {_shown(value, _BARE)}" for key, value in effect["parameters"].items())
        told = f": {known.statement}" if known else ""
        items.append(element("li", element("code", name), f"{told} ({values})" if values else told))
    yield element("ul", *items)


def _sensors(sensors: Mapping[str, Any]) -> Iterator[Element]:
    """The errors that there are, and the names of those that there are not."""
    if not sensors:
        return
    none = asdict(SensorErrors())
    rows: list[_Row] = []
    rest: dict[str, str] = {}
    off: list[str] = []
    for name, value in sensors.items():
        what, unit = named_unit(name)
        if name in none and value == none[name]:
            off.append(what)
        elif name == "pole_ring":
            rest[what] = _ring(value)
        else:
            found = list(_vectors(what, value, unit))
            rows += found
            if not found:
                rest |= dict(_scalars(name, value))
    yield element("h2", "What was wrong with the sensors")
    if rows:
        yield _vector_table(rows)
    if rest:
        yield _definitions(rest)
    yield element("p", f"As meant or nominal: {', '.join(off)}.", class_="quiet")


def _vectors(what: str, value: Any, unit: Unit) -> Iterator[_Row]:
    """Rows of three numbers, where `value` is three numbers, three times three, or leaks between axes."""

    def three(numbers: Sequence[float | None]) -> tuple[float | None, float | None, float | None]:
        x, y, z = (None if n is None else unit.per_si * n for n in numbers)
        return x, y, z

    fields = getattr(value, "_fields", ())
    if fields and set(fields) == {a + b for a in _AXES for b in _AXES if a != b}:
        for into in _AXES:
            yield _Row(f"{what}, into {into}", three([getattr(value, into + of, None) for of in _AXES]), unit.label)
    elif not fields and isinstance(value, (tuple, list)) and len(value) == 3:
        if all(isinstance(part, (tuple, list)) and len(part) == 3 for part in value):
            for into, part in zip(_AXES, value, strict=True):
                yield _Row(f"{what}, into {into}", three(part), unit.label)
        elif all(isinstance(part, (int, float)) for part in value):
            yield _Row(what, three(value), unit.label)


def _scalars(name: str, value: Any) -> Iterator[tuple[str, str]]:
    """Single values, those inside of records by themselves."""
    fields = getattr(value, "_fields", ())
    for field in fields:
        yield from _scalars(f"{name}_{field}", getattr(value, field))
    if not fields:
        what, unit = named_unit(name)
        yield what, f"{_shown(value, unit)} {unit.label}".strip()


def _ring(ring: Any) -> str:
    edges = [edge for wheel in ring.off_pitches for edge in wheel]
    if not edges:
        return f"{ring.poles} poles"
    return f"{ring.poles} poles, off by {100.0 * float(np.sqrt(np.mean(np.square(edges)))):.1f} % of a pitch (RMS)"


def _vector_table(rows: Sequence[_Row]) -> Element:
    head = element("tr", *(element("th", heading, scope="col") for heading in ("", *_AXES, "")))
    body = [
        element(
            "tr",
            element("th", row.what, scope="row"),
            *(element("td", NOTHING if v is None else _shown(v, _BARE)) for v in row.values),
            element("td", row.unit, class_="unit-name"),
        )
        for row in rows
    ]
    return element("table", element("thead", head), element("tbody", *body), class_="results inputs")


def _car(car: Mapping[str, Any]) -> Iterator[Element]:
    """Every number of the car; those that the effects changed say what they are in the catalogue's."""
    if not car:
        return
    usual = asdict(Car())
    rows = {}
    for name, value in car.items():
        what, unit = named_unit(name)
        changed = name in usual and usual[name] != (tuple(value) if isinstance(value, list) else value)
        instead = f", else {_shown(usual[name], unit)}" if changed else ""
        rows[what] = f"{_shown(value, unit)} {unit.label}".strip() + instead
    yield element("h2", "The car")
    yield _definitions(rows)


def _definitions(rows: Mapping[str, str]) -> Element:
    pairs = [element("div", element("dt", what), element("dd", value)) for what, value in rows.items()]
    return element("dl", *pairs, class_="counts")
