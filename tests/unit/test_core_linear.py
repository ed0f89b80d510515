"""core/linear against a Taylor series with scaling and squaring, written here."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsz_daemon.core.linear import exponential_2x2, relaxed, stepped_2x2


def taylor_exponential(matrix: np.ndarray) -> np.ndarray:
    squarings = max(0, int(np.ceil(np.log2(max(1e-30, np.abs(matrix).sum())))) + 4)
    small = matrix / 2.0**squarings
    term = total = np.eye(len(matrix))
    for k in range(1, 20):
        term = term @ small / k
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total


MATRICES = {
    "real": (-3.0, 1.0, 0.5, -1.0),
    "saddle": (1.0, 2.0, 0.3, -4.0),
    "complex": (-0.4, 3.0, -5.0, -0.8),
    "undamped": (0.0, 2.0, -2.0, 0.0),
    "double": (-5.0, 0.0, 0.0, -5.0),
    "double, defective": (0.0, 1.0, -25.0, -10.0),
    "nearly double, real side": (0.0, 1.0, -25.0 + 1e-8, -10.0),
    "nearly double, complex side": (0.0, 1.0, -25.0 - 1e-8, -10.0),
    "just outside the series": (-1.0, 1.1e-3, 1.1e-3, -1.0),
    "stiff": (-60.0, -1.0, 0.2, -0.3),
}


@pytest.mark.parametrize("name", MATRICES)
@pytest.mark.parametrize("t", [1e-3, 0.1, 1.0])
def test_exponential_equals_the_taylor_series(name: str, t: float) -> None:
    a, b, c, d = MATRICES[name]
    expected = taylor_exponential(np.array([[a, b], [c, d]]) * t)
    np.testing.assert_allclose(np.reshape(exponential_2x2(a, b, c, d, t), (2, 2)), expected, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("name", [n for n in MATRICES if n != "undamped"])
def test_held_inputs_equal_the_augmented_exponential(name: str) -> None:
    """x' = A x + u as one homogeneous system [[A, u], [0, 0]], which needs no inverse of A."""
    a, b, c, d = MATRICES[name]
    u, w, x, y, t = 0.7, -1.3, 2.0, -0.6, 0.35
    whole = taylor_exponential(np.array([[a, b, u], [c, d, w], [0.0, 0.0, 0.0]]) * t) @ np.array([x, y, 1.0])
    np.testing.assert_allclose(stepped_2x2(a, b, c, d, u, w, x, y, t), whole[:2], rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("name", MATRICES)
def test_two_steps_are_one_of_twice_the_length(name: str) -> None:
    a, b, c, d = MATRICES[name]
    u, w, x, y, dt = -0.2, 0.9, 1.0, 3.0, 0.17
    once = stepped_2x2(a, b, c, d, u, w, x, y, 2.0 * dt)
    half = stepped_2x2(a, b, c, d, u, w, x, y, dt)
    twice = stepped_2x2(a, b, c, d, u, w, *half, dt)
    np.testing.assert_allclose(twice, once, rtol=1e-12, atol=1e-13)


def test_a_singular_matrix_is_refused() -> None:
    with pytest.raises(ZeroDivisionError, match="regular"):
        stepped_2x2(1.0, 2.0, 2.0, 4.0, 0.0, 0.0, 1.0, 1.0, 0.1)


def test_relaxed_covers_1_minus_1_over_e_in_one_time_constant_and_composes() -> None:
    assert relaxed(2.0, 5.0, 4.0, 4.0) == pytest.approx(2.0 + 3.0 * (1.0 - math.exp(-1.0)), rel=1e-15)
    assert relaxed(relaxed(2.0, 5.0, 4.0, 0.3), 5.0, 4.0, 0.3) == pytest.approx(relaxed(2.0, 5.0, 4.0, 0.6), rel=1e-14)
