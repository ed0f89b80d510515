"""diagnose: a steering sensor that is eccentric is off straight ahead, too; that is no offset of the steering."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.search import Search, searched
from dsz_daemon.diagnose.shapes.eccentric import circle_of, parts_of
from dsz_daemon.diagnose.verdict.answer import answered

RATIO, CIRCLE_RAD = 16.0, 0.006
# Beyond half of its circle; and so far that half of it is no whole one's beginning.
STEER = {far: far * CITY_STEER for far in (2.0, 4.0)}


def searched_with(zero_rad: float, far: float) -> Search:
    """A car whose wheels turn by a circle of the hand wheel's angle more, from where its middle is `zero_rad` off."""
    more = zero_rad - CIRCLE_RAD * np.cos(2.0 * RATIO * STEER[far])
    one = drive({}, CITY_V, STEER[far] + more)._replace(steer=STEER[far])
    return searched(one, rows_of(one), TOLERANCE)


@pytest.mark.parametrize("far", [2.0, 4.0])
def test_what_a_circle_is_off_straight_ahead_is_no_offset(far: float) -> None:
    """And what was thought of before the circle, and does nothing beside it, is not said."""
    found = searched_with(0.0, far)
    assert set(found.best.effects) == {"steering_offset", "steering: k*(1-cos(2*hand))"}
    assert circle_of(found.drive, found.best) == "(1-cos(2*hand))"
    said = answered(found)
    assert said.causes == []
    [shape] = said.unlisted
    assert shape.shape == "k*cos(2*hand)"
    assert shape.coefficient.value == pytest.approx(-CIRCLE_RAD, rel=0.05)


@pytest.mark.parametrize("far", [2.0, 4.0])
def test_an_offset_beside_a_circle_is_one(far: float) -> None:
    found = searched_with(-0.004, far)
    assert circle_of(found.drive, found.best) is None
    said = answered(found)
    assert [cause.effect for cause in said.causes] == ["steering_offset"]
    assert said.causes[0].parameters["offset_rad"].value == pytest.approx(-0.004 - CIRCLE_RAD, abs=3e-4)
    assert [shape.shape for shape in said.unlisted] == ["k*(1-cos(2*hand))"]


@pytest.mark.parametrize("far", [2.0, 4.0])
@pytest.mark.parametrize("phase_rad", [0.6, -0.5])
def test_a_circle_that_begins_elsewhere_is_neither_an_offset_nor_a_ratio(phase_rad: float, far: float) -> None:
    """Near its zero it is an offset, and steep: sin(hand + phase) = sin(phase) cos(hand) + cos(phase) sin(hand)."""
    hand = RATIO * STEER[far]
    one = drive({}, CITY_V, STEER[far] + CIRCLE_RAD * np.sin(hand + phase_rad))._replace(steer=STEER[far])
    said = answered(searched(one, rows_of(one), TOLERANCE))
    assert said.causes == []
    assert any("cos(hand)" in shape.shape for shape in said.unlisted)


def test_of_a_circle_with_a_ratio_beside_it_the_zero_is_told_less_surely() -> None:
    """Half of it, where the other half is a ratio: what is left of an offset there is none."""
    found = searched_with(-0.3 * CIRCLE_RAD, 2.0)
    assert parts_of(found.drive, found.best, found.best.effects) == set()
    assert circle_of(found.drive, found.best) is None
    beside = found.best._replace(effects=(*found.best.effects, "steering_ratio"))
    assert parts_of(found.drive, beside, beside.effects) == {"steering_offset", "steering_ratio"}
    # A circle that gains too little to be said is no ground.
    assert parts_of(found.drive, beside, ["steering_ratio", "gyro_z: k*|delta|"]) == set()
    apart = searched_with(-0.7 * CIRCLE_RAD, 2.0)
    beside = apart.best._replace(effects=(*apart.best.effects, "steering_ratio"))
    assert parts_of(apart.drive, beside, beside.effects) == {"steering_ratio"}


@pytest.mark.parametrize("left_out", [{}, {"steering_offset.offset_rad": 0.004}])
def test_without_a_circle_there_is_none(left_out: dict[str, float]) -> None:
    one = drive(left_out, CITY_V, CITY_STEER)
    found = searched(one, rows_of(one), TOLERANCE)
    assert circle_of(found.drive, found.best) is None
    assert len(answered(found).causes) == len(left_out)
