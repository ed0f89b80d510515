"""What is quick must be what is slow: the step in its box, unseen squares beside a course, the low-pass."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize
from scipy.optimize import lsq_linear

from dsz_daemon.diagnose.evidence import Box, solved
from dsz_daemon.diagnose.instruments import low_passed
from dsz_daemon.diagnose.recording import filter_kernel, filtered
from dsz_daemon.diagnose.unlisted import _unseen


def _problem(seed: int) -> tuple[np.ndarray, np.ndarray, Box]:
    """Slopes (k, p), what is left (k,), and a box that holds some of the parameters."""
    rng = np.random.default_rng(seed)
    p = int(rng.integers(2, 30))
    slopes = rng.normal(size=(p + 20, p)) @ (np.eye(p) + 0.4 * rng.normal(size=(p, p)))
    left = slopes @ rng.normal(size=p) + rng.normal(size=p + 20)
    low, high = -rng.uniform(0.0, 1.5, p), rng.uniform(0.0, 1.5, p)
    low[rng.random(p) < 0.2] = 0.0
    high[rng.random(p) < 0.1] = np.inf
    return slopes, left, Box(low, high, np.full(p, 1e-6))


@pytest.mark.parametrize("seed", range(40))
def test_the_step_in_a_box_is_the_library_s(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    slopes, left, box = _problem(seed)
    p = len(box.low)
    rows, goal = np.vstack([slopes, 1e-3 * np.eye(p)]), np.append(left, np.zeros(p))
    expected = lsq_linear(rows, goal, (box.low, np.maximum(box.high, box.low + 1e-12)), method="bvls").x
    monkeypatch.setattr(scipy.optimize, "lsq_linear", lambda *_, **__: pytest.fail("such a step is found at once"))
    step = solved(slopes.T @ slopes, slopes.T @ left, box)
    np.testing.assert_allclose(step, expected, rtol=1e-7, atol=1e-9)
    assert ((box.low <= step) & (step <= box.high)).all()


def test_what_a_bound_held_is_let_go() -> None:
    # Alone the first is beyond its bound; beside the second, held at its own, it comes back inside.
    squares, cross = np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([1.0, 0.2])
    box = Box(np.array([-1.0, -0.5]), np.array([1.5, 2.0]), np.zeros(2))
    free = np.linalg.solve(squares, cross)
    assert free[0] > 1.5
    assert free[1] < -0.5
    np.testing.assert_allclose(solved(squares, cross, box), [1.45, -0.5], rtol=1e-12)


def test_a_parameter_without_room_stays_where_it_is() -> None:
    squares, cross = np.array([[1.0, 0.5], [0.5, 1.0]]), np.array([1.0, 1.0])
    box = Box(np.array([0.0, -9.0]), np.array([0.0, 9.0]), np.zeros(2))
    np.testing.assert_allclose(solved(squares, cross, box), [0.0, 1.0], atol=1e-12)


def test_unseen_squares_are_those_of_five_fits() -> None:
    rng = np.random.default_rng(7)
    block = np.sort(rng.integers(0, 23, 900))
    course = 30.0 + 10.0 * rng.normal(size=900)
    left = 0.4 + 0.002 * course + 0.05 * rng.normal(size=900)
    expected = []
    for columns in ([np.ones(900)], [np.ones(900), course]):
        table, total = np.column_stack(columns), 0.0
        for fold in range(5):
            unseen = block % 5 == fold
            step = np.linalg.lstsq(table[~unseen], left[~unseen], rcond=None)[0]
            total += float(np.sum((left[unseen] - table[unseen] @ step) ** 2))
        expected.append(total)
    found = _unseen(np.column_stack([np.zeros(900), course]), left, block)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert found[1] < 0.98 * found[0]


def test_a_block_alone_is_judged_by_none() -> None:
    assert _unseen(np.ones((50, 1)), np.ones(50), np.zeros(50, dtype=np.int64))[0] == 1e-30


@pytest.mark.parametrize("n", [100, 256, 700])
def test_the_low_pass_is_that_of_the_recording(n: int) -> None:
    values, kernel = np.random.default_rng(n).normal(size=n), filter_kernel(0.15)
    np.testing.assert_allclose(low_passed(values, kernel), filtered(values, kernel), atol=1e-14)
