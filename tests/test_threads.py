"""Results do not depend on the number of threads of BLAS, which belongs to the process."""

import copy
from threading import Barrier, Thread

import cv2
import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from saccade import slam, visual
from saccade.simulation import DriveConfig, WorldConfig, simulate_drive, simulate_world
from saccade.threads import SERIAL_OPENCV
from support.logs import between


def _smoothed():
    result = slam.run(simulate_world(WorldConfig(landmarks=150, steps=150), 3))
    assert result.estimate == "smoothed"
    poses = result.trajectory
    return poses.pose, poses.covariance, result.map.xy, result.map.covariance


@pytest.fixture(scope="module")
def maps():
    world = WorldConfig(landmarks=120, landmark_spread=8, steps=200, range_limits=(0.5, 8.0))
    log, robots = simulate_world(world, 0), []
    for first, last in ((0, 140), (60, 200)):
        part = between(log, first, last)
        robots.append(slam.slam_for(part))
        slam.run(part, initial=robots[-1])
    return robots


def _merged(maps):
    merged = slam.merge_maps(*copy.deepcopy(maps))
    return merged.transform, merged.slam.map.xy, merged.slam.map.covariance


def _driven():
    result = visual.run(simulate_drive(DriveConfig(frames=12, image_size=(160, 120)), 1))
    return result.trajectory.pose, result.trajectory.covariance, result.map.covariance


@pytest.mark.parametrize("kind", ["a log", "two maps", "a drive"])
def test_threads_of_blas_change_no_bit(kind, maps):
    work = {"a log": _smoothed, "two maps": lambda: _merged(maps), "a drive": _driven}[kind]
    by_threads = []
    for threads in (1, 2):
        with threadpool_limits(threads, user_api="blas"):
            by_threads.append(work())
    for one, two in zip(*by_threads, strict=True):
        np.testing.assert_array_equal(one, two)


def test_the_last_of_overlapping_contexts_restores_the_threads():
    before, turns, seen = cv2.getNumThreads(), Barrier(2), []

    def overlapping():
        with SERIAL_OPENCV:
            turns.wait()
            turns.wait()
            seen.append(cv2.getNumThreads())

    cv2.setNumThreads(2)
    try:
        other = Thread(target=overlapping)
        with SERIAL_OPENCV:
            other.start()
            turns.wait()
        turns.wait()
        other.join()
        assert seen == [1]
        assert cv2.getNumThreads() == 2
    finally:
        cv2.setNumThreads(before)
