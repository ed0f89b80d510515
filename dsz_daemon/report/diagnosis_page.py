"""The page of `dsz diagnose`: what the simulation leaves out, how sure that is, and how well it fits then."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from dsz_daemon.report.diagnosis_cards import cause_card, manoeuvre_list
from dsz_daemon.report.diagnosis_channels import Channel, channels_of
from dsz_daemon.report.diagnosis_figures import channel_figure, places_of, places_text, profile_figure
from dsz_daemon.report.diagnosis_grids import bars_figure, spectra_figure, whiteness_figure
from dsz_daemon.report.diagnosis_tables import (
    error_table,
    fit_table,
    located_tables,
    offset_table,
    unlisted_table,
    untested_table,
)
from dsz_daemon.report.diagnosis_units import entries, told
from dsz_daemon.report.diagnosis_words import is_spin, sentence, spins_of
from dsz_daemon.report.display import Floats, duration
from dsz_daemon.report.markup import element
from dsz_daemon.report.offline_page import Picture, no_script, page_bytes, plotly, section
from dsz_daemon.report.results import mapping

_ROADS = ("road_bank", "road_grade")
_HOW_TO_READ = (
    "Drag across a chart to zoom all charts over time, shift-drag to pan, double-click to come back; click a legend "
    "entry to hide a line. What is left is drawn where the car drives. Every row is in fit.parquet. "
)
_NOMINAL = "the nominal simulation with constant offsets and what has a tolerance at its best"
_PROFILE = "As it was found, from moment to moment; how far that is off is not known."
_BARS = (
    "RMS of recording less simulation. Seen: on the data that it was fitted to; unseen: on blocks that were left out "
    "of the fit. The noise floor is what the sensors' own white noise leaves."
)
_EXPECTED = "Expected is what noise and the simulation's own coarseness leave."
_OWN_GYRO = (
    " A road's profile is integrated from the roll or pitch gyro, so that gyro's own fit proves nothing: "
    "the other channels do."
)
_SPECTRA = (
    "Amplitude density of what is left while driving. All signals have passed the same low-pass, and noise with them: "
    "what stays above its dashed line has a cause, if only the simulation's coarseness."
)
_WHITENESS = (
    "Autocorrelation of what is left: how it goes on after so many seconds. Noise stays within the grey band, which is "
    "wide at first only because the low-pass smooths; a line outside of it is something that noise does not do."
)


def diagnosis_page(result: Mapping[str, Any], columns: Mapping[str, Floats], title: str) -> str:
    """The whole page, as HTML.

    `result`: what diagnosis.json holds; any entry may be missing. `columns`: those of fit.parquet, shape (rows,), SI:
    `time_s`, `<channel>_measured`, `_nominal` and `_fitted`, and the profiles of road and wind; any may be missing.

    Raises MachineError when plotly is missing.
    """
    drawing = plotly()
    channels = channels_of(result, columns)
    over_time, fits, residuals = _pictures(result, columns, channels)
    content = [
        _header(result, channels, title),
        *_causes(result),
        *([no_script()] if over_time or fits else []),
        *_drawn("Recording against simulation", over_time, _how(result, channels)),
        *_fit(fits, fit_table(result, any(channel.is_changed for channel in channels) or not channels)),
        *_drawn("What is left", residuals),
        *_rest(result),
        *_settings(result),
    ]
    return page_bytes(title, content, [*over_time, *fits, *residuals], drawing).decode("utf-8")


def _header(result: Mapping[str, Any], channels: Sequence[Channel], title: str) -> Element:
    return element(
        "header",
        element("h1", title),
        element("p", sentence(result), class_="verdict"),
        element("p", _facts(result, channels, title), class_="quiet"),
    )


def _facts(result: Mapping[str, Any], channels: Sequence[Channel], title: str) -> str:
    """The verdict's own word, files, length, version."""
    recording = mapping(result.get("source")).get("recording")
    names = ", ".join(map(str, recording)) if isinstance(recording, (list, tuple)) else told(recording)
    parts = [told(result.get("verdict")).replace("_", " "), "" if names in title else names]
    if channels:
        time_s = channels[0].time_s
        driven = np.max([np.mean(channel.used) for channel in channels])
        parts.append(duration(float(np.nanmax(time_s))))
        parts.append(f"{driven:.0%} of it compared while driving".replace("%", " %"))
    version = mapping(result.get("versions")).get("dsz-daemon")
    parts.append(f"dsz-daemon {version}" if version else "")
    return " · ".join(part for part in parts if part)


