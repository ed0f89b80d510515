"""diagnose: recordings on the grid, and what instruments show of one thing at a time, by hand values."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from core_cases import TUCSON
from scipy.signal import firwin, lfilter

from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose.effects.nuisances import TOLERATED
from dsz_daemon.diagnose.effects.row import SENSORS, Effect, Motion, Parameter
from dsz_daemon.diagnose.effects.surroundings import ROAD
from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, COLUMNS, EFFECTS, INDEX, vocabulary
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings import recording as recordings
from dsz_daemon.diagnose.recordings.recording import DT_S, Recording, recorded
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, nothing
from dsz_daemon.diagnose.simulation.instruments import followed
from dsz_daemon.diagnose.simulation.moving import ROLL, rolls_of
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.simulation.rolling import _unslipped, free_of, tells_engine_from_brakes
from dsz_daemon.diagnose.surroundings.profiles import Felt
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import WHEEL_SPEEDS

G = 9.80665
N = 3000
T = DT_S * np.arange(N)
RATIO = 16.0


def drive(v: np.ndarray, steer: np.ndarray | None = None) -> Drive:
    """A drive with wheels that all turn alike; its IMU is not looked at here."""
    wheels = np.tile(v[:, np.newaxis], (1, 4))
    steer = np.zeros(N) if steer is None else steer
    return drive_of(Recording(T, steer, wheels, np.zeros((N, 6)), np.ones(10)), TUCSON, RATIO)


def shown(one: Drive, **changed: float) -> np.ndarray:
    x = nothing()
    for name, value in changed.items():
        x[INDEX[name.replace("__", ".")]] = value
    return predicted(one, x, flat(N))


STANDING, CRUISING = drive(np.zeros(N)), drive(np.full(N, 20.0))
SPEEDING = drive(10.0 + 2.0 * T)
TURNING = drive(np.full(N, 10.0), np.full(N, 0.05))


def test_a_standing_car_reads_gravity_alone() -> None:
    np.testing.assert_allclose(shown(STANDING)[1500], [0, 0, 0, 0, 0, G, *[0] * 7], atol=1e-12)


def test_front_wheels_tell_the_speed_of_a_rear_driven_car() -> None:
    """They roll v / cos(delta) but for slip; a drive is the same, whichever axle gives the speed."""
    rear = TUCSON._replace(front_driven=False, rear_driven=True)
    steer = 0.3 * np.sin(2.0 * np.pi * T / 10.0)
    slow = np.tile(np.full(N, 3.0)[:, np.newaxis], (1, 4))
    there = shown(drive_of(Recording(T, np.full(N, 0.5), slow, np.zeros((N, 6)), np.ones(10)), rear, RATIO))
    assert there[2900, CHANNELS.index("reference_vx_mps")] == pytest.approx(3.0 * np.cos(0.5), rel=0.01)
    front = drive(7.0 + 2.0 * np.sin(T), steer)
    expected = shown(front)
    half = 0.5 * expected[:, CHANNELS.index("wheel_difference")]
    wheels = np.column_stack(
        [expected[:, 6], expected[:, 7], 7.0 + 2.0 * np.sin(T) - half, 7.0 + 2.0 * np.sin(T) + half]
    )
    other = shown(drive_of(Recording(T, steer, wheels, np.zeros((N, 6)), np.ones(10)), rear, RATIO))
    np.testing.assert_allclose(other[50:-50, 9], expected[50:-50, 9], atol=2e-3)
    np.testing.assert_allclose(other[50:-50, 2], expected[50:-50, 2], atol=5e-4)
    np.testing.assert_allclose(
        other[50:-50, 6:9], np.column_stack([wheels[:, 2:4], wheels[:, 1] - wheels[:, 0]])[50:-50], atol=3e-3
    )


def test_a_turned_imu_reads_as_the_contract_has_it() -> None:
    """reading_x = fx + yaw fy - pitch fz, reading_y = fy - yaw fx + roll fz, reading_z = fz + pitch fx - roll fy."""
    turns = {f"imu_misalignment__{axis}_rad": angle for axis, angle in (("roll", 0.01), ("pitch", 0.02), ("yaw", 0.03))}
    row = shown(SPEEDING, small_turns=1.0, **turns)
    assert row[1500, 3:6] == pytest.approx([2.0 - 0.02 * G, -0.03 * 2.0 + 0.01 * G, G + 0.02 * 2.0], rel=1e-6)


def test_an_imu_ahead_of_the_cg_feels_the_turn() -> None:
    """Steady: a_x less r^2 x, a_y less r^2 y."""
    plain, moved = shown(TURNING)[1500], shown(TURNING, imu_lever_arm__x_m=1.0, imu_lever_arm__y_m=0.5)[1500]
    r = plain[2]
    assert moved[3] - plain[3] == pytest.approx(-r * r)
    assert moved[4] - plain[4] == pytest.approx(-0.5 * r * r)


def test_scale_leak_offset_and_pull() -> None:
    plain = shown(TURNING)[1500]
    row = shown(
        TURNING,
        gyro_scale__z=0.1,
        accel_scale__y=-0.2,
        accel_cross_axis__xy=0.05,
        gyro_g_sensitivity__xz=1e-3,
        offset_accel_z=0.3,
    )[1500]
    assert row[2] == pytest.approx(1.1 * plain[2])
    assert row[4] == pytest.approx(0.8 * plain[4])
    assert row[3] - plain[3] == pytest.approx(0.05 * plain[4])
    assert row[0] == pytest.approx(1e-3 * G)
    assert row[5] == pytest.approx(G + 0.3)


def test_a_leaning_body_feels_the_turn_in_its_own_axes() -> None:
    """phi = k a_y, left side up: y reads a_y cos phi + g sin phi, z reads g cos phi - a_y sin phi."""
    plain = shown(TURNING)[2900]
    row, phi = shown(TURNING, suspension_roll__roll_gradient_rad_per_mps2=0.02)[2900], 0.02 * plain[4]
    assert row[4] == pytest.approx(plain[4] * np.cos(phi) + G * np.sin(phi), rel=1e-4)
    assert row[5] == pytest.approx(G * np.cos(phi) - plain[4] * np.sin(phi), rel=1e-4)


def test_late_sensors_show_what_was() -> None:
    """Speed 10 + t^2/2: a_x = t; the IMU 0.1 s late reads t - 0.1; wheels 0.1 s late: the car is at t + 0.1 already."""
    one = drive(10.0 + 0.5 * T**2)
    assert shown(one, imu_delay__delay_s=0.1)[1500, 3] == pytest.approx(14.9, abs=1e-6)
    assert shown(one, wheel_speed_delay__delay_s=0.1)[1500, 3] == pytest.approx(15.1, abs=1e-6)
    # What is shown of the wheels is as late as they are.
    assert shown(one, wheel_speed_delay__delay_s=0.1)[1500, 6] == pytest.approx(10.0 + 0.5 * 15.0**2, rel=1e-6)


def test_a_low_pass_lags_a_ramp_by_its_time_constant() -> None:
    one = drive(10.0 + 0.5 * T**2)
    assert shown(one, sensor_bandwidth__time_constant_s=0.2)[2500, 3] == pytest.approx(24.8, abs=1e-4)


def test_slipping_driven_wheels_run_ahead() -> None:
    """Front drive, 2 m/s2: F_x / F_z of the front = (a / g) / (l_r / L); the rear gives the speed."""
    share = (TUCSON.cg_to_rear_axle_m) / TUCSON.wheelbase_m
    row = shown(SPEEDING, wheel_slip__slip_per_force=0.05)[1500]
    assert row[6] == pytest.approx(SPEEDING.wheels[1500, 0] * (1.0 + 0.05 * (2.0 / G) / share), rel=1e-6)


@pytest.mark.parametrize("rear_driven", [False, True])
def test_a_driven_axle_that_loses_load_slips_more(rear_driven: bool) -> None:
    """At 2 m/s2 h a/(g L) of the weight goes to the rear: its axle, if that drives, carries so much more."""
    car, h = TUCSON._replace(front_driven=not rear_driven, rear_driven=rear_driven), 0.6
    one = SPEEDING._replace(car=car, front_gives_speed=rear_driven)
    share, moved = TUCSON.cg_to_rear_axle_m / TUCSON.wheelbase_m, h * 2.0 / (G * TUCSON.wheelbase_m)
    row = shown(one, wheel_slip__slip_per_force=0.05, wheel_slip__ahead_load_m=h)[1500]
    load = 1.0 - share + moved if rear_driven else share - moved
    assert row[6] == pytest.approx(one.wheels[1500, 0] * (1.0 + 0.05 * (2.0 / G) / load), rel=1e-5)


def test_a_car_is_slower_than_its_driven_front_wheels_that_give_the_speed() -> None:
    """By slip over force, k v'/g over the axle's share of the weight: to the first order, as it is made."""
    one = SPEEDING._replace(car=TUCSON._replace(front_driven=True, rear_driven=False), front_gives_speed=True)
    slip = 0.05 * (2.0 / G) / (TUCSON.cg_to_rear_axle_m / TUCSON.wheelbase_m)
    row = shown(one, wheel_slip__slip_per_force=0.05)[1500]
    assert one.wheels[1500, 0] / row[9] - 1.0 == pytest.approx(slip, rel=0.05)


def test_the_axle_that_gives_the_speed_slips_by_its_own_load() -> None:
    """Braked at 3 m/s2 the rear, whose wheels give the speed, loses h a/(g L) of the weight."""
    slowing, h = drive(90.0 - 3.0 * T), 0.6
    rear, moved = TUCSON.cg_to_front_axle_m / TUCSON.wheelbase_m, h * 3.0 / (G * TUCSON.wheelbase_m)
    row = shown(slowing, wheel_slip__slip_per_force=0.05, wheel_slip__ahead_load_m=h)[1500]
    slip = -0.05 * 3.0 / G * rear / (rear - moved)
    v = row[CHANNELS.index("reference_vx_mps")]
    assert slowing.wheels[1500, 2] / v == pytest.approx(1.0 + slip, rel=1e-4)


def test_the_inner_wheel_of_a_driven_axle_carries_less_and_slips_more() -> None:
    """Of m a h / t that go from the left to the right, of m g / 2 each: half the axle's force over what it carries."""
    one, h = drive(10.0 + 2.0 * T, np.full(N, 0.004)), 0.5
    slips = {"wheel_slip__slip_per_force": 0.05}
    level, loaded, without = shown(one, **slips), shown(one, **slips, wheel_slip__side_load_m=h), shown(one)
    i, turning = 1500, without[1500, 4]
    assert turning > 1.0
    moved = 2.0 * h * turning / (G * TUCSON.front_track_m)
    for wheel, carries in ((6, 1.0 - moved), (7, 1.0 + moved)):
        alike = level[i, wheel] / without[i, wheel] - 1.0
        assert loaded[i, wheel] / without[i, wheel] - 1.0 == pytest.approx(alike / carries, rel=2.0 * moved**2)
    # Of rear wheels that nothing drives neither slips; as they brake both do, and here the right one carries more.
    assert loaded[i, 8] == pytest.approx(without[i, 8], abs=1e-9)
    slowing = drive(60.0 - 2.0 * T, np.full(N, 0.004))
    level, loaded, without = shown(slowing, **slips), shown(slowing, **slips, wheel_slip__side_load_m=h), shown(slowing)
    i, turning = 1500, without[1500, 4]
    alike = 0.05 * -2.0 / G
    moved = 2.0 * h * turning / (G * TUCSON.rear_track_m)
    assert loaded[i, 8] - level[i, 8] == pytest.approx(30.0 * alike * -2.0 * moved, rel=0.05)


