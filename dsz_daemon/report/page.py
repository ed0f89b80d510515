"""`report.html`: what stands where on the page of one run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from dsz_daemon.report.channel_figures import channel_figure
from dsz_daemon.report.counts import counted
from dsz_daemon.report.display import CHANNEL_NAMES, MINUS, Samples, duration, percent, words
from dsz_daemon.report.drive_figures import attitude_figure, drive_figure, kinematics_figure, model_figure
from dsz_daemon.report.markup import element
from dsz_daemon.report.offline_page import Picture, no_script, plotly, section, write_page
from dsz_daemon.report.paper_figures import REFERENCE_NAMES, paper_pictures, paper_text
from dsz_daemon.report.results import (
    ChannelResult,
    channel_result,
    mapped_channels,
    mapping,
    row_count,
    seconds,
)
from dsz_daemon.report.tables import channel_table
from dsz_daemon.report.verdict import verdict

_CLOSED_REASONS_SHOWN = 4

_MODEL_TEXT = "Learning waits while tau, the summed variances of rates, accelerations and steering, is large."
_KINEMATICS_TEXT = (
    "Equations (20) to (22) on a level road, the reference that offsets are learnt against: "
    "a steady distance between the lines is road grade, bank or an offset still to learn."
)
_HOW_TO_READ = (
    "Drag across any chart to zoom all of them in time, shift-drag to pan, double-click to come back; "
    "click a legend entry to hide a line. Charts keep the least and the greatest value of every "
    "stretch they draw as one; every single row is in samples.parquet. "
    "A dotted line marks a gap or a step of the clock."
)


def write_report(
    samples: Samples,
    summary: Mapping[str, Any],
    path: Path,
    truth: Samples | None = None,
    title: str = "Dynamic sensor zeroing",
) -> None:
    """Write the page of one run.

    `samples`: the columns of `samples.parquet` (`edge.samples_file.read_samples`); any may be
    missing. `summary`: what `summary.json` holds; any entry may be missing. `truth`: columns of a
    simulation, `time_s` on the same clock with any of `gyro_x_radps`, `gyro_x_offset_radps`,
    `speed_mps` and so on: the names that the compensated values and offsets have in `samples`.

    Raises MachineError when plotly is missing or `path` can't be written.
    """
    drawing = plotly()
    results = [channel_result(c, samples, summary, truth) for c in mapped_channels(samples, summary)]
    drawn, paper = _figures(results, samples, truth) if row_count(samples) else ([], [])
    content = [
        _header(results, samples, summary, title),
        *_tables(results, samples, summary),
        *_pictures(drawn, paper, truth),
        *_settings(summary),
    ]
    write_page(path, title, content, [*paper, *drawn], drawing)


def _header(results: list[ChannelResult], samples: Samples, summary: Mapping[str, Any], title: str) -> Element:
    sentence = verdict(results, row_count(samples), len(_strings(summary.get("warnings"))))
    return element(
        "header",
        element("h1", title),
        element("p", sentence, class_="verdict"),
        element("p", _facts(samples, summary, title), class_="quiet"),
    )


def _facts(samples: Samples, summary: Mapping[str, Any], title: str) -> str:
    """What was replayed: files, length, steps and rate, version."""
    recordings = ", ".join(_strings(summary.get("recording")))
    parts = [] if recordings in title else [recordings]
    rows = row_count(samples)
    if rows > 1:
        time_s = seconds(samples)
        step_s = float(np.nanmedian(np.diff(time_s)))
        parts.append(duration(float(np.nanmax(time_s))))
        parts.append(f"{rows} steps at {1.0 / step_s:.0f} Hz" if step_s > 0 else f"{rows} steps")
    version = mapping(summary.get("versions")).get("dsz-daemon")
    parts.append(f"dsz-daemon {version}" if version else "")
    return " · ".join(part for part in parts if part)


def _strings(value: Any) -> list[str]:
    if isinstance(value, str):
        return [value]
    return [str(item) for item in value] if isinstance(value, (list, tuple)) else []


def _figures(
    results: list[ChannelResult], samples: Samples, truth: Samples | None
) -> tuple[list[Picture], list[Picture]]:
    """All pictures for which there is something to draw, top to bottom; those of the paper apart."""
    paper = [] if truth is None else paper_pictures(results, samples, truth)
    # The paper's Fig. 4 or 10 shows the same against the truth.
    told = any(picture.name in REFERENCE_NAMES for picture in paper)
    drawn = [
        (r.channel, _channel_heading(r), _gate_text(r), channel_figure(r.channel, samples, truth)) for r in results
    ]
    drawn += [
        ("drive", ["The drive"], "", drive_figure(samples, truth)),
        ("model", ["Single-track model and gates"], _MODEL_TEXT, model_figure(samples, truth)),
        ("kinematics", ["Accelerations from motion"], _KINEMATICS_TEXT, None if told else kinematics_figure(samples)),
        ("attitude", ["Roll and pitch"], "", attitude_figure(samples, truth)),
    ]
    return [Picture(name, heading, text, fig) for name, heading, text, fig in drawn if fig], paper


def _pictures(drawn: list[Picture], paper: list[Picture], truth: Samples | None) -> list[Element]:
    """The places that the page's script fills."""
    if not drawn and not paper:
        return []
    parts = [element("p", _HOW_TO_READ, class_="quiet how"), no_script()]
    if paper and truth is not None:
        parts += [element("h2", "The paper's figures", id="paper"), element("p", paper_text(truth), class_="quiet")]
        parts += [section(picture) for picture in paper]
    return parts + [section(picture) for picture in drawn]


