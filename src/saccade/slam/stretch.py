"""Consecutive poses of a log, as the compiled filter takes them."""

import numpy as np

from saccade.slam._log_kernels import Replay, Stretch
from saccade.slam.filter.validation import check_all
from saccade.types import FloatArray, IntArray


def new_stretch(
    control: FloatArray,
    U: FloatArray,
    scan: IntArray,
    z: FloatArray,
    R: FloatArray,
    landmark: IntArray,
) -> Stretch:
    """A stretch from its beginning, given the pose (k,) of each observation, ascending.

    All but `landmark` is copied: kernels are compiled anew for every layout of arrays.

    Raises:
        LogError: a value or a covariance is invalid.
    """
    check_all("control", control, U)
    check_all("observation", z, R)
    return Stretch(
        control=np.array(control, order="C"),
        U=np.array(U, order="C"),
        bias_jacobian=np.empty((len(control), control.shape[1], 0)),
        z=np.array(z, order="C"),
        R=np.array(R, order="C"),
        landmark=landmark,
        edge=np.searchsorted(scan, np.arange(len(control) + 1)),
        next_pose=np.zeros(1, np.int64),
        next_observation=np.full(1, -1),
    )


def new_replay(t: int, k: int) -> Replay:
    """Room for the results of so many poses and observations."""
    return Replay(
        pose=np.empty((t, 3)),
        covariance=np.empty((t, 3, 3)),
        innovation=np.full((k, 2), np.nan),
        innovation_covariance=np.full((k, 2, 2), np.nan),
        nis=np.full(k, np.nan),
    )
