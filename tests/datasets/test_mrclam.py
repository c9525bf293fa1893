"""The MRCLAM reader on a folder made by hand, and on a real set with its truth."""

import numpy as np
import pytest

from saccade import slam
from saccade.datasets import OdometryNoise, load
from saccade.datasets.logs.mrclam import UTIAS, Platform
from saccade.datasets.logs.mrclam import read_mrclam as load_mrclam
from saccade.evaluation.trajectory import landmark_rmse, position_rmse
from saccade.slam import observe

HEADER = "# made by hand\n# Time [s]    ...\n"


@pytest.fixture
def folder(tmp_path):
    """A robot that goes straight on at 1 m/s for 2 s; robot 2 and landmark 6 are before it."""
    files = {
        "Barcodes.dat": "1 \t 5\n2 14\n6 72\n7 27\n",
        "Landmark_Groundtruth.dat": "6 \t 3.0 \t 1.0 \t 0.001 \t 0.002\n7 9 9 0.1 0.1\n",
        "Robot1_Odometry.dat": "100.0 \t 1.0 \t 0.0\n101.0 1.0 0.0\n102.0 0.0 0.0\n",
        "Robot1_Measurement.dat": "101.0 14 2.0 0.1\n101.0 72 2.0 0.5\n101.3 99 1.0 0.0\n",
        "Robot1_Groundtruth.dat": "99.9 1.0 1.0 0.0\n100.1 1.0 1.0 0.2\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(HEADER + text)
    return tmp_path


def test_folder_becomes_a_log(folder):
    log = load("auto", folder, robot=1, odometry_noise=OdometryNoise(0.1, 0, 0))
    np.testing.assert_allclose(log.time, [100, 100.5, 101, 101.5, 102])
    np.testing.assert_allclose(log.control, [[0.5, 0, 0]] * 4)
    np.testing.assert_allclose(log.control_covariance[:, 0, 0], 0.01 * 0.5)
    assert log.landmark.tolist() == [6]  # neither the robot nor the unknown barcode
    assert log.observation_pose.tolist() == [2]
    np.testing.assert_array_equal(log.observation, [[2.0, 0.5]])
    np.testing.assert_allclose(log.start, [1, 1, 0.1])
    assert log.landmark_truth.id.tolist() == [6, 7]
    np.testing.assert_allclose(log.landmark_truth.covariance[0], np.diag([1e-6, 4e-6]))
    assert len(log.truth) == 2


def test_stale_first_sample_is_left_out(folder):
    before = load("mrclam", folder, robot=1)
    path = folder / "Robot1_Odometry.dat"
    path.write_text("100.1 0.5 3.0\n" + path.read_text())
    np.testing.assert_array_equal(load("mrclam", folder, robot=1).control, before.control)


@pytest.fixture(scope="module")
def set_six(shared):
    return shared / "data/logs/mrclam/mrclam6.npz"


@pytest.fixture(scope="module")
def five(set_six):
    """The robots of set 6, as the default configuration has them."""
    logs = [load("mrclam", set_six, robot=robot) for robot in range(1, 6)]
    return [(log, slam.run(log)) for log in logs]


@pytest.mark.shared
def test_rmse_of_five_robots_of_one_configuration(five):
    position = [position_rmse(result.trajectory, log.truth) for log, result in five]
    drift = [position_rmse(result.dead_reckoning, log.truth) for log, result in five]
    landmark = [landmark_rmse(result.map, log.landmark_truth) for log, result in five]
    for name, rmse in (("position", position), ("landmark", landmark), ("odometry", drift)):
        print(f"\nMRCLAM 6, {name}: {np.mean(rmse):.3f} m, {np.round(rmse, 3).tolist()}", end="")
    assert np.mean(position) <= 0.18
    assert np.mean(landmark) <= 0.07
    assert all(p < 0.4 * d for p, d in zip(position, drift, strict=True))
    assert all(len(result.map) == 15 for _, result in five)
    assert all(np.isfinite(result.trajectory.covariance).all() for _, result in five)


@pytest.mark.shared
def test_what_a_platform_says_of_its_ranges_is_what_the_survey_says(set_six):
    """Against the truth: the ranges as logged are off by several per cent, as read by one."""

    def error(platform):
        log = load_mrclam(set_six, 2, platform=platform)
        at = log.time[log.observation_pose]
        heading = np.interp(at, log.truth.time, np.unwrap(log.truth.pose[:, 2]))
        xy = [np.interp(at, log.truth.time, log.truth.pose[:, i]) for i in range(2)]
        there = log.landmark_truth.xy[np.searchsorted(log.landmark_truth.id, log.landmark)]
        z = [observe(p, m)[0] for p, m in zip(np.transpose([*xy, heading]), there, strict=True)]
        return np.median(np.abs(log.observation[:, 0] / np.array(z)[:, 0] - 1))

    assert error(UTIAS) < 0.02
    assert error(Platform()) > 0.04
