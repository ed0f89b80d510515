"""Single trials of a sealed proof made anew, opened, diagnosed: what is named, how far roads are off; Markdown.

    python tests/experiments/trials.py --seed 2061 --count 300 173 268
    python tests/experiments/trials.py --seed 7001 --count 3000 --third-party road_bank --first 7

`--seed` and `--count` are the proof's (`dsz prove --seed --trials`). Trials are those that are listed, or the `--first`
of the singles of CommonRoad's car that leave out just this effect. Nothing of it is blind: it is for looking into what
a proof missed. `took` is a diagnosis in this process, its files included: the first one loads what is compiled.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from pathlib import Path

from dsz_daemon.edge.samples_file import write_columns
from dsz_daemon.prove.mix import THIRD_PARTY, Trial, trials
from dsz_daemon.prove.recordings import made
from dsz_daemon.prove.score import scored
from dsz_daemon.runs.blind import answer


def row(trial: Trial, folder: Path) -> str:
    """A line of the table."""
    truth, profiles = made(trial, folder / "recording")
    write_columns(profiles, folder / "profiles.parquet")
    begun = time.monotonic()
    answer(folder / "recording", folder / "answer")
    took_s = time.monotonic() - begun
    one = scored(truth, folder / "answer", folder / "profiles.parquet")
    off = "-" if one["profile_rad"] is None else f"{math.degrees(one['profile_rad']):.3f}"
    planted, said = ([*one[key], *one[more]] for key, more in (("planted", "unlisted"), ("named", "shapes")))
    where = f"{trial.car}, {trial.kind}, size {trial.size:g}"
    names = f"{', '.join(planted) or '-'} | {', '.join(said) or '-'}"
    return f"| {trial.number} | {where} | {names} | {off} | {took_s:.1f} |"


def main() -> None:
    """The table, a trial a line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trials", nargs="*", type=int, metavar="TRIAL")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--third-party", default="", metavar="EFFECT")
    parser.add_argument("--first", type=int, default=5)
    asked = parser.parse_args()
    drawn = trials(asked.seed, asked.count)
    chosen = [drawn[number] for number in asked.trials]
    if asked.third_party:
        alike = [one for one in drawn if one.car == THIRD_PARTY and one.group == "single"]
        chosen += [one for one in alike if [c.name for c in one.effects] == [asked.third_party]][: asked.first]
    print("| trial | car, way | left out | said | road off, deg rms | took, s |\n|---|---|---|---|---|---|", flush=True)
    for trial in chosen:
        with tempfile.TemporaryDirectory() as name:
            print(row(trial, Path(name)), flush=True)


if __name__ == "__main__":
    main()
