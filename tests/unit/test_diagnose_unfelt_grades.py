"""diagnose: a grade that no pitch gyro feels: a function of place, told by what is before and behind."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive, found
from test_diagnose_unfelt_banks import all_named_beside, tilted

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting import gains as gains_module
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained, told_from
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.selection.smaller import without_trifles, worth_now
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.motion import G
from dsz_daemon.diagnose.simulation.prediction import ALONG
from dsz_daemon.diagnose.simulation.road import on_road
from dsz_daemon.diagnose.surroundings.profiles import Felt
from dsz_daemon.diagnose.surroundings.unfelt_grades import (
    along_the_way,
    by_place,
    cell_means,
    climbs_unfelt,
    evenly_by,
    goes_by_the_speed,
    rises_and_falls,
    way_of,
)
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.goodness import goodness
from dsz_daemon.diagnose.verdict.level import doubt, level_of, unexplained_of
from dsz_daemon.diagnose.verdict.told_roads import told_road

WAY_M = DT_S * np.cumsum(CITY_V)
# Hills of 250 m and of 170 m.
HILLS = 0.03 * np.sin(2.0 * np.pi * WAY_M / 250.0) + 0.02 * np.sin(2.0 * np.pi * WAY_M / 170.0 + 1.0)
THREE = (0, 1, 5)
INSIDE = slice(200, -200)


@pytest.mark.parametrize(("off", "asked"), [((), 20.0), ((ALONG,), 20.0), ((ALONG, 6), 40.0)])
def test_a_grade_that_no_gyro_feels_is_asked_no_more_than_a_name_where_nothing_else_is_wrong(
    monkeypatch: pytest.MonkeyPatch, off: tuple[int, ...], asked: float
) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    fit = fitted(one, rows_of(one), nothing(), (), TOLERANCE)
    monkeypatch.setattr(gains_module, "far_off", lambda *_: np.isin(np.arange(13), off))
    assert told_from(one, fit, "road_grade") == 40.0
    one.measured[:, THREE] = np.nan
    assert told_from(one, fit, "road_grade") == asked
    assert told_from(one, fit, "road_bank") == 40.0
    assert told_from(one, fit, "wheel_slip") == 20.0


def climbing(
    left_out: dict[str, float], grade: np.ndarray = HILLS, without: tuple[int, ...] = THREE, v: np.ndarray = CITY_V
) -> Drive:
    return tilted(left_out, without, v, grade_rad=grade)


def showing(more_mps2: np.ndarray, without: tuple[int, ...] = THREE) -> Drive:
    """A level drive whose longitudinal accelerometer shows more."""

    def change(one: Drive) -> None:
        one.measured[:, ALONG] += more_mps2
        one.measured[:, without] = np.nan

    return drive({}, CITY_V, CITY_STEER, change=change)


def test_hills_are_named_and_are_as_they_are() -> None:
    search = found(climbing({}))
    assert search.best.effects == ("road_grade",)
    off = on_road(search.best.road, search.best.x).grade_rad - HILLS
    assert np.std(off[INSIDE]) < np.radians(0.15)
    said = answered(search)
    assert said.verdict == "explained"
    assert said.causes[0].statement.endswith("which no gyro feels: told by the accelerometer, as a function of place")
    assert said.causes[0].parameters["rms_rad"].value == pytest.approx(np.std(HILLS), rel=0.1)
    # What is told of unseen blocks is what other places tell of them, not what the accelerometer itself has.
    told = goodness(search)["accel_x"]
    assert told.held_out.after > 1.5 * told.train.after
    assert told.held_out.after < 0.3 * told.held_out.before


@pytest.mark.parametrize(
    "other",
    [
        {"accel_scale.y": -0.05},
        {"gyro_scale.z": 0.05},
        {"wheel_radius.fl": 0.01},
        {"steering_offset.offset_rad": 0.01},
    ],
)
def test_what_else_is_left_out_is_named_beside_it(other: dict[str, float]) -> None:
    all_named_beside(climbing(other), "road_grade", other)


def test_a_hill_that_a_dive_hides_is_told_once_the_dive_is() -> None:
    """Pedals are quick: as long as nothing tells what they do, no smooth road is seen."""
    v = CITY_V + 0.7 * np.sin(2.3 * T)
    way_m = DT_S * np.cumsum(v)
    hills = 0.03 * np.sin(2.0 * np.pi * way_m / 250.0) + 0.02 * np.sin(2.0 * np.pi * way_m / 170.0 + 1.0)
    dives = {"suspension_pitch.pitch_gradient_rad_per_mps2": 0.012}
    search = found(climbing(dives, hills, v=v))
    assert set(search.best.effects) == {"road_grade", "suspension_pitch"}
    assert search.gains["road_grade"] > 40.0
    assert np.std((on_road(search.best.road, search.best.x).grade_rad - hills)[INSIDE]) < np.radians(0.3)
    place = search.best.columns.index(INDEX["suspension_pitch.pitch_gradient_rad_per_mps2"])
    assert search.best.x[search.best.columns[place]] == pytest.approx(0.012, abs=3.0 * search.best.std[place])


@pytest.mark.parametrize(
    "more_mps2",
    [
        0.25 / (1.0 + np.exp(-(T - 30.0))),
        0.25 * (1.0 - np.exp(-T / 20.0)),
        0.1 * np.sign(np.sin(2.1 * T)),
        0.05 * CITY_V**1.5 / 12.0,
        0.3 * CITY_STEER**2 / 0.002,
    ],
    ids=["a step", "warming up", "hysteresis", "of speed", "of steering"],
)
def test_what_the_accelerometer_shows_by_itself_is_no_hill(more_mps2: np.ndarray) -> None:
    said = answered(found(showing(more_mps2)))
    assert "road_grade" not in {cause.effect for cause in said.causes}
    assert said.verdict != "consistent"


@pytest.mark.parametrize(("mid_mps", "wide_mps"), [(12.0, 3.0), (16.0, 4.0), (10.0, 2.5)])
def test_what_shakes_at_a_speed_is_no_road(mid_mps: float, wide_mps: float) -> None:
    """An engine's vibration, rectified: as smooth over the way as a hill is, but always at the same speed."""
    one = showing(0.35 * np.exp(-(((CITY_V - mid_mps) / wide_mps) ** 2)))
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), ("road_grade",), TOLERANCE)
    assert rises_and_falls(way_of(one), fit.road.grade_rad)
    assert is_implausible(one, rows, fit, "road_grade")
    assert "road_grade" not in found(one).best.effects
    hills = climbing({})
    fit = fitted(hills, rows_of(hills), nothing(), ("road_grade",), TOLERANCE)
    assert not is_implausible(hills, rows_of(hills), fit, "road_grade")


