"""diagnose: the small angles' series against the library's own functions, and what is shifted in time."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dsz_daemon.diagnose.recordings.recording import filter_kernel
from dsz_daemon.diagnose.simulation.angles import (
    SMALL_RAD,
    all_at_a_side,
    all_drawn,
    at_a_side,
    atan_of,
    cos_of,
    cos_sin_of,
    drawn,
    sin_of,
)
from dsz_daemon.diagnose.simulation.instruments import add_offsets, delayed, felt, rate_of
from dsz_daemon.diagnose.surroundings.winds import _slow_part

# Spacings of double numbers: what two ways to round may differ by, and the first term that the arctangent leaves out,
# x^15/15, which is 4.8 of them at 0.1 rad.
LAST_DIGITS = 6.0


@settings(deadline=None)
@pytest.mark.parametrize(("series", "exact"), [(sin_of, math.sin), (cos_of, math.cos), (atan_of, math.atan)])
@given(
    angle=st.one_of(
        st.floats(-2.0 * SMALL_RAD, 2.0 * SMALL_RAD),
        st.floats(-1e3, 1e3),
        st.sampled_from([0.0, 0.09992239178176826, SMALL_RAD, -SMALL_RAD, math.nextafter(SMALL_RAD, 1.0)]),
    )
)
def test_a_series_is_the_librarys_to_the_last_digits(
    series: Callable[[float], float], exact: Callable[[float], float], angle: float
) -> None:
    expected = exact(angle)
    assert abs(series(angle) - expected) <= LAST_DIGITS * math.ulp(expected)


@pytest.mark.parametrize("series", [sin_of, cos_of, atan_of])
def test_what_is_no_number_stays_none(series: Callable[[float], float]) -> None:
    assert math.isnan(series(math.nan))


@settings(deadline=None)
@given(by_s=st.floats(-0.9, 0.9))
def test_what_comes_late_is_what_was_and_is_level_beyond_the_ends(by_s: float) -> None:
    time_s = 0.1 * np.arange(30)
    ramp = np.column_stack([2.0 * time_s, -time_s])
    found = delayed(ramp, by_s, 0.1)
    then_s = np.clip(time_s - by_s, 0.0, time_s[-1])
    np.testing.assert_allclose(found, np.column_stack([2.0 * then_s, -then_s]), atol=1e-12)


def test_between_two_samples_what_comes_late_is_in_proportion() -> None:
    found = delayed(np.array([[0.0], [1.0], [5.0], [5.0]]), 0.025, 0.1)
    np.testing.assert_allclose(found[:, 0], [0.0, 0.75, 4.0, 5.0])


def test_one_sample_is_the_same_at_any_time() -> None:
    np.testing.assert_array_equal(delayed(np.array([[3.0, 4.0]]), 1.0, 0.1), [[3.0, 4.0]])


def test_offsets_drift_about_the_middle() -> None:
    reads = np.ones((4, 2))
    add_offsets(reads, np.array([0.5, 0.0]), np.array([0.0, 10.0]), 0.0, 0.1)
    np.testing.assert_allclose(reads, np.column_stack([np.full(4, 1.5), [-1.0, 0.0, 1.0, 2.0]]))


def test_on_a_road_the_vertical_reading_has_the_turn_times_the_speed() -> None:
    """a_z = g cos cos - q v + p v_y: a bank that grows by p, a climb by -q, a car that goes ahead and aside."""
    n, dt_s = 200, 0.01
    time_s = dt_s * np.arange(n)
    moved = np.zeros((n, 12))
    moved[:, 0] = 2.0
    none, level = np.zeros(3), np.eye(3)
    arguments = (moved, np.full(n, 20.0), np.zeros(n), 0.01 * time_s, 0.03 * time_s)
    shown = felt(*arguments, none, none, np.stack([level, 0.0 * level, level]), dt_s)
    np.testing.assert_allclose(shown[:, 0], 0.01, atol=1e-12)
    np.testing.assert_allclose(shown[:, 1], -0.03, atol=1e-12)
    upright = 9.80665 * np.cos(0.01 * time_s) * np.cos(0.03 * time_s)
    np.testing.assert_allclose(shown[:, 5], upright + 0.03 * 20.0 + 0.01 * 2.0, rtol=1e-9)
    np.testing.assert_allclose(shown[:, 3], 9.80665 * np.sin(0.03 * time_s), atol=1e-9)


@pytest.mark.parametrize("small_turns", [0.0, 0.5, 1.0])
def test_a_body_drawn_for_small_angles_leans_without_its_vertical(small_turns: float) -> None:
    """a_z = g cos - a_y sin(lean) as axes turn; who draws small angles may have no more than g sin(lean) in a_y."""
    across, lean, dive, along = np.array([3.0, -2.0]), np.array([0.03, -0.02]), np.array([0.01, 0.02]), 1.5
    moved = np.zeros((2, 12))
    moved[:, 3], moved[:, 5], moved[:, 7] = across, lean, dive
    none, level = np.zeros(3), np.eye(3)
    still = (moved, np.full(2, 20.0), np.full(2, along), np.zeros(2), np.zeros(2))
    shown = felt(*still, none, none, np.stack([level, 0.0 * level, level]), 0.01, small_turns)
    pushed = (1.0 - small_turns) * (along * np.sin(dive) - across * np.sin(lean))
    np.testing.assert_allclose(shown[:, 5], 9.80665 * np.cos(lean) * np.cos(dive) + pushed, rtol=1e-12)
    np.testing.assert_allclose(shown[:, 4], across * np.cos(lean) + 9.80665 * np.sin(lean), rtol=1e-12)


@pytest.mark.parametrize("flat_roads", [0.0, 0.5, 1.0])
def test_a_road_drawn_as_a_tilt_alone_lifts_no_car(flat_roads: float) -> None:
    """Climbing more and more by 0.02 rad/s at 20 m/s lifts it by 0.4 m/s2; gravity is as steep either way."""
    grade = np.array([0.0, 2e-4, 4e-4])
    none, level, n = np.zeros(3), np.eye(3), 3
    still = (np.zeros((n, 12)), np.full(n, 20.0), np.zeros(n), np.zeros(n), grade)
    shown = felt(*still, none, none, np.stack([level, 0.0 * level, level]), 0.01, 0.0, flat_roads)
    np.testing.assert_allclose(shown[:, 1], -0.02, atol=1e-12)
    np.testing.assert_allclose(shown[:, 3], 9.80665 * np.sin(grade), atol=1e-12)
    np.testing.assert_allclose(shown[:, 5], 9.80665 * np.cos(grade) + (1.0 - flat_roads) * 0.4, atol=1e-12)


@pytest.mark.parametrize("flat_bends", [0.0, 0.5, 1.0])
def test_on_a_road_whose_tilts_stay_no_gyro_shows_what_the_cars_turn_has_of_them(flat_bends: float) -> None:
    """Turning by 0.3 rad/s, on a bank of 0.05 rad a car pitches by r bank, on a climb of 0.02 it rolls by r climb."""
    moved, n = np.zeros((3, 12)), 3
    moved[:, 1] = 0.3
    none, level = np.zeros(3), np.eye(3)
    still = (moved, np.full(n, 20.0), np.zeros(n), np.full(n, 0.05), np.full(n, 0.02))
    shown = felt(*still, none, none, np.stack([level, 0.0 * level, level]), 0.01, 0.0, 0.0, flat_bends)
    np.testing.assert_allclose(shown[:, 0], (1.0 - flat_bends) * 0.3 * 0.02, atol=1e-12)
    np.testing.assert_allclose(shown[:, 1], (1.0 - flat_bends) * 0.3 * 0.05, atol=1e-12)
    # What pitches lifts the car, too.
    lifted = 9.80665 * np.cos(0.05) * np.cos(0.02) - 20.0 * shown[:, 1]
    np.testing.assert_allclose(shown[:, 5], lifted, atol=1e-12)


@pytest.mark.parametrize("most_rad", [0.5 * SMALL_RAD, 0.99 * SMALL_RAD, 3.0 * SMALL_RAD])
def test_many_angles_at_once_are_each_of_them(most_rad: float) -> None:
    angles = np.linspace(-most_rad, most_rad, 31)
    cos, sin = cos_sin_of(angles)
    np.testing.assert_allclose(cos, np.cos(angles), rtol=1e-15)
    np.testing.assert_allclose(sin, np.sin(angles), rtol=2e-15)
    one_by_one = np.array([drawn(angle, 0.3, 0.2) for angle in angles.tolist()])
    np.testing.assert_allclose(np.array(all_drawn(angles, 0.3, 0.2)).T, one_by_one, rtol=1e-14, atol=1e-17)
    beside = np.array([at_a_side(*pair, 0.4) for pair in zip(cos.tolist(), sin.tolist(), strict=True)])
    np.testing.assert_allclose(np.array(all_at_a_side(cos, sin, 0.4)).T, beside, rtol=1e-14, atol=1e-17)


def test_a_rate_is_central_and_one_sided_at_the_ends() -> None:
    np.testing.assert_allclose(rate_of(np.array([1.0, 3.0, 4.0, 8.0]), 0.5), [4.0, 3.0, 5.0, 8.0], rtol=1e-15)
    np.testing.assert_array_equal(rate_of(np.array([7.0]), 0.5), [0.0])


def test_what_the_body_leans_and_dives_turns_with_the_car() -> None:
    """Of a yaw rate of 0.3 rad/s a body 0.02 rad nose down has -0.006 of roll, leaning by 0.05 0.015 of pitch."""
    moved, n = np.zeros((3, 12)), 3
    moved[:, 1], moved[:, 5], moved[:, 7] = 0.3, 0.05, 0.02
    none, level = np.zeros(3), np.eye(3)
    still = (moved, np.full(n, 20.0), np.zeros(n), np.zeros(n), np.zeros(n))
    shown = felt(*still, none, none, np.stack([level, 0.0 * level, level]), 0.01)
    np.testing.assert_allclose(shown[:, :3], np.tile([-0.006, 0.015, 0.3], (n, 1)), atol=1e-12)


def test_at_a_place_the_imu_feels_what_a_rigid_body_does_there() -> None:
    """a + w' x rho + w x (w x rho) of the rates that the gyros show, then turned by the sensors' own matrices."""
    rng, n = np.random.default_rng(8), 200
    time_s = 0.01 * np.arange(n)
    moved = np.zeros((n, 12))
    for column in (0, 1, 2, 3, 5, 6, 7, 8):
        moved[:, column] = 0.1 * np.sin(rng.uniform(1.0, 4.0) * time_s + rng.uniform(0.0, 6.0))
    moved[:, 2] = np.gradient(moved[:, 1], 0.01)
    road = (0.05 * np.sin(time_s), 0.03 * np.cos(2.0 * time_s))
    car = (moved, np.full(n, 20.0), np.sin(time_s), *road)
    none, own = np.zeros(3), np.stack([np.eye(3), np.zeros((3, 3)), np.eye(3)])
    rho = np.array([0.7, -0.3, 0.4])
    at_the_cg = felt(*car, none, none, own, 0.01)
    rates = at_the_cg[:, :3]
    turns = np.gradient(rates, 0.01, axis=0)
    forces = at_the_cg[:, 3:] + np.cross(turns, rho) + np.cross(rates, np.cross(rates, rho))
    of_rates, of_forces, by_forces = (np.asarray(rng.normal(size=(3, 3))) for _ in range(3))
    shown = felt(*car, rho, none, np.stack([of_rates, by_forces, of_forces]), 0.01)
    np.testing.assert_allclose(shown[:, :3], rates @ of_rates.T + forces @ by_forces.T, atol=1e-12)
    np.testing.assert_allclose(shown[:, 3:], forces @ of_forces.T, atol=1e-12)


def test_the_slow_part_is_a_gaussians_average_of_what_is_reflected_at_its_ends() -> None:
    values = np.random.default_rng(1).normal(size=6000).cumsum()
    weights = filter_kernel(6.0)
    reach = len(weights) // 2
    expected = np.convolve(np.pad(values, reach, mode="symmetric"), weights, mode="valid")
    np.testing.assert_allclose(_slow_part(values), expected, atol=1e-8)


@pytest.mark.parametrize("flat_leans", [0.0, 0.5, 1.0])
def test_a_body_that_stays_as_it_leans_shows_the_gyros_no_turn_of_it(flat_leans: float) -> None:
    """Turning by 0.3 rad/s: leaning by 0.05 rad it pitches by r lean, diving by 0.02 it rolls by -r dive."""
    moved, n = np.zeros((3, 12)), 3
    moved[:, 1], moved[:, 5], moved[:, 7] = 0.3, 0.05, 0.02
    none, level = np.zeros(3), np.eye(3)
    still = (moved, np.full(n, 20.0), np.zeros(n), np.zeros(n), np.zeros(n))
    shown = felt(*still, none, none, np.stack([level, 0.0 * level, level]), 0.01, 0.0, 0.0, 0.0, flat_leans)
    np.testing.assert_allclose(shown[:, 0], -(1.0 - flat_leans) * 0.3 * 0.02, atol=1e-12)
    np.testing.assert_allclose(shown[:, 1], (1.0 - flat_leans) * 0.3 * 0.05, atol=1e-12)
    np.testing.assert_allclose(shown[:, 2], 0.3, atol=1e-12)
