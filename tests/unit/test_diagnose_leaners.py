"""What is not told is no ground for what is: what gains too little without it is not told either."""

from __future__ import annotations

from typing import Any

import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection import smaller as smaller_module
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.selection.smaller import without_leaners
from dsz_daemon.diagnose.simulation.drive import nothing

MOUNT = "imu_misalignment"


@pytest.mark.parametrize(
    ("effect", "told", "gain", "alone", "stays"),
    [
        ("gyro_g_sensitivity", False, 28.0, 19.0, False),
        ("gyro_g_sensitivity", False, 28.0, 21.0, True),
        ("gyro_g_sensitivity", False, 150.0, 1.0, True),
        ("gyro_g_sensitivity", True, 28.0, 1.0, True),
        # A profile fits nearly anything, and has to gain twice as much.
        ("road_bank", False, 60.0, 39.0, False),
        ("road_bank", False, 60.0, 41.0, True),
    ],
)
def test_what_leans_on_what_is_not_told_has_to_go(
    monkeypatch: pytest.MonkeyPatch, effect: str, told: bool, gain: float, alone: float, stays: bool
) -> None:
    one = drive({"gyro_g_sensitivity.zy": 1e-3}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    best = fitted(one, rows, nothing(), (MOUNT, effect), TOLERANCE)
    asked: list[tuple[tuple[str, ...], tuple[str, ...]]] = []

    def gained(_drive: Any, smaller: Fit, larger: Fit) -> float:
        asked.append((smaller.effects, larger.effects))
        return alone

    monkeypatch.setattr(smaller_module, "gained", gained)
    monkeypatch.setattr(smaller_module, "is_told", lambda _, __, name: told or name == effect)
    rest = without_leaners(one, rows, best, TOLERANCE, {MOUNT: 30.0, effect: gain}, map)
    assert rest.effects == ((MOUNT, effect) if stays else (MOUNT,))
    assert asked == ([((), (effect,))] if not told and gain < 100.0 else [])


def test_a_search_ends_without_what_leans(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two that gain little the first is not told; without it the other gains nothing."""
    one = drive({"accel_scale.y": 0.02, "gyro_cross_axis.xz": 0.02}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    before = searched(one, rows, TOLERANCE)
    assert set(before.best.effects) == {"accel_scale", "gyro_cross_axis"}
    monkeypatch.setattr(smaller_module, "is_told", lambda _, __, effect: effect != "accel_scale")
    monkeypatch.setattr(smaller_module, "BY_ITSELF", 1e9)
    monkeypatch.setattr(smaller_module, "told_from", lambda *_: 1e9)
    assert searched(one, rows, TOLERANCE).best.effects == ("accel_scale",)
