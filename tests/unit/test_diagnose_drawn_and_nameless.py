"""Front wheels that are drawn for small angles, tyres that grow, an IMU's clock: none of them gets another's name."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_cases import TUCSON
from test_diagnose_choices import CITY_STEER, CITY_V, NOISE, TOLERANCE, N, T, drive, found

from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting import drawings
from dsz_daemon.diagnose.fitting.drawings import WHEELS, as_drawn, told, untold
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import values_of
from dsz_daemon.diagnose.recordings.recording import DT_S, Recording
from dsz_daemon.diagnose.residuals.comparison import rows_of, sensitivities
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.selection.smaller import asked_of
from dsz_daemon.diagnose.simulation.angles import at_a_side, drawn
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.simulation.instruments import delayed, rolled
from dsz_daemon.diagnose.simulation.motion import AY, DELTA, VY, R
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.simulation.rolling import _of_the_front
from dsz_daemon.diagnose.simulation.slow_sensors import smoothed
from dsz_daemon.diagnose.simulation.wheel_readings import as_they_read, as_they_roll
from dsz_daemon.diagnose.verdict import another_car
from dsz_daemon.diagnose.verdict.answer import answered

SHARP_STEER = 0.25 * np.sin(0.5 * T)
SLOW_V = 6.0 + 2.0 * np.sin(0.3 * T)


def with_(**values: float) -> np.ndarray:
    x = nothing()
    for name, value in values.items():
        x[INDEX[name.replace("__", ".")]] = value
    return x


@pytest.mark.parametrize(
    ("small", "unturned", "cos", "sin"),
    [(0.0, 0.0, math.cos(0.3), math.sin(0.3)), (1.0, 0.0, 1.0, 0.3), (0.0, 1.0, 1.0, 0.0), (1.0, 0.5, 1.0, 0.15)],
)
def test_a_wheel_is_drawn_as_it_is_for_small_angles_or_unturned(
    small: float, unturned: float, cos: float, sin: float
) -> None:
    assert drawn(0.3, small, unturned) == pytest.approx((cos, sin))
    moved = np.zeros((1, 12))
    moved[0, [VY, R, DELTA]] = 0.4, 0.5, 0.3
    ones, still = np.ones(4), np.zeros(1)
    wheels = rolled(moved, np.array([8.0]), still, still, 1.2, 1.5, 1.6, ones, 0.0, small, unturned)[0]
    across = (0.4 + 1.2 * 0.5) * sin
    assert wheels[:2] == pytest.approx([(8.0 - 0.375) * cos + across, (8.0 + 0.375) * cos + across])
    # The rear ones are not turned.
    assert wheels[2:] == pytest.approx([8.0 - 0.4, 8.0 + 0.4])


@pytest.mark.parametrize(("front_n_per_rad", "rear_n_per_rad"), [(3e4, 9e4), (9e4, 6e4)])
def test_what_front_wheels_roll_tells_the_speed_of_a_car_that_turns_less_or_more_than_it_is_steered(
    front_n_per_rad: float, rear_n_per_rad: float
) -> None:
    """Against a steady bend of a linear single-track car, solved for its sideslip and yaw rate; two tyres an axle."""
    m, lf, lr, v, delta = 1500.0, 1.2, 1.4, 12.0, 0.1
    car = Car(m, 2500.0, lf, lr, 1.5, 1.5, front_n_per_rad, rear_n_per_rad, True, False, 0.0, 0.0)
    front, rear = 2.0 * front_n_per_rad, 2.0 * rear_n_per_rad
    forces = [
        [front + rear, front * lf - rear * lr + m * v * v],
        [front * lf - rear * lr, front * lf**2 + rear * lr**2],
    ]
    vy, r = np.linalg.solve(np.array(forces) / v, [front * delta, front * lf * delta])
    rolls = v * math.cos(delta) + (vy + lf * r) * math.sin(delta)
    found = _of_the_front(car, np.array([delta]), np.array([rolls]), 0.0, 0.0)[0]
    assert found == pytest.approx(v / rolls, abs=2e-4)


def test_an_inner_wheel_slips_more_by_its_own_axles_track_and_a_larger_one_turns_less() -> None:
    """At 5 m/s2 to the left, h = 0.5 m: of the left one's half of the load 2 m a h / (m g t) is gone."""
    moved, g = np.zeros((1, 12)), 9.80665
    moved[0, AY] = 5.0
    front_slip, rear_slip = np.array([0.02]), np.array([-0.01])
    radii = np.array([1.0, 1.01, 0.99, 1.02])
    wheels = rolled(moved, np.array([20.0]), front_slip, rear_slip, 1.2, 1.5, 1.8, radii, 0.5)[0]
    front, rear = 2.0 * 0.5 * 5.0 / (g * 1.5), 2.0 * 0.5 * 5.0 / (g * 1.8)
    slips = [0.02 * (1.0 + front), 0.02 * (1.0 - front), -0.01 * (1.0 + rear), -0.01 * (1.0 - rear)]
    assert wheels == pytest.approx([20.0 * (1.0 + slip) / radius for slip, radius in zip(slips, radii, strict=True)])


