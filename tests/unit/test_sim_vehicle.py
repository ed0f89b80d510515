"""The simulated car against mechanics: closed forms, balances, and motion differentiated twice."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dsz_daemon.sim.car import TUCSON, Car
from dsz_daemon.sim.road import FLAT, Road, RoadPoint, constant_road, road_point, tabled_road
from dsz_daemon.sim.tyres import tyre_force, tyres
from dsz_daemon.sim.vehicle import Inputs, Motion, State, TwoTrackCar, rolling, specific_force

G = 9.80665
Driver = Callable[[float, float], Inputs]  # of time in s and speed in m/s
Array = NDArray[np.float64]
# Nothing that eats power while it rolls.
FREE = replace(TUCSON, rolling_resistance=0.0, drag_area_m2=0.0)


def driven(
    car: Car, road: Road, driver: Driver, start: State, duration_s: float, dt_s: float = 0.002
) -> tuple[list[State], list[Motion]]:
    vehicle, state = TwoTrackCar(car, road), start
    states, motions = [], []
    for i in range(round(duration_s / dt_s) + 1):
        t_s, speed_mps = i * dt_s, state.forward_mps
        motion = vehicle.motion(state, driver(t_s, speed_mps))
        states.append(state)
        motions.append(motion)
        gained = motion.rates.forward_mps * dt_s
        halfway, then = driver(t_s + dt_s / 2.0, speed_mps + gained / 2.0), driver(t_s + dt_s, speed_mps + gained)
        state = vehicle.next_state(state, motion, halfway, then, dt_s)
    return states, motions


def rot_x(a: float) -> Array:
    c, s = math.cos(a), math.sin(a)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def rot_y(a: float) -> Array:
    c, s = math.cos(a), math.sin(a)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def rot_z(a: float) -> Array:
    c, s = math.cos(a), math.sin(a)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def world_from_body(state: State, point: RoadPoint) -> Array:
    road = rot_z(state.yaw_rad) @ rot_y(-point.grade_up_rad) @ rot_x(point.bank_rad)
    return road @ rot_y(state.pitch_rad) @ rot_x(state.roll_rad)


def hilly(distance_m: float) -> RoadPoint:
    """A bank and a grade that both come and go, with their slopes written out by hand."""
    return RoadPoint(
        0.10 * math.sin(distance_m / 30.0),
        0.08 * math.cos(distance_m / 40.0) - 0.08,
        0.10 / 30.0 * math.cos(distance_m / 30.0),
        -0.08 / 40.0 * math.sin(distance_m / 40.0),
    )


HILLY = tabled_road(200.0, lambda s: 0.10 * np.sin(s / 30.0), lambda s: 0.08 * np.cos(s / 40.0) - 0.08)


def test_a_tabled_road_is_the_road_it_was_made_of_slopes_and_all() -> None:
    for distance_m in np.linspace(0.5, 199.0, 777):
        assert road_point(HILLY, float(distance_m)) == pytest.approx(hilly(float(distance_m)), abs=3e-8)
    assert road_point(HILLY, -5.0) == pytest.approx((0.0, 0.0, 0.0, 0.0), abs=1e-12)
    last = hilly(200.0)
    assert road_point(HILLY, 300.0) == pytest.approx((last[0], last[1], 0.0, 0.0), abs=1e-12)


def test_standing_on_level_ground_feels_g_upwards_and_nothing_else() -> None:
    motion = TwoTrackCar(TUCSON, FLAT).motion(rolling(TUCSON), Inputs())
    assert motion.rates == pytest.approx([0.0] * 29, abs=1e-9)
    assert specific_force(rolling(TUCSON), motion, (0.4, 0.1, -0.1)) == pytest.approx((0.0, 0.0, G), abs=1e-9)


@pytest.mark.parametrize("speed_mps", [8.0, 18.0, 30.0])
def test_small_steady_turn_is_the_single_track_models(speed_mps: float) -> None:
    steer_rad = 0.002
    states, _ = driven(FREE, FLAT, lambda _t, _v: Inputs(steer_rad), rolling(FREE, speed_mps), 4.0)
    last = states[-1]
    lf, lr, v = 1.149, 1.491, last.forward_mps
    wheelbase = lf + lr
    understeer = 1673.0 / (2.0 * wheelbase) * (lr / 62000.0 - lf / 68000.0)
    yaw_rate = v * steer_rad / (wheelbase + understeer * v**2)
    slip = steer_rad * (lr - 1673.0 * lf * v**2 / (2.0 * 68000.0 * wheelbase)) / (wheelbase + understeer * v**2)
    # Left out on this side: load transfer and curvature of the tyre's curve, both second
    # order in 0.3 m/s^2 of lateral acceleration, and the speed that the turn costs.
    assert last.yaw_rate_radps == pytest.approx(yaw_rate, rel=3e-3)
    assert math.atan2(last.left_mps, last.forward_mps) == pytest.approx(slip, abs=4e-3 * steer_rad)


def test_turning_left_lifts_the_left_side_by_the_springs_balance_and_gravity_is_felt_with_it() -> None:
    driver: Driver = lambda _t, v: Inputs(0.01, front_drive_nm=800.0 * (15.0 - v))  # noqa: E731
    states, motions = driven(TUCSON, FLAT, driver, rolling(TUCSON, 15.0), 5.0)
    last, motion = states[-1], motions[-1]
    ay = last.yaw_rate_radps * motion.pose.along_mps
    roll_stiffness = (30000.0 * 1.585**2 + 32000.0 * 1.586**2) / 2.0 + 24000.0 + 12000.0
    weight_moment = 1673.0 * G * 0.66
    assert ay > 0.5
    assert last.roll_rad == pytest.approx(1673.0 * ay * 0.66 / (roll_stiffness - weight_moment), rel=5e-3)
    felt = motion.specific_force_mps2
    assert felt[1] == pytest.approx(ay * math.cos(last.roll_rad) + G * math.sin(last.roll_rad), rel=1e-3)
    left, right = motion.loads_n[0] + motion.loads_n[2], motion.loads_n[1] + motion.loads_n[3]
    overturning = 1673.0 * 0.66 * (ay + G * math.sin(last.roll_rad))
    assert (right - left) * 1.5855 / 2.0 == pytest.approx(overturning, rel=5e-3)


def test_free_rear_wheels_roll_at_the_speed_of_their_place_in_the_turn() -> None:
    states, _ = driven(FREE, FLAT, lambda _t, _v: Inputs(0.03), rolling(FREE, 8.0), 3.0)
    last = states[-1]
    assert last.yaw_rate_radps > 0.05
    left, right = last.spin_rl_radps * 0.340, last.spin_rr_radps * 0.340
    assert right - left == pytest.approx(1.586 * last.yaw_rate_radps, rel=5e-3)
    assert (left + right) / 2.0 == pytest.approx(last.forward_mps, rel=1e-3)


def test_lever_arm_ahead_feels_the_centripetal_pull_backwards() -> None:
    driver: Driver = lambda _t, v: Inputs(0.03, front_drive_nm=800.0 * (12.0 - v))  # noqa: E731
    states, motions = driven(TUCSON, FLAT, driver, rolling(TUCSON, 12.0), 5.0)
    centre = specific_force(states[-1], motions[-1], (0.0, 0.0, 0.0))
    ahead = specific_force(states[-1], motions[-1], (0.5, 0.0, 0.0))
    r = states[-1].yaw_rate_radps
    assert r > 0.1
    assert ahead[0] - centre[0] == pytest.approx(-0.5 * r**2, rel=1e-3)
    aside = specific_force(states[-1], motions[-1], (0.0, 0.5, 0.0))
    assert aside[1] - centre[1] == pytest.approx(-0.5 * r**2, rel=1e-3)


def test_braking_dips_the_nose_and_loads_the_front_by_the_lever_of_the_cg() -> None:
    states, motions = driven(
        FREE,
        FLAT,
        lambda _t, _v: Inputs(front_brake_nm=500.0, rear_brake_nm=250.0),
        rolling(FREE, 25.0),
        4.0,
    )
    last, motion = states[-1], motions[-1]
    deceleration = -motion.rates[0]
    spin = 1.2 * (2 * motion.rates[11] + 2 * motion.rates[13])
    assert deceleration > 2.0
    assert last.pitch_rad > 0.005
    # A slowing wheel's spin also throws load forward.
    front_n = motion.loads_n[0] + motion.loads_n[1]
    static_n = 1673.0 * G * 1.491 / 2.640
    expected = (1673.0 * (deceleration + G * last.pitch_rad) * 0.66 - spin) / 2.640
    assert front_n - static_n == pytest.approx(expected, rel=0.01)
    assert motion.specific_force_mps2[0] == pytest.approx(-deceleration - G * last.pitch_rad, rel=5e-3)


@pytest.mark.parametrize("grade_up_rad", [-0.08, 0.05])
def test_rolling_freely_on_a_grade_gains_what_gravity_and_the_wheels_inertia_leave(grade_up_rad: float) -> None:
    road = constant_road(0.0, grade_up_rad)
    states, motions = driven(FREE, road, lambda _t, _v: Inputs(), rolling(FREE, 15.0), 4.0)
    half = len(states) // 2
    gained = (states[-1].forward_mps - states[half].forward_mps) / 2.0
    wheels_kg = 2 * 1.2 / 0.337**2 + 2 * 1.2 / 0.340**2
    assert gained == pytest.approx(-G * math.sin(grade_up_rad) * 1673.0 / (1673.0 + wheels_kg), rel=2e-3)
    # Going down freely, an accelerometer feels next to nothing of the slope.
    assert abs(motions[-1].specific_force_mps2[0]) < 0.05 * abs(G * math.sin(grade_up_rad))


def test_standing_on_a_bank_and_a_grade_reads_the_tilt() -> None:
    road = constant_road(0.05, 0.03)
    held: Driver = lambda _t, _v: Inputs(front_brake_nm=600.0, rear_brake_nm=600.0)  # noqa: E731
    states, motions = driven(TUCSON, road, held, rolling(TUCSON), 4.0)
    last, felt = states[-1], motions[-1].specific_force_mps2
    assert last.roll_rad > 0.0  # leans further downhill, which is to the right
    assert last.pitch_rad < 0.0  # sits on its rear
    assert felt[1] == pytest.approx(G * math.sin(0.05 + last.roll_rad) * math.cos(0.03), rel=2e-3)
    assert felt[0] == pytest.approx(G * math.sin(0.03 - last.pitch_rad), rel=3e-3)
    assert math.hypot(*felt) == pytest.approx(G, rel=1e-3)


@pytest.mark.parametrize("road", [FLAT, HILLY], ids=["flat", "hilly"])
def test_felt_force_and_rates_are_those_of_the_path_differentiated(road: Road) -> None:
    """The second route: only attitude and velocity, in the world, differentiated in time."""

    def driver(t_s: float, speed_mps: float) -> Inputs:
        steer = 0.05 * math.sin(3.0 * t_s)
        brake_nm = 300.0 * (1.0 - math.cos(t_s))  # pedals move smoothly: there is a derivative
        return Inputs(steer, 300.0 * math.exp(-t_s), brake_nm, 0.5 * brake_nm)

    place = np.array([0.439, 0.2, -0.035])
    dt_s = 0.001
    states, motions = driven(TUCSON, road, driver, rolling(TUCSON, 15.0), 3.5, dt_s)

    turned = [world_from_body(s, road_point(road, s.distance_m)) for s in states]
    velocity = np.array([w @ (np.array(s[:3]) + np.cross(s[3:6], place)) for s, w in zip(states, turned, strict=True)])
    largest = [0.0, 0.0]
    for i in range(300, len(states) - 1, 7):
        acceleration = (velocity[i + 1] - velocity[i - 1]) / (2.0 * dt_s)
        felt = turned[i].T @ (acceleration + np.array([0.0, 0.0, G]))
        spin = turned[i].T @ (turned[i + 1] - turned[i - 1]) / (2.0 * dt_s)
        rate = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        force = np.array(specific_force(states[i], motions[i], tuple(place)))
        assert force == pytest.approx(felt, abs=2e-3)
        assert np.array(states[i][3:6]) == pytest.approx(rate, abs=2e-5)
        largest = [max(largest[0], abs(felt[1])), max(largest[1], abs(rate[1]))]
    assert largest[0] > 3.0  # it was a real manoeuvre
    assert largest[1] > 0.01


def test_the_cg_keeps_its_distance_over_a_hilly_road() -> None:
    states, motions = driven(
        TUCSON, HILLY, lambda _t, v: Inputs(front_drive_nm=900 * (15 - v)), rolling(TUCSON, 15.0), 8
    )
    assert max(abs(s.height_m - 0.66) for s in states) < 0.02
    rise = np.trapezoid(
        [m.pose.along_mps * math.sin(hilly(s.distance_m).grade_up_rad) for s, m in zip(states, motions, strict=True)],
        dx=0.002,
    )
    climbed = np.trapezoid([(world_from_body(s, hilly(s.distance_m)) @ np.array(s[:3]))[2] for s in states], dx=0.002)
    # In the world the C.G. climbs with the road; sideways motion on the bank is the rest.
    assert climbed == pytest.approx(rise, abs=0.5)
    assert rise < -2.0


def kinetic_j(state: State, car: Car) -> float:
    spins = sum(0.5 * car.wheel_inertia_kgm2 * spin**2 for spin in state[11:15])
    turning = (
        car.roll_inertia_kgm2 * state[3] ** 2
        + car.pitch_inertia_kgm2 * state[4] ** 2
        + car.yaw_inertia_kgm2 * state[5] ** 2
    )
    return 0.5 * car.mass_kg * float(np.dot(state[:3], state[:3])) + 0.5 * turning + spins


CORNERS = ((1.149, 0.7925), (1.149, -0.7925), (-1.491, 0.793), (-1.491, -0.793))


def lifts_m(state: State) -> list[float]:
    body = rot_y(state.pitch_rad) @ rot_x(state.roll_rad)
    return [state.height_m + float((body @ np.array([x, y, -0.66]))[2]) for x, y in CORNERS]


def potential_j(state: State, car: Car) -> float:
    lift = lifts_m(state)
    front, rear = car.front_static_load_n, car.rear_static_load_n
    stored = sum(0.5 * 30000.0 * z**2 - front * z for z in lift[:2])
    stored += sum(0.5 * 32000.0 * z**2 - rear * z for z in lift[2:])
    stored += 0.5 * 24000.0 * ((lift[0] - lift[1]) / 1.585) ** 2 + 0.5 * 12000.0 * ((lift[2] - lift[3]) / 1.586) ** 2
    return stored + car.mass_kg * G * state.height_m


def test_bouncing_without_dampers_and_grip_keeps_energy_and_momentum() -> None:
    car = replace(
        FREE,
        front_damper_ns_per_m=0.0,
        rear_damper_ns_per_m=0.0,
        front_cornering_stiffness_n_per_rad=1e-12,
        rear_cornering_stiffness_n_per_rad=1e-12,
        front_slip_stiffness_n=1e-12,
        rear_slip_stiffness_n=1e-12,
    )
    start = rolling(car, 20.0)._replace(
        roll_rad=0.04, pitch_rad=0.02, height_m=0.68, roll_rate_radps=0.1, yaw_rate_radps=0.4, left_mps=1.0
    )
    states, _ = driven(car, FLAT, lambda _t, _v: Inputs(), start, 3.0, 0.001)
    energy = [kinetic_j(s, car) + potential_j(s, car) for s in states]
    swing = [potential_j(s, car) for s in states]
    assert max(swing) - min(swing) > 50.0
    assert max(energy) - min(energy) < 0.01
    momentum = np.array([world_from_body(s, RoadPoint()) @ np.array(s[:3]) for s in states])
    assert np.ptp(momentum[:, 0]) < 1e-4
    assert np.ptp(momentum[:, 1]) < 1e-4


def test_power_balance_of_a_sliding_driven_car() -> None:
    """What car and springs gain is what the engine gives less what tyres, dampers and air take."""
    car = TUCSON
    rng = np.random.default_rng(1)
    for _ in range(20):
        noise = rng.normal(size=29)
        scale = [
            2,
            0.5,
            0.2,
            0.3,
            0.2,
            0.5,
            0.03,
            0.02,
            0.3,
            0.01,
            1,
            *[1.0] * 4,
            *[0.01] * 4,
            *[0.05] * 4,
            *[0.3] * 4,
            0.0,
            0.0,
        ]
        state = State._make(np.array(rolling(car, 15.0)) + noise * np.array(scale))
        inputs = Inputs(float(noise[0]) * 0.05, 500.0 * abs(float(noise[1])), 300.0 * abs(float(noise[2])), 200.0)
        motion = TwoTrackCar(car, FLAT).motion(state, inputs)
        step = 1e-6

        def at(by_s: float, state: State = state, motion: Motion = motion) -> float:
            moved = State._make(np.array(state) + by_s * np.array(motion.rates))
            return kinetic_j(moved, car) + potential_j(moved, car)

        gained_w = (at(step) - at(-step)) / (2.0 * step)
        assert gained_w == pytest.approx(power_w(state, inputs, motion, car), rel=1e-3, abs=5.0)


def power_w(state: State, inputs: Inputs, motion: Motion, car: Car) -> float:
    body = rot_y(state.pitch_rad) @ rot_x(state.roll_rad)
    velocity, turn = np.array(state[:3]), np.array(state[3:6])
    dt_s = 1e-6
    after = State._make(np.array(state) + dt_s * np.array(motion.rates))
    before = State._make(np.array(state) - dt_s * np.array(motion.rates))
    lift_rates = (np.array(lifts_m(after)) - np.array(lifts_m(before))) / (2.0 * dt_s)
    total = -0.5 * 1.2 * car.drag_area_m2 * abs(state.forward_mps) * state.forward_mps**2
    total -= 2500.0 * float(lift_rates @ lift_rates)
    for i, (x, y) in enumerate(CORNERS):
        radius = 0.337 if i < 2 else 0.340
        steer = inputs.road_wheel_angle_rad if i < 2 else 0.0
        hub = body @ (velocity + np.cross(turn, [x, y, radius - 0.66]))
        ground = body @ (velocity + np.cross(turn, [x, y, -0.66]))
        ahead = hub[0] * math.cos(steer) + ground[1] * math.sin(steer)
        aside = -hub[0] * math.sin(steer) + ground[1] * math.cos(steer)
        spin, load = state[11 + i], motion.loads_n[i]
        fx, fy = tyre_force(tyres(car)[i // 2], state[15 + i], state[19 + i], load)
        windup = state[23 + i] + 0.03 * (spin - abs(spin) * state[23 + i]) / max(0.02, 0.002 * abs(spin))
        brake = inputs.front_brake_nm if i < 2 else inputs.rear_brake_nm
        shaft = (inputs.front_drive_nm if i < 2 else 0.0) - brake * windup
        total += fx * (ahead - spin * radius) + fy * aside
        total += shaft * (spin - turn[1]) - 0.012 * load * radius * math.tanh(spin) * spin
    return total


def test_tyre_is_linear_at_first_and_never_beats_grip() -> None:
    front, _ = tyres(TUCSON)
    load = TUCSON.front_static_load_n
    assert tyre_force(front, 0.0, 1e-4, load)[1] == pytest.approx(6.2, rel=1e-5)
    assert tyre_force(front, 1e-4, 0.0, load)[0] == pytest.approx(8.0, rel=1e-5)
    slips = np.linspace(0.0, 1.0, 200)
    forces = [math.hypot(*tyre_force(front, float(k), float(s), load)) for k in slips[::20] for s in slips]
    assert max(forces) <= load * TUCSON.friction * (1 + 1e-12)
    assert max(forces) > 0.999 * load
    assert tyre_force(front, 0.05, 0.05, 0.0) == (0.0, 0.0)
    # More load, more force, but less than in proportion.
    double = tyre_force(front, 0.0, 1e-4, 2.0 * load)[1]
    assert double == pytest.approx(1.5 * 6.2, rel=1e-4)
