"""A step with custom models or a custom association, in the order of the compiled one."""

from typing import TYPE_CHECKING

import numpy as np

from saccade.slam._step_kernels import BEFORE_MOTION, StepResults, Steps, drop_new
from saccade.slam.association._kernels import NEW
from saccade.slam.association._name_table_kernels import keep_named, may_cull
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.progressive import update_in_parts
from saccade.types import IntArray

if TYPE_CHECKING:
    from saccade.slam.online import Slam


def take_custom_step(slam: "Slam", s: Steps, out: StepResults) -> IntArray:
    """Take one step with custom models or a custom association; see `take_step`."""
    ekf, i = slam.ekf, int(s.position[0])
    scan = slice(s.edge[i], s.edge[i + 1])
    z, R, identity = s.z[scan], s.R[scan], s.identity[scan]
    if i >= s.still[0]:
        ekf.predict(s.control[i], s.U[i])  # C.5-C.9
    left_out = (
        len(z) > 0
        and slam.recovery.rule.enabled
        and slam.recovery.leaves_out(
            ekf, z, R, slam.culling.counts.confirmed, slam.known_landmarks(identity)
        )
    )
    if len(z) > 0 and not left_out:
        return process_scan(slam, s, out)
    s.landmark[scan] = -1
    _finish(ekf, s, out)
    return np.empty(0, np.int64)


def process_scan(slam: "Slam", s: Steps, out: StepResults) -> IntArray:
    """Finish a step by its scan, after the motion; returns the culled landmarks."""
    ekf, i = slam.ekf, int(s.position[0])
    scan = slice(s.edge[i], s.edge[i + 1])
    z, R, identity, found = s.z[scan], s.R[scan], s.identity[scan], s.landmark[scan]
    ekf.confirmed = slam.culling.confirmed(len(ekf))
    found[:] = slam.associate(ekf, z, R, identity)
    if slam.mode == "localize":
        drop_new(slam.names, found, len(ekf))
    check, looseness = slam.culling.is_due(), 1.0
    if slam.doubted is not None:
        s.refused[scan], looseness = slam.doubted.refused, slam.doubted.looseness
        check = check and may_cull(slam.doubted.table)
    predicted = ekf.predict_observations().z if check else None
    innovations = update_in_parts(ekf, z, R, found, looseness)  # C.10-C.14
    for array, values in zip(out.innovations, innovations, strict=True):
        array[scan] = values
    mapped = len(ekf)
    for k in np.flatnonzero(found == NEW):
        found[k] = ekf.augment(z[k], R[k])  # C.15-C.18
        slam.associate.added(int(found[k]), int(identity[k]))
    if slam.culling.rule.enabled:
        slam.culling.update(ekf, predicted, mapped, float(z[:, 0].max()), found)
    if slam.doubted is not None:
        keep_named(slam.doubted.table, slam.culling.counts.culled)
    culled = slam.culling.remove_culled(slam.stale)
    found[:] = np.maximum(found, -1)
    _finish(ekf, s, out)
    return culled


def _finish(ekf: EkfSlam, s: Steps, out: StepResults) -> None:
    i = int(s.position[0])
    out.pose[i], out.covariance[i] = ekf.pose, ekf.pose_covariance
    s.position[:] = i + 1, BEFORE_MOTION
