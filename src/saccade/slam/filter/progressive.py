"""Update by observations that are much more certain than their prediction, in parts."""

from math import ceil, log2

import numpy as np

from saccade.slam.filter._range_bearing_kernels import Innovations
from saccade.slam.filter.ekf import EkfSlam
from saccade.types import FloatArray, IntArray


def update_in_parts(
    ekf: EkfSlam, z: FloatArray, R: FloatArray, landmark: IntArray, looseness: float
) -> Innovations:
    """Update by a scan as `EkfSlam.update_scan`, linearized anew on the way to its result.

    An observation of weight w, that is of covariance R / w, moves the estimate a part of the way;
    the weights of all parts sum to one, and each is as large as those before it together.

    Args:
        ekf: the filter, predicted to the pose of the scan.
        z: (k, 2).
        R: (k, 2, 2) their covariances.
        landmark: (k,) number in the map, as for `EkfSlam.update_scan`.
        looseness: ratio of the predicted variance to that of the observations: the parts begin
            with its inverse.

    Returns:
        The innovations before any part; the normalized square is the sum of those of the parts,
        which is the same one where the observation is linear.

    Source: Zanetti (2012), "Recursive update filtering for nonlinear estimation".
    """
    parts = max(ceil(log2(looseness)), 0)
    if parts == 0:
        return ekf.update_scan(z, R, landmark)
    mapped = np.where(landmark < len(ekf), landmark, -1)
    exponents = np.append(parts, np.arange(parts, 0, -1))
    weights = 0.5**exponents
    each = [ekf.update_scan(z, R / weight, mapped) for weight in weights]
    new = ekf.update_scan(z, R, np.where(landmark < len(ekf), -1, landmark))
    first = each[0]
    first.covariance[:] -= R / weights[0] - R
    first.nis[:] = sum(part.nis for part in each)
    for old, added in zip(first, new, strict=True):
        old[np.isnan(old)] = added[np.isnan(old)]
    return first
