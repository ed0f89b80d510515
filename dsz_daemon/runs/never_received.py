"""Signals that are mapped and of which nothing came: what came in their place."""

from __future__ import annotations

from dsz_daemon.pipeline.decode_counters import DecodeCounters
from dsz_daemon.runs.setup import Setup


def never_received(setup: Setup, decoded: DecodeCounters) -> dict[str, str]:
    """Why there is no sample, for each mapped role that has none, in alphabetical order.

    Values or frames that were all refused; else no frame, with what looks like its frames: the id's number in the
    other width (11 or 29 bits), or on a channel that the configuration does not name.
    """
    resolved = setup.checked.resolved
    message_of = {source.role: source.message for source in resolved.sources}
    found = {}
    for role in sorted(setup.roles):
        counts, name = decoded.roles[role], message_of[role]
        if counts.samples:
            continue
        message = decoded.messages[name]
        if counts.rejected:
            found[role] = f"{counts.rejected} values, all refused"
        elif message.refused:
            found[role] = f"{message.refused} frames of {name}, all refused"
        else:
            near = message.near_misses(resolved.messages[name].is_extended_frame)
            found[role] = "; ".join(["no frame of it", *near])
    return found


def hints(setup: Setup, decoded: DecodeCounters) -> str:
    """What came in place of messages that never came, as the rest of a sentence; empty where nothing did."""
    found = [
        f"; {name}: {words}"
        for name, message in setup.checked.resolved.messages.items()
        if not decoded.messages[name].frames
        for words in decoded.messages[name].near_misses(message.is_extended_frame)
    ]
    return "".join(found)
