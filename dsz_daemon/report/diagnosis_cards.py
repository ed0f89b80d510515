"""The causes of a diagnosis as cards, and what to drive next. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from dsz_daemon.report.diagnosis_tables import table
from dsz_daemon.report.diagnosis_units import (
    entries,
    listed,
    real,
    shown_as,
    significant,
    to_spread,
    told,
    unit_text,
    with_interval,
)
from dsz_daemon.report.diagnosis_words import CONFIGURED
from dsz_daemon.report.display import NOTHING, PLUS_MINUS, SPREADS_95, percent, words
from dsz_daemon.report.markup import element
from dsz_daemon.report.results import mapping


def cause_card(cause: Mapping[str, Any], number: int) -> Element:
    """One cause: what it is, how large, how sure, what else it could be, what to drive."""
    effect = told(cause.get("effect"))
    parts = [element("h3", f"{number}. {words(effect)} ", element("code", effect))]
    parts += _line("statement", told(cause.get("statement")).replace("m/s2", "m/s²"))
    equation = told(cause.get("equation"))
    if equation:
        source = told(cause.get("source"))
        parts.append(element("p", element("code", equation), f" ({source})" if source else "", class_="equation"))
    rows = [_parameter_row(effect, name, value) for name, value in mapping(cause.get("parameters")).items()]
    if rows:
        parts.append(_parameter_table(rows))
    facts = [element("div", element("dt", name), element("dd", text)) for name, text in _facts(cause) if text]
    if facts:
        parts.append(element("dl", *facts, class_="facts"))
    return element("article", *parts, class_="card")


def _parameter_table(rows: Sequence[Sequence[str]]) -> Element:
    headings = ("parameter", "unit", "value", "95 % interval", "in SI", f"{PLUS_MINUS} 95 %", "SI unit")
    if all(row[4] == NOTHING for row in rows):
        # Only words, as a fault of an axis has them.
        return table(("parameter", "value"), [(row[0], row[2]) for row in rows], 2)
    return table(headings, rows, 2)


def _line(kind: str, text: str) -> list[Element]:
    return [element("p", text, class_=kind)] if text else []


def _parameter_row(effect: str, name: str, entry: Any) -> list[str]:
    """Words, unit, value and interval for people; value, half interval and unit in SI."""
    given = entry if isinstance(entry, Mapping) else {"value": entry}
    value, half = real(given.get("value")), SPREADS_95 * real(given.get("std"))
    si_unit = told(given.get("unit")) or "1"
    if not np.isfinite(value):
        content = given.get("value")
        text = content if isinstance(content, str) and content else NOTHING
        return [_parameter_words(name), "", text, NOTHING, NOTHING, NOTHING, ""]
    unit, nothing = shown_as(effect, name, si_unit)
    interval, shown = with_interval((value - nothing) * unit.per_si, half * unit.per_si)
    in_si = to_spread([value], half)[0]
    si_half = significant(half, 2) if half > 0.0 else NOTHING
    return [_parameter_words(name), unit.label, shown, interval, in_si, si_half, unit_text(si_unit)]


def _parameter_words(name: str) -> str:
    """A parameter's name without its unit: that stands beside it."""
    known = {"rad_per_n": "give per force", "per_rad": "growth with hand wheel angle"}
    if name in known:
        return known[name]
    if name in CONFIGURED:
        return CONFIGURED[name]
    for ending in ("_rad_per_mps2", "_rad_per_n", "_mps2", "_radps", "_rad", "_kg", "_hz", "_m", "_s", "_n"):
        if name.endswith(ending) and name != ending:
            return words(name.removesuffix(ending))
    return words(name)


def _facts(cause: Mapping[str, Any]) -> list[tuple[str, str]]:
    gain, probability = real(cause.get("gain")), real(cause.get("probability"))
    evidence = ""
    if np.isfinite(gain):
        evidence = f"log likelihood of unseen data rises by {significant(gain, 3)}"
    return [
        ("evidence", evidence),
        ("probability", percent(probability) if np.isfinite(probability) else ""),
        ("can't be told apart from", _rivals(cause)),
        ("drive next", told(cause.get("next_manoeuvre"))),
    ]


def _rivals(cause: Mapping[str, Any]) -> str:
    odds = {told(one.get("effect")): real(one.get("probability")) for one in entries(cause.get("alternatives"))}
    alike = cause.get("indistinguishable_from")
    names = [told(name) for name in alike] if isinstance(alike, (list, tuple)) else []
    listing = [
        f"{words(name)} ({percent(odds[name])})" if np.isfinite(odds.get(name, np.nan)) else words(name)
        for name in names
    ]
    unlikely = [
        f"{words(name)} ({percent(share)})" for name, share in odds.items() if name not in names and share > 0.0
    ]
    if listing:
        return listed(listing) + (f"; less likely {listed(unlikely)}" if unlikely else "")
    if isinstance(alike, (list, tuple)):
        return f"nothing{f'; next come {listed(unlikely)}' if unlikely else ' on this recording'}"
    return listed(unlikely)


def manoeuvre_list(manoeuvres: Any) -> Element | None:
    """What to drive next, for the whole diagnosis: texts, or mappings of which all entries are told."""
    if isinstance(manoeuvres, str):
        manoeuvres = [manoeuvres]
    items = [_manoeuvre(one) for one in manoeuvres] if isinstance(manoeuvres, (list, tuple)) else []
    items = [text for text in items if text]
    return element("ul", *(element("li", text) for text in items)) if items else None


def _manoeuvre(one: Any) -> str:
    if not isinstance(one, Mapping):
        return told(one)
    parts = []
    for key, value in one.items():
        if value is None or value in ([], ""):
            continue
        text = listed([words(told(name)) for name in value]) if isinstance(value, (list, tuple)) else told(value)
        parts.append(text if key in ("manoeuvre", "name", "words", "statement") else f"{words(told(key))}: {text}")
    return "; ".join(parts)
