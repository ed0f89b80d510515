"""Effects one by one, against hand values: what a reading, a lean or a slip must be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dsz_daemon.sim.bus import database
from dsz_daemon.sim.car import TUCSON
from dsz_daemon.sim.catalogue import Scenario
from dsz_daemon.sim.drive import drive
from dsz_daemon.sim.driver import Programme, SineSteer, SpeedChange
from dsz_daemon.sim.effects import Choice, with_effect, with_effects
from dsz_daemon.sim.road import FLAT, tabled_road
from dsz_daemon.sim.scenario import SimulatedDrive, simulate_scenario
from dsz_daemon.sim.sensors import SensorErrors
from dsz_daemon.sim.vehicle import Inputs, TwoTrackCar, rolling
from dsz_daemon.sim.world import World, nominal

Array = NDArray[np.float64]
G, DEG = 9.80665, math.pi / 180.0
STANDING = Scenario("a car that stands", TUCSON, FLAT, Programme(3.0, ()))
GYRO_NULLS, ACCEL_NULLS = (0.01, -0.02, 0.03), (0.1, -0.2, 0.15)
ERRORS = SensorErrors(GYRO_NULLS, ACCEL_NULLS, noisy=False)
SIGNALS = {
    "gyro_x": ("ROLL_ADC", DEG / 0.007), "gyro_y": ("PITCH_ADC", DEG / 0.007), "gyro_z": ("YAW_ADC", DEG / 0.007),
    "accel_x": ("LONG_ADC", G), "accel_y": ("LAT_ADC", G), "accel_z": ("VERT_ADC", G),
}  # fmt: skip


def standing(*effects: Choice, errors: SensorErrors = ERRORS) -> SimulatedDrive:
    return simulate_scenario("standing", STANDING, 1, errors, effects=effects)


def reading(drive: SimulatedDrive, channel: str) -> Array:
    """What the configured reader makes of the bus: volts above the null over volts per unit."""
    signal, per_volt = SIGNALS[channel]
    name = "IMU_RATE" if channel.startswith("gyro") else "IMU_ACCEL"
    message = database().get_message_by_name(name)
    counts = [message.decode(f.data)[signal] for f in drive.frames if f.can_id == message.frame_id]
    return (np.array(counts, dtype=float) * 7.63e-5 - 2.5) * per_volt


COUNT = 7.63e-5 * G


@pytest.mark.parametrize(
    ("channel", "kind", "expected"),
    [
        # True is 0, 0, g; what is read by x, y and z.
        ("accel_z", "reversed", (0.1, -0.2, -G + 0.15)),
        ("accel_x", "swapped_with_z", (G + 0.15, -0.2, 0.1)),
        ("accel_z", "swapped_with_y", (0.1, G + 0.15, -0.2)),
        ("accel_y", "mps2_for_g", (0.1, -0.2 * G, G + 0.15)),
        ("accel_z", "g_for_mps2", (0.1, -0.2, (G + 0.15) / G)),
        # 2.5 V above the null is all that the converter has.
        ("accel_z", "mps2_for_g", (0.1, -0.2, (65535 * 7.63e-5 - 2.5) * G)),
    ],
)
def test_a_fault_of_an_accelerometers_axis(channel: str, kind: str, expected: tuple[float, float, float]) -> None:
    drive = standing(Choice("axis_fault", {"channel": channel, "kind": kind}))
    for axis, value in zip("xyz", expected, strict=True):
        assert reading(drive, f"accel_{axis}") == pytest.approx(value, abs=COUNT), axis
        true = G if axis == "z" else 0.0
        assert drive.truth[f"accel_{axis}_mps2"] == pytest.approx(true, abs=1e-9)
    for axis, value in zip("xyz", GYRO_NULLS, strict=True):
        assert reading(drive, f"gyro_{axis}") == pytest.approx(value, abs=2e-4)


@pytest.mark.parametrize(
    ("channel", "kind", "expected"),
    [
        ("gyro_y", "reversed", (0.01, -0.02, 0.03)),
        ("gyro_y", "swapped_with_z", (0.01, 0.03, -0.02)),
        ("gyro_z", "rad_for_deg", (0.01, -0.02, 0.03 * DEG)),
        ("gyro_x", "deg_for_rad", (0.01 / DEG, -0.02, 0.03)),
    ],
)
def test_the_offset_is_what_a_faulty_channel_reads_of_nothing(
    channel: str, kind: str, expected: tuple[float, float, float]
) -> None:
    """Gyros that stand read their offsets alone, and the truth calls those the channel's."""
    drive = standing(Choice("axis_fault", {"channel": channel, "kind": kind}))
    for axis, value in zip("xyz", expected, strict=True):
        assert reading(drive, f"gyro_{axis}") == pytest.approx(value, abs=2e-4), axis
        assert drive.truth[f"gyro_{axis}_offset_radps"] == pytest.approx(value, abs=1e-12)
        assert drive.truth[f"gyro_{axis}_radps"] == pytest.approx(0.0, abs=1e-9)


