"""diagnose: tyres that do more with the load of a bend are how a car is drawn, and no physics left out."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, Drive, drive, found

from dsz_daemon.diagnose.effects.nameless import OUTER_LOAD
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.selection.trials import Step, rank_by
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.verdict.answer import answered

HEIGHT = INDEX[f"{OUTER_LOAD}.height_m"]


def bends(left_out: dict[str, float]) -> Drive:
    return drive({f"{OUTER_LOAD}.height_m": 0.6} | left_out, CITY_V, 1.3 * CITY_STEER)


def test_nothing_is_said_of_outer_tyres_that_do_more() -> None:
    there = found(bends({}))
    assert there.best.effects == (OUTER_LOAD,)
    assert there.best.x[HEIGHT] == pytest.approx(0.6, abs=0.1)
    told = answered(there)
    assert (told.verdict, told.causes, told.unlisted) == ("consistent", [], [])


@pytest.mark.parametrize(
    ("effect", "parameter", "size", "near"),
    [("steering_ratio", "scale", 0.03, 0.006), ("wheel_speed_delay", "delay_s", 0.05, 0.005)],
)
def test_beside_them_a_name_is_told_as_it_is(effect: str, parameter: str, size: float, near: float) -> None:
    there = found(bends({f"{effect}.{parameter}": size}))
    assert [cause.effect for cause in answered(there).causes] == [effect]
    assert there.best.x[INDEX[f"{effect}.{parameter}"]] == pytest.approx(size, abs=near)


def test_a_ratio_alone_is_no_load() -> None:
    there = found(drive({"steering_ratio.scale": 0.03}, CITY_V, 1.3 * CITY_STEER))
    assert there.best.effects == ("steering_ratio",)


@pytest.mark.parametrize(("height_m", "is_none"), [(0.1, True), (0.5, False), (0.9, False), (1.2, True)])
def test_no_car_is_as_low_or_as_high(height_m: float, is_none: bool) -> None:
    one = bends({})
    fit = fitted(one, rows_of(one), nothing(), (OUTER_LOAD,), TOLERANCE)
    x = np.where(np.arange(len(fit.x)) == HEIGHT, height_m, fit.x)
    assert is_implausible(one, rows_of(one), fit._replace(x=x), OUTER_LOAD) is is_none


@pytest.mark.parametrize(("gains", "first"), [(101.0, OUTER_LOAD), (99.0, "steering_ratio")])
def test_how_a_car_is_drawn_is_held_against_names_as_they_are_against_each_other(
    monkeypatch: pytest.MonkeyPatch, gains: float, first: str
) -> None:
    one = bends({})
    fit = fitted(one, rows_of(one), nothing(), (OUTER_LOAD,), TOLERANCE)
    tried = [Step("steering_ratio", 100.0, fit), Step(OUTER_LOAD, gains, fit._replace(road=None))]  # type: ignore[arg-type]
    monkeypatch.setattr(
        "dsz_daemon.diagnose.selection.trials.gained", lambda _, __, own, ___: gains if own.road is None else 100.0
    )
    assert max(tried, key=rank_by(one, fit, tried)).effect == first
