"""diagnose: what has no name, and would be given one for what it does elsewhere, or for what its shape leaves."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive, found

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.selection.search import _shaped
from dsz_daemon.diagnose.selection.smaller import asked_of
from dsz_daemon.diagnose.shapes.unlisted import best_shape, is_named, wheel_squares
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.motion import G
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.signals import IMU_CHANNELS

ALONG, ACROSS, YAW = 3, 4, 2
# Of 0.04 sin 0.9 t + 0.02 sin 2.3 t.
STEERED = 0.036 * np.cos(0.9 * T) + 0.046 * np.cos(2.3 * T)


# Sideways so do the first moments of a car that is turned in, and little is told.
@pytest.mark.parametrize(("channel", "off"), [(ALONG, 0.05), (ACROSS, 0.25)])
def test_what_follows_the_steerings_rate_is_no_lever_arm(channel: int, off: float) -> None:
    """A yaw acceleration, which an arm shows, comes near it where the speed hardly changes."""
    name = ("accel_x", "accel_y")[channel - ALONG]

    def add(one: Drive) -> None:
        one.measured[:, channel] += 2.0 * STEERED

    search = found(drive({}, CITY_V, CITY_STEER, change=add))
    assert search.best.effects == (f"{name}: k*delta'",)
    [shape] = answered(search).unlisted
    assert shape.coefficient.value == pytest.approx(2.0, rel=off)
    assert shape.coefficient.unit == "(m/s2)/(rad/s)"


@pytest.mark.parametrize(("channel", "k", "unit"), [(YAW, 0.3, "rad/s"), (ACROSS, -2.5, "m/s2")])
def test_a_supply_that_sags_as_the_steering_works_is_told(channel: int, k: float, unit: str) -> None:
    """The motor of a power steering draws its current to either side."""

    def add(one: Drive) -> None:
        one.measured[:, channel] += k * np.abs(STEERED)

    [shape] = answered(found(drive({}, CITY_V, CITY_STEER, change=add))).unlisted
    assert (shape.channel, shape.shape) == (IMU_CHANNELS[channel], "k*|delta'|")
    assert shape.coefficient.value == pytest.approx(k, rel=0.1)
    assert shape.coefficient.unit == f"({unit})/(rad/s)"


def test_an_arm_stays_one() -> None:
    search = found(drive({"imu_lever_arm.x_m": 0.4, "imu_lever_arm.y_m": -0.3}, CITY_V, CITY_STEER))
    assert search.best.effects == ("imu_lever_arm",)


COURSE = predicted(drive({}, CITY_V, CITY_STEER), nothing(), flat(N))
TURNS, SIDE = COURSE[:, YAW], COURSE[:, ACROSS]


@pytest.mark.parametrize(
    ("channel", "shape", "course", "k"),
    [
        ("gyro_x", "delta", CITY_STEER, 0.2),
        ("gyro_y", "delta", CITY_STEER, -0.2),
        ("accel_x", "delta", CITY_STEER, 2.0),
        ("gyro_z", "vx*ay", CITY_V * SIDE, 2e-4),
        ("gyro_z", "vx*r", CITY_V * TURNS, 4e-3),
        ("gyro_z", "r*|r|", TURNS * np.abs(TURNS), 0.2),
        ("gyro_z", "r^3", TURNS**3, 0.4),
        ("accel_y", "r*|r|", TURNS * np.abs(TURNS), -3.0),
        ("accel_y", "ay*|ay|", SIDE * np.abs(SIDE), 0.01),
    ],
)
def test_what_a_sensor_shows_of_products_of_motion_gets_no_name(
    channel: str, shape: str, course: np.ndarray, k: float
) -> None:
    """A roll gyro that followed the steering was called a leak of the yaw rate; k v a_y, a gyro that forces move."""

    def add(one: Drive) -> None:
        one.measured[:, IMU_CHANNELS.index(channel)] += k * course

    said = answered(found(drive({}, CITY_V, CITY_STEER, change=add)))
    assert said.causes == []
    [there] = said.unlisted
    assert (there.channel, there.shape) == (channel, f"k*{shape}")
    assert there.coefficient.value == pytest.approx(k, rel=0.1)


def test_forces_that_move_a_gyro_are_no_scale_that_grows_with_the_speed() -> None:
    """v r is a_y but for v_y': of a gyro that forces move it is a little less than that."""
    assert found(drive({"gyro_g_sensitivity.zy": 4e-3}, CITY_V, CITY_STEER)).best.effects == ("gyro_g_sensitivity",)
    assert [channel for channel in IMU_CHANNELS if not is_named("vx*r", channel)] == ["gyro_z"]


@pytest.mark.parametrize("channel", ["gyro_z", "accel_y"])
def test_what_follows_the_steering_as_the_car_does_is_the_ratios(channel: str) -> None:
    assert is_named("delta", channel)
    assert not is_named("delta'", channel)
    one = drive({}, CITY_V, CITY_STEER)
    one.measured[:, IMU_CHANNELS.index(channel)] += 2.0 * CITY_STEER
    rows = rows_of(one)
    shape = best_shape(one, rows, fitted(one, rows, nothing(), (), {}))
    assert shape is None or shape.shape != "k*delta"


def magnets(*wheels: int) -> Drive:
    """Rear wheels as read, and what is compared: front ones and the rear ones' difference; k of v^2 of the car."""

    def change(one: Drive) -> None:
        for wheel in wheels:
            more = 1e-3 * CITY_V**2
            one.wheels[:, wheel] += more
            if wheel == 2:
                one.measured[:, 8] -= more
            else:
                one.measured[:, 6 + wheel] += more

    return drive({}, CITY_V, CITY_STEER, change=change)


