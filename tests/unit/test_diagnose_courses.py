"""A shape is the simplest of a library: what another course beside it would take as well has no name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.effects.vocabulary import vocabulary
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection import search as search_module
from dsz_daemon.diagnose.selection import smaller as smaller_module
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.selection.smaller import without_courses
from dsz_daemon.diagnose.shapes.shape_beside import another_course
from dsz_daemon.diagnose.shapes.unlisted import as_effect, library
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.moving import driven
from dsz_daemon.diagnose.simulation.road import flat

YAW = 2
SHAPE = "gyro_z: k*ay*|ay|"


def yaw_rate_shows(k: float, power: float) -> Drive:
    """k times a power of the lateral acceleration, with its sign."""
    level = drive({}, CITY_V, CITY_STEER)
    side = driven(level, nothing(), flat(len(level.steer))).moved[:, motion.AY]

    def add(one: Drive) -> None:
        one.measured[:, YAW] += k * np.sign(side) * np.abs(side) ** power

    return drive({}, CITY_V, CITY_STEER, change=add)


def test_what_a_power_between_two_leaves_is_no_scale(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of |ay|^2.5 a square and some scale are left over a cube: as much as a square and some cube."""
    one = yaw_rate_shows(0.002, 2.5)
    rows = rows_of(one)
    assert searched(one, rows, TOLERANCE).best.effects == (SHAPE,)
    monkeypatch.setattr(search_module, "without_courses", lambda _, __, best, *___: best)
    assert searched(one, rows, TOLERANCE).best.effects == (SHAPE, "gyro_scale")


def test_a_second_course_gains_what_it_would_gain_as_a_name() -> None:
    """Nobody has chosen it among many: the price of that is not on it."""
    found = searched(yaw_rate_shows(0.002, 2.5), rows_of(yaw_rate_shows(0.002, 2.5)), TOLERANCE)
    drive, rows, best = found.drive, found.rows, found.best
    known = screened(drive, rows, best, TOLERANCE, map).known
    gain = another_course(drive, rows, best, known, TOLERANCE, ["gyro_z"])
    gains = []
    for course in ("ay^3", "vx*ay", "sign(ay)"):
        values = library(driven(drive, best.x, best.road), drive)[course][0]
        effect = as_effect("gyro_z", course, values - np.mean(values), "1", 1e-4)
        more = drive._replace(vocabulary=vocabulary((*drive.vocabulary.own(), effect)))
        fit = fitted(more, rows, np.append(best.x, 1e-5), (*best.effects, effect.name), TOLERANCE)
        gains.append(gained(more, best, fit))
    assert gain > 10.0
    assert gain == pytest.approx(max(gains), abs=2.0)


@pytest.mark.parametrize(
    ("effect", "gain", "of_a_course", "asked", "stays"),
    [
        ("gyro_scale", 30.0, 31.0, True, False),
        ("gyro_scale", 30.0, 29.0, True, True),
        # What gains so much stands by itself, and another instrument's name is not of this shape.
        ("gyro_scale", 101.0, 1000.0, False, True),
        ("accel_scale", 30.0, 31.0, False, True),
        ("imu_delay", 30.0, 31.0, False, True),
    ],
)
def test_a_name_has_to_gain_more_than_a_second_course_of_its_own_instrument(
    monkeypatch: pytest.MonkeyPatch, effect: str, gain: float, of_a_course: float, asked: bool, stays: bool
) -> None:
    one = searched(yaw_rate_shows(0.002, 2.0), rows_of(yaw_rate_shows(0.002, 2.0)), TOLERANCE)
    assert one.best.effects == (SHAPE,)
    best = fitted(one.drive, one.rows, one.best.x, (SHAPE, effect), TOLERANCE)
    given: list[Any] = []

    def course(*args: Any) -> float:
        given.append(args)
        return of_a_course

    monkeypatch.setattr(smaller_module, "another_course", course)
    monkeypatch.setattr(smaller_module, "gained", lambda _, smaller, __: gain if effect not in smaller.effects else 0.0)
    rest = without_courses(one.drive, one.rows, best, TOLERANCE, {SHAPE: 500.0, effect: gain}, map)
    assert rest.effects == ((SHAPE, effect) if stays else (SHAPE,))
    assert bool(given) == asked
    if asked:
        # Held against the model without the name, on the shape's channel alone.
        assert given[0][2].effects == (SHAPE,)
        assert given[0][-1] == ["gyro_z"]
