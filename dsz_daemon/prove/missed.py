"""Where the bars of a proof are missed: of which trials, by how much."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from dsz_daemon.prove.mix import AS_PUBLISHED

Scores = Sequence[Mapping[str, Any]]

# Two-sided 95 %; what a road may be off, and how much of a slippery stretch has to be said.
_Z, _OFF_DEG, _OVERLAP = 1.959963984540054, 0.1, 0.7


def missed(scores: Scores) -> str:
    """Where probability is given to something else, which numbers are outside, which roads and stretches are off."""
    scores = [one for one in scores if one["group"] != AS_PUBLISHED]
    return "\n".join([*_probability(scores), *_outside(scores), *_roads(scores), *_stretches(scores)])


def _kind(one: Mapping[str, Any]) -> str:
    if one["group"] == "single":
        return f"singles of size {one['size']:g}"
    return {"pair": "pairs", "alias_pair": "pairs that turn a car alike", "local": "slippery stretches"}[one["group"]]


def _probability(scores: Scores) -> Iterable[str]:
    rows: dict[str, list[tuple[float, float]]] = {}
    for one in scores:
        if one["planted"]:
            pairs = zip(one["probability"], one["probability_or_alias"], strict=True)
            rows.setdefault(_kind(one), []).extend(pairs)
    yield "The probability given to what was planted: what is not named has none, and where a drive does not tell which"
    yield "of several it is (load, stiffness and compliance turn a car alike), each has its part.\n"
    yield "| planted | effects | given to it | or to what is said to be the same |\n|---|---|---|---|"
    for kind, given in sorted(rows.items()):
        alone, alike = (sum(values) / len(given) for values in zip(*given, strict=True))
        yield f"| {kind} | {len(given)} | {alone:.3f} | {alike:.3f} |"
    yield ""


def _outside(scores: Scores) -> Iterable[str]:
    off = [pair for one in scores for pair in zip(one["off_of"], one["off"], strict=True)]
    told, outside = Counter(name for name, _ in off), [(name, z) for name, z in off if abs(z) >= _Z]
    if not outside:
        return
    yield "Numbers outside their 95 % interval, by how many of their spreads (of as many as were told):\n"
    yield "| number | told | outside | by |\n|---|---|---|---|"
    for name, count in sorted(Counter(name for name, _ in outside).items(), key=lambda row: (-row[1], row[0])):
        by = ", ".join(f"{z:+.1f}" for one, z in outside if one == name)
        yield f"| {name} | {told[name]} | {count} | {by} |"
    yield ""


def _roads(scores: Scores) -> Iterable[str]:
    rows = [(one, math.degrees(one["profile_rad"])) for one in scores if one["profile_rad"]]
    rows = [(one, off_deg) for one, off_deg in rows if off_deg >= _OFF_DEG]
    if not rows:
        return
    yield "Roads that are further off:\n"
    yield "| trial | car, way | planted | off, rms |\n|---|---|---|---|"
    for one, off_deg in rows:
        yield f"| {_trial(one)} | {off_deg:.2f} deg |"
    yield ""


def _stretches(scores: Scores) -> Iterable[str]:
    rows = [one for one in scores if one["overlap"] is not None and one["overlap"] <= _OVERLAP]
    if not rows:
        return
    yield "Slippery stretches that overlap by less:\n"
    yield "| trial | car, way | planted | overlap | begins off | ends off |\n|---|---|---|---|---|---|"
    for one in rows:
        begins_s, ends_s = one["moments_off_s"]
        yield f"| {_trial(one)} | {one['overlap']:.2f} | {begins_s:.1f} s | {ends_s:.1f} s |"
    yield ""


def _trial(one: Mapping[str, Any]) -> str:
    return f"{one['number']} | {one['car'].replace('_', ' ')}, {one['kind']} | {' + '.join(one['planted'])}"
