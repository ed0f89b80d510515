"""Seals: what is true is written down and its salted hash published before anybody is asked."""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from dsz_daemon.errors import InputError

_PACKAGE = Path(__file__).parents[1]
# What an answer depends on: its thresholds and settings are in these sources.
_JUDGE = ("diagnose/**/*.py", "runs/diagnose.py", "signals.py")


def sealed(truth: Mapping[str, Any], path: Path) -> str:
    """Writes the truth with a salt of its own; returns their hash."""
    salt = secrets.token_hex(16)
    text = json.dumps({"salt": salt, "truth": truth}, sort_keys=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Whole or not at all: what is there when all begins anew is taken as it is.
    part = path.with_suffix(".part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)
    return hash_of_text(path)


def hash_of_text(path: Path) -> str:
    """What is published of a seal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def opened(path: Path, published: str) -> dict[str, Any]:
    """The truth behind a seal. InputError: it is not what was sealed."""
    found = hash_of_text(path)
    if found != published:
        raise InputError(
            f"{path}: its hash is {found[:16]}..., but {published[:16]}... was published: not what was sealed"
        )
    truth: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))["truth"]
    return truth


def hash_of(paths: Iterable[Path]) -> str:
    """One hash of files' names and contents."""
    content = hashlib.sha256()
    for path in sorted(paths):
        content.update(path.name.encode())
        content.update(hashlib.sha256(path.read_bytes()).digest())
    return content.hexdigest()


def hash_of_sources(patterns: Iterable[str]) -> str:
    """One hash of the package's files of these patterns."""
    return hash_of(path for pattern in patterns for path in _PACKAGE.glob(pattern))


def hash_of_judge() -> str:
    """One hash of all that decides what is said of a recording."""
    return hash_of_sources(_JUDGE)
