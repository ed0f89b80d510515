"""The names that a mistyped one may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

# difflib's ratio: 0.6 lets one slip in four letters pass and keeps unrelated words out.
_LIKENESS = 0.6


def nearest(word: str, names: Iterable[str], most: int = 3) -> list[str]:
    """Up to `most` of `names` that look like `word`, the likeliest first; case does not count.

    >>> nearest("mas_kg", ["mass_kg", "front_track_m"])
    ['mass_kg']
    """
    by_lower: dict[str, str] = {}
    for name in names:
        by_lower.setdefault(name.lower(), name)
    close = difflib.get_close_matches(word.lower(), list(by_lower), n=most, cutoff=_LIKENESS)
    return [by_lower[name] for name in close]


def did_you_mean(word: str, names: Iterable[str], most: int = 3) -> str:
    """`; did you mean 'a' or 'b'?`, or nothing where no name looks like it."""
    close = nearest(word, names, most)
    return f"; did you mean {' or '.join(map(repr, close))}?" if close else ""
