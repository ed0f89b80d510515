"""The figures that Oh & Choi 2013 show of their two experiments, drawn of any run whose truth is known. Pure.

Figs 2 to 5 are of a flat road, 6 to 11 of a hill with a bank; which of them a run is like is asked of the
truth's road. Each picture says which figure it is drawn like, never that it is that figure.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.report.channel_figures import duration_s, gate_strip, marks_s
from dsz_daemon.report.display import (
    ACCELERATION,
    BARE,
    CHANNEL_NAMES,
    DEGREE,
    SPEED,
    Floats,
    Samples,
    channel_column,
    channel_unit,
)
from dsz_daemon.report.offline_page import Picture
from dsz_daemon.report.panels import BLUE, RAW, SKY, VERMILION, Figure, Panel, Trace, curve, stacked
from dsz_daemon.report.results import ChannelResult, column, seconds, truth_at
from dsz_daemon.report.rms_bars import rms_bars
from dsz_daemon.signals import ACCEL_CHANNELS

# Chosen: what a level road may be off by. The fall to the side that lets rain run off (2.5 %) counts as bank
# already; the paper's hill has 6 deg.
FLAT_BELOW_RAD = np.radians(1.0)
# The paper's Fig. 3 shows four seconds; where zeroing begins is asked of the gate.
_BEFORE_S, _AFTER_S = 1.0, 4.0
# What is shown of the road before and after a stretch with both angles.
_ROUND_S = 2.0
_PAPER = "Oh & Choi 2013"

_ON_THE_FLAT = (
    "Drawn of this run like Figs 2 to 5 of {paper} (sine steer on flat asphalt), with the simulation's truth in the "
    "place of their reference unit."
)
_ON_A_HILL = (
    "Drawn of this run like Figs 6 to 11 of {paper} (a downhill with a bank on the way), with the simulation's truth "
    "in the place of their reference unit."
)
_CONDITIONS = (
    "How fast the car was, and how it and the road were tilted. What is between the two is the body's lean on its "
    "springs."
)
_READINGS = "The six readings, raw and compensated, against what was true. Raw minus true is offset and noise."
_BEGINS = (
    "Where learning of the lateral offset begins, at {at_s:.1f} s: until then the compensated lateral acceleration is "
    "the raw one. Green: that channel's offset is learnt. This chart keeps to its own stretch of time."
)
_TILTED = (
    "The longest stretch on which the road has both grade and bank, {from_s:.0f} to {to_s:.0f} s: what such a road "
    "does to the compensation. Green: that channel's offset is learnt. This chart keeps to its own stretch of time."
)
_REFERENCES = (
    "The reference accelerations of equations (20) to (22), which offsets are learnt against, and what was true. "
    "Where they part, they must not be believed; green is where they are."
)
_BARS = (
    "RMS error against the truth, over all rows with a reading. Most of what is left after compensation is noise, "
    "where the third bar, the error of the estimated offset alone, is small."
)


class _Numbers(NamedTuple):
    """The paper's number for each kind of picture."""

    readings: int
    begins: int
    references: int
    bars: int


_FLAT = _Numbers(readings=2, begins=3, references=4, bars=5)
_HILL = _Numbers(readings=7, begins=8, references=10, bars=11)
_CONDITIONS_NUMBER, _TILTED_NUMBER = 6, 9


def _name(number: int) -> str:
    return f"paper-{number}"


# The pictures that show the reference accelerations.
REFERENCE_NAMES = frozenset({_name(_FLAT.references), _name(_HILL.references)})


def is_hilly(truth: Samples) -> bool:
    """Whether the truth's road has a bank or a grade beyond a degree."""
    angles = [column(truth, name) for name in ("road_bank_rad", "road_grade_up_rad")]
    return any(angle is not None and float(np.nanmax(np.abs(angle))) > FLAT_BELOW_RAD for angle in angles)


def paper_text(truth: Samples) -> str:
    """What stands above the pictures."""
    return (_ON_A_HILL if is_hilly(truth) else _ON_THE_FLAT).format(paper=_PAPER)


def paper_pictures(results: list[ChannelResult], samples: Samples, truth: Samples) -> list[Picture]:
    """All of the paper's figures for which run and truth have columns, in its order."""
    hilly = is_hilly(truth)
    numbers = _HILL if hilly else _FLAT
    channels = [r.channel for r in results]
    begins_s, tilted_s = zeroing_begins_s(samples), tilted_stretch_s(samples, truth)
    drawn: list[tuple[int, str, str, Figure | None, bool]] = [
        (numbers.readings, "readings", _READINGS, readings_figure(channels, samples, truth), False),
        (numbers.references, "reference accelerations", _REFERENCES, references_figure(samples, truth), False),
        (numbers.bars, "RMS errors", _BARS, rms_bars(results, samples, truth), True),
    ]
    if hilly:
        drawn.append((_CONDITIONS_NUMBER, "test conditions", _CONDITIONS, conditions_figure(samples, truth), False))
    if begins_s is not None:
        text = _BEGINS.format(at_s=begins_s)
        picture = magnified_figure(channels, samples, truth, (begins_s - _BEFORE_S, begins_s + _AFTER_S))
        drawn.append((numbers.begins, "readings where lateral zeroing begins", text, picture, True))
    if tilted_s is not None:
        text = _TILTED.format(from_s=tilted_s[0], to_s=tilted_s[1])
        picture = magnified_figure(channels, samples, truth, (tilted_s[0] - _ROUND_S, tilted_s[1] + _ROUND_S))
        drawn.append((_TILTED_NUMBER, "readings on bank and grade", text, picture, True))
    return [
        Picture(_name(number), [f"As Fig. {number}: {what}"], text, figure, is_alone, "h3")
        for number, what, text, figure, is_alone in sorted(drawn, key=lambda d: d[0])
        if figure
    ]


