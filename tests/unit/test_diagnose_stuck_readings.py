"""diagnose: what stands still by itself: outputs that freeze, that are dead near nothing, wheels that are cut off."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from core_cases import TUCSON
from test_diagnose_steering_stops import HAND, RATIO, STAMPS, made, signal

from dsz_daemon.diagnose import diagnose
from dsz_daemon.diagnose.faults.stuck_readings import told_by_standing
from dsz_daemon.pipeline.grid import Signal

N, STEP, NOISE = len(STAMPS), 2e-4, 0.003
TIME_S = STAMPS * 1e-9
RATE = 0.2 * np.sin(0.9 * TIME_S) + 0.05 * np.sin(2.3 * TIME_S)
RNG = np.random.default_rng(8)


def rounded(values: np.ndarray, step: float = STEP) -> np.ndarray:
    return np.asarray(np.round(values / step) * step)


READINGS = rounded(RATE + NOISE * RNG.normal(size=N))
FREEZES = [(300, 345), (800, 850), (1400, 1432), (2000, 2060)]


def freezing(values: np.ndarray) -> np.ndarray:
    held = values.copy()
    for begin, end in FREEZES:
        held[begin:end] = values[begin]
    return held


def test_an_output_that_freezes_is_said_and_what_it_repeats_left_out() -> None:
    found = told_by_standing({"gyro_z": signal(freezing(READINGS)), "accel_y": signal(READINGS)})
    [shape] = found.shapes
    assert (shape.channel, shape.shape, shape.coefficient.unit) == ("gyro_z", "the same for k", "s")
    lengths_s = [(end - 1 - begin) * 0.01 for begin, end in FREEZES]
    assert shape.coefficient.value == pytest.approx(np.median(lengths_s), abs=0.011)
    left_out = [at for begin, end in FREEZES for at in range(begin + 1, end)]
    assert shape.share == pytest.approx(len(left_out) / N, abs=2e-3)
    kept = found.signals["gyro_z"]
    assert set(left_out) == set(np.flatnonzero(~np.isin(STAMPS, kept.t_ns)))
    assert kept.values.tolist() == np.delete(freezing(READINGS), left_out).tolist()
    assert found.signals["accel_y"].values is READINGS


def test_one_that_froze_as_far_as_it_ever_was_is_no_limit() -> None:
    """Among others it is a freeze as they are; a limit is reached time and again, and one alone may be one."""
    values = freezing(READINGS)
    at = int(np.argmax(values[1500:1900])) + 1500
    values[at] = np.max(READINGS) + 0.01
    values[at : at + 40] = values[at]
    kept = told_by_standing({"gyro_z": signal(values)}).signals["gyro_z"]
    assert np.count_nonzero(kept.values == np.max(values)) == 1
    again = values.copy()
    again[at + 60 : at + 62] = values[at]
    kept = told_by_standing({"gyro_z": signal(again)}).signals["gyro_z"]
    assert np.count_nonzero(kept.values == np.max(values)) == 42
    alone = READINGS.copy()
    alone[at : at + 40] = values[at]
    assert told_by_standing({"gyro_z": signal(alone)}).shapes == []


def clipped() -> np.ndarray:
    return np.clip(READINGS, -0.12, 0.12)


def clipped_once() -> np.ndarray:
    return np.minimum(0.3 * READINGS + 0.5 * np.exp(-(((TIME_S - 20.0) / 1.0) ** 2)), 0.25)


def at_rest_between_steps() -> np.ndarray:
    """A sensor whose noise is finer than its steps stands still with the car."""
    step = 0.004
    quick = 1.5 * np.sin(3.0 * TIME_S) + 0.15 * step * RNG.normal(size=N)
    return rounded(np.where((TIME_S > 12.0) & (TIME_S < 18.0), 0.1 * step, quick), step)


@pytest.mark.parametrize(
    "values",
    [
        READINGS,
        # As often as noise in steps has it, and each reading sent five times.
        rounded(RATE + NOISE * RNG.normal(size=N), 2.0 * NOISE),
        np.repeat(READINGS[::5], 5)[:N],
        # A range's end, where all stretches stand alike, and what never moves.
        clipped(),
        clipped_once(),
        at_rest_between_steps(),
        np.zeros(N),
        np.where(TIME_S < 5.0, np.nan, freezing(READINGS)),
    ],
    ids=["noise", "coarse", "sent again", "clipped", "once", "at rest", "nothing", "gaps"],
)
def test_what_does_not_freeze_stays(values: np.ndarray) -> None:
    found = told_by_standing({"gyro_z": signal(values)})
    assert found.shapes == []
    assert found.signals["gyro_z"].values is values


def test_of_many_readings_some_are_alike_for_long_by_chance() -> None:
    """An hour of steps as coarse as the noise: one in three is like the one before, ten in a row now and then."""
    n = 360_000
    values = rounded(NOISE * RNG.normal(size=n), 0.95 * NOISE) + 1e-4 * NOISE * (np.arange(n) // 1000)
    same = np.concatenate(([0], np.flatnonzero(np.diff(values) != 0.0) + 1, [n]))
    assert np.max(np.diff(same)) > 11
    hour = Signal((1e7 * np.arange(n)).astype(np.int64), values)
    assert told_by_standing({"gyro_z": hour}).shapes == []


def test_too_few_readings_tell_nothing() -> None:
    few = Signal(STAMPS[:90], freezing(READINGS)[290:380])
    assert told_by_standing({"gyro_z": few, "wheel_speed_fl": few}).shapes == []
    none = Signal(STAMPS[:0], READINGS[:0])
    assert told_by_standing({"gyro_z": none, "wheel_speed_fl": none}).shapes == []


def test_stamps_that_stand_still_are_no_reason_to_end() -> None:
    at_once = Signal(np.zeros(N, dtype=np.int64), freezing(READINGS))
    # How long anything stands is not known then.
    assert told_by_standing({"gyro_z": at_once}).shapes == []


def test_a_sensor_that_is_dead_near_nothing_says_so_by_what_it_never_shows() -> None:
    felt = READINGS + 0.01
    dead = np.where(np.abs(RATE) < 0.05, 0.01, felt)
    dead[~(np.abs(dead - 0.01) > 0.05)] = 0.01
    found = told_by_standing({"gyro_z": signal(dead)})
    [shape] = found.shapes
    assert (shape.channel, shape.shape, shape.coefficient.unit) == ("gyro_z", "0 where |r| < k", "rad/s")
    assert shape.coefficient.value == pytest.approx(0.05, rel=0.03)
    assert shape.share == pytest.approx(np.mean(dead == 0.01))
    assert found.signals["gyro_z"].values.tolist() == dead[dead != 0.01].tolist()


def test_a_sensor_that_shows_little_is_not_dead() -> None:
    # Less by as much, so that nothing is missing; one at rest whose noise is finer than its steps; one at its end.
    less = np.sign(RATE) * np.maximum(np.abs(READINGS) - 0.05, 0.0)
    at_rest = rounded(np.where(TIME_S < 8.0, 0.0, RATE + 0.1 * NOISE * RNG.normal(size=N)), 0.004)
    at_its_end = np.where(RATE < 0.05, -0.01, READINGS)
    for values in (less, at_rest, at_its_end):
        assert told_by_standing({"gyro_z": signal(values)}).shapes == []


SPEED_MPS = np.maximum(6.0 + 8.0 * np.sin(0.5 * TIME_S), 0.0)


@pytest.mark.parametrize("noise_mps", [0.0, 0.01])
def test_wheels_that_are_not_read_when_slow_say_from_which_speed_on(noise_mps: float) -> None:
    read = np.where(SPEED_MPS < 2.2, 0.0, SPEED_MPS) + noise_mps * RNG.normal(size=N)
    [shape] = told_by_standing({"wheel_speed_rl": signal(rounded(read, 0.003))}).shapes
    assert (shape.channel, shape.shape, shape.coefficient.unit) == ("wheel_speed_rl", "0 where vx < k", "m/s")
    assert shape.coefficient.value == pytest.approx(2.2, abs=0.06)
    assert shape.share == pytest.approx(np.mean(SPEED_MPS < 2.2), abs=1e-3)


def test_wheels_that_are_read_down_to_walking_pace_say_nothing() -> None:
    dropped = SPEED_MPS.copy()
    dropped[200:210] = dropped[900:910] = 0.0
    coarse = rounded(SPEED_MPS, 1.2)
    for values in (SPEED_MPS, np.where(SPEED_MPS < 0.9, 0.0, SPEED_MPS), dropped, coarse, SPEED_MPS + 5.0):
        assert told_by_standing({"wheel_speed_rl": signal(values)}).shapes == []


def test_a_diagnosis_goes_on_without_what_is_repeated() -> None:
    signals = made(HAND, HAND)
    rate = rounded(signals["gyro_z"].values + 1e-3 * RNG.normal(size=N), 1e-4)
    assert diagnose(signals | {"gyro_z": signal(rate)}, TUCSON, RATIO).said.verdict == "consistent"
    said = diagnose(signals | {"gyro_z": signal(freezing(rate))}, TUCSON, RATIO).said
    assert said.verdict == "unexplained"
    assert [(shape.channel, shape.shape) for shape in said.unlisted] == [("gyro_z", "the same for k")]
    assert said.causes == []
    # What is left of the channel is its noise.
    assert said.level["gyro_z"] < 1.5


def _converted(volts: Any, stuck: int | None, at_one: bool = True, offset: int = 2048) -> Any:
    """What a converter of 12 bits says of these (n,), +-5 of its unit, one bit of which stays."""
    counts = np.clip(np.round(volts / 5.0 * 2048.0) + offset, 0, 4095).astype(np.int64)
    if stuck is not None:
        counts = counts | (1 << stuck) if at_one else counts & ~(1 << stuck)
    return (counts - 2048) * 5.0 / 2048.0


@pytest.mark.parametrize("at_one", [True, False])
@pytest.mark.parametrize("bit", [4, 6, 8])
def test_a_bit_that_stays_is_seen_by_what_is_never_said(bit: int, at_one: bool) -> None:
    rng, t = np.random.default_rng(bit), 0.01 * np.arange(15000)
    turns = 2.5 * np.sin(0.4 * t) * np.sin(0.07 * t) + 0.04 * rng.normal(size=len(t))
    ns = np.round(t * 1e9).astype(np.int64)
    found = told_by_standing({"accel_y": Signal(ns, _converted(turns, bit, at_one)), "accel_x": Signal(ns, turns)})
    assert [(shape.channel, shape.shape) for shape in found.shapes] == [("accel_y", "k or 0, by a bit that stays")]
    assert found.shapes[0].coefficient.value == pytest.approx(2**bit * 5.0 / 2048.0)
    # Nothing is left out for it.
    assert len(found.signals["accel_y"].values) == len(t)


def test_a_converter_that_says_all_it_can_and_one_that_is_seldom_asked_for_much_have_no_bit_that_stays() -> None:
    rng, t = np.random.default_rng(1), 0.01 * np.arange(15000)
    ns = np.round(t * 1e9).astype(np.int64)
    turns = 2.5 * np.sin(0.4 * t) * np.sin(0.07 * t) + 0.04 * rng.normal(size=len(t))
    # A car that hardly turns: one half of a period is all there is, but for a few bumps that happen to end in it.
    noise = 52.0 * rng.random(len(t)) + 2.0
    bumps = np.where(rng.random(len(t)) < 0.001, 128.0 * rng.integers(1, 5, len(t)), 0.0)
    still = np.round(noise + bumps) * 0.001
    coarse = np.round(turns / 0.16) * 0.16
    for values in (_converted(turns, None), still, coarse, turns, np.zeros(len(t)), _converted(turns, 6)[:1000]):
        assert told_by_standing({"accel_y": Signal(ns[: len(values)], values)}).shapes == []
