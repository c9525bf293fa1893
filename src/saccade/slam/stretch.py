"""A stretch of a log, many steps of which are taken at once in compiled code."""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.filter._kernels import is_full
from saccade.slam.filter._range_bearing_kernels import (
    augment_range_bearing,
    predict_by_control,
    update_range_bearing,
    write_pose,
)
from saccade.slam.filter.state import LANDMARKS, FilterState
from saccade.slam.filter.validation import check_all
from saccade.slam.results import Replay
from saccade.types import FloatArray, IntArray


class Stretch(NamedTuple):
    """Controls, each of which leads to a step, and what is seen from there.

    The observations edge[i] to edge[i + 1] are made at step i, each of `landmark`: one of the
    map, the next new one, or none (negative).
    """

    control: FloatArray
    """(t, c)."""
    U: FloatArray
    """(t, c, c)."""
    slopes: FloatArray
    """(t, c, r - 3) of the control by what the robot's state has behind the pose."""
    z: FloatArray
    """(k, 2)."""
    R: FloatArray
    """(k, 2, 2)."""
    landmark: IntArray
    """(k,)."""
    edge: IntArray
    """(t + 1,)."""
    at: IntArray
    """(2,) the step and the observation that come next; negative if the control comes first."""

    @classmethod
    def of(
        cls,
        control: FloatArray,
        U: FloatArray,
        scan: IntArray,
        z: FloatArray,
        R: FloatArray,
        landmark: IntArray,
    ) -> "Stretch":
        """A stretch from its beginning, given the step (k,) of each observation, ascending.

        All but `landmark` is copied: kernels are compiled anew for every layout of arrays.

        Raises:
            LogError: something in it is no measurement.
        """
        check_all("control", control, U)
        check_all("observation", z, R)
        return cls(
            control=np.array(control, order="C"),
            U=np.array(U, order="C"),
            slopes=np.empty((len(control), control.shape[1], 0)),
            z=np.array(z, order="C"),
            R=np.array(R, order="C"),
            landmark=landmark,
            edge=np.searchsorted(scan, np.arange(len(control) + 1)),
            at=np.array([0, -1]),
        )


@kernel()
def replay(b: FilterState, kind: int, huber: float, s: Stretch, out: Replay) -> None:
    """Go on with a stretch as far as there is room."""
    while s.at[0] < len(s.control) and not is_full(b):
        if s.at[1] < 0:
            step(b, kind, s)
        if not see(b, kind, huber, s, out):
            return
        arrive(b, kind, s, out)


@kernel()
def step(b: FilterState, kind: int, s: Stretch) -> None:
    """Move to the next step."""
    i = s.at[0]
    predict_by_control(b, kind, s.control[i], s.U[i], s.slopes[i])
    s.at[1] = s.edge[i]


@kernel()
def see(b: FilterState, kind: int, huber: float, s: Stretch, out: Replay) -> bool:
    """Take what is seen from here, as far as there is room; gives whether it was all."""
    while s.at[1] < s.edge[s.at[0] + 1]:
        k = s.at[1]
        if is_full(b):
            return False
        if s.landmark[k] == b.counts[LANDMARKS]:
            augment_range_bearing(b, s.z[k], s.R[k])
        elif s.landmark[k] >= 0:
            m = len(b.workspace) + 2 * s.landmark[k]
            v, S = out.innovation[k], out.innovation_covariance[k]
            out.nis[k] = update_range_bearing(b, kind, m, s.z[k], s.R[k], huber, v, S)
        s.at[1] += 1
    return True


@kernel()
def arrive(b: FilterState, kind: int, s: Stretch, out: Replay) -> None:
    """Say where the robot is after a step."""
    i = s.at[0]
    write_pose(b, kind, out.pose[i], out.covariance[i])
    s.at[0], s.at[1] = i + 1, -1
