"""diagnose: readings that clip stand at their limit; what goes to and fro there is something else."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat

LIMIT_MPS2 = 2.0
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
    x[INDEX["sensor_saturation.accel_limit_mps2"]] = LIMIT_MPS2
    fit = fitted(one, rows, x, ("sensor_saturation",), TOLERANCE)
    fit.x[INDEX["sensor_saturation.accel_limit_mps2"]] = LIMIT_MPS2
    left = (one.measured - predicted(one, fit.x, fit.road))[rows.at]
    fit = fit._replace(left=np.where(rows.used, left, 0.0))
    assert is_implausible(one, rows, fit, "sensor_saturation") is is_none
