"""What was counted and how old the inputs were: lists and tables of a summary's numbers. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from dsz_daemon.report.display import INTO, NOTHING, words
from dsz_daemon.report.markup import element
from dsz_daemon.report.results import mapping

_COUNTS_SHOWN = 12
_THIN_SPACE = "\N{NARROW NO-BREAK SPACE}"


def counted(counts: Mapping[str, Any], median_age_s: Mapping[str, Any]) -> list[Element]:
    """Nonzero counts one by one, zeros in one line, counts per thing (say, per role) as a table.

    The median ages of the inputs are a column of the table that has their names, or a list.
    """
    tables = {name: mapping(value) for name, value in counts.items() if _is_table(value)}
    parts = _list({name: value for name, value in counts.items() if name not in tables})
    ages = {str(role): age for role, age in median_age_s.items() if _is_number(age)}
    for name, rows in tables.items():
        known = {role: ages.pop(role) for role in list(ages) if role in rows}
        parts.append(element("h3", words(name).capitalize()))
        parts.append(_table(rows, known))
    if ages:
        rows = {role: f"{1e3 * age:.1f} ms" for role, age in ages.items()}
        parts += [element("h3", "Median age of an input when used"), _definitions(rows)]
    return parts


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and bool(np.isfinite(value))


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping) and bool(value) and all(isinstance(v, Mapping) for v in value.values())


def _table(rows: Mapping[str, Mapping[str, Any]], median_age_s: Mapping[str, float]) -> Element:
    names = list(dict.fromkeys(key for row in rows.values() for key in row))
    headings = [*names, *(["median age, ms"] if median_age_s else [])]
    head = element("tr", element("th"), *(element("th", words(name), scope="col") for name in headings))
    body = []
    for role, row in rows.items():
        cells = [_cell(row.get(name)) for name in names]
        if median_age_s:
            age = median_age_s.get(role)
            cells.append(element("td", NOTHING if age is None else f"{1e3 * age:.1f}"))
        body.append(element("tr", element("th", str(role), scope="row"), *cells))
    return element("table", element("thead", head), element("tbody", *body), class_="results inputs")


def _cell(value: Any) -> Element:
    return element("td", _count(value), class_="" if value else "old")


def _list(counts: Mapping[str, Any]) -> list[Element]:
    flat = list(_flat(counts))
    seen = {name: _count(value) for name, value in flat if value}
    zeros = [name for name, value in flat if not value]
    parts = [_definitions(seen)] if seen else []
    return [*parts, element("p", f"None of: {', '.join(zeros)}.", class_="quiet")] if zeros else parts


def _definitions(rows: Mapping[str, str]) -> Element:
    pairs = (element("div", element("dt", name), element("dd", value)) for name, value in rows.items())
    return element("dl", *pairs, class_="counts")


def _count(value: Any) -> str:
    if value is None:
        return NOTHING
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}".replace(",", _THIN_SPACE)
    return str(value)


def _flat(counts: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in _largest(counts).items():
        name = f"{above} {INTO} {words(str(key))}" if above else words(str(key))
        if isinstance(value, Mapping):
            yield from _flat(value, name)
        else:
            yield name, value


def _largest(counts: Mapping[str, Any]) -> Mapping[str, Any]:
    """Shorten a long list of numbers (say, of unknown ids) to its largest and a sum of the others."""
    numbers = {key: value for key, value in counts.items() if _is_number(value)}
    if len(numbers) < len(counts) or len(numbers) <= _COUNTS_SHOWN:
        return counts
    ordered = sorted(numbers.items(), key=lambda item: -item[1])
    rest = ordered[_COUNTS_SHOWN:]
    return dict(ordered[:_COUNTS_SHOWN]) | {f"{len(rest)} others": sum(value for _, value in rest)}
