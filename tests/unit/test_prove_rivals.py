"""The rivals of a proof see what is there to be seen; and the page that shows them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("pysindy", reason="pysindy is not installed (extra: prove)")

from dsz_daemon.prove.rivals import rivals
from dsz_daemon.report.proof_page import confusion, planted, proof_page, reliability, sizes

T = np.arange(0.0, 120.0, 0.01)
NOISE = 0.01


def fitted(**left: np.ndarray) -> tuple[dict[str, Any], dict[str, Any]]:
    rng = np.random.default_rng(4)
    nominal = {
        "gyro_z": 0.3 * np.sin(0.5 * T) * (1.0 + 0.5 * np.sin(0.07 * T)),
        "accel_x": np.cos(0.31 * T),
        "accel_y": 3.0 * np.sin(0.5 * T + 0.3),
        "wheel_other_left": 12.0 + 3.0 * np.sin(0.31 * T),
    }
    columns: dict[str, Any] = {"time_s": T}
    for channel, course in nominal.items():
        more = left.get(channel, np.zeros(len(T)))
        columns[f"{channel}_nominal"] = course
        noise = 0.002 if channel.startswith("wheel") else NOISE
        columns[f"{channel}_measured"] = course + more + rng.normal(0.0, noise, len(T))
    return columns, {channel: {"noise_floor": NOISE} for channel in nominal if channel != "wheel_other_left"}


def test_nothing_is_named_of_noise_and_nothing_is_regained() -> None:
    found = rivals(*fitted())
    assert found.sparse == "nothing"
    assert found.boosted is None


def test_a_scale_error_is_found_by_both() -> None:
    found = rivals(*fitted(gyro_z=0.3 * np.sin(0.5 * T) * (1.0 + 0.5 * np.sin(0.07 * T))))
    assert found.sparse == "gyro_scale"
    assert found.boosted is not None
    assert found.boosted > 0.8


def test_what_is_a_term_without_a_name_is_said_as_such() -> None:
    assert rivals(*fitted(accel_x=2e-3 * (12.0 + 3.0 * np.sin(0.31 * T)) ** 2)).sparse in {"accel_x v", "accel_x v^2"}


def trial(number: int, **more: Any) -> dict[str, Any]:
    one = {"number": number, "car": "own", "kind": "city", "planted": ["gyro_scale"], "unlisted": [], "size": 1.0}
    one |= {"named": ["gyro_scale"], "shapes": [], "extra": [], "error": None, "verdict": "explained", "picture": None}
    return one | more


def test_the_page_shows_every_trial_and_bold_what_is_too_much() -> None:
    courses = {name: [0, 50, -100, 100] for name in ("before", "after")}
    trials = [
        trial(1),
        trial(2, named=["gyro_scale", "wheel_slip"], extra=["wheel_slip"], picture={"channel": "gyro_z"} | courses),
        trial(3, named=[], planted=[], unlisted=["magnet"], size=0.3, shapes=["wheel_speed_rl k*vx^2"]),
    ]
    rows = [{"size": 1.0, "car": "own", "hits": 1, "of": 2, "low": 0.1, "high": 0.9}]
    summary = {
        "false_alarms": {"hits": 0, "of": 3}, "sizes": rows, "reliability": [{"stated": 0.9, "right": 1.0, "of": 3}],
        "confusion": [("gyro_scale", "gyro_scale", 2)],
    }  # fmt: skip
    protocol = {"trials": 3, "seed": 1, "version": "0", "judge": "a" * 64}
    lines = [("what", "1 of 2", "at least 0.95", "**no**")]
    page = proof_page({"protocol": protocol, "summary": summary, "trials": trials}, lines, trials[1:2]).decode()
    assert page.count("<b>wheel_slip</b>") == 2
    assert page.count("<polyline") == 4
    assert "1 bars are not reached" in page
    assert "(no name) magnet at 0.3" in page
    assert "shape wheel_speed_rl k*vx^2" in page


def test_pictures_are_left_out_where_there_is_nothing_to_draw() -> None:
    assert sizes([]) is None
    assert reliability([]) is None
    assert confusion([]) is None
    found = confusion([("a", "b", 3), ("a", "nothing", 1)])
    assert found is not None
    assert found["data"][0]["x"] == ["b", "nothing"]
    assert found["data"][0]["z"] == [[3, 1]]
    assert planted(trial(1, size=0.1)) == "gyro_scale at 0.1"
