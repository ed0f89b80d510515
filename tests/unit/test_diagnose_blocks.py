"""diagnose: a block that scatters more than others says less, wherever rows are weighed."""

from __future__ import annotations

import math
from collections import defaultdict
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.fft import next_fast_len
from scipy.optimize import lsq_linear
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, T, drive, found

from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, INDEX
from dsz_daemon.diagnose.fitting import judgement
from dsz_daemon.diagnose.fitting.descent import loss_of
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.spreads import covariance_of
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import Rows, _per_step, residual, rows_of
from dsz_daemon.diagnose.residuals.correlation import correlated_rows, quick_length
from dsz_daemon.diagnose.residuals.evidence import Box, scatter_of, solved, sums
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.shapes import beside, shape_beside
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.verdict import untested
from dsz_daemon.diagnose.verdict.goodness import goodness


def some_rows(block: np.ndarray, channels: int = 13) -> Rows:
    """All of one channel of thirteen."""
    used = np.zeros((len(block), channels), dtype=np.bool_)
    used[:, 0] = True
    return Rows(np.arange(len(block)), used, block, np.zeros((len(block), channels)), np.zeros(channels))


def bumped(one: Drive) -> None:
    """For five seconds something that stays for 0.3 s is in the vertical acceleration, and nowhere else."""
    signs = np.random.default_rng(4).choice([-1.0, 1.0], 20)[np.clip((T - 30.0) / 0.3, 0.0, 19.0).astype(int)]
    one.measured[:, 5] += np.where((T > 30.0) & (T < 35.0), 0.5 * signs, 0.0)


