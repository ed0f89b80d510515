"""diagnose: what turns a car otherwise than any name has it is given none of these names."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, T, drive, found

from dsz_daemon.diagnose.effects.shape_names import NO_SHAPE
from dsz_daemon.diagnose.simulation.drive import Drive
from dsz_daemon.diagnose.verdict import answer
from dsz_daemon.diagnose.verdict import level as level_room
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.level import (
    curve_of_an_axle,
    driven_by_other_wheels,
    late_besides,
    level_of,
    off_together,
    turned_by_another,
)
from dsz_daemon.report.diagnosis_words import sentence
from dsz_daemon.runs.diagnose import words

GYRO_Z, ACCEL_Y = 2, 4
BOTH = ["gyro_z", "accel_y"]


@pytest.mark.parametrize(
    ("effects", "level", "names", "channels"),
    [
        (("cornering_stiffness",), {"gyro_z": 2.6, "accel_y": 2.2}, {"cornering_stiffness"}, ["gyro_z", "accel_y"]),
        (("steering_backlash",), {"gyro_z": 17.0, "accel_y": 15.0}, {"steering_backlash"}, ["gyro_z", "accel_y"]),
        (("imu_delay", "mass_loading"), {"gyro_z": 9.0, "accel_y": 9.0}, {"mass_loading"}, ["gyro_z", "accel_y"]),
        (("steering_delay", "steering_ratio"), {"gyro_z": 2.0}, {"steering_delay", "steering_ratio"}, ["gyro_z"]),
        # A wind makes the accelerometer right, whatever is wrong; it is none then.
        (
            ("cornering_stiffness", "side_wind"),
            {"gyro_z": 1.6, "accel_y": 0.9},
            {"cornering_stiffness", "side_wind"},
            ["gyro_z", "accel_y"],
        ),
        (("cornering_stiffness", "side_wind"), {"gyro_z": 1.4, "accel_y": 3.0}, set(), []),
        # One channel that is right is enough: the other's instrument may be what is wrong.
        (("steering_ratio",), {"gyro_z": 0.9, "accel_y": 60.0}, set(), []),
        (("steering_ratio",), {"gyro_z": 60.0, "accel_y": 1.4}, set(), []),
        (("steering_ratio",), {"accel_x": 60.0}, set(), []),
        # But where that is said to swing, it is right then.
        (("steering_ratio", "soft_mount"), {"gyro_z": 0.9, "accel_y": 1.6}, {"steering_ratio"}, ["gyro_z", "accel_y"]),
        (("steering_ratio", "soft_mount"), {"gyro_z": 0.9, "accel_y": 1.4}, set(), []),
        # Nor is there one by itself, or beside instruments, where the only channel that could tell is off.
        (("side_wind",), {"gyro_z": 1.6, "accel_y": 0.9}, {"side_wind"}, ["gyro_z", "accel_y"]),
        (("gyro_scale", "side_wind"), {"gyro_z": 2.6, "accel_y": 2.2}, {"side_wind"}, ["gyro_z", "accel_y"]),
        (("side_wind",), {"gyro_z": 1.4, "accel_y": 3.0}, set(), []),
        (("side_wind",), {"accel_y": 3.0}, set(), []),
        # At the limit of grip by as much as that of its own.
        (("low_friction", "side_wind"), {"gyro_z": 2.4}, {"low_friction", "side_wind"}, ["gyro_z"]),
        (("low_friction", "side_wind"), {"gyro_z": 2.2}, set(), []),
        # An IMU that is late, or slow, shows how a car turns, later.
        (("imu_delay",), {"gyro_z": 1.6, "accel_y": 2.2}, {"imu_delay"}, ["gyro_z", "accel_y"]),
        (("sensor_bandwidth",), {"gyro_z": 2.2, "accel_y": 1.6}, {"sensor_bandwidth"}, ["gyro_z", "accel_y"]),
        (("imu_delay",), {"gyro_z": 1.4, "accel_y": 9.0}, set(), []),
        (("imu_delay",), {"gyro_z": 9.0}, set(), []),
        (("imu_delay", "gyro_scale"), {"gyro_z": 9.0, "accel_y": 9.0}, set(), []),
        ((), {"gyro_z": 9.0, "accel_y": 9.0}, set(), []),
        # Tyres that are stiffer to one side were a zero of the steering besides.
        (
            ("steering_offset", "steering: k*(1-cos(2*hand))"),
            {"gyro_z": 2.6, "accel_y": 2.2},
            {"steering_offset"},
            BOTH,
        ),
        (("steering_offset",), {"gyro_z": 1.4, "accel_y": 2.2}, set(), []),
        (("tyre_saturation", "steering_offset"), {"gyro_z": 2.2, "accel_y": 2.2}, set(), []),
        # Instruments do not turn a car, and at the limit of grip no simulation turns as a car does.
        (("gyro_scale",), {"gyro_z": 2.6, "accel_y": 2.2}, set(), []),
        (("tyre_saturation", "steering_ratio"), {"gyro_z": 5.0, "accel_y": 2.2}, set(), []),
        (("low_friction",), {"gyro_z": 2.6, "accel_y": 1.8, "wheel_speed_fl": 5.0}, set(), []),
        (("low_friction",), {"gyro_z": 1.4, "accel_y": 9.0, "wheel_speed_fl": 50.0}, set(), []),
        (("low_friction",), {"gyro_z": 9.0}, set(), []),
        # Beside it a ratio that explains little of what it does is the curve of these tyres.
        (
            ("low_friction", "c", "d", "e", "f", "steering_ratio"),
            {"gyro_z": 2.3, "accel_y": 1.4},
            {"steering_ratio"},
            [],
        ),
        (("low_friction", "c", "d", "e", "f", "steering_ratio"), {"gyro_z": 1.4, "accel_y": 1.4}, set(), []),
        (("low_friction", "c", "d", "e", "steering_ratio"), {"gyro_z": 2.3, "accel_y": 1.4}, set(), []),
        # But for one that has both wrong by far, or wheels as well.
        (("low_friction",), {"gyro_z": 2.4, "accel_y": 5.0}, {"low_friction"}, ["gyro_z", "accel_y"]),
        (("low_friction",), {"gyro_z": 2.2, "accel_y": 5.0}, set(), []),
        (
            ("tyre_saturation", "steering_ratio"),
            {"gyro_z": 1.6, "accel_y": 1.8, "wheel_speed_fl": 7.0},
            {"tyre_saturation", "steering_ratio"},
            ["gyro_z", "accel_y"],
        ),
        # Or turns it besides by what has no name.
        (
            ("tyre_saturation", "yaw moment: k*ax*ay"),
            {"gyro_z": 2.1, "accel_y": 2.3},
            {"tyre_saturation"},
            ["gyro_z", "accel_y"],
        ),
        (("tyre_saturation", "yaw moment: k*ax*ay"), {"gyro_z": 2.1, "accel_y": 1.4}, set(), []),
        (("tyre_saturation", "gyro_z: k*ay^2"), {"gyro_z": 2.1, "accel_y": 2.3}, set(), []),
        # But for one that explains less than what it is beside: that is none, either.
        (("steering_ratio", "tyre_saturation"), {"gyro_z": 5.0}, {"steering_ratio", "tyre_saturation"}, ["gyro_z"]),
        (("steering_ratio", "low_friction"), {"gyro_z": 1.4}, set(), []),
    ],
)
def test_what_leaves_a_car_turning_otherwise_is_not_what_turns_it(
    effects: tuple[str, ...],
    level: dict[str, float],
    names: set[str],
    channels: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # What a wind takes off is another test's.
    monkeypatch.setattr(level_room, "nominal_level", lambda _: level)
    gains = {effect: 100.0 / (1.0 + i) for i, effect in enumerate(effects)}
    search: Any = SimpleNamespace(best=SimpleNamespace(effects=effects), gains=gains)
    assert turned_by_another(search, level) == (names, channels)


@pytest.mark.parametrize(
    ("gains", "names"),
    [
        ({"steering_delay": 88.0, "yaw_inertia": 834.0}, {"steering_delay"}),
        ({"tyre_relaxation": 49.0, "yaw_inertia": 27.0}, {"tyre_relaxation"}),
        # A delay that gains far more is one; nor is a load whose inertia is no other's, or anything of instruments.
        ({"steering_delay": 2885.0, "yaw_inertia": 271.0}, set()),
        ({"steering_delay": 88.0, "mass_loading": 100.0, "yaw_inertia": 834.0}, set()),
        ({"imu_delay": 88.0, "yaw_inertia": 834.0}, set()),
        ({"steering_delay": 88.0}, set()),
        # What lags behind the hand is drawn to first order: relaxation is the rest of it.
        ({"steering_lag": 2654.0, "tyre_relaxation": 706.0, "mass_loading": 100.0}, {"tyre_relaxation"}),
        ({"steering_lag": 200.0, "steering_delay": 2885.0}, {"steering_delay"}),
    ],
)
@pytest.mark.parametrize("is_told", [True, False])
def test_what_turns_late_beside_what_has_no_name_and_does_is_a_part_of_it(
    gains: dict[str, float], names: set[str], is_told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(level_room, "is_told", lambda *_: is_told)
    there: Any = SimpleNamespace(best=SimpleNamespace(effects=tuple(gains)), gains=gains, drive=None)
    assert late_besides(there, set(gains)) == (names if is_told else set())
    assert late_besides(there, set(gains) - {"yaw_inertia", "steering_lag"}) == set()


def test_what_is_a_part_of_another_lag_is_not_said(monkeypatch: pytest.MonkeyPatch) -> None:
    search = found(drive({"steering_delay.delay_s": 0.1}, CITY_V, CITY_STEER))
    assert [cause.effect for cause in answered(search).causes] == ["steering_delay"]
    monkeypatch.setattr(answer, "late_besides", lambda *_: {"steering_delay"})
    assert answered(search).causes == []


@pytest.mark.parametrize(
    ("before", "after", "effects", "is_wind"),
    [
        # Gusts that are quicker than the course of a wind is drawn leave some; what is no wind leaves most.
        (9.0, 2.2, ("side_wind",), True),
        (8.5, 2.2, ("side_wind",), False),
        (60.0, 2.9, ("side_wind",), True),
        (60.0, 3.1, ("side_wind",), False),
        (60.0, 2.2, ("gyro_scale", "side_wind"), False),
        (60.0, 2.2, ("suspension_roll", "side_wind"), True),
        (60.0, 2.2, ("cornering_stiffness", "side_wind"), False),
    ],
)
def test_a_wind_of_quick_gusts_takes_most_of_what_is_left(
    before: float, after: float, effects: tuple[str, ...], is_wind: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(level_room, "nominal_level", lambda _: {"gyro_z": before, "accel_y": 99.0})
    there: Any = SimpleNamespace(
        best=SimpleNamespace(effects=effects), gains=dict.fromkeys(effects, 100.0), nominal=None
    )
    names, channels = turned_by_another(there, {"gyro_z": after, "accel_y": 4.0})
    assert (names, channels) == ((set(), []) if is_wind else (set(effects) - {"gyro_scale"}, ["gyro_z", "accel_y"]))


@pytest.mark.parametrize(
    ("gains", "names"),
    [
        ({"locked_axle": 800.0, "steering_ratio": 1000.0, "imu_lever_arm": 190.0}, {"imu_lever_arm"}),
        ({"locked_axle": 800.0, "steering_ratio": 1000.0, "imu_lever_arm": 210.0}, set()),
        ({"locked_axle": 1000.0, "imu_lever_arm": 190.0, "gyro_scale": 20.0}, {"imu_lever_arm"}),
        ({"steering_ratio": 1000.0, "imu_lever_arm": 190.0}, set()),
        ({"locked_axle": 1000.0, "steering_backlash": 190.0, "steering_delay": 210.0}, {"steering_backlash"}),
    ],
)
def test_what_gains_little_beside_wheels_that_turn_alike_is_how_they_scrub(
    gains: dict[str, float], names: set[str]
) -> None:
    search: Any = SimpleNamespace(best=SimpleNamespace(effects=tuple(gains)), gains=gains)
    assert curve_of_an_axle(search) == names


@pytest.mark.parametrize(
    ("level", "off"),
    [
        ({"gyro_z": 2.9, "accel_y": 2.3, "accel_x": 0.9}, ["gyro_z", "accel_y"]),
        ({"accel_x": 2.1, "accel_y": 2.1}, ["accel_x", "accel_y"]),
        # One may be off by its own sensor, and bumps or wheels are no motion in the plane.
        ({"accel_y": 2.9, "gyro_z": 1.9}, []),
        ({"accel_y": 2.9, "accel_z": 2.9, "gyro_y": 2.9, "wheel_speed_fl": 2.9}, []),
        ({}, []),
    ],
)
def test_what_two_channels_of_the_motion_in_the_plane_show_is_something(
    monkeypatch: pytest.MonkeyPatch, level: dict[str, float], off: list[str]
) -> None:
    """Where nothing is said of it a recording is not consistent with the simulation."""
    assert off_together(level) == off
    search = found(drive({}, CITY_V, CITY_STEER))
    assert answered(search).verdict == "consistent"
    there = level_of(search) | level
    monkeypatch.setattr(answer, "level_of", lambda _: there)
    told = answered(search)
    assert (told.verdict, told.causes, told.unlisted) == ("unexplained" if off else "consistent", [], [])
    # With a name what is left has to be more.
    named = found(drive({"gyro_scale.x": 0.05, "gyro_scale.z": 0.05}, CITY_V, CITY_STEER))
    assert answered(named).verdict == "explained"


def test_tyres_within_their_tolerance_are_none_where_nothing_explains_the_yaw_rate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Stability control, and a trailer that sways, were front tyres 9 % softer and rear ones 10 % stiffer besides."""
    name = "front_cornering_stiffness_n_per_rad"
    search = found(drive({name: -0.06}, CITY_V, CITY_STEER))
    told = answered(search)
    assert (told.verdict, [error.parameter for error in told.parameter_errors]) == ("consistent", [name])
    for channel, is_told in (("gyro_z", False), ("accel_y", True), ("wheel_speed_fl", True)):
        there = level_of(search) | {channel: 6.1}
        monkeypatch.setattr(answer, "level_of", lambda _, there=there: there)
        told = answered(search)
        assert told.verdict == "unexplained"
        assert [error.parameter for error in told.parameter_errors] == ([name] if is_told else [])


