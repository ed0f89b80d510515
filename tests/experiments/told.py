"""What there is to be seen of an effect: what a fit gains that is told which one was left out; prints Markdown.

    python tests/experiments/told.py [--scenario city] [--seed 90] [--sizes 1,0.3,0.1] [--jobs 2] [EFFECT ...]

The drives of `detections.py --other`, cell by cell. A search that is told nothing asks for a gain of 20 (twice that for
a road or a wind), so what gains less here is on that drive nothing to anybody: a limit that is not reached, a tyre
within its tolerance, some milliseconds. What gains more and is not named is the search's to find.
"""

from __future__ import annotations

import argparse
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import detections
import other_cars

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import OWN_CHANNEL
from dsz_daemon.diagnose.recordings.recording import recorded
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.selection.starts import starts_of
from dsz_daemon.diagnose.selection.trials import Trial
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.runs.diagnose import signals_of
from dsz_daemon.runs.setup import set_up

_ASKED, _OF_A_PROFILE = 20.0, 40.0


def told(case: detections.Case) -> float:
    """What the effect gains on blocks that its fit has not seen, in log likelihood; 0 where nothing is to be fitted."""
    [(effect, numbers)] = detections.numbers(case.effects).items()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        other_cars.make(folder, case.seed, case.scenario, {effect: numbers}, case.seconds)
        setup = set_up(folder / "config.yaml")
        signals = signals_of(setup, [folder / "recording.log"], LogReport(), None)
    vehicle, tolerance = setup.settings.vehicle, setup.settings.diagnose.tolerance
    drive = drive_of(recorded(signals, vehicle.steering_ratio), vehicle.car(), vehicle.steering_ratio)
    rows = rows_of(drive)
    plain = fitted(drive, rows, nothing(), (), tolerance, 2e-5)
    trial = Trial(drive, rows, plain, tolerance, screened(drive, rows, plain, tolerance, map).known)
    starts = [start for start in starts_of(drive, rows, plain, [effect]) if start[0] == (effect,)]
    return max([0.0, *(trial.judge(trial.fit(start)).gain for start in starts)])


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("effects", nargs="*", metavar="EFFECT")
    parser.add_argument("--scenario", default="city", choices=["city", "highway"])
    parser.add_argument("--seed", type=int, default=90)
    parser.add_argument("--seconds", type=float, default=150.0)
    parser.add_argument("--sizes", default="1,0.3,0.1")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_intermixed_args()
    sizes = [float(size) for size in asked.sizes.split(",")]
    everything = [name for name in other_cars.PLAIN if not name.startswith("unlisted")]
    print(f"| left out | {' | '.join(f'size {size:g}' for size in sizes)} |\n|---|" + "---|" * len(sizes), flush=True)
    with ProcessPoolExecutor(asked.jobs, mp_context=get_context("spawn")) as pool:
        running = []
        for number, effect in enumerate(everything):
            words = [detections.at_size(effect, size, other=True) or "" for size in sizes]
            cases = [
                detections.Case(asked.scenario, asked.seed + 100 * number, asked.seconds, (w,), True) for w in words
            ]
            if not asked.effects or effect in asked.effects:
                running.append((effect, [pool.submit(told, case) for case in cases]))
        shown = dict.fromkeys(sizes, 0)
        for effect, row in running:
            gains = [future.result() for future in row]
            enough = _OF_A_PROFILE if effect in OWN_CHANNEL else _ASKED
            for size, gain in zip(sizes, gains, strict=True):
                shown[size] += gain >= enough
            print(f"| {effect} | {' | '.join(f'{gain:.0f}' for gain in gains)} |", flush=True)
    counted = ", ".join(f"{count} of {len(running)} at size {size:g}" for size, count in shown.items())
    print(f"\nThere to be seen: {counted}.")


if __name__ == "__main__":
    main()
