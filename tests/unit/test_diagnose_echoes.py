"""A gateway that sends an IMU's frames once more, a while later: said with how late, and left out; nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from dsz_daemon.diagnose.faults.echoes import AGAIN, echoes, told_by_echoes
from dsz_daemon.pipeline.grid import Signal

STEP_NS, N = 10_000_000, 2000


def readings(lsb: float = 0.001) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(6401)
    t_ns = np.arange(N, dtype=np.int64) * STEP_NS
    moving = np.sin(np.arange(N) / 40.0)[:, None] * np.array([0.3, 2.0])
    return t_ns, np.round((moving + rng.normal(0.0, 0.02, (N, 2))) / lsb) * lsb


def with_echo(t_ns: np.ndarray, values: np.ndarray, late: int) -> tuple[np.ndarray, np.ndarray]:
    """Each frame again, so many frames and a third of a step later."""
    stamps = np.concatenate([t_ns, t_ns + late * STEP_NS + STEP_NS // 3])
    order = np.argsort(stamps, kind="stable")
    return stamps[order], np.concatenate([values, values])[order]


def test_what_comes_once_more_is_told_and_left_out() -> None:
    t_ns, values = readings()
    stamps, twice = with_echo(t_ns, values, late=18)
    signals = {name: Signal(stamps, twice[:, i]) for i, name in enumerate(("gyro_z", "accel_y"))}
    signals["accel_x"] = Signal(t_ns, values[:, 0])
    mended, shapes = told_by_echoes(signals)
    assert [(shape.channel, shape.shape, shape.coefficient.unit) for shape in shapes] == [
        ("gyro_z", AGAIN, "s"),
        ("accel_y", AGAIN, "s"),
    ]
    assert shapes[0].coefficient.value == pytest.approx(0.18 + STEP_NS * 1e-9 / 3.0, abs=1e-6)
    assert shapes[0].share == pytest.approx(0.5, abs=0.01)
    np.testing.assert_array_equal(mended["gyro_z"].t_ns, t_ns)
    np.testing.assert_array_equal(mended["accel_y"].values, values[:, 1])
    assert mended["accel_x"] is signals["accel_x"]


@pytest.mark.parametrize("lsb", [0.001, 0.05, 0.5])
def test_readings_that_are_the_same_by_themselves_are_none(lsb: float) -> None:
    t_ns, values = readings(lsb)
    assert len(echoes(t_ns, values)[0]) == 0


def test_readings_that_are_held_are_none() -> None:
    t_ns, values = readings()
    assert len(echoes(t_ns, np.repeat(values[::4], 4, axis=0))[0]) == 0
    standing = np.tile(values[:1], (N, 1))
    assert len(echoes(t_ns, standing)[0]) == 0


def test_what_comes_again_after_different_times_is_none() -> None:
    t_ns, values = readings()
    late = np.where(np.arange(N) % 2 == 0, 18, 41) * STEP_NS + STEP_NS // 3
    stamps = np.concatenate([t_ns, t_ns + late])
    order = np.argsort(stamps, kind="stable")
    assert len(echoes(stamps[order], np.concatenate([values, values])[order])[0]) == 0


def test_one_word_that_comes_in_between_is_none() -> None:
    t_ns, values = readings()
    values[::3] = 0.0
    assert len(echoes(t_ns, values)[0]) == 0


def test_a_few_that_come_again_are_none() -> None:
    t_ns, values = readings()
    some = values.copy()
    some[200:500] = some[150:450].copy()
    assert len(echoes(t_ns, some)[0]) == 0
    assert len(echoes(*with_echo(t_ns[:200], values[:200], 18))[0]) == 0
    values[7] = np.nan
    assert len(echoes(*with_echo(t_ns, values, 18))[0]) == 0
