"""A page of pictures in one file that opens anywhere, offline, and sends nothing anywhere.

plotly.js stands inside the page; a content security policy forbids the browser to load or
send anything else, so that "offline" does not rest on good intentions.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from dsz_daemon.errors import MachineError
from dsz_daemon.report.markup import data_block, document, element, script
from dsz_daemon.report.panels import Figure

_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


class Picture(NamedTuple):
    """One figure in its place: id, heading, a line of text, plotly's data.

    `is_alone`: its x axis is its own (a stretch of the run, a distance, no time at all), so it neither leads nor
    follows when the others are zoomed. `level`: of its heading.
    """

    name: str
    heading: Sequence[str | Element]
    text: str
    figure: Figure
    is_alone: bool = False
    level: str = "h2"


class Plotly(NamedTuple):
    """plotly.js, and a function that checks a figure and turns it into JSON."""

    source: str
    to_json: Callable[[Figure], str]


def plotly(page: str = "report.html") -> Plotly:
    """What drawing takes. MachineError, naming `page`, when plotly is missing."""
    try:
        offline = importlib.import_module("plotly.offline")
        graph = importlib.import_module("plotly.graph_objects")
        io = importlib.import_module("plotly.io")
    except ImportError as error:
        raise MachineError(f"{page} needs plotly, which is not installed: pip install dsz-daemon[desk]") from error

    def to_json(figure: Figure) -> str:
        # Without a template: plotly's default one would be repeated in every figure.
        checked = graph.Figure(figure | {"layout": figure["layout"] | {"template": "none"}})
        return str(io.to_json(checked, validate=False, engine="json"))

    return Plotly(str(offline.get_plotlyjs()), to_json)


def section(picture: Picture) -> Element:
    """The place of one picture, which the page's script fills."""
    children = [element(picture.level, *picture.heading)]
    if picture.text:
        children.append(element("p", picture.text, class_="quiet"))
    plot = {"data_alone": ""} if picture.is_alone else {}
    children.append(element("div", class_="plot", data_figure=picture.name, **plot))
    return element("section", *children, id=picture.name, class_="figure alone" if picture.is_alone else "figure")


def no_script() -> Element:
    """What stands in the pictures' place where scripts are off."""
    return element("noscript", element("p", "The pictures need JavaScript; the tables do not."))


def write_page(path: Path, title: str, content: Sequence[Element], drawn: Sequence[Picture], drawing: Plotly) -> None:
    """Write a page; `content` holds the `section` of every picture of `drawn`.

    Raises MachineError when `path` can't be written.
    """
    try:
        path.write_bytes(page_bytes(title, content, drawn, drawing))
    except OSError as error:
        raise MachineError(f"{path}: can't write the report: {error.strerror or error}") from error


def page_bytes(title: str, content: Sequence[Element], drawn: Sequence[Picture], drawing: Plotly) -> bytes:
    """The page that `write_page` writes."""
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", **{"http-equiv": "Content-Security-Policy", "content": _POLICY}),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", title),
        element("style", _shipped_text("page.css")),
    )
    hairline = [element("div", id="hairline")] if drawn else []
    body = element("body", element("main", *content, *hairline))
    if drawn:
        body.append(script(drawing.source))
        body.extend(data_block(f"data-{picture.name}", drawing.to_json(picture.figure)) for picture in drawn)
        body.append(script(_shipped_text("page.js")))
    return document(head, body)


def _shipped_text(name: str) -> str:
    return files("dsz_daemon.report").joinpath(name).read_text(encoding="utf-8")