@pytest.mark.parametrize(
    ("level", "is_far"),
    [
        ({"wheel_speed_rl": 8.9, "wheel_speed_rr": 27.0, "wheel_speed_fr": 0.9}, True),
        ({"wheel_speed_fl": 8.1, "wheel_speed_fr": 8.1}, True),
        # One wheel may be wrong by itself, and what is not a wheel says nothing of them.
        ({"wheel_speed_fl": 7.9, "wheel_speed_fr": 90.0, "accel_x": 90.0, "gyro_z": 90.0}, False),
        ({}, False),
    ],
)
def test_what_other_wheels_drive_is_given_no_name_but_a_roads(level: dict[str, float], is_far: bool) -> None:
    search: Any = SimpleNamespace(best=SimpleNamespace(effects=("imu_lever_arm", "road_grade", "wheel_speed_delay")))
    assert driven_by_other_wheels(search, level) == ({"imu_lever_arm", "wheel_speed_delay"} if is_far else set())


@pytest.mark.parametrize(
    ("level", "is_none"),
    [
        ({"wheel_speed_fl": 5.1, "wheel_speed_fr": 6.5, "wheel_speed_rr": 0.6}, True),
        # One wheel may be wrong by itself.
        ({"wheel_speed_fl": 4.9, "wheel_speed_fr": 7.5, "accel_y": 6.0}, False),
    ],
)
def test_radii_that_leave_wheels_wrong_are_none(level: dict[str, float], is_none: bool) -> None:
    search: Any = SimpleNamespace(best=SimpleNamespace(effects=("imu_lever_arm", "wheel_radius")))
    assert driven_by_other_wheels(search, level) == ({"wheel_radius"} if is_none else set())


