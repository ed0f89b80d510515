"""The pictures of a diagnosis over time: each channel before and after, mismatches shaded; road and wind. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dsz_daemon.report.diagnosis_channels import Channel
from dsz_daemon.report.diagnosis_units import entries, real
from dsz_daemon.report.display import BARE, DEGREE, FORCE, NOTHING, Floats, percent
from dsz_daemon.report.panels import (
    BLACK,
    BLUE,
    ORANGE,
    RAW,
    VERMILION,
    Figure,
    Panel,
    Trace,
    curve,
    shaded,
    stacked,
    strip,
    tight_range,
)
from dsz_daemon.report.results import column, seconds

BEFORE, AFTER, SIMULATION = "simulation before", "simulation after", "simulation"
BEFORE_COLOUR, AFTER_COLOUR = ORANGE, BLUE
# What is shaded has been found in blocks of seconds: so many of them are told in words.
_PLACES_TOLD = 3
_PROFILES = {
    "road_bank_rad": ("road bank, left side up", DEGREE),
    "road_grade_up_rad": ("road grade, uphill", DEGREE),
    "side_wind_n": ("side force of the air, to the left", FORCE),
}


def places_of(result: Mapping[str, Any], channel: str) -> list[tuple[float, float, float]]:
    """Start, end (s since the first frame) and share of the channel's mismatches, the largest share first."""
    found = [
        (real(place.get("start_s")), real(place.get("end_s")), real(place.get("share")))
        for place in entries(result.get("located"))
        if place.get("channel") == channel
    ]
    return sorted(
        (place for place in found if np.all(np.isfinite(place[:2]))), key=lambda place: -np.nan_to_num(place[2])
    )


def channel_figure(channel: Channel, places: Sequence[tuple[float, float, float]], small: bool) -> Figure | None:
    """Recording against simulation, what is left of it, and where it stands out; less high when `small`."""
    time_s, unit = channel.time_s, channel.unit
    over = curve("recording", time_s, channel.measured, unit, RAW, 2.2)
    left = _noise(channel)
    if channel.is_changed:
        # After is wider: where both are the same it covers the other, rather than to mix with it.
        over += curve(BEFORE, time_s, channel.nominal, unit, BEFORE_COLOUR, 1.0)
        over += curve(AFTER, time_s, channel.fitted, unit, AFTER_COLOUR, 1.4)
        left += curve("left over before", time_s, channel.before, unit, BEFORE_COLOUR, 0.9)
        left += curve("left over after", time_s, channel.after, unit, AFTER_COLOUR, 1.3)
    else:
        over += curve(SIMULATION, time_s, channel.nominal, unit, AFTER_COLOUR, 1.1)
        left += curve("left over", time_s, channel.before, unit, AFTER_COLOUR, 1.0)
    scale = tight_range((channel.before, unit), (channel.after, unit), (_floor_band(channel), unit))
    panels = [
        Panel(channel.title, unit, 90 if small else 150, over),
        Panel("recording less simulation", unit, 60 if small else 100, left, scale),
        Panel("mismatch", BARE, 14, _strip(time_s, places), categories=("mismatch",)),
    ]
    figure = stacked(panels, _end_s(time_s))
    if figure is not None:
        figure["layout"]["shapes"] += [_shade(start_s, end_s) for start_s, end_s, _ in places]
    return figure


def places_text(places: Sequence[tuple[float, float, float]]) -> str:
    """Where the shading is, in words."""
    if not places:
        return ""
    listed = [f"{start:.0f} to {end:.0f} s ({percent(share)})" for start, end, share in places[:_PLACES_TOLD]]
    more = len(places) - len(listed)
    return (
        "Shaded, with the share of the channel's excess over its usual scatter: "
        f"{', '.join(listed)}{f' and {more} more' if more > 0 else ''}."
    )


def profile_figure(columns: Mapping[str, Floats]) -> Figure | None:
    """The profiles of road and air as the diagnosis has them; None where there is none but 0."""
    if np.count_nonzero(np.isfinite(np.asarray(columns.get("time_s", ()), dtype=np.float64))) < 2:
        return None
    samples = {name: np.asarray(columns[name]) for name in ("time_s", *_PROFILES) if name in columns}
    panels = []
    for name, (label, unit) in _PROFILES.items():
        values = column(samples, name)
        if values is not None and np.nanmax(np.abs(values)) > 0.0:
            panels.append(Panel(label, unit, 110, curve(label, seconds(samples), values, unit, AFTER_COLOUR)))
    return stacked(panels, _end_s(seconds(samples))) if panels else None


def _end_s(time_s: Floats) -> float:
    return max(float(np.nanmax(time_s)), 1e-3)


def _floor_band(channel: Channel) -> Floats | None:
    return 2.0 * channel.floor * np.array([-1.0, 1.0]) if np.isfinite(channel.floor) else None


def _noise(channel: Channel) -> list[Trace]:
    """Where 95 % of the sensor's own noise is."""
    limits = _floor_band(channel)
    if limits is None:
        return []
    ends_s = np.array([0.0, _end_s(channel.time_s)])
    low, high = (np.full(2, limit) for limit in limits)
    return shaded("noise, 95 %", ends_s, low, high, channel.unit, BLACK, 0.13)


def _shade(start_s: float, end_s: float) -> dict[str, Any]:
    return {
        "type": "rect",
        "x0": start_s,
        "x1": end_s,
        "xref": "x",
        "y0": 0,
        "y1": 1,
        "yref": "paper",
        "line": {"width": 0},
        "fillcolor": VERMILION,
        "opacity": 0.08,
        "layer": "below",
    }


def _strip(time_s: Floats, places: Sequence[tuple[float, float, float]]) -> list[Trace]:
    """The mismatches as bars that tell their share."""
    codes = np.zeros(len(time_s), dtype=np.int64)
    looks = [("", "")]
    for start_s, end_s, share in places:
        codes[(time_s >= start_s) & (time_s <= end_s)] = len(looks)
        looks.append((percent(share) if np.isfinite(share) else NOTHING, VERMILION))
    return strip("mismatch", time_s, codes, "mismatch", looks)
