"""diagnose: readings that clip stand at their limit; what goes to and fro there is something else."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import values_of
from dsz_daemon.diagnose.recordings.flat_tops import FlatTop
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat

LIMIT_MPS2 = 2.0
LIMIT = INDEX["sensor_saturation.accel_limit_mps2"]
ACROSS = 4


def clipping(pulses_mps2: float) -> Drive:
    """Its lateral accelerometer reads no more than 2 m/s2, and goes up and down below that by so much."""
    level = drive({}, CITY_V, CITY_STEER)
    even = predicted(level, nothing(), flat(N))[:, ACROSS]
    assert np.max(np.abs(even)) > 1.2 * LIMIT_MPS2
    pulses = pulses_mps2 * (0.5 + 0.5 * np.sin(2.0 * np.pi * 0.9 * T)) * np.sign(even)
    measured = level.measured.copy()
    beyond = np.abs(even) > LIMIT_MPS2
    limited = np.clip(even, -LIMIT_MPS2, LIMIT_MPS2)
    measured[:, ACROSS] += np.where(beyond, limited - pulses, even) - even
    return level._replace(measured=measured)


@pytest.mark.parametrize(("pulses_mps2", "is_none"), [(0.0, False), (0.02, False), (1.0, True)])
def test_readings_that_clip_stand_at_the_limit(pulses_mps2: float, is_none: bool) -> None:
    one = clipping(pulses_mps2)
    rows, x = rows_of(one), nothing()
    x[LIMIT] = LIMIT_MPS2
    fit = fitted(one, rows, x, ("sensor_saturation",), TOLERANCE)
    fit.x[LIMIT] = LIMIT_MPS2
    left = (one.measured - predicted(one, fit.x, fit.road))[rows.at]
    fit = fit._replace(left=np.where(rows.used, left, 0.0))
    assert is_implausible(one, rows, fit, "sensor_saturation") is is_none


@pytest.mark.parametrize(("stands_at_mps2", "told_mps2"), [(2.05, 2.05), (2.3, None), (None, None)])
def test_a_limit_is_told_as_readings_have_it(stands_at_mps2: float | None, told_mps2: float | None) -> None:
    """A fit to short tops, which a filter has made lower, is no better; readings that stand elsewhere are not it."""
    one = clipping(0.0)
    tops = () if stands_at_mps2 is None else (FlatTop(ACROSS, stands_at_mps2, 100.0, T[::50]),)
    one = one._replace(recording=one.recording._replace(tops=tops))
    x = nothing()
    x[LIMIT] = LIMIT_MPS2
    fit = fitted(one, rows_of(one), x, ("sensor_saturation",), TOLERANCE)
    value, std = values_of(one, fit, "sensor_saturation")["accel_limit_mps2"]
    assert value == pytest.approx(told_mps2 or fit.x[LIMIT])
    assert fit.x[LIMIT] == pytest.approx(LIMIT_MPS2, abs=0.02)
    as_fitted = values_of(one, fit, "sensor_saturation", as_fitted=True)["accel_limit_mps2"]
    assert as_fitted[0] == fit.x[LIMIT]
    assert as_fitted[1] > std
