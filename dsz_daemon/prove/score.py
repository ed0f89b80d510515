"""One answer against its truth: what was named, how sure, how large, where, and how much better it fits."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.prove.reasons import reasons
from dsz_daemon.prove.rivals import UNASKED, rivals
from dsz_daemon.prove.sizes import HOW

# What no recording of these channels can split; the contract says so.
SAME_TURN = frozenset({"mass_loading", "cornering_stiffness", "steering_compliance"})
# How long the answer took, beside it.
SECONDS = "seconds.txt"
# What is said of a channel where no shape is: that much is left is no answer.
_FORMLESS = "of no known shape"
_DRIVING_MPS = 3.0
_POINTS = 130
_PROFILES = {"road_bank": ("road_bank_rad", "road_bank_rad"), "road_grade": ("road_grade_up_rad", "road_grade_up_rad")}


def scored(truth: Mapping[str, Any], answer: Path, profiles: Path, asks_rivals: bool = True) -> dict[str, Any]:
    """The score of one trial, as plain data; `answer` holds diagnosis.json, or error.json.

    What rivals make of it takes a second, and is left out unless it `asks_rivals`.
    """
    planted = {one["effect"]: one["parameters"] for one in truth["effects"]}
    one: dict[str, Any] = {key: truth[key] for key in ("number", "group", "car", "kind", "seed", "size")}
    one |= {"planted": sorted(planted), "unlisted": [row["name"] for row in truth["unlisted"]]}
    one["seconds"] = _seconds(answer)
    if not (answer / "diagnosis.json").exists():
        return one | _silent(planted) | {"error": json.loads((answer / "error.json").read_text())["error"]}
    found = json.loads((answer / "diagnosis.json").read_text(encoding="utf-8"))
    fitted = read_samples(answer / "fit.parquet")
    causes, beside = _causes(found), rivals(fitted, found["fit"]) if asks_rivals else UNASKED
    there = _there(truth)
    allowed = there | {name for cause in causes if set(cause["group"]) & set(planted) for name in cause["group"]}
    named = [cause["effect"] for cause in causes]
    shapes = [shape for shape in found["unlisted"] if not shape["shape"].endswith(_FORMLESS)]
    foremost = _foremost(named, planted, there)
    groups = [cause["group"] for cause in causes if cause["effect"] in foremost]
    off = _off(causes, planted)
    extra = sorted({name for name in named if name not in allowed})
    return one | {
        "verdict": found["verdict"],
        "named": named,
        "alarm": found["verdict"] != "consistent" or bool(set(named) - there),
        "shapes": [f"{shape['channel']} {shape['shape']}" for shape in shapes],
        "foremost": foremost[0] if foremost else "nothing",
        "first": bool(foremost and foremost[0] in planted),
        "first_or_alias": bool(groups and set(groups[0]) & set(planted)),
        "all_named": set(planted) <= set(named),
        "all_or_alias": all(any(name in cause["group"] for cause in causes) for name in planted),
        "extra": extra,
        "why": reasons(planted, causes, extra, found),
        "unlisted_found": _unlisted_found(truth["unlisted"], shapes),
        "probability": [_probability(name, causes) for name in planted],
        "probability_or_alias": [_with_aliases(name, causes) for name in planted],
        "stated": [(cause["probability"], bool(set(cause["group"]) & there)) for cause in causes],
        "off": [spreads for _, spreads in off],
        "off_of": [name for name, _ in off],
        "profile_rad": _profile(named, fitted, read_samples(profiles)),
        "overlap": _overlap(causes, planted),
        "moments_off_s": _moments_off(causes, planted),
        "regained": _regained(found["fit"]),
        "boosted": beside.boosted,
        "sparse": beside.sparse,
        "picture": _picture(found["fit"], fitted),
        "error": None,
        # Of beginnings alone, by their length in s.
        "first_of": {},
    }


def is_first(truth: Mapping[str, Any], answer: Path) -> bool:
    """Whether an answer names what was planted, before anything that is not there."""
    if not (answer / "diagnosis.json").exists():
        return False
    named = [one["effect"] for one in _causes(json.loads((answer / "diagnosis.json").read_text(encoding="utf-8")))]
    planted = {one["effect"] for one in truth["effects"]}
    foremost = _foremost(named, planted, _there(truth))
    return bool(foremost and foremost[0] in planted)


def _there(truth: Mapping[str, Any]) -> set[str]:
    """All that is no mistake to name."""
    there = {row["effect"] for row in (*truth["effects"], *truth["mild"])} | set(truth["by_construction"])
    return there if set(truth["stiffness"]) == {1.0} else there | {"cornering_stiffness"}


def _foremost(named: Sequence[str], planted: Collection[str], there: Collection[str]) -> list[str]:
    """What is named and counts: what was planted, and what is not there."""
    return [name for name in named if name in planted or name not in there]


def _silent(planted: Mapping[str, Any]) -> dict[str, Any]:
    nothing: dict[str, Any] = {key: [] for key in ("named", "shapes", "extra", "stated", "off", "off_of", "why")}
    nothing |= {"alarm": False, "foremost": "nothing", "sparse": "nothing"}
    nothing |= dict.fromkeys(("first", "first_or_alias", "all_named", "all_or_alias", "unlisted_found"), False)
    nothing |= dict.fromkeys(("profile_rad", "overlap", "moments_off_s", "regained", "boosted", "picture"))
    none = [0.0] * len(planted)
    return nothing | {"verdict": None, "first_of": {}, "probability": none, "probability_or_alias": none}


def _seconds(answer: Path) -> float | None:
    path = answer / SECONDS
    return float(path.read_text()) if path.exists() else None


def _causes(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Causes, each with its alias group; stiffnesses outside what is configured are one, too."""
    causes = [
        cause | {"group": sorted({cause["effect"], *cause["indistinguishable_from"]})} for cause in found["causes"]
    ]
    stiff = [one for one in found["parameter_errors"] if "cornering_stiffness" in one["parameter"]]
    if stiff and not any(cause["effect"] in SAME_TURN for cause in causes):
        shares = {
            f"{one['parameter'].partition('_')[0]}_scale": {
                "value": one["fitted"] / one["configured"], "std": one["std"] / one["configured"],
            }
            for one in stiff
        }  # fmt: skip
        causes.append(
            {"effect": "cornering_stiffness", "group": sorted(SAME_TURN), "parameters": shares}
            | {"probability": 1.0, "alternatives": []}
        )
    return causes


