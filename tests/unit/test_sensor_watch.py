"""The watch over sensors: spikes, frozen IMU channels, frozen wheels, and what must not be taken for any of it."""

from __future__ import annotations

import copy
import random
from collections.abc import Iterable

import pytest

from dsz_daemon.config.watch import WatchSettings
from dsz_daemon.pipeline.mapping import Sample
from dsz_daemon.pipeline.rows import Refusal
from dsz_daemon.pipeline.sensor_watch import SensorWatch, WatchLimits
from dsz_daemon.signals import WHEEL_SPEEDS

PERIOD_NS = 20_000_000
STEP_MPS = 0.01 / 3.6  # as most cars send them


def test_the_settings_defaults_are_the_watchs() -> None:
    given, own = WatchSettings().limits(), WatchLimits()
    assert given.gyro_jump_radps == pytest.approx(own.gyro_jump_radps, rel=1e-3)
    assert given._replace(gyro_jump_radps=own.gyro_jump_radps) == own


def wheel_rows(speeds: Iterable[float], jitter_steps: int = 2, seed: int = 1) -> list[list[float]]:
    """All four wheels at these speeds, each some steps off, rounded to whole steps."""
    chance = random.Random(seed)
    return [
        [(round(v / STEP_MPS) + chance.randint(-jitter_steps, jitter_steps)) * STEP_MPS for _ in WHEEL_SPEEDS]
        for v in speeds
    ]


def watched(rows: Iterable[list[float]], watch: SensorWatch | None = None, start: int = 0) -> list[int]:
    """How many of the four are used, row by row, 20 ms apart."""
    watch = watch or SensorWatch()
    return [
        sum(len(watch.passed(Sample(n * PERIOD_NS, role, v))) for role, v in zip(WHEEL_SPEEDS, row, strict=True))
        for n, row in enumerate(rows, start)
    ]


def test_wheels_that_all_freeze_are_refused_after_a_second_and_used_again_when_they_move() -> None:
    before, after = wheel_rows([15.0] * 100), wheel_rows([14.0] * 50, seed=2)
    watch = SensorWatch()
    used = watched([*before, *[before[-1]] * 100, *after], watch)
    # The last new row is number 99; still for 1 s at number 149, longer from number 150 on, until number 200.
    assert used == [4] * 150 + [0] * 50 + [4] * 50
    assert watch.refused == [Refusal(role, "frozen") for _ in range(50) for role in WHEEL_SPEEDS]


def test_one_wheel_that_still_changes_is_a_sign_of_life_of_the_unit() -> None:
    rows = wheel_rows([15.0] * 300)
    held = rows[100][:3]
    assert watched([*rows[:100], *([*held, row[3]] for row in rows[100:])]) == [4] * 300


def test_a_car_that_stands_or_crawls_is_not_frozen() -> None:
    rows = wheel_rows([15.0] * 100)
    for speed in (0.0, 2.9):
        assert watched([*rows, *[[speed] * 4] * 500]) == [4] * 600
    # And after it has stood, its patience is what it was.
    watch = SensorWatch()
    watched([*rows, *[[0.0] * 4] * 500, *rows], watch)
    assert watched([rows[-1]] * 100, watch, start=700) == [4] * 50 + [0] * 50


def test_wheels_without_jitter_are_not_judged() -> None:
    """A simulation's, for one: speeding up in whole steps, then the same for a minute."""
    ramp = [5.0 + n * 0.1 for n in range(100)]
    assert set(watched(wheel_rows([*ramp, *[15.0] * 3000], jitter_steps=0))) == {4}


def test_coarse_wheels_are_not_judged() -> None:
    """In steps of 1 km/h a steady car repeats itself for seconds, and still flickers at the edges."""
    coarse = [[round(v * 3.6) / 3.6 for v in row] for row in wheel_rows([14.86] * 400, jitter_steps=10)]
    assert len({tuple(row) for row in coarse}) > 4
    assert set(watched([*coarse, *[coarse[-1]] * 500])) == {4}


