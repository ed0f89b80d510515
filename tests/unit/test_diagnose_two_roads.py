"""A road that banks and climbs at once is tried as both, where nothing alone gains much and much is off."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import TOLERANCE, T
from test_diagnose_unfelt_banks import tilted

from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection import search as search_module
from dsz_daemon.diagnose.selection import two_roads
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.selection.two_roads import both_roads

BOTH = ("road_bank", "road_grade")


def step(effect: str, gain: float, *effects: str) -> Any:
    return SimpleNamespace(effect=effect, gain=gain, fit=SimpleNamespace(effects=effects or (effect,)))


@pytest.mark.parametrize(
    ("alone", "together", "off", "there", "felt", "is_right", "is_taken"),
    [
        (50.0, 672.0, (3, 4), (), BOTH, True, True),
        (50.0, 149.0, (3, 4), (), BOTH, True, False),
        (50.0, 151.0, (3, 4), (), BOTH, True, True),
        (99.0, 672.0, (3, 4), (), BOTH, True, True),
        # What gains so much by itself comes first.
        (101.0, 672.0, (3, 4), (), BOTH, True, False),
        (None, 9.0, (3, 4), (), BOTH, True, False),
        (None, 11.0, (3, 4), (), BOTH, True, True),
        (50.0, 672.0, (3, 2), (), BOTH, True, False),
        (50.0, 672.0, (2, 4), (), BOTH, True, False),
        (50.0, 672.0, (3, 4), ("road_bank",), BOTH, True, False),
        (50.0, 672.0, (3, 4), ("gyro_scale",), BOTH, True, True),
        (50.0, 672.0, (3, 4), (), ("road_bank",), True, False),
        (50.0, 672.0, (3, 4), (), BOTH, False, False),
    ],
)
def test_both_are_tried_where_each_hides_the_other(
    monkeypatch: pytest.MonkeyPatch,
    alone: float | None,
    together: float,
    off: tuple[int, int],
    there: tuple[str, ...],
    felt: tuple[str, ...],
    is_right: bool,
    is_taken: bool,
) -> None:
    asked: list[Any] = []

    def tried(_: Any, starts: Any, refused: set[str], __: Any) -> list[Any]:
        asked.extend((names, refused) for names, _ in starts)
        return [step("road_grade", together, *there, *BOTH)]

    monkeypatch.setattr(two_roads, "far_off", lambda *_: np.isin(np.arange(13), off))
    monkeypatch.setattr(two_roads, "feels", lambda _, __, ___, road: road in felt)
    monkeypatch.setattr(two_roads, "tried_at_once", tried)
    monkeypatch.setattr(two_roads, "puts_right", lambda *_: is_right)
    trial: Any = SimpleNamespace(drive=None, rows=None, best=SimpleNamespace(effects=there, x=None))
    steps = [] if alone is None else [step("suspension_roll", 5.0), step("road_bank", alone)]
    got = both_roads(trial, steps, {"imu_delay"}, map)
    assert [one.gain for one in got] == ([together] if is_taken else [])
    assert asked in ([], [(BOTH, {"imu_delay"})])


def test_a_search_takes_both(monkeypatch: pytest.MonkeyPatch) -> None:
    """As soon as they are said to be there: with what both gain."""
    roads = {"bank_rad": 0.03 * np.sin(0.11 * T), "grade_rad": 0.03 * np.sin(0.07 * T)}
    one = tilted({}, (), **roads)
    asked: list[int] = []

    def at_first(trial: Any, tried: Any, refused: set[str], each: Any) -> list[Any]:
        asked.append(len(trial.best.effects))
        if trial.best.effects:
            return []
        steps = two_roads.tried_at_once(trial, [(BOTH, trial.best.x)], refused, each)
        assert {effect for one in steps for effect in one.fit.effects} == set(BOTH)
        return steps

    monkeypatch.setattr(search_module, "both_roads", at_first)
    search = searched(one, rows_of(one), TOLERANCE)
    assert asked[:2] == [0, 2]
    assert set(search.best.effects) == set(search.gains) == set(search.rivals) == set(BOTH)
