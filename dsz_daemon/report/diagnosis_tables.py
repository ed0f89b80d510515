"""What a diagnosis says, as tables: parameters, fits, places, what could not be tested. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from dsz_daemon.report.diagnosis_channels import title_of, unit_of
from dsz_daemon.report.diagnosis_units import entries, real, significant, told, unit_text, with_interval
from dsz_daemon.report.diagnosis_words import parameter_words
from dsz_daemon.report.display import ARROW, NOTHING, SPREADS_95, Unit, percent, words
from dsz_daemon.report.markup import element
from dsz_daemon.report.results import mapping

# More than a screen of stretches is folded away.
_PLACES_SHOWN = 10
_TO = "\N{EN DASH}"
_OFFSET_UNITS = {"gyro": "rad/s", "accel": "m/s2"}


def table(headings: Sequence[str], rows: Sequence[Sequence[str | Element]], texts: int = 1) -> Element:
    """A table with its headings; the first `texts` columns are words, the others numbers."""

    def cell(place: int, content: str | Element) -> Element:
        side = {"class_": "text"} if place < texts else {}
        return element("th", content, scope="row", **side) if place == 0 else element("td", content, **side)

    head = [
        element("th", name, scope="col", **({"class_": "text"} if i < texts else {})) for i, name in enumerate(headings)
    ]
    body = [element("tr", *(cell(place, content) for place, content in enumerate(row))) for row in rows]
    return element("table", element("thead", element("tr", *head)), element("tbody", *body), class_="results said")


# By how a configured parameter's name ends.
_CONFIGURED_IN = {
    "_n_per_rad": Unit("kN/rad", 1e-3),
    "_kg": Unit("kg"),
    "_kgm2": Unit("kg m2"),
    "_m": Unit("m"),
}


def error_table(errors: Sequence[Mapping[str, Any]]) -> Element:
    """Configured parameters that fit better with another value."""
    rows = []
    for error in errors:
        name = told(error.get("parameter"))
        unit = next((unit for end, unit in _CONFIGURED_IN.items() if name.endswith(end)), Unit(""))
        configured, fitted, std = (real(error.get(key)) for key in ("configured", "fitted", "std"))
        interval, shown = with_interval(fitted * unit.per_si, SPREADS_95 * std * unit.per_si)
        change = 100.0 * (fitted / configured - 1.0) if configured else np.nan
        less = f"{significant(change, 2, sign=True)} %" if np.isfinite(change) else NOTHING
        rows.append([parameter_words(name), unit.label, significant(configured * unit.per_si), shown, interval, less])
    return table(("parameter", "unit", "configured", "fits best at", "95 % interval", "change"), rows, 2)


def unlisted_table(shapes: Sequence[Mapping[str, Any]], result: Mapping[str, Any]) -> Element:
    """Shapes of the residual for which there is no name."""
    rows: list[list[str | Element]] = []
    for shape in shapes:
        k = mapping(shape.get("coefficient"))
        interval, value = with_interval(real(k.get("value")), SPREADS_95 * real(k.get("std")))
        channel = title_of(told(shape.get("channel")), result)
        formula = element("code", told(shape.get("shape")))
        rows.append([channel, formula, value, interval, unit_text(told(k.get("unit")))])
    return table(("channel", "shape", "k", "95 % interval", "SI unit"), rows, 2)


def fit_table(result: Mapping[str, Any], is_changed: bool) -> Element | None:
    """RMS of each channel, before and after, on data of the fit and unseen; None without any channel.

    Without `is_changed` there is one simulation only, the nominal one.
    """
    fits = {name: mapping(fit) for name, fit in mapping(result.get("fit")).items()}
    if not fits:
        return None
    has_bound = any(np.isfinite(real(fit.get("flexible"))) for fit in fits.values())
    rows: list[list[str | Element]] = []
    for name, fit in fits.items():
        unit = unit_of(name, result)
        sides = [_change(mapping(fit.get(side)), unit, is_changed) for side in ("train", "held_out")]
        limits = [real(fit.get(key)) * unit.per_si for key in ("noise_floor", "flexible")[: 1 + has_bound]]
        level = real(mapping(result.get("level")).get(name))
        rows.append(
            [
                title_of(name, result),
                unit.label,
                *sides,
                *(significant(limit) for limit in limits),
                significant(level, 2) if np.isfinite(level) else NOTHING,
            ]
        )
    bound = ["without names"] if has_bound else []
    change = f", before {ARROW} after" if is_changed else ""
    headings = ["rms", "unit", f"seen{change}", f"unseen{change}", "noise floor", *bound, "times expected"]
    return table(headings, rows, 2)


def _change(side: Mapping[str, Any], unit: Unit, is_changed: bool) -> str | Element:
    before, after = (real(side.get(when)) * unit.per_si for when in ("before", "after"))
    if not is_changed:
        return significant(before)
    old = element("span", significant(before), class_="old")
    return element("span", old, f" {ARROW} {significant(after)}")


def located_tables(result: Mapping[str, Any]) -> list[Element]:
    """Where recording and simulation part, the largest share first; what is more than a screen is folded away."""
    places = sorted(entries(result.get("located")), key=lambda place: -np.nan_to_num(real(place.get("share"))))
    if not places:
        return []
    headings = ("channel", "from, s", "to, s", "share of its excess", "speed, km/h", "lateral acceleration, m/s²")
    rows = [_place_row(place, result) for place in places]
    parts = [table(headings, rows[:_PLACES_SHOWN])]
    if rows[_PLACES_SHOWN:]:
        more = element("summary", f"{len(rows) - _PLACES_SHOWN} more")
        parts.append(element("details", more, table(headings, rows[_PLACES_SHOWN:]), class_="more"))
    return parts


def _place_row(place: Mapping[str, Any], result: Mapping[str, Any]) -> list[str]:
    region = mapping(place.get("region"))
    times = [
        f"{real(place.get(key)):.0f}" if np.isfinite(real(place.get(key))) else NOTHING for key in ("start_s", "end_s")
    ]
    return [
        title_of(told(place.get("channel")), result),
        *times,
        percent(real(place.get("share"))),
        _range(region.get("speed_mps"), 3.6, 0),
        _range(region.get("abs_ay_mps2"), 1.0, 1),
    ]


def _range(ends: Any, per_si: float, decimals: int) -> str:
    values = [real(end) * per_si for end in ends] if isinstance(ends, (list, tuple)) else []
    if len(values) != 2 or not np.all(np.isfinite(values)):
        return NOTHING
    return f"{values[0]:.{decimals}f} {_TO} {values[1]:.{decimals}f}"


def untested_table(untested: Sequence[Mapping[str, Any]]) -> Element:
    """Effects that this drive could not have shown, and why."""
    rows = [[words(told(one.get("effect"))), told(one.get("why")) or NOTHING] for one in untested]
    return table(("effect", "why"), rows, 2)


def offset_table(result: Mapping[str, Any]) -> Element | None:
    """What was refitted before any cause was thought of; None without any."""
    rows: list[list[str]] = []
    for name, entry in mapping(result.get("offsets")).items():
        if name.startswith("offset_"):
            channel = name.removeprefix("offset_")
            unit = unit_of(channel, result)
            rows.append(_offset_row(f"offset of {title_of(channel, result)}", mapping(entry), unit))
        else:
            rows.append(_offset_row(f"{words(name)}, change", mapping(entry), Unit("%", 100.0)))
    return table(("refitted first", "unit", "value", "95 % interval"), rows, 2) if rows else None


def _offset_row(name: str, entry: Mapping[str, Any], unit: Unit) -> list[str]:
    half = SPREADS_95 * real(entry.get("std")) * unit.per_si
    interval, value = with_interval(real(entry.get("value")) * unit.per_si, half)
    return [name, unit.label, value, interval]
