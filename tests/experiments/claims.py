"""The paper's two experiments, driven by the simulated car, and what the paper says of its figures: true or not.

    python tests/experiments/claims.py [--seeds 10]

A claim that a figure can be put to is put to it, over all seeds (each draws another IMU); the table is Markdown.
What holds for a median but not for each seed is not called true.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.runs.replay import replay
from dsz_daemon.runs.simulate import simulate
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES

Array = NDArray[Any]
ACCELS = ("accel_x", "accel_y", "accel_z")
# What is unaffected: half of the spread that counts as converged (config/example.yaml), in SI.
UNAFFECTED = {"gyro": np.radians(0.05), "accel_x": 0.1, "accel_y": 0.1, "accel_z": 0.05}


@dataclass(frozen=True)
class Drive:
    """One replayed drive and its truth, on the samples' rows; `t` in s from the first frame."""

    t: Array
    samples: dict[str, Array]
    truth: dict[str, Array]

    def column(self, channel: str, kind: str = "") -> Array:
        return self.samples["_".join(filter(None, (channel, kind, QUANTITIES[channel].suffix)))]

    def true(self, channel: str, kind: str = "") -> Array:
        return self.truth["_".join(filter(None, (channel, kind, QUANTITIES[channel].suffix)))]


def driven(scenario: str, seed: int) -> Drive:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        simulate(scenario, place, seed)
        replay([place / "recording.log"], place / "config.yaml", place / "out")
        samples, truth = read_samples(place / "out/samples.parquet"), read_samples(place / "truth.parquet")
    inside = (samples["time_s"] >= truth["time_s"][0]) & (samples["time_s"] <= truth["time_s"][-1])
    samples = {name: column[inside] for name, column in samples.items()}
    time_s = samples["time_s"]
    true = {name: np.interp(time_s, truth["time_s"], column) for name, column in truth.items()}
    return Drive(time_s - truth["time_s"][0], samples, true)


def rms(values: Array) -> float:
    known = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(known**2)))


@dataclass(frozen=True)
class Claim:
    """What is said, where, whether it held in each drive, and the figure of each."""

    figure: str
    text: str
    held: list[bool]
    values: list[tuple[float, ...]]
    shown: str

    def row(self) -> str:
        middle = np.median(np.array(self.values), axis=0)
        verdict = "TRUE" if all(self.held) else "NOT" if not any(self.held) else f"NOT in {self.held.count(False)}"
        return f"| {self.figure} | {self.text} | {verdict} of {len(self.held)} | {self.shown.format(*middle)} |"


def removed(figure: str, drives: list[Drive]) -> Iterator[Claim]:
    """Figs 2, 5, 7, 11: what is left of the raw error."""
    for channel in IMU_CHANNELS:
        degree = channel.startswith("gyro")
        factor, unit = (57.29578, "deg/s") if degree else (1.0, "m/s2")
        values = [
            (
                factor * rms(d.column(channel, "raw") - d.true(channel)),
                factor * rms(d.column(channel) - d.true(channel)),
                factor * abs(float((d.column(channel, "offset") - d.true(channel, "offset"))[-1])),
            )
            for d in drives
        ]
        shown = "RMS error raw {:.3f}, processed {:.3f}; offset off by {:.3f} at the end " + unit
        yield Claim(figure, f"{channel}: the error is brought down", [v[1] < v[0] for v in values], values, shown)


def only_with_its_gate(drives: list[Drive]) -> Claim:
    """Fig. 3."""
    values = []
    for d in drives:
        offset, gate = d.column("accel_y", "offset"), d.samples["accel_y_gate"].astype(bool)
        moved = np.abs(np.diff(np.nan_to_num(offset)))
        first = d.t[int(np.argmax(gate))]
        values.append((float(first), float(moved[~gate[1:]].sum()), float(moved[gate[1:]].sum())))
    text = "a_y's offset moves only once its gate opens"
    return Claim(
        "3", text, [v[1] < 0.02 * v[2] for v in values], values, "opens at {:.1f} s; moved {:.4f} closed, {:.3f} open"
    )


