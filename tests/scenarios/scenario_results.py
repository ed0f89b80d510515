"""What a call of `dsz` and a replay of the short drive came to."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet
from short_drive import OFFSETS, START_S


class Called(NamedTuple):
    """Exit code and what was printed."""

    code: int
    out: str
    err: str


class Replayed(NamedTuple):
    """The results of a replay: summary and columns of the samples. Times count from the drive's start."""

    folder: Path
    summary: dict[str, Any]
    samples: dict[str, list[Any]]

    def between(self, column: str, start_s: float, end_s: float) -> list[Any]:
        """The column's values at start_s <= t < end_s."""
        times_s = self.samples["time_s"]
        return [
            x for t_s, x in zip(times_s, self.samples[column], strict=True) if start_s <= t_s - START_S < end_s
        ]  # fmt: skip

    def offsets(self, channel: str, start_s: float) -> list[float]:
        """All that was taken for the channel's offset from start_s on."""
        unit = "radps" if channel.startswith("gyro") else "mps2"
        return self.between(f"{channel}_offset_{unit}", start_s, 1e9)

    def offset(self, channel: str) -> float:
        """The last offset."""
        return float(self.summary["channels"][channel]["offset"])

    def states(self, channel: str, start_s: float, end_s: float) -> set[str]:
        return set(self.between(f"{channel}_state", start_s, end_s))

    def reasons(self, channel: str, start_s: float, end_s: float) -> set[str]:
        return set(self.between(f"{channel}_reason", start_s, end_s))


def moved(faulty: Replayed, clean: Replayed, start_s: float) -> dict[str, float]:
    """How far a fault at start_s has moved each offset (SI): from all that the clean run took for it since.

    A channel that only stopped to learn has not moved.
    """
    found = {}
    for channel in OFFSETS:
        known = clean.offsets(channel, start_s - 0.1)
        low, high = min(known), max(known)
        found[channel] = max(0.0, low - faulty.offset(channel), faulty.offset(channel) - high)
    return found


def read_results(folder: Path) -> Replayed:
    samples = pyarrow.parquet.read_table(folder / "samples.parquet").to_pydict()
    return Replayed(folder, json.loads((folder / "summary.json").read_text()), samples)
