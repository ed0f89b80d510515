"""DBC files: beside the configuration, or inside an installed package (`pkg:opendbc/...`).

Real DBC files are often not quite right. What can be read safely is read, and a warning says
what was let pass; what can't is an InputError with cantools' own words.
"""

from __future__ import annotations

import difflib
import importlib.util
import logging
import re
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import cantools
from cantools.database.can import Database

from dsz_daemon.errors import ConfigError, Fault, InputError

# Formats of cantools by suffix; whatever else a file is called, it is taken for a DBC.
_FORMATS = {".kcd": "kcd", ".sym": "sym", ".arxml": "arxml"}
# opendbc composes its files: a line names another of the same folder, whose text belongs to it.
_IMPORT = re.compile(r'^CM_ "IMPORT (?P<file>[^"]+)";[ \t]*\r?$', re.MULTILINE)
_MESSAGE_ID = re.compile(r"^(?P<key>BO_|SIG_VALTYPE_|SG_MUL_VAL_) (?P<id>\d+) (?P<name>\w*)")
_SIGNAL = re.compile(r"^\s+SG_ (?P<name>\w+)")
# Nothing in it is tried twice: with `.*` a line of a thousand brackets would take hours.
_WHOLE_SIGNAL = re.compile(r"\s++SG_ [^:]++:[^(]++\([^)]++\)\s*+\[[^]]*+\]\s*+\"[^\"]*+\"\s*+\S")
_BARE_FRACTION = re.compile(r"(?<=[(,\[|])\.(?=\d)")
# cantools makes room for every bit and every value of a range, however many the text says there are. The
# longest messages that a DBC describes are those of J1939's transport protocol, 1785 bytes.
_BITS = re.compile(r"(?<!\d)(?P<start>\d++)\s*+\|\s*+(?P<length>\d++)\s*+@")
_BYTES = re.compile(r"\bBO_\s++\d++\s++\w++\s*+:\s*+(?P<length>\d++)")
_RANGE = re.compile(r"(?<!\d)(?P<low>\d++)\s*+-\s*+(?P<high>\d++)")
_MOST_BITS, _MOST_MULTIPLEXED = 2048 * 8, 1 << 16
_LONGEST_WORDS = 300
_EXTENDED = 1 << 31
# A car's whole network has some hundred kB; cantools takes a minute for what is allowed here.
_MOST_BYTES = 16_000_000
_LARGEST_STANDARD, _LARGEST_EXTENDED = 0x7FF, 0x1FFF_FFFF


class LoadedDbc(NamedTuple):
    """A database, the name it was asked for by, its file, and what was let pass in it."""

    name: str
    path: Path
    database: Database
    warnings: tuple[str, ...] = ()


def load_dbc(name: str, base: Path) -> LoadedDbc:
    """Load `name`, relative to the folder `base`, or `pkg:PACKAGE/FILE`.

    ConfigError when there is no such file or package, InputError when it can't be read.
    """
    path = locate_dbc(name, base)
    text = _text(name, path)
    last = text.splitlines()[-1]
    # cantools passes over a signal that a cut file ends in.
    if _SIGNAL.match(last) and not _WHOLE_SIGNAL.match(last):
        raise InputError(f"{name}: is cut short: it ends in {last.strip()[-80:]!r}")
    beyond = _beyond_measure(text)
    if beyond:
        raise InputError(f"{name}: can't be read: {beyond}")
    database, warnings = _parsed(name, text, _FORMATS.get(path.suffix.lower(), "dbc"))
    if not database.messages:
        raise InputError(f"{name}: has no messages; expected a DBC file")
    return LoadedDbc(name, path, database, warnings)


def locate_dbc(name: str, base: Path) -> Path:
    """The file that `name` means; ConfigError with near misses when there is none."""
    if name.startswith("pkg:"):
        return _in_package(name)
    try:
        path = base / Path(name).expanduser()
        if path.is_dir():
            raise _no_file(name, "is a folder; expected a DBC file")
        if not path.exists():
            beside = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
            raise _no_file(name, f"no such file ({path}){_meant(path.name, beside)}")
    except (OSError, ValueError, RuntimeError) as error:
        # Too long, a NUL in it, a folder that we may not look into, the home of nobody.
        raise _no_file(name, f"can't be looked up: {getattr(error, 'strerror', None) or error}") from None
    return path


