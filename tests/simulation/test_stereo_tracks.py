"""Stereo tracks simulated along a trajectory, beside OpenCV's projection."""

import cv2
import numpy as np

from saccade.frames import Camera
from saccade.types import Trajectory
from stereo_tracks import TrackConfig, simulate_tracks

CAMERA = Camera(1226, 370, 707.0, 707.0, 602.0, 183.0, 0.537)
EXACT = {"pixel_sigma": 0.0, "drift_sigma": 0.0, "disparity_sigma": 0.0, "outliers": 0.0}


def straight(config: TrackConfig, n: int = 20):
    """A drive straight ahead by a metre a frame."""
    poses = np.tile(np.eye(3, 4), (n, 1, 1))
    poses[:, 2, 3] = np.arange(n)
    robot = np.zeros((n, 3))
    robot[:, 0] = np.arange(n)
    return simulate_tracks(CAMERA, poses, Trajectory(0.1 * np.arange(n), robot), config, 0)


def test_points_are_static_and_distorted_as_opencv_does():
    distortion, offset = 0.05, 0.8
    drive = straight(TrackConfig(refresh=0, distortion=distortion, offset=offset, **EXACT))
    plain = straight(TrackConfig(refresh=0, **EXACT))
    K = np.array([[707.0, 0, 602.0], [0, 707.0, 183.0], [0, 0, 1]])
    a, b = plain.load(0).tracks, plain.load(5).tracks
    _, i, j = np.intersect1d(a.id, b.id, return_indices=True)
    assert len(i) > 10
    depth = 707.0 * 0.537 / a.disparity[i]
    place = np.c_[(a.xy[i] - (602.0, 183.0)) / 707.0, np.ones(len(i))] * depth[:, None]
    expected = cv2.projectPoints(place, np.zeros(3), np.array([0, 0, -5.0]), K, None)[0][:, 0]
    np.testing.assert_allclose(b.xy[j], expected, atol=1e-6)
    bent, b = drive.load(0).tracks, plain.load(0).tracks
    _, i, j = np.intersect1d(b.id, bent.id, return_indices=True)
    depth = 707.0 * 0.537 / b.disparity[i]
    place = np.c_[(b.xy[i] - (602.0, 183.0)) / 707.0, np.ones(len(i))] * depth[:, None]
    expected = cv2.projectPoints(
        place, np.zeros(3), np.zeros(3), K, np.array([distortion, 0, 0, 0])
    )
    np.testing.assert_allclose(bent.xy[j], expected[0][:, 0], atol=1e-6)
