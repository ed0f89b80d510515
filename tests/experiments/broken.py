"""What `dsz diagnose` says of recordings that were broken on purpose, in which no physics is left out; Markdown.

    python tests/experiments/broken.py [--seed 500] [--cars 10] [--jobs 2]

Recordings of `other_cars.py`: every twentieth frame lost, the IMU's frames in any order, another car's configuration.
Of the last, what is to be said is that, or numbers of the car: mass, stiffness, ratio, radii, tracks, and where the
IMU is from the C.G. that is configured.
"""

from __future__ import annotations

import argparse
import random
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import other_cars
import yaml

from dsz_daemon.errors import DszError
from dsz_daemon.runs.diagnose import diagnose

_SECONDS = 150.0
# What a configuration says of a car.
CONFIGURED = {"configuration", "mass_loading", "cornering_stiffness", "steering_ratio", "track_width"}
CONFIGURED |= {"wheel_radius", "imu_lever_arm"}


def lost(folder: Path, seed: int) -> None:
    """Every twentieth frame never came, at random."""
    log, rng = folder / "recording.log", random.Random(seed)
    log.write_text("".join(line for line in log.read_text().splitlines(keepends=True) if rng.random() > 0.05))


def shuffled(folder: Path, seed: int) -> None:
    """Gyros' and accelerometers' payloads in any order, each message's own."""
    log, rng = folder / "recording.log", random.Random(seed)
    lines = [line.split() for line in log.read_text().splitlines()]
    dbc = (folder / "car.dbc").read_text().splitlines()
    ids = {
        f"{int(line.split()[1]):03X}" for line in dbc if line.startswith("BO_ ") and ("RATES" in line or "FORC" in line)
    }
    for one in ids:
        places = [k for k, (_, _, frame) in enumerate(lines) if frame.startswith(f"{one}#")]
        frames = [lines[k][2] for k in places]
        rng.shuffle(frames)
        for k, frame in zip(places, frames, strict=True):
            lines[k][2] = frame
    log.write_text("".join(f"{' '.join(line)}\n" for line in lines))


def another_car(folder: Path, seed: int) -> None:
    """The next seed's car is configured; wheel radii and signals stay, or no speed is right."""
    config = folder / "config.yaml"
    with tempfile.TemporaryDirectory() as name:
        other_cars.make(Path(name), seed + 1, "city", {}, 30.0)
        other = yaml.safe_load((Path(name) / "config.yaml").read_text())
    mine = yaml.safe_load(config.read_text())
    kept = {key: mine["vehicle"][key] for key in ("wheel_radius_m", "driven_axle")}
    config.write_text(yaml.safe_dump(mine | {"vehicle": other["vehicle"] | kept}))


BROKEN: dict[str, Callable[[Path, int], None]] = {
    "5 % of the frames lost": lost,
    "the IMU's frames in any order": shuffled,
    "another car's configuration": another_car,
    "that, and one effect left out": another_car,
}
# Each of these in its turn, at size 1; what is no number of the car, or is a sensor's share as a wrong number may be.
BESIDE = (
    *("imu_delay", "road_bank", "gyro_scale", "wheel_slip", "suspension_roll", "imu_misalignment"),
    *("bias_drift", "steering_delay", "wheel_radius", "road_grade", "accel_scale", "sensor_bandwidth"),
)


def beside(how: str, seed: int) -> tuple[str, ...]:
    """What is left out besides."""
    return (BESIDE[seed % len(BESIDE)],) if how.startswith("that") else ()


def said(case: tuple[str, int]) -> tuple[list[str], list[str], list[str], str]:
    """Causes, shapes, parameter errors, verdict."""
    how, seed = case
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        other_cars.make(folder, seed, "city", other_cars.parsed(beside(how, seed)), _SECONDS)
        BROKEN[how](folder, seed)
        try:
            found: dict[str, Any] = diagnose([folder / "recording.log"], folder / "config.yaml", folder / "out")
        except DszError as error:
            return [], [], [], f"refused: {error}".splitlines()[0][:100]
        told = [one["parameter"] for one in found["parameter_errors"]]
        shapes = [f"{one['channel']} {one['shape']}" for one in found["unlisted"]]
        return [cause["effect"] for cause in found["causes"]], shapes, told, found["verdict"]


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seed", type=int, default=500)
    parser.add_argument("--cars", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    print(
        "| broken | effects named that are no number of the car, or missed | shapes | numbers of the car | verdicts |"
    )
    print("|---|---|---|---|---|", flush=True)
    with ProcessPoolExecutor(asked.jobs, mp_context=get_context("spawn")) as pool:
        for how in BROKEN:
            seeds = range(asked.seed, asked.seed + asked.cars)
            answers = list(pool.map(said, [(how, seed) for seed in seeds]))
            wrong = []
            for seed, (named, _, _, _) in zip(seeds, answers, strict=True):
                beyond = [one for one in named if one not in {*CONFIGURED, *beside(how, seed)}]
                beyond += [f"no {effect}" for effect in beside(how, seed) if effect not in named]
                if beyond:
                    wrong.append(", ".join(beyond))
            shapes = sorted({shape for _, there, _, _ in answers for shape in there})
            configured = sum(bool(told or CONFIGURED & set(named)) for named, _, told, _ in answers)
            verdicts = sorted({verdict for _, _, _, verdict in answers})
            counts = ", ".join(f"{verdict} {sum(v == verdict for _, _, _, v in answers)}" for verdict in verdicts)
            words = f"{len(wrong)} of {len(answers)}{': ' if wrong else ''}{'; '.join(wrong)}"
            print(f"| {how} | {words} | {', '.join(shapes) or '-'} | {configured} | {counts} |", flush=True)


if __name__ == "__main__":
    main()
