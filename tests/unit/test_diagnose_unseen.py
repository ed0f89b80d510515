"""diagnose/evidence: what a fit leaves on blocks that it has not seen, by small algebra and by fits to the rows."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

from dsz_daemon.diagnose.fitting.descent import loss_of
from dsz_daemon.diagnose.residuals import evidence
from dsz_daemon.diagnose.residuals.comparison import Rows
from dsz_daemon.diagnose.residuals.evidence import Box, held_out, held_out_kinds, solved, sums

BLOCKS, ROWS, CHANNELS, P = 12, 20, 2, 5
FREE = Box(np.full(P, -math.inf), np.full(P, math.inf), np.zeros(P))
CHOSEN = [0, 2, 3]


class Made(NamedTuple):
    """Rows of two channels, of which each block's deviation is another."""

    rows: Rows
    left: np.ndarray
    slopes: np.ndarray
    std: np.ndarray

    def flat(self, blocks: list[int]) -> tuple[np.ndarray, np.ndarray]:
        """The scaled table (rows * channels, chosen) and residuals of some blocks."""
        at = np.isin(self.rows.block, blocks)
        std = self.std[self.rows.block][at]
        table = self.slopes[at][:, :, CHOSEN] / std[:, :, np.newaxis]
        return table.reshape(-1, len(CHOSEN)), (self.left[at] / std).reshape(-1)

    def left_by(self, step: np.ndarray, block: int) -> np.ndarray:
        """Scaled squares (c,) of a block after the step."""
        at = self.rows.block == block
        left = (self.left[at] - self.slopes[at][:, :, CHOSEN] @ step) / self.std[block]
        return np.sum(left**2, axis=0)


@pytest.fixture
def made() -> Made:
    rng = np.random.default_rng(3)
    block = np.repeat(np.arange(BLOCKS), ROWS)
    n = len(block)
    rows = Rows(
        np.arange(n), np.ones((n, CHANNELS), dtype=np.bool_), block, np.zeros((n, CHANNELS)), np.zeros(CHANNELS)
    )
    slopes = rng.normal(size=(n, CHANNELS, P))
    left = slopes @ rng.normal(size=P) + rng.normal(size=(n, CHANNELS))
    return Made(rows, left, slopes, rng.uniform(0.5, 2.0, (BLOCKS, CHANNELS)))


def test_each_fifth_block_is_left_out_in_turn(made: Made) -> None:
    found = held_out(sums(made.rows, made.left, made.slopes, made.std), CHOSEN, FREE)
    for k in range(5):
        table, goal = made.flat([b for b in range(BLOCKS) if b % 5 != k])
        step = np.linalg.lstsq(table, goal, rcond=None)[0]
        for b in range(k, BLOCKS, 5):
            np.testing.assert_allclose(found[b], made.left_by(step, b), rtol=1e-9)


@pytest.mark.parametrize("per_row", [0.0, 40.0])
def test_a_kind_that_no_fit_has_seen_is_judged_beyond_what_was_left_open(made: Made, per_row: float) -> None:
    """Against the sandwich of Eicker, Huber and White, and of blocks, written down row by row."""
    kind = np.array([4] * 7 + [1] * 5)
    # Of the second kind the parameters are others.
    made.left[made.rows.block >= 7] += 0.8 * made.slopes[made.rows.block >= 7].sum(axis=2)
    all_sums = sums(made.rows, made.left, made.slopes, made.std)
    found = held_out_kinds(all_sums, CHOSEN, FREE, kind, np.full(CHANNELS, per_row))
    everywhere = np.linalg.lstsq(*made.flat(list(range(BLOCKS))), rcond=None)[0]
    power = np.mean((made.left / made.std[made.rows.block]) ** 2, axis=0)
    for mine in (1, 4):
        seen, unseen = np.flatnonzero(kind != mine).tolist(), np.flatnonzero(kind == mine).tolist()
        table, goal = made.flat(seen)
        step = np.linalg.lstsq(table, goal, rcond=None)[0]
        bread = np.linalg.inv(table.T @ table)
        by_row = np.tile(power, len(seen) * ROWS) * per_row
        pulls = [t.T @ (g - t @ step) for t, g in (made.flat([b]) for b in seen)]
        meats = [(table * by_row[:, np.newaxis]).T @ table, sum(np.outer(pull, pull) for pull in pulls)]
        for c in range(CHANNELS):
            there = [made.flat([b])[0].reshape(ROWS, CHANNELS, -1)[:, c] for b in unseen]
            squares = sum(t.T @ t for t in there)
            expected = max(np.trace(squares @ bread @ meat @ bread) for meat in meats)
            best = np.array([made.left_by(everywhere, b)[c] for b in unseen])
            by_others = np.array([made.left_by(step, b)[c] for b in unseen])
            more = float(np.sum(by_others - best))
            share = max(1.0 - 4.0 * expected / more, 0.0) if more > 0.0 else 1.0
            np.testing.assert_allclose(found[unseen, c], best + share * (by_others - best), rtol=1e-7)


def test_what_is_hardly_told_apart_is_solved_as_it_was() -> None:
    """The short way is for what is told apart; a combination that is told by nothing stays where it is, by the long."""
    rng = np.random.default_rng(5)
    table, goal = rng.normal(size=(60, P)), rng.normal(size=60)
    well = solved(table.T @ table, table.T @ goal, FREE)
    np.testing.assert_allclose(well, np.linalg.lstsq(table, goal, rcond=None)[0], rtol=1e-9)
    table[:, 4] = table[:, 3]
    alike = solved(table.T @ table, table.T @ goal, FREE)
    np.testing.assert_allclose(alike[3], alike[4], rtol=1e-3)
    np.testing.assert_allclose(table @ alike, table @ np.linalg.lstsq(table, goal, rcond=None)[0], atol=1e-6)


def test_of_normal_equations_the_smallest_pivot_says_whether_all_is_told_apart() -> None:
    assert evidence._is_told_apart(np.array([[1.0, 0.99], [0.99, 1.0]]))
    assert not evidence._is_told_apart(np.array([[1.0, 1.0 - 1e-7], [1.0 - 1e-7, 1.0]]))
    # More than one is no square at all.
    assert not evidence._is_told_apart(np.array([[1.0, 1.1], [1.1, 1.0]]))


def test_a_car_that_spins_is_as_wrong_as_can_be(made: Made) -> None:
    """What is no number counts as 1e9 deviations, which is a distance."""
    left = np.zeros_like(made.left)
    left[0, 0], left[1, 0] = math.nan, math.inf
    assert loss_of(left, made.rows, made.std) == pytest.approx(2.0 * 4.0 * (1e9 - 2.0))
