"""A car that turns otherwise than its steering says, by what has no name, is no sensor's and nobody else's fault."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, drive

from dsz_daemon.diagnose.effects.row import Effect
from dsz_daemon.diagnose.effects.shape_names import MOMENT, REAR, STEERING, TYRES, is_of_the_car, with_shapes
from dsz_daemon.diagnose.effects.vocabulary import INDEX, vocabulary
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import rows_of, sensitivities
from dsz_daemon.diagnose.selection import search as search_module
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.selection.smaller import asked_of
from dsz_daemon.diagnose.shapes import steered as steered_module
from dsz_daemon.diagnose.shapes.beside import taken_beside
from dsz_daemon.diagnose.shapes.car_courses import Course, as_effect_of_the_car, courses_of
from dsz_daemon.diagnose.shapes.steered import steered_shape
from dsz_daemon.diagnose.shapes.unlisted import as_effect, unlisted
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.car import car_of
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.moving import Moving, driven, of_roll
from dsz_daemon.diagnose.simulation.own_courses import pushed_by
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.manoeuvres import next_manoeuvre

RATIO = 16.0
STEERS, LEANS = "steering: k*vx^2", "gyro_z: k*vx^2"


def as_steering(name: str, values: np.ndarray, unit: str) -> Effect:
    """A course of the front wheels, which asks nothing of the car."""
    level = drive({}, CITY_V, CITY_STEER)
    return surely(as_effect_of_the_car(Course(STEERING, name, values, unit), moves(level), car_of(level, nothing())))


def surely(effect: Effect | None) -> Effect:
    assert effect is not None
    return effect


def moves(level: Drive) -> Moving:
    return driven(level, nothing(), flat(N))


def values_of_courses(moving: Moving, hand_rad: np.ndarray, steer_rad: np.ndarray) -> dict[tuple[str, str], np.ndarray]:
    return {(one.place, one.name): one.values for one in courses_of(moving, hand_rad, steer_rad)}


def turned(course: str, k: float, steer: np.ndarray = CITY_STEER) -> Drive:
    """A car whose front wheels turn by k times the course more than is recorded."""
    values = values_of_courses(moves(drive({}, CITY_V, steer)), steer * RATIO, steer)[STEERING, course]
    return drive({}, CITY_V, steer + k * values)._replace(steer=steer)


def pushed(place: str, course: str, k: float, v: np.ndarray = CITY_V) -> Drive:
    """A car that does k times the course more, of its own motion without it, and noise."""
    level = drive({}, v, CITY_STEER)
    courses = {(one.place, one.name): one for one in courses_of(moves(level), CITY_STEER * RATIO, CITY_STEER)}
    effect = surely(as_effect_of_the_car(courses[place, course], moves(level), car_of(level, nothing())))
    more = level._replace(vocabulary=vocabulary((effect,)))
    change = predicted(more, np.append(nothing(), k), flat(N)) - predicted(level, nothing(), flat(N))
    return level._replace(measured=level.measured + change)


def slowly(values: np.ndarray) -> np.ndarray:
    """0.2 s y' = x - y by steps of its own, a hundredth of the drive's each."""
    fine = np.interp(np.arange(100 * len(values)) / 100.0, np.arange(len(values)), values)
    found, y = np.empty(len(fine)), values[0]
    for i, x in enumerate(fine):
        found[i] = y
        y += 1e-4 / 0.2 * (x - y)
    return found[::100]


@pytest.mark.parametrize(
    ("course", "k", "unit", "near"),
    [
        ("vx^2", 2e-5, "rad/(m2/s2) of the front wheels", 0.05),
        # By the motion of the car as it is simulated without, which is another then.
        ("ay*|ay|", -4e-4, "rad/(m2/s4) of the front wheels", 0.25),
        ("vx*vy", -2e-3, "rad/(m2/s2) of the front wheels", 0.25),
        ("(1-cos(hand))", 0.01, "rad of the front wheels", 0.05),
    ],
)
def test_what_steers_without_a_name_is_told_by_what_it_follows(course: str, k: float, unit: str, near: float) -> None:
    one = turned(course, k)
    found = searched(one, rows_of(one), TOLERANCE)
    assert found.best.effects == (f"steering: k*{course}",)
    [shape] = unlisted(found.drive, found.rows, found.best, found.shapes)
    assert (shape.channel, shape.shape, shape.coefficient.unit) == ("gyro_z", f"k*{course}", unit)
    assert shape.coefficient.value == pytest.approx(k, rel=near)


def test_a_hand_wheel_that_turns_far_tells_a_sensor_off_its_centre_from_a_ratio() -> None:
    one = turned("sin(hand)", 0.006, 2.5 * CITY_STEER)
    found = searched(one, rows_of(one), TOLERANCE)
    assert found.best.effects == ("steering: k*sin(hand)",)
    there = {name for _, name in values_of_courses(moves(one), CITY_STEER * RATIO, CITY_STEER)}
    assert not {"sin(hand)", "sin(2*hand)"} & there


@pytest.mark.parametrize(
    ("planted", "effect"),
    [
        ({"steering_ratio.scale": 0.05}, "steering_ratio"),
        ({"steering_ratio.per_rad": 0.06}, "steering_ratio"),
        ({"steering_offset.offset_rad": 0.003}, "steering_offset"),
        ({"steering_compliance.rad_per_n": 2e-6}, "steering_compliance"),
        ({"tyre_saturation.inverse_square": 4.0}, "tyre_saturation"),
        ({"gyro_scale.z": 0.03}, "gyro_scale"),
    ],
)
def test_what_has_a_name_keeps_it(planted: dict[str, float], effect: str) -> None:
    one = drive(planted, CITY_V, CITY_STEER)
    assert searched(one, rows_of(one), TOLERANCE).best.effects[0] == effect


def test_one_that_had_to_go_may_come_back() -> None:
    one = turned("vx^2", 2e-5)
    one = one._replace(vocabulary=vocabulary((as_steering("vx^2", CITY_V**2, "m2/s2"),)))
    assert searched(one, rows_of(one), TOLERANCE).best.effects == (STEERS,)


def test_a_manoeuvre_to_drive_next_knows_no_course_of_this_drive() -> None:
    one = turned("vx^2", 2e-5)
    there = one._replace(vocabulary=vocabulary((as_steering("vx^2", CITY_V**2, "m2/s2"),)))
    x = np.append(nothing(), 2e-5)
    x[INDEX["mass_loading.added_mass_kg"]] = 300.0
    words = next_manoeuvre(there, x, "mass_loading", ["steering_compliance"])
    assert words == next_manoeuvre(one, x[:-1], "mass_loading", ["steering_compliance"])


def test_one_that_is_in_the_model_is_not_offered_again() -> None:
    one = turned("vx^2", 2e-5)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    known = screened(one, rows, fit, TOLERANCE, map).known
    found = [steered_shape(one, rows, fit._replace(effects=there), known, TOLERANCE) for there in ((), (STEERS,))]
    assert [shape is not None and shape.effect.name == STEERS for shape in found] == [True, False]


def test_a_course_is_measured_by_how_far_it_turns_the_wheels() -> None:
    """It is tried with 2 mrad rms, and is no more than half a radian."""
    values = np.array([-3.0, 4.0, 0.0, 0.0])
    [k] = as_steering("c", values, "").parameters
    assert (k.step * 2.5, k.low * 2.5, k.high * 2.5) == pytest.approx((0.002, -0.5, 0.5))


def test_two_of_one_drive_turn_the_wheels_by_their_sum() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    own = (as_steering("a", CITY_V, ""), as_steering("b", CITY_V**2, ""))
    both = one._replace(vocabulary=vocabulary(own))
    found = predicted(both, np.append(nothing(), [1e-4, -2e-5]), flat(N))
    other = predicted(one._replace(steer=CITY_STEER + 1e-4 * CITY_V - 2e-5 * CITY_V**2), nothing(), flat(N))
    np.testing.assert_allclose(found, other, atol=1e-12)


def test_what_a_course_takes_is_what_least_squares_with_it_leave_less() -> None:
    rng = np.random.default_rng(4)
    slopes, course = rng.normal(size=(80, 5)), rng.normal(size=80)
    course += slopes @ rng.normal(size=5)
    left = slopes @ rng.normal(size=5) + 0.7 * course + rng.normal(size=80)
    both = np.column_stack([slopes, course])
    rest = [float(np.linalg.lstsq(table, left, rcond=None)[1][0]) for table in (slopes, both)]
    bread = np.linalg.inv(slopes.T @ slopes)
    sums = slopes.T @ left, slopes.T @ course, float(course @ course), float(course @ left)
    assert taken_beside(bread, *sums) == pytest.approx(rest[0] - rest[1])
    # Of one that the model can do itself nothing is taken.
    hidden = slopes @ np.ones(5)
    assert taken_beside(bread, slopes.T @ left, slopes.T @ hidden, float(hidden @ hidden), float(hidden @ left)) == 0.0


def test_where_nothing_is_left_nothing_is_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    known = screened(one, rows, fit, TOLERANCE, map).known
    assert steered_shape(one, rows, fit, known, TOLERANCE) is not None
    silent = np.ones(13, dtype=np.bool_)
    monkeypatch.setattr(steered_module, "quiet", lambda *_: silent)
    assert steered_shape(one, rows, fit, known, TOLERANCE) is None
    # Where one of the two is left, it is.
    silent[4] = False
    assert steered_shape(one, rows, fit, known, TOLERANCE) is not None


def test_where_neither_yaw_rate_nor_lateral_acceleration_is_there_nothing_steers() -> None:
    def without(one: Drive) -> None:
        one.measured[:, [2, 4]] = np.nan

    one = drive({}, CITY_V, CITY_STEER, change=without)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    known = screened(one, rows, fit, TOLERANCE, map).known
    assert steered_shape(one, rows, fit, known, TOLERANCE) is None


def test_its_slope_is_that_of_the_car_it_steers() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    course = 0.001 * np.abs(CITY_V)
    more = one._replace(vocabulary=vocabulary((as_steering("c", course, ""),)))
    rows, x = rows_of(more), np.append(nothing(), 0.0)
    base = predicted(more, x, flat(N))
    slope = sensitivities(more, rows, x, flat(N), base, [len(x) - 1])[:, :, 0]
    step = more.vocabulary.columns[-1][1].step
    there = predicted(one._replace(steer=CITY_STEER + step * course), nothing(), flat(N))
    expected = np.where(rows.used, ((there - base) / step)[rows.at], 0.0)
    np.testing.assert_allclose(slope, expected, rtol=1e-9, atol=1e-9)
    assert np.abs(slope[:, 2]).max() > 0.0
    # And a road is felt anew for it.
    other = x.copy()
    other[-1] = 0.1
    assert of_roll(other).tobytes() != of_roll(x).tobytes()


def test_the_equation_is_that_of_its_words() -> None:
    moving = moves(drive({}, CITY_V, CITY_STEER))
    v, side, r = moving.v_mps, moving.moved[:, motion.AY], moving.moved[:, motion.R]
    found = values_of_courses(moving, 2.0 * np.ones(N), CITY_STEER)
    minutes = np.arange(N) / 6000.0
    expected = {
        (STEERING, "vx^2"): v**2,
        (STEERING, "vx*delta"): v * CITY_STEER,
        (STEERING, "vx*vy"): v * moving.moved[:, motion.VY],
        (STEERING, "ay*|ay|"): np.sign(side) * side**2,
        (STEERING, "(1-cos(hand))"): np.full(N, 1.0 - np.cos(2.0)),
        (STEERING, "(1-cos(2*hand))"): np.full(N, 1.0 - np.cos(4.0)),
        (STEERING, "sin(hand)"): np.full(N, np.sin(2.0)),
        (STEERING, "sin(2*hand)"): np.full(N, np.sin(4.0)),
        (REAR, "delta"): CITY_STEER,
        (REAR, "vx*delta"): v * CITY_STEER,
        (REAR, "delta, slowly"): slowly(CITY_STEER),
        (REAR, "tanh((vx-12)/3)*delta"): np.tanh((v - 12.0) / 3.0) * CITY_STEER,
        (REAR, "tanh((vx-15)/7)*delta"): np.tanh((v - 15.0) / 7.0) * CITY_STEER,
        (REAR, "tanh((vx-20)/4)*delta"): np.tanh((v - 20.0) / 4.0) * CITY_STEER,
        (REAR, "sign(ay)"): np.tanh(side),
        (MOMENT, "sign(r)"): np.tanh(r / 0.06),
        (MOMENT, "vx^2*ay"): v**2 * side,
        (TYRES, "vx^2"): v**2,
        (TYRES, "t"): minutes,
        (TYRES, "exp(-t/60 s)"): np.exp(-minutes),
    }
    by_drive = {(MOMENT, f"ax*ay where ax {sign} 0") for sign in "<>"}
    assert set(found) == set(expected) | by_drive
    for key, values in expected.items():
        near = 1e-4 * np.abs(values).max() if key[1] == "delta, slowly" else 1e-12
        np.testing.assert_allclose(found[key], values, rtol=1e-12, atol=near)
    driven_on, braked = found[MOMENT, "ax*ay where ax > 0"], found[MOMENT, "ax*ay where ax < 0"]
    assert np.all(driven_on * side >= 0.0)
    assert np.all(braked * side <= 0.0)
    smooth = slice(200, -200)
    np.testing.assert_allclose((driven_on + braked)[smooth], (moving.v_rate * side)[smooth], atol=0.02)


def test_what_is_locked_is_looked_for_where_it_reaches_its_end() -> None:
    """In wide bends its moment is as the bend, which is a stiffness; nor at a yaw rate that is small all the way."""
    tight = 0.25 * np.sin(0.5 * np.arange(N) / 100.0)
    moving = moves(drive({}, np.full(N, 6.0), tight))
    found = values_of_courses(moving, tight * RATIO, tight)
    r, v = moving.moved[:, motion.R], moving.v_mps
    np.testing.assert_allclose(found[MOMENT, "sign(r/vx)"], np.tanh(r / v / 0.03), rtol=1e-9, atol=1e-12)
    wide = values_of_courses(moves(drive({}, CITY_V, CITY_STEER)), CITY_STEER * RATIO, CITY_STEER)
    assert (MOMENT, "sign(r/vx)") not in wide
    assert (MOMENT, "sign(r)") in wide
    straight = 0.05 * CITY_STEER
    hardly = values_of_courses(moves(drive({}, CITY_V, straight)), straight * RATIO, straight)
    assert (MOMENT, "sign(r)") not in hardly


def test_what_pushes_is_a_force_and_a_moment_of_its_place() -> None:
    """Rear wheels by C_r at l_r behind, a moment by itself, all tyres each at its axle: with k once, in N and N m."""
    level = drive({}, CITY_V, CITY_STEER)
    moving, car = moves(level), car_of(level, nothing())
    values = 0.01 * np.sin(np.arange(N) / 100.0)
    front_n = moving.moved[:, motion.FRONT_N]
    rear_n = car.mass_kg * moving.moved[:, motion.AY] - front_n
    lf, lr = car.cg_to_front_axle_m, car.cg_to_rear_axle_m
    expected = {
        REAR: (car.rear_stiffness * values, -lr * car.rear_stiffness * values),
        MOMENT: (np.zeros(N), values),
        TYRES: (values * (front_n + rear_n), values * (lf * front_n - lr * rear_n)),
    }
    for place, (side_n, turning_nm) in expected.items():
        effect = surely(as_effect_of_the_car(Course(place, "c", values, ""), moving, car))
        assert (effect.steers, effect.name) == (None, f"{place}: k*c")
        push = pushed_by(vocabulary((effect,)), np.append(nothing(), 2.0), N)
        np.testing.assert_allclose(push, 2.0 * np.column_stack([side_n, turning_nm]), rtol=1e-12)
        assert is_of_the_car(effect.name)
        assert with_shapes([effect.name]) == {"gyro_z", "accel_y"}
    assert not is_of_the_car("gyro_z: k*c")
    assert not is_of_the_car("steering_ratio")


@pytest.mark.parametrize(
    ("one", "first", "shape"),
    [
        (turned("vx*vy", -2e-3), "steering_ratio", "steering: k*vx*vy"),
        (pushed(REAR, "vx*delta", 0.008), "mass_loading", "rear steering: k*vx*delta"),
    ],
)
def test_a_name_that_came_before_a_shape_goes_where_it_does_nothing_beside_it(
    monkeypatch: pytest.MonkeyPatch, one: Drive, first: str, shape: str
) -> None:
    """What turns the car is looked for a step too late: a name is there already, and has nothing left to do."""
    nameless, before = search_module._nameless, list[tuple[str, ...]]()

    def late(trial: Any, *given: Any) -> Any:
        before.append(trial.best.effects)
        return nameless(trial, *given) if trial.best.effects else None

    monkeypatch.setattr(search_module, "_nameless", late)
    found = searched(one, rows_of(one), TOLERANCE)
    assert before[1] == (first,)
    assert found.best.effects == (shape,)
    assert set(found.gains) == set(found.rivals) == {shape}


@pytest.mark.parametrize("v", [np.zeros(N), CITY_V])
def test_a_car_that_stands_or_goes_straight_on_is_not_turned_by_anything(v: np.ndarray) -> None:
    """Though its gyro shows a turn: there is an end to the search, and no course of the car in it."""

    def wanders(one: Drive) -> None:
        one.measured[:, 2] += 0.02 * np.sin(0.7 * np.arange(N) / 100.0)

    one = drive({}, v, np.zeros(N), change=wanders)
    still = moves(one)._replace(moved=np.zeros((N, 12)))
    course = Course(TYRES, "t", np.arange(N) / 6000.0, "min")
    assert as_effect_of_the_car(course, still, car_of(one, nothing())) is None
    assert not [effect for effect in searched(one, rows_of(one), TOLERANCE).best.effects if is_of_the_car(effect)]


def test_a_push_turns_and_moves_the_car_as_newton_has_it() -> None:
    """From straight ahead, before tyres answer: a_y = F / m, r' = M / I."""
    level = drive({}, CITY_V, np.zeros(N))
    car = car_of(level, nothing())
    push = np.zeros((N, 2))
    push[100] = 500.0, 700.0
    row = Effect("own", "", "", "car", as_steering("c", CITY_V, "").parameters, pushes=push)
    more = level._replace(vocabulary=vocabulary((row,)))
    moved = driven(more, np.append(nothing(), 1.0), flat(N)).moved
    assert moved[100, motion.AY] == pytest.approx(500.0 / car.mass_kg)
    assert moved[100, motion.R_RATE] == pytest.approx(700.0 / car.yaw_inertia_kgm2)
    # Over one step, but for what the tyres hold against it in its second half.
    assert moved[101, motion.R] == pytest.approx(0.01 * 700.0 / car.yaw_inertia_kgm2, rel=0.15)
    assert moved[101, motion.VY] == pytest.approx(0.01 * 500.0 / car.mass_kg, rel=0.15)


