"""A run against the truth that only a simulation knows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.errors import InputError
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES

Column = np.ndarray[Any, np.dtype[Any]]
Columns = dict[str, Column]


def read_truth(path: Path) -> Columns:
    """The columns of a `truth.parquet`; `time_s` must be one of them."""
    columns = read_samples(path)
    if "time_s" not in columns:
        raise InputError(f"{path}: has no column time_s; expected a truth.parquet as `dsz simulate` writes it")
    return columns


# When the error of an offset is looked at, after the first row.
AT_S = (30.0, 60.0, 150.0, 600.0)
# A drive of 60 s has its last row a step before that.
_ALMOST_S = 0.1


def errors_against_truth(samples: Columns, truth: Columns, goals: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Per channel (SI): what `offset_errors` finds, and the RMS error raw and compensated.

    RMS errors are those of the readings against the true motion, over the rows inside the truth's time.
    """
    time_s = samples["time_s"]
    inside = (time_s >= truth["time_s"][0]) & (time_s <= truth["time_s"][-1])
    found: dict[str, dict[str, Any]] = {}
    for name in IMU_CHANNELS:
        unit = QUANTITIES[name].suffix
        if f"{name}_raw_{unit}" not in samples or f"{name}_{unit}" not in truth or not inside.any():
            continue
        true = np.interp(time_s[inside], truth["time_s"], truth[f"{name}_{unit}"])
        result: dict[str, Any] = {
            "rms_error_raw": _rms(samples[f"{name}_raw_{unit}"][inside] - true),
            "rms_error_compensated": _rms(samples[f"{name}_{unit}"][inside] - true),
        }
        offset = truth.get(f"{name}_offset_{unit}")
        if offset is not None:
            result |= offset_errors(
                time_s[inside],
                samples[f"{name}_offset_{unit}"][inside],
                samples[f"{name}_offset_std_{unit}"][inside],
                np.interp(time_s[inside], truth["time_s"], offset),
                goals[name],
            )
        found[name] = result
    return found


def offset_errors(time_s: Column, offset: Column, std: Column, true: Column, goal: float) -> dict[str, Any]:
    """How an estimated offset did, from rows of equal length.

    At the end: `true_offset`, `offset`, `offset_error`, `offset_std`. Over the drive: `error_at_s` (seconds after the
    first row -> error, where the drive is that long), `coverage_95` (share of rows whose band of 1.96 spreads holds the
    truth), `within_goal_from_s` (seconds after the first row, from when on the error stays within `goal`; None: it
    ends beyond). Rows without an estimate count as beyond the goal and not for the coverage.
    """
    since_s, error = time_s - time_s[0], offset - true
    known = ~np.isnan(error)
    beyond = np.flatnonzero(~known | (np.abs(np.where(known, error, 0.0)) > goal))
    first_good = int(beyond[-1]) + 1 if len(beyond) else 0
    within = np.abs(error[known]) <= 1.96 * std[known]
    reached = [at_s for at_s in AT_S if at_s <= since_s[-1] + _ALMOST_S]
    return {
        "true_offset": float(true[-1]),
        "offset": float(offset[-1]),
        "offset_error": float(error[-1]),
        "offset_std": float(std[-1]),
        "error_at_s": {f"{at_s:g}": float(error[_row(since_s, at_s)]) for at_s in reached},
        "coverage_95": float(np.mean(within)) if len(within) else None,
        "goal": goal,
        "within_goal_from_s": float(since_s[first_good]) if first_good < len(since_s) else None,
    }


def _row(since_s: Column, at_s: float) -> int:
    return min(int(np.searchsorted(since_s, at_s)), len(since_s) - 1)


def _rms(error: Column) -> float:
    known = error[~np.isnan(error)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