@pytest.mark.parametrize(
    ("level", "is_none"),
    [
        ({"wheel_speed_rl": 2.1, "wheel_speed_fr": 0.3}, True),
        ({"wheel_speed_rl": 1.9, "wheel_speed_rr": 1.9, "accel_y": 6.0}, False),
        ({}, False),
    ],
)
def test_tracks_that_leave_a_wheel_wrong_are_none(level: dict[str, float], is_none: bool) -> None:
    search: Any = SimpleNamespace(best=SimpleNamespace(effects=("imu_lever_arm", "track_width")))
    assert driven_by_other_wheels(search, level) == ({"track_width"} if is_none else set())


def test_an_arm_beside_wheels_that_are_exchanged_is_not_said(monkeypatch: pytest.MonkeyPatch) -> None:
    one = drive({"imu_lever_arm.x_m": 0.6}, CITY_V, CITY_STEER)
    search = found(one)
    assert [cause.effect for cause in answered(search).causes] == ["imu_lever_arm"]
    exchanged = level_of(search) | {"wheel_speed_fl": 9.0, "wheel_speed_fr": 9.0}
    monkeypatch.setattr(answer, "level_of", lambda _: exchanged)
    told = answered(search)
    assert told.causes == []
    assert told.verdict == "unexplained"