def test_rows_that_hang_together_tell_less_of_a_blocks_scatter() -> None:
    """Each value stays for five rows, which count as one: 12 rows of the channel's, 40 of the block's own."""
    rng, block = np.random.default_rng(8), np.repeat(np.arange(40), 200)
    loud = np.where(block == 7, 3.0, 1.0)
    left = np.zeros((len(block), 13))
    left[:, 0] = np.repeat(rng.choice([-1.0, 1.0], len(block) // 5), 5) * loud
    std = scatter_of(some_rows(block), left, np.full(13, np.nan))[7, 0]
    assert std == pytest.approx(math.sqrt((12.0 * 1.4826**2 + 40.0 * 9.0) / 52.0), rel=0.02)


def test_a_loss_is_in_the_scatter_of_its_block() -> None:
    rows, left = some_rows(np.repeat([0, 1], 50)), np.zeros((100, 13))
    left[:, 0] = 6.0
    scatter = np.ones((2, 13))
    scatter[:, 0] = [3.0, 1.0]
    # Two deviations are half a square each, six are a distance beyond four.
    assert loss_of(left, rows, scatter) == pytest.approx(50 * 2.0 + 50 * 4.0 * (6.0 - 2.0))


def test_the_steerings_steps_last_in_the_scatter_of_each_block() -> None:
    """250 rows that are off by the same: a variance of 250 (d / s)^2 over the sum of squares, block by block."""
    block = np.repeat(np.arange(20), 25)
    table, left = np.zeros((500, 13, 1)), np.zeros((500, 13))
    table[:, 0, 0], left[:, 0] = 1.0, np.tile([1.0, -1.0], 250)
    weighed = sums(some_rows(block), left, table, np.ones(13))
    lasting = np.zeros((20, 13))
    lasting[:, 0] = 250.0 * np.where(np.arange(20) < 10, 4.0, 9.0)
    box = Box(*np.array([[-1e6], [1e6], [1e-9]]))
    [[variance]] = covariance_of(weighed, np.ones(13), box.weight, lasting, np.ones((20, 13)))
    assert variance == pytest.approx((250.0 * 250.0 * 4.0 + 250.0 * 250.0 * 9.0) / 500.0**2)


@pytest.mark.parametrize("blocks", [20, 80])
def test_what_is_left_beyond_the_noise_does_not_average_out(blocks: int) -> None:
    """3 deviations of which 1 is noise: 8 in power, all of it in one of eight ways to be wrong, however long."""
    n = 25 * blocks
    block, table, left = np.repeat(np.arange(blocks), 25), np.zeros((n, 13, 1)), np.zeros((n, 13))
    table[:, 0, 0], left[:, 0] = 2.0, np.tile([3.0, -3.0], n // 2)[:n]
    weighed = sums(some_rows(block), left, table, np.ones(13))
    box, none = Box(*np.array([[-1e6], [1e6], [1e-9]])), np.zeros((blocks, 13))

    def variance(hanging_rows: float, floor: float) -> float:
        [[found]] = covariance_of(weighed, np.full(13, hanging_rows), box.weight, none, np.full((blocks, 13), floor))
        return float(found)

    # It hangs together: over 20 rows or more it is none of the sensor's.
    assert variance(20.0, 1.0) == variance(40.0, 1.0) == pytest.approx((9.0 - 1.0) / 8.0 / 2.0**2)
    # Over 5 rows it is noise, over 14 three fifths of it may be wrong.
    assert variance(5.0, 1.0) == pytest.approx(5.0 * 9.0 / n / 2.0**2)
    assert variance(14.0, 1.0) == pytest.approx(0.6 * (9.0 - 1.0) / 8.0 / 2.0**2)
    # Of no more than noise nothing of the kind: 25 rows of it, of which five count as one, are up to
    # 1 + 2 sqrt(2 x 5 / 25) = 2.265 times as much by chance.
    assert variance(20.0, 3.0 / 2.25**0.5) == pytest.approx(20.0 * 9.0 / n / 2.0**2)
    assert variance(20.0, 3.0 / 2.28**0.5) == pytest.approx((9.0 - 9.0 / 2.28) / 8.0 / 2.0**2)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """What is looked at to tell how many rows count as one: by fits, and by shapes beside them."""
    heard: list[np.ndarray] = []

    def hearing(left: np.ndarray, used: np.ndarray) -> np.ndarray:
        heard.append(left)
        return correlated_rows(left, used)

    monkeypatch.setattr(judgement, "correlated_rows", hearing)
    monkeypatch.setattr(beside, "correlated_rows", hearing)
    return heard


def test_how_many_rows_count_as_one_is_told_in_the_scatter_of_their_blocks(counted: list[np.ndarray]) -> None:
    one = drive({}, CITY_V, CITY_STEER, change=bumped)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    assert len(counted) == 1
    np.testing.assert_allclose(counted[0], fit.left / fit.scatter[rows.block])
    known = screened(one, rows, fit, TOLERANCE, map).known
    counted.clear()
    shape_beside.shape_beside(one, rows, fit, known, TOLERANCE, np.zeros(13, dtype=np.bool_))
    assert counted
    for left in counted:
        # In m/s^2 it is 0.09.
        assert 0.4 < np.sqrt(np.mean(left[rows.used[:, 5], 5] ** 2)) < 2.0


def test_the_fit_that_is_told_is_what_is_left_whatever_weighed_it() -> None:
    search = found(drive({"accel_scale.y": 0.05}, CITY_V, CITY_STEER, change=bumped))
    told = goodness(search)
    for c, channel in ((4, "accel_y"), (5, "accel_z")):
        used = search.rows.used[:, c]
        for fit, side in ((search.nominal, told[channel].train.before), (search.best, told[channel].train.after)):
            assert side == pytest.approx(float(np.sqrt(np.mean(fit.left[used, c] ** 2))), rel=1e-6)


@pytest.mark.parametrize(("calm", "is_tested"), [(1, True), (0, False)])
def test_what_shows_in_a_calm_block_can_be_tested(monkeypatch: pytest.MonkeyPatch, calm: int, is_tested: bool) -> None:
    """A yaw gyro's scale that shows in the second block, which is the calm one or the loud one."""
    rows = some_rows(np.repeat([0, 1], 50))
    scatter = np.full((2, 13), 1e3)
    scatter[calm] = 1e-3

    def slopes_of(_: Any, columns: list[int], _each: Any) -> np.ndarray:
        slopes = np.zeros((100, 13, len(columns)))
        slopes[50:, 2, columns.index(INDEX["gyro_scale.z"])] = 1.0
        return slopes

    monkeypatch.setattr(untested.searching, "slopes_of", slopes_of)
    monkeypatch.setattr(untested, "_excitation", lambda _: defaultdict(float))
    best = SimpleNamespace(effects=(), scatter=scatter, per_row=np.ones(13))
    search: Any = SimpleNamespace(
        drive=SimpleNamespace(vocabulary=BUILT_IN, measured=np.zeros((2, 13))), rows=rows, best=best
    )
    told = {one["effect"] for one in untested.untested(search, map)}
    assert ("gyro_scale" not in told) is is_tested
    assert "accel_scale" in told


def test_the_end_of_a_drive_does_not_meet_its_beginning() -> None:
    """A hundred rows at either end, 200 between: 1 + 2 sum of 1 - k / 100 is 100, with the ends joined 150 and more."""
    left = np.zeros((400, 1))
    left[:100], left[300:] = 1.0, 1.0
    [found] = correlated_rows(left, np.ones((400, 1), dtype=np.bool_))
    assert found == pytest.approx(100.0, rel=0.03)


def test_lengths_are_those_that_scipy_calls_quick() -> None:
    rng = np.random.default_rng(5)
    lengths = [*range(1, 300), *rng.integers(300, 200_000, 200).tolist()]
    assert [quick_length(n) for n in lengths] == [next_fast_len(n, real=True) for n in lengths]
    assert quick_length(0) == 1


def test_what_is_no_number_is_as_far_off_as_can_be_and_teaches_nothing() -> None:
    rows = some_rows(np.zeros(4, dtype=np.int64))
    there, base = np.zeros((4, 13)), np.zeros((4, 13))
    there[:, 0] = [math.nan, math.inf, 2.0, -1e12]
    # What is not compared is not looked at.
    there[:, 1] = math.nan
    assert residual(rows, there)[:, 0].tolist() == [1e9, -1e9, -2.0, 1e9]
    assert not residual(rows, there)[:, 1:].any()
    found = np.zeros(rows.used.shape)
    _per_step(there, base, rows.at, rows.used, 0.5, found)
    assert found[:, 0].tolist() == [0.0, 0.0, 4.0, -1e9]
    assert not found[:, 1:].any()


@pytest.mark.parametrize("room", [100.0, 0.3])
def test_a_step_is_that_of_least_squares_inside_its_box(room: float) -> None:
    """Against scipy's trust-region method, which shares nothing with the way to it."""
    rng = np.random.default_rng(6)
    table, goal = rng.normal(size=(50, 4)), rng.normal(size=50) + 1.0
    box = Box(np.full(4, -room), np.full(4, 0.1 * room), np.zeros(4))
    step = solved(table.T @ table, table.T @ goal, box)
    other = lsq_linear(table, goal, (box.low, box.high), method="trf", tol=1e-12)
    np.testing.assert_allclose(step, other.x, atol=1e-5)
    assert (room == 100.0) == bool(((step > box.low + 1e-6) & (step < box.high - 1e-6)).all())


def test_a_car_stands_some_time_after_its_wheels_do() -> None:
    """They count teeth, and a body rocks: for 2 s after the wheels have stopped, and 1 s before they start, no row."""
    v = np.where((T > 20.0) & (T < 30.0), 0.0, CITY_V + 5.0)
    rows = rows_of(drive({}, v, 0.0 * CITY_STEER))
    at_s = DT_S * rows.at
    standing = at_s[rows.used[:, 3] & (at_s > 15.0) & (at_s < 35.0)]
    standing = standing[(standing > 19.0) & (standing < 31.0)]
    assert standing.min() == pytest.approx(22.0, abs=0.06)
    assert standing.max() == pytest.approx(29.0, abs=0.06)
    # What the IMU shows at rest, and not what wheels do.
    assert not rows.used[(at_s > 19.5) & (at_s < 30.5), 6:].any()
