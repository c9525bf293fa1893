"""Steps of EKF-SLAM with the models of this package, in compiled code."""

from typing import NamedTuple

import numpy as np

from saccade._jit import Bound, kernel
from saccade.slam._recovery_kernels import LostEvidence, LostRule, leaves_out
from saccade.slam.association._kernels import DROPPED, NEW, Gates, _associate_nearest
from saccade.slam.association._name_kernels import associate_named
from saccade.slam.association._name_table_kernels import (
    STALE,
    NameGates,
    NameTable,
    keep_named,
    may_cull,
)
from saccade.slam.filter._range_bearing_kernels import (
    Innovations,
    augment_range_bearing,
    predict_by_control,
    update_scan,
    write_pose,
)
from saccade.slam.filter._state_kernels import (
    LANDMARKS,
    FilterState,
    Scratch,
    is_full,
    is_spread_due,
)
from saccade.slam.map_management._kernels import (
    CullingRule,
    VisibilityCounts,
    check_visibility,
    is_check,
    predict_visible,
)
from saccade.types import BoolArray, FloatArray, IntArray

BEFORE_MOTION, CONTRADICTED = -1, -2
"""Of `Steps.position`."""


class Steps(NamedTuple):
    """Consecutive steps: the motion to each pose, and the scan that is observed there.

    The scan of step i are the observations edge[i] to edge[i + 1].
    """

    first: IntArray
    """(1,) number of the first step since the start of the run."""
    still: IntArray
    """(1,) 1 if no control leads to the first step, else 0."""
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
    name: IntArray
    """(k,) rows of the `NameTable`, -1 where the identity is unknown."""
    refused: BoolArray
    """(k,) whether the name of each was refused; filled step by step."""
    position: IntArray
    """(2,) the step that comes next, and its observation that comes next; `BEFORE_MOTION`, or
    `CONTRADICTED` before the association of a scan that compiled code does not decide."""


class StepResults(NamedTuple):
    """Poses and innovations of t steps with k observations."""

    pose: FloatArray
    """(t, 3) after each step."""
    covariance: FloatArray
    """(t, 3, 3) of the pose."""
    innovations: Innovations
    """(k,)."""
    lost: BoolArray
    """(t,) whether the robot was lost after each step."""


class Rules(NamedTuple):
    """Parameters of association and of map management."""

    nearest: bool
    """Whether observations are associated with the nearest landmark; else `Steps.landmark` is."""
    gates: Gates
    names: NameGates
    culling: CullingRule
    lost: LostRule
    adds: bool
    """Whether landmarks are added to the map."""


@kernel()
def bind_steps(
    f: FilterState,
    w: Scratch,
    s: Steps,
    rules: Rules,
    names: NameTable,
    visibility: VisibilityCounts,
    evidence: LostEvidence,
    out: StepResults,
) -> Bound:
    """Bind the arguments of `take_steps`."""
    return Bound((f, w, s, rules, names, visibility, evidence, out))


@kernel()
def take_steps(bound: Bound, end: int) -> bool:
    """Take the steps before `end`, up to one that lacks room, culls, or whose scan is left out.

    Or up to a scan that is `CONTRADICTED`.

    Returns whether all of them were taken, and the last one did nothing of this.
    """
    f, w, s, rules, names, visibility, evidence, out = bound.arguments
    while s.position[0] < end:
        if not _take_step(f, w, s, rules, names, visibility, evidence, out):
            return False
    return True


@kernel(inline=True)
def _take_step(
    f: FilterState,
    w: Scratch,
    s: Steps,
    rules: Rules,
    names: NameTable,
    visibility: VisibilityCounts,
    evidence: LostEvidence,
    out: StepResults,
) -> bool:
    """Take the next step, in the order of `Slam.step`, or as much of it as there is room for.

    Returns whether another one can follow at once: all of it was done, nothing is culled, and its
    scan was not left out.
    """
    i = s.position[0]
    start, end = s.edge[i], s.edge[i + 1]
    association = s.landmark[start:end]
    counts = rules.culling.enabled and end > start
    if is_full(f):
        return False
    if s.position[1] < 0:
        if is_spread_due(f):
            return False
        if i >= s.still[0]:
            predict_by_control(f, w, s.control[i], s.U[i], s.bias_jacobian[i])  # C.5-C.9
        z, R, confirmed = s.z[start:end], s.R[start:end], visibility.confirmed
        if rules.lost.enabled and end > start:
            named = known_landmarks(s, rules, names, start, end)
            if leaves_out(f, evidence, rules.lost, z, R, confirmed, named):
                for k in range(end - start):
                    association[k] = -1
                write_pose(f, w, out.pose[i], out.covariance[i])
                s.position[0], s.position[1] = i + 1, -1
                return False
        if rules.names.enabled and end > start:
            name, refused = s.name[start:end], s.refused[start:end]
            if not associate_named(
                f, w, names, rules.names, rules.gates, confirmed, z, R, name, association, refused
            ):
                s.position[1] = CONTRADICTED
                return False
        elif rules.nearest and end > start:
            _associate_nearest(f, z, R, rules.gates, association[:0], confirmed, association)
        if not rules.adds:
            drop_new(names, association, f.counts[LANDMARKS])
        for k in range(start, end):
            visibility.reach[0] = max(visibility.reach[0], s.z[k, 0])
        if counts and may_cull(names) and is_check(visibility, rules.culling):
            predict_visible(f, visibility)
        s.position[1] = start
    k = update_scan(f, w, s.z, s.R, s.landmark, s.position[1], end, out.innovations)  # C.10-C.14
    s.position[1] = k
    if k < end:
        return False
    mapped, new = f.counts[LANDMARKS], 0
    for k in range(end - start):
        new += association[k] == NEW
    if len(f.blocks) - mapped < new:
        return False
    for k in range(end - start):
        if association[k] == NEW:
            association[k] = f.counts[LANDMARKS]
            augment_range_bearing(f, w, s.z[start + k], s.R[start + k])  # C.15-C.18
    culls = names.counts[STALE] > 0
    if counts:
        check = may_cull(names) and is_check(visibility, rules.culling)
        total = f.counts[LANDMARKS]
        check_visibility(visibility, rules.culling, check, mapped, total, association)
        if check:
            culls = keep_named(names, visibility.culled) or culls
    for k in range(end - start):
        association[k] = max(association[k], -1)
    write_pose(f, w, out.pose[i], out.covariance[i])
    s.position[0], s.position[1] = i + 1, -1
    return not culls


@kernel()
def known_landmarks(s: Steps, rules: Rules, names: NameTable, start: int, end: int) -> IntArray:
    """(k,) landmarks that the names of observations say, -1 for those without."""
    landmark = np.full(end - start, -1)
    for k in range(start, end):
        if rules.names.enabled:
            if s.name[k] >= 0:
                landmark[k - start] = names.landmark[s.name[k]]
        elif not rules.nearest:
            landmark[k - start] = s.landmark[k]
    return landmark


@kernel(inline=True)
def drop_new(names: NameTable, association: IntArray, landmarks: int) -> None:
    """Drop observations (m,) of none of so many landmarks, and names of none."""
    for k in range(len(names.landmark)):
        if names.landmark[k] >= landmarks:
            names.landmark[k] = -1
    for k in range(len(association)):
        if association[k] == NEW or association[k] >= landmarks:
            association[k] = DROPPED