def test_a_swapped_plug_takes_the_whole_sensor_along_noise_scale_and_all() -> None:
    errors = replace(ERRORS, accel_scale=(0.01, 0.02, 0.03), noisy=True, accel_drift_mps2_per_s=(0.0, 0.0, 0.01))
    plain = standing(errors=errors)
    swapped = standing(Choice("axis_fault", {"channel": 3, "kind": 3}), errors=errors)  # accel_x with z, as numbers
    for here, there in (("accel_x", "accel_z"), ("accel_z", "accel_x"), ("accel_y", "accel_y")):
        np.testing.assert_array_equal(reading(swapped, here), reading(plain, there))
        name = f"{here}_offset_mps2"
        np.testing.assert_array_equal(swapped.truth[name], plain.truth[f"{there}_offset_mps2"])
    assert reading(swapped, "accel_x").mean() == pytest.approx(1.03 * G + 0.15 + 0.015, abs=0.002)


def test_reversed_is_the_sensor_of_that_name_and_a_unit_the_channels() -> None:
    """So the order of both and of a swap does not matter."""
    chosen = [
        Choice("axis_fault", {"channel": "accel_z", "kind": "reversed"}),
        Choice("axis_fault", {"channel": "accel_x", "kind": "swapped_with_z"}),
        Choice("axis_fault", {"channel": "accel_x", "kind": "g_for_mps2"}),
    ]
    for effects in (chosen, chosen[::-1]):
        drive = standing(*effects)
        assert reading(drive, "accel_x") == pytest.approx((-G + 0.15) / G, abs=COUNT)
        assert reading(drive, "accel_z") == pytest.approx(0.1, abs=COUNT)


def test_a_reversed_axis_turns_its_scale_and_leaks_but_not_its_null() -> None:
    leaks = [Choice("accel_scale", {"z": 0.02}), Choice("accel_cross_axis", {"xz": 0.01})]
    drive = standing(*leaks, Choice("axis_fault", {"channel": "accel_x"}), Choice("axis_fault", {"channel": "accel_z"}))
    assert reading(drive, "accel_z") == pytest.approx(-1.02 * G + 0.15, abs=COUNT)
    assert reading(drive, "accel_x") == pytest.approx(-0.01 * G + 0.1, abs=COUNT)


def test_offsets_drift_with_time_and_with_the_warmth_of_the_imu() -> None:
    given = {
        "accel_x_per_k": 0.02, "gyro_y_per_k": -1e-3, "accel_x_per_s": 0.01,
        "start_c": 10.0, "end_c": 40.0, "time_constant_s": 2.0,
    }  # fmt: skip
    drive = standing(Choice("bias_drift", given))
    t = drive.truth["time_s"] - drive.truth["time_s"][0]
    rise_k = 30.0 * (1.0 - np.exp(-t / 2.0))
    assert drive.truth["accel_x_offset_mps2"] == pytest.approx(0.1 + 0.01 * t + 0.02 * rise_k, abs=2e-7)
    assert reading(drive, "accel_x") == pytest.approx(0.1 + 0.01 * t + 0.02 * rise_k, abs=COUNT)
    assert reading(drive, "gyro_y") == pytest.approx(-0.02 - 1e-3 * rise_k, abs=2e-4)
    assert reading(drive, "accel_y") == pytest.approx(-0.2, abs=COUNT)
    # An IMU that cools down goes the other way.
    cooling = standing(Choice("bias_drift", given | {"start_c": 40.0, "end_c": 10.0, "accel_x_per_s": 0.0}))
    assert cooling.truth["accel_x_offset_mps2"] == pytest.approx(0.1 - 0.02 * rise_k, abs=2e-7)