def test_of_a_wheel_that_shows_its_square_the_others_are_told_nothing() -> None:
    """What all four did alike would be another speed, of which the accelerometers show too little."""
    search = found(magnets(2))
    assert search.best.effects == ("wheel_square",)
    columns = search.drive.vocabulary.columns_of("wheel_square")
    assert [search.best.x[i] for i in columns if i not in search.best.columns] == [0.0, 0.0, 0.0]
    assert list(wheel_squares(search.drive, search.best)) == ["rl"]
    assert wheel_squares(search.drive, search.nominal) == {}
    [shape] = answered(search).unlisted
    assert shape.coefficient.value == pytest.approx(1e-3, rel=0.05)


def test_two_that_do_are_both_told() -> None:
    search = found(magnets(0, 2))
    told = wheel_squares(search.drive, search.best)
    assert list(told) == ["fl", "rl"]
    for value, std in told.values():
        assert abs(value - 1e-3) < 3.0 * std


def test_beside_a_shape_more_is_asked_of_what_the_same_instruments_show() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    gains = {"gyro_x: k*ax*ay": 700.0, "gyro_cross_axis": 50.0}
    for gyros in ("gyro_cross_axis", "gyro_scale", "gyro_g_sensitivity"):
        assert asked_of(one, gyros, gains) == pytest.approx(70.0)
    for other in ("accel_scale", "imu_misalignment", "steering_ratio", "accel_y: k*ay^3", "gyro_z: k*vx"):
        assert asked_of(one, other, gains) == pytest.approx(0.015 * 750.0)


def test_a_shape_is_drawn_more_coarsely_than_all_else_in_its_own_channel() -> None:
    across = predicted(drive({}, CITY_V, CITY_STEER), nothing(), flat(N))[:, ACROSS]

    def trailer(one: Drive) -> None:
        one.measured[:, YAW] += 1e-4 * across**3

    one = drive({"accel_scale.y": 0.05}, CITY_V, CITY_STEER, change=trailer)
    rows = rows_of(one)
    before = fitted(one, rows, nothing(), ("accel_scale",), TOLERANCE)
    shape = best_shape(one, rows, before)
    assert shape is not None
    there, fit, _ = _shaped(one, rows, before, shape, TOLERANCE, map)
    without = fit.x.copy()
    without[[i for effect in fit.effects for i in there.vocabulary.columns_of(effect)]] = 0.0
    change = (predicted(there, fit.x, fit.road) - predicted(there, without, flat(N)))[rows.at]
    for channel, share in ((YAW, 0.1), (ACROSS, 0.03)):
        size = float(np.std(change[rows.used[:, channel], channel]))
        assert fit.form[channel] == pytest.approx(np.hypot(rows.form[channel], share * size))


@pytest.mark.parametrize("is_felt", [True, False])
def test_a_push_that_only_the_accelerometer_shows_is_no_wind_where_nothing_feels_a_bank(is_felt: bool) -> None:
    """A tilt that is slower than a car that yields to it."""
    tilt = 0.02 * np.sin(0.25 * T)

    def change(one: Drive) -> None:
        one.measured[:, ACROSS] += G * tilt
        if not is_felt:
            one.measured[:, 0] = np.nan

    one = drive({}, CITY_V, CITY_STEER, change=change)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    push = fit._replace(effects=("side_wind",), road=fit.road._replace(side_n=700.0 * np.sin(T)))
    assert is_implausible(one, rows, push, "side_wind") is not is_felt
    told = push._replace(unseen=np.zeros_like(push.unseen))
    assert not is_implausible(one, rows, told, "side_wind")


@pytest.mark.parametrize(("channel", "road"), [(ALONG, "road_grade"), (ACROSS, "road_bank")])
def test_what_an_accelerometer_shows_by_itself_is_no_road(channel: int, road: str) -> None:
    """Its offset jumps while the car stands: a road's corrections follow, of which its gyro feels nothing."""

    def change(one: Drive) -> None:
        one.measured[:, channel] += 0.2 / (1.0 + np.exp(-4.0 * (T - 38.0)))

    one = drive({}, CITY_V * np.clip(1.0 - (T - 20.0) / 8.0, 0.0, 1.0), CITY_STEER * (T < 20.0), change=change)
    rows = rows_of(one)
    before = fitted(one, rows, nothing(), (), TOLERANCE)
    tilted = fitted(one, rows, before.x, (road,), TOLERANCE)
    # It would gain much, of blocks that it has not seen, too.
    assert np.std(tilted.left[rows.used[:, channel], channel]) < 0.5 * np.std(
        before.left[rows.used[:, channel], channel]
    )
    assert is_implausible(one, rows, tilted, road)
    assert road not in found(one).best.effects


def test_a_hill_is_one_that_its_gyro_feels() -> None:
    hill_rad = 0.03 * np.sin(0.2 * T)

    def change(one: Drive) -> None:
        one.measured[:, 1] -= 0.03 * 0.2 * np.cos(0.2 * T)
        one.measured[:, ALONG] += G * hill_rad
        one.measured[:, 5] += 0.03 * 0.2 * np.cos(0.2 * T) * CITY_V

    one = drive({}, CITY_V, CITY_STEER, change=change)
    rows = rows_of(one)
    hill = fitted(one, rows, nothing(), ("road_grade",), TOLERANCE)
    assert not is_implausible(one, rows, hill, "road_grade")
    assert found(one).best.effects == ("road_grade",)
