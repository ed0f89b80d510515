"""`drive.html`: a simulated drive to look at, one offline file: where it went, what was felt, what was true."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from dsz_daemon.report.display import ACCELERATION, SPEED, Floats, Samples, duration
from dsz_daemon.report.markup import element
from dsz_daemon.report.offline_page import Picture, no_script, plotly, section, write_page
from dsz_daemon.report.results import column, row_count, seconds
from dsz_daemon.report.truth_figures import distance_figure, path_figure, time_figure
from dsz_daemon.report.truth_table import truth_tables

_HOW_TO_READ = (
    "Drag across a chart to zoom, double-click to come back. Pointing at the charts over time shows the place on the "
    "way. Every row is in truth.parquet."
)
_WAY = "The way of the C.G. from above, the first heading being east, at equal scales."
_TIME = (
    "True motion, of which the sensors make their readings. Accelerations are what a perfect sensor in the IMU's place "
    "would show."
)
_DISTANCE = "The road along the distance driven."


def write_truth_page(name: str, seed: int, truth: Samples, parameters: Mapping[str, Any], path: Path) -> None:
    """Write the page of one simulated drive.

    `truth`: the columns of truth.parquet, any but `time_s` may be missing; `parameters`: what was true, as
    `sim.scenario.SimulatedDrive.parameters` has it.

    Raises MachineError when plotly is missing or `path` can't be written.
    """
    drawing = plotly(path.name)
    found = [
        ("way", "The way", _WAY, path_figure(truth), True),
        ("time", "Over time", _TIME, time_figure(truth), False),
        ("distance", "Over distance", _DISTANCE, distance_figure(truth), True),
    ]
    drawn = [Picture(key, [heading], text, fig, is_alone) for key, heading, text, fig, is_alone in found if fig]
    title = f"Simulated drive {name}, seed {seed}"
    content = [
        _header(title, truth, parameters),
        element("p", _HOW_TO_READ, class_="quiet how"),
        no_script(),
        *(section(picture) for picture in drawn),
        element("section", *truth_tables(parameters), class_="seen"),
    ]
    write_page(path, title, content, drawn, drawing)


def _header(title: str, truth: Samples, parameters: Mapping[str, Any]) -> Element:
    meaning = str(parameters.get("meaning", ""))
    return element(
        "header",
        element("h1", title),
        element("p", f"{meaning[:1].upper()}{meaning[1:]}.", class_="verdict"),
        element("p", " · ".join(_facts(truth)), class_="quiet"),
    )


def _facts(truth: Samples) -> list[str]:
    """How long, how far, how fast, how high, how hard."""
    told: dict[str, Callable[[Floats], str]] = {
        "distance_m": lambda v: f"{v[-1] - v[0]:.0f} m",
        "speed_mps": lambda v: f"up to {SPEED.per_si * np.max(v):.0f} {SPEED.label}",
        "height_m": lambda v: f"{np.ptp(v):.0f} m between highest and lowest",
        "accel_y_mps2": lambda v: f"up to {np.max(np.abs(v)):.1f} {ACCELERATION.label} to the side",
    }
    facts = [duration(float(seconds(truth)[-1]))] if row_count(truth) else []
    for name, words in told.items():
        values = column(truth, name)
        if values is not None:
            facts.append(words(values[np.isfinite(values)]))
    tilts = [column(truth, name) for name in ("road_bank_rad", "road_grade_up_rad")]
    if all(tilt is not None and not np.any(tilt) for tilt in tilts):
        facts.append("a level road")
    return facts
