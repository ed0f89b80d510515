"""The page of `dsz bench accuracy`: Markdown, written by the command alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dsz_daemon.errors import MachineError
from dsz_daemon.runs.accuracy import ESTIMATORS, HIGH_PASS, PAPER, PRINTED, RAW, STANDSTILL
from dsz_daemon.runs.rivals import HIGH_PASS_S, STILL_FOR_S
from dsz_daemon.runs.truth import AT_S
from dsz_daemon.signals import GYRO_CHANNELS, IMU_CHANNELS

Trials = Sequence[dict[str, Any]]

_AT = tuple(f"{at_s:g}" for at_s in AT_S)

_HEAD = """# Accuracy against truth

Written by

    dsz bench accuracy --seeds {seeds} --page docs/accuracy.md

with dsz {version}. A trial is one of the simulated drives (`dsz simulate`) with the sensors of one seed: every null
error within the data sheet's limits, scale and cross-axis errors as left by a calibration, noise, pole rings.
{trials} trials: seeds 1 to {seeds} in each of {scenarios} scenarios. The car and its roads share no formula with the
estimators; a scenario's drive is the same for all of its seeds. Figures are of the offset's error, |estimated - true|,
so many seconds after the first frame: **median / 90th percentile** over the seeds, deg/s and m/s2.

Who is compared, on the same readings:

- *{raw}*: nothing is taken off; the error is the sensor's own.
- *{standstill}*: the mean of the readings while all wheels have been silent for {still:g} s, kept until the next
  stop; a_x and a_y as if the place were level.
- *{high_pass}*: a low-pass of {high_pass_s:g} s is taken off (a plain mean until then).
- *{printed}*: the paper's law to the letter, c_y = 1.2, constant gains, deaf to standstill.
- *{paper}*: what the daemon runs.
"""


def page(result: dict[str, Any]) -> str:
    """The whole page of what `accuracy` returned."""
    trials: Trials = result["trials"]
    names: list[str] = result["scenarios"]
    parts = [
        _HEAD.format(
            seeds=result["seeds"],
            version=result["version"],
            trials=len(trials),
            scenarios=len(names),
            raw=RAW,
            standstill=STANDSTILL,
            still=STILL_FOR_S,
            high_pass=HIGH_PASS,
            high_pass_s=HIGH_PASS_S,
            printed=PRINTED,
            paper=PAPER,
        ),
        _in_short(trials),
        _worse_than_raw(trials, names),
        _spreads(trials, names),
        *(_channel(trials, names, channel) for channel in IMU_CHANNELS),
    ]
    return "\n".join(parts)


def write_page(result: dict[str, Any], path: Path) -> None:
    """The page into a file. MachineError where it can't be written."""
    try:
        path.write_text(page(result))
    except OSError as error:
        raise MachineError(f"{path}: can't write the page: {error.strerror or error}") from error


def _unit(channel: str) -> tuple[str, float, int]:
    return ("deg/s", 180.0 / math.pi, 3) if channel in GYRO_CHANNELS else ("m/s2", 1.0, 3)


def _errors(trials: Trials, channel: str, estimator: str, at: str, name: str | None = None) -> list[float]:
    """Absolute errors in the page's unit."""
    factor = _unit(channel)[1]
    found = []
    for trial in trials:
        if name is None or trial["scenario"] == name:
            error = trial["channels"][channel][estimator]["error_at_s"].get(at)
            if error is not None:
                found.append(abs(error) * factor)
    return found


def _cell(errors: Sequence[float], best: bool = False) -> str:
    if not errors:
        return "-"
    middle, most = np.median(errors), np.quantile(errors, 0.9)
    text = f"{middle:.3f} / {most:.3f}"
    return f"**{text}**" if best else text


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join([_row(head), "|" + "---|" * len(head), *map(_row, rows), ""])


def _compared(trials: Trials, channel: str, at: str, name: str | None = None) -> list[str]:
    """A cell an estimator; the least median is bold."""
    errors = [_errors(trials, channel, estimator, at, name) for estimator in ESTIMATORS]
    medians = [float(np.median(found)) if found else math.inf for found in errors]
    return [_cell(found, best=median == min(medians)) for found, median in zip(errors, medians, strict=True)]


def _in_short(trials: Trials) -> str:
    rows = [
        [f"{channel}, {_unit(channel)[0]}", f"{at} s", *_compared(trials, channel, at)]
        for channel in IMU_CHANNELS
        for at in _AT
    ]
    return "## In short: all scenarios together\n\n" + _table(["channel", "after", *ESTIMATORS], rows)


def _worse_than_raw(trials: Trials, names: Sequence[str]) -> str:
    """Where the daemon does harm: its last error's median is above the sensor's own."""
    words = []
    for name in names:
        for channel in IMU_CHANNELS:
            mine = [trial["channels"][channel] for trial in trials if trial["scenario"] == name]
            factor = _unit(channel)[1]
            ours, raw = (
                float(np.median([abs(one[estimator]["offset_error"]) for one in mine])) * factor
                for estimator in (PAPER, RAW)
            )
            if ours > raw:
                words.append(f"- {name}, {channel}: {ours:.3f} instead of {raw:.3f} {_unit(channel)[0]}")
    head = "## Where the daemon ends worse than raw\n\n"
    if not words:
        return head + "Nowhere.\n"
    text = "A road that leans or climbs for most of a drive looks like an offset: no gate sees it.\n"
    text += "Medians at the end of the drive:\n\n"
    return head + text + "\n".join(words) + "\n"


def _spreads(trials: Trials, names: Sequence[str]) -> str:
    """Whether the published band holds the truth, and since when the error is within the goal."""
    rows = []
    for name in names:
        cells = []
        for channel in IMU_CHANNELS:
            mine = [trial["channels"][channel][PAPER] for trial in trials if trial["scenario"] == name]
            held = [one["coverage_95"] for one in mine if one["coverage_95"] is not None]
            since = [one["within_goal_from_s"] for one in mine]
            reached = sorted(math.inf if at_s is None else at_s for at_s in since)
            middle = reached[len(reached) // 2]
            when = "never" if math.isinf(middle) else f"{middle:.0f} s"
            cells.append(f"{100.0 * float(np.mean(held)):.0f} % / {when}" if held else "-")
        rows.append([name, *cells])
    text = (
        "Share of the drive in which the published 95 % band holds the truth, mean over the seeds / since when the\n"
        "error is within the channel's goal (0.1 deg/s; 0.2, 0.25, 0.1 m/s2) for good, median.\n\n"
    )
    return f"## {PAPER}: its band, and when it is good\n\n" + text + _table(["scenario", *IMU_CHANNELS], rows)


def _channel(trials: Trials, names: Sequence[str], channel: str) -> str:
    rows = [
        [name, f"{at} s", *_compared(trials, channel, at, name)]
        for name in names
        for at in _AT
        if _errors(trials, channel, RAW, at, name)
    ]
    return f"## {channel}, {_unit(channel)[0]}\n\n" + _table(["scenario", "after", *ESTIMATORS], rows)
