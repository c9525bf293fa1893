"""Steps of a robot that may be lost: its map is kept, and its pose is searched in it."""

from typing import TYPE_CHECKING

import numpy as np

from saccade.slam._step_kernels import StepResults, Steps
from saccade.slam.association.known import KnownIdentity

if TYPE_CHECKING:
    from saccade.slam.online import Slam


def leave_out(slam: "Slam", s: Steps, out: StepResults) -> None:
    """Process a scan that was left out; the robot may be lost."""
    renumber(slam, s)
    i = int(s.position[0]) - 1
    if slam.recovery.begin_if_lost(slam.ekf, slam.confirmed):
        scan = slice(s.edge[i], s.edge[i + 1])
        slam.recovery.search(s.z[scan], s.R[scan], slam.known_landmarks(s.identity[scan]))
        out.lost[i] = True


def take_lost_step(slam: "Slam", s: Steps, out: StepResults) -> None:
    """Take one step of a lost robot, which may be found."""
    ekf, i = slam.ekf, int(s.position[0])
    scan = slice(s.edge[i], s.edge[i + 1])
    z, R = s.z[scan], s.R[scan]
    if i >= s.still[0]:
        ekf.predict(s.control[i], s.U[i])  # C.5-C.9
        slam.recovery.predict(s.control[i], s.U[i])
    s.landmark[scan] = -1
    if len(z) > 0:
        named = slam.known_landmarks(s.identity[scan])
        slam.recovery.leaves_out(ekf, z, R, slam.culling.counts.confirmed, named)
        slam.recovery.search(z, R, named)
        s.landmark[scan] = slam.recovery.resume_if_found(ekf)
    out.lost[i] = slam.recovery.lost
    out.pose[i], out.covariance[i] = ekf.pose, ekf.pose_covariance
    s.position[0] = i + 1
    if not slam.recovery.lost:
        renumber(slam, s)


def renumber(slam: "Slam", s: Steps) -> None:
    """Number named landmarks ahead anew, after scans that added none."""
    if isinstance(slam.associate, KnownIdentity) and slam.is_compiled:
        first, end, mapped = s.edge[s.position[0]], s.edge[-1], len(slam.ekf)
        known = slam.associate.number
        slam.associate.number = {name: n for name, n in known.items() if n < mapped}
        scan = np.repeat(np.arange(len(s.time)), np.diff(s.edge))[first:]
        identity = s.identity[first:end]
        s.landmark[first:end] = slam.associate.number_ahead(identity, scan, mapped)
