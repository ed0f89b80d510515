"""Runs for the report's tests, and a written page, taken apart.

The four-row run `small_run` was computed by hand (rates in rad/s, 1 s apart):

    raw          0.10   0.12   0.14   nan      mean 0.12, RMS sqrt(0.0440/3) = 0.121106
    offset       0.00   0.02   0.05   0.05     last 0.05, std 0.01
    compensated  0.10   0.10   0.09   nan      mean 0.0966667, RMS sqrt(0.0281/3) = 0.0967815
    truth        0.07   0.07   0.08   0.09     offset 0.04: error 0.01 = 1 sigma
    raw - truth  0.03   0.05   0.06            RMS sqrt(0.0070/3) = 0.0483046
    comp - truth 0.03   0.03   0.01            RMS sqrt(0.0019/3) = 0.0251661

and 1 rad/s = 57.29578 deg/s.
"""

from __future__ import annotations

import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np

from dsz_daemon.report import write_report
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES, WHEELS

NAN = math.nan
Samples = dict[str, np.ndarray]


def words(*items: str) -> np.ndarray:
    return np.array(items, dtype=object)


def small_run() -> Samples:
    return {
        "time_s": np.array([1e9, 1e9 + 1, 1e9 + 2, 1e9 + 3]),
        "gyro_z_raw_radps": np.array([0.10, 0.12, 0.14, NAN]),
        "gyro_z_radps": np.array([0.10, 0.10, 0.09, NAN]),
        "gyro_z_offset_radps": np.array([0.00, 0.02, 0.05, 0.05]),
        "gyro_z_offset_std_radps": np.array([0.5, 0.1, 0.01, 0.01]),
        "gyro_z_state": words("learning", "learning", "converged", "invalid"),
        "gyro_z_gate": np.array([True, True, False, False]),
        "gyro_z_reason": words("none", "none", "turning", "stale"),
        "yaw_rate_reference_radps": np.array([0.09, 0.09, 0.09, 0.09]),
        "event": words("start", "", "", "gap"),
    }


def small_truth() -> Samples:
    return {
        "time_s": np.array([1e9, 1e9 + 1, 1e9 + 2, 1e9 + 3]),
        "gyro_z_radps": np.array([0.07, 0.07, 0.08, 0.09]),
        "gyro_z_offset_radps": np.full(4, 0.04),
    }


def full_run(rows: int, seed: int = 0) -> tuple[Samples, Samples]:
    """Every column there is, filled with noise; and a truth."""
    rng = np.random.default_rng(seed)
    drawn = rng.standard_normal(rows)

    def noise() -> np.ndarray:
        return np.roll(drawn, int(rng.integers(rows)))

    samples: Samples = {"time_s": 1.5e9 + np.arange(rows) / 100.0}
    truth: Samples = {"time_s": samples["time_s"]}
    for c in IMU_CHANNELS:
        u = QUANTITIES[c].suffix
        for name in (f"{c}_raw_{u}", f"{c}_{u}", f"{c}_offset_{u}"):
            samples[name] = noise()
            truth[name] = noise()
        samples[f"{c}_offset_std_{u}"] = np.full(rows, 0.1)
        stretches = np.repeat(rng.integers(0, 4, rows // 20 + 1), 20)[:rows]
        samples[f"{c}_state"] = words("invalid", "holding", "learning", "converged")[stretches]
        samples[f"{c}_gate"] = stretches > 1
        samples[f"{c}_reason"] = words("stale", "turning", "none", "none")[stretches]
    numbers = """speed_mps sideslip_rad lateral_velocity_mps yaw_rate_model_radps road_wheel_angle_rad
        accel_x_kinematic_mps2 accel_y_kinematic_mps2 accel_z_kinematic_mps2 roll_rad pitch_rad
        suspension_roll_rad suspension_pitch_rad front_cornering_stiffness_n_per_rad
        rear_cornering_stiffness_n_per_rad steering_wheel_angle_rad speed_reference_mps"""
    for name in (*numbers.split(), *(f"wheel_speed_{w}_mps" for w in WHEELS)):
        samples[name] = noise()
        truth[name] = noise()
    samples["tau"] = rng.random(rows) + 0.1
    for switch in ("standstill", "brake", "accelerator", "reverse"):
        samples[switch] = rng.random(rows) > 0.5
    samples["event"] = words("start", *[""] * (rows - 1))
    return samples, truth


class Page(HTMLParser):
    """A written page, taken apart: tags, scripts, table cells, visible text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.styles: list[str] = []
        self.rows: list[list[str]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "link", "img", "br"):
            self._open.append(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
        elif tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        while self._open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        within = self._open[-1] if self._open else ""
        if within == "script":
            self.scripts[-1] += data
        elif within == "style":
            self.styles.append(data)
        else:
            self.text += data
            if self.rows and ("td" in self._open or "th" in self._open):
                self.rows[-1][-1] += data

    def cells(self, first: str) -> dict[str, str]:
        """Cells of the results' row that begins with `first`, by their column's heading."""
        headings = next(row for row in self.rows if row and row[0] == "channel")
        return dict(zip(headings, next(r for r in self.rows if r and r[0].startswith(first)), strict=True))

    def figures(self) -> dict[str, Any]:
        blocks = [a for tag, a in self.tags if tag == "script"]
        found = zip(blocks, self.scripts, strict=True)
        return {str(a["id"]): json.loads(text) for a, text in found if a.get("type") == "application/json"}


def page(folder: Path, samples: Samples, summary: dict[str, Any], **more: Any) -> Page:
    write_report(samples, summary, folder / "report.html", **more)
    return Page(folder / "report.html")


def assert_offline(found: Page) -> None:
    """Nothing is loaded from anywhere, and the page forbids the browser to."""
    for tag, attributes in found.tags:
        assert tag not in ("link", "iframe", "img", "object", "base")
        assert "src" not in attributes
        assert (attributes.get("href") or "#").startswith("#")
    assert not re.search(r"url\(|@import", "".join(found.styles))
    own = [s for s in found.scripts if "plotly.js v" not in s[:200]]
    assert len(own) == len(found.scripts) - 1
    assert not [s for s in own if re.search(r"https?:|import|fetch|XMLHttpRequest", s)]
    policy = next(a["content"] for _, a in found.tags if a.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None
    assert "default-src 'none'" in policy
    assert "http" not in policy
