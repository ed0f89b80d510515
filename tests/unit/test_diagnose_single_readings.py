"""diagnose: what single readings tell by themselves: spikes, two sensors in turn, coarse steps behind noise."""

from __future__ import annotations

import numpy as np
import pytest
from core_cases import TUCSON
from test_diagnose_choices import CITY_STEER, CITY_V, drive, found
from test_diagnose_steering_stops import HAND, RATIO, STAMPS, made, signal

from dsz_daemon.diagnose import diagnose
from dsz_daemon.diagnose.faults.single_readings import (
    IN_BETWEEN,
    STEPS,
    coarse_readings,
    coarse_steering,
    hidden_by_steps,
    told_by_readings,
)
from dsz_daemon.diagnose.recordings.recording import recorded, white_std
from dsz_daemon.diagnose.recordings.rounding import coarse_step
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.verdict import answer
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.pipeline.grid import Signal

N, NOISE = len(STAMPS), 0.01
TIME_S = STAMPS * 1e-9
COURSE = 1.5 * np.sin(0.7 * TIME_S) + 0.5 * np.sin(2.1 * TIME_S)
RNG = np.random.default_rng(5)
NOISY = COURSE + NOISE * RNG.normal(size=N)
HIT = np.sort(RNG.choice(np.arange(10, N - 10, 7), 60, replace=False))
SIDE = np.where(RNG.random(60) < 0.5, 1.0, -1.0)


def hit(size: float | np.ndarray, count: int = 60) -> np.ndarray:
    values = NOISY.copy()
    values[HIT[:count]] += (SIDE * size)[:count]
    return values


def shaken(values: np.ndarray) -> np.ndarray:
    """Every fiftieth reading to one side and the next one to the other: no spikes, whose neighbours agree."""
    moved = values.copy()
    there = np.setdiff1d(np.arange(25, N - 25, 50), np.concatenate([HIT + k for k in range(-3, 4)]))
    moved[there] += 0.12
    moved[there + 1] -= 0.12
    return moved


@pytest.mark.parametrize(
    ("role", "size", "unit", "is_one"),
    [
        ("wheel_speed_rl", 1.8, "m/s", True),
        ("wheel_speed_rl", 0.7, "m/s", False),
        ("steering_wheel_angle", 1.0, "rad", True),
        ("steering_wheel_angle", 0.3, "rad", False),
        ("road_wheel_angle", 0.15, "rad", True),
        ("road_wheel_angle", 0.02, "rad", False),
    ],
)
def test_spikes_of_what_drives_the_simulation_have_any_size(role: str, size: float, unit: str, is_one: bool) -> None:
    """No two alike: a bus that loses bits. A hand and a wheel are never there and back within two readings."""
    sizes = size * (1.0 + np.arange(60) / 60.0)
    found = told_by_readings({role: signal(hit(sizes if is_one else np.full(60, size)))})
    if not is_one:
        assert (found.shapes, len(found.signals[role].values)) == ([], N)
        return
    [shape] = found.shapes
    assert (shape.channel, shape.shape, shape.coefficient.unit) == (role, "+-k in single readings", unit)
    assert size < shape.coefficient.value < 2.0 * size
    assert found.signals[role].t_ns.tolist() == np.delete(STAMPS, HIT).tolist()


def test_few_spikes_or_very_many_are_left() -> None:
    for count in (4, 5):
        found = told_by_readings({"wheel_speed_fl": signal(hit(3.0, count))})
        assert len(found.shapes) == (count == 5)
    # Every tenth reading is another sensor's, or something else again.
    values = NOISY.copy()
    values[5:-5:10] += 3.0
    assert told_by_readings({"wheel_speed_fl": signal(values)}).shapes == []
    # Nor is a wheel that jumps and stays there for a reading more.
    values = NOISY.copy()
    values[HIT] += 3.0
    values[HIT + 1] += 3.0
    assert told_by_readings({"wheel_speed_fl": signal(values)}).shapes == []
    values = NOISY.copy()
    values[50] = np.nan
    assert told_by_readings({"wheel_speed_fl": signal(values)}).shapes == []


