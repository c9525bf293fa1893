"""Nearest-neighbor data association by Mahalanobis distances."""

import numpy as np

from saccade.slam.association._kernels import (
    Gates,
    associate_nearest,
    mahalanobis_distances,
)
from saccade.slam.filter.ekf import EkfSlam
from saccade.types import BoolArray, FloatArray, IntArray


def associate_by_geometry(
    ekf: EkfSlam,
    z: FloatArray,
    R: FloatArray,
    gates: Gates,
    taken: IntArray | None = None,
    confirmed: BoolArray | None = None,
) -> IntArray:
    """Associates a scan with the nearest landmarks by Mahalanobis distance, within a gate.

    Within a scan each landmark is paired with at most one observation and each observation with
    at most one landmark, the closest pair first. An observation outside the larger gate of every
    landmark is new; the others are ambiguous, and so are those to which an unpaired landmark is
    almost as near.

    Args:
        ekf: the filter, predicted to the pose of the scan.
        z: (m, 2) range in meters, bearing in radians.
        R: (m, 2, 2) their covariances.
        gates: the gates, and whether pairs must be mutually nearest.
        taken: (n,) ids of the landmarks of other observations of the scan.
        confirmed: (N,) landmarks of `EkfSlam.active` that are more than candidates; by default all.

    Returns:
        (m,) the id of the landmark, `NEW` or `DROPPED`.
    """
    ids, paired = ekf.active_ids, np.empty(len(z), np.int64)
    used = ekf.rows(np.empty(0, np.int64) if taken is None else taken)
    confirmed = np.ones(len(ids), np.bool_) if confirmed is None else confirmed
    associate_nearest(ekf.active, z, R, gates, used, confirmed, paired)
    found = paired >= 0
    paired[found] = ids[paired[found]]
    return paired


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
        (m, N) in the order of the landmarks' ids; infinite over the gate and where the innovation
        covariance is singular.
    """
    distance = np.empty((len(z), len(ekf)))
    mahalanobis_distances(*ekf.predict_observations(), z, R, gate, distance)
    return distance