# --- the car

NOMINAL = nominal(World(TUCSON, FLAT, Programme(3.0, ()), SensorErrors(noisy=False)))


@pytest.mark.parametrize("shift_m", [-0.3, 0.2])
def test_a_load_leaves_the_imu_where_it_is_on_the_car(shift_m: float) -> None:
    car = with_effect(NOMINAL, "mass_loading", added_mass_kg=250.0, cg_shift_m=shift_m).car
    assert car.mass_kg == 1923.0
    assert car.cg_to_front_axle_m == pytest.approx(1.149 - shift_m)
    assert car.wheelbase_m == pytest.approx(2.64)
    # Behind the front axle as far as before: 1.149 m, where the C.G. was.
    assert car.cg_to_front_axle_m - car.imu_x_m == pytest.approx(1.149)
    # With a lever arm, whichever comes first: from the C.G. of the car as it was.
    both = [Choice("mass_loading", {"cg_shift_m": shift_m}), Choice("imu_lever_arm", {"x_m": 0.5})]
    for chosen in (both, both[::-1]):
        car = with_effects(NOMINAL, chosen).car
        assert car.cg_to_front_axle_m - car.imu_x_m == pytest.approx(1.149 - 0.5)


def test_a_loaded_cars_imu_feels_the_turn_from_its_place() -> None:
    """C.G. 0.3 m back: the IMU, which was there, is 0.3 m ahead and feels the centripetal pull backwards."""
    turning = Programme(8.0, (SpeedChange(-2.0, -1.0, 12.0),), (SineSteer(0.5, 0.02, 1, 60.0 * DEG),))
    ahead = with_effect(replace(NOMINAL, programme=turning), "mass_loading", added_mass_kg=0.0, cg_shift_m=-0.3)
    centre = replace(ahead, car=replace(ahead.car, imu_x_m=0.0))
    felt, there = (
        drive(TwoTrackCar(world.car, FLAT), world.programme, start=rolling(world.car, 12.0))
        for world in (ahead, centre)
    )
    late = felt["time_s"] > 4.0
    rate = felt["gyro_z_radps"][late]
    assert rate.min() > 0.1
    assert (felt["accel_x_mps2"] - there["accel_x_mps2"])[late] == pytest.approx(-0.3 * rate**2, abs=1e-6)


def test_lean_and_dive_have_their_gradients_together() -> None:
    """Springs that are changed for the one must not change the other."""
    k_roll, k_pitch = 0.012, 0.004
    both = [
        Choice("suspension_roll", {"roll_gradient_rad_per_mps2": k_roll}),
        Choice("suspension_pitch", {"pitch_gradient_rad_per_mps2": k_pitch}),
    ]
    car = with_effects(NOMINAL, both).car
    # K k = m h (1 + g k), over what the axles' springs and bars resist.
    roll = (car.front_spring_n_per_m * 1.585**2 + car.rear_spring_n_per_m * 1.586**2) / 2.0
    roll += car.front_bar_nm_per_rad + car.rear_bar_nm_per_rad
    assert roll * k_roll == pytest.approx(1673.0 * 0.66 * (1.0 + G * k_roll))
    front, rear = 2.0 * car.front_spring_n_per_m, 2.0 * car.rear_spring_n_per_m
    pitch = front * rear / (front + rear) * 2.64**2
    assert pitch * k_pitch == pytest.approx(1673.0 * 0.66 * (1.0 + G * k_pitch))
    assert front / rear == pytest.approx(30000.0 / 32000.0)
    # And the axles share the lean's moment as before.
    front_nm = car.front_spring_n_per_m * 1.585**2 / 2.0 + car.front_bar_nm_per_rad
    before = 30000.0 * 1.585**2 / 2.0 + 24000.0
    assert front_nm / roll == pytest.approx(before / (before + 32000.0 * 1.586**2 / 2.0 + 12000.0))


