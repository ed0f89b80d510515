"""Which effects `dsz diagnose` names, from which size on, in the simulated car; Markdown on standard output.

    python tests/experiments/detections.py [--scenario city] [--seed 2] [--sizes 1,0.3,0.1] [--jobs 2] [EFFECT ...]
    python tests/experiments/detections.py --together 2 --drives 12 [EFFECT ...]
    python tests/experiments/detections.py --nulls 200
    python tests/experiments/detections.py --other --three --sizes 1,0.3

Each is put into the nominal world (`dsz simulate --nominal --effect NAME:...`, cut after --seconds), so that it is all
there is to find. Size 1 is what `--effect NAME` alone has, smaller ones are nearer to nothing in proportion. Of nulls
every second one has stiffnesses that are off within their tolerance. The car shares no formula with what judges it.
`--other` takes the cars of `other_cars.py` instead, another one each time: --scenario city or highway.
"""

from __future__ import annotations

import argparse
import json
import random
import tempfile
import time
from collections.abc import Collection, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import other_cars
import yaml

from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.prove import sizes
from dsz_daemon.runs.diagnose import diagnose
from dsz_daemon.runs.simulate import simulate
from dsz_daemon.sim.effects import EFFECTS

_SIX_ONLY = ("gyro_x", "gyro_y", "accel_z")
# Where it is slippery for a while; on the proving ground where the bends are gentle.
_LOW_FRICTION = {"start_s": 50.0, "end_s": 95.0}
_LOW_FRICTION_IN = {"handling": {"start_s": 72.0, "end_s": 108.0}}
# Effects that have no sizes, or turn the car as others do at these speeds: not in pairs.
_ALONE = {"axis_fault", "low_friction", "mass_loading", "cornering_stiffness", "steering_compliance", "tyre_saturation"}


class Case(NamedTuple):
    """One drive: what is in it, in the words of `--effect`; of the project's own simulated car or of another.

    `three`: the IMU has a yaw gyro, a_x and a_y, and no more.
    """

    scenario: str
    seed: int
    seconds: float
    effects: tuple[str, ...]
    other: bool
    three: bool = False


class Answer(NamedTuple):
    """What is said of a drive; of every planted parameter that is told with a spread, how many spreads it is off.

    `profile_rad`: how far a road's profile is off, rms, but for a constant.
    """

    found: dict[str, Any]
    off: tuple[float, ...]
    profile_rad: float | None
    overlap: float | None
    took_s: float


def at_size(name: str, size: float, other: bool = False, scenario: str = "city") -> str | None:
    """The effect in the words of `--effect`; None where it has no such size."""
    if other:
        return f"{name}:{','.join(f'{key}={value:.6g}' for key, value in other_cars.at_size(name, size).items())}"
    choice = sizes.at_size(
        name, size, _LOW_FRICTION_IN.get(scenario, _LOW_FRICTION) if name == "low_friction" else None
    )
    if choice is None:
        return None
    pairs = ((key, value if isinstance(value, str) else f"{value:.6g}") for key, value in choice.given.items())
    return f"{name}:{','.join(f'{key}={value}' for key, value in pairs)}"


