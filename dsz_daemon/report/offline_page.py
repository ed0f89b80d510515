"""A page of pictures in one file that opens anywhere, offline, and sends nothing anywhere.

plotly.js stands inside the page; a content security policy forbids the browser to load or
send anything else, so that "offline" does not rest on good intentions.
"""

from __future__ import annotations

import base64
import importlib
import json
import math
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from dsz_daemon.errors import MachineError
from dsz_daemon.report.markup import data_block, document, element, script
from dsz_daemon.report.panels import Figure

# What plotly.js reads by its bytes.
_TYPED = frozenset({"f4", "f8", "i1", "i2", "i4", "u1", "u2", "u4"})
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


def plotly(page: str = "report.html") -> str:
    """What drawing takes: plotly.js. MachineError, naming `page`, when plotly is missing."""
    try:
        offline = importlib.import_module("plotly.offline")
    except ImportError as error:
        raise MachineError(f"{page} needs plotly, which is not installed: pip install dsz-daemon[desk]") from error
    return str(offline.get_plotlyjs())


def figure_json(figure: Figure) -> str:
    """A figure as plotly.js reads it: columns of numbers by their bytes, what is not finite as null.

    What plotly's own classes would check of it, and take a quarter of a second for, all tests that draw check.
    """
    return json.dumps(_as_json(figure), allow_nan=False)


def _as_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _as_json(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_as_json(one) for one in value]
    if isinstance(value, np.ndarray):
        if f"{value.dtype.kind}{value.dtype.itemsize}" not in _TYPED or value.ndim != 1:
            return _as_json(value.tolist())
        dtype = value.dtype.newbyteorder("<")
        return {"dtype": dtype.str[1:], "bdata": base64.b64encode(value.astype(dtype).tobytes()).decode("ascii")}
    if isinstance(value, np.generic):
        return _as_json(value.item())
    return None if isinstance(value, float) and not math.isfinite(value) else value


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


def write_page(path: Path, title: str, content: Sequence[Element], drawn: Sequence[Picture], plotly_js: str) -> None:
    """Write a page; `content` holds the `section` of every picture of `drawn`.

    Raises MachineError when `path` can't be written.
    """
    try:
        path.write_bytes(page_bytes(title, content, drawn, plotly_js))
    except OSError as error:
        raise MachineError(f"{path}: can't write the report: {error.strerror or error}") from error


def page_bytes(title: str, content: Sequence[Element], drawn: Sequence[Picture], plotly_js: str) -> bytes:
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
        body.append(script(plotly_js))
        body.extend(data_block(f"data-{picture.name}", figure_json(picture.figure)) for picture in drawn)
        body.append(script(_shipped_text("page.js")))
    return document(head, body)


def _shipped_text(name: str) -> str:
    return files("dsz_daemon.report").joinpath(name).read_text(encoding="utf-8")