def _channel_heading(result: ChannelResult) -> list[str | Element]:
    return [element("code", result.channel), " ", CHANNEL_NAMES[result.channel]]


def _gate_text(result: ChannelResult) -> str:
    """How much of the time the offset was learning, and what kept it from it."""
    if not np.isfinite(result.gate_share):
        return ""
    text = f"Learning {percent(result.gate_share)} of the time"
    kept = [f"{words(r)} {percent(s)}" for r, s in result.closed_share.items()][:_CLOSED_REASONS_SHOWN]
    return f"{text}; not while: {', '.join(kept)}." if kept else f"{text}."


def _tables(results: list[ChannelResult], samples: Samples, summary: Mapping[str, Any]) -> list[Element]:
    """Results, warnings, notes and counters."""
    parts = [element("section", channel_table(results, samples), _table_note(results))] if results else []
    seen: list[Element] = []
    for heading, name in (("Warnings", "warnings"), ("Notes", "notes")):
        items = [element("li", text) for text in _strings(summary.get(name))]
        if items:
            seen += [element("h2", heading), element("ul", *items, class_=name)]
    numbers = counted(mapping(summary.get("counts")), mapping(summary.get("median_age_s")))
    if numbers:
        seen += [element("h2", "Counted"), *numbers]
    return [*parts, element("section", *seen, class_="seen")] if seen else parts


def _table_note(results: list[ChannelResult]) -> Element:
    text = (
        f"Offset is reading minus truth: compensated = raw {MINUS} offset. "
        "Means and RMS are over all rows with a reading."
    )
    references = sorted({f"{r.channel}: {r.reference}" for r in results if r.difference})
    if references:
        text += f" Reference: another unit's reading, never used by the estimator ({', '.join(references)})."
    return element("p", text, class_="quiet")


def _settings(summary: Mapping[str, Any]) -> list[Element]:
    told = {key: summary[key] for key in ("versions", "recording", "settings") if summary.get(key)}
    if not told:
        return []
    text = json.dumps(told, indent=2, ensure_ascii=False, default=str)
    return [element("details", element("summary", "Settings and versions"), element("pre", text))]