def test_a_course_over_the_speed_is_told_on_what_it_has_not_seen() -> None:
    """Twelve rounds between 5 and 15 m/s: a course of the speed is told by the others, one of the time is not."""
    one, rows = (
        drive({}, 10.0 + 5.0 * np.sin(2.0 * np.pi * T / 5.0), CITY_STEER),
        rows_of(drive({}, CITY_V, CITY_STEER)),
    )
    speed = np.mean(one.wheels, axis=1)[rows.at]
    course, rng = np.abs(speed - 9.0) - 2.0, np.random.default_rng(3)
    blocks, used = int(rows.block[-1]) + 1, np.count_nonzero(rows.used[:, ALONG])
    for left, rms, is_speed in (
        (course, 0.2, True),
        (course, 0.01, False),
        (course + rng.normal(0.0, 0.5, len(course)), 0.55, True),
        (course + rng.normal(0.0, 0.5, len(course)), 0.45, False),
        (np.sin(0.3 * rows.at * DT_S), 0.5, False),
    ):
        by_place = np.full(blocks, used * rms**2 / blocks)
        assert goes_by_the_speed(one, rows, left, by_place) is is_speed
        # Whatever an offset adds.
        assert goes_by_the_speed(one, rows, left + 50.0, by_place) is is_speed


