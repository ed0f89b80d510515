"""diagnose: a number that is another one in each part of a drive is none."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, T, drive, found

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.verdict import answer, steady
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.steady import changes_all_the_way

YAW = 2
# Four parts of the minute: a scale on top of itself that goes up and down again.
UP_AND_DOWN = np.where((T // 15.0) % 2.0 == 0.0, 1.0, -1.0)


def scaled(by: np.ndarray) -> Drive:
    """A yaw gyro that shows so much more of what it shows (n,)."""

    def more(one: Drive) -> None:
        one.measured[:, YAW] *= 1.0 + by

    return drive({}, CITY_V, CITY_STEER, change=more)


@pytest.mark.parametrize(
    ("changes", "is_none"),
    [(np.zeros(len(T)), False), (0.3 * UP_AND_DOWN, False), (0.9 * UP_AND_DOWN, True), (-1.5 * UP_AND_DOWN, True)],
)
@pytest.mark.parametrize("size", [0.05, -0.02])
def test_a_scale_that_changes_by_most_of_itself_is_none(changes: np.ndarray, size: float, is_none: bool) -> None:
    one = scaled(size * (1.0 + changes))
    fit = fitted(one, rows_of(one), nothing(), ("gyro_scale",), TOLERANCE)
    assert fit.x[INDEX["gyro_scale.z"]] == pytest.approx(size, rel=0.3)
    assert changes_all_the_way(one, rows_of(one), fit, "gyro_scale") is is_none


def test_noise_is_no_change_and_a_road_has_no_number() -> None:
    """Of a scale that is next to nothing noise makes another one of each part."""
    one = scaled(np.full(len(T), 3e-4))
    fit = fitted(one, rows_of(one), nothing(), ("gyro_scale", "road_bank"), TOLERANCE)
    assert not changes_all_the_way(one, rows_of(one), fit, "gyro_scale")
    assert not changes_all_the_way(one, rows_of(one), fit, "road_bank")
    # Nor where the knots of its corrections are nothing that stays.
    knots = one.vocabulary.columns_of("road_bank")
    x, std = fit.x.copy(), fit.std.copy()
    x[list(knots)] = 1e-9
    std[[fit.columns.index(i) for i in knots if i in fit.columns]] = 1e-12
    sums = fit.sums._replace(cross=1e4 * np.random.default_rng(1).normal(size=fit.sums.cross.shape))
    assert not changes_all_the_way(one, rows_of(one), fit._replace(x=x, std=std, sums=sums), "road_bank")
    assert changes_all_the_way(one, rows_of(one), fit._replace(sums=sums), "gyro_scale")
    assert not changes_all_the_way(one, rows_of(one), fit, "accel_scale")


def test_what_changes_all_the_way_is_not_said(monkeypatch: pytest.MonkeyPatch) -> None:
    search = found(scaled(np.full(len(T), 0.05)))
    assert [cause.effect for cause in answered(search).causes] == ["gyro_scale"]
    for rule, of_it in (("changes_all_the_way", True), ("curve_of_an_axle", {"gyro_scale"})):
        with monkeypatch.context() as one:
            one.setattr(answer, rule, lambda *_, of_it=of_it: of_it)
            assert answered(search).causes == []
    assert steady.changes_all_the_way(search.drive, search.rows, search.best, "gyro_scale") is False


LATE_S, TOWN_V = 0.08, CITY_V + 3.0 * np.sin(0.11 * T)


def late(by_s: np.ndarray, speed_mps: np.ndarray = TOWN_V) -> Drive:
    """All wheel speeds come so much (n,) late."""
    one = drive({}, speed_mps, CITY_STEER)

    def later(columns: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(T - by_s, T, column) for column in columns.T])

    measured = one.measured.copy()
    measured[:, 6:9] = later(measured[:, 6:9])
    return one._replace(wheels=later(one.wheels), measured=measured)


def test_wheels_that_are_late_by_a_time_are_that_at_each_speed() -> None:
    told = answered(found(late(np.full(len(T), LATE_S))))
    assert [cause.effect for cause in told.causes] == ["wheel_speed_delay"]
    assert told.unlisted == []


def test_wheels_that_are_late_by_a_way_are_late_by_no_time() -> None:
    one = late(LATE_S * 11.0 / TOWN_V)
    fit = fitted(one, rows_of(one), nothing(), ("wheel_speed_delay",), TOLERANCE)
    assert changes_all_the_way(one, rows_of(one), fit, "wheel_speed_delay")
    told = answered(found(one))
    assert told.causes == []
    assert {shape.shape for shape in told.unlisted if shape.channel.startswith("wheel_")} == {"later by k"}
    # Each part of 15 s is like the others: by the speed alone is it another time.
    speed = 12.0 + 5.0 * np.sin(2.0 * np.pi * T / 15.0)
    one = late(LATE_S * 12.0 / speed, speed)
    fit = fitted(one, rows_of(one), nothing(), ("wheel_speed_delay",), TOLERANCE)
    assert changes_all_the_way(one, rows_of(one), fit, "wheel_speed_delay")
    # What lasts as long as the parts of the drive do is no more of a time.
    by_time = late(LATE_S * (1.0 + 0.4 * UP_AND_DOWN))
    fit = fitted(by_time, rows_of(by_time), nothing(), ("wheel_speed_delay",), TOLERANCE)
    assert changes_all_the_way(by_time, rows_of(by_time), fit, "wheel_speed_delay")


@pytest.mark.parametrize(
    ("effect", "channels"),
    [
        ("wheel_speed_delay", ["wheel_speed_fl", "wheel_speed_fr", "wheel_speed_rl", "wheel_speed_rr"]),
        ("imu_delay", ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]),
        ("steering_delay", ["gyro_z"]),
        ("gyro_scale", []),
    ],
)
def test_a_time_that_changes_is_told_without_its_name(effect: str, channels: list[str]) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    fit = fitted(one, rows_of(one), nothing(), (effect,), TOLERANCE)
    told = steady.times_that_change(one, fit, {effect})
    assert [shape.channel for shape in told] == channels
    assert {shape.shape for shape in told} <= {"later by k"}
