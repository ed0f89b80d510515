"""One picture of `dsz monitor`: a daemon's answer and its trend, fitted to the terminal's size."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from rich.console import Group, RenderableType
from rich.text import Text

from dsz_daemon.runs.screen_status import bus_troubles, event_style, event_words
from dsz_daemon.runs.status_words import (
    NOTHING,
    PHASE_STYLES,
    SPREADS_95,
    STATE_STYLES,
    channel_words,
    lateness_words,
    motion_words,
    shown,
    state_file_words,
    uptime_words,
)
from dsz_daemon.runs.trend import BLOCKS, PLAIN_BLOCKS, Trend, bridged, sparkline

# A trend beside its row where there is room for it, else below, else not at all.
_BESIDE_COLUMNS = 120
_BELOW_ROWS = 22
_ROW_COLUMNS = 80
_HEAD = "channel      unit       raw compensated  offset +- 95 % state     held because"


class Size(NamedTuple):
    """The terminal's, and whether it can show block characters."""

    columns: int
    rows: int
    has_blocks: bool = True


def picture(answer: dict[str, Any] | None, trend: Trend, problem: str, where: str, size: Size) -> RenderableType:
    """The whole screen. `problem` says why no answer comes at present; the last one stays, dimmed."""
    lines = [_title(where, size)]
    if problem:
        lines.append(_line(f"waiting: {problem}", "bold yellow"))
    if answer is None:
        return Group(*lines)
    if not problem:
        lines.append(_line(answer["summary"], PHASE_STYLES.get(answer["phase"], "")))
    body = [
        _line(uptime_words(answer)),
        _line(f"motion: {motion_words(answer['motion'])}"),
        *_channels(answer["channels"], trend, size),
        *(_bus(bus, trend) for bus in answer["buses"]),
        _line(f"ticks: {lateness_words(answer)}"),
        _line(_counts(answer)),
        _line(f"offsets kept: {state_file_words(answer['state_file'])}"),
    ]
    if problem:
        for line in body:
            line.stylize("dim")
    lines += body
    room = max(0, size.rows - len(lines))
    newest_first = answer["events"][::-1][:room]
    lines += [_line(event_words(event), event_style(event)) for event in newest_first]
    if not size.has_blocks:
        for line in lines:
            # The ellipsis is no ASCII either.
            line.overflow = "crop"
    return Group(*lines[: size.rows])


def _title(where: str, size: Size) -> Text:
    title, keys = f"dsz monitor {where}", "q ends"
    return _line(f"{title}{' ' * max(1, size.columns - len(title) - len(keys))}{keys}", "reverse")


def _line(words: str, style: str = "") -> Text:
    return Text(words, style=style, no_wrap=True, overflow="ellipsis")


def _channels(channels: dict[str, Any], trend: Trend, size: Size) -> Iterator[Text]:
    beside = size.columns >= _BESIDE_COLUMNS
    below = not beside and size.rows >= _BELOW_ROWS
    yield _line(f"{_HEAD}{'       offset over the last minute' if beside else ''}", "bold")
    for name, channel in channels.items():
        row, style = channel_words(name, channel), STATE_STYLES.get(channel["state"], "")
        line = _line(
            f"{row.name:<12} {row.unit:<5} {row.raw:>8} {row.compensated:>11} {row.offset:>7} {row.spread:>7} "
        )
        line.append(f"{row.state:<9} ", style).append(row.why)
        if beside:
            line.pad_right(max(0, _ROW_COLUMNS + 3 - len(line)))
            line.append(_trend(name, channel, trend, size.columns - _ROW_COLUMNS - 3, size), style)
        yield line
        if below:
            yield _line(" " * 13 + _trend(name, channel, trend, size.columns - 13, size), style)


def _trend(name: str, channel: dict[str, Any], trend: Trend, columns: int, size: Size) -> str:
    """The offset's last minute and between which values it lay."""
    unit, std = channel["unit"], channel["offset_std"]
    columns -= len(" -00.000 .. -00.000")
    values = bridged(trend.offsets(name, max(1, columns)))
    known = [value for value in values if value is not None]
    if not known:
        return ""
    line = sparkline(values, 2.0 * SPREADS_95 * (std or 0.0), BLOCKS if size.has_blocks else PLAIN_BLOCKS)
    return f"{line} {shown(min(known), unit)} .. {shown(max(known), unit)}"


def _bus(bus: dict[str, Any], trend: Trend) -> Text:
    load = trend.load(bus["name"])
    rates = f"{NOTHING} in, {NOTHING} out" if load is None else f"{load[0]:.0f} in, {load[1]:.0f} out"
    line = _line(f"bus {bus['name']} ({bus['interface']}) ")
    line.append(bus["link"].replace("_", " "), "green" if bus["link"] == "up" else "bold red")
    troubles = bus_troubles(bus)
    return line.append(f", frames/s: {rates}{'; ' if troubles else ''}{troubles}")


def _counts(answer: dict[str, Any]) -> str:
    counters = answer["row"]["counters"] if answer["row"] else {}
    seen = ", ".join(f"{counters[name]} {name.replace('_', ' ')}" for name in counters)
    refused = "; OUTPUT REFUSED: another sender uses our ids" if answer["output_refused"] else ""
    return f"seen: {seen or NOTHING}{refused}"


def text_lines(answer: dict[str, Any]) -> Iterator[str]:
    """One answer for a pipe: a line a channel, in columns of their own (`TEXT_HEAD`)."""
    for name, channel in answer["channels"].items():
        row = channel_words(name, channel)
        words = (
            f"{answer['time_s']:.3f}",
            answer["phase"],
            name,
            *(row.raw, row.compensated, row.offset, row.spread, row.unit, row.state),
            channel["reason"],
        )
        yield " ".join(words)


TEXT_HEAD = "# time_s phase channel raw compensated offset plus_minus_95 unit state reason"
