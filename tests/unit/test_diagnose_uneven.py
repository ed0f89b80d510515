"""A number that is none: a scale to one side only or that comes with the time, a ratio that follows the speed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive, found

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.selection import plausible, search
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.selection.search import fitted
from dsz_daemon.diagnose.selection.trials import Step
from dsz_daemon.diagnose.shapes.unlisted import Found, as_effect, is_named
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.simulation.wheel_readings import as_they_read, as_they_roll
from dsz_daemon.diagnose.verdict import unnamed
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.unnamed import not_named

CHANNEL = {"gyro_z": 2, "accel_x": 3, "accel_y": 4}
OWN = {"gyro_z": "r", "accel_x": "ax", "accel_y": "ay"}
G = 9.80665


def showing(channel: str, share: np.ndarray) -> Drive:
    """A channel that shows so much more (n,) of what it shows."""
    c = CHANNEL[channel]
    own = predicted(drive({}, CITY_V, CITY_STEER), nothing(), flat(N))[:, c]

    def more(one: Drive) -> None:
        one.measured[:, c] += share * own

    return drive({}, CITY_V, CITY_STEER, change=more)


@pytest.mark.parametrize("channel", ["gyro_z", "accel_y"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_a_sensor_shows_more_to_one_side_is_no_scale(channel: str, sign: float) -> None:
    own = predicted(drive({}, CITY_V, CITY_STEER), nothing(), flat(N))[:, CHANNEL[channel]]
    said = answered(found(showing(channel, 0.08 * (sign * own > 0.0))))
    assert said.causes == []
    [shape] = said.unlisted
    assert shape.channel == channel
    assert shape.shape == f"k*{OWN[channel]} where {OWN[channel]} {'>' if sign > 0.0 else '<'} 0"
    assert shape.coefficient.value == pytest.approx(0.08, rel=0.05)


@pytest.mark.parametrize(
    ("share", "name", "k"),
    [
        (0.1 * (1.0 - np.exp(-T / 60.0)), "{}*(1-exp(-t/60 s))", 0.1),
        (0.1 * np.exp(-T / 60.0), "{}*exp(-t/60 s)", 0.1),
        (0.002 * T, "{}*t", 0.002),
    ],
    ids=["comes", "goes", "with time"],
)
@pytest.mark.parametrize("channel", ["gyro_z", "accel_y"])
def test_what_a_sensor_shows_more_as_it_warms_up_is_no_scale(
    channel: str, share: np.ndarray, name: str, k: float
) -> None:
    said = answered(found(showing(channel, share)))
    assert said.causes == []
    [shape] = said.unlisted
    assert (shape.channel, shape.shape) == (channel, f"k*{name.format(OWN[channel])}")
    assert shape.coefficient.value == pytest.approx(k, rel=0.1)


@pytest.mark.parametrize("channel", ["gyro_z", "accel_y"])
def test_a_scale_is_one_all_the_way(channel: str) -> None:
    said = answered(found(showing(channel, np.full(N, 0.01))))
    assert [cause.effect for cause in said.causes] == [f"{channel.partition('_')[0]}_scale"]
    assert said.unlisted == []


def test_each_sensor_has_its_own_uneven_scales() -> None:
    for name in ("{} where {} > 0", "{} where {} < 0", "{}*t", "{}*(1-exp(-t/60 s))", "{}*exp(-t/60 s)"):
        for channel in ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"):
            for other, own in OWN.items():
                assert is_named(name.format(own, own), channel) == (channel != other)
    # What is no scale at all is every channel's.
    assert not is_named("ax*ay", "accel_y")
    assert not is_named("r*|r|", "accel_x")


RATIO, BY_SPEED = "steering_ratio", "steering: k*vx*delta"


@pytest.mark.parametrize(
    ("effects", "silent"),
    [
        ((RATIO,), set()),
        ((RATIO, BY_SPEED), {RATIO}),
        ((RATIO, "rear steering: k*tanh((vx-15)/7)*delta"), {RATIO}),
        ((RATIO, "rear steering: k*tanh((vx-20)/4)*delta"), {RATIO}),
        (("mass_loading", "gyro_scale", "rear steering: k*tanh((vx-15)/7)*delta"), {"mass_loading"}),
        ((RATIO, "mass_loading", "rear steering: k*delta"), {RATIO, "mass_loading"}),
        ((RATIO, "rear steering: k*delta"), set()),
        ((RATIO, "gyro_z: k*vx^2"), set()),
        ((RATIO, "steering: k*sin(2*hand)"), {RATIO}),
        ((RATIO, "steering: k*(1-cos(hand))"), {RATIO}),
        (("tyre_saturation", RATIO, "gyro_z: k*ax*ay", "accel_y: k*ax*ay"), {RATIO, "tyre_saturation"}),
        (("steering_offset", "gyro_scale", "gyro_z: k*|ay|", "accel_y: k*|ay|"), {"steering_offset"}),
        (("steering_offset", "gyro_scale", "gyro_z: k*|r|", "accel_y: k*|ay|"), set()),
        (("tyre_saturation", RATIO, "gyro_z: k*ax*ay", "accel_y: k*ay^3"), set()),
        (("tyre_saturation", RATIO, "gyro_x: k*ax*ay", "accel_y: k*ax*ay"), set()),
        ((RATIO, "steering_backlash", "gyro_z: k*delta'"), {RATIO, "steering_backlash"}),
        (("tyre_relaxation", "low_friction", "gyro_z: k*ay*|ay|"), {"tyre_relaxation", "low_friction"}),
        (("tyre_saturation", "mass_loading", "gyro_scale", "gyro_z: k*r'"), {"tyre_saturation", "mass_loading"}),
        ((RATIO, "steering_offset", "gyro_z: k*vx*vy"), {RATIO}),
        ((RATIO, "steering_offset", "gyro_z: k*delta"), {RATIO, "steering_offset"}),
        ((RATIO, "steering_offset", "gyro_z: k*delta'"), {RATIO}),
        (("steering_offset", "gyro_scale", "accel_y: k*delta"), set()),
        (("steering_offset", "gyro_scale", "rear steering: k*delta"), {"steering_offset"}),
        (("steering_offset", "gyro_scale", "steering: k*vx^2"), set()),
        ((RATIO, "gyro_z: k*r^3"), set()),
        ((RATIO, "gyro_z: k*ax where ax > 0"), set()),
        ((RATIO, "gyro_x: k*ay"), set()),
        ((RATIO, "locked_axle", "gyro_scale"), {RATIO, "locked_axle"}),
        (("gyro_scale", "accel_scale", "gyro_z: k*r where r > 0"), {"gyro_scale"}),
        (("gyro_scale", "accel_scale", "accel_y: k*ay*t"), {"accel_scale"}),
        (("gyro_scale", "accel_scale", "gyro_z: k*r^3"), set()),
        (("gyro_scale", "accel_scale", "accel_y: k*sign(ay)"), {"accel_scale"}),
        (("gyro_scale", "accel_scale", "accel_y: k*sign(ax)"), set()),
        (("gyro_g_sensitivity", "gyro_scale", "gyro_z: k*sign(ay)"), {"gyro_g_sensitivity", "gyro_scale"}),
        (("gyro_g_sensitivity", "gyro_scale", "gyro_z: k*sign(r)"), {"gyro_g_sensitivity", "gyro_scale"}),
        (("gyro_g_sensitivity", "gyro_scale", "gyro_z: k*sign(ax)"), set()),
        (("gyro_g_sensitivity", "accel_scale", "accel_y: k*sign(ay)"), {"accel_scale"}),
        (("gyro_g_sensitivity", "gyro_scale", "gyro_x: k*sign(ay)"), set()),
        ((RATIO, "cornering_stiffness", "tyres: k*t"), {"cornering_stiffness"}),
        (("mass_loading", "steering_compliance", "tyres: k*vx^2"), {"mass_loading", "steering_compliance"}),
        ((RATIO, "cornering_stiffness", "yaw moment: k*vx^2*ay"), {RATIO, "cornering_stiffness"}),
        (("cornering_stiffness", "gyro_scale", "yaw moment: k*vx^2*ay"), {"cornering_stiffness"}),
        ((RATIO, "gyro_scale", "yaw moment: k*vx^2*ay"), set()),
        (("cornering_stiffness", "gyro_scale", "yaw moment: k*sign(r/vx)"), set()),
        (("road_bank", "gyro_z: k*vx^2"), {"road_bank"}),
        (("road_bank", "accel_y: k*vx^2"), {"road_bank"}),
        (("road_bank", "accel_x: k*vx^2"), set()),
        (("road_bank", "steering: k*vx^2"), set()),
        (("gyro_g_sensitivity", "gyro_scale", "gyro_z: k*sat(r/0.02)"), {"gyro_g_sensitivity", "gyro_scale"}),
        (("gyro_scale", "accel_scale", "gyro_z: k*r where |r| < 0.03"), {"gyro_scale"}),
        (("gyro_scale", "accel_scale", "accel_y: k*sat(ay/0.3)"), {"accel_scale"}),
        (("gyro_scale", "accel_scale", "accel_y: k*(play(ay, 0.3)-ay)"), set()),
        (("imu_misalignment", "accel_scale", "accel_y: k*(t > 45.0 s)"), {"imu_misalignment"}),
        (("imu_misalignment", "accel_scale", "accel_x: k*(t > 45.0 s)"), {"imu_misalignment"}),
        (("imu_misalignment", "accel_scale", "accel_y: k*(18.0 s < t < 33.0 s)"), set()),
        (("imu_misalignment", "accel_scale", "gyro_z: k*(t > 45.0 s)"), set()),
    ],
)
@pytest.mark.parametrize("is_told", [True, False])
def test_beside_what_has_no_name_nothing_is_named_that_it_explains(
    monkeypatch: pytest.MonkeyPatch, effects: tuple[str, ...], silent: set[str], is_told: bool
) -> None:
    """Of what is named beside an axle that is locked, for that has to be told."""
    monkeypatch.setattr(unnamed, "is_told", lambda *_: is_told)
    monkeypatch.setattr(unnamed, "is_unfelt", lambda _: True)
    fit: Any = SimpleNamespace(effects=effects)
    if "locked_axle" in effects and not is_told:
        silent = {"locked_axle"}
    drive_of_none: Any = SimpleNamespace()
    assert not_named(drive_of_none, fit, effects) & set(effects) == silent
    # What a car does and gains too little to be said is no ground; what a sensor does is said always.
    by_sensors = any(effect.startswith(("gyro_z: ", "accel_x: ", "accel_y: ")) for effect in effects)
    unsaid = silent if by_sensors else silent & {"locked_axle"}
    assert not_named(drive_of_none, fit, ()) & set(effects) == unsaid


LEAN, SCALE = INDEX["suspension_roll.roll_gradient_rad_per_mps2"], INDEX["accel_scale.y"]


@pytest.mark.parametrize(
    ("spreads", "is_felt", "is_one"), [(3.0, False, True), (5.0, False, False), (3.0, True, False)]
)
def test_without_a_gyro_a_lean_and_a_scale_that_undo_each_other_are_none(
    spreads: float, is_felt: bool, is_one: bool
) -> None:
    measured = np.full((10, 13), 0.0 if is_felt else np.nan)
    x = nothing()
    x[LEAN], x[SCALE] = 0.02, -0.2
    effects = ("accel_scale", "suspension_roll")
    fit: Any = SimpleNamespace(effects=effects, x=x, columns=(LEAN, SCALE), std=np.array([0.02 / spreads, 0.1]))
    silent = not_named(SimpleNamespace(measured=measured), fit, effects)  # type: ignore[arg-type]
    assert silent & set(effects) == (set(effects) if is_one else set())


@pytest.mark.parametrize(
    ("tilt", "scale", "gyro", "other"),
    [
        ("suspension_roll.roll_gradient_rad_per_mps2", "accel_scale.y", "gyro_x", "gyro_y"),
        ("suspension_pitch.pitch_gradient_rad_per_mps2", "accel_scale.x", "gyro_y", "gyro_x"),
    ],
)
@pytest.mark.parametrize(
    ("undone", "sign", "beside", "is_none"),
    [
        (1.1, -1.0, True, True),
        (0.9, -1.0, True, True),
        (0.7, -1.0, True, False),
        (1.3, -1.0, True, False),
        (1.0, 1.0, True, False),
        (1.0, -1.0, False, False),
    ],
)
def test_what_a_gyro_shows_by_itself_is_no_lean_that_a_scale_takes_back(
    tilt: str, scale: str, gyro: str, other: str, undone: float, sign: float, beside: bool, is_none: bool
) -> None:
    x = nothing()
    x[INDEX[scale]], x[INDEX[tilt]] = sign * 0.06, undone * 0.06 / G
    effects = (tilt.partition(".")[0], "accel_scale", f"{gyro if beside else other}: k*r'")
    fit: Any = SimpleNamespace(effects=effects, x=x, columns=())
    silent = not_named(SimpleNamespace(measured=np.zeros((10, 13))), fit, effects)  # type: ignore[arg-type]
    assert silent & set(effects) == (set(effects[:2]) if is_none else set())


@pytest.mark.parametrize(
    ("resistance", "apart", "silent"), [(2.0, False, True), (0.0, False, True), (1.2, False, False), (2.0, True, False)]
)
def test_of_wheels_that_slip_radii_of_an_axle_are_told_where_resistance_is(
    monkeypatch: pytest.MonkeyPatch, resistance: float, apart: bool, silent: bool
) -> None:
    asked = []
    monkeypatch.setattr(unnamed, "are_apart", lambda _, __, *pair: bool(asked.append(pair)) or apart)
    x = nothing()
    x[INDEX["wheel_slip.resistance"]] = resistance
    fit: Any = SimpleNamespace(effects=("wheel_slip", "wheel_radius"), x=x)
    one = drive({}, CITY_V, CITY_STEER)
    assert ("wheel_radius" in not_named(one, fit, fit.effects)) is silent
    sides = [[INDEX[f"wheel_radius.{wheel}"] for wheel in pair] for pair in (("fl", "fr"), ("rl", "rr"))]
    assert [list(pair) for pair in asked] == sides[: 0 if resistance == 1.2 else 1 if apart else 2]


@pytest.mark.parametrize(
    ("rough", "off", "silent"),
    [
        ((1.0, 1.0, 50.0, 1.0), "rl", True),
        # Where the others are alike, and where they are not.
        ((1.0, 1.0, 1.6, 1.0), "rl", True),
        ((1.0, 1.0, 4.0, 1.0), "rl", True),
        ((1.0, 1.0, 1.4, 1.0), "rl", False),
        ((1.0, 1.0, 1.4, 1.2), "rl", False),
        ((1.0, 1.0, 2.1, 1.2), "rl", False),
        ((1.0, 1.0, 2.2, 1.2), "rl", True),
        ((1.0, 1.0, 4.0, 1.7), "rl", False),
        ((1.0, 1.0, 4.9, 2.0), "rl", False),
        ((1.0, 1.0, 5.1, 2.0), "rl", True),
        ((1.0, 1.0, 50.0, 1.0), "fr", False),
        ((1.0, 1.0, 50.0, 60.0), "rl", True),
        ((50.0, 50.0, 50.0, 50.0), "rl", False),
        ((1.0, 0.0, 1.0, 1.0), "rl", False),
        ((1.0, np.nan, 1.0, 1.0), "rl", False),
        ((0.0, 0.0, 0.0, 0.0), "rl", False),
    ],
)
def test_a_wheel_whose_teeth_are_uneven_is_not_a_larger_one(rough: tuple[float, ...], off: str, silent: bool) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    one.recording.floor[6:10] = 2e-3 * np.array(rough)
    radii = tuple(INDEX[f"wheel_radius.{wheel}"] for wheel in ("fl", "fr", "rl", "rr"))
    x = nothing()
    x[INDEX[f"wheel_radius.{off}"]] = 0.015
    fit: Any = SimpleNamespace(effects=("wheel_radius",), x=x, columns=radii, covariance=1e-8 * np.eye(4))
    assert ("wheel_radius" in not_named(one, fit, fit.effects)) is silent
    assert "wheel_radius" not in not_named(one, SimpleNamespace(effects=()), ())  # type: ignore[arg-type]


def test_a_bank_that_a_roll_gyro_feels_is_named_beside_anything(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unnamed, "is_unfelt", lambda _: False)
    fit: Any = SimpleNamespace(effects=("road_bank", "gyro_z: k*vx^2"))
    assert "road_bank" not in not_named(SimpleNamespace(), fit, fit.effects)  # type: ignore[arg-type]


@pytest.mark.parametrize(("over_a_scale", "is_taken"), [(1.15, False), (1.25, True)])
@pytest.mark.parametrize("course", ["r where r > 0", "r^3"])
def test_an_uneven_scale_has_to_explain_a_fifth_more_than_a_name(
    monkeypatch: pytest.MonkeyPatch, course: str, over_a_scale: float, is_taken: bool
) -> None:
    """And another shape a twentieth."""
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    level = fitted(one, rows, nothing(), (), TOLERANCE)
    shape = Found(as_effect("gyro_z", course, CITY_STEER, "1", 1.0), "gyro_z", f"k*{course}", 1.0, 0.0, 1.0, 0.1)
    shape = shape._replace(gain=100.0 * over_a_scale)
    monkeypatch.setattr(search, "likeliest_shapes", lambda *_, **__: [shape])
    monkeypatch.setattr(search, "_shaped", lambda *_: (one, level, shape))
    trial: Any = SimpleNamespace(drive=one, rows=rows, best=level, tolerance=TOLERANCE, known=None)
    found = search._nameless(trial, [Step("gyro_scale", 100.0, level)], {}, map)
    assert (found is not None) is (is_taken or course == "r^3")


@pytest.mark.parametrize("more_mps", [0.6, -0.3])
def test_wheels_that_show_a_constant_more_are_no_scale_and_no_ratio(more_mps: float) -> None:
    """As long as they roll: what the IMU shows is of another speed than they tell."""
    v = np.where((T > 20.0) & (T < 26.0), 0.0, CITY_V)
    made = drive({}, v, CITY_STEER)
    reads = np.where(made.wheels > 0.0, made.wheels + more_mps, 0.0)
    one = drive_of(made.recording._replace(wheels_mps=reads), made.car, made.steering_ratio)
    shown = made.measured.copy()
    shown[:, 6:8] += np.where(v > 0.0, more_mps, 0.0)[:, np.newaxis]
    said = answered(found(one._replace(measured=shown)))
    assert said.causes == []
    assert [(shape.channel, shape.shape) for shape in said.unlisted] == [
        (f"wheel_speed_{wheel}", "k where vx > 0") for wheel in ("fl", "fr", "rl", "rr")
    ]
    assert said.unlisted[0].coefficient.value == pytest.approx(more_mps, rel=0.1)
    assert said.unlisted[0].coefficient.unit == "m/s"


def test_readings_and_rolling_undo_each_other() -> None:
    x = nothing()
    x[INDEX["wheels_more.offset_mps"]] = 0.4
    rolled = np.array([[0.0, 0.3, 0.7, 20.0]])
    np.testing.assert_allclose(as_they_read(rolled, x), [[0.0, 0.3, 1.1, 20.4]])
    np.testing.assert_allclose(as_they_roll(as_they_read(rolled, x), x), rolled)


@pytest.mark.parametrize(("hz", "bounces"), [(0.2, False), (0.45, False), (0.55, True), (1.5, True)])
@pytest.mark.parametrize("road", ["road_bank", "road_grade"])
def test_what_tilts_as_quickly_as_a_body_on_its_springs_is_no_road(hz: float, bounces: bool, road: str) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    tilt = 0.01 * np.sin(2.0 * np.pi * hz * T)
    profile = {"road_bank": "bank_rad", "road_grade": "grade_rad"}[road]
    fit: Any = SimpleNamespace(
        effects=(road,), road=flat(N)._replace(**{profile: tilt}), x=nothing(), left=np.zeros((len(rows.at), 13))
    )
    assert plausible._bounces(fit, road) is bounces
    # By as much beside a slow one.
    slow = fit.road._replace(**{profile: tilt + 0.012 * np.sin(0.5 * T)})
    assert not plausible._bounces(SimpleNamespace(road=slow), road)  # type: ignore[arg-type]


def lifted(k: float, without: tuple[int, ...] = ()) -> Drive:
    """A nose that lifts by k v^2, of what that is: what pushes ahead and up, a pitch rate, a turn in the roll gyro."""
    v_rate = np.gradient(CITY_V, T)
    r = predicted(drive({}, CITY_V, CITY_STEER), nothing(), flat(N))[:, 2]

    def change(one: Drive) -> None:
        lift = k * CITY_V**2
        one.measured[:, 0] += lift * r
        one.measured[:, 1] -= 2.0 * k * CITY_V * v_rate
        one.measured[:, 3] += G * lift
        one.measured[:, 5] -= v_rate * lift
        one.measured[:, without] = np.nan

    return drive({}, CITY_V, CITY_STEER, change=change)


@pytest.mark.parametrize("k", [1e-4, -6e-5])
def test_a_nose_that_lifts_with_the_speed_is_no_road(k: float) -> None:
    said = answered(found(lifted(k)))
    assert said.causes == []
    [shape] = said.unlisted
    assert (shape.channel, shape.shape) == ("accel_x", "k*vx^2")
    assert shape.coefficient.value == pytest.approx(G * k, rel=0.03)


def test_where_no_gyro_feels_a_nose_lift_it_is_an_accelerometers_own() -> None:
    one = lifted(1e-4, without=(0, 1, 5))
    rows = rows_of(one)
    screening = screened(one, rows, fitted(one, rows, nothing(), (), TOLERANCE), TOLERANCE, map)
    assert "nose_lift" not in screening.of_effects
    said = answered(found(one))
    assert said.causes == []
    assert [(shape.channel, shape.shape) for shape in said.unlisted] == [("accel_x", "k*vx^2")]


def test_a_nose_lift_leaves_the_car_alone() -> None:
    """Nothing of the motion is another: only what an IMU shows."""
    one = drive({}, CITY_V, CITY_STEER)
    x = nothing()
    x[INDEX["nose_lift.rad_per_v2"]] = 1e-4
    change = predicted(one, x, flat(N)) - predicted(one, nothing(), flat(N))
    assert np.all(change[:, [2, *range(6, 13)]] == pytest.approx(0.0, abs=1e-4))
    again = predicted(one, nothing(), flat(N)) - predicted(one, nothing(), flat(N))
    assert not again.any()
