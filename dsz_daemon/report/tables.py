"""The table of the page: one row per channel, from where it started to where it came. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from dsz_daemon.report.display import (
    ARROW,
    CHANNEL_WORDS,
    NOTHING,
    PLUS_MINUS,
    SIGMA,
    SPREADS_95,
    Floats,
    Samples,
    channel_column,
    channel_unit,
    number,
    percent,
    spread,
    words,
)
from dsz_daemon.report.markup import element
from dsz_daemon.report.results import ChannelResult, Level, column
from dsz_daemon.report.thinning import extreme_indices
from dsz_daemon.signals import GYRO_CHANNELS

_SPARK_WIDTH, _SPARK_HEIGHT, _SPARK_POINTS = 90, 20, 160


class _Column(NamedTuple):
    """One column of the results: two lines of heading, and whether it was asked for."""

    group: str
    heading: str
    is_shown: bool = True


def channel_table(results: Sequence[ChannelResult], samples: Samples) -> Element:
    """One row per channel, rates first; columns that no channel can fill are left out."""
    columns = _channel_columns(results)
    shown = [c.is_shown for c in columns]
    bodies = [
        element("tbody", _unit_row(group, sum(shown)), *(_channel_row(r, samples, shown) for r in group))
        for group in (
            [r for r in results if r.channel in GYRO_CHANNELS],
            [r for r in results if r.channel not in GYRO_CHANNELS],
        )
        if group
    ]
    return element("table", _heading(columns), *bodies, class_="results")


def _channel_columns(results: Sequence[ChannelResult]) -> list[_Column]:
    has_truth = any(np.isfinite(r.true_offset) for r in results)
    has_error = any(r.error for r in results)
    has_reference = any(r.difference for r in results)
    change = f"raw {ARROW} compensated"
    return [
        _Column("", "channel"),
        _Column("", "at the end"),
        _Column("offset", f"final, {PLUS_MINUS} 2{SIGMA} (95 %)"),
        _Column("offset", "true", has_truth),
        _Column("offset", "error", has_truth),
        _Column("offset", f"error/{SIGMA}", has_truth),
        _Column("offset", "over time"),
        _Column("learning", "share of time"),
        _Column("learning", "converged after, s"),
        _Column(change, "mean"),
        _Column(change, "RMS"),
        _Column(change, "RMS error", has_error),
        _Column(change, "mean minus ref.", has_reference),
    ]


def _heading(columns: Sequence[_Column]) -> Element:
    shown = [c for c in columns if c.is_shown]
    groups: list[tuple[str, int]] = []
    for c in shown:
        if groups and groups[-1][0] == c.group:
            groups[-1] = (c.group, groups[-1][1] + 1)
        else:
            groups.append((c.group, 1))
    top = [element("th", name, colspan=str(n), scope="colgroup", class_="named" if name else "") for name, n in groups]
    second = [element("th", c.heading, scope="col") for c in shown]
    return element("thead", element("tr", *top, class_="groups"), element("tr", *second))


def _unit_row(group: Sequence[ChannelResult], width: int) -> Element:
    unit = channel_unit(group[0].channel).label
    return element("tr", element("th", f"in {unit}", colspan=str(width)), class_="unit")


def _channel_row(result: ChannelResult, samples: Samples, shown: Sequence[bool]) -> Element:
    per_si = channel_unit(result.channel).per_si
    cells = [
        element(
            "th",
            element("a", element("code", result.channel), href=f"#{result.channel}"),
            " ",
            CHANNEL_WORDS[result.channel],
            scope="row",
        ),
        element("td", *_state(result), class_="state"),
        element("td", *_with_spread(result, per_si), class_="main"),
        element("td", number(result.true_offset * per_si, sign=True)),
        element("td", number(result.offset_error * per_si, sign=True)),
        element("td", number(result.error_in_spreads, 1, sign=True)),
        element("td", *_spark(result.channel, samples), class_="spark"),
        element("td", percent(result.gate_share)),
        element("td", number(result.converged_after_s, 1)),
        _change(result.level, per_si, "mean", sign=True),
        _change(result.level, per_si, "rms"),
        _change(result.error, per_si, "rms"),
        _change(result.difference, per_si, "mean", sign=True),
    ]
    return element("tr", *(cell for cell, keep in zip(cells, shown, strict=True) if keep))


def _state(result: ChannelResult) -> list[str | Element]:
    why = "" if result.reason in ("", "none") else f", {words(result.reason)}"
    marked = element("i", class_=f"dot {result.state}") if result.state.isalpha() else ""
    return [marked, f"{result.state or NOTHING}", element("small", why)]


def _with_spread(result: ChannelResult, per_si: float) -> list[str | Element]:
    value = number(result.offset * per_si, sign=True)
    if not np.isfinite(result.offset):
        return [value]
    return [value, " ", element("span", spread(SPREADS_95 * result.offset_std * per_si), class_="spread")]


def _change(level: Level | None, per_si: float, what: str, sign: bool = False) -> Element:
    if level is None or not np.isfinite(level.raw_mean):
        return element("td", NOTHING)
    before, after = (
        (level.raw_mean, level.compensated_mean) if what == "mean" else (level.raw_rms, level.compensated_rms)
    )
    old = element("span", number(before * per_si, sign=sign), class_="old")
    return element("td", old, f" {ARROW} {number(after * per_si, sign=sign)}")


def _spark(channel: str, samples: Samples) -> list[Element]:
    """Draw the offset over the run, small, scaled to itself: the shape of its settling."""
    offset = column(samples, channel_column(channel, "offset"))
    if offset is None:
        return []
    index = np.flatnonzero(np.isfinite(offset))
    index = index[extreme_indices(offset[index], _SPARK_POINTS)]
    # The first column has the time of every row; rows come at a fixed rate, so they serve.
    x = 1.0 + (_SPARK_WIDTH - 2.0) * index / max(len(offset) - 1, 1)
    y = _scaled(offset[index])
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    line = element("polyline", points=points)
    end = element("circle", cx=f"{x[-1]:.1f}", cy=f"{y[-1]:.1f}", r="1.6")
    size = {"width": str(_SPARK_WIDTH), "height": str(_SPARK_HEIGHT)}
    return [element("svg", line, end, viewBox=f"0 0 {_SPARK_WIDTH} {_SPARK_HEIGHT}", role="img", **size)]


def _scaled(values: Floats) -> Floats:
    low, high = float(np.min(values)), float(np.max(values))
    if high == low:
        return np.full(len(values), _SPARK_HEIGHT / 2)
    return 2.0 + (_SPARK_HEIGHT - 4.0) * (high - values) / (high - low)
