"""Where a robot is at the first pose of a log, in a map that was saved before."""

import numpy as np

from saccade.errors import LogError
from saccade.slam.models import Motion
from saccade.slam.online import Slam
from saccade.slam.relocalization import Relocalizer
from saccade.types import FloatArray, LandmarkLog

FOUND = 0.99
"""Probability from which a hypothesis of the pose is right."""
MIN_MATCHED = 3
"""Observed points that must be landmarks of the map for the robot to be found."""
MAX_SCANS = 50
"""Scans after which a robot that was not found is not in the map."""


def find_start(slam: Slam, log: LandmarkLog) -> tuple[FloatArray, FloatArray]:
    """Find the first pose of a log in a map, by its first scans and without a prior.

    This looks ahead to the scan that decides; `Relocalizer` finds a live robot at that scan.

    Args:
        slam: with the map, as `Slam.load` gives it.
        log: of which the first scans are used, as many as are needed.

    Returns:
        The first pose (3,) in the frame of the map, and its covariance (3, 3), which includes
        the uncertainty of the landmarks around.

    Raises:
        LogError: no pose is certain.
    """
    ekf = slam.ekf
    r = len(ekf.robot_state)
    search = Relocalizer(ekf.landmarks, ekf.covariance[r:, r:], motion=slam.motion)
    moved, spread, scans, best = np.zeros(3), np.zeros((3, 3)), 0, 0.0
    for step in range(len(log.time)):
        if step > 0:
            u, U = log.control[step - 1], log.control_covariance[step - 1]
            search.predict(u, U)
            moved, spread = _moved(slam.motion, moved, spread, u, U)
        scan = log.observation_pose == step
        if not scan.any() or scans == MAX_SCANS:
            continue
        found = search.add(log.observation[scan], log.observation_covariance[scan])
        scans += 1
        if len(found) == 0:
            continue
        best, association = float(found.probability[0]), found.association[0]
        matched = association[association >= 0]
        if best > FOUND and len(matched) >= MIN_MATCHED:
            covariance = found.covariance[0].copy()
            covariance[:2, :2] += ekf.landmark_covariances[matched].mean(0)
            return _before(found.pose[0], covariance, moved, spread)
    raise LogError(
        f"start: expected a pose in the map that is certain, found a probability of {best:.2f} "
        f"after {scans} scans; give the start"
    )


def _moved(
    motion: Motion, pose: FloatArray, P: FloatArray, u: FloatArray, U: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Dead reckoning by one control."""
    pose, Fx, Fu = motion(pose, u)
    return pose, Fx @ P @ Fx.T + Fu @ U @ Fu.T


def _before(
    pose: FloatArray, C: FloatArray, moved: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The pose from which a motion (3,) with its covariance leads to a pose."""
    heading = pose[2] - moved[2]
    c, s = np.cos(heading), np.sin(heading)
    R = np.array([[c, -s], [s, c]])
    arm = R @ moved[:2]
    J, K = np.eye(3), np.zeros((3, 3))
    J[:2, 2] = arm[1], -arm[0]
    K[:2, :2], K[:2, 2], K[2, 2] = -R, [-arm[1], arm[0]], -1.0
    return np.append(pose[:2] - arm, heading), J @ C @ J.T + K @ spread @ K.T