def test_what_was_at_a_speed_once_is_not_told_by_it() -> None:
    """The car goes faster all the way: what one block shows at its speed no other block has been at."""
    one = drive({}, 5.0 + 0.35 * T, CITY_STEER)
    rows = rows_of(one)
    blocks = int(rows.block[-1]) + 1
    left = np.where(rows.block % 2 == 0, 1.0, -1.0)
    assert not goes_by_the_speed(one, rows, left, np.full(blocks, np.count_nonzero(rows.used[:, ALONG]) * 0.8 / blocks))


def test_on_a_level_road_nothing_is_said() -> None:
    for seed in (1, 2, 3):
        one = drive({}, CITY_V, CITY_STEER, seed=seed)
        one.measured[:, THREE] = np.nan
        assert answered(found(one)).verdict == "consistent"


def test_with_a_pitch_gyro_the_road_is_that_gyros() -> None:
    assert climbs_unfelt(climbing({}))
    assert climbs_unfelt(climbing({}, without=(1,)))
    assert not climbs_unfelt(climbing({}, without=(0, 5)))
    assert not climbs_unfelt(climbing({}, without=(1, 3)))
    felt = climbing({}, without=())
    rows = rows_of(felt)
    assert fitted(felt, rows, nothing(), ("road_grade",), TOLERANCE).along is None
    alone = climbing({})
    assert fitted(alone, rows_of(alone), nothing(), ("road_grade",), TOLERANCE).along is not None


@pytest.mark.parametrize("evenly", [0.03, -0.02])
def test_a_roll_gyro_tells_how_much_it_climbs_all_the_way(evenly: float) -> None:
    """A car that turns on a climb rolls by r gamma: no leak, and no offset of the accelerometer."""
    search = found(climbing({}, HILLS + evenly, without=(1, 5)))
    assert search.best.effects == ("road_grade",)
    said = answered(search)
    told = told_road(search.drive, search.best, ["road_grade"])[0].grade_rad
    assert np.mean(told) == pytest.approx(np.mean(HILLS) + evenly, abs=2e-3)
    assert np.std((told - HILLS)[INSIDE]) < np.radians(0.15)
    assert abs(said.offsets["offset_accel_x"].value) < 0.03
    rms = said.causes[0].parameters["rms_rad"]
    assert rms.value == pytest.approx(np.sqrt(np.mean((HILLS + evenly) ** 2)), rel=0.03)
    assert rms.std is not None
    assert rms.std < 0.05 * rms.value


def test_without_a_roll_gyro_what_it_climbs_all_the_way_is_an_offset() -> None:
    search = found(climbing({}, HILLS + 0.03))
    said = answered(search)
    told = told_road(search.drive, search.best, ["road_grade"])[0].grade_rad
    assert np.mean(told) == pytest.approx(0.0, abs=1e-4)
    assert said.offsets["offset_accel_x"].value == pytest.approx(G * (np.mean(HILLS) + 0.03), abs=0.05)


@pytest.mark.parametrize(
    ("effects", "without", "is_told"),
    [
        (("road_grade",), (1, 5), True),
        (("road_grade",), (0, 1, 5), False),
        (("road_grade",), (), False),
        (("road_bank",), (1, 5), False),
    ],
)
def test_the_leak_of_a_turn_is_free_where_it_tells_a_climb(
    effects: tuple[str, ...], without: tuple[int, ...], is_told: bool
) -> None:
    one = climbing({}, HILLS, without)
    assert evenly_by(one, effects) == (INDEX["gyro_cross_axis.xz"] if is_told else None)
    assert (INDEX["gyro_cross_axis.xz"] in fitted(one, rows_of(one), nothing(), effects, TOLERANCE).columns) is is_told


