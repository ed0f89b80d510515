"""`dsz diagnose` on drives of the simulated car, which shares no formula with it: silent, or the right name."""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dsz_daemon import diagnose as api
from dsz_daemon.cli import main
from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose.fitting.spreads import covariance_of
from dsz_daemon.diagnose.residuals.comparison import FOLDS, Rows
from dsz_daemon.diagnose.residuals.evidence import (
    Box,
    Sums,
    correlated_rows,
    gain,
    held_out,
    held_out_kinds,
    scatter_of,
    solved,
    sums,
)
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.errors import InputError
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.runs.diagnose import diagnose, signals_of, words
from dsz_daemon.runs.setup import set_up
from dsz_daemon.runs.simulate import simulate
from dsz_daemon.runs.states_file import read_states
from dsz_daemon.signals import IMU_CHANNELS


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


def test_an_axis_that_is_turned_round_is_said_and_nothing_else(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, "axis_fault:channel=accel_y,kind=reversed")
    assert [cause["effect"] for cause in found["causes"]] == ["axis_fault"]
    assert values(found) == {"channel": "accel_y", "kind": "reversed"}
    assert found["fit"]["accel_y"]["held_out"]["after"] < 0.1
    assert "accel_y is not what it is called: reversed" in words(found)


def signals_and_car(folder: Path, *effects: str) -> tuple[dict[str, Signal], Car, float]:
    simulate("sine_steer", folder, 5, None, list(effects), from_nominal=True)
    setup = set_up(folder / "config.yaml")
    signals = signals_of(setup, [folder / "recording.log"], LogReport())
    vehicle = setup.settings.vehicle
    return signals, vehicle.car(), vehicle.steering_ratio


def lifted(signals: dict[str, Signal], k: float) -> dict[str, Signal]:
    """As if the vertical accelerometer read k v^3 more: rectified vibration, for which there is no name."""
    accel = signals["accel_z"]
    rear = [signals[f"wheel_speed_{wheel}"] for wheel in ("rl", "rr")]
    speed = np.mean([np.interp(accel.t_ns, wheel.t_ns, wheel.values) for wheel in rear], axis=0)
    return signals | {"accel_z": accel._replace(values=accel.values + k * speed**3)}


def test_what_no_name_fits_is_given_its_shape_and_no_name(tmp_path: Path) -> None:
    signals, car, ratio = signals_and_car(tmp_path)
    found = api.diagnose(lifted(signals, 1e-4), car, ratio).said
    assert (found.verdict, found.causes) == ("unexplained", [])
    [shape] = found.unlisted
    assert (shape.channel, shape.shape) == ("accel_z", "k*vx^3")
    assert shape.coefficient.value == pytest.approx(1e-4, rel=0.05)


