"""Estimated offsets against the truth: figures from rows that are written down by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.errors import InputError
from dsz_daemon.runs.truth import errors_against_truth, offset_errors, read_truth

NAN = math.nan


def test_the_error_at_times_the_coverage_and_from_when_on_it_is_good() -> None:
    time_s = 100.0 + np.arange(0.0, 62.0, 1.0)
    true = np.full(62, 2.0)
    # Nothing for 5 s; then 1.0 off and falling by 0.02 a second: from 40 s after the fifth on within 0.2.
    offset = np.concatenate([np.full(5, NAN), 3.0 - 0.02 * np.arange(57.0)])
    # A spread that holds the truth (1.96 x 0.4) as long as the error is 0.78 or less: not in the first 11.
    std = np.full(62, 0.4)
    found = offset_errors(time_s, offset, std, true, 0.2)
    assert found["error_at_s"] == {"30": pytest.approx(0.5), "60": pytest.approx(-0.1)}
    assert found["coverage_95"] == pytest.approx(46.0 / 57.0)
    assert found["within_goal_from_s"] == pytest.approx(46.0, abs=1.0)
    assert found["offset_error"] == pytest.approx(3.0 - 0.02 * 56.0 - 2.0)
    assert (found["true_offset"], found["offset_std"], found["goal"]) == (2.0, 0.4, 0.2)


def test_what_ends_beyond_its_goal_or_without_an_estimate_was_never_good() -> None:
    time_s = np.arange(10.0)
    good = np.zeros(10)
    gone = good.copy()
    gone[-1] = 0.3
    lost = good.copy()
    lost[-1] = NAN
    for offset in (gone, lost):
        assert offset_errors(time_s, offset, good + 1.0, good, 0.2)["within_goal_from_s"] is None
    assert offset_errors(time_s, good, good + 1.0, good, 0.2)["within_goal_from_s"] == 0.0
    nothing = offset_errors(time_s, np.full(10, NAN), good + 1.0, good, 0.2)
    assert nothing["coverage_95"] is None
    assert nothing["error_at_s"] == {}


def test_a_moving_offset_is_followed_where_it_was() -> None:
    time_s = np.arange(0.0, 40.0, 0.5)
    true = 0.01 * time_s
    found = offset_errors(time_s, true + 0.05, np.full(80, 0.03), true, 0.1)
    assert found["error_at_s"]["30"] == pytest.approx(0.05)
    assert found["true_offset"] == pytest.approx(0.395)
    assert found["coverage_95"] == 1.0
    assert offset_errors(time_s, true + 0.06, np.full(80, 0.03), true, 0.1)["coverage_95"] == 0.0


def test_rows_outside_the_truths_time_do_not_count() -> None:
    truth = {"time_s": np.array([10.0, 20.0]), "gyro_z_radps": np.array([0.0, 1.0])}
    truth["gyro_z_offset_radps"] = np.array([0.1, 0.1])
    time_s = np.array([5.0, 10.0, 15.0, 20.0, 25.0])
    raw = np.array([9.0, 0.1, 0.6, 1.1, 9.0])
    samples = {
        "time_s": time_s,
        "gyro_z_raw_radps": raw,
        "gyro_z_radps": raw - 0.1,
        "gyro_z_offset_radps": np.full(5, 0.1),
        "gyro_z_offset_std_radps": np.full(5, 0.01),
    }
    found = errors_against_truth(samples, truth, {"gyro_z": 0.05})
    assert found.keys() == {"gyro_z"}
    assert found["gyro_z"]["rms_error_raw"] == pytest.approx(0.1)
    assert found["gyro_z"]["rms_error_compensated"] == pytest.approx(0.0, abs=1e-12)
    assert found["gyro_z"]["within_goal_from_s"] == 0.0


def test_a_truth_without_time_is_refused(tmp_path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    path = tmp_path / "truth.parquet"
    pyarrow.parquet.write_table(pyarrow.table({"speed_mps": [1.0]}), path)
    assert "speed_mps" in read_samples(path)
    with pytest.raises(InputError, match="has no column time_s"):
        read_truth(path)
