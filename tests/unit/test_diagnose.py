"""`dsz diagnose` on drives of the simulated car, which shares no formula with it: silent, or the right name."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dsz_daemon.cli import main
from dsz_daemon.diagnose.comparison import FOLDS, Rows
from dsz_daemon.diagnose.evidence import Box, correlated_rows, gain, held_out, solved, sums
from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.runs.diagnose import diagnose
from dsz_daemon.runs.simulate import simulate


def diagnosed(folder: Path, *effects: str, seed: int = 5, scenario: str = "sine_steer") -> dict[str, Any]:
    simulate(scenario, folder, seed, None, list(effects), from_nominal=True)
    return diagnose([folder / "recording.log"], folder / "config.yaml", folder / "out")


def values(found: dict[str, Any]) -> dict[str, float]:
    [cause] = found["causes"]
    return {name: one["value"] for name, one in cause["parameters"].items()}


def test_where_nothing_is_left_out_nothing_is_said(tmp_path: Path) -> None:
    found = diagnosed(tmp_path)
    assert (found["verdict"], found["causes"], found["unlisted"], found["located"]) == ("consistent", [], [], [])
    kept = json.loads((tmp_path / "out/diagnosis.json").read_text())
    assert kept["verdict"] == "consistent"
    columns = read_samples(tmp_path / "out/fit.parquet")
    assert columns["time_s"][0] == pytest.approx(1_700_000_000.0, abs=0.1)
    assert {"gyro_z_measured", "gyro_z_nominal", "gyro_z_fitted", "road_bank_rad"} <= set(columns)


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        ("imu_misalignment:roll_rad=0.03,pitch_rad=-0.02,yaw_rad=0.04", (0.03, -0.02, 0.04)),
        ("steering_backlash:width_rad=0.01", (0.01,)),
        ("bias_drift:accel_z_per_s=0.002", None),
    ],
)
def test_one_thing_left_out_is_named(tmp_path: Path, effect: str, expected: tuple[float, ...] | None) -> None:
    found = diagnosed(tmp_path, effect)
    name = effect.partition(":")[0]
    assert [cause["effect"] for cause in found["causes"]] == [name]
    assert found["verdict"] == "explained"
    assert found["causes"][0]["probability"] > 0.9
    if expected is not None:
        for value, wanted in zip(values(found).values(), expected, strict=False):
            assert value == pytest.approx(wanted, abs=0.15 * abs(wanted) + 1e-3)
    improved = [fit["held_out"]["after"] < 0.8 * fit["held_out"]["before"] for fit in found["fit"].values()]
    assert any(improved)
    assert found["located"]


def test_what_no_name_fits_is_not_called_consistent(tmp_path: Path) -> None:
    """A reversed accelerometer has no name yet: the level of what is left must say that something is wrong."""
    found = diagnosed(tmp_path, "axis_fault:channel=accel_y,kind=reversed")
    assert found["verdict"] in {"unexplained", "partly_explained"}
    assert found["level"]["accel_y"] > 10.0
    assert max(value for name, value in found["level"].items() if name.startswith("gyro")) < 3.0
    assert "accel_y" in {place["channel"] for place in found["located"]}


def test_ratios_are_true_over_configured(tmp_path: Path) -> None:
    """As the contract has them, not as deviations."""
    found = diagnosed(tmp_path, "wheel_radius:fl=1.02,fr=1,rl=1,rr=1")
    radii = values(found)
    assert radii["fl"] / radii["rl"] == pytest.approx(1.02, abs=1e-3)
    assert radii["rl"] == pytest.approx(1.0, abs=0.01)


def test_a_wrong_recording_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    simulate("sine_steer", tmp_path, 1)
    few = [line for line in (tmp_path / "recording.log").read_text().splitlines() if "386#" not in line]
    (tmp_path / "few.log").write_text("\n".join(few[:3000]) + "\n")
    arguments = ["-c", str(tmp_path / "config.yaml"), "-o", str(tmp_path / "out")]
    assert main(["diagnose", str(tmp_path / "few.log"), *arguments]) == 3
    assert "wheel_speed_fl" in capsys.readouterr().err
    turnless = [line for line in (tmp_path / "recording.log").read_text().splitlines() if " 2B0#" not in line]
    (tmp_path / "turnless.log").write_text("\n".join(turnless) + "\n")
    assert main(["diagnose", str(tmp_path / "turnless.log"), *arguments]) == 3
    assert "steering" in capsys.readouterr().err
    standing = (tmp_path / "recording.log").read_text().splitlines()[:2500]
    (tmp_path / "standing.log").write_text("\n".join(standing) + "\n")
    assert main(["diagnose", str(tmp_path / "standing.log"), *arguments]) == 3
    assert "0.0 s of driving" in capsys.readouterr().err
    (tmp_path / "other.log").write_text("(1.0) can0 7FF#00\n(2.0) can0 7FF#00\n")
    assert main(["diagnose", str(tmp_path / "other.log"), *arguments]) == 3
    assert "none of the mapped messages" in capsys.readouterr().err


def test_without_scipy_the_desk_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.startswith(("dsz_daemon.diagnose", "dsz_daemon.runs.diagnose"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    assert main(["diagnose", "x.log", "-c", "x.yaml", "-o", str(tmp_path)]) == 4
    assert "pip install dsz-daemon[desk]" in capsys.readouterr().err


# --- the algebra -------------------------------------------------------------------------------------


def rows_of(k: int) -> Rows:
    return Rows(np.arange(k), np.ones((k, 1), bool), np.arange(k) // 20, np.zeros((k, 1)), np.zeros(1))


def test_a_fit_is_judged_on_blocks_that_it_has_not_seen() -> None:
    """Second route: numpy's least squares, fold by fold."""
    rng = np.random.default_rng(2)
    slopes, rows = rng.normal(size=(400, 1, 3)), rows_of(400)
    left = slopes[:, 0] @ [0.5, -1.0, 0.0] + rng.normal(size=400)
    found = sums(rows, left[:, np.newaxis], slopes, np.ones(1))
    free = Box(np.full(3, -np.inf), np.full(3, np.inf), np.zeros(3))
    unseen = held_out(found, range(3), free)
    for k in range(FOLDS):
        mine = rows.block % FOLDS == k
        step = np.linalg.lstsq(slopes[~mine, 0], left[~mine], rcond=None)[0]
        expected = np.sum((left[mine] - slopes[mine, 0] @ step) ** 2)
        assert unseen[np.arange(20) % FOLDS == k].sum() == pytest.approx(expected, rel=1e-6)


