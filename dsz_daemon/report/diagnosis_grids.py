"""Small pictures of a diagnosis, one cell a channel: seen against unseen, spectra, whiteness. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.report.diagnosis_channels import Channel
from dsz_daemon.report.diagnosis_figures import AFTER_COLOUR, BEFORE_COLOUR, SIMULATION
from dsz_daemon.report.diagnosis_residuals import Memory, memory, noise_density, spectrum
from dsz_daemon.report.diagnosis_units import real, significant
from dsz_daemon.report.display import Floats, Unit
from dsz_daemon.report.panels import BLACK, PURPLE, RAW, Figure, Trace, bare_axis, label, legend_at, plain_layout

_COLUMNS = 3
_BETWEEN = 0.065
_ROOM_PX = 46
_LEGEND_PX = 20
_SIDES = (("seen", "train"), ("unseen", "held_out"))
_FLOOR = "noise floor"
_FLEXIBLE = "what a model without names reaches"
# Where the low-pass has left a hundredth of an amplitude there is nothing more to read.
_PASSED = 0.01


class Cell(NamedTuple):
    """One small picture: what is over it, its traces, what its axes have beyond the common."""

    title: str
    unit: str
    traces: list[Trace]
    x_axis: dict[str, Any]
    y_axis: dict[str, Any]


def bars_figure(channels: Sequence[Channel]) -> Figure | None:
    """RMS on the data of the fit and on unseen data, before and after, with the floor; None without any number."""
    return _grid([cell for channel in channels if (cell := _bars_cell(channel)) is not None], 108)


def spectra_figure(channels: Sequence[Channel], height_px: int) -> Figure | None:
    """Amplitude density of what is left, before and after, and of the sensor's noise."""
    return _grid([cell for channel in channels if (cell := _spectrum_cell(channel)) is not None], height_px)


def whiteness_figure(channels: Sequence[Channel], height_px: int) -> Figure | None:
    """Autocorrelation of what is left, before and after, with the band that white noise would stay in."""
    return _grid([cell for channel in channels if (cell := _memory_cell(channel)) is not None], height_px)


def _when(channel: Channel) -> list[tuple[str, str, Floats, str]]:
    """(when, name, what is left then, colour): before and after, or the one simulation that there is."""
    if not channel.is_changed:
        return [("before", SIMULATION, channel.before, AFTER_COLOUR)]
    return [("before", "before", channel.before, BEFORE_COLOUR), ("after", "after", channel.after, AFTER_COLOUR)]


def _bars_cell(channel: Channel) -> Cell | None:
    per_si, unit = channel.unit.per_si, channel.unit.label
    traces: list[Trace] = []
    heights: list[float] = []
    two = channel.is_changed
    for when, name, _, colour in _when(channel):
        tall = [per_si * channel.rms(side, when) for _, side in _SIDES]
        if not np.any(np.isfinite(tall)):
            continue
        heights += [height for height in tall if np.isfinite(height)]
        traces.append(
            {
                "type": "bar",
                "name": name,
                "x": [place + (0.0 if not two else -0.2 if when == "before" else 0.2) for place in (0, 1)],
                "y": [height if np.isfinite(height) else None for height in tall],
                "width": 0.36,
                "text": [significant(height, 3) if np.isfinite(height) else "" for height in tall],
                "textposition": "outside",
                "textfont": {"size": 9},
                "textangle": 0,
                "cliponaxis": False,
                "customdata": [name for name, _ in _SIDES],
                "hovertemplate": f"%{{customdata}}, {name}: %{{y:.4~r}} {unit}<extra></extra>",
                "marker": {"color": colour},
            }
        )
    if not traces:
        return None
    flexible = real(channel.fit.get("flexible"))
    for name, value, colour, dash in (
        (_FLOOR, channel.floor, BLACK, "dash"),
        (_FLEXIBLE, flexible, PURPLE, "dot"),
    ):
        # A sensor that is counted, not read, has no white noise to tell of.
        if value > 0.0:
            heights.append(per_si * value)
            traces.append(_line(name, np.array([-0.5, 1.5]), np.full(2, per_si * value), colour, unit, dash))
    ticks = {"tickvals": [0, 1], "ticktext": [name for name, _ in _SIDES], "range": [-0.5, 1.5], "showgrid": False}
    return Cell(channel.title, unit, traces, ticks, {"range": [0.0, 1.22 * max(heights) or 1.0], "nticks": 5})


