"""What shakes an IMU is no noise of its sensors: it is gone while the car stands, or two sensors show it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, NOISE, N, T, drive, found

from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import STILL_MPS, rows_of
from dsz_daemon.diagnose.residuals.own_noise import _is_quiet_while_standing, is_its_own, is_shared
from dsz_daemon.diagnose.simulation.drive import Drive
from dsz_daemon.diagnose.verdict.answer import answered, with_nothing_said, with_what_has_no_shape
from dsz_daemon.diagnose.verdict.level import level_of, off_where_nothing_is_said

_AX, _AY, _AZ, _GX = 3, 4, 5, 0


def _stopping(stands_s: float) -> Any:
    """A drive's speed with one stop."""
    return CITY_V * np.clip(np.abs(T - 30.0) - 0.5 * stands_s, 0.0, 5.0) / 5.0


def _ringing(seed: int, by: float = 1.0) -> Any:
    """A bracket that rings at 6 Hz, excited at random (N,): rms 1."""
    rng, x = np.random.default_rng(seed), np.zeros(N)
    push = rng.normal(size=N)
    w = 2.0 * np.pi * 6.0 * DT_S
    for k in range(2, N):
        x[k] = 2.0 * 0.97 * np.cos(w) * x[k - 1] - 0.97**2 * x[k - 2] + push[k]
    return by * x / np.std(x)


@pytest.mark.parametrize(
    ("stands_s", "hushes", "own"), [(20.0, 1.0, False), (20.0, 0.0, True), (13.0, 1.0, False), (4.0, 1.0, True)]
)
def test_what_hushes_while_the_car_stands_is_not_the_sensors(stands_s: float, hushes: float, own: bool) -> None:
    """Of a stop of two seconds of rest nothing is known."""
    v = _stopping(stands_s)
    rows = rows_of(one := drive({}, v, CITY_STEER))
    standing = rows.used[:, _AZ] & (v[rows.at] < STILL_MPS)
    assert (np.count_nonzero(standing) >= 100) == (stands_s > 10.0)
    loud = np.where(v < STILL_MPS, 1.0 - hushes, 1.0)
    left = (_ringing(3) * loud)[rows.at] * 3.0 * NOISE[_AZ]
    rest = np.random.default_rng(4).normal(size=len(left)) * NOISE[_AZ]
    assert is_its_own(one, rows, left + rest, _AZ) is own


@pytest.mark.parametrize(("rests", "is_quiet"), [(0.45, True), (0.55, False), (2.5, False)])
def test_a_quarter_of_the_power_is_quiet(rests: float, is_quiet: bool) -> None:
    """By itself: what is louder in lively parts of a drive, or now and then, is no noise by other rules."""
    rng, k = np.random.default_rng(6), np.arange(4000)
    v_mps = np.where(k < 1000, 0.0, 12.0)
    left = rng.normal(size=4000) * np.where(k < 1000, rests, 1.0)
    assert _is_quiet_while_standing(v_mps, left, np.full(4000, True), k // 125) is is_quiet
    assert not _is_quiet_while_standing(v_mps, left, k >= 901, k // 125)


def test_what_is_slow_may_be_little_by_chance_while_the_car_stands() -> None:
    """A wander whose mean is next to nothing in the one stop is the sensor's all the same."""
    v = _stopping(20.0)
    rows = rows_of(one := drive({}, v, CITY_STEER))
    rng = np.random.default_rng(7)
    rest = rng.normal(size=len(rows.at))
    wander = np.sin(2.0 * np.pi * (T - 30.0) / 24.0)[rows.at] * np.where(v[rows.at] < STILL_MPS, 0.1, 1.0)
    assert is_its_own(one, rows, 3.0 * NOISE[_AZ] * (wander + 0.5 * rest), _AZ)


def test_noise_has_no_readings_that_are_far_from_all_others() -> None:
    """One word in twenty is torn, by as much all the way; flicker, and what is cut off, have none."""
    rows = rows_of(one := drive({}, CITY_V, CITY_STEER))
    rng = np.random.default_rng(8)
    white = rng.normal(size=len(rows.at))
    torn = white + np.where(rng.random(len(white)) < 0.05, 8.0 * rng.choice([-1.0, 1.0], len(white)), 0.0)
    flicker = np.convolve(rng.normal(size=len(white)), np.ones(25) / 5.0, "same")
    evenly = [is_its_own(one, rows, NOISE[_AZ] * left, _AZ) for left in (white, 3.0 * flicker + white, np.sign(white))]
    assert evenly == [True, True, True]
    assert not is_its_own(one, rows, NOISE[_AZ] * torn, _AZ)


def test_two_sensors_have_no_noise_in_common() -> None:
    rows = rows_of(drive({}, CITY_V, CITY_STEER))
    rng = np.random.default_rng(5)
    left = rng.normal(size=(len(rows.at), 13))
    assert not any(is_shared(rows, left, c, 6) for c in range(6))
    both = _ringing(5, 2.0)[rows.at]
    left[:, _AY] += both
    assert not is_shared(rows, left, _AY, 6)
    left[:, _GX] -= both
    assert [is_shared(rows, left, c, 6) for c in range(6)] == [True, False, False, False, True, False]
    # Nor is what only wheels share asked for.
    left[:, 8] += 100.0 * left[:, _AZ]
    assert not is_shared(rows, left, _AZ, 6)
    # What is slow goes the same way by chance.
    left = rng.normal(size=(len(rows.at), 13))
    left[:, [_AX, _AZ]] += 20.0 * np.floor(T / 15.0)[rows.at][:, np.newaxis]
    assert not is_shared(rows, left, _AX, 6)
    # And of a channel that is not there nothing is known.
    rows.used[300:, _AY] = False
    assert not is_shared(rows, np.ones((len(rows.at), 13)), _AY, 6)


@pytest.mark.parametrize(
    ("shakes", "by", "channels"),
    [
        ((_AY,), 6.0, ["accel_y"]),
        ((_AY, _GX), 3.0, ["accel_y", "gyro_x"]),
        ((_AY,), 0.5, []),
        ((), 0.0, []),
    ],
)
def test_what_shakes_a_car_that_stands_now_and_then_is_said_with_how_much_it_is(
    shakes: tuple[int, ...], by: float, channels: list[str]
) -> None:
    """A loose bracket rings while the car drives: no name, no shape, and not what the simulation expects either."""
    v = _stopping(20.0)

    def shaken(one: Drive) -> None:
        for c in shakes:
            one.measured[:, c] += _ringing(9, by) * NOISE[c] * (v > STILL_MPS)

    search = found(drive({}, v, CITY_STEER, change=shaken))
    said, search = with_nothing_said(answered(search), search)
    said = with_what_has_no_shape(said, search)
    assert said.verdict == ("unexplained" if channels else "consistent")
    assert sorted(shape.channel for shape in said.unlisted) == channels
    assert off_where_nothing_is_said(search, level_of(search)) == set(channels)
    assert not said.causes
