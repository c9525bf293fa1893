"""Update by observations that are much more certain than their prediction, in parts."""

from collections.abc import Callable
from math import ceil, log2

import numpy as np

from saccade.slam.filter._range_bearing_kernels import Innovations
from saccade.types import FloatArray, IntArray

Update = Callable[[FloatArray, IntArray], Innovations]
"""From covariances (k, 2, 2) and landmarks (k,) of a scan to the innovations of its update."""


def update_in_parts(
    update: Update, R: FloatArray, landmark: IntArray, mapped: int, looseness: float
) -> Innovations:
    """Update by a scan, linearized anew on the way to the result.

    An observation of weight w, that is of covariance R / w, moves the estimate a part of the way;
    the weights of all parts sum to one, and each is as large as those before it together.

    Args:
        update: of the filter, by the scan.
        R: (k, 2, 2) covariances of the observations.
        landmark: (k,) number of the landmark of each; the next free number augments.
        mapped: number of landmarks in the map.
        looseness: ratio of the predicted variance to that of the observations: the parts begin
            with its inverse. At most 1 for an update at once.

    Returns:
        The innovations before any part; the normalized square is the sum of those of the parts,
        which is the same one where the observation is linear.

    Source: Zanetti (2012), "Recursive update filtering for nonlinear estimation".
    """
    parts = max(ceil(log2(looseness)), 0)
    if parts == 0:
        return update(R, landmark)
    exponents = np.append(parts, np.arange(parts, 0, -1))
    weights = 0.5**exponents
    each = [update(R / weight, np.where(landmark < mapped, landmark, -1)) for weight in weights]
    new = update(R, np.where(landmark < mapped, -1, landmark))
    first = each[0]
    first.covariance[:] -= R / weights[0] - R
    first.nis[:] = sum(part.nis for part in each)
    for old, added in zip(first, new, strict=True):
        old[np.isnan(old)] = added[np.isnan(old)]
    return first
