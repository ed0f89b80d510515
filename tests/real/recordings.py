"""The real recordings beside the project, and what an independent reference says of them.

`python tests/real/recordings.py` replays all of them and prints the tables of docs/results.md.
The reference offsets come from the GNSS/INS/vision smoother of the RAV4 and from the maker's own
compensated signals of the Fords: never from this project's code.
"""

from __future__ import annotations

import csv
import importlib.util
import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.runs.replay import replay

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
CARS = ROOT / "config" / "cars"
FUSION_LOGS = ("nothing", "car_50km", "car_60km", "amarillo", "lkast_activated", "collision_assist_activated")
G = 9.80665
DEG = math.pi / 180.0

ABSENT = None if DATA.is_dir() else f"the real recordings are not beside the project ({DATA.parent.name}/data)"
NO_OPENDBC = None if importlib.util.find_spec("opendbc") else "opendbc is not installed (it needs Python below 3.13)"


def rav4_reference() -> dict[str, np.ndarray]:
    """Course rate (rad/s) and the specific forces (m/s^2) that speed, course and grade stand for."""
    with (DATA / "rav4_highway" / "reference.csv").open() as file:
        rows = list(csv.DictReader(file))
    column = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    t, v = column["time_s"], column["speed_mps"]
    kernel = np.ones(21) / 21.0  # 1 s: the reference is differentiated

    def smooth(x: np.ndarray) -> np.ndarray:
        return np.convolve(x, kernel, mode="same")

    course_rate = np.gradient(column["course_rad"], t)
    return {
        "time_s": t[25:-25],
        "gyro_z_radps": smooth(course_rate)[25:-25],
        "accel_x_mps2": smooth(np.gradient(v, t) + G * np.sin(column["grade_up_rad"]))[25:-25],
        "accel_y_mps2": smooth(v * course_rate)[25:-25],
    }


def rav4_offsets(samples: dict[str, np.ndarray]) -> dict[str, float]:
    """Mean of raw minus reference per channel: the reference's own word on the offsets (no bank in it)."""
    reference = rav4_reference()
    t = samples["time_s"]
    inside = (t > reference["time_s"][0]) & (t < reference["time_s"][-1])
    found = {}
    for name, unit in (("gyro_z", "radps"), ("accel_x", "mps2"), ("accel_y", "mps2")):
        truth = np.interp(t[inside], reference["time_s"], reference[f"{name}_{unit}"])
        found[name] = float(np.nanmean(samples[f"{name}_raw_{unit}"][inside] - truth))
    return found


def replayed(logs: list[Path], config: Path, folder: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Summary and samples of a replay."""
    summary = replay(logs, config, folder)
    return summary, read_samples(folder / "samples.parquet")


def _print_rav4(folder: Path) -> None:
    log = DATA / "rav4_highway" / "recording.log"
    phone = {"gyro_x": -0.56, "gyro_y": 2.01, "gyro_z": -3.92}  # recorded by the phone, in ISO 8855 axes
    print("| RAV4 | channel | offset | +- (95 %) | reference's own | unit |\n|---|---|---|---|---|---|")
    for title, config in (("car", CARS / "toyota_rav4_2017.yaml"), ("phone", ROOT / "tests/real/rav4_phone.yaml")):
        summary, samples = replayed([log], config, folder / title)
        reference = rav4_offsets(samples)
        for name, row in summary["channels"].items():
            scale, unit = (1.0 / DEG, "deg/s") if name.startswith("gyro") else (1.0, "m/s^2")
            known = phone.get(name) if title == "phone" else None
            if known is None and name in reference:
                known = reference[name] * scale
            told = "-" if known is None else f"{known:+.3f}"
            print(
                f"| {title} | {name} | {row['offset'] * scale:+.3f} | {1.96 * row['offset_std'] * scale:.3f} "
                f"| {told} | {unit} |"
            )


def _print_fords(folder: Path) -> None:
    print("\n| log | channel | raw - maker | ours - maker | +- (95 %) | unit |\n|---|---|---|---|---|---|")
    logs = [(f"fusion/{name}", CARS / "ford_fusion_2017.yaml") for name in FUSION_LOGS]
    logs.append(("mustang/recording", CARS / "ford_mustang_s550.yaml"))
    for name, config in logs:
        summary, _ = replayed([DATA / f"{name}.log"], config, folder / name)
        for channel, row in summary["channels"].items():
            other = row.get("reference")
            if other is None:
                continue
            scale, unit = (1.0 / DEG, "deg/s") if channel.startswith("gyro") else (1.0, "m/s^2")
            raw, ours = ((other[key] - other["reference_mean"]) * scale for key in ("raw_mean", "compensated_mean"))
            spread = 1.96 * row["offset_std"] * scale
            print(f"| {name} | {channel} | {raw:+.3f} | {ours:+.3f} | {spread:.3f} | {unit} |")


def main() -> int:
    """Prints the tables, or why it can't."""
    why = ABSENT or NO_OPENDBC
    if why:
        print(f"skipped: {why}", file=sys.stderr)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        _print_rav4(Path(folder))
        _print_fords(Path(folder))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