def _in_package(name: str) -> Path:
    package, _, inside = name.removeprefix("pkg:").partition("/")
    parts = PurePosixPath(inside).parts
    if not package.isidentifier() or not parts or ".." in parts:
        raise _no_file(name, "expected pkg:PACKAGE/FILE, e.g. pkg:opendbc/dbc/hyundai_2015_ccan.dbc")
    # Only looked up, never imported: a package's code has no business in reading a text file.
    try:
        spec = importlib.util.find_spec(package)
    except ValueError:  # of __main__, and of modules that somebody has put together by hand
        spec = None
    if spec is None or not spec.submodule_search_locations:
        needs = " (needs Python below 3.13)" if package == "opendbc" else ""
        raise _no_file(name, f"package {package!r} is not installed; pip install {package}{needs}")
    roots = [Path(root) for root in spec.submodule_search_locations]
    try:
        exact = [root.joinpath(*parts) for root in roots if root.joinpath(*parts).is_file()]
    except OSError as error:
        raise _no_file(name, f"can't be looked up: {error.strerror}") from None
    if exact:
        return exact[0]
    # Shorthand: the file's name alone; and opendbc's own names for the files it composes.
    wanted = parts[-1].removesuffix(".dbc").removesuffix("_generated") + ".dbc"
    shipped = sorted({path for root in roots for path in root.rglob("*.dbc")})
    found = [path for path in shipped if path.name in {wanted, parts[-1]}]
    if len(found) == 1:
        return found[0]
    if found:
        choices = ", ".join(f"pkg:{package}/{_inside(path, roots)}" for path in found)
        raise _no_file(name, f"is ambiguous; expected one of {choices}")
    hint = _meant(parts[-1], [path.name for path in shipped])
    raise _no_file(name, f"package {package!r} has no such file{hint}")


def _inside(path: Path, roots: Iterable[Path]) -> str:
    return next(path.relative_to(root).as_posix() for root in roots if path.is_relative_to(root))


def _meant(word: str, names: Iterable[str]) -> str:
    close = difflib.get_close_matches(word, list(names), n=3)
    return f"; did you mean {' or '.join(map(repr, close))}?" if close else ""


def _no_file(name: str, what: str) -> ConfigError:
    return ConfigError("a DBC is not there", [Fault(name, what)])


def _text(name: str, path: Path) -> str:
    """The file's text with its imports; UTF-8, else cp1252 as DBC editors write it."""
    raw = _content(name, path)
    if not raw.strip():
        raise InputError(f"{name}: is empty; expected a DBC file")
    if b"\0" in raw:
        raise InputError(f"{name}: is binary; expected a DBC file")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("cp1252", errors="replace")
    files = dict.fromkeys(match["file"] for match in _IMPORT.finditer(text))
    whole = "".join([*(_imported(name, path.parent, file) for file in files), _IMPORT.sub("", text)])
    if len(whole) > _MOST_BYTES:
        raise _too_large(name)
    if not whole.strip():
        raise InputError(f"{name}: is empty; expected a DBC file")
    return whole.rstrip() + "\n"


def _content(name: str, path: Path) -> bytes:
    """The file's bytes; of a device or a pipe, which may never end, not one."""
    try:
        if not path.is_file():
            raise InputError(f"{name}: is no file")
        with path.open("rb") as file:
            raw = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"{name}: can't be read: {error.strerror}") from None
    if len(raw) > _MOST_BYTES:
        raise _too_large(name)
    return raw


def _too_large(name: str) -> InputError:
    return InputError(f"{name}: has more than {_MOST_BYTES // 1_000_000} MB; a DBC file has some hundred kB")


def _imported(name: str, folder: Path, file: str) -> str:
    # A DBC from elsewhere must not have other files of this machine read into error messages.
    if "/" in file or not file.isprintable():
        raise InputError(f"{name}: imports {file[:80]!r}; expected the name of a file beside it")
    try:
        is_there = (folder / file).is_file()
    except OSError:
        is_there = False
    if not is_there:
        raise InputError(f"{name}: imports {file[:80]!r}, which is not beside it")
    return _content(file, folder / file).decode("utf-8", errors="replace") + "\n"


