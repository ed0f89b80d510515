"""Forces that rest hides: wind above the C.G., dampers on a rough road, a locked body over a crest."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dsz_daemon.sim.axle import axles, loads_n
from dsz_daemon.sim.car import TUCSON, Car
from dsz_daemon.sim.pose import pose
from dsz_daemon.sim.road import FLAT, Road, RoadPoint, tabled_road, upwards
from dsz_daemon.sim.vehicle import Inputs, State, TwoTrackCar, rolling

G, MASS, HEIGHT = 9.80665, 1673.0, 0.66
FREE = replace(TUCSON, rolling_resistance=0.0, drag_area_m2=0.0)
ROLL_STIFFNESS = (30000.0 * 1.585**2 + 32000.0 * 1.586**2) / 2.0 + 24000.0 + 12000.0


def after(car: Car, inputs: Inputs, duration_s: float, road: Road = FLAT, speed_mps: float = 0.0) -> State:
    vehicle, state = TwoTrackCar(car, road), rolling(car, speed_mps)
    for _ in range(round(duration_s / 0.001)):
        state = vehicle.next_state(state, vehicle.motion(state, inputs), inputs, inputs, 0.001)
    return state


@pytest.mark.parametrize("up_m", [0.0, 0.5, -0.3])
@pytest.mark.parametrize("wind_n", [800.0, -800.0])
def test_a_side_wind_leans_a_standing_car_to_leeward(wind_n: float, up_m: float) -> None:
    """The tyres hold at the road, the wind pushes above it: F (h + up) = (K - m g h) lean, away from the wind."""
    car = replace(TUCSON, wind_up_m=up_m, wind_ahead_m=0.0)
    state = after(car, Inputs(side_wind_n=wind_n, front_brake_nm=600.0, rear_brake_nm=600.0), 6.0)
    lean_rad = -wind_n * (HEIGHT + up_m) / (ROLL_STIFFNESS - MASS * G * HEIGHT)
    assert state.roll_rad == pytest.approx(lean_rad, rel=0.01)


@pytest.mark.parametrize(("axle", "stiffness", "track_m", "bar"), [(0, 3e4, 1.585, 24e3), (1, 32e3, 1.586, 12e3)])
@pytest.mark.parametrize(("left", "right"), [(0.01, 0.0), (0.0, 0.01), (0.01, 0.01), (0.02, -0.01)])
def test_a_wheel_that_the_road_lifts_presses_spring_and_damper(
    axle: int, stiffness: float, track_m: float, bar: float, left: float, right: float
) -> None:
    """Force over the static load: spring x way and bar; or damper x speed, which is the slope's times the car's."""
    found = axles(TUCSON)[axle]
    stands = pose((20.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0, HEIGHT, HEIGHT, RoadPoint())
    static_n = MASS * G * (1.491, 1.149)[axle] / 2.64 / 2.0
    twist_n = bar * (left - right) / track_m**2
    by_way = loads_n(found, stands, (left, right, 0.0, 0.0))
    assert by_way == pytest.approx((static_n + stiffness * left + twist_n, static_n + stiffness * right - twist_n))
    by_speed = loads_n(found, stands, (0.0, 0.0, left, right))
    assert by_speed == pytest.approx((static_n + 2500.0 * 20.0 * left, static_n + 2500.0 * 20.0 * right))


def test_a_body_that_sinks_or_rolls_is_held_up_by_its_dampers() -> None:
    """Sinking at 0.1 m/s: 2500 N/(m/s) more on every wheel. Rolling left side down: more on the left."""
    for number, track_m in enumerate((1.585, 1.586)):
        axle = axles(TUCSON)[number]
        still = pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0, HEIGHT, HEIGHT, RoadPoint())
        sinking = pose((0.0, 0.0, -0.1), (0.0, 0.0, 0.0), 0.0, 0.0, HEIGHT, HEIGHT, RoadPoint())
        rolls = pose((0.0, 0.0, 0.0), (-0.2, 0.0, 0.0), 0.0, 0.0, HEIGHT, HEIGHT, RoadPoint())
        nods = pose((0.0, 0.0, 0.0), (0.0, 0.1, 0.0), 0.0, 0.0, HEIGHT, HEIGHT, RoadPoint())
        flat = (0.0, 0.0, 0.0, 0.0)
        rest = loads_n(axle, still, flat)
        assert np.subtract(loads_n(axle, sinking, flat), rest) == pytest.approx((250.0, 250.0))
        aside = 2500.0 * 0.2 * track_m / 2.0
        assert np.subtract(loads_n(axle, rolls, flat), rest) == pytest.approx((aside, -aside))
        # The nose goes down: the front is pressed, the rear let go.
        along = 2500.0 * 0.1 * (1.149, -1.491)[number]
        assert np.subtract(loads_n(axle, nods, flat), rest) == pytest.approx((along, along))


@pytest.mark.parametrize("bend_per_m", [-0.002, 0.002])
def test_a_locked_body_is_lighter_over_a_crest_and_heavier_in_a_dip(bend_per_m: float) -> None:
    """Over a road that bends by so much per metre it turns at v times that, and feels g cos(grade) + v^2 of it."""
    road = tabled_road(400.0, grade_up_rad=lambda s: bend_per_m * (s - 200.0))
    car = replace(FREE, leans=False, dives=False)
    vehicle, state = TwoTrackCar(car, road), rolling(car, 20.0)
    # It begins on the slope, turning with it.
    state = state._replace(distance_m=150.0, pitch_rate_radps=-bend_per_m * 20.0)
    for _ in range(3000):
        state = vehicle.next_state(state, vehicle.motion(state, Inputs()), Inputs(), Inputs(), 0.001)
    motion = vehicle.motion(state, Inputs())
    speed, grade = state.forward_mps, bend_per_m * (state.distance_m - 200.0)
    assert abs(grade) < 0.05
    assert state.pitch_rate_radps == pytest.approx(-bend_per_m * speed, rel=1e-3)
    assert state.up_mps == pytest.approx(0.0, abs=1e-3)
    assert motion.specific_force_mps2[2] == pytest.approx(G * math.cos(grade) + bend_per_m * speed**2, abs=2e-3)


@pytest.mark.parametrize("across_mps", [-1.0, 1.0])
def test_a_locked_body_that_slides_over_a_twisting_road_feels_that_too(across_mps: float) -> None:
    """p v: a body that drifts to the side that the twist lifts is pushed up with it."""
    twist_per_m = 0.003
    road = tabled_road(100.0, bank_rad=lambda s: twist_per_m * (s - 50.0))
    car = replace(FREE, leans=False, dives=False)
    roll_rate = -twist_per_m * 20.0
    start = rolling(car, 20.0)._replace(distance_m=50.0, left_mps=across_mps)
    # A bank that grows lifts the left side: turning about x, left to up.
    motion = TwoTrackCar(car, road).motion(start._replace(roll_rate_radps=-roll_rate), Inputs())
    assert motion.rates.roll_rad == 0.0
    assert motion.rates.roll_rate_radps == pytest.approx(0.0, abs=1e-9)
    assert motion.specific_force_mps2[2] == pytest.approx(G + twist_per_m * 20.0 * across_mps, abs=1e-9)


def test_left_and_right_are_each_others_mirror_image() -> None:
    """Steering, wind, bumps and bank from the other side: the same drive, mirrored."""
    heights = 0.01 * np.sin(np.arange(401) * 0.7)

    def drive(side: float) -> State:
        rough = (heights, np.zeros(401)) if side > 0.0 else (np.zeros(401), heights)
        road = tabled_road(200.0, lambda s: side * 0.05 * np.sin(s / 15.0), rough_m=rough)
        inputs = Inputs(side * 0.02, 200.0, 0.0, 50.0, 20.0, side * 500.0)
        car = replace(TUCSON, wind_up_m=0.2, steering_compliance_rad_per_n=1e-6)
        return after(car, inputs, 3.0, road, 15.0)

    left, right = drive(1.0), drive(-1.0)
    odd = {"left_mps", "roll_rate_radps", "yaw_rate_radps", "roll_rad", "yaw_rad", "off_middle_m", "off_heading_rad"}
    swapped = {"fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}
    assert left.yaw_rad > 0.1
    for name in State._fields:
        head, _, wheel = name.partition("_")
        other = f"{head}_{swapped[wheel[:2]]}{wheel[2:]}" if wheel[:2] in swapped else name
        sign = -1.0 if name in odd or head == "slip" else 1.0
        assert getattr(right, other) == pytest.approx(sign * getattr(left, name), rel=1e-9, abs=1e-9), name


@pytest.mark.parametrize(("axle", "ahead_m", "stiffness"), [(0, 1.149, 30000.0), (1, -1.491, 32000.0)])
def test_a_bump_is_felt_by_the_axle_that_stands_on_it(axle: int, ahead_m: float, stiffness: float) -> None:
    heights = 0.01 * np.exp(-(((np.arange(401) * 0.5 - 20.0) / 0.5) ** 2))
    vehicle = TwoTrackCar(TUCSON, tabled_road(200.0, rough_m=(heights, heights)))
    standing = rolling(TUCSON)
    rest = vehicle.motion(standing, Inputs()).loads_n
    on_it = vehicle.motion(standing._replace(distance_m=20.0 - ahead_m), Inputs()).loads_n
    more = np.subtract(on_it, rest)
    assert more[2 * axle : 2 * axle + 2] == pytest.approx((0.01 * stiffness,) * 2, rel=1e-6)
    other = 2 * (1 - axle)
    assert more[other : other + 2] == pytest.approx((0.0, 0.0), abs=1.0)


@pytest.mark.parametrize(("bank", "grade"), [(0.3, 0.0), (0.0, -0.2), (0.25, 0.4), (-0.2, -0.3)])
def test_the_vertical_in_road_axes_is_that_of_grade_then_bank(bank: float, grade: float) -> None:
    """Its shares on ahead and on aside: uphill by the grade, and the left side's rise; a unit vector."""
    ahead = np.array([math.cos(grade), 0.0, math.sin(grade)])
    level_left = np.array([0.0, 1.0, 0.0])
    up = np.cross(ahead, level_left)  # the normal of a road without bank
    left = math.cos(bank) * level_left + math.sin(bank) * up
    normal = np.cross(ahead, left)
    assert upwards(RoadPoint(bank, grade)) == pytest.approx((ahead[2], left[2], normal[2]), abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_how_fast_the_body_lifts_leans_and_dives_is_what_that_changes_by(seed: float) -> None:
    rng = np.random.default_rng(seed)
    roll, pitch, height = 0.2 * rng.normal(), 0.2 * rng.normal(), HEIGHT + 0.05 * rng.normal()
    velocity, turn = tuple(rng.normal(size=3)), tuple(0.5 * rng.normal(size=3))

    def at(by_s: float) -> tuple[float, float, float]:
        moved = pose(
            velocity, turn, roll + by_s * now.angle_rates_radps[0], pitch + by_s * now.angle_rates_radps[1],
            height + by_s * now.rising_mps, HEIGHT, RoadPoint(),
        )  # fmt: skip
        return moved.lift_m, moved.lean, moved.dive

    now = pose(velocity, turn, roll, pitch, height, HEIGHT, RoadPoint())
    changed = np.subtract(at(1e-5), at(-1e-5)) / 2e-5
    assert changed == pytest.approx((now.lift_mps, now.lean_per_s, now.dive_per_s), abs=1e-8)
