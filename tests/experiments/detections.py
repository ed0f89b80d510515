"""Which effects `dsz diagnose` names, one at a time at a plain size, in the simulated car; Markdown on standard output.

    python tests/experiments/detections.py [--scenario city] [--seed 2] [--seconds 150] [--jobs 2] [EFFECT ...]

Each is put into the nominal world (`dsz simulate --nominal --effect NAME`, cut after --seconds), so that it is all
there is to find; the first row has nothing in it. The car shares no formula with what judges it.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from dsz_daemon.runs.diagnose import diagnose
from dsz_daemon.runs.simulate import simulate
from dsz_daemon.sim.effects import EFFECTS

# Not built yet: what names these.
LATER = {"axis_fault", "sensor_saturation", "low_friction", "side_wind"}


def case(scenario: str, effect: str, seed: int, seconds: float) -> tuple[str, dict[str, Any], float]:
    """One drive with one effect ("" for none), diagnosed, and how long that took."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulate(scenario, folder, seed, None, [effect] if effect else [], from_nominal=True)
        cut(folder / "recording.log", seconds)
        begun = time.monotonic()
        found = diagnose([folder / "recording.log"], folder / "config.yaml", folder / "out")
        return effect, found, time.monotonic() - begun


def cut(log: Path, seconds: float) -> None:
    """Only the first seconds of a candump log."""
    lines = log.read_text().splitlines(keepends=True)
    first = float(lines[0][1 : lines[0].index(")")])
    log.write_text("".join(line for line in lines if float(line[1 : line.index(")")]) < first + seconds))


def row(effect: str, found: dict[str, Any], took_s: float) -> str:
    """One line of the table."""
    causes = [cause["effect"] for cause in found["causes"]]
    causes += [error["parameter"] for error in found["parameter_errors"]]
    right = causes[:1] == [effect]
    if effect in {"", "cornering_stiffness"}:
        right = not found["causes"] and bool(found["parameter_errors"]) == bool(effect)
    alias = bool(found["causes"]) and effect in found["causes"][0]["indistinguishable_from"]
    verdict = (
        "right"
        if right and len(found["causes"]) < 2
        else "right, and more"
        if right
        else "alias"
        if alias
        else "**wrong**"
    )
    mine = [cause for cause in found["causes"] if cause["effect"] == effect]
    values = "; ".join(
        f"{name} {one['value']:.3g}" for cause in mine for name, one in cause["parameters"].items() if one["std"] != 0.0
    )
    return f"| {effect or 'nothing'} | {verdict} | {', '.join(causes) or '-'} | {values or '-'} | {took_s:.0f} s |"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("effects", nargs="*", metavar="EFFECT")
    parser.add_argument("--scenario", default="city")
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=150.0)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    effects = asked.effects or ["", *(name for name in EFFECTS if name not in LATER)]
    print("| left out | said | causes and parameter errors | found | took |\n|---|---|---|---|---|", flush=True)
    with ProcessPoolExecutor(asked.jobs, mp_context=get_context("spawn")) as pool:
        running = [pool.submit(case, asked.scenario, effect, asked.seed, asked.seconds) for effect in effects]
        for future in running:
            print(row(*future.result()), flush=True)


if __name__ == "__main__":
    main()
