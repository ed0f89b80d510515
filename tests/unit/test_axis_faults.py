"""Axis faults: each one found and mended in arrays written by hand and in simulated drives, nothing called one else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dsz_daemon.diagnose.faults.axis_faults import found_faults
from dsz_daemon.diagnose.faults.wiring import KINDS, AxisFault, Wiring, mended, wiring_of
from dsz_daemon.diagnose.recordings.recording import recorded
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.runs.diagnose import signals_of
from dsz_daemon.runs.setup import set_up
from dsz_daemon.runs.simulate import simulate
from dsz_daemon.signals import IMU_CHANNELS
from dsz_daemon.sim import effects_of_sensors
from tests.real.recordings import ABSENT, CARS, DATA, NO_OPENDBC

G = 9.80665
N = 9000  # of 10 ms
T_S = 0.01 * np.arange(N)
ALL = np.ones((N, 6), dtype=bool)
OFFSETS = np.array([0.03, -0.08, 0.05, 0.9, -0.7, 0.4])
X, Y, Z = 3, 4, 5


def waves(rms: float, seed: int) -> np.ndarray:
    """What moves up and down within 4 to 15 s."""
    rng = np.random.default_rng(seed)
    rates = 2.0 * np.pi / rng.uniform(4.0, 15.0, 12)
    one = np.sum(np.sin(np.outer(T_S, rates) + rng.uniform(0.0, 6.28, 12)), axis=1)
    return rms * one / np.std(one)


def nominal(yaw_radps: float = 0.06, along: float = 0.6, across: float = 0.7) -> np.ndarray:
    found = np.zeros((N, 6))
    found[:, 2] = waves(yaw_radps, 1)
    found[:, X], found[:, Y], found[:, Z] = waves(along, 2), waves(across, 3), G
    return found


def measured(right: np.ndarray, seed: int = 9) -> np.ndarray:
    """With the noise that a filter leaves: white within 0.1 s, and offsets."""
    noise = np.random.default_rng(seed).normal(0.0, 1.0, (N // 10, 6)).repeat(10, axis=0)
    return right + OFFSETS + noise * [0.002, 0.002, 0.002, 0.05, 0.05, 0.05]


def said(imu: np.ndarray, expected: np.ndarray, used: np.ndarray = ALL) -> list[tuple[str, str]]:
    return [(fault.channel, fault.kind) for fault in found_faults(imu, expected, used)]


def reversed_(imu: np.ndarray, channel: int) -> np.ndarray:
    factors = np.ones(6)
    factors[channel] = -1.0
    return imu * factors


def swapped(imu: np.ndarray, a: int, b: int) -> np.ndarray:
    order = list(range(6))
    order[a], order[b] = b, a
    return imu[:, order]


def scaled(imu: np.ndarray, channel: int, factor: float) -> np.ndarray:
    factors = np.ones(6)
    factors[channel] = factor
    return imu * factors


NOMINAL = nominal()
RIGHT = measured(NOMINAL)
DEG = 57.29577951308232
FAULTY = {
    ("gyro_z", "reversed"): reversed_(RIGHT, 2),
    ("accel_x", "reversed"): reversed_(RIGHT, X),
    ("accel_y", "reversed"): reversed_(RIGHT, Y),
    ("accel_z", "reversed"): reversed_(RIGHT, Z),
    ("gyro_x", "swapped_with_z"): swapped(RIGHT, 0, 2),
    ("gyro_y", "swapped_with_z"): swapped(RIGHT, 1, 2),
    ("accel_x", "swapped_with_y"): swapped(RIGHT, X, Y),
    ("accel_x", "swapped_with_z"): swapped(RIGHT, X, Z),
    ("accel_y", "swapped_with_z"): swapped(RIGHT, Y, Z),
    ("gyro_y", "deg_for_rad"): scaled(RIGHT, 1, DEG),
    ("gyro_z", "deg_for_rad"): scaled(RIGHT, 2, DEG),
    ("gyro_z", "rad_for_deg"): scaled(RIGHT, 2, 1.0 / DEG),
    ("accel_x", "mps2_for_g"): scaled(RIGHT, X, G),
    ("accel_y", "mps2_for_g"): scaled(RIGHT, Y, G),
    ("accel_z", "mps2_for_g"): scaled(RIGHT, Z, G),
    ("accel_x", "g_for_mps2"): scaled(RIGHT, X, 1.0 / G),
    ("accel_y", "g_for_mps2"): scaled(RIGHT, Y, 1.0 / G),
    ("accel_z", "g_for_mps2"): scaled(RIGHT, Z, 1.0 / G),
}


def test_the_words_are_those_of_the_simulated_car() -> None:
    assert KINDS == effects_of_sensors.KINDS


@pytest.mark.parametrize("less", [0.3, 0.5])
def test_a_yaw_gyro_that_has_lost_its_sign_is_not_turned_round(less: float) -> None:
    """On a way that turns mostly to the right it goes mostly the wrong way; one that is turned round does so always."""
    right = nominal()
    right[:, 2] *= np.where(right[:, 2] > 0.0, less, 1.0)
    shown = measured(right)
    shown[:, 2] = np.abs(shown[:, 2] - OFFSETS[2])
    assert said(shown, right) == []
    assert said(reversed_(measured(right), 2), right) == [("gyro_z", "reversed")]


@pytest.mark.parametrize("faults", [[], [("gyro_z", "reversed")]])
def test_a_way_to_one_side_is_not_judged_by_what_is_next_to_nothing_to_the_other(faults: list[tuple[str, str]]) -> None:
    """Left turns, and little to the right, where the gyro shows the opposite."""
    right = nominal()
    right[:, 2] = np.where(right[:, 2] > 0.0, right[:, 2], 0.05 * right[:, 2])
    shown = measured(right)
    shown[:, 2] = np.where(right[:, 2] > 0.0, shown[:, 2], OFFSETS[2] - right[:, 2])
    assert said(reversed_(shown, 2) if faults else shown, right) == faults


def test_wired_right_nothing_is_said() -> None:
    assert said(RIGHT, NOMINAL) == []


@pytest.mark.parametrize(("factor", "expected"), [(1.0, []), (-1.0, [("gyro_z", "reversed")])])
def test_a_leak_of_a_yaw_gyro_that_clips_is_no_other_plug(factor: float, expected: list[tuple[str, str]]) -> None:
    """It follows a turn better than the gyro that clips; 0.042 is nearer to a radian for a degree than to 1."""
    imu = RIGHT.copy()
    imu[:, 1] = NOMINAL[:, 2] * 0.042 + np.random.default_rng(2).normal(0.0, 0.0003, N // 10).repeat(10)
    imu[:, 2] = factor * np.clip(RIGHT[:, 2], -0.07, 0.07)
    assert said(imu, NOMINAL) == expected


@pytest.mark.parametrize("planted", FAULTY, ids=" ".join)
def test_each_fault_is_found_alone_and_mended(planted: tuple[str, str]) -> None:
    imu = FAULTY[planted]
    found = found_faults(imu, NOMINAL, ALL)
    assert [(fault.channel, fault.kind) for fault in found] == [planted]
    assert found[0].gain > 10.0
    assert planted[0] in found[0].evidence
    np.testing.assert_allclose(mended(imu, found), RIGHT, rtol=1e-12)
    np.testing.assert_allclose(wiring_of(found).faulty(RIGHT), imu, rtol=1e-12)


def test_the_evidence_has_figures() -> None:
    [fault] = found_faults(FAULTY["accel_y", "mps2_for_g"], NOMINAL, ALL)
    # 90 s, and 9.81 give or take what noise does.
    assert fault.evidence.startswith("accel_y moves 9.")
    assert "times the simulated accel_y (correlation 1.00, 90 s)" in fault.evidence
    [fault] = found_faults(FAULTY["accel_z", "reversed"], NOMINAL, ALL)
    # Gravity and an offset of 0.4.
    assert fault.evidence.startswith("accel_z shows -10.2 m/s^2 on average")


def test_several_faults_at_once() -> None:
    """A phone's axes (forward, right, down); all in g; in a circle; turned round and on another's plug."""
    phone = RIGHT * [1, -1, -1, 1, -1, -1]
    assert said(phone, NOMINAL) == [("gyro_z", "reversed"), ("accel_y", "reversed"), ("accel_z", "reversed")]
    in_g = RIGHT * [1, 1, 1, 1 / G, 1 / G, 1 / G]
    assert said(in_g, NOMINAL) == [(name, "g_for_mps2") for name in ("accel_x", "accel_y", "accel_z")]
    for circle in ([Y, Z, X], [Z, X, Y]):
        round_ = RIGHT[:, [0, 1, 2, *circle]]
        found = found_faults(round_, NOMINAL, ALL)
        assert len(found) == 2
        np.testing.assert_allclose(mended(round_, found), RIGHT, rtol=1e-12)
    both = swapped(reversed_(RIGHT, X), X, Y)
    found = found_faults(both, NOMINAL, ALL)
    assert {(one.channel, one.kind) for one in found} == {("accel_x", "swapped_with_y"), ("accel_x", "reversed")}
    np.testing.assert_allclose(mended(both, found), RIGHT, rtol=1e-12)


def test_a_unit_is_more_easily_believed_of_a_neighbour() -> None:
    """A roll gyro that shows 0.45 rad/s all the time: an offset, unless the yaw gyro is in deg/s for sure."""
    imu = RIGHT.copy()
    imu[:, 0] += 0.45 / DEG - OFFSETS[0]
    assert said(scaled(imu, 0, DEG), NOMINAL) == []
    assert said(imu * [DEG, 1, DEG, 1, 1, 1], NOMINAL) == [("gyro_x", "deg_for_rad"), ("gyro_z", "deg_for_rad")]


def test_a_fault_is_found_beside_a_scale_error_and_a_delay() -> None:
    for share in (0.6, 1.4):
        imu = reversed_(measured(np.roll(NOMINAL * [1, 1, share, 1, share, 1], 40, axis=0)), Y)
        [fault] = found_faults(imu, NOMINAL, ALL)
        assert (fault.channel, fault.kind) == ("accel_y", "reversed")
        assert float(fault.evidence.removeprefix("accel_y moves ").split()[0]) == pytest.approx(-share, rel=0.03)
        assert "correlation -1.00" in fault.evidence


def test_signals_are_mended_as_channels_are() -> None:
    """Reversed x on y's plug, y in g: each sample goes where it belongs, and no other role is touched."""
    faults = [
        AxisFault("accel_x", "swapped_with_y", 0.0, ""),
        AxisFault("accel_x", "reversed", 0.0, ""),
        AxisFault("accel_x", "g_for_mps2", 0.0, ""),
    ]
    wiring = wiring_of(faults)
    assert wiring.plugs == (0, 1, 2, 4, 3, 5)
    stamps = np.arange(2, dtype=np.int64)
    signals = {
        "accel_x": Signal(stamps, np.array([0.1, 0.2])),
        "accel_y": Signal(stamps + 5, np.array([3.0, 4.0])),
        "brake": Signal(stamps, np.array([1.0, 1.0])),
    }
    right = wiring.mended_signals(signals)
    assert set(right) == {"accel_x", "accel_y", "brake"}
    np.testing.assert_allclose(right["accel_y"].values, [0.980665, 1.96133])
    np.testing.assert_array_equal(right["accel_x"].values, [-3.0, -4.0])
    np.testing.assert_array_equal(right["accel_x"].t_ns, [5, 6])
    assert right["brake"] is signals["brake"]


