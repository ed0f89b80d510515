"""RMS errors as bars: rates on the left, accelerations on the right, each in its own unit. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dsz_daemon.report.display import CHANNEL_WORDS, Floats, Samples, channel_column, channel_unit, number
from dsz_daemon.report.panels import BLUE, RAW, SKY, Figure, Trace, bare_axis, label, legend_at, plain_layout
from dsz_daemon.report.results import NAN, ChannelResult, column, truth_at
from dsz_daemon.signals import ACCEL_CHANNELS, GYRO_CHANNELS

_HEIGHT_PX = 230
_HALVES = ((GYRO_CHANNELS, "rates", "", 0.0, 0.48), (ACCEL_CHANNELS, "accelerations", "2", 0.52, 1.0))


def offset_error_rms(channel: str, samples: Samples, truth: Samples) -> float:
    """RMS of estimated minus true offset over the run, SI; NaN where either is not known."""
    true = truth_at(samples, truth, channel_column(channel, "offset"))
    offset = column(samples, channel_column(channel, "offset"))
    return NAN if true is None or offset is None else _rms(offset - true)


def rms_bars(results: Sequence[ChannelResult], samples: Samples, truth: Samples) -> Figure | None:
    """RMS error of each channel: raw, compensated, and that of its offset alone. None without any error."""
    data: list[Trace] = []
    layout = plain_layout(_HEIGHT_PX) | {
        "barmode": "group",
        "bargap": 0.28,
        "bargroupgap": 0.06,
        "annotations": [],
        "legend": legend_at(1.0),
    }
    for channels, what, suffix, left, right in _HALVES:
        known = [(r, r.error) for r in results if r.channel in channels and r.error is not None]
        if not known:
            continue
        unit = channel_unit(known[0][0].channel)
        bars = {
            "raw": (RAW, [error.raw_rms for _, error in known]),
            "compensated": (BLUE, [error.compensated_rms for _, error in known]),
            "offset alone": (SKY, [offset_error_rms(r.channel, samples, truth) for r, _ in known]),
        }
        names = [CHANNEL_WORDS[r.channel] for r, _ in known]
        for name, (colour, heights_si) in bars.items():
            heights = [unit.per_si * height for height in heights_si]
            if any(np.isfinite(heights)):
                data.append(_bars(name, names, heights, unit.label, colour, suffix))
        top = max(height for _, heights in bars.values() for height in heights if np.isfinite(height)) * unit.per_si
        layout[f"xaxis{suffix}"] = bare_axis() | {"domain": [left, right], "anchor": f"y{suffix}", "fixedrange": True}
        layout[f"yaxis{suffix}"] = bare_axis() | {
            "anchor": f"x{suffix}",
            "range": [0.0, 1.15 * top or 1.0],
            "nticks": 6,
            "fixedrange": True,
        }
        layout["annotations"].append(label(what, unit.label, left, 1.0))
    return {"data": _told_once(data), "layout": layout} if data else None


def _bars(name: str, channels: list[str], heights: list[float], unit: str, colour: str, suffix: str) -> dict[str, Any]:
    return {
        "type": "bar",
        "name": name,
        "x": channels,
        "y": [None if not np.isfinite(h) else h for h in heights],
        "text": [number(h) for h in heights],
        "textposition": "outside",
        "textfont": {"size": 10},
        "textangle": 0,
        "cliponaxis": False,
        "hovertemplate": f"%{{x}}, {name}: %{{y:.4~r}} {unit}<extra></extra>",
        "marker": {"color": colour},
        "legendgroup": name,
        "xaxis": f"x{suffix}",
        "yaxis": f"y{suffix}",
    }


def _told_once(data: list[Trace]) -> list[Trace]:
    """The same traces, each name once in the legend."""
    seen: set[str] = set()
    told = []
    for trace in data:
        told.append(trace | {"showlegend": trace["name"] not in seen})
        seen.add(trace["name"])
    return told


def _rms(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else NAN
