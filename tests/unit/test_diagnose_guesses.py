"""diagnose: where a slippery stretch is begun with."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.descent import loss_of_rows
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import residual, rows_of
from dsz_daemon.diagnose.selection import guesses as guesses_module
from dsz_daemon.diagnose.selection.guesses import guesses
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.simulation.prediction import predicted

ICE = "low_friction"


@pytest.mark.parametrize(
    ("others", "begun"),
    [
        ([], [(20.0, 30.0)]),
        # Another stretch that gains about as much is begun with, too; the same is not, nor one that gains less.
        ([(95.0, 20.0, 36.0)], [(20.0, 30.0), (20.0, 36.0)]),
        ([(95.0, 25.0, 30.0), (92.0, 20.0, 36.0)], [(20.0, 30.0), (25.0, 30.0)]),
        ([(95.0, 20.0, 31.5), (92.0, 20.0, 36.0)], [(20.0, 30.0), (20.0, 36.0)]),
        ([(89.0, 20.0, 36.0)], [(20.0, 30.0)]),
    ],
)
def test_a_stretch_that_gains_about_as_much_is_begun_with_too(
    monkeypatch: pytest.MonkeyPatch, others: list[tuple[float, float, float]], begun: list[tuple[float, float]]
) -> None:
    """Gain, begin and end (s) of the best stretch of each friction."""
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    told = [*others, (100.0, 20.0, 30.0)]

    def stretch(_: object) -> tuple[int, int, float]:
        total, *moments_s = told.pop(0) if told else (0.0, 0.0, 0.0)
        first, last = (int(np.argmin(np.abs(rows.at * DT_S - moment_s))) for moment_s in moments_s)
        return first, last + 1, total

    monkeypatch.setattr(guesses_module, "_stretch", stretch)
    starts = [x for effect, x in guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)) if effect == ICE]
    moments = [INDEX[f"{ICE}.start_s"], INDEX[f"{ICE}.end_s"]]
    assert [tuple(np.round(x[moments], 1)) for x in starts] == begun


@pytest.mark.parametrize(("softer", "beside"), [(0.0, 0.0), (-0.03, 0.0), (-0.008, -0.008), (0.03, 0.03)])
def test_a_stretch_is_looked_for_beside_configured_tyres_where_softer_ones_have_some_of_it(
    softer: float, beside: float
) -> None:
    """A stretch that holds 0.6 for a while: tyres that are 3 % softer all the way have taken what it does."""
    slippery = {f"{ICE}.inverse_square": 0.6**-2, f"{ICE}.sharpness": 1.0, f"{ICE}.start_s": 20.0, f"{ICE}.end_s": 45.0}
    one = drive(slippery, CITY_V, 1.3 * CITY_STEER)
    rows = rows_of(one)
    before = fitted(one, rows, nothing(), (), {})
    x = before.x.copy()
    for axle in ("front", "rear"):
        x[INDEX[f"{axle}_cornering_stiffness_n_per_rad"]] = softer
    # As if these were what fits best: what is left is that, and of the true tyres so much more.
    there = residual(rows, predicted(one, x, before.road))
    start = dict(guesses(one, rows, before._replace(x=x, left=there)))[ICE]
    assert 15.0 < start[INDEX[f"{ICE}.start_s"]] < start[INDEX[f"{ICE}.end_s"]] < 50.0
    # With the tyres beside which it is seen the best.
    assert start[INDEX["rear_cornering_stiffness_n_per_rad"]] == beside


@pytest.mark.parametrize(("share", "is_one"), [(0.45, False), (0.55, True)])
def test_beside_configured_tyres_a_stretch_has_to_do_half_of_what_softer_ones_do(
    monkeypatch: pytest.MonkeyPatch, share: float, is_one: bool
) -> None:
    """Tyres that are softer do better than configured ones all the way, and so does nearly anything that softens."""
    softer = {f"{axle}_cornering_stiffness_n_per_rad": -0.05 for axle in ("front", "rear")}
    one = drive(softer, CITY_V, 1.3 * CITY_STEER)
    rows = rows_of(one)
    best = fitted(one, rows, nothing(), (), TOLERANCE)
    x = best.x.copy()
    x[[INDEX[name] for name in softer]] = 0.0
    there = loss_of_rows(residual(rows, predicted(one, x, best.road)), rows, best.scatter)
    more = float(np.sum(there - loss_of_rows(best.left, rows, best.scatter)))
    assert more > 1000.0
    asked: list[object] = []

    def stretch(values: object) -> tuple[int, int, float]:
        # Of the tyres so far first, then beside configured ones.
        asked.append(values)
        return 500, 1000, 0.0 if len(asked) <= 28 else share * more

    monkeypatch.setattr(guesses_module, "_stretch", stretch)
    starts = [start for effect, start in guesses(one, rows, best) if effect == ICE]
    assert len(asked) == 56
    assert (len(starts) > 0) is is_one
