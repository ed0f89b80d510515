"""A car that parks: its wheel speeds have no sign, its yaw gyro and its accelerometer have."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from core_cases import TUCSON
from test_diagnose_choices import TOLERANCE

from dsz_daemon.diagnose import diagnose
from dsz_daemon.diagnose.faults.backwards import as_shapes, backwards, without_them
from dsz_daemon.diagnose.recordings.recording import DT_S, Recording
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import WHEEL_SPEEDS

N = 6000
T = DT_S * np.arange(N)
_FLOOR = np.array([*[0.001] * 3, *[0.02] * 3, *[0.01] * 4])


def _trapeze(begin_s: float, end_s: float, fastest_mps: float) -> Any:
    """Speed of one run from a stop to a stop."""
    return fastest_mps * np.clip(np.minimum(T - begin_s, end_s - T) / 2.5, 0.0, 1.0)


# Out of a bay, a turn in the street, a way along it, and back into another bay.
_RUNS = ((2.0, 10.0, 1.6), (12.0, 20.0, 1.4), (22.0, 44.0, 9.0), (47.0, 57.0, 1.6))


def parked(
    back: tuple[int, ...] = (0, 3),
    steer_rad: tuple[float, ...] = (0.3, -0.3, 0.03, 0.25),
    gyro: float = 1.0,
    along: float = 1.0,
    fastest_mps: float | None = None,
) -> Recording:
    """A drive whose runs of `back` go backwards; `gyro` and `along`: how these sensors read."""
    rng = np.random.default_rng(3)
    v, signed, steer = np.zeros(N), np.zeros(N), np.zeros(N)
    for i, (begin_s, end_s, fastest) in enumerate(_RUNS):
        run = _trapeze(begin_s, end_s, fastest if fastest_mps is None else fastest_mps)
        v += run
        signed += run * (-1.0 if i in back else 1.0)
        steer += steer_rad[i] * (run > 0.0)
    imu = rng.normal(size=(N, 6)) * _FLOOR[:6]
    # A bicycle without slip, ISO 8855.
    imu[:, 2] += gyro * signed * np.tan(steer) / TUCSON.wheelbase_m + 0.02
    imu[:, 3] += along * np.diff(signed, prepend=0.0) / DT_S + 0.3
    wheels = np.tile(v[:, np.newaxis], (1, 4)) + rng.normal(size=(N, 4)) * 0.003
    return Recording(T, steer, wheels, imu, _FLOOR)


@pytest.mark.parametrize(
    ("back", "found"),
    [
        ((0, 3), [(2.0, 10.0), (47.0, 57.0)]),
        ((1,), [(12.0, 20.0)]),
        ((), []),
        ((0, 1, 3), [(2, 10), (12, 20), (47, 57)]),
    ],
)
def test_runs_backwards_are_told_from_those_forwards(back: tuple[int, ...], found: list[tuple[float, float]]) -> None:
    told = backwards(parked(back), TUCSON.wheelbase_m)
    assert [end for pair in told for end in pair] == pytest.approx([end for pair in found for end in pair], abs=0.4)


def test_straight_backwards_the_accelerometer_tells_alone() -> None:
    told = backwards(parked((0,), steer_rad=(0.0, 0.0, 0.0, 0.0)), TUCSON.wheelbase_m)
    assert [round(begin) for begin, _ in told] == [2]
    # And where that is not there the gyro does, in a bend.
    deaf = parked((0,))
    deaf.imu[:, 3] = np.nan
    assert [round(begin) for begin, _ in backwards(deaf, TUCSON.wheelbase_m)] == [2]
    deaf.imu[:, 2] = np.nan
    assert backwards(deaf, TUCSON.wheelbase_m) == []


@pytest.mark.parametrize(("gyro", "along"), [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0)])
def test_a_sensor_that_is_the_other_way_all_the_time_is_reversed(gyro: float, along: float) -> None:
    """One that is reversed is not both; of two that are, no run is forwards."""
    assert backwards(parked((), gyro=gyro, along=along), TUCSON.wheelbase_m) == []


def test_both_have_to_be_the_other_way_and_a_gyro_has_an_offset() -> None:
    """One sensor alone is its own fault; and of an offset as large as the turn the one way round is none."""
    for channel in (2, 3):
        one, other = parked((0, 3)), parked(())
        one.imu[:, channel] = other.imu[:, channel]
        assert backwards(one, TUCSON.wheelbase_m) == []
    for offset_radps in (-0.3, 0.3):
        one = parked((0, 3))
        one.imu[:, 2] += offset_radps
        assert [round(begin) for begin, _ in backwards(one, TUCSON.wheelbase_m)] == [2, 47]


def test_a_car_that_hardly_moves_or_goes_fast_is_not_asked() -> None:
    assert backwards(parked((0,), fastest_mps=0.1), TUCSON.wheelbase_m) == []
    assert [round(begin) for begin, _ in backwards(parked((0,), fastest_mps=7.0), TUCSON.wheelbase_m)] == [2]
    assert backwards(parked((0,), fastest_mps=9.0), TUCSON.wheelbase_m) == []
    # A gap in what is felt leaves the rest of a run.
    holed = parked((0, 3))
    holed.imu[(T > 4.0) & (T < 4.4)] = np.nan
    assert [round(begin) for begin, _ in backwards(holed, TUCSON.wheelbase_m)] == [2, 47]
    gone = parked((0, 3))
    gone.wheels_mps[:, 1] = np.nan
    assert backwards(gone, TUCSON.wheelbase_m) == []


def test_what_is_said_has_the_time_and_that_the_sign_is_the_other_one() -> None:
    one = parked()
    stretches = backwards(one, TUCSON.wheelbase_m)
    shapes = as_shapes(one, stretches)
    assert [shape.channel for shape in shapes] == list(WHEEL_SPEEDS)
    assert {shape.shape for shape in shapes} == {"k*vx from 2.2 to 9.8 s and from 47.2 to 56.8 s"}
    for shape in shapes:
        # (1 + k) of a speed that is negative is what such a wheel reads.
        assert shape.coefficient.value == -2.0
        assert shape.coefficient.unit == "(m/s)/(m/s)"
        assert shape.share == pytest.approx(18.0 / 60.0, abs=0.02)
    without = without_them(one, stretches)
    lost = np.isnan(without.road_wheel_angle_rad)
    assert lost[(T > 2.5) & (T < 9.5)].all()
    assert lost[(T > 47.5) & (T < 56.5)].all()
    assert not lost[(T > 10.5) & (T < 46.5)].any()
    np.testing.assert_array_equal(without.wheels_mps, one.wheels_mps)


def test_a_diagnosis_says_when_the_car_goes_backwards_and_is_not_misled() -> None:
    """At 3 m/s, which is compared, the yaw rate would be the other way round."""
    for back in ((0, 3), ()):
        one = parked(back, fastest_mps=4.0)
        ns = np.round(T * 1e9).astype(np.int64)
        rng = np.random.default_rng(5)
        imu = one.imu.copy()
        v = np.mean(one.wheels_mps, axis=1)
        imu[:, 4] += np.where(T > 0.0, v * (imu[:, 2] - 0.02), 0.0) * 1.0
        imu[:, 5] += 9.80665
        names = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
        signals = {name: Signal(ns, imu[:, c]) for c, name in enumerate(names)}
        signals |= {
            f"wheel_speed_{side}": Signal(ns, one.wheels_mps[:, i] + 1e-4 * rng.normal(size=N))
            for i, side in enumerate(("fl", "fr", "rl", "rr"))
        }
        signals["steering_wheel_angle"] = Signal(ns, 16.0 * one.road_wheel_angle_rad)
        said = diagnose(signals, TUCSON, 16.0, tolerance=TOLERANCE).said
        told = [shape for shape in said.unlisted if shape.shape.startswith("k*vx from")]
        assert len(told) == (4 if back else 0)
        if back:
            assert said.verdict != "consistent"