def _swinging(share: float, at_m: float, hz: float) -> Drive:
    """What soft rear tyres would do, and a share of the mass on a spring across the car, so far ahead of the C.G."""
    one = drive({"cornering_stiffness.rear_scale": -0.25}, CITY_V, CITY_STEER)
    w, dt, damping = 2.0 * np.pi * hz, float(T[1] - T[0]), 0.15
    s = speed = yaw = slide = 0.0
    push = np.zeros((len(T), 2))
    for k, across in enumerate(np.nan_to_num(one.measured[:, ACCEL_Y])):
        force = share * (w * w * s + 2.0 * damping * w * speed)
        speed += dt * (-w * w * s - 2.0 * damping * w * speed - across)
        s += dt * speed
        # What it was at rest on the car is in the car's mass already; the tyres take most of a push within 0.2 s.
        more = force + share * across
        yaw += dt * (at_m * more / 1.6 - yaw / 0.2)
        slide += dt * (more - slide / 0.2)
        push[k] = yaw, more - 0.5 * slide
    measured = one.measured.copy()
    measured[:, [GYRO_Z, ACCEL_Y]] += push
    return one._replace(measured=measured)


def test_what_turns_a_car_by_tyres_and_swings_is_no_stiffness_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    search = found(_swinging(0.05, -0.9, 0.6))
    turns = turned_by_another(search, level_of(search))[0]
    told = answered(search)
    assert turns
    assert turns.isdisjoint(cause.effect for cause in told.causes)
    assert told.parameter_errors == []
    assert told.verdict in {"unexplained", "partly_explained"}
    # Else it would be told as that.
    monkeypatch.setattr(answer, "turned_by_another", lambda *_: (set(), []))
    assert turns & {cause.effect for cause in answered(search).causes}


