"""diagnose: what a shape without a name gains by a linear step is what it gains when it is fitted."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import quiet
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.evidence import Box, sums
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.selection.search import _shaped, searched
from dsz_daemon.diagnose.shapes import shape_beside as beside_room
from dsz_daemon.diagnose.shapes.beside import step_beside
from dsz_daemon.diagnose.shapes.shape_beside import likeliest_shapes, shape_beside
from dsz_daemon.diagnose.shapes.unlisted import Found
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.simulation.road import flat

YAW, ACROSS = 2, 4


def yaw_rate_shows(k: float) -> Drive:
    """k times the magnitude of the lateral acceleration, which is never less than 0."""
    level = drive({}, CITY_V, CITY_STEER)
    course = np.abs(driven(level, nothing(), flat(len(level.steer))).moved[:, motion.AY])

    def add(one: Drive) -> None:
        one.measured[:, YAW] += k * course

    return drive({}, CITY_V, CITY_STEER, change=add)


def shape_and_fit(one: Drive) -> tuple[Found, Found, Fit, Fit]:
    """The likeliest shape by its linear step, what it is by names' measure, and the fits before and after."""
    rows = rows_of(one)
    before = fitted(one, rows, nothing(), (), TOLERANCE)
    known = screened(one, rows, before, TOLERANCE, map).known
    shape = shape_beside(one, rows, before, known, TOLERANCE, quiet(one, before))
    assert shape is not None
    _, after, by_names = _shaped(one, rows, before, shape._replace(gain=np.inf), TOLERANCE, map)
    return shape, by_names, before, after


@pytest.mark.parametrize("k", [0.001, 0.004])
def test_a_shape_that_is_never_negative_gains_as_much_as_when_it_is_fitted(k: float) -> None:
    """What of it is the same all the way is the offset's: left in, the rest would hang together and gain little."""
    one = yaw_rate_shows(k)
    shape, by_names, before, after = shape_and_fit(one)
    assert (shape.channel, shape.shape) == ("gyro_z", "k*|ay|")
    assert shape.gain == pytest.approx(by_names.gain, rel=0.15)
    assert shape.gain > 50.0
    assert shape.value == pytest.approx(k, rel=0.1)
    # All that is left of a course that hangs together is noise.
    assert before.per_row[YAW] > 3.0 * after.per_row[YAW]


def test_it_is_found_before_the_scale_that_comes_near_it() -> None:
    one = yaw_rate_shows(0.004)
    assert searched(one, rows_of(one), TOLERANCE).best.effects == ("gyro_z: k*|ay|",)


def test_what_has_used_up_its_room_has_none_left_on_blocks_that_are_not_seen() -> None:
    """A yaw gyro that is off by 2 mrad/s may go a tenth of the way, once."""
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    off = fit.left.copy()
    off[:, YAW] += np.where(rows.used[:, YAW], 0.002, 0.0)
    fit = fit._replace(left=off)
    slopes = screened(one, rows, fit, TOLERANCE, map).known
    own = np.ascontiguousarray(slopes.values[:, :, [slopes.columns.index(i) for i in fit.columns]])
    room = np.where(np.array(fit.columns) == YAW, 0.0002, 0.0)
    course = np.zeros_like(off)
    course[:, 5] = np.where(rows.used[:, 5], np.sin(0.01 * np.arange(len(off))), 0.0)
    larger = sums(rows, off, np.concatenate([own, course[:, :, np.newaxis]], axis=2), fit.scatter)
    box = Box(-room, room, np.zeros(len(room)))
    step = step_beside(one, rows, fit, own, larger, box, course, np.zeros(13, dtype=np.bool_))
    expected = np.sum((off[rows.used[:, YAW], YAW] - 0.0002) ** 2)
    assert step.unseen[YAW] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("width", [0.0, 0.4])
def test_where_much_is_left_and_no_shape_alone_one_is_looked_for_beside_the_model(
    monkeypatch: pytest.MonkeyPatch, width: float
) -> None:
    """A lateral accelerometer that follows only after 0.4 m/s2; without any nothing is left, and nothing looked for."""

    def sticks(one: Drive) -> None:
        at = one.measured[0, ACROSS]
        for i, value in enumerate(one.measured[:, ACROSS].copy()):
            at = min(max(at, value - width), value + width)
            one.measured[i, ACROSS] = at

    one = drive({}, CITY_V, CITY_STEER, change=sticks)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    known = screened(one, rows, fit, TOLERANCE, map).known
    monkeypatch.setattr(beside_room, "best_shape", lambda *_: None)
    monkeypatch.setattr(beside_room, "steered_shape", lambda *_: None)
    found = likeliest_shapes(one, rows, fit, known, TOLERANCE, beside=False)
    assert [(shape.channel, shape.shape.partition(",")[0]) for shape in found] == (
        [("accel_y", "k*(play(ay")] if width else []
    )
    for shape in found:
        assert shape.value == pytest.approx(1.0, abs=0.2)
