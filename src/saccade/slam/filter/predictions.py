"""Innovations and predicted observations."""

from typing import NamedTuple

import numpy as np

from saccade.slam.filter._kernels import expected_observations
from saccade.slam.filter._state_kernels import FilterState
from saccade.types import FloatArray, IntArray


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


def new_innovations(k: int) -> Innovations:
    """Innovations of k observations that have updated nothing yet."""
    room = np.empty(7 * k)
    room.fill(np.nan)
    value, covariance = room[: 2 * k].reshape(k, 2), room[2 * k : 6 * k].reshape(k, 2, 2)
    return Innovations(value, covariance, room[6 * k :])
