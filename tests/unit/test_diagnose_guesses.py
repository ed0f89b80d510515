"""diagnose: where a slippery stretch is begun with."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection import guesses as guesses_module
from dsz_daemon.diagnose.selection.guesses import guesses
from dsz_daemon.diagnose.simulation.drive import nothing

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
