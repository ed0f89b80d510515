"""`dsz status`: the whole answer of a running daemon as tables."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from dsz_daemon.runs.status_words import (
    NOTHING,
    PHASE_STYLES,
    STATE_STYLES,
    ago,
    channel_words,
    lateness_words,
    motion_words,
    shown,
    shown_unit,
    state_file_words,
    uptime_words,
)

_PRIORITY_STYLES = {"error": "red", "warning": "yellow"}
# In a pipe nothing is folded or cut.
_PIPE_WIDTH = 160
_UNSIGNED = frozenset({"1", "m/s"})


def print_status(answer: dict[str, Any]) -> None:
    """The tables on standard output."""
    console = Console(width=None if sys.stdout.isatty() else _PIPE_WIDTH, highlight=False)
    with console.capture() as captured:
        console.print(status_screen(answer))
    # Not printed by rich, which would end the process with 1 where the reader of a pipe went away.
    print("\n".join(line.rstrip() for line in captured.get().splitlines()))


def status_screen(answer: dict[str, Any]) -> RenderableType:
    """Everything that the answer says, for any console."""
    version = answer["versions"].get("dsz-daemon", "?")
    return Group(
        Text(answer["summary"], style=PHASE_STYLES.get(answer["phase"], "")),
        Text(f"{uptime_words(answer)}; dsz {version}, process {answer['pid']}, {answer['config']}"),
        Text(),
        _channels(answer["channels"]),
        Text(),
        _inputs(answer["inputs"], answer["decoder"]["roles"]),
        Text(),
        _messages(answer["decoder"]["messages"]),
        Text(),
        _buses(answer["buses"]),
        Text(),
        _facts(answer),
        *_events(answer["events"]),
    )


def _table(heads: str, left: int = 1) -> Table:
    """A plain table; the first `left` columns are words, the others are numbers."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for n, head in enumerate(heads.split("|")):
        table.add_column(head, justify="left" if n < left else "right", overflow="fold")
    return table


def _channels(channels: dict[str, Any]) -> Table:
    table = _table("channel|unit|raw|compensated|offset|+- 95 %", left=2)
    # It must fit 80 columns.
    table.collapse_padding = True
    table.add_column("state")
    table.add_column("held because")
    for name, channel in channels.items():
        row = channel_words(name, channel)
        state = Text(row.state, style=STATE_STYLES.get(row.state, ""))
        words = (row.name, row.unit, row.raw, row.compensated, row.offset, row.spread)
        table.add_row(*(Text(word) for word in words), state, Text(row.why))
    return table


def _inputs(inputs: dict[str, Any], counted: dict[str, Any]) -> Table:
    table = _table("input|unit|value|age|samples|refused", left=2)
    table.add_column("of which")
    for role, given in inputs.items():
        counts = dict(counted.get(role, {}))
        samples, rejected = counts.pop("samples", 0), counts.pop("rejected", 0)
        kinds = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in counts.items() if n)
        value = shown(given["value"], given["unit"], sign=given["unit"] not in _UNSIGNED)
        words = (role, shown_unit(given["unit"]), value, ago(given["age_s"]))
        table.add_row(*(Text(word) for word in words), str(samples), str(rejected), Text(kinds))
    return table


def _messages(messages: dict[str, Any]) -> Table:
    table = _table("message|bus|frames|age|refused", left=2)
    table.add_column("counted")
    for name, counts in messages.items():
        others = {key: n for key, n in counts.items() if key not in _MESSAGE_COLUMNS and n}
        words = (name, counts["channel"] or NOTHING, str(counts["frames"]), ago(counts["age_s"]))
        table.add_row(*(Text(word) for word in words), str(counts["refused"]), Text(_counted(others)))
    return table


def _buses(buses: list[dict[str, Any]]) -> RenderableType:
    table = _table("bus|interface|link|stamps|in/s|out/s|received|sent", left=4)
    for bus in buses:
        link = Text(bus["link"].replace("_", " "), style="green" if bus["link"] == "up" else "bold red")
        rates = (bus["mean_received_per_s"], bus["mean_sent_per_s"])
        in_out = (NOTHING if rate is None else f"{rate:.0f}" for rate in rates)
        row = (bus["name"], bus["interface"], link, bus["stamps"], *in_out, str(bus["received"]), str(bus["sent"]))
        table.add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in row))
    troubles = ((bus["name"], bus_troubles(bus)) for bus in buses)
    return Group(table, *(Text(f"{name}: {words}") for name, words in troubles if words))


# Shown in columns of their own, or derived.
_MESSAGE_COLUMNS = frozenset({"channel", "frames", "age_s", "refused"})
_BUS_COLUMNS = frozenset({"name", "interface", "link", "stamps", "received", "sent", "last_error"})


def bus_troubles(bus: dict[str, Any]) -> str:
    """What else was counted on a bus and is not 0, and its last error.

    >>> bus_troubles({"received": 5, "lost": 2, "dropped": 0, "last_error": "ENOBUFS"})
    'lost 2; ENOBUFS'
    """
    counts = {key: n for key, n in bus.items() if key not in _BUS_COLUMNS and not key.startswith("mean_") and n}
    words = ", ".join(f"{key.replace('_', ' ')} {n}" for key, n in counts.items())
    return "; ".join(part for part in (words, bus.get("last_error", "")) if part)


def _facts(answer: dict[str, Any]) -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, words in _fact_words(answer):
        table.add_row(name, Text(words))
    return table


def _fact_words(answer: dict[str, Any]) -> Iterator[tuple[str, str]]:
    yield "motion", motion_words(answer["motion"])
    yield "ticks", lateness_words(answer)
    decoder, row = answer["decoder"], answer["row"] or {"counters": {}, "refused": []}
    yield "frames", _counted({key: n for key, n in decoder.items() if isinstance(n, int)})
    yield "loop", _counted(row["counters"]) or NOTHING
    if row["refused"]:
        yield "just refused", ", ".join(f"{refused['role']} ({refused['why']})" for refused in row["refused"])
    saturated = _counted(answer["encoder"]["saturated"])
    refused = "; refused, another sender uses our ids" if answer["output_refused"] else ""
    yield "output", f"{answer['encoder']['rows']} rows; beyond their range: {saturated or 'none'}{refused}"
    yield "offsets kept", state_file_words(answer["state_file"])


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in counts.items())


def _events(events: list[dict[str, Any]]) -> Iterator[RenderableType]:
    if events:
        yield Text("\nlast events", style="bold")
        yield from (Text(event_words(event), style=event_style(event), overflow="fold") for event in events)


def event_words(event: dict[str, Any]) -> str:
    """One event: how long ago, how bad, what."""
    when = NOTHING if event["age_s"] is None else f"{ago(event['age_s'])} ago"
    return f"{when:>14}  {event['priority']}: {event['message']}"


def event_style(event: dict[str, Any]) -> str:
    """The colour of its line."""
    return _PRIORITY_STYLES.get(event["priority"], "")
