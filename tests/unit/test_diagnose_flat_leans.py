"""diagnose: a body that leans and dives, drawn so that it stays as it leans while the car turns."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, T, drive, found

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.selection.starts import starts_of
from dsz_daemon.diagnose.simulation.drive import nothing

FLAT_LEANS, SMALL_TURNS = INDEX["flat_leans"], INDEX["small_turns"]
ROLL, PITCH = INDEX["suspension_roll.roll_gradient_rad_per_mps2"], INDEX["suspension_pitch.pitch_gradient_rad_per_mps2"]
# Town: what a car turns by in its bends is most of what a lean does to a pitch gyro.
SLOW_V, TOWN_STEER = 7.0 + 2.0 * np.sin(0.3 * T), 0.2 * np.sin(0.25 * T) + 0.02 * np.sin(2.3 * T)
LEAN = 0.012


@pytest.mark.parametrize("flat_leans", [0.0, 1.0])
def test_a_body_that_leans_is_no_scale_however_it_is_drawn(flat_leans: float) -> None:
    left_out = {"suspension_roll.roll_gradient_rad_per_mps2": LEAN, "flat_leans": flat_leans}
    best = found(drive(left_out, SLOW_V, TOWN_STEER)).best
    assert best.effects == ("suspension_roll",)
    assert best.x[ROLL] == pytest.approx(LEAN, abs=5e-4)
    assert best.x[FLAT_LEANS] == pytest.approx(flat_leans, abs=0.1)


def test_how_a_lean_is_drawn_is_asked_of_what_leans() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    for effects, asked in [
        ((), False),
        (("imu_misalignment",), False),
        (("suspension_roll",), True),
        (("suspension_pitch",), True),
    ]:
        assert (FLAT_LEANS in fitted(one, rows, nothing(), effects, TOLERANCE).columns) is asked
        assert (SMALL_TURNS in fitted(one, rows, nothing(), effects, TOLERANCE).columns) is bool(effects)


def test_a_lean_that_no_linear_step_leans_is_tried_where_a_scale_is() -> None:
    left_out = {"suspension_roll.roll_gradient_rad_per_mps2": LEAN, "flat_leans": 1.0}
    one = drive(left_out, SLOW_V, TOWN_STEER)
    rows = rows_of(one)
    plain = fitted(one, rows, nothing(), (), TOLERANCE)
    assert "suspension_roll" not in screened(one, rows, plain, TOLERANCE, map).names[:7]
    starts = dict(starts_of(one, rows, plain, ["accel_scale", "gyro_scale"]))
    for effect, column in (("suspension_roll", ROLL), ("suspension_pitch", PITCH)):
        x = starts[(effect,)]
        assert x[column] > 0.0
        assert x[FLAT_LEANS] > 0.0
        # Where it is screened it begins as all others do.
        assert dict(starts_of(one, rows, plain, ["accel_scale", effect]))[(effect,)][column] == 0.0
        assert (effect,) not in dict(starts_of(one, rows, plain, ["gyro_scale"]))
        there = plain._replace(effects=(effect,))
        assert (effect,) not in dict(starts_of(one, rows, there, ["accel_scale"]))
