"""Where nothing is said the verdict is that of the nominal simulation, whatever was fitted on the way."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, T, drive

from dsz_daemon.diagnose.effects.nameless import OUTER_LOAD
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.verdict.answer import answered, with_nothing_said, with_what_has_no_shape


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


def test_of_what_has_no_shape_the_channel_is_said_and_how_much_is_left() -> None:
    """A yaw gyro between two levels, at random: an offset 0.03 rad/s to either side."""
    steps = np.where(np.random.default_rng(4).random(200) < 0.5, -0.03, 0.03)
    level = np.repeat(steps, 75)[: len(T)] if len(T) > 75 else steps[: len(T)]
    level = np.resize(level, len(T))
    one = drive(
        {},
        CITY_V,
        CITY_STEER,
        change=lambda there: there.measured.__setitem__((slice(None), 2), there.measured[:, 2] + level),
    )
    found = searched(one, rows_of(one), TOLERANCE)
    said = answered(found)
    assert (said.verdict, said.causes, said.unlisted) == ("unexplained", [], [])
    told = with_what_has_no_shape(said, found)
    assert [(shape.channel, shape.shape, shape.coefficient.unit) for shape in told.unlisted] == [
        ("gyro_z", "k rms, of no known shape", "rad/s")
    ]
    assert told.unlisted[0].coefficient.value == pytest.approx(0.03, rel=0.1)
    assert 0.0 < told.unlisted[0].coefficient.std < 0.01
    assert told._replace(unlisted=[]) == said
    # What is off by most comes first.
    for value, order in ((7.0, ["gyro_z", "accel_z"]), (1e4, ["accel_z", "gyro_z"])):
        both = with_what_has_no_shape(said._replace(level={**said.level, "accel_z": value}), found)
        assert [shape.channel for shape in both.unlisted] == order
    # Where something is said, or nothing is left, it is no news.
    assert with_what_has_no_shape(told, found) is told
    for other in ("consistent", "partly_explained", "explained"):
        assert with_what_has_no_shape(said._replace(verdict=other), found).unlisted == []