@pytest.mark.parametrize(
    ("place", "course", "k", "tolerance"),
    [
        (REAR, "delta", -0.1, TOLERANCE),
        # Within their tolerance the tyres take some of it.
        (REAR, "delta, slowly", -0.1, {}),
        (REAR, "vx*delta", 0.008, TOLERANCE),
        (MOMENT, "sign(r)", -800.0, TOLERANCE),
        (MOMENT, "ax*ay where ax > 0", 400.0, TOLERANCE),
        # At one speed it is what stiffnesses do: with a tolerance of theirs a tenth of it is.
        (MOMENT, "vx^2*ay", -0.8, {}),
        (TYRES, "exp(-t/60 s)", -0.4, TOLERANCE),
    ],
)
def test_what_a_car_does_without_a_name_is_told_by_where_and_what(
    place: str, course: str, k: float, tolerance: dict[str, float]
) -> None:
    one = pushed(place, course, k)
    found = searched(one, rows_of(one), tolerance)
    assert found.best.effects == (f"{place}: k*{course}",)
    [shape] = unlisted(found.drive, found.rows, found.best, found.shapes)
    assert (shape.channel, shape.shape) == ("gyro_z", f"k*{course}")
    assert shape.coefficient.value == pytest.approx(k, rel=0.1)


