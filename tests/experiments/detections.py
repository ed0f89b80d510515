"""Which effects `dsz diagnose` names, from which size on, in the simulated car; Markdown on standard output.

    python tests/experiments/detections.py [--scenario city] [--seed 2] [--sizes 1,0.3,0.1] [--jobs 2] [EFFECT ...]
    python tests/experiments/detections.py --pairs 12
    python tests/experiments/detections.py --nulls 200

Each is put into the nominal world (`dsz simulate --nominal --effect NAME:...`, cut after --seconds), so that it is all
there is to find. Size 1 is what `--effect NAME` alone has, smaller ones are nearer to nothing in proportion. Of nulls
every second one has stiffnesses that are off within their tolerance. The car shares no formula with what judges it.
"""

from __future__ import annotations

import argparse
import random
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from dsz_daemon.runs.diagnose import diagnose
from dsz_daemon.runs.simulate import simulate
from dsz_daemon.sim.effects import EFFECTS

# What these are when nothing is left out; all others are 0.
_ONE = ("fl", "fr", "rl", "rr", "scale", "front_scale", "rear_scale")
# How, not how much.
_HOW = {"seed", "correlation_m", "correlation_s", "start_c", "end_c", "time_constant_s"}
_LOW_FRICTION = "start_s=50,end_s=95"
# Effects that have no sizes, or turn the car as others do at these speeds: not in pairs.
_ALONE = {"axis_fault", "low_friction", "mass_loading", "cornering_stiffness", "steering_compliance", "tyre_saturation"}


class Case(NamedTuple):
    """One drive: what is in it, in the words of `--effect`."""

    scenario: str
    seed: int
    seconds: float
    effects: tuple[str, ...]


def at_size(name: str, size: float) -> str | None:
    """The effect in the words of `--effect`; None where it has no such size."""
    if name == "axis_fault":
        return "axis_fault:channel=accel_x,kind=reversed" if size == 1.0 else None
    words = []
    for key, parameter in EFFECTS[name].parameters.items():
        if parameter.default is None or parameter.words or key in _HOW or key in {"start_s", "end_s"}:
            continue
        neutral = 1.0 if key in _ONE else 0.0
        value = neutral + size * (parameter.default - neutral)
        if key in {"cutoff_hz", "accel_limit_mps2"}:
            value = parameter.default / size
        elif key == "friction_coefficient":
            value = parameter.default / size**0.5
        words.append(f"{key}={value:.6g}")
    if name == "low_friction":
        words.append(_LOW_FRICTION)
    return f"{name}:{','.join(words)}"


