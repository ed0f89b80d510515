"""Many numbers of a car that are off at once are one mistake; one that is off, or two, are not."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.effects.row import SENSORS
from dsz_daemon.diagnose.effects.shape_names import is_of_the_car
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.search import Search, searched
from dsz_daemon.diagnose.verdict import another_car
from dsz_daemon.diagnose.verdict.another_car import ROOM, with_own_numbers
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.said import ParameterError

STIFFNESS = "front_cornering_stiffness_n_per_rad"
# Shares by which a car is another than the one that is configured: longer, wider, steered less directly.
ANOTHER = {
    "cg_to_rear_axle_m": 0.3,
    "cg_to_front_axle_m": 0.2,
    "steering_ratio": 0.37,
    "front_track_m": 0.05,
    "rear_track_m": 0.06,
    "yaw_inertia_kgm2": 0.3,
    "front_cornering_stiffness_n_per_rad": 0.1,
    "rear_cornering_stiffness_n_per_rad": 0.1,
}


def test_another_cars_numbers_are_told_and_need_no_names() -> None:
    one, said = drive(ANOTHER, CITY_V, CITY_STEER), list[str]()
    names = searched(one, rows_of(one), TOLERANCE)
    # Something of which nothing is there: what sensors show wrongly, by name or by shape, or what turns the car.
    sensors = {effect.name for effect in names.drive.vocabulary.effects if effect.touches == SENSORS}
    assert [effect for effect in names.best.effects if effect in sensors or is_of_the_car(effect)]
    found, gain = with_own_numbers(one, names, TOLERANCE, said.append)
    assert any("all numbers of the car" in words for words in said)
    assert gain > 100.0
    assert found.best.effects == ()
    for name, share in ANOTHER.items():
        at = INDEX[name]
        assert found.best.x[at] == pytest.approx(
            share, abs=max(4.0 * found.best.std[found.best.columns.index(at)], 0.01)
        )

    # What is said is one cause, and each number; what it is held against is what is configured.
    told = answered(found, by_numbers=gain)
    assert told.verdict == "explained"
    [cause] = told.causes
    assert (cause.effect, cause.gain) == ("configuration", gain)
    assert answered(found).causes == []
    errors = {error.parameter: error.fitted / error.configured for error in told.parameter_errors}
    spreads = {error.parameter: error.std / error.configured for error in told.parameter_errors}
    # The rear tyres' stiffness is no more off than this drive tells.
    assert set(ANOTHER) - {"rear_cornering_stiffness_n_per_rad"} <= set(errors) <= set(ANOTHER)
    for name, value in cause.parameters.items():
        assert value.value == pytest.approx(1.0 + ANOTHER[name], abs=0.05)
        assert (value.value, value.std) == (errors[name], spreads[name])
        assert f"{name} by {100.0 * (errors[name] - 1.0):+.1f}%" in cause.statement
    np.testing.assert_array_equal(found.nominal.x, names.nominal.x[: len(found.nominal.x)])
    fit = told.fit["accel_y"].held_out
    assert fit.before > 2.0 * fit.after


def test_one_number_and_a_sensor_stay_what_they_are() -> None:
    one = drive({"steering_ratio.scale": 0.1, "accel_scale.y": 0.05}, CITY_V, CITY_STEER)
    names = searched(one, rows_of(one), TOLERANCE)
    assert set(names.best.effects) == {"steering_ratio", "accel_scale"}
    found, gain = with_own_numbers(one, names, TOLERANCE)
    assert found is names
    assert gain == 0.0
    assert [cause.effect for cause in answered(found).causes] == [
        cause.effect for cause in answered(found, by_numbers=gain).causes
    ]


@pytest.mark.parametrize("left_out", [{"steering_ratio.scale": 0.1}, {"accel_scale.y": 0.05, "gyro_scale.z": 0.05}])
def test_numbers_are_free_only_where_one_of_them_is_named_beside_something(
    left_out: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = drive(left_out, CITY_V, CITY_STEER)
    names = searched(one, rows_of(one), TOLERANCE)
    assert set(names.best.effects) == {name.split(".")[0] for name in left_out}
    monkeypatch.setattr(another_car, "fitted", lambda *_args, **_more: pytest.fail("fitted for nothing"))
    assert with_own_numbers(one, names, TOLERANCE) == (names, 0.0)


def test_a_sensor_that_is_named_in_the_place_of_numbers_has_to_go() -> None:
    """Names that fit as well as numbers: another car's axles as a ratio, an IMU's place, and sensors too weak."""
    one = drive(ANOTHER, CITY_V, CITY_STEER)
    rows = rows_of(one)
    told, _ = with_own_numbers(one, searched(one, rows, TOLERANCE), TOLERANCE)
    idle = ("steering_ratio", "accel_scale")
    fit = fitted(one, rows, told.best.x, idle, TOLERANCE | ROOM)
    # As well as numbers, and they gained so much that no number can gain a twentieth of it.
    crowded = told._replace(best=fit, gains=dict.fromkeys(idle, 1e6))
    found, gain = with_own_numbers(one, crowded, TOLERANCE)
    assert found.best.effects == ()
    assert gain > 100.0


@pytest.mark.parametrize(
    ("effects", "gain", "of", "idle", "told", "anew"),
    [
        (("track_width", "accel_scale"), 0.0, 1000.0, {"accel_scale"}, 0.85, True),
        (("track_width", "accel_scale"), 0.0, 1000.0, set(), 0.85, False),
        (("track_width", "side_wind"), 0.0, 1000.0, {"side_wind"}, 0.85, True),
        (("track_width", "imu_lever_arm"), 0.0, 1000.0, {"imu_lever_arm"}, 0.85, False),
        (("steering_ratio", "imu_lever_arm"), 51.0, 1000.0, set(), 0.85, True),
        (("steering_ratio", "imu_lever_arm"), 49.0, 1000.0, set(), 0.85, False),
        (("mass_loading", "steering_compliance"), 9.0, 20.0, set(), 0.85, False),
        (("mass_loading", "steering_compliance"), 11.0, 20.0, set(), 0.85, True),
        (("track_width", "accel_scale"), 60.0, 1000.0, {"accel_scale"}, None, False),
        (("track_width", "accel_scale"), 60.0, 1000.0, {"accel_scale"}, 0.95, False),
    ],
)
def test_numbers_are_free_where_they_explain_more_or_a_sensor_is_idle(
    effects: tuple[str, ...],
    gain: float,
    of: float,
    idle: set[str],
    told: float | None,
    anew: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The rule by itself, of gains that are given: a twentieth, 10 at least, and where an IMU is counts as a number.

    And a number has to be `told` that is off by more than its tolerance, 10 % here.
    """
    one = drive({}, CITY_V, CITY_STEER)
    found = searched(one, rows_of(one), TOLERANCE)
    found = found._replace(best=found.best._replace(effects=effects), gains=dict.fromkeys(effects, of / len(effects)))
    rooms: list[dict[str, float]] = []

    def fit(
        _drive: object, _rows: object, _start: object, kept: tuple[str, ...], *_args: object, **_more: object
    ) -> Fit:
        return found.best._replace(effects=kept)

    def gained(_drive: object, smaller: Fit, larger: Fit) -> float:
        if smaller is found.best:
            return gain
        gone = set(larger.effects) - set(smaller.effects)
        return -1.0 if gone and gone <= idle else 30.0

    def search(_drive: object, _rows: object, room: dict[str, float], *_args: object) -> Search:
        rooms.append(room)
        return found

    def errors(_found: Search, _each: object) -> list[ParameterError]:
        return [] if told is None else [ParameterError(STIFFNESS, 6e4, told * 6e4, 1e3)]

    for name, instead in (("fitted", fit), ("gained", gained), ("searched", search), ("parameter_errors", errors)):
        monkeypatch.setattr(another_car, name, instead)
    tolerance = {STIFFNESS: 0.1, "yaw_inertia_kgm2": 0.9, "mass_kg": 0.05}
    _, by_numbers = with_own_numbers(one, found, tolerance)
    assert (by_numbers > 0.0) is anew
    assert len(rooms) == (anew or told != 0.85)
    for room in rooms:
        assert room == {**ROOM, "yaw_inertia_kgm2": 0.9, "mass_kg": 0.05}

    # Beside what a car does without a name, or a mount that swings, its numbers are none that are told; what a sensor
    # does by itself is no matter.
    shapes = {"steering: k*vx*vy": 0.0, "locked_axle": 0.0, "soft_mount": 0.0, "gyro_z: k*vx^2": by_numbers}
    for shape, told_by in shapes.items():
        shaped = found._replace(best=found.best._replace(effects=(shape,)))
        monkeypatch.setattr(another_car, "searched", lambda *_, shaped=shaped: shaped)
        again, gain_of_numbers = with_own_numbers(one, found, tolerance)
        assert gain_of_numbers == told_by
        assert (again is found) is (told_by == 0.0)


