"""Innovations and predicted observations, and the biases of the odometry."""

from typing import NamedTuple

import numpy as np

from saccade.slam.filter._kernels import expected_observations
from saccade.slam.filter._state_kernels import FilterState
from saccade.types import FloatArray, IntArray

BIASES = 3
"""States after the pose: relative error of the distance; turn in radians per meter driven; and
meters lost per radian turned."""


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


class Innovations(NamedTuple):
    """Innovations of k observations, NaN where one updated nothing."""

    value: FloatArray
    """(k, 2) observed minus predicted ranges and bearings."""
    covariance: FloatArray
    """(k, 2, 2) S of C.12, before the update."""
    nis: FloatArray
    """(k,) normalized innovations squared; chi-square with two degrees if the filter is right."""


class PredictedObservations(NamedTuple):
    """Predicted observations of landmarks."""

    z: FloatArray
    """(n, 2)."""
    covariance: FloatArray
    """(n, 2, 2) H P H^T of each, without the noise of an observation."""


def expected(f: FilterState, landmarks: IntArray) -> PredictedObservations:
    """Predicted observations of landmarks (k,)."""
    k = len(landmarks)
    predicted = PredictedObservations(np.empty((k, 2)), np.empty((k, 2, 2)))
    expected_observations(f, landmarks, *predicted)
    return predicted


def control_bias(u: FloatArray, robot_size: int) -> FloatArray:
    """(c, r - 3) Jacobian of a control by the robot's states beyond the pose."""
    jacobian: FloatArray = _NO_BIAS[len(u)] if robot_size == 3 else bias_jacobian(u[None])[0]
    return jacobian


def new_innovations(k: int) -> Innovations:
    """Innovations of k observations that have updated nothing yet."""
    room = np.empty(7 * k)
    room.fill(np.nan)
    value, covariance = room[: 2 * k].reshape(k, 2), room[2 * k : 6 * k].reshape(k, 2, 2)
    return Innovations(value, covariance, room[6 * k :])


_NO_BIAS = {c: np.zeros((c, 0)) for c in (2, 3)}