def test_what_front_wheels_tell_of_the_speed_is_drawn_likewise() -> None:
    """Without sideslip at the axle (tyres as stiff as can be) they go along delta: cos delta, or 1 + delta^2 over."""
    stiff = Car(1500.0, 2500.0, 1.2, 1.4, 1.5, 1.5, 1e9, 1e9, True, False, 0.0, 0.0)
    steer, rolls = np.array([0.3]), np.array([5.0])
    assert _of_the_front(stiff, steer, rolls, 0.0, 0.0)[0] == pytest.approx(math.cos(0.3), rel=1e-6)
    small = 1.0 / (1.0 + 0.3 * math.tan(0.3))
    assert _of_the_front(stiff, steer, rolls, 1.0, 0.0)[0] == pytest.approx(small, rel=1e-6)
    assert _of_the_front(stiff, steer, rolls, 0.0, 1.0)[0] == pytest.approx(1.0)


def test_front_wheels_for_small_angles_are_no_physics_left_out() -> None:
    one = drive({"small_wheels": 1.0}, SLOW_V, SHARP_STEER)
    said = answered(found(one))
    assert (said.verdict, said.causes, said.unlisted) == ("consistent", [], [])
    assert max(said.level.values()) < 1.5
    # And it is that.
    plain = fitted(one, rows_of(one), untold(nothing(), one.steer), (), TOLERANCE)
    assert plain.x[INDEX["small_wheels"]] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("apart", [0.0, 1.0])
@pytest.mark.parametrize(
    ("small", "unturned", "is_told"), [(0.0, 0.0, True), (1.0, 0.0, True), (0.0, 1.0, True), (0.5, 0.0, False)]
)
def test_what_is_near_a_drawing_is_it_and_no_number_more(
    small: float, unturned: float, is_told: bool, apart: float
) -> None:
    numbers = {"small_wheels": small, "unturned_wheels": unturned, "wheels_apart": apart * (1.0 - unturned)}
    nominal = found(drive(numbers, SLOW_V, SHARP_STEER)).nominal
    turned, at = WHEELS[:2], nominal.x[list(WHEELS)].tolist()
    assert WHEELS[2] not in nominal.columns
    assert at[2] == apart or unturned == 1.0
    assert not set(turned).intersection(nominal.columns) if is_told else set(turned) <= set(nominal.columns)
    assert at[:2] == [small, unturned] if is_told else at[:2] == pytest.approx([small, unturned], abs=0.1)


def near_to(x: np.ndarray, *spreads: float) -> np.ndarray | None:
    """`as_drawn` of numbers that are told so well."""
    return as_drawn(x, np.array(spreads), WHEELS)