def test_larger_wheels_show_less_than_the_car_does() -> None:
    row = shown(CRUISING, wheel_radius__fl=0.01, wheel_radius__rl=0.02, wheel_radius__rr=0.02)[1500]
    assert row[6] == pytest.approx(20.0 * 1.02 / 1.01)
    assert row[7] == pytest.approx(20.0 * 1.02)


def test_more_ratio_turns_the_wheels_less() -> None:
    """Small angles: the yaw rate is that of a steering angle divided by 1 + k + k1 |hand wheel|."""
    plain = shown(drive(np.full(N, 10.0), np.full(N, 0.05 / (1.0 + 0.1 + 0.02 * 0.05 * RATIO))))[1500, 2]
    assert shown(TURNING, steering_ratio__scale=0.1, steering_ratio__per_rad=0.02)[1500, 2] == pytest.approx(plain)


@pytest.mark.parametrize("name", [parameter.name for parameter in TOLERATED if parameter.name != "steering_ratio"])
def test_a_share_of_a_configured_parameter_is_another_car(name: str) -> None:
    v, steer = 12.0 + np.sin(T), 0.05 * np.sin(2.0 * T)
    other = TUCSON._replace(**{name: 1.1 * getattr(TUCSON, name)})
    wheels = np.tile(v[:, np.newaxis], (1, 4))
    expected = shown(drive_of(Recording(T, steer, wheels, np.zeros((N, 6)), np.ones(10)), other, RATIO))
    np.testing.assert_allclose(shown(drive(v, steer), **{name: 0.1}), expected, atol=1e-9)
    assert np.abs(expected - shown(drive(v, steer))).max() > 1e-4