@pytest.mark.parametrize("axle", ["front", "rear"])
def test_a_driven_wheel_slips_by_its_share_of_force_over_load(axle: str) -> None:
    slip_per_force, torque_nm = 0.05, 300.0
    car = with_effect(NOMINAL, "wheel_slip", slip_per_force=slip_per_force).car
    inputs = Inputs(front_drive_nm=torque_nm) if axle == "front" else Inputs(rear_drive_nm=torque_nm)
    vehicle, state = TwoTrackCar(car, FLAT), rolling(car, 15.0)
    for _ in range(2000):
        state = vehicle.next_state(state, vehicle.motion(state, inputs), inputs, inputs, 0.001)
    radius, arm = (0.337, 1.491) if axle == "front" else (0.340, 1.149)
    spin = state.spin_fl_radps if axle == "front" else state.spin_rl_radps
    rates = vehicle.motion(state, inputs).rates
    spin_rate = rates.spin_fl_radps if axle == "front" else rates.spin_rl_radps
    load = 1673.0 * G * arm / 2.64 / 2.0
    # The torque less what turns the wheel and rolling resistance is what the road gets.
    force = (torque_nm - 1.2 * spin_rate) / radius - 0.012 * load
    slip = spin * radius / state.forward_mps - 1.0
    assert slip == pytest.approx(slip_per_force * force / load, rel=0.01)


def test_a_ratio_that_varies_turns_the_wheels_less_the_further_either_way() -> None:
    steering = (SineSteer(0.0, 0.5, 1, 120.0 * DEG),)
    world = replace(NOMINAL, programme=Programme(2.0, (), steering))
    columns = drive(
        TwoTrackCar(with_effect(world, "steering_ratio", scale=1.1, per_rad=0.1).car, FLAT), world.programme
    )
    wheel, road = columns["steering_wheel_angle_rad"], columns["road_wheel_angle_rad"]
    assert wheel.max() == pytest.approx(120.0 * DEG, rel=1e-3)
    assert wheel.min() == pytest.approx(-120.0 * DEG, rel=1e-3)
    assert road == pytest.approx(wheel / (15.7 * 1.1 * (1.0 + 0.1 * np.abs(wheel))), abs=1e-12)


def test_zero_is_not_straight_ahead_by_the_offset() -> None:
    world = replace(NOMINAL, programme=Programme(2.0, (), (SineSteer(0.0, 0.5, 1, 60.0 * DEG),)))
    columns = drive(TwoTrackCar(with_effect(world, "steering_offset", offset_rad=0.02).car, FLAT), world.programme)
    road = columns["steering_wheel_angle_rad"] / 15.7 + 0.02
    assert columns["road_wheel_angle_rad"] == pytest.approx(road, abs=1e-12)


def test_a_larger_wheel_reads_less() -> None:
    """It turns less often on the same way, and the controller multiplies by the configured radius."""
    world = replace(NOMINAL, programme=Programme(2.0, (SpeedChange(-2.0, -1.0, 10.0),)))
    car = with_effect(world, "wheel_radius", fl=1.02, rr=0.97).car
    columns = drive(TwoTrackCar(car, FLAT), world.programme, start=rolling(car, 10.0))
    for wheel, scale in (("fl", 1.02), ("fr", 1.0), ("rl", 1.0), ("rr", 0.97)):
        assert columns[f"wheel_speed_{wheel}_mps"] == pytest.approx(columns["speed_mps"] / scale, rel=1e-9)


@pytest.mark.parametrize(("name", "angle"), [("road_bank", 0), ("road_grade", 1)])
def test_a_tilt_comes_on_top_of_the_roads_own_with_its_slope(name: str, angle: int) -> None:
    own = tabled_road(
        400.0, lambda s: 0.02 * np.sin(s / 30.0), lambda s: 0.03 * np.cos(s / 40.0), lambda s: 0.001 + 0.0 * s
    )
    road = with_effect(replace(NOMINAL, road=own), name, rms_rad=0.05, correlation_m=50.0).road
    at_m = np.arange(0.0, 399.0)
    before = np.column_stack([0.02 * np.sin(at_m / 30.0), 0.03 * np.cos(at_m / 40.0)])
    added = road.tilt[:399, :2] - before
    assert added[:, 1 - angle] == pytest.approx(0.0, abs=1e-5)
    assert 0.02 < np.sqrt(np.mean(added[:, angle] ** 2)) < 0.1
    for i in (0, 1):
        slope = np.gradient(road.tilt[:399, i], road.step_m)
        assert road.tilt[1:398, 2 + i] == pytest.approx(slope[1:398], abs=2e-5)
    assert road.bend_per_m[:399] == pytest.approx(0.001)
