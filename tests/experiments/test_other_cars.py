"""Cars, sensors and buses that nothing else in the project knows: silent, or the right name, or no name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from other_cars import make, parsed

from dsz_daemon.runs.diagnose import diagnose


def diagnosed(folder: Path, seed: int, kind: str, *effects: str) -> dict[str, Any]:
    make(folder, seed, kind, parsed(effects))
    return diagnose([folder / "recording.log"], folder / "config.yaml", folder / "out")


# The first is rear-driven, turns hard, and is simulated in steps that hold their inputs.
@pytest.mark.parametrize(("seed", "kind"), [(3005, "city"), (5013, "highway")])
def test_where_nothing_is_left_out_nothing_is_said(tmp_path: Path, seed: int, kind: str) -> None:
    found = diagnosed(tmp_path, seed, kind)
    assert (found["verdict"], found["causes"], found["unlisted"]) == ("consistent", [], [])


def test_a_turned_imu_on_a_hilly_road_is_both(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 7006, "city", "imu_misalignment", "road_grade")
    causes = {cause["effect"]: cause["parameters"] for cause in found["causes"]}
    assert set(causes) == {"imu_misalignment", "road_grade"}
    for name, planted in (("roll_rad", 0.02), ("pitch_rad", 0.02), ("yaw_rad", 0.03)):
        one = causes["imu_misalignment"][name]
        assert abs(one["value"] - planted) < 3.0 * one["std"], name
        assert one["std"] < 0.003


def test_what_has_no_name_gets_none(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 7231, "city", "unlisted_magnet")
    assert found["causes"] == []
    assert [(one["channel"], one["shape"]) for one in found["unlisted"]] == [("wheel_speed_rl", "k*vx^2")]


def test_a_small_shape_is_not_called_by_the_name_that_comes_nearest(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 140, "city", "unlisted_drag_of_trailer@0.3")
    assert found["causes"] == []
    [one] = found["unlisted"]
    assert (one["channel"], one["shape"]) == ("gyro_z", "k*ay^3")
    planted = 0.3 * 4e-4
    # A simulation's small angles are of the same shape, and that is not in the spread.
    assert abs(one["coefficient"]["value"] - planted) < 0.15 * planted