def _probability(name: str, causes: Sequence[Mapping[str, Any]]) -> float:
    """What is given to one effect: of what is stated for its group, its own part, or what it has as an alternative."""
    best = 0.0
    for cause in causes:
        others = {other["effect"]: float(other["probability"]) for other in cause["alternatives"]}
        outside = sum(odds for other, odds in others.items() if other not in cause["group"])
        # How sure it is that there is anything at all.
        sure = cause["probability"] / max(1.0 - outside, 1e-12)
        if cause["effect"] == name:
            best = max(best, sure * (1.0 - sum(others.values())))
        elif name in others:
            best = max(best, sure * others[name])
        elif name in cause["group"]:
            # Declared to be the same, without a figure: shared out evenly.
            best = max(best, cause["probability"] / len(cause["group"]))
    return best


def _with_aliases(name: str, causes: Sequence[Mapping[str, Any]]) -> float:
    """What is stated of a cause that an effect is, or that is said not to be told from it."""
    stated = [float(cause["probability"]) for cause in causes if name in cause["group"]]
    return max([_probability(name, causes), *stated])


def _unlisted_found(planted: Sequence[Mapping[str, Any]], said: Sequence[Mapping[str, Any]]) -> bool:
    return bool(planted) and all(any(one["channel"] == shape["channel"] for shape in said) for one in planted)