def test_what_is_no_fault_of_an_axis() -> None:
    """Scale errors of 40 %, a lean, leaks and delays, an offset of 1 m/s^2 where gravity in g would be."""
    assert said(measured(NOMINAL * [1, 1, 0.6, 1.4, 0.6, 0.62]), NOMINAL) == []
    leaky = NOMINAL.copy()
    leaky[:, X] += 0.1 * NOMINAL[:, Y] - 0.15 * G
    leaky[:, 0] += 0.2 * NOMINAL[:, 2]
    assert said(measured(leaky), NOMINAL) == []
    assert said(measured(np.roll(NOMINAL, 40, axis=0)), NOMINAL) == []
    assert said(measured(np.roll(NOMINAL, -40, axis=0)), NOMINAL) == []
    compensated = RIGHT - [0, 0, 0, 0, 0, G]
    assert said(compensated, NOMINAL) == []


def test_a_sensor_that_shows_nothing_is_not_swapped() -> None:
    for channel in range(6):
        dead = RIGHT.copy()
        dead[:, channel] = 0.0
        assert said(dead, NOMINAL) == []
        dead[:, channel] = np.nan
        assert said(dead, NOMINAL) == []


def test_half_a_likeness_is_no_swap() -> None:
    """The yaw gyro is dead; the roll gyro has some of the yaw rate in it, too little or among too much else."""
    for share, noise_radps in ((0.3, 0.0), (0.6, 0.1)):
        imu = RIGHT.copy()
        imu[:, 2] = 0.01
        noise = np.random.default_rng(2).normal(0.0, noise_radps, N // 20).repeat(20)
        imu[:, 0] = share * NOMINAL[:, 2] + noise
        assert said(imu, NOMINAL) == []
    # So it would be one.
    imu[:, 0] = 0.6 * NOMINAL[:, 2]
    assert said(imu, NOMINAL) == [("gyro_x", "swapped_with_z")]
    # But not where the car as good as goes straight on.
    straight = nominal(yaw_radps=5e-4)
    imu[:, 0] = 0.6 * straight[:, 2]
    assert said(imu, straight) == []


def test_shuffled_in_time_there_is_nothing_to_be_followed() -> None:
    blocks = np.random.default_rng(4).permutation(90)
    shuffled = RIGHT.reshape(90, 100, 6)[blocks].reshape(N, 6)
    assert said(shuffled, NOMINAL) == []


def test_where_nothing_turns_nothing_is_guessed() -> None:
    """Straight on, at a steady speed: only where gravity is can be told."""
    straight = nominal(yaw_radps=2e-4, along=0.01, across=0.005)
    imu = measured(straight)
    for channel in (2, X, Y):
        assert said(reversed_(imu, channel), straight) == []
    assert said(swapped(imu, X, Y), straight) == []
    assert said(reversed_(imu, Z), straight) == [("accel_z", "reversed")]
    # Three quarters of gravity are nearer to it than to none; on two axes alike they tell nothing.
    assert said(swapped(scaled(imu, Z, 0.75), X, Z), straight) == [("accel_x", "swapped_with_z")]
    assert said(imu + np.array([0.0, 0.0, 0.0, 0.0, 7.5, -3.0]), straight) == []


def test_too_little_of_a_drive_says_nothing() -> None:
    assert said(reversed_(RIGHT, Z)[:1400], NOMINAL[:1400], ALL[:1400]) == []
    assert said(RIGHT[:0], NOMINAL[:0], ALL[:0]) == []


def test_only_what_is_used_counts() -> None:
    """Every fourth row of a part of the drive; what is elsewhere is another car's."""
    used = np.zeros((N, 6), dtype=bool)
    used[1000:6000:4] = True
    imu = reversed_(RIGHT, Y)
    imu[~used] = np.random.default_rng(1).normal(0.0, 30.0, np.count_nonzero(~used))
    imu[2000:2100, Y] = np.nan
    assert said(imu, NOMINAL, used) == [("accel_y", "reversed")]


@pytest.mark.parametrize("gyro", [True, False])
def test_a_car_that_gives_way_to_hills_has_no_reversed_accelerometer(gyro: bool) -> None:
    """Slower uphill, pressed forward: reading = -dv/dt all the time."""
    slope_up = 0.02 * np.sin(2.0 * np.pi * T_S / 12.0) + 0.01 * np.sin(2.0 * np.pi * T_S / 7.0)
    expected = nominal()
    expected[:, X] = -0.5 * G * slope_up
    right = expected.copy()
    right[:, X] += G * slope_up
    right[:, 1] = -np.gradient(slope_up, 0.01)
    imu = right + OFFSETS + np.random.default_rng(3).normal(0.0, 1e-3, (N, 6))
    if not gyro:
        imu[:, :2] = np.nan
    assert said(imu, expected) == []


def test_a_banked_road_is_no_wrong_unit() -> None:
    """A bank that comes with the bends, and pulls eight times as much as they do."""
    expected = nominal(across=0.08)
    bank = 7.0 * expected[:, Y] / G
    right = expected.copy()
    right[:, Y] += G * bank
    right[:, 0] = np.gradient(bank, 0.01)
    assert said(measured(right), expected) == []
    # Its roll gyro is on another's plug: the bank is still the bank.
    assert said(swapped(measured(right), 0, 2), expected) == [("gyro_x", "swapped_with_z")]


def test_without_a_roll_gyro_a_gentle_bank_is_no_wrong_unit() -> None:
    expected = nominal(across=0.04)
    imu = measured(expected)
    imu[:, Y] += 7.0 * expected[:, Y]
    imu[:, :2] = np.nan
    assert said(imu, expected) == []


def test_the_tilt_of_the_road_does_not_hide_a_fault() -> None:
    """Grade that is as large as what the car does."""
    slope_up = waves(0.06, 7)
    right = NOMINAL.copy()
    right[:, X] += G * slope_up
    right[:, 1] = -np.gradient(slope_up, 0.01)
    imu = measured(right)
    assert said(imu, NOMINAL) == []
    assert said(reversed_(imu, X), NOMINAL) == [("accel_x", "reversed")]


def imu_of(config: Path, log: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measured, nominal and used of a recording, as `dsz diagnose` makes them."""
    setup = set_up(config)
    signals = signals_of(setup, [log], LogReport())
    vehicle = setup.settings.vehicle
    drive = drive_of(recorded(signals, vehicle.steering_ratio), vehicle.car(), vehicle.steering_ratio)
    n = len(drive.steer)
    rows = rows_of(drive)
    used = np.zeros((n, 6), dtype=bool)
    used[rows.at] = rows.used[:, :6]
    return drive.measured[:, :6], predicted(drive, nothing(), flat(n))[:, :6], used


@pytest.mark.parametrize(
    ("planted", "nominally"),
    [
        ([], False),
        ([("accel_y", "reversed")], False),
        ([("gyro_x", "swapped_with_z")], True),
        ([("accel_x", "reversed"), ("accel_x", "swapped_with_z")], True),
        ([("gyro_z", "deg_for_rad")], True),
    ],
)
def test_drives_of_the_simulated_car(planted: list[tuple[str, str]], nominally: bool, tmp_path: Path) -> None:
    """Once with all that a real car adds: lean, slip, sensors' errors; its faults are put on before its sensors."""
    effects = [f"axis_fault:channel={channel},kind={kind}" for channel, kind in planted]
    simulate("sine_steer", tmp_path, 3, None, effects, from_nominal=nominally)
    found = found_faults(*imu_of(tmp_path / "config.yaml", tmp_path / "recording.log"))
    assert sorted((one.channel, one.kind) for one in found) == sorted(planted)


@pytest.mark.real
@pytest.mark.skipif(bool(ABSENT or NO_OPENDBC), reason=ABSENT or NO_OPENDBC or "")
def test_a_real_car_is_wired_right_by_its_ready_configuration() -> None:
    """Its accelerometers are turned round (against a GNSS/INS reference), which the configuration's sign puts right."""
    log = DATA / "rav4_highway" / "recording.log"
    imu, expected, used = imu_of(CARS / "toyota_rav4_2017.yaml", log)
    assert said(imu, expected, used) == []
    assert said(reversed_(imu, X), expected, used) == [("accel_x", "reversed")]
    assert said(reversed_(imu, Y), expected, used) == [("accel_y", "reversed")]
    assert said(reversed_(imu, 2), expected, used) == [("gyro_z", "reversed")]


def test_a_wiring_as_mapped_changes_nothing() -> None:
    np.testing.assert_array_equal(Wiring().mended(RIGHT), RIGHT)
    np.testing.assert_array_equal(Wiring().faulty(RIGHT), RIGHT)
    assert len(IMU_CHANNELS) == len(Wiring().plugs)
