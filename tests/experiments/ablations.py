"""What parts of `dsz diagnose` are worth: a proof's recordings diagnosed again without one of them; Markdown.

    dsz prove -o out/proof --trials 200 --seed 2030
    python tests/experiments/ablations.py out/proof [--car own] [--trials 60] [--jobs 2]

Without selection by unseen data (a step is judged on the blocks that it was fitted to), without a refit of configured
parameters first (their tolerance is nothing), without alias groups (one name, and no word of what is the same).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from dsz_daemon.diagnose.fitting import judgement
from dsz_daemon.diagnose.residuals.evidence import Box, Sums, solved
from dsz_daemon.diagnose.selection import screening
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.shapes import beside
from dsz_daemon.diagnose.verdict import causes
from dsz_daemon.errors import DszError
from dsz_daemon.prove import score
from dsz_daemon.prove.mix import Trial, trials
from dsz_daemon.prove.prove import SEALS
from dsz_daemon.prove.rivals import Rivals
from dsz_daemon.prove.seal import opened
from dsz_daemon.prove.summary import share
from dsz_daemon.runs import diagnose as run

Floats = np.ndarray[Any, np.dtype[np.float64]]


def seen(found: Sums, columns: Sequence[int], box: Box, *_: object) -> Floats:
    """Sum of squares (b, c) of each block, of a fit of `columns` that has seen all of them."""
    chosen = list(columns)
    squares, cross = found.squares[:, :, chosen][:, :, :, chosen], found.cross[:, :, chosen]
    part = Box(box.low[chosen], box.high[chosen], box.weight[chosen])
    step = solved(squares.sum(axis=(0, 1)), cross.sum(axis=(0, 1)), part)
    return np.asarray(found.left - 2.0 * cross @ step + np.einsum("bcij,i,j->bc", squares, step, step))


def without_unseen_data() -> None:
    """Steps are judged on what they were fitted to."""
    for module in (beside, judgement, screening):
        module.held_out = seen  # type: ignore[attr-defined]
    judgement.held_out_kinds = seen  # type: ignore[assignment]


def without_refit() -> None:
    """What is configured is true."""
    whole: Callable[..., Any] = run.diagnosed
    run.diagnosed = lambda *given, tolerance, **more: whole(*given, tolerance={}, **more)


def without_groups() -> None:
    """No word of what can't be told apart."""

    def alone(_found: Search, effect: str, *_: object) -> tuple[list[str], list[dict[str, float | str]]]:
        return [effect], []

    causes.alternatives = alone  # type: ignore[assignment]


VARIANTS: dict[str, Callable[[], None]] = {
    "all of it": lambda: None,
    "without selection by unseen data": without_unseen_data,
    "without refit of configured parameters": without_refit,
    "without alias groups": without_groups,
}


def scored(task: tuple[Path, str, Trial, str]) -> dict[str, Any]:
    """One trial, in a process of its own: a variant stays."""
    folder, variant, trial, published = task
    VARIANTS[variant]()
    score.rivals = lambda *_: Rivals(None, "nothing")
    number = f"{trial.number:05d}"
    recording, said = folder / "recordings" / number, folder / "ablations" / variant.replace(" ", "_") / number
    try:
        run.diagnose([recording / "recording.log.gz"], recording / "config.yaml", said, draws=False)
    except DszError as error:
        said.mkdir(parents=True, exist_ok=True)
        (said / "error.json").write_text(json.dumps({"error": str(error)}))
    truth = folder / "sealed" / f"{number}.json"
    return score.scored(opened(truth, published), said, truth.with_suffix(".parquet"))


def row(variant: str, found: Sequence[dict[str, Any]]) -> str:
    """One line of the table."""

    def words(flags: list[bool]) -> str:
        counted = share(flags)
        return f"{counted['hits']} of {counted['of']}"

    def of(group: str) -> list[dict[str, Any]]:
        return [one for one in found if one["group"] == group]

    listed = [one for one in found if one["planted"]]
    odds = [value for one in listed for value in one["probability"]]
    return " | ".join(
        [
            f"| {variant}",
            words([one["alarm"] for one in of("null")]),
            words([one["first"] for one in of("single")]),
            words([one["all_named"] for one in of("pair")]),
            words([one["first_or_alias"] for one in of("alias_pair")]),
            words([bool(one["extra"]) for one in found]),
            words([bool(one["extra"]) for one in of("unlisted")]),
            f"{np.mean(odds) if odds else float('nan'):.2f} |",
        ]
    )


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description="What parts of the diagnosis are worth.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--car", default="own")
    parser.add_argument("--trials", type=int, default=60, help="the first so many of that car")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    published = json.loads((given.folder / SEALS).read_text(encoding="utf-8"))
    drawn = trials(published["protocol"]["seed"], published["protocol"]["trials"])
    mine = [trial for trial in drawn if trial.car == given.car][: given.trials]
    print("| | false alarms | singles right | pairs named | one of an alias pair | names too many |", end="")
    print(" no name, misnamed | probability of the truth |\n|---|---|---|---|---|---|---|---|")
    for variant in VARIANTS:
        with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
            tasks = [(given.folder, variant, trial, published["truths"][f"{trial.number:05d}"]) for trial in mine]
            print(row(variant, list(pool.map(scored, tasks))), flush=True)


if __name__ == "__main__":
    main()
