"""Systematic odometry errors as filter states.

Wheels of a wrong or unequal diameter and slip while turning: errors that white noise does not
model, and that become observable after some tens of metres among landmarks.
"""

import numpy as np

from saccade.types import FloatArray

BIASES = 3
"""States after the pose: relative error of the distance; turn in radians per metre driven; and
metres lost per radian turned."""


def bias_jacobian(control: FloatArray) -> FloatArray:
    """Jacobian D of controls by the biases: the true control is u + D bias.

    Args:
        control: (t, 2) distance and turn, or (t, 3) forward, left and turn.

    Returns:
        (t, c, 3).
    """
    forward, turn = control[:, 0], control[:, -1]
    D = np.zeros((*control.shape, BIASES))
    D[:, :-1, 0] = control[:, :-1]
    D[:, -1, 1] = forward
    D[:, 0, 2] = -np.sign(forward) * np.abs(turn)
    return D


def unbiased(control: FloatArray, bias: FloatArray) -> FloatArray:
    """Controls (t, c) corrected for the biases (3,)."""
    return np.asarray(control + bias_jacobian(control) @ bias)