def test_an_effect_of_ones_own_is_named(tmp_path: Path) -> None:
    """The example of docs/diagnose.md."""

    def shaken(motion: api.Motion, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        return {"accel_z": values["k"] * motion.speed_mps**3}

    vibration = api.Effect(
        name="rectified_vibration",
        words="Vibration shifts the vertical accelerometer by {k:.1e} v^3",
        equation="reading_z += k v^3",
        touches=api.SENSORS,
        parameters=(api.Parameter("k", "s/m2", step=1e-4, low=-1e-2, high=1e-2, least=1e-6),),
        shows=shaken,
    )
    signals, car, ratio = signals_and_car(tmp_path)
    found = api.diagnose(lifted(signals, 1e-4), car, ratio, effects=(vibration,)).said
    [cause] = found.causes
    assert (cause.effect, found.verdict, found.unlisted) == ("rectified_vibration", "explained", [])
    assert cause.parameters["k"].value == pytest.approx(1e-4, rel=0.05)
    assert "1.0e-04 v^3" in cause.statement


def test_a_simulation_of_ones_own_is_what_is_held_against(tmp_path: Path) -> None:
    """The truth stands for a perfect one: it leaves nothing to be said but what the sensors do."""
    signals, car, ratio = signals_and_car(tmp_path / "good")
    perfect = read_states(tmp_path / "good/truth.parquet").signals
    same = api.diagnose(signals, car, ratio, simulation={name: perfect[name] for name in IMU_CHANNELS}).said
    assert (same.verdict, same.causes) == ("consistent", [])
    signals, car, ratio = signals_and_car(
        tmp_path / "bad", "imu_misalignment:roll_rad=0.03,pitch_rad=-0.02,yaw_rad=0.04"
    )
    found = api.diagnose(signals, car, ratio, simulation={name: perfect[name] for name in IMU_CHANNELS}).said
    assert [cause.effect for cause in found.causes] == ["imu_misalignment"]
    assert found.causes[0].parameters["yaw_rad"].value == pytest.approx(0.04, abs=2e-3)
    with pytest.raises(InputError, match="nothing to hold it against"):
        api.diagnose(signals, car, ratio, simulation={"speed_mps": signals["wheel_speed_fl"]})


def test_recordings_of_two_days_are_one_car(tmp_path: Path) -> None:
    """The night between them is no drive, no memory and no hole; what both have is learnt from either for the other."""
    simulate("sine_steer", tmp_path, 5, None, ["imu_misalignment"], from_nominal=True)
    late = []
    for line in (tmp_path / "recording.log").read_text().splitlines(keepends=True):
        stamp, rest = line[1:].split(")", 1)
        late.append(f"({float(stamp) + 86_400.0:.6f}){rest}")
    (tmp_path / "late.log").write_text("".join(late))
    found = diagnose([tmp_path / "recording.log", tmp_path / "late.log"], tmp_path / "config.yaml", tmp_path / "out")
    [cause] = found["causes"]
    assert cause["effect"] == "imu_misalignment"
    assert cause["elsewhere"]["recordings"] > 10.0
    assert len(read_samples(tmp_path / "out/fit.parquet")["time_s"]) < 50_000
    assert {place["start_s"] > 80_000.0 for place in found["located"]} == {False, True}


def test_each_days_offsets_are_its_own(tmp_path: Path) -> None:
    """An IMU that wakes up 0.01 rad/s and 0.2 m/s2 further off on the second day does not drift, and lacks nothing."""
    signals, car, ratio = signals_and_car(tmp_path)
    day = int(86_400e9)
    both = {}
    for name, signal in signals.items():
        more = {"gyro_z": 0.01, "accel_x": -0.2, "accel_y": 0.2}.get(name, 0.0)
        t_ns, values = (
            np.concatenate((signal.t_ns, signal.t_ns + day)),
            np.concatenate((signal.values, signal.values + more)),
        )
        both[name] = signal._replace(t_ns=t_ns, values=values)
    found = api.diagnose(both, car, ratio)
    assert (found.said.verdict, found.said.causes, found.said.unlisted) == ("consistent", [], [])
    one = api.diagnose(signals, car, ratio).said.offsets["offset_gyro_z"]
    # What is told is the mean of both.
    assert found.said.offsets["offset_gyro_z"].value == pytest.approx(one.value + 0.005, abs=5e-4)


def test_a_reference_speed_tells_the_common_wheel_factor(tmp_path: Path) -> None:
    """All four wheels 1 % larger than configured: wheels alone can't tell; a measured speed does."""
    signals, car, ratio = signals_and_car(tmp_path, "wheel_radius:fl=1.01,fr=1.01,rl=1.01,rr=1.01")
    truth = read_states(tmp_path / "truth.parquet").signals
    found = api.diagnose(signals, car, ratio, reference={"speed_mps": truth["speed_mps"]}).said
    [cause] = found.causes
    assert cause.effect == "wheel_radius"
    for wheel in ("fl", "fr", "rl", "rr"):
        assert cause.parameters[wheel].value == pytest.approx(1.01, abs=5e-4)


def test_files_beside_the_recording_are_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    simulate("sine_steer", tmp_path, 5, from_nominal=True)
    arguments = [
        "diagnose",
        str(tmp_path / "recording.log"),
        "-c",
        str(tmp_path / "config.yaml"),
        "-o",
        str(tmp_path / "o"),
    ]
    assert main([*arguments, "--reference", str(tmp_path / "truth.parquet")]) == 0
    found = json.loads((tmp_path / "o/diagnosis.json").read_text())
    assert found["source"]["reference"] == "truth.parquet"
    assert "reference_vx_mps" in found["fit"]
    page = (tmp_path / "o/report.html").read_text(encoding="utf-8")
    assert "recording.log" in page
    capsys.readouterr()
    assert main([*arguments, "--simulation", str(tmp_path / "none.csv")]) == 3
    assert "none.csv" in capsys.readouterr().err


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
    told = capsys.readouterr().err
    assert "0.0 s of driving" in told
    assert "without samples" not in told
    # A gateway that lets one steering message in thirty through.
    frames = (tmp_path / "recording.log").read_text().splitlines()
    left = set([frame for frame in frames if " 2B0#" in frame][::30])
    sparse = [frame for frame in frames if " 2B0#" not in frame or frame in left]
    (tmp_path / "sparse.log").write_text("\n".join(sparse) + "\n")
    assert main(["diagnose", str(tmp_path / "sparse.log"), *arguments]) == 3
    assert "without samples for more than 0.25 s: steering_wheel_angle 100%" in capsys.readouterr().err
    (tmp_path / "other.log").write_text("(1.0) can0 7FF#00\n(2.0) can0 7FF#00\n")
    assert main(["diagnose", str(tmp_path / "other.log"), *arguments]) == 3
    assert "none of the mapped messages" in capsys.readouterr().err
    # A DBC that has the wheels' message with 29 bits.
    text = (tmp_path / "car.dbc").read_text()
    (tmp_path / "car.dbc").write_text(text.replace("BO_ 902 ", f"BO_ {902 + 2**31} "))
    assert main(["diagnose", str(tmp_path / "recording.log"), *arguments]) == 3
    told = capsys.readouterr().err
    assert "wheel_speed_fl, wheel_speed_fr, wheel_speed_rl, wheel_speed_rr (no frame of it; " in told
    assert "frames have its id as standard (11 bit), the DBC as extended (29 bit))" in told


def test_without_scipy_the_desk_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "scipy" else pytest.fail(name))
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