def test_other_places_tell_what_is_between() -> None:
    """Of each block of 5 s by all other blocks: hills of 250 m are told, what changes from row to row is not."""
    way = way_of(climbing({}))
    rng = np.random.default_rng(1)
    means = cell_means(way, HILLS)
    off = by_place(way, means).unseen @ means
    assert np.std(off) < 0.2 * np.std(means)
    white = rng.normal(size=len(means))
    off = by_place(way, white).unseen @ white
    assert np.std(off) > 0.9 * np.std(white)
    # By hand: a block's own cells have no say in what is told of it.
    road, told = by_place(way, means), means - by_place(way, means).unseen @ means
    other = means.copy()
    other[way.block == 5] += 7.0
    assert np.allclose((other - road.unseen @ other)[way.block == 5], told[way.block == 5], atol=1e-8)


def test_a_car_that_stands_stays_on_its_slope() -> None:
    stops = CITY_V * np.clip(1.0 - (T - 20.0) / 8.0, 0.0, 1.0) + CITY_V * np.clip((T - 40.0) / 8.0, 0.0, 1.0)
    one = drive({}, stops, CITY_STEER * (T < 20.0))
    way = way_of(one)
    values = along_the_way(way, np.sin(way.cells_m / 40.0))
    standing = (T > 28.5) & (T < 39.5)
    assert np.ptp(values[standing]) == 0.0
    assert np.all(way.cell[standing] == -1)


@pytest.mark.parametrize(
    ("course", "expected"),
    [
        (np.sin(T / 5.0), True),
        (np.sin(T / 5.0) + 0.2 * np.sin(3.0 * T), True),
        (np.sin(T / 19.1), False),
        (1.0 / (1.0 + np.exp(-(T - 30.0))) + 0.05 * np.sin(3.0 * T), False),
        (T, False),
        (-np.exp(-T / 20.0), False),
    ],
)
def test_a_road_rises_and_falls(course: np.ndarray, expected: bool) -> None:
    one = climbing({}, 0.02 * course)
    assert rises_and_falls(way_of(one), 0.02 * course) is expected
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), ("road_grade",), TOLERANCE)
    assert is_implausible(one, rows, fit, "road_grade") is not expected


@pytest.mark.parametrize(("wrong_mps", "asked"), [(0.0, 20.0), (0.5, 40.0)])
def test_a_grade_that_is_not_said_hides_nothing(wrong_mps: float, asked: float) -> None:
    """Beside a wheel that is wrong it has to gain twice as much."""
    one = climbing({}, 0.1 * HILLS)
    one.measured[:, 6] += wrong_mps * np.sin(2.0 * T)
    rows = rows_of(one)
    with_it = fitted(one, rows, nothing(), ("road_grade",), TOLERANCE)
    assert np.std(with_it.left[rows.used[:, ALONG], ALONG]) < np.std(0.1 * G * HILLS)
    for gain, effects in ((asked - 1.0, ()), (asked + 1.0, ("road_grade",))):
        rest = without_trifles(one, rows, with_it, TOLERANCE, {"road_grade": gain}, map)
        assert rest.effects == effects


@pytest.mark.parametrize("left_out", [{"accel_scale.x": 0.15}, {"imu_delay.delay_s": 0.5}])
def test_by_an_imu_as_it_is_the_road_is_as_it_is(left_out: dict[str, float]) -> None:
    one, x = climbing(left_out), nothing()
    for name, value in left_out.items():
        x[INDEX[name]] = value
    assert np.std((Felt(one, x, ("road_grade",))(x).grade_rad - HILLS)[INSIDE]) < np.radians(0.15)