def zeroing_begins_s(samples: Samples) -> float | None:
    """When the lateral offset is first learnt; None where that is never, or from the first row on."""
    gate = column(samples, "accel_y_gate")
    if gate is None or not np.any(gate > 0) or gate[0] > 0:
        return None
    return float(seconds(samples)[int(np.argmax(gate > 0))])


def tilted_stretch_s(samples: Samples, truth: Samples) -> tuple[float, float] | None:
    """From when to when the road has both bank and grade, where that is longest; None: nowhere."""
    angles = [truth_at(samples, truth, name) for name in ("road_bank_rad", "road_grade_up_rad")]
    if angles[0] is None or angles[1] is None:
        return None
    both = (np.abs(angles[0]) > FLAT_BELOW_RAD) & (np.abs(angles[1]) > FLAT_BELOW_RAD)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], both, [False]]).astype(np.int8)))
    if not len(edges):
        return None
    time_s, starts, ends = seconds(samples), edges[::2], edges[1::2] - 1
    longest = int(np.argmax(time_s[ends] - time_s[starts]))
    return float(time_s[starts[longest]]), float(time_s[ends[longest]])


def _against_truth(channel: str, samples: Samples, truth: Samples, part: NDArray[np.bool_]) -> list[Trace]:
    """Raw, compensated and true over the rows of `part`; nothing where the truth does not know the channel."""
    time_s, unit = seconds(samples)[part], channel_unit(channel)
    true = truth_at(samples, truth, channel_column(channel))
    if true is None:
        return []

    def line(name: str, values: Floats | None, colour: str, width: float) -> list[Trace]:
        return [] if values is None else curve(name, time_s, values[part], unit, colour, width)

    return [
        *line("raw", column(samples, channel_column(channel, "raw")), RAW, 1.0),
        *line("compensated", column(samples, channel_column(channel)), BLUE, 1.0),
        *line("truth", true, VERMILION, 1.2),
    ]


def readings_figure(channels: list[str], samples: Samples, truth: Samples) -> Figure | None:
    """Figs 2 and 7: every channel's readings against the truth."""
    everything = np.ones(len(samples["time_s"]), dtype=bool)
    panels = [
        Panel(CHANNEL_NAMES[c], channel_unit(c), 90, _against_truth(c, samples, truth, everything)) for c in channels
    ]
    return stacked(panels, duration_s(samples), marks_s(samples))


def magnified_figure(
    channels: list[str], samples: Samples, truth: Samples, span_s: tuple[float, float]
) -> Figure | None:
    """Figs 3, 8 and 9: the same from `span_s[0]` to `span_s[1]`, and when each offset was learnt."""
    start_s, end_s = max(span_s[0], 0.0), min(span_s[1], duration_s(samples))
    time_s = seconds(samples)
    part = (time_s >= start_s) & (time_s <= end_s)
    panels = [Panel(CHANNEL_NAMES[c], channel_unit(c), 80, _against_truth(c, samples, truth, part)) for c in channels]
    if not part.any() or not any(panel.traces for panel in panels):
        return None
    rows = {name: values[part] for name, values in samples.items()}
    strips = [(c, gate_strip(c, rows, time_s[part], c)) for c in channels]
    known = tuple(c for c, traces in strips if traces)
    learning = [trace for _, traces in strips for trace in traces]
    panels.append(Panel("learning", BARE, 15 * len(known), learning, categories=known))
    marks = [t for t in marks_s(samples) if start_s <= t <= end_s]
    return stacked(panels, end_s, marks, start_s)


def references_figure(samples: Samples, truth: Samples) -> Figure | None:
    """Figs 4 and 10: the accelerations from inverse kinematics against the truth, and when they are believed."""
    time_s = seconds(samples)
    panels = []
    for channel in ACCEL_CHANNELS:
        true = truth_at(samples, truth, channel_column(channel))
        from_motion = column(samples, f"{channel}_kinematic_mps2")
        if true is None or from_motion is None:
            continue
        traces = [
            *curve("reference, from motion", time_s, from_motion, ACCELERATION, SKY, 1.0),
            *curve("truth", time_s, true, ACCELERATION, VERMILION, 1.2),
        ]
        strip = gate_strip(channel, samples, time_s, "gate")
        panels += [
            Panel(CHANNEL_NAMES[channel], ACCELERATION, 110, traces),
            Panel("believed", BARE, 16, strip, categories=("gate",)),
        ]
    return stacked(panels, duration_s(samples), marks_s(samples))


def conditions_figure(samples: Samples, truth: Samples) -> Figure | None:
    """Fig. 6: speed, roll and pitch of the car, and the road under it."""
    time_s = seconds(samples)
    grade = truth_at(samples, truth, "road_grade_up_rad")

    def true(name: str) -> Floats | None:
        return truth_at(samples, truth, name)

    panels = [
        Panel("speed", SPEED, 110, curve("speed", time_s, true("speed_mps"), SPEED, VERMILION)),
        Panel(
            "roll, left side up positive",
            DEGREE,
            110,
            [
                *curve("road's bank", time_s, true("road_bank_rad"), DEGREE, RAW, 2.0),
                *curve("car's roll", time_s, true("roll_rad"), DEGREE, VERMILION),
            ],
        ),
        Panel(
            "pitch, nose down positive",
            DEGREE,
            110,
            [
                *curve("road's grade, downhill", time_s, None if grade is None else -grade, DEGREE, RAW, 2.0),
                *curve("car's pitch", time_s, true("pitch_rad"), DEGREE, VERMILION),
            ],
        ),
    ]
    return stacked(panels, duration_s(samples), marks_s(samples))
