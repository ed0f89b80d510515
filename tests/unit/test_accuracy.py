"""`dsz bench accuracy`: its readings are those of the recording, its rivals do what they say, its page counts right."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dsz_daemon.cli import main
from dsz_daemon.core import batch
from dsz_daemon.core.state import initial_state
from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.runs import accuracy, accuracy_page, rivals
from dsz_daemon.runs.replay import replay
from dsz_daemon.runs.simulate import simulate
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES, STANDARD_GRAVITY_MPS2
from dsz_daemon.sim import scenario as scenarios

G = STANDARD_GRAVITY_MPS2


def test_a_trial_is_a_replay_of_the_recording(tmp_path: Path) -> None:
    """Frames, decoder, loop and step one by one on one side; arrays and the compiled step on the other."""
    simulate("sine_steer", tmp_path, 3)
    replay([tmp_path / "recording.log"], tmp_path / "config.yaml", tmp_path / "out")
    samples = read_samples(tmp_path / "out/samples.parquet")

    bench = accuracy._bench("sine_steer")
    series = scenarios.series_of(bench.scenario, bench.columns, scenarios.drawn_errors(3), 3)
    ticks_ns, inputs = accuracy.gridded_inputs(bench.setup, series)
    tuning = bench.setup.settings.estimator.tuning()
    rows = batch.run(bench.setup.settings.vehicle.car(), tuning, initial_state(tuning), inputs, 0.01)[1]

    np.testing.assert_allclose(ticks_ns * 1e-9, samples["time_s"], atol=1e-6, rtol=0.0)
    for axis, name in enumerate(IMU_CHANNELS):
        unit = QUANTITIES[name].suffix
        raw = samples[f"{name}_raw_{unit}"]
        np.testing.assert_allclose(inputs[:, axis], raw, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(rows[:, batch.OFFSET + axis], samples[f"{name}_offset_{unit}"], atol=1e-9)
        np.testing.assert_allclose(rows[:, batch.STD + axis], samples[f"{name}_offset_std_{unit}"], atol=1e-9)


# --- the rivals ---------------------------------------------------------------------------------


def still(readings: list[float], wheels: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """gyro_x as given, the rest of a level car at rest; all wheels alike."""
    all_six = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, G], (len(readings), 1))
    all_six[:, 0] = readings
    return all_six, np.tile(np.array(wheels)[:, np.newaxis], (1, 4))


def test_raw_takes_nothing_off() -> None:
    assert not rivals.raw(*still([1.0, 2.0], [0.0, 0.0]), 0.5).any()


def test_standstill_is_averaged_after_a_second_and_kept_until_the_next() -> None:
    """Two rows a second: the first two rows of each stop are waited for."""
    readings = [9.0, 9.0, 1.0, 3.0, 7.0, 7.0, 9.0, 9.0, 5.0]
    wheels = [0.0, 0.0, 0.0, 0.0, 5.0, 5.0, 0.0, 0.0, 0.0]
    offset = rivals.zero_at_standstill(*still(readings, wheels), 0.5)
    assert offset[:, 0].tolist() == [0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 5.0]
    assert not offset[:, 1:].any()


def test_a_stop_too_short_teaches_nothing() -> None:
    offset = rivals.zero_at_standstill(*still([4.0, 4.0, 4.0], [0.0, 0.0, 3.0]), 0.5)
    assert not offset.any()


def test_a_missing_reading_is_left_out_of_the_mean() -> None:
    offset = rivals.zero_at_standstill(*still([0.0, 0.0, 2.0, float("nan"), 4.0], [0.0] * 5), 0.5)
    assert offset[:, 0].tolist() == [0.0, 0.0, 2.0, 2.0, 3.0]


def test_the_high_pass_is_a_mean_at_first_and_forgets_by_its_time_constant() -> None:
    """A step of 1 after 120 s of nothing: 1 - 1/e of it after 60 s."""
    readings = [0.0] * 1200 + [1.0] * 600
    offset = rivals.high_pass(*still(readings, [1.0] * 1800), 0.1)
    assert offset[1199, 0] == 0.0
    assert offset[-1, 0] == pytest.approx(1.0 - np.exp(-1.0), abs=1e-3)
    first = rivals.high_pass(*still([1.0, 2.0, 6.0], [1.0] * 3), 0.1)
    assert first[:, 0] == pytest.approx([1.0, 1.5, 3.0])


# --- the command ----------------------------------------------------------------------------------


def test_what_is_there_is_not_done_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["bench", "accuracy", "--scenario", "sine_steer", "-o", str(tmp_path), "--jobs", "1", "--json"]
    assert main([*arguments, "--seeds", "1"]) == 0
    first = json.loads(capsys.readouterr().out)["trials"]
    [kept] = tmp_path.glob("trials-*/sine_steer-*.json")
    kept.write_text(json.dumps(first[0] | {"marked": True}))
    assert main([*arguments, "--seeds", "2"]) == 0
    both = json.loads(capsys.readouterr().out)["trials"]
    assert [trial["seed"] for trial in both] == [1, 2]
    assert both[0]["marked"]
    assert "marked" not in both[1]


def test_a_wrong_name_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "accuracy", "--scenario", "moon", "-o", str(tmp_path)]) == 2
    assert "moon" in capsys.readouterr().err
    assert main(["bench", "speed"]) == 2
    assert main(["bench", "accuracy", "--seeds", "0"]) == 2
    assert main(["bench", "accuracy", "--page", str(tmp_path / "no/page.md"), "--seeds", "1", "-o", str(tmp_path)]) == 4


def trial(seed: int, ours: float, raw: float) -> dict[str, object]:
    def one(error: float) -> dict[str, object]:
        return {
            "error_at_s": {"30": error},
            "offset_error": error,
            "coverage_95": 0.5,
            "within_goal_from_s": None if seed == 1 else 12.0,
        }

    each = dict.fromkeys(accuracy.ESTIMATORS, one(9.0)) | {accuracy.PAPER: one(ours), accuracy.RAW: one(raw)}
    return {"scenario": "city", "seed": seed, "channels": dict.fromkeys(IMU_CHANNELS, each)}


def test_the_page_has_medians_and_says_where_we_do_harm() -> None:
    """Errors 1, -2, 3 of ours: median 2, 90th percentile 2.8; raw 0.5 is better."""
    trials = [trial(1, 1.0, 0.5), trial(2, -2.0, -0.5), trial(3, 3.0, 0.5)]
    page = accuracy_page.page({"trials": trials, "scenarios": ["city"], "seeds": 3, "version": "0"})
    assert "| accel_x, m/s2 | 30 s | **0.500 / 0.500** | 9.000 / 9.000 " in page
    assert "| 2.000 / 2.800 |" in page
    assert "- city, accel_x: 2.000 instead of 0.500 m/s2" in page
    assert "50 % / 12 s" in page
    degrees = f"{np.degrees(2.0):.3f}"
    assert f"- city, gyro_x: {degrees} instead of" in page


def test_the_page_of_the_docs_is_of_a_hundred_seeds_and_every_scenario() -> None:
    page = (Path(__file__).parents[2] / "docs/accuracy.md").read_text()
    assert "seeds 1 to 100 in each of 13 scenarios" in page
    assert all(f"| {name} |" in page for name in scenarios.scenario_names())