def diagnosed(case: Case) -> Answer:
    """The drive, diagnosed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        profiles: dict[str, Any] = {}
        planted = numbers(case.effects)
        if case.other:
            other_cars.make(folder, case.seed, case.scenario, planted, case.seconds)
            planted = json.loads((folder / "truth.json").read_text())
            profiles = dict(np.load(folder / "profiles.npz"))
        else:
            simulate(case.scenario, folder, case.seed, None, list(case.effects), from_nominal=True)
            cut(folder / "recording.log", case.seconds)
        if case.three:
            without(folder / "config.yaml", _SIX_ONLY)
        begun = time.monotonic()
        found = diagnose([folder / "recording.log"], folder / "config.yaml", folder / "out")
        took_s = time.monotonic() - begun
        fitted = read_samples(folder / "out" / "fit.parquet")
        return Answer(found, _off(found, planted), _profile(found, fitted, profiles), _overlap(found, planted), took_s)


def without(config: Path, channels: Collection[str]) -> None:
    """Takes channels out of a configuration."""
    settings = yaml.safe_load(config.read_text(encoding="utf-8"))
    settings["signals"] = {role: value for role, value in settings["signals"].items() if role not in channels}
    config.write_text(yaml.safe_dump(settings, sort_keys=False), encoding="utf-8")


def numbers(effects: Sequence[str]) -> dict[str, dict[str, float]]:
    """What is planted, in the words of `--effect`; what is no number (an axis, a kind) is left out."""
    found: dict[str, dict[str, float]] = {}
    for words in effects:
        name, _, rest = words.partition(":")
        pairs = [pair.split("=") for pair in rest.split(",") if "=" in pair]
        found[name] = {key: float(value) for key, value in pairs if value.lstrip("-")[:1].isdigit()}
    return found


def _off(found: dict[str, Any], planted: dict[str, dict[str, float]]) -> tuple[float, ...]:
    off = []
    for cause in found["causes"]:
        mine = planted.get(cause["effect"], {})
        for name, one in cause["parameters"].items():
            if name in mine and one["std"] and name not in {"start_s", "end_s"}:
                off.append((one["value"] - mine[name]) / one["std"])
    return tuple(off)


def _profile(found: dict[str, Any], fitted: dict[str, Any], profiles: dict[str, Any]) -> float | None:
    names = {"road_bank": ("road_bank_rad", "bank"), "road_grade": ("road_grade_up_rad", "grade")}
    for cause in found["causes"]:
        if cause["effect"] in names and profiles:
            name, key = names[cause["effect"]]
            at_s = fitted["time_s"] - fitted["time_s"][0]
            left = fitted[name] - np.interp(at_s, profiles["time"], profiles[key])
            moving = np.nan_to_num(fitted["wheel_other_left_fitted"]) > 3.0
            return float(np.std(left[moving]))
    return None


def _overlap(found: dict[str, Any], planted: dict[str, dict[str, float]]) -> float | None:
    """Of a slippery stretch, what is said and true over what is said or true."""
    for cause in found["causes"]:
        if cause["effect"] == "low_friction" and "low_friction" in planted:
            said = [cause["parameters"][name]["value"] for name in ("start_s", "end_s")]
            true = [planted["low_friction"][name] for name in ("start_s", "end_s")]
            return max(0.0, min(said[1], true[1]) - max(said[0], true[0])) / (
                max(said[1], true[1]) - min(said[0], true[0])
            )
    return None


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
    if effect.startswith("unlisted") and not causes and shapes:
        return f"right: {', '.join(shapes)}"
    if not causes:
        # That a channel is off, and no more, is nothing of an effect.
        shapes = [shape for shape in shapes if not shape.endswith("of no known shape")]
        return f"shape {', '.join(shapes)}" if shapes else "nothing"
    if causes[0] == effect:
        more = [*causes[1:], *shapes]
        return "right" if not more else f"right, and {', '.join(more)}"
    if effect in found["causes"][0]["indistinguishable_from"]:
        return f"alias ({causes[0]})"
    return f"**{', '.join(causes)}**"


def values(effect: str, answer: Answer) -> str:
    """The parameters that were found, with their spreads, and how well a profile or a stretch was."""
    mine = [cause for cause in answer.found["causes"] if cause["effect"] == effect]
    words = [
        f"{name} {one['value']:.3g}" + (f" +- {one['std']:.1g}" if one["std"] else "")
        for cause in mine
        for name, one in cause["parameters"].items()
        if not isinstance(one["value"], str) and (one["std"] or 0.0) < 0.3 * max(1.0, abs(one["value"]))
    ]
    if answer.profile_rad is not None:
        words.append(f"profile {np.degrees(answer.profile_rad):.2f} deg off")
    if answer.overlap is not None:
        words.append(f"overlap {answer.overlap:.2f}")
    return "; ".join(words)


class Tally:
    """Counts what is said, drive by drive."""

    def __init__(self) -> None:
        self.off: list[float] = []
        self.took_s: list[float] = []

    def add(self, answer: Answer) -> Answer:
        """Counts one."""
        self.off += answer.off
        self.took_s.append(answer.took_s)
        return answer

    def words(self) -> str:
        """Coverage of the intervals, and how long it took."""
        inside = sum(abs(one) < 1.96 for one in self.off)
        covered = f"{inside} of {len(self.off)} parameters are within 1.96 of their spreads. " if self.off else ""
        return f"{covered}Half took less than {np.median(self.took_s):.0f} s, the longest {max(self.took_s):.0f} s."


def singles(asked: argparse.Namespace, pool: Executor) -> None:
    """A row an effect, a column a size."""
    sizes = [float(size) for size in asked.sizes.split(",")]
    print(f"| left out | {' | '.join(f'size {size:g}' for size in sizes)} | found at size {sizes[0]:g} |")
    print("|---|" + "---|" * (len(sizes) + 1), flush=True)
    running, tally, counted = [], Tally(), {size: dict.fromkeys(_VERDICTS, 0) for size in sizes}
    for number, effect in enumerate(asked.effects or names(asked)):
        row = []
        for size in sizes:
            words = at_size(effect, size, asked.other, asked.scenario)
            seed = asked.seed + (100 * number if asked.other else 0)
            case = (
                None if words is None else Case(asked.scenario, seed, asked.seconds, (words,), asked.other, asked.three)
            )
            row.append(None if case is None else pool.submit(diagnosed, case))
        running.append((effect, row))
    for effect, futures in running:
        answers = [None if future is None else tally.add(future.result()) for future in futures]
        said = ["-" if answer is None else judged(effect, answer.found) for answer in answers]
        for size, words in zip(sizes, said, strict=True):
            if words != "-":
                counted[size][_verdict(words)] += 1
        first = answers[0]
        shown = values(effect, first) if first is not None else ""
        print(f"| {effect} | {' | '.join(said)} | {shown or '-'} |", flush=True)
    print(f"\n| size | {' | '.join(_VERDICTS)} |\n|---|" + "---|" * len(_VERDICTS))
    for size, counts in counted.items():
        print(f"| {size:g} | {' | '.join(str(count) for count in counts.values())} |")
    print(f"\n{tally.words()}")


_VERDICTS = ("right", "right, and more", "alias", "nothing", "wrong")


def _verdict(words: str) -> str:
    if words.startswith("right, and"):
        return "right, and more"
    return next((name for name in ("right", "alias", "nothing") if words.startswith(name)), "wrong")


def names(asked: argparse.Namespace) -> list[str]:
    """All effects that can be planted."""
    return [name for name in (other_cars.PLAIN if asked.other else EFFECTS) if asked.unlisted == name.startswith("unl")]


def together(asked: argparse.Namespace, pool: Executor) -> None:
    """Several effects at once, drawn by the seed; all must be named."""
    rng, listed = random.Random(asked.seed), [name for name in asked.effects or names(asked) if name not in _ALONE]
    drawn = [rng.sample(listed, asked.together) for _ in range(asked.drives)]
    print("| left out | said | |\n|---|---|---|", flush=True)

    def case(number: int, effects: Sequence[str]) -> Case:
        words = [at_size(name, 1.0, asked.other, asked.scenario) for name in effects]
        there = tuple(one for one in words if one is not None)
        return Case(asked.scenario, asked.seed + number, asked.seconds, there, asked.other, asked.three)

    running = [(effects, pool.submit(diagnosed, case(number, effects))) for number, effects in enumerate(drawn)]
    named, more_than, tally = 0, 0, Tally()
    for effects, future in running:
        answer = tally.add(future.result())
        causes = [cause["effect"] for cause in answer.found["causes"]]
        there = sum(name in causes for name in effects)
        more = [name for name in causes if name not in effects]
        named, more_than = named + there, more_than + bool(more)
        verdict = ("all" if there == len(effects) else str(there)) + (" and more" if more else "")
        print(f"| {' + '.join(effects)} | {', '.join(causes) or '-'} | {verdict} |", flush=True)
    print(
        f"\n{named} of {asked.together * len(drawn)} named; {more_than} of {len(drawn)} answers with a name too many."
    )
    print(tally.words())


def nulls(asked: argparse.Namespace, pool: Executor) -> None:
    """Nothing left out, over seeds."""
    rng, running = random.Random(asked.seed), []
    for number in range(asked.nulls):
        front, rear = (round(1.0 + rng.uniform(-0.08, 0.08), 3) for _ in range(2))
        stiffness = f"cornering_stiffness:front_scale={front},rear_scale={rear}"
        there = (stiffness,) if number % 2 else ()
        case = Case(asked.scenario, asked.seed + number, asked.seconds, there, asked.other, asked.three)
        running.append((case, pool.submit(diagnosed, case)))
    alarms, tally = 0, Tally()
    for case, future in running:
        said = judged("", tally.add(future.result()).found)
        if said != "nothing":
            alarms += 1
            print(f"seed {case.seed} {' '.join(case.effects)}: {said}", flush=True)
    print(f"{alarms} false alarms in {asked.nulls} drives. {tally.words()}")


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("effects", nargs="*", metavar="EFFECT")
    parser.add_argument("--scenario", default="city")
    parser.add_argument("--other", action="store_true", help="cars of other_cars.py")
    parser.add_argument("--three", action="store_true", help="a yaw gyro, a_x and a_y are all channels")
    parser.add_argument("--unlisted", action="store_true", help="what has no name (of other cars)")
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=150.0)
    parser.add_argument("--sizes", default="1,0.3,0.1")
    parser.add_argument("--together", type=int, default=0, metavar="N", help="so many effects in each drive")
    parser.add_argument("--drives", type=int, default=10, metavar="N", help="so many of these")
    parser.add_argument("--nulls", type=int, default=0, metavar="N")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_intermixed_args()
    with ProcessPoolExecutor(asked.jobs, mp_context=get_context("spawn")) as pool:
        (together if asked.together else nulls if asked.nulls else singles)(asked, pool)


if __name__ == "__main__":
    main()