def test_spikes_are_said_and_left_out() -> None:
    found = told_by_readings({"accel_y": signal(hit(0.6)), "gyro_z": signal(NOISY)})
    [shape] = found.shapes
    assert (shape.channel, shape.shape) == ("accel_y", "+-k in single readings")
    assert shape.coefficient.value == pytest.approx(0.6, rel=0.02)
    assert shape.coefficient.unit == "m/s^2"
    assert shape.share == pytest.approx(60 / N)
    assert found.signals["accel_y"].t_ns.tolist() == np.delete(STAMPS, HIT).tolist()
    assert found.signals["accel_y"].values.tolist() == np.delete(NOISY, HIT).tolist()
    assert found.signals["gyro_z"].values is NOISY


@pytest.mark.parametrize(
    "values",
    [
        NOISY,
        # Too small, too seldom, of all sizes, and what stays.
        hit(0.07),
        hit(0.6, 8),
        hit(np.linspace(0.1, 1.0, 60)),
        # Of many sizes, and of one beside as much that is between it and the noise.
        hit(np.linspace(0.42, 0.8, 60)),
        shaken(hit(0.3)),
        NOISY + 0.6 * (np.arange(N) // 50 % 2),
        # What shakes the sensor.
        NOISY + 0.3 * np.sin(2.0 * np.pi * 37.0 * TIME_S) * np.maximum(np.sin(0.2 * TIME_S), 0.0),
        np.zeros(N),
        np.where(TIME_S < 5.0, np.nan, NOISY),
    ],
    ids=["noise", "small", "seldom", "all sizes", "many sizes", "and less", "steps", "shakes", "nothing", "gaps"],
)
def test_what_is_no_spike_stays(values: np.ndarray) -> None:
    found = told_by_readings({"accel_y": signal(values)})
    assert found.shapes == []
    assert found.signals["accel_y"].values is values
    assert told_by_readings({"accel_y": Signal(STAMPS[:50], hit(0.6)[:50])}).shapes == []


@pytest.mark.parametrize(
    ("share", "more", "shapes"),
    [
        (-0.2, 0.35, ["k in every other reading", "k*ay in every other reading"]),
        (0.0, 0.35, ["k in every other reading"]),
        (0.1, 0.0, ["k*ay in every other reading"]),
        (0.0, 0.0, []),
        # Less than noise.
        (0.002, 0.0, []),
    ],
)
def test_two_sensors_in_turn_are_said_and_their_mean_is_taken(share: float, more: float, shapes: list[str]) -> None:
    odd = np.arange(N) % 2 == 1
    values = NOISY + odd * (share * COURSE + more)
    found = told_by_readings({"accel_y": signal(values)})
    assert [shape.shape for shape in found.shapes] == shapes
    told = {shape.shape: shape.coefficient for shape in found.shapes}
    if "k in every other reading" in told:
        # Where the mean of the two is nothing: c (1 + share / 2) + more / 2 = 0.
        there = more - share * (0.5 * more) / (1.0 + 0.5 * share)
        assert told["k in every other reading"].value == pytest.approx(there, rel=0.02)
    if "k*ay in every other reading" in told:
        # Over the mean of the two.
        assert told["k*ay in every other reading"].value == pytest.approx(abs(share / (1.0 + share / 2.0)), rel=0.05)
        assert told["k*ay in every other reading"].unit == "1"
    assert len(found.signals["accel_y"].values) == (N // 2 if shapes else N)
    if shapes:
        assert white_std(found.signals["accel_y"].values) == pytest.approx(NOISE / np.sqrt(2.0), rel=0.2)
        assert found.signals["accel_y"].t_ns[0] == (STAMPS[0] + STAMPS[1]) // 2


@pytest.mark.parametrize("stands_at", [9.81, 1.0, 2.0, 100.0])
def test_a_channel_that_hardly_stirs_is_no_traceback(stands_at: float) -> None:
    """By one rounding, once: of such a course no slope can be told, whatever an inverse makes of it."""
    for n in (200, 1000, N):
        values = np.where(np.arange(n) < n // 2, stands_at, np.nextafter(stands_at, np.inf))
        assert told_by_readings({"accel_z": Signal(STAMPS[:n], values)}).shapes == []


STEP_RAD = np.radians(9.0)


def stepped(noise_rad: float, step_rad: float = STEP_RAD) -> np.ndarray:
    return np.asarray(step_rad * np.round(HAND / step_rad) + noise_rad * np.random.default_rng(1).normal(size=N))


def test_steps_behind_noise_are_found() -> None:
    assert coarse_step(signal(stepped(1e-3))) == pytest.approx(STEP_RAD, rel=0.02)
    # Without noise steps are seen by any eye; and with much no eye sees them.
    assert coarse_step(signal(stepped(0.0))) == 0.0
    assert coarse_step(signal(stepped(0.02))) == 0.0
    assert coarse_step(signal(HAND + 1e-3 * RNG.normal(size=N))) == 0.0
    # Steps of two sizes, a hand that moves between them, and one that hardly ever stands.
    two = np.cumsum(np.where(np.arange(N) % 100 == 0, np.where(np.arange(N) % 200 == 0, 0.16, -0.10), 0.0))
    assert coarse_step(signal(two + 1e-3 * RNG.normal(size=N))) == 0.0
    there = np.where(np.arange(N) % 100 < 50, STEP_RAD, 0.0)
    between = there + np.cumsum(np.where(np.arange(N) % 80 == 35, 0.05, 0.0))
    assert coarse_step(signal(there + 1e-3 * RNG.normal(size=N))) == pytest.approx(STEP_RAD, rel=0.02)
    assert coarse_step(signal(between + 1e-3 * RNG.normal(size=N))) == 0.0
    restless = np.where(np.arange(N) % 16 < 8, STEP_RAD, 0.0)
    assert coarse_step(signal(restless + 1e-3 * RNG.normal(size=N))) == 0.0
    # A hand that jerks makes moves of all sizes.
    jerks = np.cumsum(np.where(np.arange(N) % 100 == 0, RNG.uniform(-0.3, 0.3, N), 0.0))
    assert coarse_step(signal(jerks + 1e-3 * RNG.normal(size=N))) == 0.0
    assert coarse_step(Signal(STAMPS[:1], HAND[:1])) == 0.0


@pytest.mark.parametrize("role", ["steering_wheel_angle", "road_wheel_angle"])
def test_coarse_steps_are_said_and_known_to_the_simulation(role: str) -> None:
    values = stepped(1e-3)
    by = 1.0 if role == "steering_wheel_angle" else RATIO
    [shape] = coarse_steering({role: signal(values / by)}, RATIO)
    # Finer ones, of a hand wheel as well as of road wheels, are a sensor's resolution.
    for noise_rad in (0.0, 1e-3):
        assert coarse_steering({role: signal(stepped(noise_rad, np.radians(3.5)) / by)}, RATIO) == []
    [of_all] = coarse_steering({role: signal(stepped(0.0) / by)}, RATIO)
    assert of_all.coefficient.value == pytest.approx(STEP_RAD / by)
    assert (shape.channel, shape.shape, shape.coefficient.unit) == (role, "steps of k", "rad")
    ratio = RATIO if role == "steering_wheel_angle" else 1.0
    recording = recorded({role: signal(values), "accel_y": signal(NOISY)}, RATIO)
    assert recording.steering_step_rad == pytest.approx(STEP_RAD / ratio, rel=0.02)


def test_the_answer_says_what_readings_tell_and_gives_what_two_sensors_show_no_scale() -> None:
    signals = made(HAND, HAND)
    side = signals["accel_y"].values.copy()
    side[1::2] *= 0.8
    said = diagnose(signals | {"accel_y": signal(side)}, TUCSON, RATIO).said
    assert [shape.shape for shape in said.unlisted] == ["k*ay in every other reading"]
    assert said.causes == []
    # All of them by as much are a scale.
    said = diagnose(signals | {"accel_y": signal(0.9 * signals["accel_y"].values)}, TUCSON, RATIO).said
    assert [cause.effect for cause in said.causes] == ["accel_scale"]


def test_a_diagnosis_goes_on_without_spikes_and_says_how_coarse_the_steering_is() -> None:
    signals = made(HAND, stepped(0.0))
    side = signals["accel_y"].values.copy()
    side[HIT] += 3.0 * SIDE
    found_now = diagnose(signals | {"accel_y": signal(side)}, TUCSON, RATIO)
    assert {(one.channel, one.shape) for one in found_now.said.unlisted} >= {
        ("accel_y", "+-k in single readings"),
        ("steering_wheel_angle", "steps of k"),
    }
    # What is compared has none of the 3 m/s2, of which the low-pass would have left 0.2.
    clean = recorded(signals, RATIO).imu[:, 4]
    assert np.nanmax(np.abs(found_now.search.drive.recording.imu[:, 4] - clean)) < 0.02


def test_how_a_hand_moves_of_which_only_steps_are_known_is_not_said(monkeypatch: pytest.MonkeyPatch) -> None:
    steps = Shape("steering_wheel_angle", STEPS, Coefficient(STEP_RAD, 1e-3, "rad"), 1.0)
    late = found(drive({"steering_delay.delay_s": 0.1, "yaw_inertia.share": 0.3}, CITY_V, CITY_STEER))
    said = answered(late)
    assert [cause.effect for cause in said.causes] == ["steering_delay"]
    assert [error.parameter for error in said.parameter_errors] == ["yaw_inertia_kgm2"]
    said = answered(late, beside=[steps])
    assert said.causes == said.parameter_errors == []
    assert said.unlisted[0] == steps
    # Nor is a car harder to turn that turns otherwise.
    monkeypatch.setattr(answer, "turned_by_another", lambda *_: (set(), ["gyro_z"]))
    assert answered(late).parameter_errors == []


def test_wheel_speeds_of_which_only_steps_are_known_are_said_and_hide_what_comes_with_them() -> None:
    speed_mps = 8.0 + 4.0 * np.sin(0.2 * TIME_S)
    signals = {f"wheel_speed_{at}": signal(np.round(speed_mps / 0.6) * 0.6) for at in ("fl", "rr")}
    shapes = coarse_readings(signals)
    assert [(shape.channel, shape.shape, shape.coefficient.unit) for shape in shapes] == [
        (name, STEPS, "m/s") for name in signals
    ]
    assert [shape.coefficient.value for shape in shapes] == pytest.approx([0.6, 0.6])
    # A dashboard's 1 km/h is a resolution.
    assert coarse_readings({"wheel_speed_fl": signal(np.round(speed_mps * 3.6) / 3.6)}) == []
    assert coarse_readings({"wheel_speed_fl": signal(speed_mps)}) == []
    # What ten bits make of an analog IMU is one, too; sensors' own steps hide nothing of a car.
    imu = {"gyro_z": signal(np.round(COURSE / 0.03) * 0.03), "accel_y": signal(np.round(COURSE / 0.4) * 0.4)}
    found = coarse_readings(imu)
    assert [(shape.channel, shape.coefficient.unit) for shape in found] == [("gyro_z", "rad/s"), ("accel_y", "m/s^2")]
    assert hidden_by_steps(found) == frozenset()
    assert coarse_readings({"gyro_z": signal(np.round(COURSE / 0.0122) * 0.0122)}) == []
    # Nor are jumps as large as each other steps, where it moves between them, too.
    assert coarse_readings({"accel_y": signal(np.mod(NOISY + 1.0, 2.0) - 1.0)}) == []
    assert coarse_readings({"accel_y": signal(np.round(COURSE / 0.16) * 0.16)}) == []

    by_wheels, by_hand = hidden_by_steps(shapes), hidden_by_steps([shapes[0]._replace(channel="steering_wheel_angle")])
    assert {"accel_scale", "gyro_scale"} <= by_wheels - by_hand
    assert "steering_backlash" in by_hand - by_wheels
    assert hidden_by_steps([shapes[0]._replace(shape="+-k in single readings")]) == frozenset()


def test_a_scale_of_an_accelerometer_beside_wheel_speeds_in_coarse_steps_has_no_name() -> None:
    steps = Shape("wheel_speed_rl", STEPS, Coefficient(1.1, 0.0, "m/s"), 1.0)
    weak = found(drive({"accel_scale.y": 0.1}, CITY_V, CITY_STEER))
    assert [cause.effect for cause in answered(weak).causes] == ["accel_scale"]
    said = answered(weak, beside=[steps])
    assert said.causes == []
    assert said.unlisted[0] == steps


def interjected(value: float, share: float, run: int = 1, seed: int = 11) -> tuple[np.ndarray, np.ndarray]:
    """A second sender's value in runs of so many readings, so many of all; and which readings are its."""
    starts = np.sort(
        np.random.default_rng(seed).choice(np.arange(10, N - 40, run + 3), int(share * N / run), replace=False)
    )
    there = np.concatenate([start + np.arange(run) for start in starts])
    values = NOISY.copy()
    values[there] = value
    return values, there


@pytest.mark.parametrize(("role", "unit"), [("gyro_z", "rad/s"), ("accel_x", "m/s^2"), ("wheel_speed_fl", "m/s")])
@pytest.mark.parametrize(("value", "share", "run"), [(0.0, 0.2, 1), (3.0, 0.1, 4), (-2.5, 0.01, 1)])
def test_a_value_that_comes_in_between_is_anothers(role: str, unit: str, value: float, share: float, run: int) -> None:
    values, there = interjected(value, share, run)
    found = told_by_readings({role: signal(values)})
    [shape] = found.shapes
    assert (shape.channel, shape.shape, shape.coefficient.unit) == (role, IN_BETWEEN, unit)
    assert shape.coefficient.value == value
    left = np.setdiff1d(STAMPS, found.signals[role].t_ns)
    if role.startswith("wheel"):
        # Where the others come near it, nothing tells whose it is: a wheel may stand.
        assert set(left) <= set(STAMPS[there])
        assert len(left) > 0.5 * len(there)
    else:
        assert left.tolist() == STAMPS[there].tolist()


def test_what_stands_still_or_is_seldom_is_nobody_elses() -> None:
    for values in (
        np.where(COURSE > 1.0, 1.0, NOISY),  # a limit: it comes near it
        np.where((TIME_S % 10.0) < 2.0, 0.7, NOISY),  # frozen for two seconds, and never back where it was
        interjected(3.0, 15 / N)[0],
        np.round(NOISY / 0.3) * 0.3,  # coarse steps
        np.where(interjected(9.0, 0.1)[0] == 9.0, RNG.choice([2.5, 3.0, 3.5, 4.0], N), NOISY),  # of no one value
    ):
        assert [
            one.shape for one in told_by_readings({"gyro_z": signal(values)}).shapes if one.shape == IN_BETWEEN
        ] == []


def test_what_is_the_rest_is_no_other() -> None:
    """Two of three: nobody knows which of the two is the sensor."""
    values = np.where(np.arange(N) % 3 == 0, NOISY, 3.0)
    assert [one for one in told_by_readings({"gyro_z": signal(values)}).shapes if one.shape == IN_BETWEEN] == []
