"""Steps of EKF-SLAM with the models of this package, in compiled code."""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.association._kernels import DROPPED, NEW, Gates, associate_nearest
from saccade.slam.filter._range_bearing_kernels import (
    Innovations,
    augment_range_bearing,
    inverse_observe,
    predict_by_control,
    update_scan,
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


class Steps(NamedTuple):
    """Consecutive steps: the motion to each pose, and the scan that is observed there.

    The scan of step i are the observations edge[i] to edge[i + 1].
    """

    first: int
    """Number of the first step since the start of the run."""
    still: int
    """1 if no control leads to the first step, else 0."""
    time: FloatArray
    """(t,)."""
    control: FloatArray
    """(t, c); unused for a step without."""
    U: FloatArray
    """(t, c, c)."""
    bias_jacobian: FloatArray
    """(t, c, r - 3) of the control by the robot's states beyond the pose."""
    edge: IntArray
    """(t + 1,)."""
    z: FloatArray
    """(k, 2)."""
    R: FloatArray
    """(k, 2, 2)."""
    identity: IntArray
    """(k,) of the landmarks, -1 where it is unknown."""
    landmark: IntArray
    """(k,) the association: given for known identities, else filled step by step."""
    position: IntArray
    """(2,) the step that comes next, and its observation that comes next; -1 before the motion."""


class StepResults(NamedTuple):
    """Poses and innovations of t steps with k observations."""

    pose: FloatArray
    """(t, 3) after each step."""
    covariance: FloatArray
    """(t, 3, 3) of the pose."""
    innovations: Innovations
    """(k,)."""


class Rules(NamedTuple):
    """Parameters of association, confirmation and culling."""

    nearest: bool
    """Whether observations are associated with the nearest landmark; else `Steps.landmark` is."""
    gates: Gates
    policy: ConfirmationPolicy
    culling: CullingRule
    adds: bool
    """Whether landmarks are added to the map."""


@kernel()
def take_steps(
    f: FilterState,
    w: Scratch,
    s: Steps,
    end: int,
    rules: Rules,
    candidates: CandidateBuffer,
    visibility: VisibilityCounts,
    out: StepResults,
) -> None:
    """Take the steps before `end`, up to one that lacks room or that culls a landmark."""
    while s.position[0] < end:
        if not take_step(f, w, s, rules, candidates, visibility, out):
            return


@kernel()
def take_step(
    f: FilterState,
    w: Scratch,
    s: Steps,
    rules: Rules,
    candidates: CandidateBuffer,
    visibility: VisibilityCounts,
    out: StepResults,
) -> bool:
    """Take the next step, in the order of `Slam.step`, or as much of it as there is room for.

    Returns whether another one can follow at once: all of it was done, and nothing is culled.
    """
    i = s.position[0]
    start, end = s.edge[i], s.edge[i + 1]
    association = s.landmark[start:end]
    check = rules.culling.enabled and end > start and (s.first + i) % rules.culling.interval == 0
    if is_full(f):
        return False
    if s.position[1] < 0:
        if i >= s.still:
            predict_by_control(f, w, s.control[i], s.U[i], s.bias_jacobian[i])  # C.5-C.9
        if rules.nearest and end > start:
            associate_nearest(f, s.z[start:end], s.R[start:end], rules.gates, association)
        if not rules.adds:
            drop_new(association, f.counts[LANDMARKS])
        if check:
            predict_visible(f, visibility)
        s.position[1] = start
    k = update_scan(f, w, s.z, s.R, s.landmark, s.position[1], end, out.innovations)  # C.10-C.14
    s.position[1] = k
    if k < end:
        return False
    new = start + np.flatnonzero(association == NEW)
    if len(new) > 0:
        if len(f.blocks) - f.counts[LANDMARKS] < len(new):
            return False
        if len(candidates.kept) - candidates.length[0] < len(new):
            return False
        augment_confirmed(f, w, s, new, s.time[i], rules.policy, candidates)  # C.15-C.18
    for k in range(end - start):
        association[k] = max(association[k], -1)
    culls = check and check_visibility(visibility, rules.culling, f.counts[LANDMARKS], association)
    write_pose(f, w, out.pose[i], out.covariance[i])
    s.position[0], s.position[1] = i + 1, -1
    return not culls


@kernel()
def drop_new(association: IntArray, landmarks: int) -> None:
    """Drop observations (m,) of none of so many landmarks."""
    for k in range(len(association)):
        if association[k] == NEW or association[k] >= landmarks:
            association[k] = DROPPED


@kernel()
def augment_confirmed(
    f: FilterState,
    w: Scratch,
    s: Steps,
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