def reference_is_bad_and_ignored(figure: str, where: str, drives: list[Drive], there: list[Array]) -> Iterator[Claim]:
    """Figs 4 and 10: the reference accelerations where they can't be right, and how often they are believed."""
    for channel in ACCELS:
        values = []
        for d, bad in zip(drives, there, strict=True):
            error = d.samples[f"{channel}_kinematic_mps2"] - d.true(channel)
            gate = d.samples[f"{channel}_gate"].astype(bool)
            moving = d.truth["speed_mps"] > 3.0
            values.append((rms(error[bad]), rms(error[moving & ~bad]), 100.0 * float(gate[bad].mean())))
        text = f"{channel}: the reference is worse {where}"
        shown = "RMS {:.3f} there, {:.3f} elsewhere m/s2"
        yield Claim(figure, text, [v[0] > v[1] for v in values], [v[:2] for v in values], shown)
        text = f"{channel}: and is not learnt from {where}"
        yield Claim(figure, text, [v[2] < 10.0 for v in values], [v[2:] for v in values], "gate open {:.0f} % of it")


def unaffected(drives: list[Drive]) -> Iterator[Claim]:
    """Fig. 9: what a hill of twenty seconds does to each offset."""
    for channel in IMU_CHANNELS:
        factor, unit = (57.29578, "deg/s") if channel.startswith("gyro") else (1.0, "m/s2")
        bound = UNAFFECTED.get(channel, UNAFFECTED["gyro"])
        values = []
        for d in drives:
            error = d.column(channel, "offset") - d.true(channel, "offset")
            before, after = np.searchsorted(d.t, [24.5, 44.0])
            std = d.column(channel, "offset_std")[after]
            values.append((float(error[after] - error[before]), float(error[after]), float(1.96 * std)))
        held = [abs(v[0]) < bound for v in values]
        shown = "moved by {:+.3f}, off by {:+.3f}, says +- {:.3f} " + unit
        text = f"{channel}: grade and bank don't move its offset (by more than {bound * factor:.2f} {unit})"
        yield Claim("9", text, held, [tuple(factor * x for x in v) for v in values], shown)


def begins(drives: list[Drive]) -> Claim:
    """Fig. 8."""
    values = [(float(d.t[int(np.argmax(d.samples["accel_y_gate"].astype(bool)))]),) for d in drives]
    return Claim(
        "8", "a_y's zeroing begins at about 20.9 s", [abs(v[0] - 20.9) < 1.0 for v in values], values, "{:.1f} s"
    )


def claims(seeds: int) -> Iterator[Claim]:
    """All of them, both experiments."""
    flat = [driven("sine_steer", seed) for seed in range(1, seeds + 1)]
    yield from removed("2, 5", flat)
    yield only_with_its_gate(flat)
    yield from reference_is_bad_and_ignored(
        "4", "in the manoeuvre", flat, [np.abs(d.true("gyro_z")) > np.radians(3.0) for d in flat]
    )
    hill = [driven("bank_and_incline", seed) for seed in range(1, seeds + 1)]
    yield from removed("7, 11", hill)
    yield begins(hill)
    yield from unaffected(hill)
    yield from reference_is_bad_and_ignored(
        "10", "on the hill", hill, [np.abs(d.truth["road_grade_up_rad"]) > 0.03 for d in hill]
    )


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="The paper's claims on its two experiments, put to figures.")
    parser.add_argument("--seeds", type=int, default=10, help="IMUs to draw (default %(default)s)")
    print("| Fig. | claim | holds | median |\n|---|---|---|---|")
    for claim in claims(parser.parse_args().seeds):
        print(claim.row(), flush=True)


if __name__ == "__main__":
    main()