def diagnosed(case: Case) -> tuple[dict[str, Any], float]:
    """The drive, diagnosed, and how long that took."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulate(case.scenario, folder, case.seed, None, list(case.effects), from_nominal=True)
        cut(folder / "recording.log", case.seconds)
        begun = time.monotonic()
        found = diagnose([folder / "recording.log"], folder / "config.yaml", folder / "out")
        return found, time.monotonic() - begun


def cut(log: Path, seconds: float) -> None:
    """Only the first seconds of a candump log."""
    lines = log.read_text().splitlines(keepends=True)
    first = float(lines[0][1 : lines[0].index(")")])
    log.write_text("".join(line for line in lines if float(line[1 : line.index(")")]) < first + seconds))


def judged(effect: str, found: dict[str, Any]) -> str:
    """What was said of one effect, or of none (""), in a word or two."""
    causes = [cause["effect"] for cause in found["causes"]]
    shapes = [f"{shape['channel']} {shape['shape']}" for shape in found["unlisted"]]
    if not effect:
        return f"**{', '.join([*causes, *shapes])}**" if causes or shapes else "nothing"
    if effect == "cornering_stiffness" and not causes and found["parameter_errors"]:
        return "right"
    if not causes:
        return f"shape {', '.join(shapes)}" if shapes else "nothing"
    if causes[0] == effect:
        more = [*causes[1:], *shapes]
        return "right" if not more else f"right, and {', '.join(more)}"
    if effect in found["causes"][0]["indistinguishable_from"]:
        return f"alias ({causes[0]})"
    return f"**{', '.join(causes)}**"


def values(effect: str, found: dict[str, Any]) -> str:
    """The parameters that were found, with their spreads."""
    mine = [cause for cause in found["causes"] if cause["effect"] == effect]
    return "; ".join(
        f"{name} {one['value']:.3g}" + (f" +- {one['std']:.1g}" if one["std"] else "")
        for cause in mine
        for name, one in cause["parameters"].items()
        if not isinstance(one["value"], str) and (one["std"] or 0.0) < 0.3
    )


def singles(asked: argparse.Namespace, pool: ProcessPoolExecutor) -> None:
    """A row an effect, a column a size."""
    sizes = [float(size) for size in asked.sizes.split(",")]
    print(f"| left out | {' | '.join(f'size {size:g}' for size in sizes)} | found at size {sizes[0]:g} | took |")
    print("|---|" + "---|" * (len(sizes) + 2), flush=True)
    running = []
    for effect in asked.effects or ["", *EFFECTS]:
        words = [at_size(effect, size) if effect else "" for size in (sizes if effect else sizes[:1])]
        cases = [
            None if w is None else Case(asked.scenario, asked.seed, asked.seconds, (w,) if w else ()) for w in words
        ]
        running.append((effect, [None if case is None else pool.submit(diagnosed, case) for case in cases]))
    for effect, futures in running:
        answers = [None if future is None else future.result() for future in futures]
        said = ["-" if answer is None else judged(effect, answer[0]) for answer in answers]
        said += ["-"] * (len(sizes) - len(said))
        took = max(answer[1] for answer in answers if answer is not None)
        first = answers[0]
        shown = values(effect, first[0]) if first is not None else ""
        print(f"| {effect or 'nothing'} | {' | '.join(said)} | {shown or '-'} | {took:.0f} s |", flush=True)


def pairs(asked: argparse.Namespace, pool: ProcessPoolExecutor) -> None:
    """Two effects at once, drawn by the seed; both must be named."""
    rng, names = random.Random(asked.seed), [name for name in EFFECTS if name not in _ALONE]
    drawn = [rng.sample(names, 2) for _ in range(asked.pairs)]
    print("| left out | said | |\n|---|---|---|", flush=True)

    def case(number: int, pair: Sequence[str]) -> Case:
        words = [at_size(name, 1.0) for name in pair]
        return Case(asked.scenario, asked.seed + number, asked.seconds, tuple(one for one in words if one is not None))

    running = [(pair, pool.submit(diagnosed, case(number, pair))) for number, pair in enumerate(drawn)]
    named = 0
    for pair, future in running:
        found, _ = future.result()
        causes = [cause["effect"] for cause in found["causes"]]
        there = [name in causes for name in pair]
        named += sum(there)
        more = [name for name in causes if name not in pair]
        verdict = ("both" if all(there) else "one" if any(there) else "none") + (" and more" if more else "")
        print(f"| {' + '.join(pair)} | {', '.join(causes) or '-'} | {verdict} |", flush=True)
    print(f"\n{named} of {2 * len(drawn)} named.")


def nulls(asked: argparse.Namespace, pool: ProcessPoolExecutor) -> None:
    """Nothing left out, over seeds."""
    rng, running = random.Random(asked.seed), []
    for number in range(asked.nulls):
        front, rear = (round(1.0 + rng.uniform(-0.08, 0.08), 3) for _ in range(2))
        stiffness = f"cornering_stiffness:front_scale={front},rear_scale={rear}"
        case = Case(asked.scenario, asked.seed + number, asked.seconds, (stiffness,) if number % 2 else ())
        running.append((case, pool.submit(diagnosed, case)))
    alarms = 0
    for case, future in running:
        found, _ = future.result()
        said = judged("", found)
        if said != "nothing":
            alarms += 1
            print(f"seed {case.seed} {' '.join(case.effects)}: {said}", flush=True)
    print(f"{alarms} false alarms in {asked.nulls} drives.")


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("effects", nargs="*", metavar="EFFECT")
    parser.add_argument("--scenario", default="city")
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=150.0)
    parser.add_argument("--sizes", default="1,0.3,0.1")
    parser.add_argument("--pairs", type=int, default=0, metavar="N")
    parser.add_argument("--nulls", type=int, default=0, metavar="N")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    with ProcessPoolExecutor(asked.jobs, mp_context=get_context("spawn")) as pool:
        (pairs if asked.pairs else nulls if asked.nulls else singles)(asked, pool)


if __name__ == "__main__":
    main()
