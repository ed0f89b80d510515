"""A YAML file as plain data, with the line of every key.

Plain YAML 1.2 (core schema): `yes`, `on` and `012` are text, text and twelve, and `1e-3` is a
number. Only mappings, lists, text, numbers, true/false and null can come out, whatever the
file says; nothing is ever constructed from a tag.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from dsz_daemon.config.nearest import did_you_mean
from dsz_daemon.errors import ConfigError, Fault

Loc = tuple[str | int, ...]

# The largest sensible configuration is a few kB; a recording given by mistake is many MB.
_MOST_BYTES = 1_000_000
# It has a few hundred values. Aliases of aliases of aliases unfold to millions, which every check
# after this one would have to go through.
_MOST_VALUES = 100_000
# No number that anybody means is longer, and Python refuses to write out much longer ones.
_LONGEST_WHOLE = 1000
_PREFIX = "tag:yaml.org,2002:"


class _CoreLoader(yaml.SafeLoader):
    """Composes nodes by the YAML 1.2 core schema instead of PyYAML's 1.1."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - PyYAML's own attribute, replaced as a whole


def _resolve(kind: str, pattern: str, first: Iterable[str]) -> None:
    _CoreLoader.add_implicit_resolver(_PREFIX + kind, re.compile(pattern), list(first))


