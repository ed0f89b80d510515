"""The pictures of a simulated drive, of its truth alone: the way from above, over time, over distance. Pure."""

from __future__ import annotations

from typing import Any

import numpy as np

from dsz_daemon.report.display import (
    ACCELERATION,
    BARE,
    DEGREE,
    DEGREE_PER_SECOND,
    FORCE,
    METRE,
    SPEED,
    Floats,
    Samples,
    Unit,
)
from dsz_daemon.report.panels import (
    BLACK,
    BLUE,
    ORANGE,
    PALE,
    RAW,
    VERMILION,
    Figure,
    Panel,
    Trace,
    bare_axis,
    curve,
    plain_layout,
    stacked,
)
from dsz_daemon.report.results import column, seconds

# A page is about 1100 pixels wide, marks are 4 pixels: so many of them look like one line.
_MARKS = 2500
_WIDTH_PX, _LEAST_PX, _MOST_PX = 1040, 170, 620
# The times written along the way: the first step that needs no more of them than this.
_MOST_TIMES = 14
_TIME_STEPS_S = (10.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0)
# Names closer than this share of the picture would be written over each other.
_APART = 0.045
_LEAST_WAY_M = 5.0
_GRID_POINTS = 2000


def path_figure(truth: Samples) -> Figure | None:
    """The way from above, east to the right and north up, equal scales, coloured by speed; None: it stood still."""
    east, north, speed = (column(truth, name) for name in ("east_m", "north_m", "speed_mps"))
    if east is None or north is None or speed is None or max(np.ptp(east), np.ptp(north)) < _LEAST_WAY_M:
        return None
    shown = _evenly_along(east, north)
    size_m = max(float(np.ptp(east)), float(np.ptp(north)))
    named = _timed(seconds(truth), east, north, _APART * size_m)
    way: Trace = {
        "type": "scatter",
        "mode": "markers",
        # Plain lists, to the centimetre: page.js looks points up in them.
        "x": np.round(east[shown], 2).tolist(),
        "y": np.round(north[shown], 2).tolist(),
        "customdata": _told(truth, shown),
        "hovertemplate": _WAY_TOLD,
        "marker": {
            "size": 4,
            "color": (SPEED.per_si * speed[shown]).astype(np.float32),
            "colorscale": "Viridis",
            "reversescale": True,
            "colorbar": {"title": {"text": SPEED.label}, "thickness": 10, "outlinewidth": 0, "len": 1.0},
        },
        "showlegend": False,
    }
    layout = plain_layout(_height_px(east, north)) | {
        "hovermode": "closest",
        "dragmode": "zoom",
        "showlegend": False,
        "xaxis": bare_axis() | {"title": {"text": "east, m", "standoff": 4}},
        "yaxis": bare_axis() | {"title": {"text": "north, m", "standoff": 4}, "scaleanchor": "x", "nticks": 8},
        # For page.js: which trace is the way, and which marks where the mouse is on the time axes.
        "meta": {"way": 1, "here": 4},
    }
    layout["margin"] = {**layout["margin"], "r": 80, "b": 44}
    thin: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": way["x"],
        "y": way["y"],
        "line": {"color": PALE, "width": 1},
        "hoverinfo": "skip",
    }
    return {"data": [thin, way, *_ends(east, north), _here(), *named], "layout": layout}


_WAY_TOLD = (
    "%{customdata[0]:.1f} s<br>%{marker.color:.1f} km/h<br>%{customdata[1]:.0f} m driven<br>"
    "%{customdata[2]:.1f} m high<extra></extra>"
)


def _told(truth: Samples, shown: Floats) -> Any:
    """Time, distance and height of the points shown, for who points at them; 0 where a column is missing."""
    rest = [column(truth, name) for name in ("distance_m", "height_m")]
    found = [seconds(truth)[shown], *(np.zeros(len(shown)) if v is None else v[shown] for v in rest)]
    return np.round(np.stack(found, axis=1), 2).tolist()


