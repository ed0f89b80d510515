"""The simulated car against what mechanics gives in closed form: steps, wind, helix, bumps, bends, drive."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dsz_daemon.sim.car import TUCSON, Car
from dsz_daemon.sim.drive import Columns, drive
from dsz_daemon.sim.driver import Programme, SpeedChange
from dsz_daemon.sim.road import FLAT, Road, constant_road, tabled_road
from dsz_daemon.sim.vehicle import Inputs, State, TwoTrackCar, rolling

Array = NDArray[np.float64]
G, MASS, YAW_INERTIA, LF, LR, CF, CR = 9.80665, 1673.0, 2850.0, 1.149, 1.491, 62000.0, 68000.0
# No losses, nothing that bends: where the linear single-track car applies.
LINEAR = replace(
    TUCSON, rolling_resistance=0.0, drag_area_m2=0.0, friction=1e6, load_sensitivity=0.0, lateral_relaxation_m=0.01,
    leans=False, dives=False,
)  # fmt: skip


def single_track(speed_mps: float) -> tuple[Array, Array]:
    """A and the column of the steering angle of x' = A x + B u for x = (v_y, r), Newton and Euler written out."""
    a = np.array(
        [
            [-2 * (CF + CR) / (MASS * speed_mps), -2 * (CF * LF - CR * LR) / (MASS * speed_mps) - speed_mps],
            [
                -2 * (CF * LF - CR * LR) / (YAW_INERTIA * speed_mps),
                -2 * (CF * LF**2 + CR * LR**2) / (YAW_INERTIA * speed_mps),
            ],
        ]
    )
    return a, np.array([2 * CF / MASS, 2 * CF * LF / YAW_INERTIA])


def under(car: Car, inputs: Inputs, speed_mps: float, duration_s: float, road: Road = FLAT) -> list[State]:
    vehicle, state = TwoTrackCar(car, road), rolling(car, speed_mps)
    states = [state]
    for _ in range(round(duration_s / 0.001)):
        state = vehicle.next_state(state, vehicle.motion(state, inputs), inputs, inputs, 0.001)
        states.append(state)
    return states


@pytest.mark.parametrize("speed_mps", [10.0, 20.0, 30.0])
def test_a_step_of_the_wheel_answers_like_the_linear_car(speed_mps: float) -> None:
    """x(t) = A^-1 (e^(At) - 1) B u, by eigenvalues."""
    step_rad = 0.002
    states = under(LINEAR, Inputs(step_rad), speed_mps, 1.5)
    a, b = single_track(speed_mps)
    eigen, vectors = np.linalg.eig(a)
    for at in (100, 200, 400, 800, 1500):
        grown = vectors @ np.diag(np.exp(eigen * at * 0.001)) @ np.linalg.inv(vectors)
        aside, yaw_rate = (np.linalg.solve(a, (grown - np.eye(2)) @ b) * step_rad).real
        steady = abs(np.linalg.solve(a, b)[1]) * step_rad
        # 2 ms of slip's building up, and the speed that a turn costs.
        assert states[at].yaw_rate_radps == pytest.approx(yaw_rate, abs=0.02 * steady)
        assert states[at].left_mps == pytest.approx(aside, abs=0.02 * steady * speed_mps / 5.0)


def test_a_steady_side_wind_drifts_and_turns_the_car_as_the_linear_one() -> None:
    speed_mps, wind_n = 25.0, 300.0
    last = under(LINEAR, Inputs(side_wind_n=wind_n), speed_mps, 4.0)[-1]
    a, _ = single_track(speed_mps)
    aside, yaw_rate = np.linalg.solve(a, -np.array([wind_n / MASS, wind_n * LINEAR.wind_ahead_m / YAW_INERTIA]))
    assert last.yaw_rate_radps == pytest.approx(yaw_rate, rel=0.02)
    assert last.left_mps == pytest.approx(aside, rel=0.03)


