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
from dsz_daemon.diagnose.selection.guesses import guesses
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat

LIMIT_MPS2 = 2.0
LIMIT, BEFORE = INDEX["sensor_saturation.accel_limit_mps2"], INDEX["sensor_saturation.before_offset"]
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


def moved_aside(before: float, offset_mps2: float = 0.3) -> Drive:
    """Its readings clip at 2 m/s2, before so much of their offset is added, and noise after that."""
    level = drive({}, CITY_V, CITY_STEER)
    measured, even = level.measured.copy(), predicted(level, nothing(), flat(N))[:, ACROSS]
    held = np.clip(even + (1.0 - before) * offset_mps2, -LIMIT_MPS2, LIMIT_MPS2)
    measured[:, ACROSS] += held + before * offset_mps2 - even
    return level._replace(measured=measured)


@pytest.mark.parametrize("before", [0.0, 1.0])
def test_readings_that_clip_before_their_offset_stand_higher_to_one_side(before: float) -> None:
    one = moved_aside(before)
    rows = rows_of(one)
    start = dict(guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)))["sensor_saturation"]
    assert start[BEFORE] == pytest.approx(0.5)
    fit = fitted(one, rows, start, ("sensor_saturation",), TOLERANCE)
    assert fit.x[BEFORE] == pytest.approx(before, abs=0.05)
    assert fit.x[LIMIT] == pytest.approx(LIMIT_MPS2, abs=0.01)
    assert fit.x[INDEX["offset_accel_y"]] == pytest.approx(0.3, abs=0.02)
    # As if clipped with it, the other end is off by twice the offset.
    with_it = fitted(
        one, rows, np.where(np.arange(len(start)) == BEFORE, 0.0, start), ("sensor_saturation",), TOLERANCE
    )
    assert (np.std(with_it.left[:, ACROSS]) > 1.3 * np.std(fit.left[:, ACROSS])) is np.bool_(before == 1.0)


def test_readings_that_stand_still_clip_with_their_offset() -> None:
    one = moved_aside(0.0)
    one = one._replace(recording=one.recording._replace(tops=(FlatTop(ACROSS, LIMIT_MPS2, 100.0, T[::50]),)))
    rows = rows_of(one)
    start = dict(guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)))["sensor_saturation"]
    assert start[BEFORE] == 0.0
    assert BEFORE not in fitted(one, rows, start, ("sensor_saturation",), TOLERANCE).columns
