"""Two landmarks of the map that are one."""

import numpy as np

from saccade.slam.filter._kernels import retract
from saccade.slam.filter._state_kernels import INVARIANT
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.state import add_rows, flush, state_size, symmetric

TOLERANCE = 1e-4
"""Metres: standard deviation of the constraint that both are at the same position."""


def join_landmarks(ekf: EkfSlam, kept: int, removed: int) -> None:
    """Update by the observation that two landmarks are one.

    An update (C.10-C.11) by an innovation of zero distance, with the Jacobian 1 of the one
    landmark and -1 of the other.

    Args:
        ekf: the filter; changed in place.
        kept: number of the landmark that stays.
        removed: number of the other one, which is not removed here.
    """
    ekf.reserve()
    f = ekf.filter_state
    flush(f)
    r, n = f.robot_size, state_size(f)
    a, b = r + 2 * kept, r + 2 * removed
    H = np.zeros((2, n))  # by eta
    H[[0, 1], [a, a + 1]], H[[0, 1], [b, b + 1]] = 1.0, -1.0
    if f.error_state == INVARIANT:
        H[:, 2] = f.heading_lever[a : a + 2] - f.heading_lever[b : b + 2]
    W = H @ symmetric(f.P[:n, :n])
    S = W @ H.T + TOLERANCE**2 * np.eye(2)
    A = np.linalg.inv(np.linalg.cholesky(S))
    V = np.zeros((2, len(f.state)))
    V[:, :n] = A @ W
    first, second = A @ (f.state[b : b + 2] - f.state[a : a + 2])
    f.P[:r, :n] -= V[:, :r].T @ V[:, :n]
    retract(f, float(first), float(second), V)
    V[:, :r] = 0.0
    add_rows(f, -1.0, V[:, :n])