def test_down_a_helix_all_three_rates_are_the_verticals() -> None:
    """A multi-storey car park: what turns is the car about the vertical, seen in its own tilted axes."""
    grade, bank, bend = -0.09, 0.04, 1.0 / 15.0
    programme = Programme(40.0, (SpeedChange(0.5, 4.0, 4.0),), follows_road=True)
    columns = drive(TwoTrackCar(TUCSON, constant_road(bank, grade, bend)), programme)
    late = columns["time_s"] > 25.0
    mean = {name: float(column[late].mean()) for name, column in columns.items()}
    turn = mean["speed_mps"] * bend
    assert math.hypot(mean["gyro_x_radps"], mean["gyro_y_radps"], mean["gyro_z_radps"]) == pytest.approx(turn, rel=0.01)
    # roll_rad and pitch_rad are the attitude against the vertical: the mean of many, small here.
    roll, pitch = mean["roll_rad"], mean["pitch_rad"]
    assert mean["gyro_x_radps"] == pytest.approx(-turn * math.sin(pitch), rel=0.02)
    assert mean["gyro_y_radps"] == pytest.approx(turn * math.sin(roll) * math.cos(pitch), rel=0.02)
    assert mean["gyro_x_radps"] < -0.02
    assert abs(columns["off_middle_m"][late]).max() < 0.3
    assert columns["speed_mps"][late].std() < 0.01


@pytest.mark.parametrize("speed_mps", [8.0, 20.0])
def test_the_driver_keeps_to_a_bend(speed_mps: float) -> None:
    def bend(distance_m: Array) -> Array:
        return 0.008 * (1.0 - np.cos(np.clip(distance_m - 60.0, 0.0, 200.0) * 2.0 * math.pi / 200.0)) / 2.0

    programme = Programme(320.0 / speed_mps, (SpeedChange(-2.0, -1.0, speed_mps),), follows_road=True)
    car = TwoTrackCar(TUCSON, tabled_road(400.0, bend_per_m=bend))
    columns = drive(car, programme, start=rolling(TUCSON, speed_mps))
    assert np.abs(columns["off_middle_m"]).max() < 0.6
    # The way round: the heading is the bend's area.
    assert columns["yaw_rad"][-1] == pytest.approx(0.004 * 200.0, abs=0.02)


def lifted(left_m: float, right_m: float) -> Road:
    rise: Callable[[float], Array] = lambda height: height * np.clip((np.arange(401) * 0.5 - 20.0) / 10.0, 0.0, 1.0)  # noqa: E731
    return tabled_road(200.0, rough_m=(rise(left_m), rise(right_m)))


def test_on_a_raised_track_the_body_settles_as_high_and_as_tilted_as_its_wheels() -> None:
    both = under(LIFTED, Inputs(), 20.0, 6.0, lifted(0.03, 0.03))[-1]
    assert both.height_m - 0.66 == pytest.approx(0.03, abs=1e-4)
    assert both.roll_rad == pytest.approx(0.0, abs=1e-6)
    one = under(LIFTED, Inputs(), 20.0, 6.0, lifted(0.03, 0.0))[-1]
    assert one.height_m - 0.66 == pytest.approx(0.015, abs=2e-4)
    # The wheels' line tilts by 0.03 over the track; springs and bars turn the body that far, its weight a bit more.
    springs = (30000.0 * 1.585**2 + 32000.0 * 1.586**2) / 2.0 + 24000.0 + 12000.0
    tilt = 0.03 / 1.5855 * springs / (springs - MASS * G * 0.66)
    assert one.roll_rad == pytest.approx(tilt, rel=0.02)


LIFTED = replace(TUCSON, rolling_resistance=0.0, drag_area_m2=0.0)


