"""What a status answer says that an earlier one did not: how a fault was flagged."""

from __future__ import annotations

from typing import Any

Status = dict[str, Any]
_BUS_COUNTS = ("lost", "dropped", "error_frames", "bus_offs", "outages", "foreign")
_ROLE_COUNTS = ("short", "flagged", "not_a_number", "out_of_range")
_MESSAGE_COUNTS = ("wrong_length", "babbling", "wrong_checksum", "repeated", "wrong_sequence", "lost")
_DOUBTFUL = ("implausible", "doubted")
_OLD_S = 0.3


def flags(before: Status, now: Status | None) -> set[str]:
    """Everything that is worse than before, in words; one word for one kind."""
    if now is None:
        return {"status does not answer"}
    found = set()
    for bus, was in zip(now["buses"], before["buses"], strict=True):
        if bus["link"] != "up":
            found.add(f"link {bus['link']}")
        found |= {f"bus {name}" for name in _BUS_COUNTS if bus[name] > was[name]}
    found |= _decoder_flags(before["decoder"], now["decoder"])
    for name, channel in now["channels"].items():
        if channel["state"] == "invalid":
            found.add(f"{name} invalid: {channel['reason']}")
        elif channel["reason"] != before["channels"][name]["reason"] and channel["reason"] in _DOUBTFUL:
            found.add(f"{name} {channel['reason']}")
    if now["phase"] != before["phase"]:
        found.add(f"phase {now['phase']}")
    for role, value in now["inputs"].items():
        if value["value"] is None or (value["age_s"] or 0.0) > _OLD_S:
            found.add(f"input {role} old")
    for refusal in (now["row"] or {}).get("refused", ()):
        found.add("refused " + " ".join(str(part) for part in refusal.values()))
    known = {(event["time_s"], event["message"]) for event in before["events"]}
    found |= {f"event {event['kind']}" for event in now["events"] if (event["time_s"], event["message"]) not in known}
    if now["state_file"]["problem"]:
        found.add(f"state file: {now['state_file']['problem']}")
    if now["output_refused"]:
        found.add("output refused")
    if now["missed_ticks"] > before["missed_ticks"]:
        found.add("missed ticks")
    if now["reloads"] > before["reloads"]:
        found.add("reloaded")
    return found


def _decoder_flags(before: Status, now: Status) -> set[str]:
    found = {f"frames {name}" for name in ("remote", "ambiguous") if now[name] > before[name]}
    for role, counts in now["roles"].items():
        was = before["roles"].get(role, {})
        found |= {f"{role} {name}" for name in _ROLE_COUNTS if counts[name] > was.get(name, 0)}
    for message, counts in now["messages"].items():
        was = before["messages"].get(message, {})
        found |= {f"{message} {name}" for name in _MESSAGE_COUNTS if counts[name] > was.get(name, 0)}
    return found


def worst_move(before: Status, after: Status | None) -> tuple[float, str, float, float]:
    """(share of the bound, channel, change, bound) where an offset moved most, SI.

    The bound is the 95 % that is stated: twice the spread before and twice the spread now.
    """
    worst = (0.0, "", 0.0, 0.0)
    if after is None:
        return worst
    for name, was in before["channels"].items():
        now = after["channels"][name]
        if None in (was["offset"], now["offset"], was["offset_std"], now["offset_std"]):
            continue
        change = abs(now["offset"] - was["offset"])
        bound = 2.0 * (was["offset_std"] + now["offset_std"])
        share = change / bound if bound > 0.0 else float(change > 0.0)
        if share > worst[0]:
            worst = (share, name, change, bound)
    return worst