_resolve("bool", r"^(?:true|True|TRUE|false|False|FALSE)$", "tTfF")
_resolve("null", r"^(?:~|null|Null|NULL|)$", ["~", "n", "N", ""])
_resolve("int", r"^(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)$", "-+0123456789")
_resolve("float", r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?$", "-+.0123456789")
_resolve("float", r"^(?:[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$", "-+.")
_resolve("merge", r"^<<$", "<")


@dataclass(frozen=True)
class Document:
    """A read file: its data, where its keys stand, and what was wrong already on reading."""

    path: Path
    root: yaml.Node
    data: dict[str, Any]
    faults: tuple[Fault, ...]

    def where(self, loc: Sequence[str | int]) -> str:
        """`config.yaml:12: vehicle.mass_kg`; the nearest line above for a key that isn't there."""
        dotted = dotted_name(loc)
        place = f"{self.path.name}:{self._line(loc)}"
        return f"{place}: {dotted}" if dotted else place

    def _line(self, loc: Sequence[str | int]) -> int:
        node, mark = self.root, self.root.start_mark
        for part in loc:
            if isinstance(node, yaml.MappingNode):
                entry = next((e for e in node.value if e[0].value == part), None)
                if entry is None:
                    break
                mark, node = entry[0].start_mark, entry[1]
            elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
                node = node.value[part]
                mark = node.start_mark
            else:
                break
        return int(mark.line) + 1


def dotted_name(loc: Sequence[str | int]) -> str:
    """`vehicle.mass_kg`; a key of any length and a nesting of any depth give a line that one can read."""
    parts = [text if len(text) <= 60 else f"{text[:57]}..." for text in map(str, loc)]
    return ".".join([*parts[:8], "..."] if len(parts) > 9 else parts)


def read_document(path: Path) -> Document:
    """The file's data. ConfigError where there is none: no file, no text, no YAML, no mapping."""
    text = _text(path)
    try:
        root = yaml.compose(text, Loader=_CoreLoader)
    except yaml.MarkedYAMLError as error:
        raise _refused(path, _syntax(error), error.problem_mark or error.context_mark) from None
    except yaml.YAMLError as error:
        raise _refused(path, " ".join(str(error).split())) from None
    except RecursionError:
        raise _refused(path, "nested too deeply to be a configuration") from None
    if root is None or root.tag == _PREFIX + "null":
        raise _refused(path, "is empty; expected the sections vehicle and signals")
    if not isinstance(root, yaml.MappingNode):
        kind = "a list" if isinstance(root, yaml.SequenceNode) else f"the text {root.value[:40]!r}"
        raise _refused(path, f"holds {kind}; expected the sections vehicle and signals")
    reader = _Reader(path)
    data = reader.value(root, ())
    return Document(path, root, data, tuple(reader.faults))


def _text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if path.is_dir():
            raise _refused(path, "is a folder; expected a YAML file")
        if size > _MOST_BYTES:
            raise _refused(path, f"has {size / 1e6:.0f} MB; a configuration is a small YAML file")
        with path.open("rb") as file:
            raw = file.read(_MOST_BYTES + 1)
    except FileNotFoundError:
        names = [p.name for p in path.parent.glob("*.y*ml")] if path.parent.is_dir() else []
        raise _refused(path, "no such file" + did_you_mean(path.name, names)) from None
    except OSError as error:
        raise _refused(path, f"can't be read: {error.strerror}") from None
    if len(raw) > _MOST_BYTES:  # a pipe or a device tells no size
        raise _refused(path, f"has more than {_MOST_BYTES / 1e6:.0f} MB; a configuration is a small YAML file")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        bad = raw[error.start]
        raise _refused(path, f"is not UTF-8 text (byte 0x{bad:02x} at offset {error.start})") from None


def _syntax(error: yaml.MarkedYAMLError) -> str:
    problem = error.problem or "not YAML"
    if "\\t" in problem:
        problem += "; YAML is indented with spaces, not tabs"
    context = f" ({error.context})" if error.context else ""
    return f"not valid YAML: {problem}{context}"


def _refused(path: Path, what: str, mark: Any = None) -> ConfigError:
    place = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else f"{path}"
    return ConfigError(f"{place}: {what}")


class _Reader:
    """Nodes to plain data; collects duplicate keys, foreign tags and odd keys on the way."""

    def __init__(self, path: Path) -> None:
        self.faults: list[Fault] = []
        self._path = path
        self._open: set[int] = set()
        # An anchor's data is made once, however often its alias stands; counted it is every time.
        self._done: dict[int, tuple[Any, int]] = {}
        self._values = 0

    def value(self, node: yaml.Node, loc: Loc) -> Any:
        """The node's data; a fault and None where it has none."""
        self._count(1)
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node, loc)
        if node.tag not in {_PREFIX + "map", _PREFIX + "seq"}:
            self._fault(node, loc, f"has the tag {node.tag!r}; expected none")
        if id(node) in self._open:
            return self._fault(node, loc, "contains itself (an anchor inside its own alias)")
        if id(node) in self._done:
            data, values = self._done[id(node)]
            self._count(values)
            return data
        values_before = self._values
        self._open.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            data = [self.value(item, (*loc, i)) for i, item in enumerate(node.value)]
        else:
            data = self._mapping(node, loc)
        self._open.discard(id(node))
        self._done[id(node)] = data, self._values - values_before
        return data

    def _count(self, values: int) -> None:
        self._values += values
        if self._values > _MOST_VALUES:
            raise _refused(self._path, f"unfolds to more than {_MOST_VALUES} values; a configuration has some hundred")

    def _mapping(self, node: yaml.Node, loc: Loc) -> dict[str, Any]:
        data: dict[str, Any] = {}
        lines: dict[str, int] = {}
        merged: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                self._fault(key_node, loc, "a key is a list or mapping; expected a name")
                continue
            key = key_node.value
            if key_node.tag == _PREFIX + "merge":
                given = self.value(value_node, loc)
                for part in given if isinstance(given, list) else [given]:
                    merged = {**part, **merged} if isinstance(part, dict) else merged
                continue
            if key in lines:
                what = "is mapped twice; a role has one source" if loc == ("signals",) else "is given twice"
                self._fault(key_node, (*loc, key), f"{what} (first at line {lines[key]})")
                continue
            lines[key] = key_node.start_mark.line + 1
            data[key] = self.value(value_node, (*loc, key))
        return {**merged, **data}

    def _scalar(self, node: yaml.ScalarNode, loc: Loc) -> Any:
        kind, text = node.tag.removeprefix(_PREFIX), str(node.value)
        try:
            if kind == "str":
                return text
            if kind == "bool":
                return {"true": True, "false": False}[text.lower()]
            if kind == "null":
                return None
            if kind == "int" and len(text) <= _LONGEST_WHOLE:
                base = {"0x": 16, "0o": 8}.get(text[:2], 10)
                return int(text, base)
            if kind == "float":
                return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
        except (KeyError, ValueError):
            pass
        return self._fault(node, loc, f"tag {node.tag!r} on {text[:40]!r}; expected plain text or a number")

    def _fault(self, node: yaml.Node, loc: Loc, what: str) -> None:
        dotted = dotted_name(loc)
        place = f"{self._path.name}:{node.start_mark.line + 1}"
        self.faults.append(Fault(f"{place}: {dotted}" if dotted else place, what))
