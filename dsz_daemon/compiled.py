"""One source of an equation: compiled where numba is installed, plain Python where it is not.

`compiled` is for rooms that are only ever used as a whole. `compiled_with` leaves a room's functions plain Python for
whoever calls them one by one (a live daemon, which has no numba to wait for) and compiles them for one caller of many.

Compiled functions call each other, so that all of them are written in what both understand: floats, tuples, named
tuples and arrays, no methods, nothing kept. NUMBA_DISABLE_JIT=1 gives the plain ones where numba is installed, too.

Numba keeps what it compiled, but looks only at the file of the function itself, not at those it calls: a mended
equation would live on in its callers. So the kept ones have a folder by what all the sources say.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., object])

_PACKAGE = Path(__file__).parent
# What compiled functions are made of, constants included; those of one package call none of another.
_SOURCES = {
    "core": ("core/*.py",),
    "sim": ("sim/*.py",),
    "diagnose": ("diagnose/simulation/*.py", "diagnose/residuals/evidence.py"),
}
_OF_ALL = ("signals.py", "compiled.py")
# A product and a sum may be rounded once in place of twice, where nothing has to be the same to the last digit.
_ROUNDED_ONCE = {"diagnose": {"contract"}}
_PREFIX = "compiled-"


def _compiler() -> Any:
    """Numba where it is installed and not told to keep out."""
    try:
        found: Any = importlib.import_module("numba")
    except ImportError:
        return None
    return None if found.config.DISABLE_JIT else found


numba = _compiler()
IS_COMPILED = numba is not None


@functools.cache
def _kept_in(package: str) -> Path | None:
    """The first folder that may be written, for one package's functions; what older sources left is taken away."""
    content = hashlib.sha256()
    for pattern in (*_SOURCES.get(package, ("**/*.py",)), *_OF_ALL):
        for source in sorted(_PACKAGE.glob(pattern)):
            content.update(source.read_bytes())
    prefix = f"{_PREFIX}{package}-"
    name = prefix + content.hexdigest()[:16]
    # Not in a folder that others may write: what is kept is loaded as code.
    for place in (_PACKAGE / "__pycache__", Path("~/.cache/dsz-daemon")):
        try:
            folder = place.expanduser() / name
            folder.mkdir(parents=True, exist_ok=True)
            (folder / ".used").touch()
        except (OSError, RuntimeError):
            continue
        for old in folder.parent.glob(prefix + "*"):
            if old != folder:
                shutil.rmtree(old, ignore_errors=True)
        return folder
    return None


def compiled(function: F) -> F:
    """Compiles the function at its first call, for this and later processes; without numba, leaves it as it is."""
    if not IS_COMPILED:
        return function
    package = function.__module__.partition(".")[2].partition(".")[0]
    kept_in, rounds = _kept_in(package), _ROUNDED_ONCE.get(package, False)
    if kept_in is None:
        return cast(F, numba.njit(nogil=True, fastmath=rounds)(function))
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(kept_in)
    try:
        return cast(F, numba.njit(cache=True, nogil=True, fastmath=rounds)(function))
    finally:
        numba.config.CACHE_DIR = before


def compiled_with(function: F, beside: Sequence[Callable[..., object]], rooms: Sequence[ModuleType]) -> F:
    """Compiles the function at its first call, with `beside` and all functions of the rooms, which stay as they are.

    Properties of the rooms' named tuples can be read, too. Without numba, leaves the function as it is.
    """
    if not IS_COMPILED:
        return function
    kept: list[F] = []

    def call(*arguments: object) -> object:
        if not kept:
            _let_numba_see(beside, rooms)
            kept.append(compiled(function))
        return kept[0](*arguments)

    return cast(F, call)


def _let_numba_see(functions: Sequence[Callable[..., object]], rooms: Sequence[ModuleType]) -> None:
    extending = importlib.import_module("numba.extending")
    here = [
        thing for room in rooms for thing in vars(room).values() if getattr(thing, "__module__", None) == room.__name__
    ]
    for thing in (*functions, *here):
        if isinstance(thing, FunctionType):
            extending.register_jitable(thing)
        elif isinstance(thing, type):
            for name, value in vars(thing).items():
                if isinstance(value, property):
                    _let_numba_read(name, value.fget)


def _let_numba_read(name: str, getter: object) -> None:
    """A property `name` of named tuples; the argument must be called as the getter's."""
    extending, types = importlib.import_module("numba.extending"), importlib.import_module("numba.core.types")
    extending.overload_attribute(types.NamedTuple, name)(lambda self: getter)  # noqa: ARG005