def test_more_ratio_than_configured_turns_the_wheels_less_and_early_steering_is_late() -> None:
    v, steer = np.full(N, 12.0), 0.05 * np.sin(2.0 * T)
    np.testing.assert_allclose(shown(drive(v, steer), steering_ratio=0.1), shown(drive(v, steer / 1.1)), atol=1e-9)
    late = shown(drive(v, steer), steering_delay__delay_s=0.002)
    np.testing.assert_allclose(shown(drive(v, steer), steering_skew_s=0.002), late, atol=1e-9)


def test_drift_grows_from_the_middle() -> None:
    rows = shown(STANDING, bias_drift__gyro_y=1e-3)[:, 1]
    assert rows[-1] - rows[0] == pytest.approx(1e-3 * (N - 1) * DT_S)
    assert np.mean(rows) == pytest.approx(0.0, abs=1e-5)


def test_a_felt_road_is_the_integral_of_what_the_gyros_have_left() -> None:
    """The road climbs to 0.1 rad within 10 s: the nose rises, q is negative; ax then reads g sin(0.1) more."""
    climb = np.clip((T - 5.0) / 10.0, 0.0, 1.0) * 0.1
    one = drive(np.full(N, 20.0))
    one.measured[:, 1] = -np.gradient(climb, DT_S)
    road = Felt(one, nothing(), ("road_grade",))(nothing())
    # But for its corners, which are rounder than a road's.
    np.testing.assert_allclose(road.grade_rad, climb, atol=1e-3)
    np.testing.assert_allclose(road.grade_rad[600:1400], climb[600:1400], atol=2e-4)
    assert predicted(one, nothing(), road)[2500, 3] == pytest.approx(G * np.sin(0.1), rel=1e-3)


