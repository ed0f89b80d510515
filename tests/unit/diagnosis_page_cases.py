"""A diagnosis as it may be written, a drive with a known residual, and the page of both, taken apart."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from report_cases import Page

from dsz_daemon.report.diagnosis_page import diagnosis_page

NAN = math.nan
EVIL = "<script>alert(1)</script>"
STEMS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
WHEEL_STEMS = ("wheel_other_left", "wheel_other_right", "wheel_difference")
Floats = np.ndarray[Any, np.dtype[np.float64]]


def drive(seconds: float = 60.0, seed: int = 1) -> dict[str, Floats]:
    """100 Hz: 10 m/s from the 10th second on; all that is left is white noise, before with a slow swing on top."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(round(100 * seconds)) / 100.0
    columns = {"time_s": 1.7e9 + time_s}
    for stem in (*STEMS, *WHEEL_STEMS):
        base = np.sin(0.5 * time_s)
        if stem.startswith("wheel_other"):
            base = np.where(time_s < 10.0, 0.0, 10.0)
        columns[f"{stem}_measured"] = base + 0.01 * rng.standard_normal(len(time_s))
        columns[f"{stem}_nominal"] = base - 0.1 * np.sin(2.0 * time_s)
        columns[f"{stem}_fitted"] = base
    columns["road_bank_rad"] = np.full(len(time_s), 0.02)
    columns["road_grade_up_rad"] = np.zeros(len(time_s))
    return columns


def fit(before: float, after: float, unit: str = "m/s^2") -> dict[str, Any]:
    return {
        "train": {"before": 0.5 * before, "after": 0.5 * after},
        "held_out": {"before": before, "after": after},
        "noise_floor": 0.01,
        "unit": unit,
    }


def cause(effect: str = "imu_lever_arm", **more: Any) -> dict[str, Any]:
    return {
        "effect": effect,
        "probability": 0.97,
        "statement": "The IMU sits +0.48 m ahead of the C.G.",
        "equation": "a_IMU = a + w' x rho",
        "parameters": {"x_m": {"value": 0.48, "std": 0.01, "unit": "m"}},
        "indistinguishable_from": [],
        "next_manoeuvre": None,
        "gain": 123.4,
    } | more


def diagnosis(**more: Any) -> dict[str, Any]:
    fits = {name: fit(0.2, 0.1) for name in STEMS} | {
        f"wheel_speed_{w}": fit(0.2, 0.1, "m/s") for w in ("fl", "fr", "rr")
    }
    fits["accel_y"] = fit(0.8, 0.08)
    return {
        "verdict": "explained",
        "causes": [cause()],
        "located": [
            {"channel": "accel_y", "start_s": 20.0, "end_s": 30.0, "share": 0.41,
             "region": {"speed_mps": [10.0, 20.0], "abs_ay_mps2": [2.0, 5.0]}},
            {"channel": "accel_y", "start_s": 40.0, "end_s": 45.0, "share": 0.2, "region": {}},
        ],
        "parameter_errors": [
            {"parameter": "front_cornering_stiffness_n_per_rad", "configured": 62000.0, "fitted": 55800.0, "std": 400.0}
        ],
        "unlisted": [
            {"channel": "accel_x", "shape": "k*vx^2", "coefficient": {"value": 1.1e-3, "std": 1e-4, "unit": "1/m"}}
        ],
        "fit": fits,
        "level": {"accel_y": 1.1},
        "could_not_test": [{"effect": "tyre_saturation", "why": "lateral acceleration stayed below 2.1 m/s2"}],
        "offsets": {
            "offset_gyro_z": {"value": 0.01, "std": 0.001},
            "front_cornering_stiffness": {"value": -0.1, "std": 0.01},
        },
        "source": {"recording": ["drive.log"]},
        "settings": {"vehicle": {"driven_axle": "front"}},
        "versions": {"dsz-daemon": "1.2.3"},
    } | more  # fmt: skip


def taken_apart(
    folder: Path, result: Mapping[str, Any], columns: Mapping[str, Floats], title: str = "Diagnosis"
) -> Page:
    path = folder / "report.html"
    path.write_text(diagnosis_page(result, columns, title), encoding="utf-8")
    return Page(path)
