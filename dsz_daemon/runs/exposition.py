"""The Prometheus text format, version 0.0.4: families of samples in, one text out.

Source: https://prometheus.io/docs/instrumenting/exposition_formats/ (checked in the tests against
the parser of the prometheus_client package).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"


class Exposition:
    """Takes samples in any order; `text` has each family once, with its HELP and TYPE."""

    def __init__(self) -> None:
        self._heads: dict[str, str] = {}
        self._lines: dict[str, list[str]] = {}

    def gauge(self, name: str, meaning: str, value: float | None, labels: Mapping[str, str] | None = None) -> None:
        """A value that goes up and down; None (not known now) adds no sample."""
        self._add(name, "gauge", meaning, name, value, labels or {})

    def counter(self, name: str, meaning: str, value: float | None, labels: Mapping[str, str] | None = None) -> None:
        """A count that only grows while the daemon runs; `name` ends in `_total`."""
        self._add(name, "counter", meaning, name, value, labels or {})

    def one_of(
        self, name: str, meaning: str, label: str, all_of: list[str], now: str, labels: Mapping[str, str]
    ) -> None:
        """Which of several states holds: one gauge each, 1 for the one that does and 0 for the others."""
        for state in all_of:
            self.gauge(name, meaning, float(state == now), {**labels, label: state})

    def histogram(self, name: str, meaning: str, below: list[tuple[float, int]], total: int, summed: float) -> None:
        """Counts of values at or below each edge (cumulative), of all, and their sum."""
        for edge, count in below:
            self._add(name, "histogram", meaning, f"{name}_bucket", count, {"le": f"{edge:.4g}"})
        self._add(name, "histogram", meaning, f"{name}_bucket", total, {"le": "+Inf"})
        self._add(name, "histogram", meaning, f"{name}_sum", summed, {})
        self._add(name, "histogram", meaning, f"{name}_count", total, {})

    def _add(
        self, family: str, kind: str, meaning: str, name: str, value: float | None, labels: Mapping[str, str]
    ) -> None:
        if value is None:
            return
        if family not in self._heads:
            self._heads[family] = f"# HELP {family} {_escaped(meaning)}\n# TYPE {family} {kind}\n"
        shown = ",".join(f'{key}="{_quoted(label)}"' for key, label in labels.items())
        self._lines.setdefault(family, []).append(
            f"{name}{{{shown}}} {_shown(value)}\n" if shown else f"{name} {_shown(value)}\n"
        )

    def text(self) -> str:
        """The whole page."""
        return "".join(head + "".join(self._lines[family]) for family, head in self._heads.items())


def _shown(value: float) -> str:
    """A number as Go's parser reads it.

    >>> _shown(True), _shown(3), _shown(1e-06), _shown(float("inf"))
    ('1', '3', '1e-06', '+Inf')
    """
    if isinstance(value, int):
        return str(int(value))
    if math.isinf(value):
        return "+Inf" if value > 0 else "-Inf"
    return "NaN" if math.isnan(value) else repr(float(value))


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("\n", "\\n")


def _quoted(text: str) -> str:
    return _escaped(text).replace('"', '\\"')
