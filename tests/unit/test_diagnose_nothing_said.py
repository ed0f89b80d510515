"""Where nothing is said the verdict is that of the nominal simulation, whatever was fitted on the way."""

from __future__ import annotations

import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.effects.nameless import OUTER_LOAD
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.verdict.answer import answered, with_nothing_said


@pytest.mark.parametrize(
    ("gain", "effects", "verdict"),
    [
        # A yaw gyro 20 % off leaves the yaw rate many times off: whoever says nothing of it has not explained it.
        (0.2, ("gyro_scale",), "unexplained"),
        # As little as noise leaves is none.
        (0.0, (), "consistent"),
        # Nor is how the car is drawn.
        (0.2, (OUTER_LOAD,), "consistent"),
    ],
)
def test_what_is_fitted_and_not_said_explains_nothing(gain: float, effects: tuple[str, ...], verdict: str) -> None:
    one = drive({"gyro_scale.z": gain} if gain else {}, CITY_V, CITY_STEER)
    found = searched(one, rows_of(one), TOLERANCE)
    said = answered(found)._replace(verdict="consistent", causes=[], parameter_errors=[], unlisted=[], located=[])
    found = found._replace(best=found.best._replace(effects=effects))
    told, search = with_nothing_said(said, found)
    assert told.verdict == verdict
    assert search.best is found.nominal
    assert told.fit["gyro_z"].held_out.after == told.fit["gyro_z"].held_out.before
    if verdict == "unexplained":
        assert told.level["gyro_z"] > 3.0 > said.level["gyro_z"]
        assert "gyro_z" in {place.channel for place in told.located}