@pytest.mark.parametrize(
    ("small", "unturned", "drawing"),
    [
        (0.2, -0.2, (0.0, 0.0, 1.0)),
        (0.8, 0.2, (1.0, 0.0, 1.0)),
        (-0.1, 1.2, (0.0, 1.0, 0.0)),
        (0.5, 0.8, (0.0, 1.0, 0.0)),
        (0.3, 0.0, None),
        (1.0, 0.3, None),
        (0.0, 0.7, None),
    ],
)
def test_which_drawing_is_near(small: float, unturned: float, drawing: tuple[float, float, float] | None) -> None:
    x = with_(small_wheels=small, unturned_wheels=unturned, wheels_apart=1.0, offset_gyro_z=0.1)
    assert told(x) == {WHEELS[2]}
    near = near_to(x, 0.1, 0.1, 0.1)
    assert (near is None) is (drawing is None)
    if near is not None:
        assert tuple(near[list(WHEELS)]) == drawing
        assert told(near) == set(WHEELS)
        assert near[INDEX["offset_gyro_z"]] == 0.1


def test_what_is_hardly_told_is_no_drawing_yet() -> None:
    """Small angles and none at all are hardly told apart where little else is: then only the latter counts."""
    x = with_(small_wheels=0.9, unturned_wheels=0.1)
    assert near_to(x, 0.2, 0.2, 0.1) is not None
    assert near_to(x, 0.3, 0.2, 0.1) is None
    assert near_to(x, 0.2, 0.3, 0.1) is None
    unturned = with_(small_wheels=0.9, unturned_wheels=0.9)
    assert near_to(unturned, 9.0, 0.2, 0.1) is not None
    assert near_to(unturned, 0.1, 0.3, 0.1) is None
    # Nor is what is not fitted.
    assert as_drawn(x, np.zeros(0), ()) is None


@pytest.mark.parametrize(
    ("apart", "spread", "near"),
    [(-0.5, 0.4, 0.0), (0.45, 0.4, 0.0), (0.55, 0.4, 1.0), (1.5, 0.4, 1.0), (1.2, 0.6, None), (1.0, 0.4, None)],
)
def test_wheels_are_turned_alike_or_not(apart: float, spread: float, near: float | None) -> None:
    drawn_so = near_to(with_(wheels_apart=apart), 0.1, 0.1, spread)
    assert (None if drawn_so is None else drawn_so[WHEELS[2]]) == near


@pytest.mark.parametrize("small", [0.0, 1.0])
def test_how_wheels_are_drawn_is_told_beside_what_was_left_out(small: float) -> None:
    """A ratio hides it at first; with that in the model it is one drawing, as of any other car."""
    search = found(drive({"small_wheels": small, "steering_ratio.scale": -0.15}, SLOW_V, SHARP_STEER))
    assert set(WHEELS) <= set(search.nominal.columns)
    assert search.best.effects == ("steering_ratio",)
    assert search.best.x[list(WHEELS)].tolist() == [small, 0.0, 0.0]


RADII = {"wheel_radius.rl": -0.025, "wheel_radius.rr": -0.02}


