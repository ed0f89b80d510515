"""Scores `dsz diagnose` on another author's simulator, all of it answered before a key is opened; prints Markdown.

    python tests/experiments/other_authors.py FOLDER [--answers DIR] [--jobs 2] [SET ...]

Who writes such a simulator has the contract and nothing else. FOLDER holds sets (`nulls`, `plain`, `small`, `tiny`,
`pairs`, `triples`, `unlisted`, or any others), each with folders `000`, `001`, ... of `recording.log`, `config.yaml`
and its DBCs, and `sealed/SET/000.json` with what is in it:

    {"effects": [{"effect": "imu_delay", "parameters": {"delay_s": 0.06}}],
     "stiffness_scales": {"front": 0.95, "rear": 1.0},
     "unlisted": null, or {"mechanism": "a hatch rattles", "channels": ["accel_z"]}}

Roads' profiles are beside it: `sealed/SET/000.csv` of `time_s` and `road_bank_rad` or `road_grade_up_rad`.
What was answered stays in --answers: asked once, a set is blind no longer. Delete an answer to have it given again.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import statistics
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from dsz_daemon.edge.samples_file import write_columns
from dsz_daemon.errors import DszError
from dsz_daemon.prove.score import scored
from dsz_daemon.runs.diagnose import diagnose

_INSIDE = 1.96
_DRIVES_MPS = 10.0
_ANSWERED = ("diagnosis.json", "error.json")


def answered(recording: Path, answer: Path) -> None:
    """diagnosis.json and fit.parquet of one recording; error.json where there can't be any."""
    if any((answer / name).exists() for name in _ANSWERED):
        return
    try:
        diagnose([recording / "recording.log"], recording / "config.yaml", answer, draws=False)
    except DszError as error:
        answer.mkdir(parents=True, exist_ok=True)
        (answer / "error.json").write_text(json.dumps({"error": str(error)}), encoding="utf-8")


def score_of(sealed: Path, answer: Path) -> dict[str, Any]:
    """One answer against its key, by what the sealed proof counts with."""
    key = json.loads(sealed.read_text(encoding="utf-8"))
    unlisted = key.get("unlisted") or {}
    truth = {
        "number": int(sealed.stem), "group": sealed.parent.name, "car": "another's", "kind": "", "seed": 0, "size": 1.0,
        "effects": key["effects"], "mild": [], "by_construction": [],
        "stiffness": sorted(key.get("stiffness_scales", {"front": 1.0}).values()),
        "unlisted": [{"name": unlisted["mechanism"], "channel": name} for name in unlisted.get("channels", [])],
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        profiles = Path(folder) / "profiles.parquet"
        write_columns(_profiles(sealed.with_suffix(".csv")), profiles)
        return scored(truth, answer, profiles, asks_rivals=False) | {"mechanism": unlisted.get("mechanism")}


def _profiles(path: Path) -> Mapping[str, np.ndarray]:
    """A road over time since the first frame; where the car stands counts, too: no speed is told."""
    if not path.exists():
        return {"time_s": np.zeros(2), "speed_mps": np.zeros(2)}
    with path.open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    columns = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    return columns | {"time_s": columns["time_s"] - columns["time_s"][0], "speed_mps": np.full(len(rows), _DRIVES_MPS)}


def table(scores: Sequence[dict[str, Any]]) -> str:
    """A line for each set, as Markdown."""
    columns = (
        *("set", "recordings", "silent", "first", "first, or the alias it says", "all", "a name too many"),
        *("a shape too many", "numbers inside", "roads off, deg rms: median, most"),
    )
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    for name in sorted({one["group"] for one in scores}):
        mine = [one for one in scores if one["group"] == name]
        listed = [one for one in mine if one["planted"]]
        roads = [math.degrees(one["profile_rad"]) for one in listed if one["profile_rad"] is not None]
        cells = [
            _of(one["verdict"] == "consistent" and not one["alarm"] for one in mine if is_null(one)),
            _of(one["first"] for one in listed),
            _of(one["first_or_alias"] for one in listed),
            _of(one["all_named"] for one in listed),
            _of(bool(one["extra"]) for one in mine),
            _of(bool(one["shapes"]) for one in listed),
            _of(abs(spreads) < _INSIDE for one in listed for spreads in one["off"]),
            f"{statistics.median(roads):.3f}, {max(roads):.3f}" if roads else "-",
        ]
        lines.append(f"| {name} | {len(mine)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def is_null(one: Mapping[str, Any]) -> bool:
    """Whether nothing is left out."""
    return not one["planted"] and not one["mechanism"]


def told(one: Mapping[str, Any]) -> str:
    """What is to be looked at of one answer, in a line; empty where it is as it should be."""
    where, said = f"{one['group']}/{one['number']:03d}", ", ".join([*one.get("named", []), *one.get("shapes", [])])
    said = f"{one['verdict']}, {said or 'nothing'}"
    if one["error"]:
        return f"- {where}: {one['error']}"
    if one["mechanism"] and (one["extra"] or one["verdict"] == "consistent"):
        return f"- {where}: {one['mechanism']} -- {said}"
    if one["planted"] and (not one["all_named"] or one["extra"] or one["shapes"]):
        return f"- {where}: {', '.join(one['planted'])} -- {said}"
    if is_null(one) and one["alarm"]:
        return f"- {where}: nothing left out -- {said}"
    return ""


def _of(flags: Iterable[bool]) -> str:
    found = list(flags)
    return f"{sum(found)} of {len(found)}" if found else "-"


def main() -> None:
    """Answers, then opens the keys and prints the table, and what went otherwise."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("sets", nargs="*", metavar="SET")
    parser.add_argument("--answers", type=Path, help="where answers are and stay (default: FOLDER/answers)")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_intermixed_args()
    answers = asked.answers or asked.folder / "answers"
    keys = sorted((asked.folder / "sealed").glob("*/*.json"))
    keys = [key for key in keys if not asked.sets or key.parent.name in asked.sets]
    where = [(key.parent.name, key.stem) for key in keys]
    with ProcessPoolExecutor(asked.jobs, mp_context=get_context("spawn")) as pool:
        running = [pool.submit(answered, asked.folder.joinpath(*one), answers.joinpath(*one)) for one in where]
        for number, future in enumerate(as_completed(running), 1):
            future.result()
            print(f"\r{number} of {len(running)} answered", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    scores = [score_of(key, answers.joinpath(*one)) for key, one in zip(keys, where, strict=True)]
    print(table(scores))
    print("\n".join(["", *filter(None, map(told, scores))]))


if __name__ == "__main__":
    main()