def test_every_parameter_does_something_and_has_a_place_of_its_own() -> None:
    """At a plain size, on a drive with everything in it."""
    busy = drive(15.0 + 5.0 * np.sin(0.5 * T), 0.05 * np.sin(2.0 * T))
    base = shown(busy)
    assert len(INDEX) == len(COLUMNS)
    for effect in (*EFFECTS, *ROAD):
        for parameter in effect.parameters:
            x = nothing()
            x[INDEX[f"{effect.name}.{parameter.name}"]] = parameter.step
            changed = np.abs(predicted(busy, x, flat(N)) - base).max(axis=0)
            silent = effect.name in {"gyro_scale", "gyro_cross_axis"} and parameter.name in {
                "x",
                "y",
                "xy",
                "yx",
                "zx",
                "zy",
            }
            # Nothing rolls or pitches here: what only those show shows nothing.
            silent |= effect.name == "imu_lever_arm" and parameter.name == "z_m"
            silent |= parameter.name in {
                "frequency_share",
                "damping",
                "above_m",
                "swings_m",
                "ahead_m",
                "front_brakes_more",
                "air_per_m",
                "resistance",
                "spun_share",
                "front_drives_more",
                "engine_brakes_mps2",
                "ahead_load_m",
                "side_load_m",
                "fades_per_s",
                "before_offset",
                "turns",
                "sharpness",
                "brush",
                "centred",
                "begins",
                "ellipse",
                "leans",
            }
            # A stretch needs all of its parameters: it has a test of its own.
            silent |= effect.name == "low_friction"
            assert silent or changed.max() > 1e-6, (effect.name, parameter.name)


@pytest.mark.parametrize("cube", [-1.0 / 3.0, 1.0 / 6.0])
def test_an_angle_may_be_drawn_as_something_else_of_it(cube: float) -> None:
    """Steered by 0.2 rad with a cube of it is steered by that angle: so are those whose sine or tangent it is."""
    wanted = 0.2 + cube * 0.2**3
    assert wanted == pytest.approx({-1.0 / 3.0: math.atan(0.2), 1.0 / 6.0: math.asin(0.2)}[cube], abs=7e-5)
    x = nothing()
    x[INDEX["large_angles"]] = cube
    other = drive(np.full(N, 5.0), np.full(N, wanted))
    one = drive(np.full(N, 5.0), np.full(N, 0.2))
    np.testing.assert_allclose(predicted(one, x, flat(N)), predicted(other, nothing(), flat(N)), atol=1e-12)
    assert not np.allclose(predicted(one, nothing(), flat(N)), predicted(other, nothing(), flat(N)), atol=1e-4)


@pytest.mark.parametrize(("name", "begins_s", "ends_s"), [("steered_pull", 2.0, 13.0), ("steered_brake", 17.0, 28.0)])
def test_drive_and_brakes_along_steered_wheels_are_two_numbers(name: str, begins_s: float, ends_s: float) -> None:
    """Up by 1 m/s2 for 15 s and down by 2: each changes the yaw rate where it is, by little else where it is not."""
    v = np.where(T < 15.0, 10.0 + T, 25.0 - 1.2 * (T - 15.0))
    one, x = drive(v, np.full(N, 0.02)), nothing()
    x[INDEX[name]] = 1.0
    more = np.abs(predicted(one, x, flat(N)) - predicted(one, nothing(), flat(N)))[:, 2]
    inside = (begins_s < T) & (ends_s > T)
    beyond = (T > 2.0) & (T < 28.0) & ((begins_s - 3.0 > T) | (ends_s + 3.0 < T))
    assert np.min(more[inside]) > 20.0 * np.max(more[beyond])
    assert np.min(more[inside]) > 1e-4


def test_readings_clip_and_z_only_where_it_stands_at_the_limit() -> None:
    row = shown(SPEEDING, sensor_saturation__accel_limit_mps2=1.5)[1500]
    assert row[3] == pytest.approx(1.5)
    assert row[5] == pytest.approx(1.5)
    upright = drive(10.0 + 2.0 * T)
    upright.measured[:, 5] = G
    row = shown(upright, sensor_saturation__accel_limit_mps2=1.5)[1500]
    assert (row[3], row[5]) == (pytest.approx(1.5), pytest.approx(G))
    assert np.max(np.abs(shown(TURNING, sensor_saturation__gyro_limit_radps=0.1)[:, 2])) == pytest.approx(0.1)


def test_a_gyro_that_clips_before_its_offset_stands_beside_its_limit() -> None:
    clips = {"sensor_saturation__gyro_limit_radps": 0.1, "offset_gyro_z": -0.03}
    assert np.max(shown(TURNING, **clips, sensor_saturation__before_offset=1.0)[:, 2]) == pytest.approx(0.07)
    assert np.max(shown(TURNING, **clips)[:, 2]) == pytest.approx(0.1)


def test_a_slippery_stretch_begins_and_ends() -> None:
    """0.2 g are 1.96 m/s2 at most: some 90 % of it for 1.7 wanted ones, and all of these before and after."""
    x = nothing()
    x[INDEX["low_friction.inverse_square"]] = 0.2**-2
    x[INDEX["low_friction.start_s"]], x[INDEX["low_friction.end_s"]] = 10.0, 20.0
    slippery, dry = predicted(TURNING, x, flat(N))[:, 4], shown(TURNING)[:, 4]
    np.testing.assert_array_equal(slippery[:1000], dry[:1000])
    assert dry[1500] > 1.7
    assert slippery[1500] < 0.97 * dry[1500]
    assert slippery[2900] == pytest.approx(dry[2900], rel=1e-3)