def test_wheels_that_read_more_all_the_way_are_drawn_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rear radii 2 % too large look at first as if the front wheels were never turned."""
    one = drive(RADII, SLOW_V, SHARP_STEER)
    search = found(one)
    assert search.nominal.x[list(WHEELS)].tolist() == [0.0, 1.0, 0.0]
    assert search.best.effects == ("wheel_radius",)
    assert search.best.x[list(WHEELS)].tolist()[:2] == [0.0, 0.0]
    for name, value in RADII.items():
        assert search.best.x[INDEX[name]] == pytest.approx(value, abs=0.0005)
    assert search.best.x[INDEX["wheel_radius.fl"]] == pytest.approx(0.0, abs=0.0005)
    monkeypatch.setattr("dsz_daemon.diagnose.selection.drawn.far_off", lambda *_: np.zeros(13, dtype=bool))
    kept = found(one).best
    assert kept.x[list(WHEELS)].tolist()[:2] != [0.0, 0.0] or "wheel_radius" not in kept.effects


@pytest.mark.parametrize(("most_rad", "free"), [(0.075, 0), (0.085, 2), (0.145, 2), (0.155, 3)])
def test_front_wheels_are_asked_of_where_they_are_turned(most_rad: float, free: int) -> None:
    x = untold(nothing(), most_rad * np.sin(T))
    assert len(WHEELS) - len(told(x)) == free


@pytest.mark.parametrize("delta", [0.3, -0.2])
def test_a_wheel_at_a_side_rolls_about_where_the_car_turns(delta: float) -> None:
    """Ackermann: cot of the left = cot of the middle - track / 2 over the wheelbase; of the right, plus."""
    for nearer in (0.27, -0.27):
        angle = math.atan(1.0 / (1.0 / math.tan(delta) - nearer))
        assert at_a_side(math.cos(delta), math.sin(delta), nearer) == pytest.approx((math.cos(angle), math.sin(angle)))


def test_wheels_apart_roll_with_no_sideslip_what_their_paths_are() -> None:
    """A car that rolls about one point: each front wheel's speed is yaw rate times its distance from there."""
    delta, r, lf, lr, track = 0.35, 0.6, 1.2, 1.5, 1.6
    radius = (lf + lr) / math.tan(delta)
    moved_row = np.zeros((1, 12))
    moved_row[0, [VY, R, DELTA]] = lr * r, r, delta
    ones, still = np.ones(4), np.zeros(1)
    nearer = 0.5 * track / (lf + lr)
    wheels = rolled(moved_row, np.array([r * radius]), still, still, lf, track, 1.5, ones, 0.0, 0.0, 0.0, nearer)[0]
    assert wheels[:2] == pytest.approx([r * math.hypot(radius - side * track / 2, lf + lr) for side in (1.0, -1.0)])


def test_what_wheels_tell_of_a_compliance_is_not_taken_by_how_they_are_drawn() -> None:
    """With both numbers free, what front wheels tell of how far they are turned is told a third as well."""
    one = drive({"steering_compliance.rad_per_n": 2e-6}, SLOW_V, SHARP_STEER)
    rows, effects = rows_of(one), ("steering_compliance",)
    sure = fitted(one, rows, nothing(), effects, TOLERANCE)
    free = fitted(one, rows, untold(nothing(), one.steer), effects, TOLERANCE)
    place = INDEX["steering_compliance.rad_per_n"]
    of_wheels = [float(np.diag(fit.covariance)[fit.columns.index(place)]) for fit in (sure, free)]
    assert of_wheels[1] > 4.0 * of_wheels[0]
    # Of softer tyres it is told by these wheels alone: no better than by half of what tyres may be off.
    by_tyres = 0.5 * 0.1 / (2.0 * one.car.front_cornering_stiffness_n_per_rad)
    for fit, variance in zip((sure, free), of_wheels, strict=True):
        value, spread = values_of(one, fit, effects[0])["rad_per_n"]
        assert spread == pytest.approx(math.hypot(math.sqrt(variance), by_tyres), rel=0.02)
        assert 1.96 * spread > abs(value - 2e-6)
        # That is no doubt of there being one.
        told = values_of(one, fit, effects[0], as_fitted=True)["rad_per_n"]
        assert told == (value, fit.std[fit.columns.index(place)])
        assert math.sqrt(variance) <= told[1] < 1.2 * math.sqrt(variance) < 0.9 * spread
    without = fitted(one, rows, nothing(), effects, {})
    assert values_of(one, without, effects[0])["rad_per_n"][1] < 0.5 * by_tyres


