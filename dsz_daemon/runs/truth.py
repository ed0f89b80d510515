"""A run against the truth that only a simulation knows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.errors import InputError
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES

Columns = dict[str, np.ndarray[Any, np.dtype[Any]]]


def read_truth(path: Path) -> Columns:
    """The columns of a `truth.parquet`; `time_s` must be one of them."""
    columns = read_samples(path)
    if "time_s" not in columns:
        raise InputError(f"{path}: has no column time_s; expected a truth.parquet as `dsz simulate` writes it")
    return columns


def errors_against_truth(samples: Columns, truth: Columns) -> dict[str, dict[str, float]]:
    """Per channel (SI): true offset, last estimate, its error and spread, RMS error raw and compensated.

    RMS errors are those of the readings against the true motion, over the rows inside the truth's time.
    """
    time_s = samples["time_s"]
    inside = (time_s >= truth["time_s"][0]) & (time_s <= truth["time_s"][-1])
    found: dict[str, dict[str, float]] = {}
    for name in IMU_CHANNELS:
        unit = QUANTITIES[name].suffix
        if f"{name}_raw_{unit}" not in samples or f"{name}_{unit}" not in truth or not inside.any():
            continue
        true = np.interp(time_s[inside], truth["time_s"], truth[f"{name}_{unit}"])
        result = {
            "rms_error_raw": _rms(samples[f"{name}_raw_{unit}"][inside] - true),
            "rms_error_compensated": _rms(samples[f"{name}_{unit}"][inside] - true),
        }
        offset = truth.get(f"{name}_offset_{unit}")
        if offset is not None:
            last = float(np.interp(time_s[inside][-1], truth["time_s"], offset))
            estimate = float(samples[f"{name}_offset_{unit}"][inside][-1])
            result |= {
                "true_offset": last,
                "offset": estimate,
                "offset_error": estimate - last,
                "offset_std": float(samples[f"{name}_offset_std_{unit}"][inside][-1]),
            }
        found[name] = result
    return found


def _rms(error: np.ndarray[Any, np.dtype[Any]]) -> float:
    known = error[~np.isnan(error)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
