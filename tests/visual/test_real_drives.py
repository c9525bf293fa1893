"""Whole drives on real images and tracks, held to the bars that were set for them.

The first stretch of each; the whole of them takes minutes: see benchmarks/drive.py.
"""

import numpy as np
import pytest

from saccade import visual
from saccade.datasets.drives.kitti import read_kitti_drive
from saccade.datasets.drives.tracks import read_tracks_drive
from saccade.evaluation.out_and_back import OutAndBackConfig, out_and_back
from saccade.evaluation.trajectory import position_rmse


def inside(result, drive):
    """Share of the frames after the first whose place is within 3 sigma, and the last error."""
    away = result.trajectory.pose[1:, :2] - drive.truth.at(drive.time[1:])[:, :2]
    spread = np.linalg.inv(result.trajectory.covariance[1:, :2, :2])
    square = np.einsum("ni,nij,nj->n", away, spread, away)
    return np.mean(square < 11.83), np.hypot(*away[-1])


@pytest.mark.shared
def test_one_camera_comes_back_to_where_it_began(shared):
    drive = out_and_back(
        read_kitti_drive(shared / "data/drives/kitti07"), OutAndBackConfig(frames=48)
    )
    result = visual.run(drive)
    sure, returned = inside(result, drive)
    assert position_rmse(result.trajectory, drive.truth) < 0.40
    assert returned < 0.2
    assert sure >= 0.95
    assert np.bincount(result.observations.kind)[2] > 20


@pytest.mark.shared
def test_stereo_tracks_are_followed(shared):
    tracks = shared / "data/drives/kitti07/stereo_tracks_clean.npz"
    drive = read_tracks_drive(tracks).until(150)
    result = visual.run(drive, visual.VisualConfig(detect_interval=1))
    sure, _ = inside(result, drive)
    assert position_rmse(result.trajectory, drive.truth) < 0.8
    assert sure >= 0.95


@pytest.mark.shared
def test_a_robot_that_speeds_up_is_not_left_behind(shared):
    drive = read_kitti_drive(shared / "data/drives/kitti07").until(64)
    sure, missed = inside(visual.run(drive), drive)
    assert missed < 0.6  # of 22 m
    assert sure >= 0.95