def textbook_car(car: Car, v: np.ndarray, steer: np.ndarray, turned_wheels: float | None) -> Recording:
    """The linear single track as textbooks have it, in steps of 1 ms, with front wheels for small angles, and noise.

    `turned_wheels`: 0 where front wheels roll as rear ones do, however they are turned; None where each is turned by
    the angle of its own circle (Ackermann).
    """
    steps, rng = 10, np.random.default_rng(7)
    lf, lr = car.cg_to_front_axle_m, car.cg_to_rear_axle_m
    front, rear = 2.0 * car.front_cornering_stiffness_n_per_rad, 2.0 * car.rear_cornering_stiffness_n_per_rad
    fine = np.arange(N * steps) / steps
    speeds, angles = (np.interp(fine, np.arange(N), values) for values in (v, steer))
    vy, r, rows = 0.0, 0.0, np.empty((N * steps, 3))
    for i, (u, delta) in enumerate(zip(speeds.tolist(), angles.tolist(), strict=True)):
        side = -front * ((vy + lf * r) / u - delta), -rear * (vy - lr * r) / u
        across = (side[0] + side[1]) / car.mass_kg
        rows[i] = vy, r, across
        vy += 0.001 * (across - r * u)
        r += 0.001 * (lf * side[0] - lr * side[1]) / car.yaw_inertia_kgm2
    vy_mps, r_radps, ay = rows[::steps].T
    still = np.zeros(N)
    imu = np.stack([still, still, r_radps, np.gradient(v, DT_S) - r_radps * vy_mps, ay, still + 9.80665], axis=1)
    half = 0.5 * r_radps * car.front_track_m, 0.5 * r_radps * car.rear_track_m
    if turned_wheels is None:
        beside = 0.5 * car.front_track_m / (lf + lr)
        angles = [np.arctan(np.tan(steer) / (1.0 - side * beside * np.tan(steer))) for side in (1.0, -1.0)]
        fronts = [
            (v - side * half[0]) * np.cos(angle) + (vy_mps + lf * r_radps) * np.sin(angle)
            for side, angle in zip((1.0, -1.0), angles, strict=True)
        ]
    else:
        turned = v + turned_wheels * (vy_mps + lf * r_radps) * steer
        fronts = [turned - half[0], turned + half[0]]
    wheels = np.stack([*fronts, v - half[1], v + half[1]], axis=1)

    def noise(rms: float) -> np.ndarray:
        return np.convolve(rng.normal(size=N), np.ones(15) / 15**0.5, "same") * rms

    for c, rms in enumerate(NOISE):
        imu[:, c] += noise(rms)
    for c in range(4):
        wheels[:, c] += noise(2e-3)
    return Recording(T, steer, wheels, imu, np.array([*NOISE, *[2e-3] * 4]))


@pytest.mark.parametrize("turned_wheels", [0.0, 1.0])
@pytest.mark.parametrize("by_front", [False, True])
def test_a_textbooks_car_in_town_is_consistent(
    monkeypatch: pytest.MonkeyPatch, by_front: bool, turned_wheels: float
) -> None:
    car = TUCSON._replace(front_driven=not by_front, rear_driven=by_front)
    one = drive_of(textbook_car(car, SLOW_V, SHARP_STEER, turned_wheels), car, 16.0)
    assert one.front_gives_speed is by_front
    said = answered(found(one))
    assert (said.verdict, said.causes, said.unlisted) == ("consistent", [], [])
    assert max(level for channel, level in said.level.items() if channel.startswith("wheel")) < 2.0
    # With front wheels as they are it is not.
    monkeypatch.setattr(drawings, "_FROM_RAD", 1.0)
    said = answered(found(one))
    assert said.verdict != "consistent"
    assert max(level for channel, level in said.level.items() if channel.startswith("wheel")) > 3.0


@pytest.mark.parametrize("by_front", [False, True])
def test_wheels_that_each_roll_on_a_circle_of_their_own_are_consistent(
    monkeypatch: pytest.MonkeyPatch, by_front: bool
) -> None:
    car = TUCSON._replace(front_driven=not by_front, rear_driven=by_front)
    one = drive_of(textbook_car(car, SLOW_V, 1.6 * SHARP_STEER, None), car, 16.0)
    assert one.front_gives_speed is by_front
    there = found(one)
    said = answered(there)
    assert (said.verdict, said.causes, said.unlisted) == ("consistent", [], [])
    assert max(level for channel, level in said.level.items() if channel.startswith("wheel")) < 2.0
    assert there.nominal.x[list(WHEELS)].tolist() == [0.0, 0.0, 1.0]
    # As if both were turned alike it is not.
    monkeypatch.setattr(drawings, "_APART_FROM_RAD", 1.0)
    said = answered(found(one))
    assert said.verdict != "consistent" or max(said.level.values()) > 2.0


