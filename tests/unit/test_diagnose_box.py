"""What is quick must be what is slow: the step in its box, unseen squares beside a course, slopes, the low-pass."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize
from scipy.optimize import lsq_linear
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.fitting.descent import turned
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings.recording import filter_kernel, filtered
from dsz_daemon.diagnose.residuals.comparison import noises, rows_of
from dsz_daemon.diagnose.residuals.evidence import Box, solved
from dsz_daemon.diagnose.shapes.unlisted import _has_structure, _unseen, best_shape
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.instruments import low_passed


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


def test_a_parameter_without_room_stays_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scipy.optimize, "lsq_linear", lambda *_, **__: pytest.fail("such a step is found at once"))
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


@pytest.mark.parametrize(("times", "has"), [(1.2, False), (1.3, True)])
def test_a_channel_is_looked_at_where_more_is_left_than_noise_and_form(times: float, has: bool) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    usual = float(np.hypot(noises(one)[2], fit.form[2]))
    left = times * usual * np.ones_like(fit.left)
    assert _has_structure(one, rows, fit._replace(left=left), 2) is has


def test_a_channel_that_has_a_shape_is_not_looked_at() -> None:
    def shows(one: Drive) -> None:
        one.measured[:, 5] += 0.01 * (CITY_V - 12.0) ** 2

    one = drive({}, CITY_V, CITY_STEER, change=shows)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), (), TOLERANCE)
    found = best_shape(one, rows, fit)
    assert found is not None
    assert found.channel == "accel_z"
    assert best_shape(one, rows, fit._replace(effects=("accel_z: k*|r|",))) is None


def test_slopes_of_either_sign_are_turned_to_what_a_step_did() -> None:
    """Broyden: by the turned slopes the step makes just the change; what is not felt stays 0."""
    rng = np.random.default_rng(2)
    slopes = -rng.uniform(0.5, 1.0, size=(40, 2, 3))
    slopes[:, 1, 2] = 0.0
    step, change = np.array([0.3, -0.2, 0.1]), rng.normal(size=(40, 2))
    found = turned(slopes, change, step, np.array([1.0, 2.0, 0.5]))
    np.testing.assert_allclose(found @ step, change, atol=1e-12)
    assert not found[:, 1, 2].any()
