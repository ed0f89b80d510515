"""For all tests."""

from __future__ import annotations

import importlib
import signal
from collections.abc import Sequence
from typing import Any

import pytest

from dsz_daemon.report import offline_page

# Whoever starts a job in the background of a shell has SIGINT ignored, and all programs that are started from there as
# well; tests that end one with Ctrl-C would wait for ever.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Stages of their own, for which `make` looks in the files that have such a mark written out.
_STAGES = ("vcan", "quiet", "long")


@pytest.fixture(autouse=True)
def _figures_are_plotlys(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever a test draws is what plotly's own classes take, which a run does not ask."""
    plain = offline_page.figure_json

    def checked(figure: dict[str, Any]) -> str:
        graph_objects = importlib.import_module("plotly.graph_objects")
        graph_objects.Figure({part: figure[part] for part in figure})
        return plain(figure)

    monkeypatch.setattr(offline_page, "figure_json", checked)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    """No test is marked in a way that `make` does not see: it would be in no stage at all."""
    unseen = [
        f"{item.nodeid} ({stage})"
        for stage in _STAGES
        for item in items
        if item.get_closest_marker(stage) and f"pytest.mark.{stage}" not in item.path.read_text(encoding="utf-8")
    ]
    if unseen:
        raise pytest.UsageError(f"marked otherwise than by pytest.mark in their own file: {', '.join(unseen)}")
