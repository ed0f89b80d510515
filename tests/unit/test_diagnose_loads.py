"""diagnose: what a load weighs is no surer than how it turns with the car."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.comparison import rows_of, sensitivities
from dsz_daemon.diagnose.descent import Place
from dsz_daemon.diagnose.effects import INDEX
from dsz_daemon.diagnose.fit import Fit, fitted
from dsz_daemon.diagnose.loads import spread_by_inertia
from dsz_daemon.diagnose.prediction import Drive, nothing, predicted

ADDED, SHIFT = INDEX["mass_loading.added_mass_kg"], INDEX["mass_loading.cg_shift_m"]
ADDED_KG, FROM_THE_CG_M = 300.0, 0.8


def loaded(inertia_more_kgm2: float = 0.0) -> tuple[Drive, Fit]:
    """A loaded car that turns as configured, fitted by one whose yaw inertia is so much larger."""
    one = drive({"mass_loading.added_mass_kg": ADDED_KG, "mass_loading.cg_shift_m": -0.1}, CITY_V, CITY_STEER)
    one = one._replace(car=one.car._replace(yaw_inertia_kgm2=one.car.yaw_inertia_kgm2 + inertia_more_kgm2))
    return one, fitted(one, rows_of(one), nothing(), ("mass_loading",), TOLERANCE, 1e-6)


def std_of(fit: Fit, column: int) -> float:
    return float(fit.std[fit.columns.index(column)])


def test_a_load_is_as_unsure_as_what_its_inertia_would_move_it_by() -> None:
    """By parallel axes 0.8 m from the C.G.: m M/(m + M) d^2."""
    one, fit = loaded()
    mass_kg = one.car.mass_kg
    _, other = loaded(mass_kg * ADDED_KG / (mass_kg + ADDED_KG) * FROM_THE_CG_M**2)
    for column in (ADDED, SHIFT):
        moved = abs(float(other.x[column] - fit.x[column]))
        assert std_of(fit, column) > 0.7 * moved
        assert moved > 0.3 * std_of(fit, column)
    assert fit.x[ADDED] == pytest.approx(ADDED_KG, abs=2.0 * std_of(fit, ADDED))


def test_nothing_on_board_turns_nothing() -> None:
    one, fit = loaded()
    rows, x = rows_of(one), fit.x.copy()
    slopes = sensitivities(one, rows, x, fit.road, predicted(one, x, fit.road), fit.columns, fit.felt)
    moved = []
    for added_kg in (0.0, 150.0, -150.0, 300.0):
        x[ADDED] = added_kg
        here = Place(x, fit.felt, fit.road, predicted(one, x, fit.road), fit.left, fit.scatter, np.zeros(0))
        weight = np.full(len(fit.columns), 1e-6)
        found = spread_by_inertia(one, rows, here, slopes, fit.sums, weight)
        moved.append(float(found[fit.columns.index(ADDED)]))
    assert moved[0] == 0.0
    assert 0.0 < moved[1] < moved[3]
    assert moved[2] == pytest.approx(moved[1], rel=0.5)


def test_what_moves_the_cg_far_stands_far_out_but_between_the_axles() -> None:
    """300 kg that move it by 0.02 m stand within 0.8 m of it, by 0.15 m at 1 m, by 0.24 m at 1.6, behind the axle."""
    one, fit = loaded()
    rows, x = rows_of(one), fit.x.copy()
    slopes = sensitivities(one, rows, x, fit.road, predicted(one, x, fit.road), fit.columns, fit.felt)
    whole_kg, moved = one.car.mass_kg + ADDED_KG, []
    out_m = (0.8, 1.0, 0.5 * one.car.wheelbase_m)
    for shift_m in (-0.02, -ADDED_KG * out_m[1] / whole_kg, -ADDED_KG * 1.6 / whole_kg):
        x[ADDED], x[SHIFT] = ADDED_KG, shift_m
        here = Place(x, fit.felt, fit.road, predicted(one, x, fit.road), fit.left, fit.scatter, np.zeros(0))
        found = spread_by_inertia(one, rows, here, slopes, fit.sums, np.full(len(fit.columns), 1e-6))
        moved.append(float(found[fit.columns.index(ADDED)]))
    ratios = np.sqrt(np.array(moved) / moved[0])
    np.testing.assert_allclose(ratios, np.array(out_m) / 0.8, rtol=0.2)
