"""Scores over trials, with Wilson's intervals."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from dsz_daemon.prove.mix import AS_PUBLISHED, OWN, SECONDS

Scores = Sequence[dict[str, Any]]

# Two-sided 95 %.
_Z = 1.959963984540054


def wilson(hits: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927); nothing known of nothing."""
    if of == 0:
        return 0.0, 1.0
    share, z2 = hits / of, _Z * _Z
    middle = (share + z2 / (2.0 * of)) / (1.0 + z2 / of)
    half = _Z / (1.0 + z2 / of) * math.sqrt(share * (1.0 - share) / of + z2 / (4.0 * of * of))
    return max(0.0, middle - half), min(1.0, middle + half)


def share(flags: Iterable[bool]) -> dict[str, Any]:
    """Hits, of how many, and the interval."""
    found = [bool(flag) for flag in flags]
    low, high = wilson(sum(found), len(found))
    return {"hits": sum(found), "of": len(found), "low": low, "high": high}


def summary(scores: Scores) -> dict[str, Any]:
    """All figures of a proof; of each group by its own, and those of a car that shakes itself by themselves alone."""
    shaken = [one for one in scores if one["group"] == AS_PUBLISHED]
    scores = [one for one in scores if one["group"] != AS_PUBLISHED]
    nulls = [one for one in scores if one["group"] == "null"]
    listed = [one for one in scores if one["planted"]]
    singles = [one for one in scores if one["group"] == "single"]
    pairs = [one for one in scores if one["group"] == "pair"]
    nameless = [one for one in scores if one["group"] == "unlisted"]
    off = [abs(value) for one in listed for value in one["off"]]
    stated = [pair for one in scores for pair in one["stated"]]
    found: dict[str, Any] = {
        "trials": len(scores),
        "errors": sum(one["error"] is not None for one in scores),
        "false_alarms": share(one["alarm"] for one in nulls),
        "false_extras": share(bool(one["extra"]) for one in scores),
        "shapes_too_many": share(bool(one["shapes"]) for one in listed if one["car"] == OWN),
        "probability_of_truth": _mean(value for one in listed for value in one["probability"]),
        "probability_or_alias": _mean(value for one in listed for value in one["probability_or_alias"]),
        "both_of_a_pair": share(one["all_named"] for one in pairs),
        "both_or_alias": share(one["all_or_alias"] for one in pairs),
        "alias_pairs": share(one["first_or_alias"] for one in scores if one["group"] == "alias_pair"),
        "unlisted_misnamed": share(bool(one["extra"]) for one in nameless),
        "unlisted_found": share(one["unlisted_found"] for one in nameless),
        "as_published": share(one["first"] for one in shaken),
        "as_published_extras": share(bool(one["extra"]) for one in shaken),
        "inside_95": share(value < _Z for value in off),
        "brier": _mean((p - right) ** 2 for p, right in stated),
        "reliability": _reliability(stated),
        "regained_median": _median(one["regained"] for one in listed),
        "profile_within_0.1_deg": share(one["profile_rad"] < math.radians(0.1) for one in scores if one["profile_rad"]),
        "overlap_0.7": share(one["overlap"] > 0.7 for one in scores if one["overlap"] is not None),
        "begins_off_s": _median(one["moments_off_s"][0] for one in scores if one["moments_off_s"]),
        "ends_off_s": _median(one["moments_off_s"][1] for one in scores if one["moments_off_s"]),
        "seconds_median": _median(one["seconds"] for one in scores),
        "seconds_longest": max((one["seconds"] for one in scores if one["seconds"]), default=None),
    }
    for size in sorted({one["size"] for one in singles}, reverse=True):
        mine = [one for one in singles if one["size"] == size]
        found[f"singles_{size:g}"] = share(one["first"] for one in mine)
        found[f"singles_or_alias_{size:g}"] = share(one["first_or_alias"] for one in mine)
        found[f"singles_wrong_{size:g}"] = share(bool(one["extra"]) and not one["first_or_alias"] for one in mine)
    found["sizes"] = [
        {"size": size, "car": car} | share(one["first"] for one in singles if (one["size"], one["car"]) == (size, car))
        for size, car in sorted({(one["size"], one["car"]) for one in singles}, reverse=True)
    ]
    found["lengths"] = [
        {"seconds": float(length_s)} | share(one["first_of"][length_s] for one in scores if length_s in one["first_of"])
        for length_s in sorted({length_s for one in scores for length_s in one["first_of"]}, key=float)
    ]
    whole = [one for one in scores if one["first_of"]]
    found["lengths"] += [{"seconds": SECONDS} | share(one["first"] for one in whole)] if whole else []
    found["confusion"] = [
        (planted, said, count)
        for (planted, said), count in sorted(Counter((one["planted"][0], one["foremost"]) for one in singles).items())
    ]
    found["rivals"] = _rivals(scores, singles, nulls)
    found["by_car"] = {
        car: {
            "singles": share(one["first"] for one in singles if one["car"] == car and one["size"] == 1.0),
            "false_extras": share(bool(one["extra"]) for one in scores if one["car"] == car),
        }
        for car in sorted({one["car"] for one in scores})
    }
    return found


def _rivals(scores: Scores, singles: Scores, nulls: Scores) -> list[dict[str, Any]]:
    """Who else could have answered, on the same recordings."""
    names = Counter(one["planted"][0] for one in singles)
    common = max(names, key=lambda name: names[name], default="")
    listed = [one for one in scores if one["planted"]]

    def row(name: str, right: Iterable[bool], alarms: Iterable[bool], regained: float | None) -> dict[str, Any]:
        return {"name": name, "first": share(right), "false_alarms": share(alarms), "regained": regained}

    return [
        row("dsz diagnose", (one["first"] for one in singles), (one["alarm"] for one in nulls),
            _median(one["regained"] for one in listed)),
        row("a refit of the configured parameters alone", (False for _ in singles), (False for _ in nulls), 0.0),
        row("gradient boosting on what that leaves (fits, names nothing)",
            (False for _ in singles), (False for _ in nulls), _median(one["boosted"] for one in listed)),
        row("sparse regression on what that leaves (pysindy; its largest term, named by hand)",
            (one["sparse"] in one["planted"] for one in singles), (one["sparse"] != "nothing" for one in nulls), None),
        row(f"always {common}", (one["planted"] == [common] for one in singles), (True for _ in nulls), None),
    ]  # fmt: skip


def _mean(values: Iterable[float]) -> float | None:
    found = list(values)
    return float(np.mean(found)) if found else None


def _median(values: Iterable[float | None]) -> float | None:
    found = [value for value in values if value is not None]
    return float(np.median(found)) if found else None


def _reliability(stated: Sequence[tuple[float, bool]]) -> list[dict[str, float]]:
    """In tenths of the stated probability: how sure, how often right, how many."""
    rows = []
    for low in np.arange(0.0, 1.0, 0.1).tolist():
        mine = [(p, right) for p, right in stated if low <= p < low + 0.1 or (low > 0.85 and p >= 1.0)]
        if mine:
            hits = sum(right for _, right in mine)
            rows.append({"stated": float(np.mean([p for p, _ in mine])), "right": hits / len(mine), "of": len(mine)})
    return rows
