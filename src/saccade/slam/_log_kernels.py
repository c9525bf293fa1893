"""EKF-SLAM over consecutive poses of a log, in compiled code.

Each pose takes the steps of `Passage`: predict, associate, update, confirm and augment, cull.
"""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.association._kernels import NEW, Gates, associate_nearest
from saccade.slam.filter._range_bearing_kernels import (
    augment_range_bearing,
    inverse_observe,
    predict_by_control,
    update_range_bearing,
    write_pose,
)
from saccade.slam.filter._state_kernels import LANDMARKS, FilterState, Scratch, is_full
from saccade.slam.map_management._kernels import (
    CandidateBuffer,
    ConfirmationPolicy,
    CullingRule,
    VisibilityCounts,
    check_visibility,
    confirm,
    predict_visible,
)
from saccade.types import FloatArray, IntArray


class Stretch(NamedTuple):
    """Consecutive poses of a log: the controls that lead to them, and their observations.

    The observations edge[i] to edge[i + 1] are made at pose i, each of `landmark`: one of the
    map, the next new one, or none (negative).
    """

    control: FloatArray
    """(t, c)."""
    U: FloatArray
    """(t, c, c)."""
    bias_jacobian: FloatArray
    """(t, c, r - 3) of the control by the robot's states beyond the pose."""
    z: FloatArray
    """(k, 2)."""
    R: FloatArray
    """(k, 2, 2)."""
    landmark: IntArray
    """(k,)."""
    edge: IntArray
    """(t + 1,)."""
    next_pose: IntArray
    """(1,) index of the pose that comes next."""
    next_observation: IntArray
    """(1,) index of the observation that comes next; -1 if the motion to `next_pose` does."""


class Replay(NamedTuple):
    """Poses and innovations of consecutive poses of a log."""

    pose: FloatArray
    """(t, 3) after each step."""
    covariance: FloatArray
    """(t, 3, 3) of the pose."""
    innovation: FloatArray
    """(k, 2) as in `Innovation`; here and below NaN where an observation updated nothing."""
    innovation_covariance: FloatArray
    """(k, 2, 2)."""
    nis: FloatArray
    """(k,)."""


class Search(NamedTuple):
    """Parameters of association, confirmation and culling."""

    gates: Gates
    policy: ConfirmationPolicy
    rule: CullingRule


@kernel()
def replay(f: FilterState, w: Scratch, s: Stretch, out: Replay) -> None:
    """Process poses with known association, as far as there is room."""
    while s.next_pose[0] < len(s.control) and not is_full(f):
        if s.next_observation[0] < 0:
            predict_next(f, w, s)
        if not update_all(f, w, s, out):
            return
        finish_pose(f, w, s, out)


@kernel()
def explore(
    f: FilterState,
    w: Scratch,
    s: Stretch,
    first: int,
    time: FloatArray,
    search: Search,
    candidates: CandidateBuffer,
    visibility: VisibilityCounts,
    out: Replay,
) -> None:
    """Process poses with unknown association, as far as there is room, or until one culls."""
    culled = False
    while s.next_pose[0] < len(s.control) and not is_full(f) and not culled:
        i = s.next_pose[0]
        start, end = s.edge[i], s.edge[i + 1]
        association = s.landmark[start:end]
        check = search.rule.enabled and end > start and (first + i) % search.rule.interval == 0
        if s.next_observation[0] < 0:
            predict_next(f, w, s)
            if end > start:
                associate_nearest(f, s.z[start:end], s.R[start:end], search.gates, association)
            if check:
                predict_visible(f, visibility)
        if not update_all(f, w, s, out):
            return
        if (association == NEW).any():
            new = start + np.flatnonzero(association == NEW)
            if len(f.blocks) - f.counts[LANDMARKS] < len(new):
                return
            if len(candidates.kept) - candidates.length[0] < len(new):
                return
            augment_confirmed(f, w, s, new, time[i], search.policy, candidates)
        for k in range(end - start):
            association[k] = max(association[k], -1)
        if check:
            culled = check_visibility(visibility, search.rule, f.counts[LANDMARKS], association)
        finish_pose(f, w, s, out)


@kernel()
def predict_next(f: FilterState, w: Scratch, s: Stretch) -> None:
    """Move to the next pose."""
    i = s.next_pose[0]
    predict_by_control(f, w, s.control[i], s.U[i], s.bias_jacobian[i])
    s.next_observation[0] = s.edge[i]


@kernel()
def update_all(f: FilterState, w: Scratch, s: Stretch, out: Replay) -> bool:
    """Update by the observations of a pose, as far as there is room; returns whether by all."""
    while s.next_observation[0] < s.edge[s.next_pose[0] + 1]:
        k = s.next_observation[0]
        if is_full(f):
            return False
        if s.landmark[k] == f.counts[LANDMARKS]:
            augment_range_bearing(f, w, s.z[k], s.R[k])
        elif s.landmark[k] >= 0:
            m = f.robot_size + 2 * s.landmark[k]
            v, S = out.innovation[k], out.innovation_covariance[k]
            out.nis[k] = update_range_bearing(f, w, m, s.z[k], s.R[k], v, S)
        s.next_observation[0] += 1
    return True


@kernel()
def augment_confirmed(
    f: FilterState,
    w: Scratch,
    s: Stretch,
    new: IntArray,
    time: float,
    policy: ConfirmationPolicy,
    candidates: CandidateBuffer,
) -> None:
    """Associate new observations (m,) with the candidates; add those that confirm one."""
    xy, C = np.empty((len(new), 2)), np.empty((len(new), 2, 2))
    confirmed = np.empty(len(new), np.bool_)
    for i in range(len(new)):
        inverse_observe(f, w, s.z[new[i]], s.R[new[i]], xy[i], C[i])
    confirm(candidates, policy, xy, C, time, confirmed)
    for i in range(len(new)):
        if confirmed[i]:
            s.landmark[new[i]] = f.counts[LANDMARKS]
            augment_range_bearing(f, w, s.z[new[i]], s.R[new[i]])


@kernel()
def finish_pose(f: FilterState, w: Scratch, s: Stretch, out: Replay) -> None:
    """Write the pose and its covariance, and advance."""
    i = s.next_pose[0]
    write_pose(f, w, out.pose[i], out.covariance[i])
    s.next_pose[0], s.next_observation[0] = i + 1, -1
