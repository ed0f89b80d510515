"""What was tried beside a model, for when it is asked again of the same: only what is refused there has changed."""

from __future__ import annotations

from collections.abc import Collection, Hashable
from dataclasses import dataclass, field

from dsz_daemon.diagnose.residuals.comparison import Each
from dsz_daemon.diagnose.selection.screening import Screening
from dsz_daemon.diagnose.selection.starts import Start
from dsz_daemon.diagnose.selection.trials import Step, Trial


@dataclass(frozen=True)
class Remembered(Trial):
    """A trial that fits and judges each candidate once; with what its model's screening found, and where to begin.

    Lost is nothing by it: the same start leads to the same step. Won is a round of fits for each that is refused.
    """

    screening: Screening
    starts: tuple[Start, ...]
    _steps: dict[Hashable, Step] = field(default_factory=dict)
    _judged: dict[int, tuple[Step, Step]] = field(default_factory=dict)

    def starts_but_for(self, refused: Collection[str]) -> list[Start]:
        """Where to begin with what is not refused."""
        return [start for start in self.starts if not set(start[0]) & set(refused)]

    def fit(self, start: Start, each: Each = map, leader: float = 0.0) -> Step:
        """As `Trial.fit`; from the same start behind the same leader the same step."""
        new, x = start
        key = new, x.tobytes(), leader
        if key not in self._steps:
            self._steps[key] = super().fit(start, each, leader)
        return self._steps[key]

    def judge(self, step: Step, each: Each = map) -> Step:
        """As `Trial.judge`; a step that was judged is not judged again."""
        # The step is kept beside what it came to: a number of an object that is gone may be another's.
        if id(step) not in self._judged:
            self._judged[id(step)] = step, super().judge(step, each)
        return self._judged[id(step)][1]