def test_a_wheel_that_repeats_itself_as_a_rule_is_given_more_patience() -> None:
    """Still for 0.6 s again and again: from then on three times that."""
    rows = wheel_rows([15.0] * 100)
    slow = [row for n in range(10) for row in [wheel_rows([15.0], seed=n)[0]] * 31]
    used = watched([*rows, *slow, *[slow[-1]] * 200])
    # The last stretch of 0.6 s, begun at row 379, goes on: refused once 1.8 s are over. (One period more where
    # a wheel repeats itself in the very row in which another goes on.)
    first = used.index(0)
    assert 379 + 90 < first <= 379 + 3 * 31 + 1
    assert set(used[:first]) == {4}


def test_time_that_falls_back_is_not_counted() -> None:
    rows = wheel_rows([15.0] * 100)
    watch = SensorWatch()
    watched(rows, watch)
    for n in range(100, 0, -1):
        for role, value in zip(WHEEL_SPEEDS, rows[-1], strict=True):
            assert watch.passed(Sample(n * PERIOD_NS, role, value))
    assert watch.wheels.still_ns == PERIOD_NS  # from row 99 to the first of these


def test_after_a_gap_wheels_begin_anew() -> None:
    rows = wheel_rows([15.0] * 100)
    watch = SensorWatch()
    assert watched([*rows, *[rows[-1]] * 45], watch)[-1] == 4
    watch.forget()
    assert watched([rows[-1]] * 50, watch, start=10_000) == [4] * 50
    # Not one new value since the gap: whether the car turned wheels before is of no account.
    assert watched([rows[-1]] * 500, watch, start=10_050) == [4] * 500
    watched(rows, watch, start=11_000)
    assert watched([rows[-1]] * 60, watch, start=11_100) == [4] * 50 + [0] * 10


def test_a_watch_that_is_copied_goes_on_as_if_never_stopped() -> None:
    rows = wheel_rows([15.0] * 100)
    frozen = [*rows, *[rows[-1]] * 100]
    for cut in (10, 99, 120, 149, 151, 180):
        first = SensorWatch()
        used = watched(frozen[:cut], first)
        used += watched(frozen[cut:], copy.deepcopy(first), start=cut)
        assert used == watched(frozen)


def test_limits_are_the_configurations() -> None:
    limits = WatchSettings(wheel_patience_s=0.4, wheel_speed_mps=20.0, gyro_jump_degps=5.0, alive_changes=3).limits()
    rows = wheel_rows([25.0] * 100)
    assert watched([*rows, *[rows[-1]] * 40], SensorWatch(limits)) == [4] * 120 + [0] * 20
    slow = wheel_rows([15.0] * 100)
    assert set(watched([*slow, *[slow[-1]] * 100], SensorWatch(limits))) == {4}
    watch = SensorWatch(limits)
    rates = [0.0, 0.08, 0.0, 0.1, 0.0]  # rad/s; 5 deg/s are 0.087
    assert [len(watch.passed(Sample(n, "gyro_z", r))) for n, r in enumerate(rates)] == [1, 1, 1, 0, 1]


def imu_used(limits: WatchLimits, still_ms: int) -> bool:
    """Whether a yaw rate that has stood still for so long, in a car whose wheels change, is used."""
    watch, chance, passed = SensorWatch(limits), random.Random(3), True
    for n in range(100 + still_ms // 20):
        t_ns = n * PERIOD_NS
        watch.passed(Sample(t_ns, "wheel_speed_fl", 10.0 + chance.random()))
        value = chance.random() if n < 100 else 0.25
        passed = bool(watch.passed(Sample(t_ns, "gyro_z", value)))
    return passed


@pytest.mark.parametrize("patience_s", [1.0, 3.0])
def test_patience_with_a_gyro_is_the_configurations(patience_s: float) -> None:
    limits = WatchSettings(gyro_patience_s=patience_s).limits()
    assert imu_used(limits, round(patience_s * 1000))
    assert not imu_used(limits, round(patience_s * 1000) + 60)
