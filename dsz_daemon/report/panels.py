"""Panels on one time axis, stacked into a figure: plain data as plotly.js takes it. Pure.

Colours are Okabe and Ito's (2008), made to be told apart with any colour vision; raw is grey,
so that it also recedes in black and white. Nothing is told by colour alone: legends, hover
text and tables say the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.report.display import PLUS_MINUS, Floats, Unit
from dsz_daemon.report.thinning import Ints, Runs, band, buckets, line, runs

RAW = "#8f959b"
BLUE = "#0072b2"
SKY = "#56b4e9"
GREEN = "#009e73"
ORANGE = "#e69f00"
VERMILION = "#d55e00"
PURPLE = "#cc79a7"
BLACK = "#20242a"
PALE = "#dfe3e7"

Trace = dict[str, Any]
Figure = dict[str, Any]

# All figures share these margins: time stands at the same place down the whole page.
LEFT_PX, RIGHT_PX = 62, 14
_TOP_PX, _BOTTOM_PX, _GAP_PX = 22, 26, 26
_INK, _MUTED, _GRID = "#20242a", "#5b6570", "#eceff2"
_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


class Panel(NamedTuple):
    """One strip of the figure: what is on its y axis, how high, and its traces."""

    label: str
    unit: Unit
    height_px: int
    traces: list[Trace]
    y_range: tuple[float, float] | None = None
    is_log: bool = False
    categories: tuple[str, ...] = ()


def curve(
    name: str,
    time_s: Floats,
    values_si: Floats | None,
    unit: Unit,
    colour: str,
    width: float = 1.2,
    dash: str = "solid",
    spread_si: Floats | None = None,
) -> list[Trace]:
    """Thinned line of values in SI, or nothing when there is none; `spread_si` is told on hover."""
    if values_si is None or not np.any(np.isfinite(values_si)):
        return []
    x, y = line(time_s, values_si * unit.per_si)
    trace: Trace = {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": x,
        "y": y,
        "line": {"color": colour, "width": width, "dash": dash},
        "hovertemplate": f"%{{y:.4~r}} {unit.label}".strip(),
    }
    if spread_si is not None:
        known = np.isfinite(spread_si) & np.isfinite(time_s)
        at_points = np.interp(x, time_s[known], spread_si[known] * unit.per_si)
        trace["customdata"] = at_points.astype(np.float32)
        trace["hovertemplate"] = f"%{{y:.4~r}} {PLUS_MINUS} %{{customdata:.2~r}} {unit.label}"
    return [trace]


def shaded(
    name: str,
    time_s: Floats,
    low_si: Floats,
    high_si: Floats,
    unit: Unit,
    colour: str,
    opacity: float = 0.18,
) -> list[Trace]:
    """Area between two lines."""
    x, y = band(time_s, low_si * unit.per_si, high_si * unit.per_si)
    if not len(x):
        return []
    return [
        {
            "type": "scatter",
            "mode": "lines",
            "name": name,
            "x": x,
            "y": y,
            "fill": "toself",
            "fillcolor": _translucent(colour, opacity),
            "line": {"width": 0, "color": colour},
            "hoverinfo": "skip",
        }
    ]


def level(name: str, time_s: Floats, values_si: Floats, unit: Unit, colour: str, length_s: float) -> list[Trace]:
    """Mean over stretches of `length_s` as a line, least to greatest as an area behind it."""
    found = buckets(time_s, values_si, length_s)
    area = shaded(name, found.middle_s, found.low, found.high, unit, colour, 0.22)
    for trace in area:
        trace |= {"showlegend": False, "legendgroup": name}
    mean = curve(name, found.middle_s, found.mean, unit, colour, 1.4)
    return area + [trace | {"legendgroup": name} for trace in mean]


def strip(name: str, time_s: Floats, codes: Ints, row: str, looks: Sequence[tuple[str, str]]) -> list[Trace]:
    """Bars over time: `looks[code]` is a code's (hover text, colour); colour "" draws nothing."""
    found = runs(time_s, codes)
    return [
        trace
        for colour in dict.fromkeys(colour for _, colour in looks if colour)
        for trace in _bars(name, found, row, looks, colour)
    ]


def _bars(name: str, found: Runs, row: str, looks: Sequence[tuple[str, str]], colour: str) -> list[Trace]:
    mine = np.array([looks[code][1] == colour for code in found.code], dtype=bool)
    if not np.any(mine):
        return []
    return [
        {
            "type": "bar",
            "orientation": "h",
            "name": name,
            "base": found.start_s[mine].astype(np.float32),
            "x": found.length_s[mine].astype(np.float32),
            "y": [row] * int(np.count_nonzero(mine)),
            "width": 0.8,
            "customdata": [looks[code][0] for code in found.code[mine]],
            "hovertemplate": "%{customdata}",
            "marker": {"color": colour, "line": {"width": 0}},
            "showlegend": False,
        }
    ]


def _translucent(colour: str, opacity: float) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity})"


def tight_range(*lines_si: tuple[Floats | None, Unit]) -> tuple[float, float] | None:
    """Range that holds all finite values of the lines, with a margin of 8 %."""
    finite = [v[np.isfinite(v)] * unit.per_si for v, unit in lines_si if v is not None]
    values: NDArray[Any] = np.concatenate(finite) if finite else np.zeros(0)
    if not len(values):
        return None
    low, high = float(np.min(values)), float(np.max(values))
    margin = 0.08 * (high - low) or 0.05 * abs(high) or 1.0
    return low - margin, high + margin


