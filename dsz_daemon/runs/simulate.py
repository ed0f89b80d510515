"""`dsz simulate`: a simulated drive as files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from dsz_daemon.edge.scenario_files import write_scenario
from dsz_daemon.errors import MachineError
from dsz_daemon.report.offline_page import plotly
from dsz_daemon.report.truth_page import write_truth_page
from dsz_daemon.runs.results import output_folder
from dsz_daemon.runs.summary import write_json
from dsz_daemon.sim import scenario

Progress = Callable[[int, int], None]

PICTURE = "drive.html"


def simulate(
    name: str,
    folder: Path,
    seed: int,
    progress: Progress | None = None,
    effects: Sequence[str] = (),
    from_nominal: bool = False,
) -> dict[str, Any]:
    """Writes recording.log, config.yaml, DBC files, truth.parquet and parameters.json of a scenario into `folder`.

    `effects`: each `NAME` or `NAME:KEY=VALUE,...`; with `from_nominal` the car has nothing else that the nominal
    simulation leaves out. parameters.json holds what was true: car, sensors, effects; drive.html shows what was driven
    (left out without plotly: `picture` in the summary is None then, and `notes` says why).
    """
    scenario.checked(name, seed, effects)
    output_folder(folder)
    told = None if progress is None else lambda done: progress(round(done * 1000), 1000)
    drive = scenario.simulate(name, seed, told, effects, from_nominal)
    write_scenario(drive, folder)
    write_json({"scenario": name, "seed": seed, **drive.parameters}, folder / "parameters.json")
    picture, notes = _picture(drive, folder / PICTURE)
    return {
        "scenario": name,
        "seed": seed,
        "folder": str(folder),
        "frames": len(drive.frames),
        "duration_s": (drive.frames[-1].t_ns - drive.frames[0].t_ns) * 1e-9,
        "parameters": drive.parameters,
        "picture": picture,
        "notes": notes,
    }


def _picture(drive: scenario.SimulatedDrive, path: Path) -> tuple[str | None, list[str]]:
    """Draws the page; without plotly there is none, nor one that was left from an earlier drive."""
    try:
        plotly(PICTURE)
    except MachineError as error:
        path.unlink(missing_ok=True)
        return None, [f"no picture of the drive: {error}"]
    write_truth_page(drive.name, drive.seed, drive.truth, drive.parameters, path)
    return str(path), []