@pytest.mark.parametrize("per_v2", [7e-5, 3e-6, -2e-5])
def test_tyres_that_grow_read_less_the_faster_they_turn(per_v2: float) -> None:
    rolls = np.array([[5.0, 10.0, 20.0, 35.0]])
    x = with_(wheel_growth__per_v2=per_v2)
    reads = as_they_read(rolls, x)
    np.testing.assert_allclose(reads, rolls / (1.0 + per_v2 * rolls**2), rtol=1e-12)
    np.testing.assert_allclose(as_they_roll(reads, x), rolls, rtol=1e-9)


def test_a_wheels_square_is_its_own() -> None:
    rolls, x = np.full((1, 4), 10.0), with_(wheel_square__rl=1e-3)
    assert as_they_read(rolls, x).tolist() == [[10.0, 10.0, 10.1, 10.0]]
    assert as_they_roll(rolls, x).tolist() == [[10.0, 10.0, 9.9, 10.0]]


def test_a_clock_that_is_off_comes_later_and_later_about_the_middle() -> None:
    values = np.arange(1001.0)[:, np.newaxis]
    late = delayed(values, 0.05, 0.01, 0.002)[:, 0]
    # Five rows late in the middle, and a 500th of the rows since.
    assert late[[250, 500, 750]] == pytest.approx([250 - 5.0 + 0.5, 500 - 5.0, 750 - 5.0 - 0.5], abs=0.01)


def test_a_clock_is_late_in_the_middle_beside_what_the_imu_is_late_by() -> None:
    values = np.arange(1001.0)[:, np.newaxis]
    late = smoothed(values, with_(imu_clock__late_s=0.02, imu_clock__per_s=0.002, imu_delay__delay_s=0.03))[:, 0]
    assert late[[250, 500, 750]] == pytest.approx([250 - 5.0 + 0.5, 500 - 5.0, 750 - 5.0 - 0.5], abs=0.01)
    early = smoothed(values, with_(imu_clock__late_s=-0.02))[:, 0]
    assert early[500] == pytest.approx(502.0)


def test_tyres_that_grow_have_no_name_and_no_scale_is_told_for_them() -> None:
    fast = 25.0 + 8.0 * np.sin(0.15 * T)
    told = answered(found(drive({"wheel_growth.per_v2": 1e-5}, fast, 0.25 * CITY_STEER)))
    assert told.causes == []
    shapes = {shape.channel: shape for shape in told.unlisted}
    assert set(shapes) == {f"wheel_speed_{wheel}" for wheel in ("fl", "fr", "rl", "rr")}
    assert {shape.shape for shape in shapes.values()} == {"k*vx^3"}
    coefficient = shapes["wheel_speed_fl"].coefficient
    assert coefficient.value == pytest.approx(-1e-5, abs=4.0 * coefficient.std)
    assert coefficient.std < 1e-6


@pytest.mark.parametrize(("gain", "shapes"), [(19.9, 0), (20.1, 4)])
def test_what_all_wheels_show_is_told_by_what_names_are(gain: float, shapes: int) -> None:
    fast = 25.0 + 8.0 * np.sin(0.15 * T)
    there = found(drive({"wheel_growth.per_v2": 1e-5}, fast, 0.25 * CITY_STEER))
    assert there.best.effects == ("wheel_growth",)
    assert len(answered(there._replace(gains={"wheel_growth": gain})).unlisted) == shapes


