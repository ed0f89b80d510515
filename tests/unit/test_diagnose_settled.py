"""A search ends where its model fits best, not where a candidate's rough trial fit left it."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.search import searched


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("steering_backlash.width_rad", 0.01),
        ("suspension_roll.roll_gradient_rad_per_mps2", 0.01),
        ("steering_ratio.scale", 0.15),
    ],
)
def test_what_is_told_is_where_a_longer_fit_ends(name: str, value: float) -> None:
    """Fitted on, till no step takes a ten millionth off what is left, no number moves by a tenth of its spread."""
    one = drive({name: value}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    best = searched(one, rows, TOLERANCE).best
    assert best.effects == (name.partition(".")[0],)
    further = fitted(one, rows, best.x, best.effects, TOLERANCE, 1e-7)
    columns = list(best.columns)
    assert float(np.max(np.abs(further.x[columns] - best.x[columns]) / best.std)) < 0.1
