"""Point correspondences between two frames."""

from typing import NamedTuple

import numpy as np

from saccade.types import Float32Array, FloatArray

DEFAULT_DEPTH = 50.0
"""Metres at which points of unknown depth are linearized."""


class Correspondences(NamedTuple):
    """k points observed in two frames; inverse depths are 1 / metres along the optical axis."""

    previous: FloatArray
    """(k, 2) pixels in the first frame."""
    current: FloatArray
    """(k, 2) pixels in the second frame."""
    inverse_depth: FloatArray
    """(k,) in the first frame."""
    inverse_depth_sigma: FloatArray
    """(k,) standard deviation; 1 where the depth is unknown."""
    current_inverse_depth: FloatArray
    """(k,) measured in the second frame, NaN where it was not."""
    current_inverse_depth_sigma: FloatArray
    """(k,) standard deviation."""


def correspondences_of(
    previous: Float32Array,
    current: Float32Array,
    depth: FloatArray,
    depth_sigma: FloatArray,
    current_depth: FloatArray,
    current_depth_sigma: FloatArray,
) -> Correspondences:
    """Correspondences of pixels (k, 2) with depths (k,) in metres and their standard deviations.

    A depth is NaN where it is unknown.
    """
    known = np.isfinite(depth)
    inverse = 1 / np.where(known, depth, DEFAULT_DEPTH)
    current_inverse = 1 / current_depth
    return Correspondences(
        previous.astype(np.float64),
        current.astype(np.float64),
        inverse,
        np.where(known, np.nan_to_num(depth_sigma) * inverse**2, 1.0),
        current_inverse,
        np.nan_to_num(current_depth_sigma * current_inverse**2, nan=1.0),
    )