def _causes(result: Mapping[str, Any]) -> list[Element]:
    """A card each; what is wrong with the configuration; shapes without a name; what to drive next."""
    causes, errors = entries(result.get("causes")), entries(result.get("parameter_errors"))
    shapes = [shape for shape in entries(result.get("unlisted")) if not is_spin(shape)]
    parts: list[Element] = []
    if causes:
        parts += [element("h2", "Cause" if len(causes) == 1 else "Causes")]
        parts += [cause_card(cause, number) for number, cause in enumerate(causes, start=1)]
    if errors:
        parts += [element("h2", "Configured parameters that fit better otherwise"), error_table(errors)]
    if spins := spins_of(result):
        parts += [element("h2", "Wheels beyond their grip")]
        parts += [element("ul", *(element("li", f"{one[:1].upper()}{one[1:]}.") for one in spins))]
    if shapes:
        parts += [element("h2", "Shapes without a name"), unlisted_table(shapes, result)]
    manoeuvres = manoeuvre_list(result.get("next_manoeuvres"))
    if manoeuvres is not None:
        parts += [element("h2", "What to drive next"), manoeuvres]
    return [element("section", *parts, class_="seen")] if parts else []


def _pictures(
    result: Mapping[str, Any], columns: Mapping[str, Floats], channels: Sequence[Channel]
) -> tuple[list[Picture], list[Picture], list[Picture]]:
    """Over time, the fit, the residuals; those for which there is something to draw."""
    calm = told(result.get("verdict")) == "consistent"
    over_time: list[Picture] = []
    for channel in channels:
        places = places_of(result, channel.name)
        figure = channel_figure(channel, places, calm)
        if figure is not None:
            heading: list[str | Element] = [element("code", channel.name), " ", channel.title]
            over_time.append(Picture(f"channel-{len(over_time)}", heading, places_text(places), figure, level="h3"))
    named = {told(cause.get("effect")) for cause in entries(result.get("causes"))}
    profile = profile_figure(columns) if named & {*_ROADS, "side_wind"} else None
    if profile is not None:
        over_time.append(Picture("profile", ["Road and wind"], _PROFILE, profile, level="h3"))
    bars = bars_figure(channels)
    text = _BARS + (_OWN_GYRO if named & {*_ROADS} else "")
    fits = [Picture("bars", ["RMS of each channel"], text, bars, is_alone=True, level="h3")] if bars else []
    height_px = 90 if calm else 130
    residuals = [
        Picture(name, [heading], told_of, figure, is_alone=True, level="h3")
        for name, heading, told_of, figure in (
            ("spectra", "Spectra", _SPECTRA, spectra_figure(channels, height_px)),
            ("whiteness", "Whiteness", _WHITENESS, whiteness_figure(channels, height_px)),
        )
        if figure
    ]
    return over_time, fits, residuals


def _drawn(heading: str, pictures: Sequence[Picture], *more: Element) -> list[Element]:
    """The places that the page's script fills, under one heading; `more` goes before it."""
    if not pictures:
        return []
    return [*more, element("h2", heading), *(section(picture) for picture in pictures)]


def _how(result: Mapping[str, Any], channels: Sequence[Channel]) -> Element:
    """How to read the charts, and what their simulations are."""
    fitted = "with the causes in it" if entries(result.get("causes")) else "that fits best, though no cause has a name"
    is_changed = any(channel.is_changed for channel in channels)
    shown = f"Before is {_NOMINAL}, after is the one {fitted}." if is_changed else f"Shown is {_NOMINAL}."
    return element("p", _HOW_TO_READ + shown, class_="quiet how")


def _fit(pictures: Sequence[Picture], numbers: Element | None) -> list[Element]:
    """Bars, and their numbers."""
    parts = [section(picture) for picture in pictures]
    if numbers is not None:
        parts += [numbers, element("p", _EXPECTED, class_="quiet")]
    return [element("h2", "Fit on seen and unseen data"), *parts] if parts else []


def _rest(result: Mapping[str, Any]) -> list[Element]:
    """Where the two part, what could not be tested, what was refitted."""
    parts: list[Element] = []
    places = located_tables(result)
    if places:
        parts += [element("h2", "Where they part"), *places]
    untested = entries(result.get("could_not_test"))
    if untested:
        parts += [element("h2", "What this drive could not test"), untested_table(untested)]
    offsets = offset_table(result)
    if offsets is not None:
        parts += [element("h2", "Refitted before any cause"), offsets]
        parts += [
            element("p", f"{told(one.get('statement'))}.")
            for key in ("same_as_offsets", "same_as_slip")
            for one in entries(result.get(key))
        ]
    return [element("section", *parts, class_="seen")] if parts else []


def _settings(result: Mapping[str, Any]) -> list[Element]:
    kept = {key: result[key] for key in ("versions", "source", "settings") if result.get(key)}
    if not kept:
        return []
    text = json.dumps(kept, indent=2, ensure_ascii=False, default=str)
    return [element("details", element("summary", "Settings and versions"), element("pre", text))]