def test_what_is_far_off_pulls_no_harder_than_at_the_bound() -> None:
    """Huber's normal equations by hand: the row 10 deviations off counts 4 of its 10."""
    rows = Rows(np.arange(2), np.ones((2, 1), bool), np.zeros(2, dtype=int), np.zeros((2, 1)), np.zeros(1))
    left, slopes = np.array([[2.0], [-20.0]]), np.array([[[3.0]], [[5.0]]])
    near, far = sums(rows, left, slopes, np.array([2.0])), sums(rows, left, slopes, np.array([2.0]), 4.0)
    assert near.cross[0, 0, 0] == pytest.approx((3.0 * 2.0 - 5.0 * 20.0) / 4.0)
    assert near.squares[0, 0, 0, 0] == pytest.approx((9.0 + 25.0) / 4.0)
    assert far.cross[0, 0, 0] == pytest.approx((3.0 * 2.0 - 0.4 * 5.0 * 20.0) / 4.0)
    assert far.squares[0, 0, 0, 0] == pytest.approx((9.0 + 0.4 * 25.0) / 4.0)


def test_the_box_holds() -> None:
    squares, cross = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([3.0, 3.0])
    free = Box(np.full(2, -9.0), np.full(2, 9.0), np.zeros(2))
    assert solved(squares, cross, free) == pytest.approx([1.0, 1.0])
    # With the first held at 0.5, the second solves 2 y + 0.5 = 3.
    tight = Box(np.array([-9.0, -9.0]), np.array([0.5, 9.0]), np.zeros(2))
    assert solved(squares, cross, tight) == pytest.approx([0.5, 1.25])


def one_slope(slopes: np.ndarray, left: np.ndarray) -> Sums:
    """Sums over 20 blocks of 25 rows, in one channel of thirteen."""
    used = np.zeros((500, 13), dtype=np.bool_)
    used[:, 0] = True
    table, column = np.zeros((500, 13, 1)), np.zeros((500, 13))
    table[:, 0, 0], column[:, 0] = slopes, left
    block = np.repeat(np.arange(20), 25)
    return sums(Rows(np.arange(500), used, block, np.zeros((500, 13)), np.zeros(13)), column, table, np.ones(13))


