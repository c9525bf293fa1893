"""Mahalanobis gating."""

import numpy as np

from saccade.slam.association._kernels import mahalanobis_distances
from saccade.slam.consistency import normalized_squared
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.models import RangeBearing
from saccade.types import FloatArray


def mahalanobis_squared(
    ekf: EkfSlam, z: FloatArray, R: FloatArray, gate: float = np.inf
) -> FloatArray:
    """Squared Mahalanobis distances between observations and landmarks.

    Args:
        ekf: the filter, with N landmarks.
        z: (m, 2) observations.
        R: (m, 2, 2) their covariances.
        gate: largest distance that is of interest.

    Returns:
        (m, N); infinite over the gate and where the innovation covariance is singular.
    """
    predicted = ekf.predict_observations()
    distance = np.full((len(z), len(ekf)), np.inf)
    if type(ekf.sensor) is RangeBearing:
        mahalanobis_distances(*predicted, z, R, gate, distance)
        return distance
    v = ekf.sensor.difference(z[:, None], predicted.z)  # (m, N, 2)
    distance = squared_distances(v, predicted.covariance + R[:, None])
    return np.where(distance <= gate, distance, np.inf)


def squared_distances(v: FloatArray, S: FloatArray) -> FloatArray:
    """Squared Mahalanobis distances (...,) of v (..., 2) by S (..., 2, 2); infinite if singular."""
    distance = np.full(v.shape[:-1], np.inf)
    regular = np.linalg.det(S) > 0
    distance[regular] = normalized_squared(v[regular], S[regular])
    return distance