def test_a_body_that_leans_about_an_axis_below_it_feels_its_own_swing() -> None:
    """Second route: the C.G. is h above the roll axis, so that it swings sideways by -h phi''."""
    swerve = drive(np.full(N, 15.0), 0.02 * np.sin(6.0 * T))
    base = shown(swerve, suspension_roll__roll_gradient_rad_per_mps2=0.01)
    high = shown(swerve, suspension_roll__roll_gradient_rad_per_mps2=0.01, suspension_roll__above_m=0.4)
    roll_rate = base[:, 0] - shown(swerve)[:, 0]
    expected = -0.4 * np.gradient(roll_rate, DT_S)
    np.testing.assert_allclose((high - base)[100:-100, 4], expected[100:-100], atol=0.02 * np.max(np.abs(expected)))


def test_a_diving_body_swings_about_its_axis() -> None:
    """The C.G. 0.3 m above and 0.5 m ahead of the pitch axis: a_x has 0.3 theta'', a_z has -0.5 theta''."""
    braking = drive(20.0 + 2.0 * np.sin(4.0 * T))
    pitching = {"suspension_pitch__pitch_gradient_rad_per_mps2": 0.005}
    base = shown(braking, **pitching)
    moved = shown(braking, **pitching, suspension_pitch__above_m=0.3, suspension_pitch__ahead_m=0.5)
    swing = np.gradient(base[:, 1], DT_S)
    change, middle = moved - base, slice(200, -200)
    np.testing.assert_allclose(change[middle, 5], -0.5 * swing[middle], atol=0.02 * np.max(np.abs(swing)))
    # a_x passes its own low-pass, which takes a sixth of 4 rad/s.
    expected = 0.3 * np.exp(-0.5 * (4 * 0.15) ** 2) * swing
    np.testing.assert_allclose(change[middle, 3], expected[middle], atol=0.03 * np.max(np.abs(expected)))


def test_brakes_at_the_front_slip_at_the_front() -> None:
    """Half more than by load: 1.5 times the slip there; the rear has what is left."""
    slowing = drive(60.0 - 2.0 * T)
    share = TUCSON.cg_to_rear_axle_m / TUCSON.wheelbase_m
    row = shown(slowing, wheel_slip__slip_per_force=0.05, wheel_slip__front_brakes_more=0.2)[1500]
    rear = -0.05 * 2.0 / G * (1.0 - 1.2 * share) / (1.0 - share)
    front = -0.05 * 2.0 / G * 1.2
    assert row[6] / 30.0 == pytest.approx((1.0 + front) / (1.0 + rear), rel=1e-4)


@pytest.mark.parametrize(("slows_mps2", "by_engine_mps2"), [(2.0, 1.5), (1.0, 1.0)])
def test_an_engine_brakes_by_the_axle_that_it_drives(slows_mps2: float, by_engine_mps2: float) -> None:
    """Of 2 m/s2 it takes 1.5, all at the front, and the brakes the rest by load; of 1 m/s2 all. The rear gives v."""
    slowing = drive(60.0 - slows_mps2 * T)
    share = TUCSON.cg_to_rear_axle_m / TUCSON.wheelbase_m
    row = shown(slowing, wheel_slip__slip_per_force=0.05, wheel_slip__engine_brakes_mps2=1.5)[1500]
    rear = -0.05 * (slows_mps2 - by_engine_mps2) / G
    front = rear - 0.05 * by_engine_mps2 / G / share
    assert row[6] / slowing.wheels[1500, 2] == pytest.approx((1.0 + front) / (1.0 + rear), rel=1e-4)
    v = row[CHANNELS.index("reference_vx_mps")]
    assert slowing.wheels[1500, 2] / v == pytest.approx(1.0 + rear, rel=1e-4)


@pytest.mark.parametrize(("driven", "braked", "engine"), [(6e-3, 4e-3, 0.8), (0.0, 6e-3, 1.5), (1e-2, 2e-3, 1.5)])
def test_slip_follows_from_the_speed_where_an_engine_brakes(driven: float, braked: float, engine: float) -> None:
    """Wheels roll v (1 + s), s by its own slope beyond where the engine ends; back to v, to a thirtieth of v s."""
    pull = 4.0 * np.sin(0.7 * T) + 1.5 * np.sin(2.1 * T)
    against = np.full(N, 0.2)
    v = 20.0 + DT_S * np.cumsum(pull - against)
    rate = np.gradient(v, DT_S) + against
    slip = driven * np.maximum(rate, -engine) + braked * np.minimum(rate + engine, 0.0)
    found = _unslipped(v * (1.0 + slip), against, np.ones(N), driven, braked, engine, DT_S)
    inside = slice(100, -100)
    assert np.std((found - v)[inside]) < 0.033 * np.std((v * slip)[inside])