@pytest.mark.parametrize("drawing", ["small_wheels", "unturned_wheels", "wheel_growth.per_v2"])
def test_where_front_wheels_tell_the_speed_their_drawing_moves_all(drawing: str) -> None:
    car = TUCSON._replace(front_driven=False, rear_driven=True)
    one = drive_of(textbook_car(car, SLOW_V, SHARP_STEER, 1.0), car, 16.0)
    rows, x, i = rows_of(one), nothing(), INDEX[drawing]
    base, moved = predicted(one, x, flat(N)), x.copy()
    moved[i] = one.vocabulary.columns[i][1].step
    slope = sensitivities(one, rows, x, flat(N), base, [i])[:, :, 0]
    secant = (predicted(one, moved, flat(N)) - base)[rows.at] / moved[i]
    assert np.abs(secant[:, 2]).max() > 0.0
    np.testing.assert_allclose(slope[:, 2], secant[:, 2] * rows.used[:, 2], rtol=1e-9, atol=1e-12)


def test_inputs_that_are_all_late_are_no_clock_of_the_imu() -> None:
    """An IMU that is early by as much is the same, but no clock that goes evenly is off."""
    late = {"steering_delay.delay_s": 0.08, "wheel_speed_delay.delay_s": 0.1}
    one = drive(late, CITY_V, CITY_STEER)
    search = found(one)
    assert set(search.best.effects) == {"steering_delay", "wheel_speed_delay"}
    for name, value in late.items():
        assert search.best.x[INDEX[name]] == pytest.approx(value, abs=0.01)
    x = nothing()
    x[INDEX["imu_clock.late_s"]] = -0.1
    even = fitted(one, search.rows, x, ("imu_clock",), TOLERANCE)
    assert even.x[INDEX["imu_clock.late_s"]] < -0.05
    assert is_implausible(one, search.rows, even, "imu_clock")


def test_a_clock_that_is_off_is_no_delay() -> None:
    told = answered(found(drive({"imu_clock.per_s": 1e-3, "imu_clock.late_s": 0.03}, CITY_V, CITY_STEER)))
    assert told.causes == []
    shapes = [shape for shape in told.unlisted if shape.shape == "later by k*t"]
    assert [shape.channel for shape in shapes] == ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    assert shapes[0].coefficient.value == pytest.approx(1e-3, rel=0.1)


def test_a_delay_is_no_clock() -> None:
    told = answered(found(drive({"imu_delay.delay_s": 0.05}, CITY_V, CITY_STEER)))
    assert [cause.effect for cause in told.causes] == ["imu_delay"]
    assert told.unlisted == []


def test_what_is_asked_beside_tyres_that_grow_an_eccentric_sensor_and_play() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    assert asked_of(one, "track_width", {"wheel_growth": 1000.0}) == pytest.approx(100.0)
    assert asked_of(one, "gyro_scale", {"wheel_growth": 1000.0}) == pytest.approx(15.0)
    assert asked_of(one, "wheel_radius", {"wheel_slip": 1000.0}) == pytest.approx(50.0)
    assert asked_of(one, "side_wind", {"steering_backlash": 1000.0}) == pytest.approx(30.0)
    assert asked_of(one, "steering_backlash", {"side_wind": 1000.0}) == pytest.approx(15.0)
    hand = "steering: k*(1-cos(hand))"
    assert asked_of(one, "steering_ratio", {hand: 400.0}) == pytest.approx(400.0)
    assert asked_of(one, "steering_ratio", {"steering: k*vx^2": 400.0}) == pytest.approx(100.0)


def test_wheels_that_roll_as_no_car_does_are_no_other_cars(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rear wheels turn alike: a locked axle, whatever a car's numbers may be."""
    numbers = {"steering_ratio": 0.3, "cg_to_rear_axle_m": 0.2, "front_track_m": 0.05, "yaw_inertia_kgm2": 0.3}

    def locked(made: object) -> None:
        made.measured[:, 8] = 0.2 * np.sin(5.0 * T[:N])  # type: ignore[attr-defined]

    one = drive(numbers, CITY_V, CITY_STEER, change=locked)
    names = found(one)
    assert another_car.with_own_numbers(one, names, TOLERANCE) == (names, 0.0)