def test_what_is_quick_is_no_part_of_a_road() -> None:
    """0.2 m/s2 would be 1.2 degrees."""
    one = climbing({})
    one.measured[:, ALONG] += 0.2 * np.sign(np.sin(9.0 * T))
    assert np.std((Felt(one, nothing(), ("road_grade",))(nothing()).grade_rad - HILLS)[INSIDE]) < np.radians(0.1)


def test_manoeuvres_are_no_judges_of_what_is_taken_from_the_accelerometer_itself() -> None:
    one = climbing({})
    rows = rows_of(one)
    before = fitted(one, rows, nothing(), (), TOLERANCE)
    there = fitted(one, rows, before.x, ("road_grade",), TOLERANCE)
    assert gained(one, before, there) > 40.0
    assert "manoeuvres" in rows.together
    assert abs(gained(one, before, there, kind="manoeuvres")) < 10.0


def test_what_a_hill_gains_is_what_it_gains_in_the_end_if_that_is_more() -> None:
    one = climbing({})
    rows = rows_of(one)
    there = fitted(one, rows, nothing(), ("road_grade",), TOLERANCE)
    now = worth_now(one, rows, there, TOLERANCE, {"road_grade": 1.0}, (), map)["road_grade"]
    assert now > 40.0
    assert worth_now(one, rows, there, TOLERANCE, {"road_grade": 1e6}, (), map) == {"road_grade": 1e6}
    felt = climbing({}, without=())
    there = fitted(felt, rows_of(felt), nothing(), ("road_grade",), TOLERANCE)
    assert worth_now(felt, rows_of(felt), there, TOLERANCE, {"road_grade": 1.0}, (), map) == {"road_grade": 1.0}


def test_what_another_instrument_leaves_is_no_doubt_of_a_hill() -> None:
    """A yaw gyro with a hysteresis, which nothing explains: of what the car does it makes one doubt, not of this."""
    one = climbing({})
    one.measured[:, 2] += 0.03 * np.sign(np.sin(2.1 * T))
    search = found(one)
    assert "road_grade" in search.best.effects
    unexplained = unexplained_of(search, level_of(search))
    assert "gyro_z" in unexplained
    assert 40.0 < search.gains["road_grade"] < 40.0 * doubt(search, unexplained)
    said = answered(search)
    assert [cause.effect for cause in said.causes] == ["road_grade"]
    assert said.verdict == "partly_explained"


def test_recordings_tell_nothing_of_each_others_roads_and_offsets_are_no_hills() -> None:
    """Four starts, each with another offset and a sensor that warms up."""
    piece = np.repeat([0, 1, 2, 3], N // 4)
    more = np.array([0.1, -0.1, 0.1, -0.1])[piece] + 0.3 * np.exp(-(T % 15.0) / 4.0)
    one = showing(more)
    one = one._replace(recording=one.recording._replace(piece=piece))
    way = way_of(one)
    assert np.array_equal(np.unique(way.piece), [0, 1, 2, 3])
    means = cell_means(way, more)
    assert [abs(float(np.mean(means[way.piece == k]))) < 1e-12 for k in range(4)] == [True] * 4
    assert not rises_and_falls(way, along_the_way(way, means))
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), ("road_grade",), TOLERANCE)
    assert is_implausible(one, rows, fit, "road_grade")
    # Another's readings change nothing of a recording's own road.
    road = by_place(way, means).smooth
    other = means.copy()
    other[way.piece == 1] += 1.0
    assert np.allclose((road @ other)[way.piece == 2], (road @ means)[way.piece == 2], atol=1e-9)


def test_an_accelerometer_that_shows_something_at_rest_alone_feels_no_road() -> None:
    stops = CITY_V * (T < 30.0)
    one = drive({}, stops, CITY_STEER * (T < 30.0))
    one.measured[:, THREE] = np.nan
    assert climbs_unfelt(one)
    one.measured[:3200, ALONG] = np.nan
    assert not climbs_unfelt(one)
    assert answered(found(one)).causes == []