@pytest.mark.parametrize(
    ("held", "off", "anew"),
    [
        ("locked_axle", ["rear_track_m"], False),
        ("locked_axle", ["front_track_m", STIFFNESS], True),
        ("wheel_square", ["rear_track_m"], True),
    ],
)
def test_a_narrow_track_alone_is_a_differential_that_holds_an_axles_wheels(
    monkeypatch: pytest.MonkeyPatch, held: str, off: list[str], anew: bool
) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    found = searched(one, rows_of(one), TOLERANCE)
    names = found._replace(best=found.best._replace(effects=(held, "steering_ratio")), gains={held: 1000.0})
    errors = [ParameterError(name, 1.5, 1.05, 0.01) for name in off]
    monkeypatch.setattr(another_car, "gained", lambda *_: 400.0)
    monkeypatch.setattr(another_car, "fitted", lambda *_args, **_more: found.best)
    monkeypatch.setattr(another_car, "without", lambda *_args, **_more: found.best)
    monkeypatch.setattr(another_car, "slopes_at", lambda *_: None)
    monkeypatch.setattr(another_car, "searched", lambda *_: found)
    monkeypatch.setattr(another_car, "parameter_errors", lambda *_: errors)
    again, gain = with_own_numbers(one, names, TOLERANCE)
    assert (gain > 0.0) is anew
    assert (again is names) is not anew
