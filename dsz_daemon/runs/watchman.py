"""What is worth saying of a running daemon: the difference between two looks at it, in words."""

from __future__ import annotations

from typing import NamedTuple

from dsz_daemon.core.outputs import Reason
from dsz_daemon.edge.health import BusHealth, Link
from dsz_daemon.edge.journal import Priority
from dsz_daemon.runs.facts import LiveFacts
from dsz_daemon.signals import IMU_CHANNELS

_LINK_WORDS = {
    Link.UP: "is up",
    Link.DOWN: "is down: nothing is received or sent until it comes up again",
    Link.ABSENT: "is not there: waiting for it",
    Link.BUS_OFF: "is bus-off: the controller has taken itself off the bus; `restart-ms` brings it back",
    Link.ERROR_PASSIVE: "is error-passive: many errors on the bus",
}


class News(NamedTuple):
    """One thing to say."""

    priority: Priority
    kind: str
    message: str
    bus: str = ""


class Seen(NamedTuple):
    """What was known at the last look. Plain values: facts hold objects that go on living."""

    phase: str
    links: dict[str, Link]
    counts: dict[tuple[str, str], int]
    output_refused: bool
    doubted: tuple[str, ...] = ()


def seen(facts: LiveFacts) -> Seen:
    """What the next look is compared with."""
    counts: dict[tuple[str, str], int] = {("", "missed_ticks"): facts.missed_ticks}
    for health in facts.buses:
        for name in ("lost", "dropped", "error_frames", "foreign"):
            counts[health.name, name] = getattr(health, name)
    for name, message in facts.decoder.messages.items():
        for fault in ("wrong_checksum", "repeated", "lost", "babbling"):
            counts[name, fault] = getattr(message, fault, 0)
    for role, values in facts.decoder.roles.items():
        counts[role, "out_of_range"] = values.out_of_range
    links = {health.name: health.link for health in facts.buses}
    return Seen(facts.phase, links, counts, facts.output_refused, _doubted(facts))


def _doubted(facts: LiveFacts) -> tuple[str, ...]:
    if facts.row is None:
        return ()
    channels = zip(IMU_CHANNELS, facts.row.output.channels, strict=True)
    # A list first: see runs/status of tuples of unknown length.
    return tuple([name for name, channel in channels if channel.reason is Reason.DOUBTED])


def news(before: Seen | None, facts: LiveFacts) -> list[News]:
    """What has changed since the look before (None: since nothing was known)."""
    now = seen(facts)
    found = [_link_news(health) for health in facts.buses if _link_changed(before, health)]
    if before is not None and before.phase != now.phase:
        found.append(_phase_news(now.phase))
    known = before.counts if before is not None else {}
    for (where, what), count in now.counts.items():
        more = count - known.get((where, what), 0)
        if more > 0 and what in _COUNT_WORDS:
            found.append(News(Priority.WARNING, what, _COUNT_WORDS[what].format(n=more, where=where)))
    doubted = sorted(set(now.doubted) - set(before.doubted if before is not None else ()))
    if doubted:
        message = (
            f"{', '.join(doubted)}: the car stands, but the reading leapt away from the learnt offset, which is held"
        )
        found.append(News(Priority.WARNING, "doubted", message))
    if now.output_refused and not (before is not None and before.output_refused):
        message = "messages whose ids somebody else sends are held back; see output.on_conflict"
        found.append(News(Priority.ERROR, "output_refused", message))
    if before is not None and before.output_refused and not now.output_refused:
        found.append(News(Priority.NOTICE, "output_again", "nobody else sends our ids any more: publishing all again"))
    return found


_COUNT_WORDS = {
    "lost": "{n} frames of {where} were lost before they could be read",
    "dropped": "{n} of our frames were not taken by {where}",
    "error_frames": "{n} errors on {where}",
    "foreign": "{n} frames with our own ids on {where} were sent by somebody else",
    "missed_ticks": "{n} ticks were late and not published",
    "wrong_checksum": "{where}: {n} frames with a wrong checksum were refused",
    "repeated": "{where}: {n} frames repeated an old counter and were refused",
    "out_of_range": "{where}: {n} values out of range were refused (a sensor that clips, is torn off or shorted?)",
    "babbling": "{where}: {n} frames came faster than input_rate_limit_hz and were refused",
}


def _link_changed(before: Seen | None, health: BusHealth) -> bool:
    if before is None:
        return health.link is not Link.UP
    return before.links.get(health.name) is not health.link


def _link_news(health: BusHealth) -> News:
    priority = Priority.NOTICE if health.link is Link.UP else Priority.WARNING
    message = f"bus {health.name}: {health.interface} {_LINK_WORDS[health.link]}"
    return News(priority, f"link_{health.link.value}", message, health.name)


def _phase_news(phase: str) -> News:
    if phase == "running":
        return News(Priority.NOTICE, "running", "input comes: running")
    if phase == "silent":
        return News(Priority.WARNING, "silent", "no wanted frame comes any more: saying so on the bus, and waiting")
    return News(Priority.NOTICE, "waiting", "waiting for frames")