def test_the_box_holds() -> None:
    squares, cross = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([3.0, 3.0])
    free = Box(np.full(2, -9.0), np.full(2, 9.0), np.zeros(2))
    assert solved(squares, cross, free) == pytest.approx([1.0, 1.0])
    # With the first held at 0.5, the second solves 2 y + 0.5 = 3.
    tight = Box(np.array([-9.0, -9.0]), np.array([0.5, 9.0]), np.zeros(2))
    assert solved(squares, cross, tight) == pytest.approx([0.5, 1.25])


def test_what_hangs_together_counts_once() -> None:
    """An autoregression of 0.8: (1 + 0.8) / (1 - 0.8) = 9 rows tell as much as one."""
    rng = np.random.default_rng(4)
    noise, left = rng.normal(size=40_000), np.zeros(40_000)
    for i in range(1, len(left)):
        left[i] = 0.8 * left[i - 1] + noise[i]
    used = np.ones((len(left), 1), bool)
    assert correlated_rows(left[:, np.newaxis], used)[0] == pytest.approx(9.0, rel=0.15)
    assert correlated_rows(noise[:, np.newaxis], used)[0] == pytest.approx(1.0, abs=0.1)


def test_the_gain_is_a_log_likelihood_and_the_forms_coarseness_is_none() -> None:
    """A hundred rows of mean square 4 come down to 1: 50 ln 4; half of it for rows of which two count once."""
    before, after, count = np.array([[400.0]]), np.array([[100.0]]), np.array([[100.0]])
    assert gain(before, after, count, np.ones(1), np.zeros(1)) == pytest.approx(50.0 * np.log(4.0))
    assert gain(before, after, count, np.full(1, 2.0), np.zeros(1)) == pytest.approx(25.0 * np.log(4.0))
    assert gain(before, after, count, np.ones(1), np.full(1, 10.0)) == pytest.approx(50.0 * np.log(104.0 / 101.0))