@pytest.mark.parametrize(
    ("driven", "pull_mps2", "front", "rear"),
    [
        # 2 / 9.80665 of the car's weight at the front axle, which bears 1.491 / 2.64 of it: 0.3611 of 0.5 is used.
        ("front", 2.0, math.sqrt(1.0 - (2.0 / 9.80665 / (1.491 / 2.64) / 0.5) ** 2), 1.0),
        ("rear", 2.0, 1.0, math.sqrt(1.0 - (2.0 / 9.80665 / (1.149 / 2.64) / 0.5) ** 2)),
        # Brakes follow the load.
        ("front", -3.0, *[math.sqrt(1.0 - (3.0 / 9.80665 / 0.5) ** 2)] * 2),
        # No axle is driven beyond its grip.
        ("front", 4.0, 0.05, 1.0),
    ],
)
def test_drive_and_brakes_take_of_the_side_force_what_the_ellipse_says(
    driven: str, pull_mps2: float, front: float, rear: float
) -> None:
    car = TUCSON._replace(front_driven=driven == "front", rear_driven=driven == "rear")
    assert car.cg_to_rear_axle_m == 1.491
    assert car.wheelbase_m == pytest.approx(2.64)
    grip, level = np.full(N, 0.5**-2), np.zeros(N)
    middle = N // 2
    found = free_of(car, 0.0, 5.0 + pull_mps2 * T, grip, level)
    assert [one[middle] for one in found] == [pytest.approx(front, rel=1e-3), pytest.approx(rear, rel=1e-3)]
    # A climb is pulled up as well; where grip does not end nothing is taken.
    climb = np.full(N, pull_mps2 / 9.80665)
    for one, expected in zip(free_of(car, 0.0, np.full(N, 5.0), grip, climb), (front, rear), strict=True):
        assert one[middle] == pytest.approx(expected, rel=1e-3)
    for one in free_of(car, 0.0, 5.0 + pull_mps2 * T, level, level):
        assert (one == 1.0).all()