@pytest.mark.parametrize(("gain", "shapes"), [(19.0, 0), (21.0, 1)])
def test_what_a_car_does_without_a_name_is_told_where_it_gains_as_names_have_to(gain: float, shapes: int) -> None:
    one = turned("vx^2", 2e-5)
    found = searched(one, rows_of(one), TOLERANCE)
    told = answered(found._replace(gains={STEERS: gain}))
    assert len(told.unlisted) == shapes
    assert told.verdict == ("unexplained" if shapes else "consistent")


@pytest.mark.parametrize(
    ("effect", "beside", "asked"),
    [
        # What a car does, and where or when an IMU feels it, may be a car that steers otherwise.
        ("steering_ratio", STEERS, 25.0),
        ("imu_lever_arm", STEERS, 25.0),
        ("imu_delay", STEERS, 25.0),
        ("wheel_radius", STEERS, 1.5),
        ("wheel_radius", "wheel_square", 50.0),
        # And what a nose does that lifts as its springs let it.
        ("accel_scale", "nose_lift", 10.0),
        ("wheel_growth", "nose_lift", 10.0),
        ("gyro_scale", "nose_lift", 1.5),
        ("gyro_scale", STEERS, 1.5),
        # A ratio is a number: what follows the speed is told beside it.
        ("steering: k*vx*delta", "steering_ratio", 5.0),
        ("steering: k*vx*delta", "steering_compliance", 25.0),
        (STEERS, "steering_compliance", 25.0),
        (STEERS, "gyro_scale", 1.5),
        (STEERS, LEANS, 1.5),
        ("gyro_scale", LEANS, 10.0),
        ("accel_scale", LEANS, 1.5),
        (LEANS, "gyro_scale", 1.5),
    ],
)
def test_what_has_to_be_gained_beside_a_shape(effect: str, beside: str, asked: float) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    own = (as_steering("vx^2", CITY_V**2, "m2/s2"), as_effect("gyro_z", "vx^2", CITY_V**2, "1", 1e-3))
    one = one._replace(vocabulary=vocabulary(own))
    assert asked_of(one, effect, {beside: 100.0}) == pytest.approx(asked)


def test_what_steers_shows_in_the_yaw_rate_and_across() -> None:
    assert with_shapes([STEERS, "accel_x: k*ay^2", "gyro_scale"]) == {"gyro_z", "accel_y", "accel_x"}