def _evenly_along(east: Floats, north: Floats) -> Any:
    """Rows that lie evenly along the way, both ends among them."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(east), np.diff(north)))])
    return np.unique(np.searchsorted(way, np.linspace(0.0, way[-1], _MARKS)))


def _height_px(east: Floats, north: Floats) -> int:
    share = float(np.ptp(north)) / max(float(np.ptp(east)), 1e-9)
    return round(min(max(_WIDTH_PX * share + 80.0, _LEAST_PX), _MOST_PX))


def _timed(time_s: Floats, east: Floats, north: Floats, apart_m: float) -> list[Trace]:
    """Names of times along the way, none on top of another."""
    step_s = next((s for s in _TIME_STEPS_S if time_s[-1] / s <= _MOST_TIMES), _TIME_STEPS_S[-1])
    rows = np.searchsorted(time_s, np.arange(step_s, time_s[-1], step_s))
    kept: list[int] = []
    ends = [0, len(time_s) - 1]
    for row in rows.tolist():
        taken = np.array(kept + ends)
        if np.all(np.hypot(east[taken] - east[row], north[taken] - north[row]) > apart_m):
            kept.append(row)
    if not kept:
        return []
    names = [_clock(round(float(time_s[row]))) for row in kept]
    return [_dots(east[kept], north[kept], names, BLACK, "circle-open", 7)]


def _clock(time_s: int) -> str:
    """A time as a short name.

    >>> _clock(30), _clock(90), _clock(120)
    ('30 s', '1 min 30 s', '2 min')
    """
    minutes, rest = divmod(time_s, 60)
    return " ".join(part for part in (f"{minutes} min" * bool(minutes), f"{rest} s" * bool(rest)) if part)


def _ends(east: Floats, north: Floats) -> list[Trace]:
    """Where it began and where it ended."""
    return [
        _dots(east[:1], north[:1], ["start"], BLUE, "circle", 10),
        _dots(east[-1:], north[-1:], ["end"], VERMILION, "square", 10),
    ]


def _here() -> Trace:
    """A ring that page.js leads along the way; nowhere until then."""
    return _dots(np.zeros(0), np.zeros(0), [], BLACK, "circle-open", 16) | {"mode": "markers"}


def _dots(x: Floats, y: Floats, names: list[str], colour: str, symbol: str, size: int) -> Trace:
    return {
        "type": "scatter",
        "mode": "markers+text",
        "x": x.tolist(),
        "y": y.tolist(),
        "text": names,
        "textposition": "top center",
        "textfont": {"size": 10, "color": BLACK, "shadow": "0 0 3px #fff, 0 0 3px #fff, 0 0 3px #fff"},
        "marker": {"color": colour, "symbol": symbol, "size": size, "line": {"width": 2 if size > 10 else 1}},
        "cliponaxis": False,
        "hoverinfo": "skip",
        "showlegend": False,
    }


def time_figure(truth: Samples) -> Figure | None:
    """What the driver did and the car felt, over time; grip where it is less than on dry asphalt, wind where it is."""

    def line(name: str, label: str, unit: Unit, colour: str = VERMILION, width: float = 1.2) -> list[Trace]:
        return curve(label, seconds(truth), column(truth, name), unit, colour, width)

    downhill = column(truth, "road_grade_up_rad")
    grade = curve("road's grade, downhill", seconds(truth), None if downhill is None else -downhill, DEGREE, RAW, 2.0)
    panels = [
        Panel("speed", SPEED, 110, line("speed_mps", "speed", SPEED)),
        Panel("steering wheel", DEGREE, 80, line("steering_wheel_angle_rad", "steering wheel", DEGREE)),
        Panel("road wheel", DEGREE, 80, line("road_wheel_angle_rad", "road wheel", DEGREE)),
        *(
            Panel(f"{label} acceleration, gravity's share included", ACCELERATION, 90, line(name, label, ACCELERATION))
            for name, label in (("accel_x_mps2", "longitudinal"), ("accel_y_mps2", "lateral"))
        ),
        Panel("yaw rate", DEGREE_PER_SECOND, 90, line("gyro_z_radps", "yaw rate", DEGREE_PER_SECOND)),
        Panel("sideslip", DEGREE, 70, line("sideslip_rad", "sideslip", DEGREE)),
        Panel(
            "roll, left side up positive",
            DEGREE,
            90,
            [*line("road_bank_rad", "road's bank", DEGREE, RAW, 2.0), *line("roll_rad", "car's roll", DEGREE)],
        ),
        Panel("pitch, nose down positive", DEGREE, 90, [*grade, *line("pitch_rad", "car's pitch", DEGREE)]),
        Panel("grip", BARE, 60, line("friction", "grip", BARE, ORANGE) if _is_slippery(truth) else []),
        Panel("side wind", FORCE, 60, line("side_wind_n", "side wind", FORCE, ORANGE) if _is_windy(truth) else []),
    ]
    return stacked(panels, max(float(seconds(truth)[-1]), 1e-3))


def _is_slippery(truth: Samples) -> bool:
    grip = column(truth, "friction")
    return grip is not None and bool(np.any(grip < 1.0))


def _is_windy(truth: Samples) -> bool:
    wind = column(truth, "side_wind_n")
    return wind is not None and bool(np.any(wind != 0.0))


def distance_figure(truth: Samples) -> Figure | None:
    """Height, grade and bank of the road over the distance driven; None: it stood still, or all of that is 0."""
    driven = column(truth, "distance_m")
    if driven is None or float(np.ptp(driven)) < _LEAST_WAY_M:
        return None
    # A car that comes to rest swings back by a hair; and time runs on while it stands.
    ahead = np.maximum.accumulate(driven)
    rows = np.flatnonzero(np.diff(ahead, prepend=-np.inf) > 0.0)
    at_m = np.linspace(ahead[rows[0]], ahead[rows[-1]], _GRID_POINTS)

    def line(name: str, label: str, unit: Unit) -> list[Trace]:
        values = column(truth, name)
        if values is None or not np.any(values):
            return []
        return curve(label, at_m, np.interp(at_m, ahead[rows], values[rows]), unit, BLUE)

    panels = [
        Panel("height", METRE, 120, line("height_m", "height", METRE)),
        Panel("grade, uphill positive", DEGREE, 90, line("road_grade_up_rad", "grade", DEGREE)),
        Panel("bank, left side high positive", DEGREE, 90, line("road_bank_rad", "bank", DEGREE)),
    ]
    return stacked(panels, float(at_m[-1]), start=float(at_m[0]), unit="m")