def test_brakes_at_the_front_take_of_the_front_axles_side_force() -> None:
    front, rear = (one[N // 2] for one in free_of(TUCSON, 0.3, 60.0 - 3.0 * T, np.full(N, 0.5**-2), np.zeros(N)))
    share = 1.491 / 2.64
    assert front == pytest.approx(math.sqrt(1.0 - (3.0 / 9.80665 * 1.3 / 0.5) ** 2), rel=1e-3)
    assert rear == pytest.approx(
        math.sqrt(1.0 - (3.0 / 9.80665 * (1.0 - 1.3 * share) / (1.0 - share) / 0.5) ** 2), rel=1e-3
    )


@pytest.mark.parametrize("car", [TUCSON, TUCSON._replace(front_driven=False, rear_driven=True)])
def test_what_is_known_before_the_car_moves_sideways_is_the_same_for_all_other_parameters(car: Car) -> None:
    """A slope that takes it from where it is looked from is the one that does not, for each single parameter."""
    v, steer = 12.0 + 3.0 * np.sin(0.4 * T), 0.05 * np.sin(T)
    wheels = np.tile(v[:, np.newaxis], (1, 4)) * [1.0, 1.01, 0.99, 1.0]
    one = drive_of(Recording(T, steer, wheels, np.zeros((N, 6)), np.ones(10)), car, RATIO)
    x = 3.0 * np.array([parameter.step for _, parameter in BUILT_IN.columns])
    x[INDEX["low_friction.start_s"]], x[INDEX["low_friction.end_s"]] = 5.0, 20.0
    x[[INDEX["low_friction.inverse_square"], INDEX["low_friction.ellipse"]]] = 0.3**-2, 0.5
    road = flat(N)._replace(bank_rad=0.02 * np.sin(0.3 * T), grade_rad=0.02 * np.cos(0.3 * T), side_n=200.0 * np.sin(T))
    rolls = rolls_of(one, x, road)
    for i, (effect, parameter) in enumerate(BUILT_IN.columns):
        other = x.copy()
        other[i] += parameter.step
        if not ROLL & {effect, parameter.name}:
            again = rolls_of(one, other, road)
            assert all(np.array_equal(*pair) for pair in zip(rolls, again, strict=True)), (effect, parameter.name)
            np.testing.assert_array_equal(predicted(one, other, road, rolls), predicted(one, other, road))


def test_a_car_that_speeds_up_on_ice_goes_straight() -> None:
    """A driven front axle near the end of its grip steers by less than half of what one that rolls does."""
    one = drive(5.0 + 2.0 * T, np.full(N, 0.01))
    ice = {"low_friction.inverse_square": 0.4**-2, "low_friction.start_s": 0.0, "low_friction.end_s": 99.0}
    x = nothing()
    for name, value in (*ice.items(), ("low_friction.ellipse", 1.0)):
        x[INDEX[name]] = value
    uphill = predicted(one, x, flat(N)._replace(grade_rad=np.full(N, 0.05)))
    rolls, there, dry = shown(one, **ice), shown(one, **ice, **{"low_friction.ellipse": 1.0}), shown(one)
    assert there[N // 2, 2] < 0.5 * dry[N // 2, 2]
    assert rolls[N // 2, 2] > 0.8 * dry[N // 2, 2]
    # Uphill it takes more.
    assert uphill[N // 2, 2] < 0.9 * there[N // 2, 2]


def test_wind_is_found_from_what_the_accelerometer_has_left() -> None:
    """A gust of 800 N; its slow part shows less, since the tyres hold against it."""
    one = drive(np.full(N, 20.0))
    gust = 800.0 * np.exp(-0.5 * ((T - 15.0) / 0.8) ** 2)
    one.measured[:] = predicted(one, nothing(), flat(N)._replace(side_n=gust))
    found = Felt(one, nothing(), ("side_wind",))(nothing()).side_n
    np.testing.assert_allclose(found, gust, atol=40.0)


def test_an_effect_of_ones_own_is_added_to_its_channels() -> None:
    def drag(motion: Motion, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        return {"accel_z": values["k"] * motion.speed_mps**2}

    words = vocabulary(
        (Effect("lift", "Air lifts", "k v^2", SENSORS, (Parameter("k", "1/m", 1e-3, -1, 1, 0.0),), drag),)
    )
    one = drive(np.full(N, 20.0))._replace(vocabulary=words)
    x = nothing(words)
    assert len(x) == len(nothing()) + 1
    x[-1] = 0.01
    assert predicted(one, x, flat(N))[1500, 5] == pytest.approx(G + 0.01 * 400.0)
    with pytest.raises(ValueError, match="gyro_scale are there twice"):
        vocabulary((Effect("gyro_scale", "", "", SENSORS, (), drag),))
    with pytest.raises(ValueError, match="shows nothing"):
        vocabulary((Effect("mine", "", "", SENSORS, ()),))


# --- the recording ----------------------------------------------------------------------------------


def signal(at_s: np.ndarray, values: np.ndarray) -> Signal:
    return Signal((1_000_000_000 * (100.0 + at_s)).astype(np.int64), values)


def test_a_ramp_passes_the_filter_unchanged_and_noise_is_measured() -> None:
    at_s, rng = np.arange(0.0, 20.0, 0.01), np.random.default_rng(3)
    signals = {name: signal(at_s, 3.0 * at_s) for name in (*WHEEL_SPEEDS, "steering_wheel_angle")}
    signals["gyro_x"] = signal(at_s, 0.5 * at_s + rng.normal(0.0, 0.2, len(at_s)))
    found = recorded(signals, RATIO)
    middle = slice(100, -100)
    np.testing.assert_allclose(found.wheels_mps[middle, 0], 3.0 * found.time_s[middle], atol=1e-9)
    np.testing.assert_allclose(found.road_wheel_angle_rad[middle], 3.0 * found.time_s[middle] / RATIO, atol=1e-9)
    scatter = np.std(found.imu[middle, 0] - 0.5 * found.time_s[middle])
    assert found.floor[0] == pytest.approx(scatter, rel=0.15)
    assert np.isnan(found.imu[:, 1:]).all()


def test_rounding_is_noise_where_it_hides_noise() -> None:
    """Wheel speeds in steps of 0.01 m/s that change by less between two rows."""
    at_s = np.arange(0.0, 60.0, 0.01)
    course = 10.0 + 0.3 * at_s + 2.0 * np.sin(0.3 * at_s)
    signals = {name: signal(at_s, np.round(course, 2)) for name in WHEEL_SPEEDS}
    signals |= {"steering_wheel_angle": signal(at_s, 0.0 * at_s), "gyro_x": signal(at_s, 0.5 * at_s)}
    found, smooth = recorded(signals, RATIO), recorded(signals | {"wheel_speed_fl": signal(at_s, course)}, RATIO)
    error = (found.wheels_mps - smooth.wheels_mps)[100:-100, 0]
    assert found.floor[6] == pytest.approx(np.std(error), rel=0.5)
    assert smooth.floor[6] < 0.1 * found.floor[6]


def test_a_long_hole_is_not_made_up() -> None:
    at_s = np.concatenate((np.arange(0.0, 5.0, 0.02), np.arange(6.0, 10.0, 0.02)))
    signals = {name: signal(at_s, at_s) for name in (*WHEEL_SPEEDS, "gyro_z")}
    found = recorded(signals, RATIO)
    assert np.isnan(found.imu[520:580, 2]).all()
    assert np.isfinite(found.imu[650:900, 2]).all()


def test_the_filter_has_half_the_power_at_its_corner() -> None:
    kernel = recordings.filter_kernel()
    corner_hz = np.sqrt(np.log(2.0)) / (2.0 * np.pi * recordings.FILTER_S)
    reach = len(kernel) // 2
    response = np.sum(kernel * np.cos(2.0 * np.pi * corner_hz * DT_S * np.arange(-reach, reach + 1)))
    assert response**2 == pytest.approx(0.5, rel=1e-2)
    assert corner_hz == pytest.approx(2.2, abs=0.05)


def test_channels_are_thirteen() -> None:
    assert len(CHANNELS) == 13


@pytest.mark.parametrize(("name", "rate_mps2"), [("drive_steer", 2.0), ("brake_steer", -2.0)])
@pytest.mark.parametrize("by_force", [0.0, 1.0])
def test_a_car_that_pulls_aside_goes_as_if_it_were_steered(name: str, rate_mps2: float, by_force: float) -> None:
    """By rad over m/s2, by force of rolling and air (0.12 and 2.6e-4 v^2), too; and not at all the other way."""
    speed = (10.0 if rate_mps2 > 0.0 else 60.0) + rate_mps2 * T
    values = {name: 3e-4, "steers_by_force": by_force}
    pulls = shown(drive(speed), **values)
    steer = 3e-4 * (rate_mps2 + by_force * (0.12 + 2.6e-4 * speed**2))
    np.testing.assert_allclose(pulls, shown(drive(speed, steer)), atol=1e-12)
    assert abs(pulls[1500, 2]) > 1e-3
    other = drive(speed[::-1].copy())
    np.testing.assert_array_equal(shown(other, **values), shown(other))


def test_the_filters_are_scipys() -> None:
    """Second route: its first order with the input straight between two instants, and its windowed low-pass."""
    values, keep = np.random.default_rng(3).normal(size=(400, 6)), math.exp(-DT_S / 0.05)
    share = 1.0 + (keep - 1.0) * 0.05 / DT_S
    zi = (values[0] * (1.0 - share))[np.newaxis]
    expected = lfilter([share, 1.0 - keep - share], [1.0, -keep], values, axis=0, zi=zi)[0]
    np.testing.assert_allclose(followed(values, 0.05, DT_S), expected, atol=1e-12)
    np.testing.assert_allclose(recordings.sharp_kernel(1.5), firwin(201, 1.5, fs=1.0 / DT_S), atol=1e-15)


@pytest.mark.parametrize("accelerations_mps2", [2.5 * np.sin(0.8 * T), np.where(np.sin(0.8 * T) > 0.0, 3.0, -3.0)])
def test_slip_follows_from_the_speed_without_it(accelerations_mps2: np.ndarray) -> None:
    """Rear wheels that only brake roll v (1 + k v'/g), at a brake's edge, too: there they are ahead of the car."""
    k = 0.1
    v = 20.0 + DT_S * np.cumsum(accelerations_mps2)
    rate = 0.5 * (accelerations_mps2 + np.append(accelerations_mps2[1:], accelerations_mps2[-1]))
    rolls = v * (1.0 + k * np.minimum(rate, 0.0) / G)
    found = shown(drive(rolls), wheel_slip__slip_per_force=k)[:, CHANNELS.index("reference_vx_mps")]
    inside = slice(100, -100)
    assert np.std((found - v)[inside]) < 0.04 * np.std((rolls - v)[inside])
    assert np.max(np.abs(found - v)[inside]) < 0.05


def test_wheels_that_nothing_drives_are_spun_up_by_the_road() -> None:
    """Front drive at 2 m/s2: 0.02 of the car's mass behind, against it, on the rear's load; so much more in front."""
    wheelbase_m = TUCSON.wheelbase_m
    front_load, rear_load = TUCSON.cg_to_rear_axle_m / wheelbase_m, TUCSON.cg_to_front_axle_m / wheelbase_m
    row = shown(SPEEDING, wheel_slip__slip_per_force=0.05, wheel_slip__spun_share=0.02)[1500]
    rear, front = (1.0 + 0.05 * 2.0 / G * share for share in (-0.02 / rear_load, 1.02 / front_load))
    assert row[6] / SPEEDING.wheels[1500, 0] == pytest.approx(front / rear, abs=2e-5)


@pytest.mark.parametrize("more", [0.0, 0.3])
def test_of_two_driven_axles_the_one_that_drives_more_slips_more(more: float) -> None:
    """At 2 m/s2: by load both slip alike; 1.3 times that in front leaves the rear the rest. Brakes don't know of it."""
    both = TUCSON._replace(front_driven=True, rear_driven=True)
    share = TUCSON.cg_to_rear_axle_m / TUCSON.wheelbase_m
    parameters = {"wheel_slip__slip_per_force": 0.05, "wheel_slip__front_drives_more": more}
    row = shown(SPEEDING._replace(car=both), **parameters)[1500]
    front, rear = 2.0 / G * (1.0 + more), 2.0 / G * (1.0 - (1.0 + more) * share) / (1.0 - share)
    expected = (1.0 + 0.05 * front) / (1.0 + 0.05 * rear)
    assert row[6] / SPEEDING.wheels[1500, 0] == pytest.approx(expected, abs=2e-4)
    slowing = drive(60.0 - 2.0 * T)._replace(car=both)
    assert shown(slowing, **parameters)[1500, 6] == shown(slowing, wheel_slip__slip_per_force=0.05)[1500, 6]


@pytest.mark.parametrize(("brakes_mps2", "for_s", "tells"), [(2.0, 6.0, True), (2.0, 3.0, False), (1.2, 6.0, False)])
def test_an_engine_is_told_from_brakes_by_a_car_that_brakes(brakes_mps2: float, for_s: float, tells: bool) -> None:
    """Longer than for 4 s by more than 1.5 m/s2: of what slows a car else the shares that brakes have say all."""
    speed = 25.0 - brakes_mps2 * np.clip(T - 5.0, 0.0, for_s)
    assert tells_engine_from_brakes(np.tile(speed[:, np.newaxis], (1, 4))) is tells


@pytest.mark.parametrize("tells", [True, False])
def test_what_an_engine_brakes_is_fitted_where_it_is_told(monkeypatch: pytest.MonkeyPatch, tells: bool) -> None:
    monkeypatch.setattr("dsz_daemon.diagnose.fitting.fit.tells_engine_from_brakes", lambda _: tells)
    one = drive(15.0 + 3.0 * np.sin(0.5 * T))
    x = nothing()
    x[INDEX["wheel_slip.slip_per_force"]] = 0.03
    found = fitted(one, rows_of(one), x, ("wheel_slip",), {})
    assert (INDEX["wheel_slip.engine_brakes_mps2"] in found.columns) is tells
