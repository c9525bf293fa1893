"""Relative poses estimated from matches, against simulated motions."""

import cv2
import numpy as np
import pytest

from saccade.datasets.drives.sidecar_files import Poses
from saccade.evaluation.relative_pose import FAILED, pose_errors, relative_pose

MATRIX = np.array([[700.0, 0, 600], [0, 700, 180], [0, 0, 1]])


@pytest.fixture
def motion(rng):
    """Poses of a camera that turns and moves, and the matches of points that it sees."""
    rotation, _ = cv2.Rodrigues(np.array([0.02, 0.1, -0.01]))
    rotations = np.stack([np.eye(3), rotation])
    poses = Poses(np.arange(2.0), rotations, np.array([[0.0, 0, 0], [0.2, 0.1, 1.5]]))
    points = rng.uniform([-8, -3, 8], [8, 3, 30], (200, 3))
    seen = [
        cv2.projectPoints(points, cv2.Rodrigues(r.T)[0], -r.T @ p, MATRIX, None)[0][:, 0]
        for r, p in zip(poses.rotation, poses.position, strict=True)
    ]
    return poses, *seen


def test_the_pose_of_a_simulated_motion_is_found(motion):
    poses, first, second = motion
    sigma = np.ones((200, 2))
    angles = pose_errors(np.hstack([first, second]), sigma, MATRIX, relative_pose(poses, 0, 1))
    assert max(angles) < 0.05
    swapped = pose_errors(np.hstack([second, first]), sigma, MATRIX, relative_pose(poses, 0, 1))
    assert swapped[0] > 5
    assert swapped[1] > 90


def test_without_enough_matches_there_is_no_pose(motion):
    poses, first, second = motion
    truth = relative_pose(poses, 0, 1)
    matched = np.hstack([first, second])[:4]
    assert pose_errors(matched, np.ones((4, 2)), MATRIX, truth) == (FAILED, FAILED)
