"""What is said of a recording: as it stands in diagnosis.json."""

from __future__ import annotations

from typing import NamedTuple

from dsz_daemon.diagnose.residuals.locate import Place
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.verdict.aliases import SameAsOffset, SameAsSlip

__all__ = ["Cause", "ChannelFit", "Coefficient", "Diagnosis", "ParameterError", "Place", "Shape", "Sides", "Value"]


class Value(NamedTuple):
    """A number with its spread (one standard deviation; None: not a fitted one)."""

    value: float | str
    std: float | None
    unit: str


class Cause(NamedTuple):
    """One effect that earns its place on unseen data; `gain` in log likelihood, `probability` of its alias group.

    `source`: where its equation is from; `elsewhere`: what it gains where whole manoeuvres, or recordings, are unseen.
    """

    effect: str
    probability: float
    statement: str
    parameters: dict[str, Value]
    equation: str
    gain: float
    elsewhere: dict[str, float]
    indistinguishable_from: list[str]
    alternatives: list[dict[str, float | str]]
    next_manoeuvre: str | None
    source: str = ""


class ParameterError(NamedTuple):
    """A configured parameter that fits better otherwise, SI."""

    parameter: str
    configured: float
    fitted: float
    std: float


class Sides(NamedTuple):
    """RMS with the nominal simulation, and with the causes in it."""

    before: float
    after: float


class ChannelFit(NamedTuple):
    """How well one channel fits, on rows that the fit has seen and on those that it has not.

    `flexible`: what a model that fits nearly anything would leave on unseen rows (see `flexible.py`); None without it.
    """

    train: Sides
    held_out: Sides
    noise_floor: float
    flexible: float | None
    unit: str


class Diagnosis(NamedTuple):
    """All that is said of one recording; `level` is what is left over what may be, per channel."""

    verdict: str
    located: list[Place]
    causes: list[Cause]
    parameter_errors: list[ParameterError]
    unlisted: list[Shape]
    fit: dict[str, ChannelFit]
    level: dict[str, float]
    could_not_test: list[dict[str, str]]
    offsets: dict[str, Value]
    same_as_offsets: list[SameAsOffset]
    same_as_slip: list[SameAsSlip]
