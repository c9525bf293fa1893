"""A step with custom models or a custom association, in the order of the compiled one."""

from typing import TYPE_CHECKING

import numpy as np

from saccade.slam._step_kernels import StepResults, Steps, drop_new
from saccade.slam.association._kernels import NEW
from saccade.slam.association._name_table_kernels import keep_named, may_cull
from saccade.types import IntArray

if TYPE_CHECKING:
    from saccade.slam.online import Slam


def take_custom_step(slam: "Slam", s: Steps, out: StepResults) -> IntArray:
    """Take one step with custom models or a custom association; see `take_step`."""
    ekf, i = slam.ekf, int(s.position[0])
    scan, culled = slice(s.edge[i], s.edge[i + 1]), np.empty(0, np.int64)
    z, R, identity, found = s.z[scan], s.R[scan], s.identity[scan], s.landmark[scan]
    if i >= s.still[0]:
        ekf.predict(s.control[i], s.U[i])  # C.5-C.9
    if len(z) > 0:
        ekf.confirmed = slam.culling.confirmed(len(ekf))
        left_out = slam.recovery.rule.enabled and slam.recovery.leaves_out(
            ekf, z, R, slam.culling.counts.confirmed, slam.known_landmarks(identity)
        )
        if left_out:
            found[:] = -1
            out.pose[i], out.covariance[i] = ekf.pose, ekf.pose_covariance
            s.position[0] = i + 1
            return culled
        found[:] = slam.associate(ekf, z, R, identity)
        if slam.mode == "localize":
            drop_new(slam.names, found, len(ekf))
        check = slam.culling.is_due()
        if slam.doubted is not None:
            s.refused[scan] = slam.doubted.refused
            check = check and may_cull(slam.doubted.table)
        predicted = ekf.predict_observations().z if check else None
        innovations = ekf.update_scan(z, R, found)  # C.10-C.14
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
    out.pose[i], out.covariance[i] = ekf.pose, ekf.pose_covariance
    s.position[0] = i + 1
    return culled