def _off(causes: Sequence[Mapping[str, Any]], planted: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, float]]:
    """By how many of their spreads parameters are off, with their names."""
    off = []
    for cause in causes:
        true = planted.get(cause["effect"], {})
        # What the vocabulary calls by another name in the simulated car.
        true = {key.removesuffix("_per_s"): value for key, value in true.items() if key not in HOW}
        for name, one in cause["parameters"].items():
            if name in true and one.get("std") and not isinstance(true[name], str):
                off.append((f"{cause['effect']}.{name}", float((one["value"] - true[name]) / one["std"])))
    return off


def _profile(named: Sequence[str], fitted: Mapping[str, Any], true: Mapping[str, Any]) -> float | None:
    """How far a road's profile is off, rms, but for a constant; the worst of those that were named."""
    found = []
    for effect, (ours, theirs) in _PROFILES.items():
        if effect in named and theirs in true and float(np.ptp(true[theirs])) > 0.0:
            at_s = fitted["time_s"] - fitted["time_s"][0]
            moving = np.interp(at_s, true["time_s"], true["speed_mps"]) > _DRIVING_MPS
            found.append(float(np.std((fitted[ours] - np.interp(at_s, true["time_s"], true[theirs]))[moving])))
    return max(found, default=None)


def _overlap(causes: Sequence[Mapping[str, Any]], planted: Mapping[str, Mapping[str, Any]]) -> float | None:
    """Of a slippery stretch, what is said and true over what is said or true."""
    true = planted.get("low_friction")
    for cause in causes:
        if true is not None and cause["effect"] == "low_friction":
            start_s, end_s = (cause["parameters"][key]["value"] for key in ("start_s", "end_s"))
            both = min(end_s, true["end_s"]) - max(start_s, true["start_s"])
            return float(max(0.0, both) / (max(end_s, true["end_s"]) - min(start_s, true["start_s"])))
    return None


def _moments_off(
    causes: Sequence[Mapping[str, Any]], planted: Mapping[str, Mapping[str, Any]]
) -> tuple[float, float] | None:
    """By how much the beginning and the end of a slippery stretch are off, s."""
    true = planted.get("low_friction")
    said = next((cause["parameters"] for cause in causes if cause["effect"] == "low_friction"), None)
    if true is None or said is None:
        return None
    start_s, end_s = (abs(float(said[key]["value"]) - float(true[key])) for key in ("start_s", "end_s"))
    return start_s, end_s


def _regained(fit: Mapping[str, Mapping[str, Any]]) -> float | None:
    """Of what unseen rows could lose at best (all but the sensors' noise), what they lost: over channels, in power.

    Each channel in units of its noise; None where nothing was to be gained.
    """
    before, after = 0.0, 0.0
    for channel in fit.values():
        floor = channel["noise_floor"]
        if not (floor and math.isfinite(floor)):
            continue
        before += max((channel["held_out"]["before"] / floor) ** 2 - 1.0, 0.0)
        after += max((channel["held_out"]["after"] / floor) ** 2 - 1.0, 0.0)
    return 1.0 - after / before if before > 1.0 else None


def _picture(fit: Mapping[str, Mapping[str, Any]], fitted: Mapping[str, Any]) -> dict[str, Any] | None:
    """What is left of the channel with most to explain over its noise, before and after, `_POINTS` in time.

    Each point is the largest in its piece of the drive, in hundredths of the largest of all.
    """
    level = {
        name: one["held_out"]["before"] / one["noise_floor"]
        for name, one in fit.items()
        if one["noise_floor"] and f"{name}_measured" in fitted
    }
    if not level:
        return None
    channel = max(level, key=lambda name: level[name])
    left = {
        name: np.nan_to_num(fitted[f"{channel}_measured"] - fitted[f"{channel}_{simulated}"])
        for name, simulated in (("before", "nominal"), ("after", "fitted"))
    }
    edges = np.linspace(0, len(left["before"]), _POINTS + 1).astype(int)
    thin = {
        name: [
            float(course[a:b][np.argmax(np.abs(course[a:b]))]) for a, b in itertools.pairwise(edges.tolist()) if b > a
        ]
        for name, course in left.items()
    }
    most = max(abs(value) for course in thin.values() for value in course) or 1.0
    return {"channel": channel} | {name: [round(100.0 * v / most) for v in course] for name, course in thin.items()}