def test_a_bump_shakes_the_body_in_its_two_modes() -> None:
    """Heave and pitch on undamped springs, coupled: what is left of a bump is two sines of known frequencies."""
    heights = 0.02 * np.exp(-(((np.arange(401) * 0.5 - 20.0) / 1.0) ** 2))
    car = replace(LIFTED, front_damper_ns_per_m=0.0, rear_damper_ns_per_m=0.0)
    states = under(car, Inputs(), 20.0, 6.0, tabled_road(200.0, rough_m=(heights, heights)))
    swing = np.array([state.height_m for state in states[1500:]])
    front, rear = 2 * 30000.0, 2 * 32000.0
    coupling = rear * LR - front * LF
    stiffness = np.array([[front + rear, coupling], [coupling, front * LF**2 + rear * LR**2 - MASS * G * 0.66]])
    eigen = np.linalg.eigvalsh(stiffness / np.sqrt(np.outer([MASS, 2700.0], [MASS, 2700.0])))
    time_s = np.arange(len(swing)) * 0.001

    def left_by(frequencies: Array) -> float:
        sines = [wave(f * time_s) for f in frequencies for wave in (np.sin, np.cos)]
        columns = np.column_stack([*sines, np.ones(len(swing))])
        return float(np.std(swing - columns @ np.linalg.lstsq(columns, swing, rcond=None)[0]) / swing.std())

    assert swing.std() > 1e-3
    assert left_by(np.sqrt(eigen)) < 0.05
    assert left_by(np.sqrt(eigen) * 1.05) > 0.2


@pytest.mark.parametrize(("share", "ahead"), [(1.0, "f"), (0.0, "r"), (0.5, "fr")])
def test_the_driven_wheels_run_ahead(share: float, ahead: str) -> None:
    car = replace(TUCSON, front_drive_share=share)
    columns = drive(TwoTrackCar(car, FLAT), Programme(5.0, (SpeedChange(0.5, 6.0, 15.0),)))
    pulling = (columns["time_s"] > 2.0) & (columns["time_s"] < 4.5)
    speed = columns["speed_mps"][pulling]
    for axle in "fr":
        lead = float(np.mean(columns[f"wheel_speed_{axle}l_mps"][pulling] / speed)) - 1.0
        assert (lead > 0.005) == (axle in ahead), (axle, lead)


@pytest.mark.parametrize(
    ("slows_mps2", "engine_mps2", "rear_slips"), [(1.0, 1.5, False), (2.5, 1.5, True), (1.0, 0.0, True)]
)
def test_an_engine_brakes_the_wheels_that_it_drives_and_then_the_brakes_all(
    slows_mps2: float, engine_mps2: float, rear_slips: bool
) -> None:
    car = replace(TUCSON, engine_braking_mps2=engine_mps2)
    programme = Programme(8.0, (SpeedChange(-2.0, -1.0, 20.0), SpeedChange(1.0, 7.0, -4.0 * slows_mps2)))
    columns = drive(TwoTrackCar(car, FLAT), programme, start=rolling(car, 20.0))
    # Half-way the S slows the car by one and a half times its mean.
    slowing = (columns["time_s"] > 3.5) & (columns["time_s"] < 4.5)
    speed = columns["speed_mps"][slowing]
    front, rear = (float(np.mean(columns[f"wheel_speed_{axle}l_mps"][slowing] / speed)) - 1.0 for axle in "fr")
    assert float(np.mean(columns["accel_x_mps2"][slowing])) == pytest.approx(-slows_mps2, abs=0.15)
    assert front < -2e-3
    assert (rear < -1e-3) == rear_slips, rear


def friction_used(columns: Columns) -> float:
    return float(np.max(np.hypot(columns["accel_x_mps2"], columns["accel_y_mps2"]))) / G


def test_on_snow_the_car_does_not_turn_as_asked() -> None:
    programme = Programme(12.0, (SpeedChange(-2.0, -1.0, 15.0),), follows_road=True)
    start, road = rolling(TUCSON, 15.0), constant_road(bend_per_m=1.0 / 60.0)
    dry = drive(TwoTrackCar(TUCSON, road), programme, start=start)
    snow = drive(
        TwoTrackCar(TUCSON, road), replace(programme, friction_limit=lambda t: np.full(len(t), 0.25)), start=start
    )
    late = dry["time_s"] > 3.0
    assert dry["accel_y_mps2"][late].mean() == pytest.approx(15.0**2 / 60.0, rel=0.15)
    assert snow["accel_y_mps2"].max() < 0.25 * G * 1.15
    assert friction_used(snow) < 0.3 < friction_used(dry)
    assert abs(snow["off_middle_m"][-1]) > 5.0
