"""diagnose: a bank that no roll gyro feels: by what the lateral accelerometer shows beyond the turn."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive, found

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained, puts_right
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.selection.smaller import without_trifles
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.motion import G
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat, on_road
from dsz_daemon.diagnose.surroundings.profiles import Felt
from dsz_daemon.diagnose.surroundings.unfelt_banks import is_unfelt
from dsz_daemon.diagnose.verdict.answer import answered

# Of a road that is driven at 12 m/s: waves of 130 m and of 250 m.
BANK = 0.02 * np.sin(2.0 * np.pi * T / 11.0) + 0.025 * np.sin(2.0 * np.pi * T / 21.0 + 1.0)
ROLLING = slice(200, -200)
THREE = (0, 1, 5)


def tilted(
    left_out: dict[str, float], without: tuple[int, ...] = THREE, v: np.ndarray = CITY_V, **profiles: np.ndarray
) -> Drive:
    """A noisy drive on a road of these profiles, by the kernel itself, without these channels."""
    level = drive({}, v, CITY_STEER)
    x = nothing()
    for name, value in left_out.items():
        x[INDEX[name]] = value
    noise = level.measured[:, :9] - predicted(level, nothing(), flat(N))[:, :9]
    measured = level.measured.copy()
    measured[:, :9] = predicted(level, x, flat(N)._replace(**profiles))[:, :9] + noise
    measured[:, without] = np.nan
    return level._replace(measured=measured)


def banked(left_out: dict[str, float], bank: np.ndarray = BANK, without: tuple[int, ...] = THREE) -> Drive:
    return tilted(left_out, without, bank_rad=bank)


def all_named_beside(one: Drive, road: str, other: dict[str, float]) -> None:
    """The road and the effect that these are of are named, each number within three of its spreads."""
    search = found(one)
    [name] = {key.partition(".")[0] for key in other}
    assert sorted(search.best.effects) == sorted((road, name))
    for key, value in other.items():
        place = search.best.columns.index(INDEX[key])
        assert abs(search.best.x[INDEX[key]] - value) < 3.0 * search.best.std[place]


def bank_of(search: Search) -> np.ndarray:
    return on_road(search.best.road, search.best.x).bank_rad


@pytest.mark.parametrize(
    "left_out",
    [
        {},
        {"gyro_scale.z": 0.05},
        {"accel_scale.y": -0.04},
        {"imu_delay.delay_s": 0.3},
        {"imu_lever_arm.x_m": 0.5},
        {"suspension_roll.roll_gradient_rad_per_mps2": 0.01},
        {"offset_gyro_z": 0.01},
        {"wheel_radius.rl": 0.01, "wheel_radius.rr": 0.01},
    ],
)
def test_by_instruments_and_a_car_as_they_are_the_bank_is_as_it_is(left_out: dict[str, float]) -> None:
    one, x = banked(left_out), nothing()
    for name, value in left_out.items():
        x[INDEX[name]] = value
    found = Felt(one, x, ("road_bank",))(x).bank_rad
    assert np.std((found - BANK)[ROLLING]) < np.radians(0.1)
    # And for parameters that are not the recording's, another one.
    assert not left_out or np.std((Felt(one, nothing(), ("road_bank",))(nothing()).bank_rad - found)[ROLLING]) > 2e-4


@pytest.mark.parametrize(("scale", "channel"), [("gyro_scale.z", 2), ("accel_scale.y", 4)])
def test_instruments_that_show_more_tell_the_same_bank_to_the_last_digit(scale: str, channel: int) -> None:
    one, x = banked({}), nothing()
    more = one.measured.copy()
    more[:, channel] *= 1.2
    scaled = x.copy()
    scaled[INDEX[scale]] = 0.2
    same = Felt(one._replace(measured=more), scaled, ("road_bank",))(scaled).bank_rad
    assert np.allclose(same, Felt(one, x, ("road_bank",))(x).bank_rad, atol=1e-9)


def test_a_bank_is_named_by_how_the_car_yaws_on_it() -> None:
    search = found(banked({}))
    assert search.best.effects == ("road_bank",)
    off = bank_of(search) - BANK
    assert np.std(off[ROLLING]) < np.radians(0.15)
    said = answered(search)
    assert said.verdict == "explained"
    assert said.causes[0].statement.endswith("which no gyro feels: told by how the car yaws on it")
    felt = answered(found(banked({}, without=()))).causes[0]
    assert felt.effect == "road_bank"
    assert "gyro" not in felt.statement
    assert said.causes[0].parameters["rms_rad"].value == pytest.approx(np.std(BANK), rel=0.1)


@pytest.mark.parametrize(
    "other", [{"gyro_scale.z": 0.05}, {"imu_delay.delay_s": 0.05}, {"steering_offset.offset_rad": 0.01}]
)
def test_what_else_is_left_out_is_named_beside_it(other: dict[str, float]) -> None:
    all_named_beside(banked(other), "road_bank", other)


def test_a_lean_beside_it_is_that_of_a_body_that_sways() -> None:
    """The IMU swings to the side above the roll axis: as an accelerometer has it, a tenth more lean."""
    leans = {"suspension_roll.roll_gradient_rad_per_mps2": 0.01, "suspension_roll.above_m": 0.4}
    one = banked(leans)
    fit = fitted(one, rows_of(one), nothing(), ("road_bank", "suspension_roll"), TOLERANCE)
    place = fit.columns.index(INDEX["suspension_roll.roll_gradient_rad_per_mps2"])
    assert fit.x[fit.columns[place]] == pytest.approx(0.01, abs=3.0 * fit.std[place])
    assert fit.std[place] < 0.002


@pytest.mark.parametrize("wave", [0.02 * np.sin(0.5 * T), 0.03 / (1.0 + np.exp(-(T - 30.0)))])
def test_what_the_accelerometer_shows_by_itself_is_no_bank(wave: np.ndarray) -> None:
    """A car would have to yaw on it."""

    def change(one: Drive) -> None:
        one.measured[:, 4] += G * wave
        one.measured[:, THREE] = np.nan

    one = drive({}, CITY_V, CITY_STEER, change=change)
    assert "road_bank" not in {cause.effect for cause in answered(found(one)).causes}
    rows = rows_of(one)
    before = fitted(one, rows, nothing(), (), TOLERANCE)
    there = fitted(one, rows, before.x, ("road_bank",), TOLERANCE)
    assert is_implausible(one, rows, there, "road_bank")
    # The accelerometer itself, whose all is taken, is no judge.
    assert gained(one, before, there) < 0.0
    assert not puts_right(one, before, there)
    true = banked({})
    rows = rows_of(true)
    before = fitted(true, rows, nothing(), (), TOLERANCE)
    assert not is_implausible(true, rows, fitted(true, rows, before.x, ("road_bank",), TOLERANCE), "road_bank")


def test_on_a_level_road_nothing_is_said() -> None:
    for seed in (1, 2, 3):
        one = drive({}, CITY_V, CITY_STEER, seed=seed)
        one.measured[:, THREE] = np.nan
        assert answered(found(one)).verdict == "consistent"


def test_a_bank_that_is_not_said_hides_nothing() -> None:
    """It takes all that the accelerometer has left over; where the car's yaw tells too little of it, that is left."""
    one = banked({}, 0.05 * BANK)
    rows = rows_of(one)
    with_it = fitted(one, rows, nothing(), ("road_bank",), TOLERANCE)
    for gain, effects in ((39.0, ()), (41.0, ("road_bank",))):
        rest = without_trifles(one, rows, with_it, TOLERANCE, {"road_bank": gain}, map)
        assert rest.effects == effects
    felt = banked({}, 0.05 * BANK, ())
    rows = rows_of(felt)
    with_it = fitted(felt, rows, nothing(), ("road_bank",), TOLERANCE)
    assert without_trifles(felt, rows, with_it, TOLERANCE, {"road_bank": 39.0}, map).effects == ("road_bank",)


@pytest.mark.parametrize(
    ("without", "roads"),
    [
        ((), ""),
        ((0,), ""),
        ((1,), ""),
        (THREE, ""),
        ((1, 3), "road_grade"),
        ((0, 1, 2), "road_bank"),
        ((0, 4), "road_bank"),
    ],
)
def test_roads_that_only_their_accelerometer_shows_are_not_tested(without: tuple[int, ...], roads: str) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    one.measured[:, without] = np.nan
    told = {one["effect"] for one in answered(found(one)).could_not_test}
    assert told & {"road_grade", "road_bank"} == set(roads.split())


@pytest.mark.parametrize(
    ("without", "expected"),
    [((), False), ((0,), True), (THREE, True), ((0, 2), False), ((0, 4), False), ((1, 5), False)],
)
def test_which_instruments_it_takes(without: tuple[int, ...], expected: bool) -> None:
    assert is_unfelt(banked({}, without=without)) is expected
