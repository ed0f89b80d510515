"""Golden replays: what the estimator makes of fixed logs, as a text file whose diff is the review.

`make golden` writes `expected.json` anew; the test compares with the tolerance below. A change of
behaviour shows here as numbers that moved, and the changelog explains them.
The log is the first 24 s of `dsz simulate sine_steer --seed 7` as 0.1.0 drove it (standstill, drive-off, a sine).
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.runs.replay import replay
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES

HERE = Path(__file__).parent
LOG, CONFIG, EXPECTED = HERE / "sine_steer.log.gz", HERE / "sine_steer" / "config.yaml", HERE / "expected.json"
# Far above rounding of another platform's libm, far below any change that a user could notice.
RELATIVE, ABSOLUTE = 1e-6, 1e-9


def observed() -> list[dict[str, Any]]:
    """One entry a second: the offsets with their spread and state, speed and sideslip."""
    with tempfile.TemporaryDirectory() as folder:
        replay([LOG], CONFIG, Path(folder))
        samples = read_samples(Path(folder) / "samples.parquet")
    entries = []
    for i in range(99, len(samples["time_s"]), 100):
        entry: dict[str, Any] = {"second": round(float(samples["time_s"][i] - samples["time_s"][0]), 3)}
        for name in IMU_CHANNELS:
            unit = QUANTITIES[name].suffix
            entry[name] = [
                _digits(samples[f"{name}_offset_{unit}"][i]),
                _digits(samples[f"{name}_offset_std_{unit}"][i]),
                str(samples[f"{name}_state"][i]),
            ]
        entry["speed_mps"] = _digits(samples["speed_mps"][i])
        entry["sideslip_rad"] = _digits(samples["sideslip_rad"][i])
        entries.append(entry)
    return entries


def _digits(value: float) -> float:
    return float(f"{value:.9g}")


def main() -> None:
    """Writes the golden file anew."""
    lines = ",\n".join(json.dumps(entry) for entry in observed())
    EXPECTED.write_text(f"[\n{lines}\n]\n", encoding="utf-8")
    print(f"{EXPECTED.name} written: read its diff and say in CHANGELOG.md why numbers moved")


if __name__ == "__main__":
    main()
