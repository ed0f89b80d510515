"""diagnose: what a body on springs and slipping wheels do of climbs, banks and air; what no data tell is open."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_cases import TUCSON
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE
from test_diagnose_choices import drive as scattered
from test_diagnose_prediction import RATIO, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings.recording import Recording
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.residuals.evidence import inverse_of_told
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import Profiles, flat, on_road
from dsz_daemon.diagnose.surroundings.profiles import Felt

G = 9.80665
DIVES = "suspension_pitch.pitch_gradient_rad_per_mps2"
LEANS = "suspension_roll.roll_gradient_rad_per_mps2"


def numbers(**changed: float) -> np.ndarray:
    x = nothing()
    for name, value in changed.items():
        x[INDEX[name.replace("__", ".")]] = value
    return x


CLIMB = 0.05
UPHILL = flat(N)._replace(grade_rad=np.full(N, CLIMB))


def test_a_body_on_springs_squats_on_a_climb() -> None:
    """Steady: the tyres push g sin(grade); the nose is up by k times that, besides, and x reads of both."""
    cruising = drive(np.full(N, 20.0))
    row = predicted(cruising, numbers(suspension_pitch__pitch_gradient_rad_per_mps2=0.006), UPHILL)[2900]
    nose_up = 0.006 * G * math.sin(CLIMB)
    assert row[3] == pytest.approx(G * math.sin(CLIMB + nose_up), rel=1e-4)


def test_a_body_on_springs_squats_against_the_air() -> None:
    """Steady at 30 m/s: 3e-4 v^2 = 0.27 m/s2 of push that no acceleration is left of."""
    cruising = drive(np.full(N, 30.0))
    row = predicted(
        cruising,
        numbers(suspension_pitch__pitch_gradient_rad_per_mps2=0.006, suspension_pitch__air_per_m=3e-4),
        flat(N),
    )[2900]
    assert row[3] == pytest.approx(G * math.sin(0.006 * 0.27), rel=1e-4)


def test_driven_wheels_slip_against_what_slows_a_car() -> None:
    """0.12 m/s2 of rolling tyres and 2.6e-4 v^2 of air at 30 m/s: 0.354 m/s2 on the front axle's share of the load."""
    cruising = drive(np.full(N, 30.0))
    row = predicted(cruising, numbers(wheel_slip__slip_per_force=0.05, wheel_slip__resistance=1.0), flat(N))[2900]
    share = TUCSON.cg_to_rear_axle_m / TUCSON.wheelbase_m
    assert row[6] / 30.0 == pytest.approx(1.0 + 0.05 * 0.354 / G / share, rel=1e-6)


def read(x: np.ndarray, road: Profiles) -> Drive:
    """A drive over this road whose IMU reads what a car with these numbers does there."""
    one = drive(np.full(N, 15.0))
    wheels = np.full((N, 4), 15.0)
    return drive_of(Recording(T, np.zeros(N), wheels, predicted(one, x, road)[:, :6], np.ones(10)), TUCSON, RATIO)


ROLLING_HILLS = 0.04 * np.sin(2.0 * np.pi * T / 12.0) * np.minimum(T / 5.0, 1.0)
MIDDLE = slice(300, -300)


@pytest.mark.parametrize(
    ("gradient", "profile", "effects"),
    [
        (DIVES, "grade_rad", ("suspension_pitch", "road_grade")),
        (LEANS, "bank_rad", ("suspension_roll", "road_bank")),
    ],
)
def test_what_a_body_does_on_a_hill_is_no_hill(gradient: str, profile: str, effects: tuple[str, ...]) -> None:
    """Of k = 0.01 a gyro has 10 % more than the road: told without springs, and with these."""
    x = nothing()
    x[INDEX[gradient]] = 0.01
    one = read(x, flat(N)._replace(**{profile: ROLLING_HILLS}))
    for springs, expected in ((x, 1.0), (nothing(), 1.0 + 0.01 * G)):
        told = getattr(Felt(one, springs, effects)(springs), profile)
        slope = np.polyfit(ROLLING_HILLS[MIDDLE], told[MIDDLE], 1)[0]
        assert slope == pytest.approx(expected, abs=0.02)


