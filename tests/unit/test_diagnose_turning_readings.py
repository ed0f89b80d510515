"""What comes round with each turn of a wheel is told with its channel, the wheel's radius and how it grows."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.faults.turning_readings import (
    _as_shape,
    _evenly_driven,
    _Line,
    _stands_out,
    of_wheels,
    told_by_turning,
    uneven_rings,
)
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.unnamed import differ_by
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import WHEEL_SPEEDS

# What is added to a channel at times, s, by speeds, m/s, and a wheel's angle, rad.
Added = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]

RADIUS_M = 0.31
IMU_NOISE = {"gyro_x": 0.003, "gyro_z": 0.003, "accel_x": 0.05, "accel_z": 0.05}


def speed_at(time_s: np.ndarray) -> np.ndarray:
    """Town and country, with a stop."""
    return np.clip(15.0 + 9.0 * np.sin(0.07 * time_s) + 3.0 * np.sin(0.31 * time_s), 0.0, None)


def angle_at(time_s: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """How far a wheel has turned, rad, by the trapezoidal rule."""
    steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time_s)
    return np.concatenate(([0.0], np.cumsum(steps))) / RADIUS_M


def recording(
    *,
    add: Mapping[str, Added] | None = None,
    seed: int = 3,
    length_s: float = 150.0,
    wheel_rate_hz: float = 50.0,
    wheel_noise_mps: float = 0.02,
    pace: float = 1.0,
) -> dict[str, Signal]:
    """White noise about a drive, and what is added to channels."""
    rng = np.random.default_rng(seed)
    signals = {}
    rates = {**dict.fromkeys(IMU_NOISE, 100.0), **dict.fromkeys(WHEEL_SPEEDS, wheel_rate_hz)}
    for name, rate_hz in rates.items():
        time_s = np.arange(0.0, length_s, 1.0 / rate_hz)
        fine_s = np.arange(0.0, length_s, 0.001)
        speed, turned = pace * speed_at(time_s), np.interp(time_s, fine_s, angle_at(fine_s, pace * speed_at(fine_s)))
        values = rng.normal(0.0, IMU_NOISE.get(name, wheel_noise_mps), len(time_s))
        values += speed if name in WHEEL_SPEEDS else 0.4 * np.sin(0.4 * time_s)
        if add and name in add:
            values += add[name](time_s, speed, turned)
        signals[name] = Signal(np.asarray(np.round(time_s * 1e9), dtype=np.int64) + 10**18, values)
    return signals


def test_an_uneven_ring_is_told_with_its_wheel_and_how_uneven_it_is() -> None:
    [shape] = told_by_turning(recording(add={"wheel_speed_rl": lambda t, v, a: 0.015 * v * np.sin(a + 0.4)}))
    assert shape.channel == "wheel_speed_rl"
    assert shape.shape == "k*vx*sin(s/0.31 m)"
    assert shape.coefficient.value == pytest.approx(0.015, rel=0.05)
    assert shape.coefficient.std < 0.03 * 0.015
    assert shape.coefficient.unit == "(m/s)/(m/s)"
    assert 0.8 < shape.share <= 1.0


@pytest.mark.parametrize(
    ("channel", "grows", "k", "written", "unit"),
    [
        ("accel_z", lambda v: v**2, 1e-3, "k*vx^2*sin(s/0.31 m)", "(m/s2)/(m2/s2)"),
        ("gyro_x", lambda v: v, 4e-4, "k*vx*sin(s/0.31 m)", "(rad/s)/(m/s)"),
        ("accel_x", np.ones_like, 0.15, "k*sin(s/0.31 m)", "m/s2"),
    ],
)
def test_what_shakes_a_body_is_told_with_how_it_grows(
    channel: str, grows: Callable[[np.ndarray], np.ndarray], k: float, written: str, unit: str
) -> None:
    shake = {channel: lambda t, v, a: k * grows(v) * np.cos(a)}
    [shape] = told_by_turning(recording(add=shake))
    assert (shape.channel, shape.shape, shape.coefficient.unit) == (channel, written, unit)
    assert shape.coefficient.value == pytest.approx(k, rel=0.07)


def test_another_wheel_has_another_radius() -> None:
    [shape] = told_by_turning(recording(add={"accel_z": lambda t, v, a: 0.2 * np.sin(a * RADIUS_M / 0.25)}))
    assert shape.shape == "k*sin(s/0.25 m)"
    # What comes round quicker, or more seldom, than any car's wheel is something else.
    for radius_m in (0.1, 0.9):
        share = RADIUS_M / radius_m
        assert told_by_turning(recording(add={"accel_z": lambda t, v, a, n=share: 0.2 * np.sin(n * a)})) == []  # type: ignore[misc]


@pytest.mark.parametrize("seed", range(6))
def test_noise_and_what_has_its_own_time_do_not_come_round(seed: int) -> None:
    assert told_by_turning(recording(seed=seed)) == []
    tone = {
        "accel_z": lambda t, v, a: 0.3 * np.sin(2.0 * np.pi * 9.0 * t),
        "gyro_z": lambda t, v, a: 0.05 * np.sin(2.0 * np.pi * 1.3 * t),
        "wheel_speed_fl": lambda t, v, a: 0.1 * np.sin(2.0 * np.pi * 6.0 * t),
    }
    assert told_by_turning(recording(add=tone, seed=seed)) == []


def test_coloured_noise_does_not_come_round() -> None:
    def coloured(t: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        white, shown = np.random.default_rng(1).normal(0.0, 0.05, len(t)), np.zeros(len(t))
        for i in range(1, len(t)):
            shown[i] = 0.9 * shown[i - 1] + white[i]
        return shown * (1.0 + 0.1 * v)

    assert told_by_turning(recording(add={"accel_z": coloured, "accel_x": coloured})) == []


def test_what_is_little_is_not_told() -> None:
    # Rings are never quite even, and a shake behind the noise is no more than noise.
    assert told_by_turning(recording(add={"wheel_speed_fl": lambda t, v, a: 0.002 * v * np.sin(a)})) == []
    [shape] = told_by_turning(recording(add={"wheel_speed_fl": lambda t, v, a: 0.005 * v * np.sin(a)}))
    assert shape.coefficient.value == pytest.approx(0.005, rel=0.1)
    assert told_by_turning(recording(add={"accel_z": lambda t, v, a: 0.01 * np.sin(a)})) == []
    assert told_by_turning(recording(add={"accel_z": lambda t, v, a: 0.04 * np.sin(a)})) != []


def test_readings_too_seldom_or_too_few_tell_nothing() -> None:
    def ring(t: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        return np.asarray(0.03 * v * np.sin(a))

    assert told_by_turning(recording(add={"wheel_speed_fl": ring}, wheel_rate_hz=5.0)) == []
    assert told_by_turning(recording(add={"wheel_speed_fl": ring}, length_s=10.0)) == []
    # Too slow a car turns its wheels as quickly as its driver steers.
    assert told_by_turning(recording(add={"wheel_speed_fl": ring}, pace=0.15)) == []
    # What is quicker than a third of the rate has an image, and is left out.
    for rate_hz in (20.0, 25.0):
        [shape] = told_by_turning(recording(add={"wheel_speed_fl": ring}, wheel_rate_hz=rate_hz))
        assert shape.coefficient.value == pytest.approx(0.03, rel=0.05)


def test_noise_is_no_part_of_a_line_and_its_spread_comes_true() -> None:
    """Of drives that differ in their noise alone; a quarter of it, rms, is a third of the power beside the line."""
    true = 0.025
    told = [told_by_turning(recording(add={"accel_z": lambda t, v, a: true * np.sin(a)}, seed=k))[0] for k in range(12)]
    values = np.array([shape.coefficient.value for shape in told])
    spread = float(np.median([shape.coefficient.std for shape in told]))
    assert np.mean(values) == pytest.approx(true, rel=0.04)
    assert np.std(values) < 1.5 * spread < 3.0 * np.std(values)


def test_a_spread_is_that_of_a_mean_and_two_parts_in_a_hundred() -> None:
    """Of an amplitude it is half that of its square, by a smaller share each."""
    speed = np.linspace(10.0, 30.0, 40)
    square = 0.04 + 0.01 * np.where(np.arange(40) % 2 == 0, 1.0, -1.0)
    shape = _as_shape("accel_z", _Line(0.31, speed, square, np.zeros(40)), 0.05)
    assert (shape.shape, shape.coefficient.value) == ("k*sin(s/0.31 m)", pytest.approx(0.2))
    assert shape.coefficient.std == pytest.approx(np.hypot(0.01 / np.sqrt(40) / 0.4, 0.004))


def test_a_line_is_sure_in_its_stretches() -> None:
    """Much in three of eighty is a shake or two, as much in the mean of all is a line."""
    beside, speed = np.full(80, 0.01), np.full(80, 20.0)
    seldom = np.where(np.arange(80) % 27 == 0, 1.0, 0.0)
    assert not _stands_out(_Line(0.31, speed, seldom, beside))
    assert _stands_out(_Line(0.31, speed, np.full(80, np.mean(seldom)), beside))
    assert not _stands_out(_Line(0.31, speed, np.full(80, 0.014), beside))
    assert not _stands_out(_Line(0.31, speed[:7], np.full(7, 1.0), beside[:7]))


def test_what_shakes_for_a_while_does_not_come_round() -> None:
    for size in (0.4, 0.8):
        burst = {"accel_z": lambda t, v, a, k=size: k * np.sin(a) * ((t > 60.0) & (t < 66.0))}  # type: ignore[misc]
        assert told_by_turning(recording(add=burst)) == []


def test_a_day_between_two_drives_is_no_way_that_was_driven() -> None:
    signals = recording(add={"accel_z": lambda t, v, a: 0.2 * np.sin(a)})
    apart = {}
    for name, one in signals.items():
        later = one.t_ns > 10**18 + 75 * 10**9
        apart[name] = Signal(one.t_ns + later * 86_400 * 10**9, one.values)
    wheels = [apart[name] for name in WHEEL_SPEEDS]
    whole = _evenly_driven([signals[name] for name in WHEEL_SPEEDS], 10**18)
    assert len(_evenly_driven(wheels, 10**18)) == pytest.approx(len(whole), rel=0.01)
    [shape] = told_by_turning(apart)
    assert shape.coefficient.value == pytest.approx(0.2, rel=0.07)


def test_where_readings_are_lost_the_rest_tells() -> None:
    signals = recording(add={"accel_z": lambda t, v, a: 0.2 * np.sin(a)})
    kept = {}
    for name, signal in signals.items():
        at_s = (signal.t_ns - 10**18) * 1e-9
        lost = ((at_s > 40.0) & (at_s < 47.0)) | ((at_s > 90.0) & (at_s < 91.0))
        kept[name] = Signal(signal.t_ns[~lost], signal.values[~lost])
    [shape] = told_by_turning(kept)
    assert shape.channel == "accel_z"
    assert shape.coefficient.value == pytest.approx(0.2, rel=0.07)


def test_without_wheels_or_readings_nothing_is_told() -> None:
    signals = recording(add={"accel_z": lambda t, v, a: 0.2 * np.sin(a)})
    none = np.empty(0, dtype=np.int64)
    assert told_by_turning({"accel_z": signals["accel_z"]}) == []
    assert told_by_turning({**signals, "wheel_speed_fl": Signal(none, np.empty(0))}) == []
    values = signals["accel_z"].values.copy()
    values[7] = np.nan
    assert told_by_turning({**signals, "accel_z": Signal(signals["accel_z"].t_ns, values)}) == []
    unknown = signals["wheel_speed_rr"].values.copy()
    unknown[7] = np.nan
    assert told_by_turning({**signals, "wheel_speed_rr": Signal(signals["wheel_speed_rr"].t_ns, unknown)}) == []
    # Stamps of whole seconds.
    whole = {name: Signal(one.t_ns // 10**9 * 10**9, one.values) for name, one in signals.items()}
    assert told_by_turning(whole) == []
    stands = {name: Signal(one.t_ns, np.zeros(len(one.values))) for name, one in signals.items()}
    assert told_by_turning(stands) == []


@pytest.mark.parametrize(("gyro", "road"), [("gyro_x", "road_bank"), ("gyro_y", "road_grade")])
def test_what_a_roads_own_gyro_alone_shows_is_the_roads(gyro: str, road: str) -> None:
    """Slabs, or a profile drawn from one metre to the next; a wheel shows in more than the gyro that feels a road."""
    line = Shape(gyro, "k*vx*sin(s/0.32 m)", Coefficient(1e-3, 1e-4, "(rad/s)/(m/s)"), 1.0)
    wheels = line._replace(channel="accel_z")
    for effects in ((), ("imu_lever_arm",), ("road_bank", "road_grade")):
        assert of_wheels([line, wheels], effects) == [line, wheels]
    assert of_wheels([line], ("imu_lever_arm",)) == [line]
    assert of_wheels([line], ("imu_lever_arm", road)) == []
    assert of_wheels([line], ({"road_bank", "road_grade"} - {road})) == [line]


def test_the_radius_of_a_wheel_alone_whose_ring_is_not_even_is_none() -> None:
    """Teeth that are further apart over a part of the turn are a smaller wheel besides."""

    def line(channel: str, shape: str = "k*vx*sin(s/0.34 m)") -> Shape:
        return Shape(channel, shape, Coefficient(0.012, 0.0002, "(m/s)/(m/s)"), 0.5)

    lines = [line("wheel_speed_rl"), line("gyro_x"), line("wheel_speed_fr", "k*vx from 2.0 to 3.0 s")]
    assert uneven_rings(lines) == {"rl"}
    one = drive({"wheel_radius.rl": -0.006}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), ("wheel_radius",), TOLERANCE)
    assert differ_by(one, fit, {"rl"})
    assert not differ_by(one, fit, {"fr"})
    assert not differ_by(one, fit, set())
    search = searched(one, rows, TOLERANCE)
    assert [cause.effect for cause in answered(search).causes] == ["wheel_radius"]
    assert [cause.effect for cause in answered(search, beside=[line("wheel_speed_fl")]).causes] == ["wheel_radius"]
    assert answered(search, beside=[line("wheel_speed_rl")]).causes == []
    # Of two wheels that differ the other one's is told.
    two = drive({"wheel_radius.rl": -0.006, "wheel_radius.fr": 0.006}, CITY_V, CITY_STEER)
    assert not differ_by(two, fitted(two, rows_of(two), nothing(), ("wheel_radius",), TOLERANCE), {"rl"})
