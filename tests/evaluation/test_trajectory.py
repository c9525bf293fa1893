"""Distances from the truth, against evo's."""

import numpy as np
import pytest
from evo.core import metrics, sync
from evo.core.trajectory import PoseTrajectory3D

from saccade import LogWarning, slam
from saccade.datasets import load
from saccade.evaluation.runs import summarize_run
from saccade.evaluation.trajectory import (
    coverage_remarks,
    landmark_rmse,
    position_rmse,
    score_drive,
)
from saccade.slam import observe
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


SECONDS = np.arange(0, 10, 0.1)
CIRCLE = Trajectory(SECONDS, np.c_[5 * np.cos(SECONDS), 5 * np.sin(SECONDS), SECONDS + np.pi / 2])
"""A circle of 5 m with one radian a second."""


def part_of(trajectory, kept):
    covariance = trajectory.covariance
    return Trajectory(
        trajectory.time[kept],
        trajectory.pose[kept],
        None if covariance is None else covariance[kept],
    )


@pytest.mark.parametrize(
    ("kept", "time", "covered"),
    [
        (slice(20, 80), [1.98, 1.995, 2.0, 5.05, 7.9, 7.905, 7.95], [0, 1, 1, 1, 1, 1, 0]),
        (np.r_[0:40, 60:100], [3.9, 3.95, 5.0, 5.95, 6.0], [1, 0, 0, 0, 1]),
        (slice(0, 100, 3), [0.15, 0.3, 9.85, 9.9], [1, 1, 1, 1]),
        (slice(0, 100, 20), [0.0, 0.5, 1.0, 2.0], [1, 0, 0, 1]),
        (slice(50, 51), [4.9, 5.0, 5.1], [0, 1, 0]),
        (slice(0, 0), [0.0, 5.0], [0, 0]),
    ],
    ids=["ends", "gap", "every third", "sparse", "one pose", "none"],
)
def test_poses_are_neither_extrapolated_nor_taken_across_gaps(kept, time, covered):
    time, truth = np.array(time), part_of(CIRCLE, kept)
    assert truth.covers(time).tolist() == [bool(each) for each in covered]
    expected = np.c_[5 * np.cos(time), 5 * np.sin(time)]
    expected[~truth.covers(time)] = np.nan
    np.testing.assert_allclose(truth.at(time)[:, :2], expected, atol=0.06)


@pytest.mark.parametrize("kept", [slice(0, 50), slice(50, 100), np.r_[0:30, 70:100]])
def test_errors_are_those_of_the_part_that_the_truth_covers(rng, kept):
    noisy = CIRCLE.pose + rng.normal(size=(100, 3)) * 0.03
    estimate = Trajectory(SECONDS, noisy, np.tile(1e-3 * np.eye(3), (100, 1, 1)))
    score = score_drive(estimate, part_of(CIRCLE, kept))
    alone = score_drive(part_of(estimate, kept), part_of(CIRCLE, kept))
    assert score.poses_compared == alone.poses_compared == len(SECONDS[kept])
    for name in ("ate_m", "ate_unaligned_m", "end_m"):
        assert getattr(score, name) == pytest.approx(getattr(alone, name)), name
    expected = score_drive(estimate, CIRCLE).rpe_m
    assert score.rpe_m == pytest.approx(expected, rel=0.15)  # no step leads across the gap
    assert score.inside_3sigma > 0.9
    aligned = score_drive(estimate, part_of(CIRCLE, kept), start_known=False)
    assert aligned.ate_m == score.ate_m
    assert np.isnan([aligned.ate_unaligned_m, aligned.end_m, aligned.inside_3sigma]).all()


@pytest.mark.parametrize(
    ("compared", "poses", "words"),
    [
        (None, 40, ""),
        (40, 40, ""),
        (20, 40, "truth for 20 of 40 poses"),
        (3, 40, "warning: truth for only 3 of 40 poses"),
        (50, 600, "warning: truth for only 50 of 600 poses"),
    ],
)
def test_few_true_poses_are_a_warning(compared, poses, words):
    assert " ".join(coverage_remarks(compared, poses)).startswith(words)
    assert bool(coverage_remarks(compared, poses)) == bool(words)


def test_a_log_whose_truth_begins_late_has_no_start(tmp_path):
    """Motion capture begins 10 s after the odometry of a robot that drives in a circle."""
    time = np.arange(0.0, 40.0, 0.5)
    pose = np.stack([5 * np.sin(time / 5), 5 - 5 * np.cos(time / 5), time / 5], 1)
    landmarks = np.array([[0.0, 5.0], [2.0, 7.0], [-2.0, 4.0]])
    seen = [(t, 72 + i, *observe(p, m)[0]) for t, p in zip(time, pose, strict=True)
            for i, m in enumerate(landmarks)]  # fmt: skip
    late = time >= 10.0
    np.savez(
        tmp_path / "log.npz",
        barcodes=[[1, 1], [6, 72], [7, 73], [8, 74]],
        robot1_odometry=np.column_stack([time, np.ones(len(time)), np.full(len(time), 0.2)]),
        robot1_measurement=np.array(seen),
        robot1_groundtruth=np.column_stack([time, pose])[late],
    )
    with pytest.warns(LogWarning, match="does not cover the first pose"):
        log = load("auto", tmp_path / "log.npz")
    assert log.start.tolist() == [0, 0, 0]
    assert log.aligned_truth is None
    row = summarize_run(log, slam.run(log))
    assert row["poses_compared"] == pytest.approx(late.sum(), abs=2)
    assert f"truth for {row['poses_compared']} of" in row["remark"]
    assert "smoothed_position_rmse_m" in row
    assert "smoothed_position_unaligned_rmse_m" not in row