def test_a_stiffness_that_is_one_has_its_name() -> None:
    search = found(drive({"cornering_stiffness.rear_scale": -0.25}, CITY_V, CITY_STEER))
    assert turned_by_another(search, level_of(search)) == (set(), [])


@pytest.mark.parametrize(
    ("level", "unlisted", "line"),
    [
        ({"gyro_z": 2.57, "accel_y": 1.6, "accel_x": 2.9}, [], "gyro_z 2.6 times, accel_y 1.6 times"),
        ({"gyro_z": 11.4, "accel_y": 2.9, "accel_x": 3.2}, [], "gyro_z 11 times, accel_x 3 times"),
        # Then a shape is what has no name, and the rest is explained.
        ({"gyro_z": 2.57, "accel_y": 1.6}, ["accel_x"], None),
    ],
)
def test_what_is_not_explained_is_said_with_how_much(
    level: dict[str, float], unlisted: list[str], line: str | None
) -> None:
    keys = ("causes", "parameter_errors", "same_as_offsets", "same_as_slip", "located", "could_not_test")
    coefficient = {"value": 1.0, "std": 0.1, "unit": "1"}
    shapes = [{"channel": channel, "shape": "k*vx", "coefficient": coefficient} for channel in unlisted]
    result: dict[str, Any] = {key: [] for key in keys}
    result |= {"verdict": "unexplained", "level": level, "fit": {}, "unlisted": shapes}
    told = words(result)
    if line is None:
        assert "not explained" not in told
    else:
        assert f"not explained: {line} what noise" in told


def test_what_is_of_no_known_shape_is_said_with_its_channel_and_how_much() -> None:
    keys = ("causes", "parameter_errors", "same_as_offsets", "same_as_slip", "located", "could_not_test")
    left = {"channel": "gyro_z", "shape": NO_SHAPE, "coefficient": {"value": 0.0173, "std": 1e-4, "unit": "rad/s"}}
    result: dict[str, Any] = {key: [] for key in keys}
    result |= {"verdict": "unexplained", "level": {"gyro_z": 2.57}, "fit": {}, "unlisted": [left]}
    lines = words(result).splitlines()
    assert "- gyro_z: 0.0173 rad/s (rms) is left, of no known shape" in lines
    assert any(line.startswith("- not explained: gyro_z 2.6 times") for line in lines)
    # The page's sentence says it by how far the channel is off, and of no shape.
    told = sentence(result)
    assert "2.6 times" in told
    assert "shape" not in told