ONE = Box(np.full(1, -1e6), np.full(1, 1e6), np.full(1, 1e-9))
KINDS = (np.arange(20) >= 10).astype(np.int64)


def test_whole_kinds_are_held_out_together() -> None:
    """Of two recordings that deny each other, either is predicted worse by the other than by nothing."""
    rng = np.random.default_rng(5)
    slopes = rng.normal(size=500)
    left = slopes * np.where(np.arange(500) < 250, 1.0, -1.0)
    unseen = held_out_kinds(one_slope(slopes, left), [0], ONE, KINDS, np.ones(13))
    # The other recording's coefficient is the negative of one's own: twice the distance, four times the square.
    assert unseen.sum() == pytest.approx(4.0 * float(np.sum(left**2)), rel=0.02)


@pytest.mark.parametrize("seed", range(5))
def test_what_calm_driving_leaves_open_denies_nothing(seed: int) -> None:
    """Slopes of 0.01 in calm driving leave a coefficient open to +- 6, of which a hard bend would show all."""
    rng = np.random.default_rng(seed)
    slopes = rng.normal(size=500) * np.where(np.arange(500) < 250, 0.01, 1.0)
    left = rng.normal(size=500)
    found = one_slope(slopes, left)
    unseen = held_out_kinds(found, [0], ONE, KINDS, np.ones(13))
    assert unseen.sum() == pytest.approx(float(np.sum(left**2)), rel=0.05)
    # By its own, calm driving predicts nonsense.
    calm = np.sum(slopes[:250] * left[:250]) / np.sum(slopes[:250] ** 2)
    assert np.sum((left[250:] - calm * slopes[250:]) ** 2) > 1.3 * np.sum(left[250:] ** 2)


@pytest.mark.parametrize(("share", "is_asked"), [(0.1, False), (0.15, True)])
def test_what_one_kind_shows_nearly_alone_the_others_are_not_asked(share: float, is_asked: bool) -> None:
    """Of a slope of 0.1 they show 1 % of its square, of 0.15 2.2 %: the rest are errors that hang together there."""
    rng = np.random.default_rng(4)
    hard = np.arange(500) >= 250
    slopes = rng.normal(size=500) * np.where(hard, 1.0, share)
    left = slopes * np.where(hard, 1.0, -9.0) + 1e-3 * rng.normal(size=500)
    unseen = held_out_kinds(one_slope(slopes, left), [0], ONE, KINDS, np.ones(13)).sum(axis=1)[10:].sum()
    whole = np.sum(slopes * left) / np.sum(slopes**2)
    best = float(np.sum((left - whole * slopes)[hard] ** 2))
    assert unseen == pytest.approx(best if not is_asked else 100.0 * float(np.sum(slopes[hard] ** 2)), rel=0.05)


def test_a_spread_is_that_of_whole_blocks() -> None:
    """Errors that are the same all through a block: sum of (25 c_b)^2 over the square of 500, by hand."""
    errors = np.random.default_rng(6).normal(size=20)
    found = one_slope(np.ones(500), np.repeat(errors, 25))
    [[variance]] = covariance_of(found, np.ones(13), ONE.weight, np.zeros((20, 13)), np.full((20, 13), 9.0))
    assert variance == pytest.approx(float(np.sum((25.0 * errors) ** 2)) / 500.0**2)
    # White errors of the same size: their mean square over the rows; the blocks' sums say no more than that.
    found = one_slope(np.ones(500), np.tile([1.0, -1.0], 250))
    [[variance]] = covariance_of(found, np.ones(13), ONE.weight, np.zeros((20, 13)), np.ones((20, 13)))
    assert variance == pytest.approx(1.0 / 500.0)


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


