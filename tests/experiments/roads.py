"""How far roads that a proof planted are off as they are told, with how much they tilt all the way; Markdown.

    dsz prove -o out/proof [...]
    python tests/experiments/roads.py out/proof

The page of a proof has the same but for a constant. A road whose even tilt is not told is told level on average.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from dsz_daemon.edge.samples_file import read_samples

_ROADS = {"road_bank": "road_bank_rad", "road_grade": "road_grade_up_rad"}
# What is level at every fourth row is as level as this at all.
_LEVEL_RAD = 5e-5


def rows_of(proof: Path) -> list[str]:
    """A row for each road that was planted and is named, of a proof that was scored: its seals are open."""
    if not (proof / "scores.json").is_file():
        raise SystemExit(f"{proof}: no scores.json; expected a proof that was scored")
    rows = []
    for seal in sorted((proof / "sealed").glob("*.json")):
        truth = json.loads(seal.read_text())["truth"]
        said = json.loads((proof / "answers" / seal.stem / "diagnosis.json").read_text())
        planted = {effect["effect"] for effect in truth["effects"]} & _ROADS.keys()
        named = planted & {cause["effect"] for cause in said["causes"]}
        if not named:
            rows += [
                f"| {int(seal.stem)} | {truth['car']}, {truth['kind']} | {road} | not named | - | - |"
                for road in planted
            ]
            continue
        told, true = (
            read_samples(path) for path in (proof / "answers" / seal.stem / "fit.parquet", seal.with_suffix(".parquet"))
        )
        for road in sorted(named):
            # Truth counts from its own zero.
            since_s = told["time_s"] - told["time_s"][0]
            there = np.interp(since_s, true["time_s"] - true["time_s"][0], true[_ROADS[road]])
            off = np.degrees(told[_ROADS[road]] - there)
            even = "told" if abs(np.mean(told[_ROADS[road]])) > _LEVEL_RAD else "not told"
            rows.append(
                f"| {int(seal.stem)} | {truth['car']}, {truth['kind']} | {road} | {even} "
                f"| {np.sqrt(np.mean(off**2)):.3f} | {np.std(off):.3f} |"
            )
    return rows


def main() -> None:
    """The table of one proof."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("proof", type=Path)
    print("| trial | car | planted | even tilt | off, deg rms | but for a constant |\n|---|---|---|---|---|---|")
    print("\n".join(rows_of(parser.parse_args().proof)))


if __name__ == "__main__":
    main()
