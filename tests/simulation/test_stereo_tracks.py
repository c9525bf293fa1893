"""Stereo tracks simulated along a trajectory, beside OpenCV's projection."""

import cv2
import numpy as np
import pytest

from saccade.errors import ConfigError
from saccade.frames import Camera
from saccade.plane import steps_between
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


def test_a_refresh_ends_all_tracks():
    drive = straight(TrackConfig(refresh=4), 80)
    pairs = [(drive.load(i).tracks.id, drive.load(i + 1).tracks.id) for i in range(79)]
    common = np.array([len(np.intersect1d(*pair)) for pair in pairs])
    assert 8 < (common == 0).sum() < 36
    assert (common[common > 0] > 10).all()


def test_odometry_has_the_declared_errors_and_no_slip():
    n = 4000
    turn = 0.02 * np.sin(np.arange(n) / 50)
    pose = np.zeros((n, 3))
    pose[:, 2] = np.cumsum(turn)
    pose[:, 0] = np.cumsum(np.cos(pose[:, 2]))
    pose[:, 1] = np.cumsum(np.sin(pose[:, 2]))
    config = TrackConfig(speed_scale=0.02, turn_bias=0.01, points=6, speed_sigma=0.1)
    poses = np.tile(np.eye(3, 4), (n, 1, 1))
    drive = simulate_tracks(CAMERA, poses, Trajectory(0.1 * np.arange(n), pose), config, 1)
    error = drive.control - steps_between(pose)
    assert error[:, 0].mean() == pytest.approx(0.02, abs=1e-3)
    assert error[:, 2].mean() == pytest.approx(0.001, abs=2e-4)
    assert error[:, 2].std() == pytest.approx(0.1 * 0.036 / np.sqrt(2), rel=0.1)
    arc = np.tan(drive.control[:, 2] / 2) * drive.control[:, 0]
    np.testing.assert_allclose(drive.control[:, 1], arc, atol=1e-12)


def test_settings_out_of_range_are_refused():
    with pytest.raises(ConfigError, match="survival"):
        TrackConfig(survival=1.5)
