"""Stability of observer and lateral zeroing attached to each other, (30)-(39), corrected.

(31) drops c g v K2 from the diagonal of e_y, (34) prints K C where A - K C belongs and is not
Hurwitz at speed. The true closed loop follows from (7) and (26) with a_y = a_y* + e:

    beta' = m11 beta + m12 r^ + K2 e + ...
    r^'   = m21 beta + m22 r^ + K4 e + ...
    e'    = g (-e + c (v beta' + r v - a_y*))
"""

from __future__ import annotations

import numpy as np

from dsz_daemon.core.bicycle import Bicycle, ObserverGain, observer_matrix


def closed_loop_matrix(
    model: Bicycle, gain: ObserverGain, v: float, gamma: float, c: float
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """State matrix (3, 3) of [beta, r^, e_y] while the lateral gate is open."""
    M = observer_matrix(model, gain, v)
    g = gamma
    return np.array(
        [
            [M.m11, M.m12, gain.k2],
            [M.m21, M.m22, gain.k4],
            [g * c * v * M.m11, g * c * v * M.m12, g * (c * v * gain.k2 - 1.0)],
        ]
    )


def closed_loop_poles(
    model: Bicycle, gain: ObserverGain, v: float, gamma: float, c: float
) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
    """Eigenvalues (3,) of the true closed loop, 1/s, slowest last."""
    poles = np.linalg.eigvals(closed_loop_matrix(model, gain, v, gamma, c)).astype(np.complex128)
    return poles[np.argsort(poles.real)]


def lateral_dc_gain(model: Bicycle, gain: ObserverGain, v: float, gamma: float, c: float) -> float:
    """Settled e_y per unit of constant a_y* with r = 0 and delta = 0; -c by (26), -1 is unbiased."""
    A = closed_loop_matrix(model, gain, v, gamma, c)
    B = np.array([gain.k2, gain.k4, gamma * c * (v * gain.k2 - 1.0)])
    return float(-np.linalg.solve(A, B)[2])
