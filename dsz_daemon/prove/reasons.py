"""Why an answer is not what was planted, as far as the answer itself tells."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

# So many times beyond noise and form a channel is not explained: then a simulation is wrong there.
_WRONG = 3.0
# Odds that are worth a word.
_SOME = 0.01


def reasons(
    planted: Collection[str], causes: Sequence[Mapping[str, Any]], extra: Collection[str], found: Mapping[str, Any]
) -> list[str]:
    """In words, of each planted effect that was not named, and of each name too many.

    `causes`: as they were told, each with its alias `group`; `found`: the whole of `diagnosis.json`.
    """
    named = {cause["effect"] for cause in causes}
    said = [f"{name}: {_missed(name, causes, found)}" for name in sorted(set(planted) - named)]
    return said + [f"{name} too many: {_extra(name, planted, causes, found)}" for name in sorted(extra)]


def _missed(name: str, causes: Sequence[Mapping[str, Any]], found: Mapping[str, Any]) -> str:
    for cause in causes:
        odds = {other["effect"]: float(other["probability"]) for other in cause["alternatives"]}.get(name, 0.0)
        if name in cause["group"]:
            return f"told as one that can't be told from {cause['effect']}"
        if odds > _SOME:
            return f"{cause['effect']} gained more ({odds:.2f} is left for it)"
    if name in {one["effect"] for one in found["could_not_test"]}:
        return "the drive shows less of it than noise"
    worst = _worst(found)
    return f"not named, while {worst}" if worst else f"not named, and no channel stays more than {_WRONG:g} times off"


def _extra(name: str, planted: Collection[str], causes: Sequence[Mapping[str, Any]], found: Mapping[str, Any]) -> str:
    missed = sorted(set(planted) - {cause["effect"] for cause in causes})
    near = {one["effect"] for cause in causes if cause["effect"] == name for one in cause["alternatives"]}
    instead = [one for one in missed if one in near]
    if instead:
        return f"in place of {', '.join(instead)}"
    worst = _worst(found)
    return f"named, while {worst}" if worst else f"named, and no channel stays more than {_WRONG:g} times off"


def _worst(found: Mapping[str, Any]) -> str:
    level = found.get("level") or {}
    if not level:
        return ""
    channel = max(level, key=lambda name: float(level[name]))
    times = float(level[channel])
    return f"{channel} stays {times:.0f} times off" if times > _WRONG else ""
