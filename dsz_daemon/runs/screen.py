"""What a run shows on a terminal: progress, and a table at the end. Degrees and deg/s, for people."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

_SHOWN = {"rad/s": (180.0 / math.pi, "deg/s", 3), "m/s^2": (1.0, "m/s^2", 3)}


class _Console(Console):
    """rich would end the process with 1 where the reader of a pipe went away; `cli.main` knows better."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


@contextmanager
def progress(what: str, quiet: bool) -> Iterator[Callable[[int, int], None] | None]:
    """A progress bar on a terminal (standard error), nothing in a pipe; yields what to call with (done, all)."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def print_warnings(warnings: Sequence[str], notes: Sequence[str], to_stdout: bool = False) -> None:
    """Warnings and notes, one a line."""
    file = sys.stdout if to_stdout else sys.stderr
    for word in warnings:
        print(f"warning: {word}", file=file)
    for word in notes:
        print(f"note: {word}", file=file)


def print_run(summary: dict[str, Any], folder: Path | None) -> None:
    """The table of a run: offsets with their spread, and errors where the truth is known."""
    truth: dict[str, Any] = summary.get("truth", {})
    references = {name: row["reference"] for name, row in summary["channels"].items() if "reference" in row}
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("channel")
    table.add_column("unit")
    heads = ["offset", "+- (95 %)"]
    if truth:
        heads += ["true", "error", "in band", "good from", "RMS raw", "RMS comp."]
    if references:
        heads += ["raw - other", "ours - other"]
    for head in heads:
        table.add_column(head, justify="right")
    table.add_column("state")
    for name, row in summary["channels"].items():
        scale, unit, digits = _SHOWN[row["unit"]]

        def show(value: float | None, scale: float = scale, digits: int = digits) -> str:
            return "-" if value is None or math.isnan(value) else f"{value * scale:+.{digits}f}"

        cells = [show(row["offset"]), show(_twice(row["offset_std"])).lstrip("+")]
        if truth:
            known = truth.get(name, {})
            cells += [show(known.get("true_offset")), show(known.get("offset_error"))]
            cells += [_share(known.get("coverage_95")), _seconds(known.get("within_goal_from_s"))]
            cells += [show(known.get(key)).lstrip("+") for key in ("rms_error_raw", "rms_error_compensated")]
        if references:
            other = references.get(name)
            cells += [
                show(other[f"{key}_mean"] - other["reference_mean"]) if other else "-" for key in ("raw", "compensated")
            ]
        table.add_row(name, unit, *cells, row["state"])
    console = _Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    console.print(table)
    counts = summary["counts"]
    print(
        f"{summary['rows']} rows over {summary['duration_s']:.1f} s; {counts['frames']} frames, "
        f"{counts['rejected']} values refused, {counts['missed']} ticks missed, {counts['gaps']} gaps, "
        f"{counts['clock_steps']} clock steps"
    )
    print_warnings(summary["warnings"], summary["notes"], to_stdout=True)
    if folder is not None:
        print(f"report: {folder / 'report.html'}")


def _share(value: float | None) -> str:
    """How much of the drive the 95 % band held the truth."""
    return "-" if value is None else f"{100.0 * value:.0f} %"


def _seconds(value: float | None) -> str:
    """From when on the error stayed within the goal."""
    return "-" if value is None else f"{value:.0f} s"


def _twice(std: float | None) -> float | None:
    return None if std is None else 1.96 * std


def print_simulation(summary: dict[str, Any]) -> None:
    """Where the simulated recording lies and what to do with it."""
    folder = summary["folder"]
    print(f"{summary['scenario']} (seed {summary['seed']}): {summary['frames']} frames, {summary['duration_s']:.0f} s")
    if summary["picture"] is not None:
        print(f"picture: {summary['picture']}")
    print_warnings((), summary["notes"], to_stdout=True)
    print(f"next: dsz replay {folder}/recording.log -c {folder}/config.yaml --truth {folder}/truth.parquet -o OUT")
