"""`proof.html`: how a proof went; every trial with its truth, its answer and a picture, failures first. Pure.

`result` is what `dsz_daemon.prove.prove` returns; the page knows its fields alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

from dsz_daemon.report.markup import element
from dsz_daemon.report.offline_page import Picture, no_script, page_bytes, plotly, section
from dsz_daemon.report.panels import BLUE, ORANGE, PALE, VERMILION, Figure, bare_axis, legend_at, plain_layout

Trials = Sequence[Mapping[str, Any]]

_HEIGHT_PX, _SPARK_PX = 300, (260, 40)
_NOTHING, _NAMELESS = "nothing", "(no name)"
_SPARKS = (
    "What is left over the drive of the channel in which most was to be explained: by the nominal simulation, refitted "
    "(red), and with what was named in it (blue), to one scale. A name too many is in bold."
)


def proof_page(result: Mapping[str, Any], lines: Sequence[Sequence[str]], failures: Trials) -> bytes:
    """The whole page. `lines`: figure, what was reached, bar, whether it holds; `failures` are told before all others.

    Raises MachineError when plotly is missing.
    """
    protocol, trials, summary = result["protocol"], result["trials"], result["summary"]
    pictures = [
        Picture(name, [heading], text, figure, is_alone=True)
        for name, heading, text, figure in (
            ("sizes", "How small it may be", "Singles: the planted effect is named first; Wilson's 95 %.",
             sizes(summary["sizes"])),
            ("reliability", "Stated probabilities", "How often a cause was right that was said to be so probable.",
             reliability(summary["reliability"])),
            ("confusion", "What was said of what", "Singles by what was planted, and what was named first.",
             confusion(summary["confusion"])),
        )
        if figure is not None
    ]  # fmt: skip
    missed = sum(line[-1] != "yes" for line in lines)
    title = f"Proof: {protocol['trials']} sealed trials, seed {protocol['seed']}"
    content = [
        element("header", element("h1", title), element("p", _sentence(result, missed), class_="verdict"),
                element("p", f"dsz {protocol['version']}, judge {protocol['judge'][:12]}", class_="quiet")),
        table(("", "reached", "bar", "holds"), lines),
        no_script(),
        *(section(picture) for picture in pictures),
        element("h2", f"Failures ({len(failures)})"),
        element("p", _SPARKS, class_="quiet"),
        trial_table(failures),
        element("h2", "Every trial"),
        trial_table(trials),
    ]  # fmt: skip
    return page_bytes(title, content, pictures, plotly("proof.html"))


def _sentence(result: Mapping[str, Any], missed: int) -> str:
    alarms, plain = result["summary"]["false_alarms"], result["summary"].get("singles_1", {"hits": 0, "of": 0})
    words = f"{alarms['hits']} false alarms on {alarms['of']} recordings with nothing left out; "
    words += f"{plain['hits']} of {plain['of']} plain effects named first. "
    return words + ("Every bar is reached." if not missed else f"{missed} bars are not reached.")


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Element:
    """A plain table; text between ** is bold."""
    head = element("thead", element("tr", *(element("th", head, scope="col") for head in heads)))
    body = element("tbody")
    for row in rows:
        cells = [element("th", row[0], scope="row"), *(element("td", *_bold(cell)) for cell in row[1:])]
        body.append(element("tr", *cells))
    return element("table", head, body, class_="results")


def _bold(text: str) -> list[str | Element]:
    parts = text.split("**")
    return [element("b", part) if number % 2 else part for number, part in enumerate(parts) if part]


def trial_table(trials: Trials) -> Element:
    """A row a trial."""
    heads = ("trial", "car, way", "planted", "said", "reason", "picture")
    head = element("thead", element("tr", *(element("th", head, scope="col") for head in heads)))
    body = element("tbody")
    for one in trials:
        said = [*one["named"], *(f"shape {shape}" for shape in one["shapes"])] or [one["error"] or one["verdict"]]
        marked = ", ".join(f"**{name}**" if name in one["extra"] else name for name in said)
        cells = [
            element("th", str(one["number"]), scope="row"),
            element("td", f"{one['car'].replace('_', ' ')}, {one['kind']}"),
            element("td", planted(one)),
            element("td", *_bold(marked), class_="said"),
            element("td", "; ".join(one.get("why", ()))),
            element("td", *([] if one.get("picture") is None else [_spark(one["picture"])]), class_="spark"),
        ]
        body.append(element("tr", *cells))
    return element("table", head, body, class_="results trials")


def planted(one: Mapping[str, Any]) -> str:
    """What was put into a trial, in words."""
    words = " + ".join([*one["planted"], *(f"{_NAMELESS} {name}" for name in one["unlisted"])]) or _NOTHING
    return words if one["size"] == 1.0 else f"{words} at {one['size']:g}"


def _spark(picture: Mapping[str, Any]) -> Element:
    """`picture`: channel, and what is left before and after (n,) in hundredths of the largest of both."""
    width, height = _SPARK_PX
    lines = []
    for name, colour in (("before", VERMILION), ("after", BLUE)):
        values = picture[name]
        step = (width - 2.0) / max(len(values) - 1, 1)
        points = " ".join(
            f"{1.0 + k * step:.0f},{0.5 * height * (1.0 - 0.9 * value / 100.0):.1f}" for k, value in enumerate(values)
        )
        lines.append(element("polyline", points=points, style=f"stroke:{colour}"))
    size = {"width": str(width), "height": str(height), "viewBox": f"0 0 {width} {height}", "role": "img"}
    return element("svg", element("title", str(picture["channel"])), *lines, **size)


def sizes(rows: Sequence[Mapping[str, Any]]) -> Figure | None:
    """Shares of singles that are right, by size and car, with their intervals."""
    if not rows:
        return None
    data: list[dict[str, Any]] = []
    for car, colour in zip(sorted({row["car"] for row in rows}), (BLUE, ORANGE), strict=False):
        mine = [row for row in rows if row["car"] == car and row["of"]]
        shares = [row["hits"] / row["of"] for row in mine]
        data.append(
            {
                "type": "bar",
                "name": car.replace("_", " "),
                "x": [f"size {row['size']:g}" for row in mine],
                "y": shares,
                "marker": {"color": colour},
                "text": [f"{row['hits']} of {row['of']}" for row in mine],
                "error_y": {
                    "type": "data",
                    "symmetric": False,
                    "array": [row["high"] - share for row, share in zip(mine, shares, strict=True)],
                    "arrayminus": [share - row["low"] for row, share in zip(mine, shares, strict=True)],
                    "thickness": 1,
                },
            }
        )
    axes = {"xaxis": bare_axis(), "yaxis": bare_axis() | {"range": [0.0, 1.05]}}
    layout = plain_layout(_HEIGHT_PX) | axes | {"barmode": "group", "legend": legend_at(1.0)}
    return {"data": data, "layout": layout}


def reliability(rows: Sequence[Mapping[str, float]]) -> Figure | None:
    """Shares that were right over what was stated, in tenths; the larger the more causes."""
    if not rows:
        return None
    data = [
        {"type": "scatter", "mode": "lines", "x": [0, 1], "y": [0, 1], "line": {"color": PALE, "width": 1},
         "hoverinfo": "skip", "showlegend": False},
        {"type": "scatter", "mode": "markers+text", "x": [row["stated"] for row in rows],
         "y": [row["right"] for row in rows], "text": [f"{row['of']:.0f}" for row in rows],
         "textposition": "bottom center", "showlegend": False,
         "marker": {"color": BLUE, "size": [6.0 + 3.0 * float(row["of"]) ** 0.25 for row in rows]}},
    ]  # fmt: skip
    layout = plain_layout(_HEIGHT_PX) | {
        "xaxis": bare_axis() | {"range": [-0.02, 1.05], "title": {"text": "stated"}},
        "yaxis": bare_axis() | {"range": [-0.02, 1.1], "title": {"text": "right"}},
    }
    layout["margin"] = layout["margin"] | {"b": 44}
    return {"data": data, "layout": layout}


def confusion(rows: Sequence[tuple[str, str, int]]) -> Figure | None:
    """Counts of what was named first (across) of what was planted (down)."""
    if not rows:
        return None
    planted_names = sorted({row[0] for row in rows}, reverse=True)
    said_names = [*sorted({row[1] for row in rows} - {_NOTHING}), _NOTHING]
    counts = {(row[0], row[1]): row[2] for row in rows}
    cells = [[counts.get((name, said), 0) for said in said_names] for name in planted_names]
    heat = {
        "type": "heatmap", "x": said_names, "y": planted_names, "z": cells, "showscale": False,
        "text": [[str(count or "") for count in row] for row in cells], "texttemplate": "%{text}",
        "colorscale": [[0.0, "#ffffff"], [1.0, BLUE]], "xgap": 1, "ygap": 1,
    }  # fmt: skip
    layout = plain_layout(60 + 18 * len(planted_names)) | {
        "xaxis": bare_axis() | {"tickangle": -40, "automargin": True},
        "yaxis": bare_axis() | {"automargin": True},
    }
    # Names stand aslant below.
    layout["margin"] = layout["margin"] | {"b": 110}
    return {"data": [heat], "layout": layout | {"height": layout["height"] + 110}}