def test_a_bank_that_the_accelerometer_leans_the_body_to_is_not_taken_off_twice() -> None:
    x = nothing()
    x[INDEX[LEANS]] = 0.01
    road = flat(N)._replace(bank_rad=ROLLING_HILLS)
    one = read(x, road)
    felt = Felt(one, x, ("suspension_roll", "road_bank"))
    # All of the lean is what the tyres do on that road.
    felt._lean_share, felt._tyres_mps2 = 1.0, G * np.sin(ROLLING_HILLS)
    told = felt(x).bank_rad
    assert np.polyfit(ROLLING_HILLS[MIDDLE], told[MIDDLE], 1)[0] == pytest.approx(1.0, abs=0.02)


def test_what_no_data_tell_apart_is_as_open_as_it_was_before() -> None:
    """A level car's az is offset + g (1 + scale): their sum is told, each is within what is plausible."""
    slope = np.array([1.0, G])
    weight = np.array([1.0 / 10.0**2, 1.0])
    for count in (1e3, 1e6, 1e9):
        told, rest = inverse_of_told(count * np.outer(slope, slope), weight)
        whole = told + rest
        assert math.sqrt(whole[1, 1]) == pytest.approx(1.0 / math.sqrt(G**2 / 10.0**2 + 1.0), rel=0.02)
        together = float(slope @ whole @ slope)
        assert together == pytest.approx(1.0 / count, rel=0.2)


@pytest.mark.parametrize("count", [1e2, 1e14])
def test_of_several_that_are_told_together_each_is_as_open_as_the_prior_of_all_allows(count: float) -> None:
    """Sherman and Morrison: (W + N s s')^-1 = U - U s s' U / (1/N + s' U s), U = W^-1."""
    slope, weight = np.array([1.0, 2.0, 0.5, 3.0]), np.array([1.0, 0.04, 9.0, 0.3])
    open_ = np.diag(1.0 / weight)
    expected = open_ - np.outer(open_ @ slope, open_ @ slope) / (1.0 / count + slope @ open_ @ slope)
    told, rest = inverse_of_told(count * np.outer(slope, slope), weight)
    np.testing.assert_allclose(told + rest, expected, rtol=1e-3, atol=1e-6)


def test_what_data_tell_is_as_usual() -> None:
    squares = np.array([[4.0, 1.0], [1.0, 9.0]])
    told, rest = inverse_of_told(squares, np.full(2, 1e-3))
    np.testing.assert_allclose(told, np.linalg.inv(squares + 1e-3 * np.eye(2)), rtol=1e-9)
    np.testing.assert_array_equal(rest, 0.0)


def test_a_scale_that_a_level_car_can_not_tell_has_a_spread_that_says_so() -> None:
    one = scattered({}, CITY_V, CITY_STEER)
    fit = fitted(one, rows_of(one), nothing(), ("accel_scale",), TOLERANCE)
    spread = {name: float(fit.std[fit.columns.index(INDEX[f"accel_scale.{name}"])]) for name in "xyz"}
    assert spread["x"] < 0.01
    assert spread["y"] < 0.01
    assert spread["z"] > 0.3


def test_what_slows_a_car_is_no_climb() -> None:
    """Wheels slip against both; but where it turns on a climb, it rolls (p = r sin(grade)), and there is none of that.

    Taken for a climb, 0.12 m/s2 and the air are 0.7 to 1.5 degrees of it.
    """
    level = scattered({}, CITY_V, CITY_STEER)
    grade_rad = 0.03 * np.sin(0.3 * np.arange(len(CITY_V)) * 0.01)
    x = numbers(wheel_slip__slip_per_force=0.08, wheel_slip__resistance=1.0)
    noise = level.measured - predicted(level, nothing(), flat(len(CITY_V)))
    road = flat(len(CITY_V))._replace(grade_rad=grade_rad)
    one = level._replace(measured=predicted(level, x, road) + noise)
    fit = fitted(one, rows_of(one), nothing(), ("road_grade", "wheel_slip"), TOLERANCE)
    found = on_road(fit.road, fit.x).grade_rad - grade_rad
    assert abs(math.degrees(float(np.mean(found)))) < 0.1
    assert math.degrees(float(np.std(found))) < 0.1
    assert fit.x[INDEX["wheel_slip.slip_per_force"]] == pytest.approx(0.08, rel=0.1)
    assert INDEX["wheel_slip.resistance"] in fit.columns
