"""The picture of one IMU channel: reading, error, offset with its spread, gate. Pure."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.report.display import (
    BARE,
    MINUS,
    PLUS_MINUS,
    SIGMA,
    SPREADS_95,
    Floats,
    Samples,
    channel_column,
    channel_unit,
    words,
)
from dsz_daemon.report.panels import (
    BLUE,
    GREEN,
    PALE,
    PURPLE,
    RAW,
    VERMILION,
    Figure,
    Panel,
    Trace,
    curve,
    level,
    shaded,
    stacked,
    strip,
    tight_range,
)
from dsz_daemon.report.results import column, seconds, truth_at
from dsz_daemon.report.thinning import Ints, bucket_length_s
from dsz_daemon.signals import QUANTITIES, REFERENCE_OF

_MOST_MARKS = 50
# The first quarter is left out when the offset's axis is scaled: the spread starts wide.
_SETTLED_FROM = 0.25


def marks_s(samples: Samples) -> list[float]:
    """Times of gaps and clock steps, at most 50 of them."""
    events = samples.get("event")
    if events is None:
        return []
    times = seconds(samples)[np.isin(events.astype(str), ("gap", "clock_step"))]
    return [float(t) for t in times[np.isfinite(times)][:_MOST_MARKS]]


def duration_s(samples: Samples) -> float:
    """Seconds from the first row to the latest; never 0, so that an axis has a length."""
    return max(float(np.nanmax(seconds(samples))), 1e-3)


def channel_figure(channel: str, samples: Samples, truth: Samples | None) -> Figure | None:
    """Raw against compensated, what is left against truth or reference, offset, gate strip."""
    time_s, unit = seconds(samples), channel_unit(channel)
    raw, compensated = (column(samples, channel_column(channel, what)) for what in ("raw", ""))
    name, against = _comparison(channel, samples, truth)
    signal = [
        *curve("raw", time_s, raw, unit, RAW),
        *curve("compensated", time_s, compensated, unit, BLUE),
        *curve(name, time_s, against, unit, VERMILION, 1.0),
    ]
    rest = []
    if against is not None and raw is not None and compensated is not None:
        length_s = bucket_length_s(duration_s(samples))
        rest = [
            *level(f"raw {MINUS} {name}", time_s, raw - against, unit, RAW, length_s),
            *level(f"compensated {MINUS} {name}", time_s, compensated - against, unit, BLUE, length_s),
        ]
    panels = [
        Panel("reading", unit, 170, signal),
        Panel("error" if name == "truth" else "difference", unit, 100, rest),
        _offset_panel(channel, samples, truth),
        Panel("learning", BARE, 16, gate_strip(channel, samples, time_s, "gate"), categories=("gate",)),
    ]
    return stacked(panels, duration_s(samples), marks_s(samples))


def _comparison(channel: str, samples: Samples, truth: Samples | None) -> tuple[str, Floats | None]:
    true = truth_at(samples, truth, channel_column(channel))
    if true is not None:
        return "truth", true
    role = REFERENCE_OF[channel]
    return words(role), column(samples, f"{role}_{QUANTITIES[channel].suffix}")


def _offset_panel(channel: str, samples: Samples, truth: Samples | None) -> Panel:
    time_s, unit = seconds(samples), channel_unit(channel)
    offset = column(samples, channel_column(channel, "offset"))
    std = column(samples, channel_column(channel, "offset_std"))
    true = truth_at(samples, truth, channel_column(channel, "offset"))
    if offset is None:
        return Panel("offset", unit, 0, [])
    traces: list[Trace] = []
    settled: Floats | None = None
    spread_si: Floats | None = None
    if std is not None:
        spread_si = SPREADS_95 * std
        low, high = offset - spread_si, offset + spread_si
        traces += shaded(f"{PLUS_MINUS} 2{SIGMA}", time_s, low, high, unit, BLUE)
        settled = np.r_[low, high][np.tile(time_s >= _SETTLED_FROM * duration_s(samples), 2)]
    traces += curve("offset", time_s, offset, unit, BLUE, 1.4, spread_si=spread_si)
    traces += curve("true offset", time_s, true, unit, VERMILION, 1.2, "dash")
    y_range = tight_range((offset, unit), (settled, unit), (true, unit))
    return Panel("offset", unit, 110, traces, y_range)


def gate_strip(channel: str, samples: Samples, time_s: Floats, row: str) -> list[Trace]:
    """Green while the offset learns, pale while it is held, purple while there is no valid input.

    `row` is the panel's category that the strip is drawn in; `time_s` shape (rows,).
    """
    gate, reasons, states = (samples.get(f"{channel}_{what}") for what in ("gate", "reason", "state"))
    if gate is None:
        return []
    blank = np.full(len(gate), "", dtype=object)
    reasons = blank if reasons is None else reasons
    states = blank if states is None else states
    codes, looks = _coded(gate, states, reasons)
    return strip("learning", time_s, codes, row, looks)


def _coded(*columns: NDArray[Any]) -> tuple[Ints, list[tuple[str, str]]]:
    """Code each kind of row (gate, state, reason) by its first occurrence, with its text and colour."""
    changes = np.any([column[1:] != column[:-1] for column in columns], axis=0)
    # Only where something changes: words are slow to look at, and seldom change.
    starts = np.flatnonzero(np.concatenate([[True], changes]))
    known: dict[tuple[Any, ...], int] = {}
    kinds = zip(*(column[starts].tolist() for column in columns), strict=True)
    codes = np.array([known.setdefault(kind, len(known)) for kind in kinds], dtype=np.int64)
    lengths = np.diff(np.concatenate([starts, [len(columns[0])]]))
    return np.repeat(codes, lengths), [_gate_look(*kind) for kind in known]


def _gate_look(gate: bool, state: str, reason: str) -> tuple[str, str]:
    why = "" if reason in ("", "none") else f": {words(reason)}"
    if state == "invalid":
        return f"invalid{why}", PURPLE
    if gate:
        return f"yes ({state})" if state else "yes", GREEN
    return f"no{why}", PALE