def _spectrum_cell(channel: Channel) -> Cell | None:
    unit = Unit(f"{channel.unit.label}/√Hz", channel.unit.per_si)
    traces: list[Trace] = []
    lowest = np.inf
    highest_hz = np.sqrt(-2.0 * np.log(_PASSED)) / (2.0 * np.pi * channel.filter_s)
    for _, name, left, colour in _when(channel):
        found = spectrum(channel.time_s, left)
        if found is None:
            continue
        shown = found.frequency_hz <= highest_hz
        density = found.density[shown] * unit.per_si
        traces.append(_line(name, found.frequency_hz[shown], density, colour, unit.label))
        lowest = min(lowest, float(np.min(density[density > 0.0], initial=np.inf)))
    if not traces or not np.isfinite(lowest):
        return None
    frequency_hz = np.asarray(traces[0]["x"], dtype=np.float64)
    if np.isfinite(channel.floor) and channel.floor > 0.0:
        noise = noise_density(frequency_hz, channel.floor, channel.filter_s) * unit.per_si
        traces.append(_line(_FLOOR, frequency_hz, noise, BLACK, unit.label, "dash"))
    highest = max(float(np.max(trace["y"])) for trace in traces)
    decades = [float(np.log10(max(lowest, highest * 1e-5))) - 0.1, float(np.log10(highest)) + 0.15]
    log: dict[str, Any] = {"type": "log", "dtick": 1, "tickfont": {"size": 9}}
    x_axis = log | {"ticksuffix": " Hz", "range": [float(np.log10(edge)) for edge in frequency_hz[[0, -1]]]}
    return Cell(channel.title, unit.label, traces, x_axis, log | {"range": decades, "exponentformat": "power"})


def _memory_cell(channel: Channel) -> Cell | None:
    found = {
        name: (told, colour)
        for _, name, left, colour in _when(channel)
        if (told := memory(channel.time_s, left, channel.filter_s)) is not None
    }
    if not found:
        return None
    first: Memory = next(iter(found.values()))[0]
    outline = np.concatenate([first.white - first.band, (first.white + first.band)[::-1]])
    traces: list[Trace] = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": "white noise behind the low-pass, 95 %",
            "x": _compact(np.concatenate([first.lag_s, first.lag_s[::-1]])),
            "y": _compact(outline),
            "fill": "toself",
            "fillcolor": "rgba(32,36,42,0.13)",
            "line": {"width": 0, "color": RAW},
            "hoverinfo": "skip",
        }
    ]
    traces += [_line(name, told.lag_s, told.found, colour, "") for name, (told, colour) in found.items()]
    x_axis = {"ticksuffix": " s", "range": [0.0, float(first.lag_s[-1])]}
    low = min(-0.35, *(float(np.min(told.found)) - 0.05 for told, _ in found.values()))
    return Cell(channel.title, "", traces, x_axis, {"range": [max(low, -1.05), 1.05], "dtick": 0.5, "zeroline": True})


def _line(name: str, x: Floats, y: Floats, colour: str, unit: str, dash: str = "solid") -> Trace:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": _compact(x),
        "y": _compact(y),
        "line": {"color": colour, "width": 1.6 if colour == AFTER_COLOUR else 1.2, "dash": dash},
        "hovertemplate": f"{name}: %{{y:.3~r}} {unit}".strip() + "<extra></extra>",
    }


def _compact(values: Floats) -> Any:
    return values.astype(np.float32)


def _grid(cells: Sequence[Cell], cell_px: int) -> Figure | None:
    """The cells in rows of three, each with axes of its own, one legend over all; None without a cell."""
    if not cells:
        return None
    rows = -(-len(cells) // _COLUMNS)
    inner_px = rows * cell_px + (rows - 1) * _ROOM_PX
    layout = plain_layout(inner_px) | {"annotations": [], "barmode": "overlay", "hovermode": "closest"}
    layout["margin"] = layout["margin"] | {"t": layout["margin"]["t"] + _LEGEND_PX}
    layout["height"] = inner_px + layout["margin"]["t"] + layout["margin"]["b"]
    # One row up, clear of the cells' own names.
    layout["legend"] = legend_at(1.0 + _LEGEND_PX / inner_px)
    width = (1.0 - (_COLUMNS - 1) * _BETWEEN) / _COLUMNS
    data: list[Trace] = []
    told: set[str] = set()
    for number, cell in enumerate(cells, start=1):
        row, place = divmod(number - 1, _COLUMNS)
        top = 1.0 - row * (cell_px + _ROOM_PX) / inner_px
        left = place * (width + _BETWEEN)
        suffix = "" if number == 1 else str(number)
        x_domain, y_domain = [left, min(left + width, 1.0)], [max(top - cell_px / inner_px, 0.0), top]
        layout[f"xaxis{suffix}"] = bare_axis() | {"domain": x_domain, "anchor": f"y{suffix}"} | cell.x_axis
        layout[f"yaxis{suffix}"] = (
            bare_axis() | {"domain": y_domain, "anchor": f"x{suffix}", "zerolinecolor": "#c9cfd5"} | cell.y_axis
        )
        layout["annotations"].append(label(cell.title, cell.unit, left, top))
        for trace in cell.traces:
            name = str(trace["name"])
            shown = {"showlegend": name not in told, "legendgroup": name}
            data.append(trace | shown | {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"})
            told.add(name)
    return {"data": data, "layout": layout}
