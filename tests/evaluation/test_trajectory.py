"""Distances from the truth, against evo's."""

import numpy as np
import pytest
from evo.core import metrics, sync
from evo.core.trajectory import PoseTrajectory3D

from saccade.evaluation.trajectory import landmark_rmse, position_rmse
from saccade.types import LandmarkMap, Trajectory


def _evo(trajectory):
    place = np.c_[trajectory.pose[:, :2], np.zeros(len(trajectory))]
    half = trajectory.pose[:, 2] / 2
    zero = np.zeros(len(half))
    turned = np.stack([np.cos(half), zero, zero, np.sin(half)], 1)
    return PoseTrajectory3D(place, turned, trajectory.time)


def _moved(xy, angle=0.8, shift=(3.0, -2.0)):
    c, s = np.cos(angle), np.sin(angle)
    return xy @ np.array([[c, s], [-s, c]]) + shift


@pytest.fixture
def drive(rng):
    xy = np.cumsum(rng.normal(size=(200, 2)), 0)
    return Trajectory(np.arange(200.0), np.c_[xy, np.zeros(200)])


def test_distance_after_alignment_is_that_of_evo(drive, rng):
    noisy = _moved(drive.pose[:, :2]) + rng.normal(size=(200, 2)) * 0.3
    found = Trajectory(drive.time, np.c_[noisy, np.zeros(200)])
    reference, estimate = sync.associate_trajectories(_evo(drive), _evo(found))
    estimate.align(reference)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((reference, estimate))
    expected = ape.get_statistic(metrics.StatisticsType.rmse)
    assert position_rmse(found, drive) == pytest.approx(expected, rel=1e-9)


def test_unaligned_errors_are_those_of_the_frame(drive):
    found = Trajectory(drive.time, np.c_[_moved(drive.pose[:, :2]), np.zeros(200)])
    error = found.pose[:, :2] - drive.pose[:, :2]
    expected = np.sqrt(np.square(error).sum(1).mean())
    assert position_rmse(found, drive, aligned=False) == pytest.approx(expected)
    landmarks, truth = (LandmarkMap(np.arange(200), each.pose[:, :2]) for each in (found, drive))
    assert landmark_rmse(landmarks, truth, aligned=False) == pytest.approx(expected)
    assert landmark_rmse(landmarks, truth) == pytest.approx(0, abs=1e-9)


def test_times_need_not_be_the_same(drive):
    fine = np.linspace(-5, 150, 1551)
    there = [np.interp(fine, drive.time, drive.pose[:, i]) for i in (0, 1)]
    found = Trajectory(fine, np.c_[_moved(np.stack(there, 1)), np.zeros(len(fine))])
    assert position_rmse(found, drive) == pytest.approx(0, abs=1e-9)
    assert position_rmse(drive, found) == pytest.approx(0, abs=1e-9)


def test_outliers_of_the_truth_can_be_left_out(drive, rng):
    off = drive.pose.copy()
    off[rng.choice(200, 15, replace=False), :2] += 40
    truth = Trajectory(drive.time, np.c_[_moved(off[:, :2]), np.full(200, np.nan)])
    assert position_rmse(drive, truth) > 5
    assert position_rmse(drive, truth, keep=0.9) == pytest.approx(0, abs=1e-9)


def test_landmarks_are_compared_by_name(rng):
    xy = rng.uniform(-9, 9, (6, 2))
    truth = LandmarkMap(np.arange(6), xy)
    found = LandmarkMap(np.array([9, 4, 2, 0]), _moved(np.vstack([[[50.0, 0]], xy[[4, 2, 0]]])))
    assert landmark_rmse(found, truth) == pytest.approx(0, abs=1e-9)
