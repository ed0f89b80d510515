"""What pydantic found, in the user's words: which value, and what was expected instead."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import cache
from types import UnionType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from dsz_daemon.config.nearest import did_you_mean
from dsz_daemon.config.sections import unit_in_name

Loc = tuple[str | int, ...]


class _Place(NamedTuple):
    """What the schema has at a location: the declared type, its field, the name that carries the unit."""

    annotation: Any
    field: FieldInfo | None
    name: str


def explained(error: ValidationError, model: type[BaseModel], most: int = 200) -> list[tuple[Loc, str]]:
    """Every fault as (location, text), in the order of the schema; beyond `most`, only how many more."""
    errors = error.errors(include_url=False)
    found = [_explained(details, model) for details in errors[:most]]
    return found if len(errors) <= most else [*found, ((), f"and {len(errors) - most} faults more")]


def _explained(details: ErrorDetails, model: type[BaseModel]) -> tuple[Loc, str]:
    loc = tuple(part for part in details["loc"] if part != "[key]")
    kind, value = details["type"], details["input"]
    if kind == "extra_forbidden":
        return loc, _unknown_key(str(loc[-1]), loc[:-1], model)
    place = _place(model, loc)
    expected = _expectation(place)
    if kind == "missing":
        return loc, f"is missing; expected {expected}"
    if value is None or kind == "too_short":
        return loc, f"is empty; expected {expected}"
    noun = _noun(place, value)
    tail = "" if noun == expected else f"; expected {expected}"
    return loc, f"{_shown(value)} is not {noun}{tail}"


def _unknown_key(key: str, parents: Loc, model: type[BaseModel]) -> str:
    siblings = list(_model_of(_place(model, parents).annotation).model_fields)
    hint = did_you_mean(key[:80], siblings)
    if not hint:
        homes = [section for section in _homes(model).get(key, ()) if section != ".".join(map(str, parents))]
        if homes:
            hint = f"; it belongs in {homes[0]!r}"
        elif len(siblings) <= 12:
            hint = f"; known here: {', '.join(siblings)}"
    return f"unknown key {_shown(key)}{hint}"


@cache
def _homes(model: type[BaseModel]) -> dict[str, list[str]]:
    """Key -> the sections, dotted, that have it; the top level is not one of them."""
    found: dict[str, list[str]] = {}
    for name, field in model.model_fields.items():
        below = _model_of(field.annotation)
        if get_origin(_bare(field.annotation)) is None and below is not _NoModel:
            for key in below.model_fields:
                found.setdefault(key, []).append(name)
            for key, sections in _homes(below).items():
                found.setdefault(key, []).extend(f"{name}.{section}" for section in sections)
    return found


def _place(model: type[BaseModel], loc: Sequence[str | int]) -> _Place:
    """Follow `loc` through the schema."""
    place = _Place(model, None, "")
    for part in loc:
        annotation = _bare(place.annotation)
        fields = _model_of(annotation).model_fields if get_origin(annotation) is None else {}
        if isinstance(part, str) and part in fields:
            field = fields[part]
            name = part if unit_in_name(part)[1] or not unit_in_name(place.name)[1] else place.name
            place = _Place(field.annotation, field, name)
        else:
            inner = [a for a in get_args(annotation) if a is not Ellipsis]
            item = inner[-1] if inner else Any
            place = _Place(item, _item_field(item), place.name)
    return place


def _item_field(annotation: Any) -> FieldInfo | None:
    return FieldInfo.from_annotation(annotation) if annotation is not Any else None


def _bare(annotation: Any) -> Any:
    """Without Annotated and without `| None`."""
    while hasattr(annotation, "__metadata__"):
        annotation = get_args(annotation)[0]
    if get_origin(annotation) in {Union, UnionType}:
        kinds = [a for a in get_args(annotation) if a is not type(None)]
        return _bare(kinds[0]) if len(kinds) == 1 else annotation
    return annotation


class _NoModel(BaseModel):
    """Stands for "not a section"."""


def _model_of(annotation: Any) -> type[BaseModel]:
    bare = _bare(annotation)
    return bare if isinstance(bare, type) and issubclass(bare, BaseModel) else _NoModel


def _noun(place: _Place, value: object) -> str:
    """`a mass`, `a number`, ...: what the value failed to be."""
    kind = _bare(place.annotation)
    number = kind in {int, float}
    if number and (isinstance(value, bool) or not isinstance(value, int | float)):
        return "a number"
    if isinstance(value, float) and not math.isfinite(value):
        return "a finite number"
    if kind is int and isinstance(value, float):
        return "a whole number"
    if kind in {str, bool}:
        return {str: "text", bool: "true or false"}[kind]
    if _model_of(kind) is not _NoModel or get_origin(kind) is dict:
        return "a mapping"
    if get_origin(kind) in {tuple, list}:
        return "a list"
    noun = (place.field.title if place.field else None) or unit_in_name(place.name)[0] or "valid here"
    article = "an" if noun[0] in "aeio" else "a"
    return noun if noun == "valid here" else f"{article} {noun}"


def _expectation(place: _Place) -> str:
    kind = _bare(place.annotation)
    if get_origin(kind) is Literal:
        return _either([str(choice) for choice in get_args(kind)])
    if kind in {int, float}:
        return _range(place)
    model = _model_of(kind)
    if model is not _NoModel:
        required = [name for name, field in model.model_fields.items() if field.is_required()]
        return f"a mapping with {', '.join(required or list(model.model_fields)[:6])}"
    if get_origin(kind) is dict:
        return "a mapping of names"
    if get_origin(kind) in {tuple, list}:
        return "a list with at least one entry" if place.field and place.field.is_required() else "a list"
    if kind is str:
        return (place.field.description if place.field else None) or "text"
    return "true or false" if kind is bool else "text or a number"


def _range(place: _Place) -> str:
    """`100 to 60000 kg`, from the field's bounds and its name."""
    unit = unit_in_name(place.name)[1]
    bounds = {
        key: getattr(constraint, key)
        for constraint in (place.field.metadata if place.field else [])
        for key in ("ge", "gt", "le", "lt")
        if getattr(constraint, key, None) is not None
    }
    low, high = bounds.get("ge", bounds.get("gt")), bounds.get("le", bounds.get("lt"))
    above = "more than " if "gt" in bounds else ""
    if low is not None and high is not None:
        text = f"{above}{_plain(low)} {'and at most' if above else 'to'} {_plain(high)}"
    elif low is not None:
        text = f"{above or 'at least '}{_plain(low)}"
    else:
        text = f"at most {_plain(high)}" if high is not None else "a number"
    return f"{text} {unit}".rstrip()


def _plain(bound: float) -> str:
    """60000, 0.05, 1e6; large whole numbers are ids or masks: hexadecimal."""
    if isinstance(bound, int) and bound > 0xFFF_FFF:
        return f"0x{bound:X}"
    return re.sub(r"e\+?(-?)0", r"e\1", f"{bound:g}")


def _either(choices: list[str]) -> str:
    return choices[0] if len(choices) == 1 else f"{', '.join(choices[:-1])} or {choices[-1]}"


def _shown(value: object) -> str:
    """A value as a message shows it: short."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list | tuple):
        return "a list" if value else "an empty list"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