def _beyond_measure(text: str) -> str:
    """What in a DBC is larger than anything on a bus; "" if nothing is. Linear in the text's length."""
    for found in _BITS.finditer(text):
        if max(_number(found["start"]), _number(found["length"])) > _MOST_BITS:
            return f"a signal at {found[0][:40]!r}; expected at most {_MOST_BITS} bits"
    for found in _BYTES.finditer(text):
        if _number(found["length"]) * 8 > _MOST_BITS:
            return f"a message of {found['length'][:20]} bytes; expected at most {_MOST_BITS // 8}"
    for piece in text.split("SG_MUL_VAL_")[1:]:
        ranges = list(_RANGE.finditer(piece.partition(";")[0]))
        if sum(max(0, _number(r["high"]) - _number(r["low"])) for r in ranges) > _MOST_MULTIPLEXED:
            return f"multiplexer values {ranges[0][0][:40]!r}; expected at most {_MOST_MULTIPLEXED} of them"
    return ""


def _number(digits: str) -> int:
    return int(digits) if len(digits) < 12 else 10**12


def _parsed(name: str, text: str, database_format: str) -> tuple[Database, tuple[str, ...]]:
    """Strictly; else with overlapping signals; else without comments and impossible ids."""
    try:
        return _load(text, database_format, strict=True), ()
    except Exception as error:  # cantools raises whatever its parser runs into
        strict = _one_line(error)
    try:
        return _load(text, database_format, strict=False), (f"{name}: read leniently: {strict}",)
    except Exception as error:
        lenient = _one_line(error)
    skeleton, left_out = _skeleton(text)
    try:
        database = _load(skeleton, database_format, strict=False)
    except Exception:
        raise InputError(f"{name}: can't be read: {lenient}") from None
    warnings = [f"{name}: read without comments, value names and attributes: {lenient}"]
    if left_out:
        warnings.append(f"{name}: left out, for impossible ids or names: {', '.join(left_out)}")
    return database, tuple(warnings)


def _load(text: str, database_format: str, *, strict: bool) -> Database:
    # cantools logs what it finds twice, raw, and logging prints that where nobody has set it up: a line for each
    # message of a file made so. What matters of it is told by the mapping's own warnings.
    logger = logging.getLogger("cantools")
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
    database = cantools.database.load_string(text, database_format=database_format, strict=strict)
    if not isinstance(database, Database):
        raise TypeError("describes diagnostics, not CAN messages")
    return database


def _skeleton(text: str) -> tuple[str, list[str]]:
    """Messages, signals, float and multiplexing marks only; and the names of what had to go.

    An id that only fits 29 bits is one, also where the file forgot to mark it so; `.25` is
    0.25. What is wrong in a message or a signal beyond that stays wrong: guessing at bits is
    not ours.
    """
    kept: list[str] = []
    left_out: list[str] = []
    skipping = False
    for line in text.splitlines():
        signal = _SIGNAL.match(line)
        if signal is not None:
            if signal["name"][0].isdigit():
                left_out.append(signal["name"])
            elif not skipping:
                kept.append(_BARE_FRACTION.sub("0.", line))
            continue
        numbered = _MESSAGE_ID.match(line)
        if numbered is None:
            kept += [line] if line.startswith("BO_ ") else []
            continue
        number = _number(numbered["id"])
        wrong = _LARGEST_EXTENDED < number < _EXTENDED or numbered["name"][:1].isdigit()
        if numbered["key"] == "BO_":
            skipping = wrong
            left_out += [numbered["name"]] if wrong else []
        if not wrong:
            marked = number | _EXTENDED if _LARGEST_STANDARD < number < _EXTENDED else number
            kept.append(f"{line[: numbered.start('id')]}{marked}{line[numbered.end('id') :]}")
    return "\n".join(kept) + "\n", left_out


def _one_line(error: Exception) -> str:
    """cantools' words without its wrapping."""
    text = " ".join(str(error).split())
    wrapped = re.fullmatch(r'DBC: "(?P<words>.*)"', text)
    words = wrapped["words"] if wrapped else (text or type(error).__name__)
    # It quotes the offending line, whatever its length.
    return words if len(words) <= _LONGEST_WORDS else f"{words[: _LONGEST_WORDS - 3]}..."
