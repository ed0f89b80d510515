"""diagnose: on a road that tilts an IMU's height is not told from that of the C.G. above the way."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting import spreads
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat

DT_S, ABOVE_M = 0.01, 0.5
X, Y, Z = (INDEX[f"imu_lever_arm.{axis}_m"] for axis in "xyz")
BOTH = ("road_bank", "imu_lever_arm")
# A road that turns quickly.
BANK_RAD = 0.02 * np.sin(1.9 * T + 1.0) + 0.015 * np.sin(1.1 * T)


def turned_about_the_way(aside_m: float = 0.0) -> Drive:
    """A car of which the C.G. is above the way that turns: it goes -h p' sideways; and its IMU stands aside."""
    level = drive({}, CITY_V, CITY_STEER)
    noise = level.measured - predicted(level, nothing(), flat(N))
    x = nothing()
    x[Y] = aside_m
    one = level._replace(measured=predicted(level, x, flat(N)._replace(bank_rad=BANK_RAD)) + noise)
    one.measured[:, 4] -= ABOVE_M * np.gradient(np.gradient(BANK_RAD, DT_S), DT_S)
    return one


def test_a_cg_above_a_road_that_turns_is_no_lever_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    one = turned_about_the_way()
    rows = rows_of(one)
    assert searched(one, rows, TOLERANCE).best.effects == ("road_bank",)
    # As if all heights of a C.G. were none, the IMU stands on a mast.
    monkeypatch.setattr(spreads, "_ABOVE_THE_WAY_M", 0.0)
    found = searched(one, rows, TOLERANCE).best
    assert set(found.effects) == set(BOTH)
    assert found.x[Z] == pytest.approx(ABOVE_M, rel=0.2)


def test_nor_is_one_above_a_climb_that_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whose top goes forward as its nose goes down."""
    level = drive({}, CITY_V, CITY_STEER)
    noise = level.measured - predicted(level, nothing(), flat(N))
    one = level._replace(measured=predicted(level, nothing(), flat(N)._replace(grade_rad=BANK_RAD)) + noise)
    one.measured[:, 3] -= ABOVE_M * np.gradient(np.gradient(BANK_RAD, DT_S), DT_S)
    rows = rows_of(one)
    assert searched(one, rows, TOLERANCE).best.effects == ("road_grade",)
    monkeypatch.setattr(spreads, "_ABOVE_THE_WAY_M", 0.0)
    found = searched(one, rows, TOLERANCE).best
    assert set(found.effects) == {"road_grade", "imu_lever_arm"}
    assert found.x[Z] == pytest.approx(ABOVE_M, rel=0.2)


def test_an_arm_that_is_told_otherwise_is_named_beside_a_bank_and_its_height_is_not_sure() -> None:
    one = turned_about_the_way(aside_m=0.3)
    rows = rows_of(one)
    found = searched(one, rows, TOLERANCE).best
    assert set(found.effects) == set(BOTH)
    for column, true, least in ((Y, 0.3, 0.0), (Z, 0.0, 0.4)):
        std = float(found.std[found.columns.index(column)])
        assert abs(found.x[column] - true) < 2.0 * std
        assert least <= std < least + 0.1


def test_without_a_bank_a_height_is_as_sure_as_ever() -> None:
    """On a body that leans quickly it is told to some centimetres."""
    leans = {"suspension_roll.roll_gradient_rad_per_mps2": 0.02}
    one, start = drive(leans, CITY_V, CITY_STEER), nothing()
    rows, start[INDEX["suspension_roll.roll_gradient_rad_per_mps2"]] = rows_of(one), 0.02
    arm = ("suspension_roll", "imu_lever_arm")
    alone, beside = (fitted(one, rows, start, effects, TOLERANCE) for effects in (arm, ("road_bank", *arm)))
    assert alone.std[alone.columns.index(Z)] < 0.2
    assert beside.std[beside.columns.index(Z)] >= 0.4

    def is_refused(fit: Fit, aside_m: float, up_m: float) -> bool:
        x = fit.x.copy()
        x[X], x[Y], x[Z] = 0.0, aside_m, up_m
        return is_implausible(one, rows, fit._replace(x=x), "imu_lever_arm")

    assert [is_refused(beside, *arm) for arm in ((0.0, 0.7), (0.0, 0.9), (0.2, 0.7))] == [True, False, False]
    assert not is_refused(alone, 0.0, 0.5)