def stacked(
    panels: Sequence[Panel],
    end: float,
    marks_s: Sequence[float] = (),
    start: float = 0.0,
    unit: str = "s",
) -> Figure | None:
    """One figure of the panels that have traces, top down on a common axis from `start` to `end`, in `unit`.

    The axis is time in s, unless it is said otherwise. `marks_s`: times of gaps and clock steps, drawn as dotted
    lines. None when all panels are empty.
    """
    panels = [panel for panel in panels if panel.traces]
    if not panels:
        return None
    inner_px = sum(panel.height_px for panel in panels) + _GAP_PX * (len(panels) - 1)
    layout: dict[str, Any] = _frame(inner_px, (start, end), unit)
    data: list[Trace] = []
    top_px = 0
    for number, panel in enumerate(panels, start=1):
        suffix = "" if number == 1 else str(number)
        top, bottom = 1 - top_px / inner_px, 1 - (top_px + panel.height_px) / inner_px
        layout[f"yaxis{suffix}"] = _y_axis(panel, max(bottom, 0.0), top)
        layout[f"legend{suffix}"] = legend_at(top)
        layout["annotations"].append(_label(panel, top))
        data += [
            {"showlegend": len(panel.traces) > 1}
            | trace
            | {"xaxis": "x", "yaxis": f"y{suffix}", "legend": f"legend{suffix}"}
            for trace in panel.traces
        ]
        top_px += panel.height_px + _GAP_PX
    layout["xaxis"]["anchor"] = f"y{'' if len(panels) == 1 else len(panels)}"
    layout["shapes"] = [_mark(t) for t in marks_s]
    return {"data": data, "layout": layout}


def _frame(inner_px: int, span: tuple[float, float], unit: str) -> dict[str, Any]:
    return plain_layout(inner_px + _TOP_PX + _BOTTOM_PX) | {
        "hovermode": "x unified",
        "hoversubplots": "axis",
        "dragmode": "zoom",
        "barmode": "overlay",
        "bargap": 0,
        "annotations": [],
        "xaxis": bare_axis() | {"range": list(span), "ticksuffix": f" {unit}", "hoverformat": ".2f"},
    }


def plain_layout(height_px: int) -> dict[str, Any]:
    """What every figure's layout begins with: height, the common margins, fonts, no background."""
    return {
        "height": height_px,
        "margin": {"l": LEFT_PX, "r": RIGHT_PX, "t": _TOP_PX, "b": _BOTTOM_PX},
        "font": {"family": _FONT, "size": 11, "color": _MUTED},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "hoverlabel": {"font": {"size": 11, "color": _INK}, "bgcolor": "rgba(255,255,255,0.94)"},
    }


def bare_axis() -> dict[str, Any]:
    """An axis with pale lines and small ticks."""
    return {
        "gridcolor": _GRID,
        "zeroline": False,
        "ticks": "outside",
        "ticklen": 3,
        "tickcolor": _GRID,
        # 10,000 rather than 10k.
        "exponentformat": "none",
        "separatethousands": True,
    }


def _y_axis(panel: Panel, bottom: float, top: float) -> dict[str, Any]:
    axis: dict[str, Any] = {
        "domain": [bottom, top],
        "anchor": "x",
        "gridcolor": _GRID,
        "zeroline": not panel.categories and not panel.is_log,
        "zerolinecolor": "#c9cfd5",
        "zerolinewidth": 1,
        "nticks": max(4, panel.height_px // 15),
        "automargin": False,
    }
    if panel.y_range:
        axis["range"] = list(panel.y_range)
    if panel.is_log:
        axis |= {"type": "log", "dtick": 1, "exponentformat": "e"}
    if panel.categories:
        axis |= {
            "type": "category",
            "categoryorder": "array",
            "categoryarray": list(reversed(panel.categories)),
            "range": [-0.5, len(panel.categories) - 0.5],
            "fixedrange": True,
            "showgrid": False,
            "showticklabels": len(panel.categories) > 1,
        }
    return axis


def legend_at(top: float) -> dict[str, Any]:
    """A legend in one line, over the upper right corner of a panel."""
    return {
        "orientation": "h",
        "x": 1,
        "xanchor": "right",
        "y": top,
        "yanchor": "bottom",
        "font": {"size": 11},
        "bgcolor": "rgba(0,0,0,0)",
        "itemwidth": 30,
    }


def _label(panel: Panel, top: float) -> dict[str, Any]:
    return label(panel.label, panel.unit.label, 0.0, top)


def label(name: str, unit: str, left: float, top: float) -> dict[str, Any]:
    """Name and unit over the upper left corner of a panel; `left` and `top` are shares of the figure."""
    return {
        "text": f"<b>{name}</b>  {unit}" if unit else f"<b>{name}</b>",
        "x": left,
        "xref": "paper",
        "xanchor": "left",
        "y": top,
        "yref": "paper",
        "yanchor": "bottom",
        "showarrow": False,
        "font": {"size": 11, "color": _INK},
    }


def _mark(time_s: float) -> dict[str, Any]:
    return {
        "type": "line",
        "x0": time_s,
        "x1": time_s,
        "xref": "x",
        "y0": 0,
        "y1": 1,
        "yref": "paper",
        "line": {"color": PURPLE, "width": 1, "dash": "dot"},
        "layer": "below",
    }
