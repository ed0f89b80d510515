"""Beside the same model nothing is fitted or judged twice, and nothing is taken for what it is not."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection import search as search_module
from dsz_daemon.diagnose.selection.remembered import Remembered
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.selection.trials import Step, Trial

_NONE: Any = None


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> Counter[Any]:
    """How often each was fitted, by effects and where it began, and judged."""
    count: Counter[Any] = Counter()
    fit, judge, kept = Trial.fit, Trial.judge, list[Any]()

    def counted_fit(self: Trial, start: Any, each: Any = map, leader: float = 0.0) -> Step:
        kept.append(self.best)
        count["fit", self.best.effects, start[0], start[1].tobytes(), leader, id(self.best)] += 1
        return fit(self, start, each, leader)

    def counted_judge(self: Trial, step: Step, *more: Any) -> Step:
        kept.append(step.fit)
        count["judge", self.best.effects, step.effect, id(step.fit)] += 1
        return judge(self, step, *more)

    monkeypatch.setattr(Trial, "fit", counted_fit)
    monkeypatch.setattr(Trial, "judge", counted_judge)
    return count


def test_what_is_refused_does_not_have_the_others_fitted_again(
    monkeypatch: pytest.MonkeyPatch, done: Counter[Any]
) -> None:
    """Three effects of which only the first may stay: two rounds beside the same, each of all that turn or scale."""
    models = []

    def alone(_drive: Any, _rows: Any, before: Any, best: Any, *_: Any) -> tuple[Any, set[str]]:
        models.append(best)
        return (before, {best.effects[-1]}) if before.effects else (best, set())

    monkeypatch.setattr(search_module, "plausible", alone)
    one = drive({"accel_scale.y": 0.2, "wheel_radius.rl": -0.003, "gyro_scale.z": 0.05}, CITY_V, CITY_STEER)
    searched(one, rows_of(one), TOLERANCE)
    assert len({model.effects[0] for model in models}) == 1
    assert len(models) > 2
    assert {what[0] for what in done} == {"fit", "judge"}
    assert set(done.values()) == {1}


def test_another_start_or_leader_is_another_fit_and_another_step_is_judged_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []

    def fit(_self: Trial, start: Any, _each: Any = map, leader: float = 0.0) -> Step:
        asked.append((start[0], start[1].tolist(), leader))
        return Step(start[0][-1], leader + float(start[1][0]), _NONE)

    def judge(_self: Trial, step: Step, _each: Any = map) -> Step:
        asked.append(step)
        return step._replace(gain=step.gain + 100.0)

    monkeypatch.setattr(Trial, "fit", fit)
    monkeypatch.setattr(Trial, "judge", judge)
    zero, half = np.zeros(2), np.array([0.5, 0.0])
    starts = ((("a",), zero), (("a",), half), (("b",), zero))
    trial = Remembered(_NONE, _NONE, _NONE, {}, _NONE, _NONE, starts)
    gains = [trial.fit(start, map, leader).gain for _ in range(2) for start in starts for leader in (0.0, 7.0)]
    assert gains == 2 * [0.0, 7.0, 0.5, 7.5, 0.0, 7.0]
    assert len(asked) == 6
    one, other = Step("a", 1.0, _NONE), Step("a", 2.0, _NONE)
    assert [trial.judge(step).gain for step in (one, other, one, other)] == [101.0, 102.0, 101.0, 102.0]
    assert asked[6:] == [one, other]
    # A step that is gone leaves its place in memory to others.
    assert [trial.judge(Step("a", float(gain), _NONE)).gain for gain in range(20)] == [100.0 + i for i in range(20)]
    assert trial.starts_but_for({"a"}) == [(("b",), zero)]
    fresh = Remembered(_NONE, _NONE, _NONE, {}, _NONE, _NONE, starts)
    assert fresh.fit(starts[0], map, 1.0).gain == 1.0
    assert asked[-1] == (("a",), [0.0, 0.0], 1.0)
