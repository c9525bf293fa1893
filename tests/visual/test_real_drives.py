"""Drives on real images and tracks.

By night they are held to bars that were set on these very drives, on the first stretch of each
(all of them take minutes: see benchmarks/drive.py). What holds on any drive is always tested.
"""

from dataclasses import replace

import numpy as np
import pytest

from out_and_back import OutAndBackConfig, out_and_back
from saccade import visual
from saccade.datasets import load_drive
from saccade.evaluation.trajectory import position_rmse


def within_3sigma(result, drive):
    """Fraction of the frames after the first inside 3 sigma, and the last error in meters."""
    error = result.trajectory.pose[1:, :2] - drive.truth.at(drive.time[1:])[:, :2]
    information = np.linalg.inv(result.trajectory.covariance[1:, :2, :2])
    squared = np.einsum("ni,nij,nj->n", error, information, error)
    return np.mean(squared < 11.829), np.hypot(*error[-1])


@pytest.mark.shared
def test_a_drive_does_not_depend_on_the_robots_frame(shared):
    """Start elsewhere, and the whole run is moved there: trajectory, map and what it observed."""
    drive = load_drive("tracks", shared / "data/drives/kitti07/stereo_tracks_clean.npz").until(30)
    start = np.array([40.0, -7.0, 2.0])
    here, there = visual.run(drive), visual.run(replace(drive, start=start))
    c, s = np.cos(start[2] - drive.start[2]), np.sin(start[2] - drive.start[2])
    R = np.array([[c, -s], [s, c]])
    for one, other in (
        (here.trajectory.pose[:, :2], there.trajectory.pose[:, :2]),
        (here.map.xy, there.map.xy),
    ):
        moved = (one - drive.start[:2]) @ R.T + start[:2]
        np.testing.assert_allclose(other, moved, atol=1e-6)
    covariance = R @ here.trajectory.covariance[:, :2, :2] @ R.T
    np.testing.assert_allclose(there.trajectory.covariance[:, :2, :2], covariance, atol=1e-8)
    np.testing.assert_array_equal(here.observations.landmark, there.observations.landmark)


@pytest.mark.nightly
@pytest.mark.shared
def test_one_camera_comes_back_to_where_it_began(shared):
    drive = out_and_back(
        load_drive("kitti", shared / "data/drives/kitti07"), OutAndBackConfig(frames=48)
    )
    result = visual.run(drive)
    inside_3sigma, returned = within_3sigma(result, drive)
    assert position_rmse(result.trajectory, drive.truth) < 0.40
    assert returned < 0.2
    assert inside_3sigma >= 0.95
    assert np.bincount(result.observations.kind)[2] > 20


@pytest.mark.nightly
@pytest.mark.shared
def test_stereo_tracks_are_mapped(shared):
    tracks = shared / "data/drives/kitti07/stereo_tracks_clean.npz"
    drive = load_drive("tracks", tracks).until(150)
    result = visual.run(drive, visual.VisualConfig(detect_interval=1))
    inside_3sigma, _ = within_3sigma(result, drive)
    assert position_rmse(result.trajectory, drive.truth) < 0.8
    assert inside_3sigma >= 0.95


@pytest.mark.nightly
@pytest.mark.shared
def test_a_robot_that_speeds_up_is_not_left_behind(shared):
    drive = load_drive("kitti", shared / "data/drives/kitti07").until(64)
    inside_3sigma, error = within_3sigma(visual.run(drive), drive)
    assert error < 0.6  # of 22 m
    assert inside_3sigma >= 0.95