def test_a_block_that_is_far_off_does_not_hide_what_the_others_gain() -> None:
    """Nine blocks come down from a mean square of 4 to 1 each, beside one of 10 000 that nothing changes."""
    before, after, count = np.full((10, 1), 400.0), np.full((10, 1), 100.0), np.full((10, 1), 100.0)
    before[3], after[3] = 1e6, 1e6
    found = gain(before, after, count, np.ones(1), np.zeros(1))
    assert found == pytest.approx(450.0 * np.log(4.0), rel=0.05)
    # What only that block gains counts by its own rows, too: 56 of t, of which 50 are the normal distribution's.
    there = before * np.where(np.arange(10) == 3, 0.25, 1.0)[:, np.newaxis]
    assert gain(before, there, count, np.ones(1), np.zeros(1)) == pytest.approx(56.0 * np.log(4.0), rel=0.05)


def test_a_block_scatters_by_itself_as_far_as_its_rows_tell() -> None:
    """Twelve rows of the channel's own scatter, and the block's: (12 + n 9) / (12 + n) in the loud one."""
    block, used = np.repeat(np.arange(10), 100), np.zeros((1000, 13), bool)
    used[:, 0] = True
    left = np.zeros((1000, 13))
    left[:, 0] = np.random.default_rng(3).choice([-1.0, 1.0], 1000) * np.where(block == 4, 3.0, 1.0)
    rows = Rows(np.arange(1000), used, block, np.zeros((1000, 13)), np.zeros(13))
    found = scatter_of(rows, left, np.full(13, np.nan))[:, 0]
    # The robust deviation of +-1 is 1.4826 of it.
    whole = 1.4826**2
    assert found[4] == pytest.approx(math.sqrt((12.0 * whole + 900.0) / 112.0), rel=0.01)
    assert np.delete(found, 4) == pytest.approx(math.sqrt((12.0 * whole + 100.0) / 112.0), rel=0.01)
    assert scatter_of(rows, left, np.full(13, 2.0))[:, 0].min() == 2.0


def test_sums_are_in_the_scatter_of_their_block() -> None:
    block, used = np.repeat([0, 1], 250), np.ones((500, 1), bool)
    rows = Rows(np.arange(500), used, block, np.zeros((500, 13)), np.zeros(13))
    found = sums(rows, np.full((500, 1), 6.0), np.full((500, 1, 1), 2.0), np.array([[1.0], [3.0]]))
    assert found.left[:, 0].tolist() == pytest.approx([250 * 36.0, 250 * 4.0])
    assert found.squares[:, 0, 0, 0].tolist() == pytest.approx([250 * 4.0, 250 * 4.0 / 9.0])
    assert found.cross[:, 0, 0].tolist() == pytest.approx([250 * 12.0, 250 * 12.0 / 9.0])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("sum_of_squares", [-100.0, math.nan, math.inf])
def test_what_became_unstable_gains_nothing_without_a_word(sum_of_squares: float) -> None:
    after, count = np.array([[sum_of_squares, 1.0]]), np.array([[100.0, 100.0]])
    assert gain(np.full((1, 2), 400.0), after, count, np.ones(2), np.zeros(2)) == -math.inf
    # Rounding is no instability.
    after[0, 0] = -1e-9
    assert math.isfinite(gain(np.full((1, 2), 400.0), after, count, np.ones(2), np.zeros(2)))


def test_configured_figures_have_their_digits() -> None:
    nothing = {"verdict": "consistent", "causes": [], "unlisted": [], "level": {}}
    nothing |= {"same_as_offsets": [], "same_as_slip": []}
    none = {"located": [], "fit": {}, "could_not_test": []}
    errors = [
        {"parameter": "front_track_m", "configured": 1.591, "fitted": 1.468, "std": 0.01},
        {"parameter": "rear_cornering_stiffness_n_per_rad", "configured": 31296.0, "fitted": 28445.2, "std": 654.3},
    ]
    told = words(nothing | none | {"parameter_errors": errors})
    assert "front_track_m: configured 1.591, fits best at 1.468 +- 0.01" in told
    assert "rear_cornering_stiffness_n_per_rad: configured 31296, fits best at 28445 +- 654" in told
