"""`dsz simulate`: a simulated drive as files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from dsz_daemon.edge.scenario_files import write_scenario
from dsz_daemon.runs.results import output_folder
from dsz_daemon.sim import scenario

Progress = Callable[[int, int], None]


def simulate(name: str, folder: Path, seed: int, progress: Progress | None = None) -> dict[str, Any]:
    """Writes recording.log, config.yaml, DBC files and truth.parquet of a scenario into `folder`."""
    output_folder(folder)
    drive = scenario.simulate(name, seed, None if progress is None else lambda done: progress(round(done * 1000), 1000))
    write_scenario(drive, folder)
    return {
        "scenario": name,
        "seed": seed,
        "folder": str(folder),
        "frames": len(drive.frames),
        "duration_s": (drive.frames[-1].t_ns - drive.frames[0].t_ns) * 1e-9,
        "parameters": drive.parameters,
    }
