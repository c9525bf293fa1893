"""Covariances of relative poses, and their Jacobians by systematic errors of the odometry."""

import numpy as np

from saccade._jit import kernel
from saccade.types import FloatArray


@kernel()
def convert_controls(
    u: FloatArray, U: FloatArray, J: FloatArray, covariance: FloatArray, by_error: FloatArray
) -> None:
    """Fill the covariances J U J^T (t, 3, 3), and the Jacobians J D (t, 3, 3) by the errors.

    J (t, 3, c) are the Jacobians of the relative poses by controls u (t, c) with covariances U
    (t, c, c). The true control is u + D error: lengths are longer by a fraction, the control turns
    in proportion to its first length, and this length loses in proportion to its turn.
    """
    c = u.shape[1]
    for t in range(len(u)):
        forward, turn = u[t, 0], u[t, c - 1]
        lost = -np.sign(forward) * abs(turn)
        for i in range(3):
            longer = 0.0
            for k in range(c - 1):
                longer += J[t, i, k] * u[t, k]
            by_error[t, i, 0] = longer
            by_error[t, i, 1], by_error[t, i, 2] = J[t, i, c - 1] * forward, J[t, i, 0] * lost
            for j in range(i + 1):
                total = 0.0
                for k in range(c):
                    for o in range(c):
                        total += J[t, i, k] * U[t, k, o] * J[t, j, o]
                covariance[t, i, j] = covariance[t, j, i] = total
