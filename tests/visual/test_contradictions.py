"""Images that contradict odometry, and single cameras that have neither scale nor motion."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from saccade import visual
from saccade.datasets.drives.folder import assume_speed
from saccade.evaluation.trajectory import score_drive
from saccade.frames import AHEAD, Camera, Drive, Frame
from saccade.types import Trajectory
from saccade.visual.camera import from_pixels, to_pixels
from saccade.visual.contradictions import StepSource, choose_motion
from saccade.visual.egomotion import correspondences_of
from saccade.visual.unscaled_camera import ScaleDrift, camera_rotation

CAMERA = Camera(640, 480, 450, 450, 320, 240, 0.3, np.array([0.0, 0.0, 1.0]), AHEAD)
STEP = np.array([0.3, 0.0, 0.02])
ODOMETRY = STEP * 1.02, np.diag(np.square([0.01, 0.005, 0.003]))
STANDING = np.zeros(3)


def pixels_after(control, points):
    """Pixels and depths of points (k, 3) in the robot's frame after a control (3,)."""
    moved = Rotation.from_rotvec([0, 0, -control[2]]).apply(points - [*control[:2], 0])
    return to_pixels(CAMERA, moved)


def seen(rng, object_width, world=STEP):
    """Correspondences of points in the world and of an object that moves along with the robot."""
    xy = rng.uniform((10, 10), (630, 470), (240, 2))
    is_object = np.abs(xy[:, 0] - 320) < object_width / 2
    depth = np.where(is_object, 3.0, rng.uniform(4, 25, len(xy)))
    points = from_pixels(CAMERA, xy, depth)
    now, deep = pixels_after(world, points)
    still, near = pixels_after(STANDING, points)
    now = np.where(is_object[:, None], still, now) + rng.normal(0, 0.3, now.shape)
    deep = np.where(is_object, near, deep)
    sigma = depth**2 * 0.4 / (CAMERA.fx * CAMERA.baseline)
    return correspondences_of(xy, now, depth, sigma, deep, sigma), is_object


@pytest.mark.parametrize("width", [280, 420, 520])
def test_an_object_that_moves_along_does_not_determine_the_motion(rng, width):
    points, is_object = seen(rng, width)
    motion, source = choose_motion(CAMERA, points, 0.5, None, ODOMETRY)
    assert source == (StepSource.PART if width > 300 else source)
    assert np.abs(motion.control - STEP).max() < 0.02
    assert motion.inliers[is_object].mean() < 0.5
    if width > 400:  # nothing but odometry says so
        motion, source = choose_motion(CAMERA, points, 0.5, None, None)
        assert source == StepSource.CAMERA
        assert np.abs(motion.control).max() < 0.02


def test_images_that_agree_everywhere_overrule_wheels_that_slip(rng):
    points, _ = seen(rng, 0, world=STANDING)
    motion, source = choose_motion(CAMERA, points, 0.5, None, ODOMETRY)
    assert source == StepSource.CONTRADICTED
    assert np.abs(motion.control).max() < 0.02
    after_objects = choose_motion(CAMERA, points, 0.5, None, ODOMETRY, objects_seen=True)
    assert after_objects == (None, StepSource.REJECTED)


def test_a_turn_in_place_has_no_parallax(rng):
    xy = rng.uniform((10, 10), (630, 470), (100, 2))
    R = Rotation.from_rotvec([0.01, -0.06, 0.02]).as_matrix()
    ray = np.column_stack([(xy - [CAMERA.cx, CAMERA.cy]) / CAMERA.fx, np.ones(len(xy))]) @ R.T
    now = ray[:, :2] / ray[:, 2:] * CAMERA.fx + [CAMERA.cx, CAMERA.cy]
    now[:30] += rng.uniform(-40, 40, (30, 2))
    found, parallax = camera_rotation(CAMERA, xy.astype(np.float32), now.astype(np.float32))
    assert_allclose(found, R, atol=2e-4)
    assert parallax < 0.1


def test_the_covariance_by_a_drifting_scale_is_that_of_many_draws(rng):
    steps = np.column_stack([np.full(30, 0.5), np.zeros(30), np.full(30, 0.05)])
    drift, heading = ScaleDrift(np.zeros(3)), np.cumsum(steps[:, 2]) - steps[:, 2]
    for step in steps:
        drift.add_error(0.03)
        drift.add(step)
    scale = np.cumsum(0.03 * rng.standard_normal((20_000, 30)), 1)
    moved = steps[:, :1] * np.stack([np.cos(heading), np.sin(heading)], 1)
    assert_allclose(drift.covariance[:2, :2], np.cov((scale @ moved).T), rtol=0.05, atol=1e-3)
    assert drift.variance == pytest.approx(30 * 0.03**2)


@pytest.mark.parametrize("has_odometry", [True, False])
def test_a_camera_that_stands_stays_where_it_is(rng, has_odometry):
    wall = (
        rng.integers(0, 255, (120, 160), np.uint8)
        .repeat(4, 0)
        .repeat(4, 1)
        .astype(float)[:480, :640]
    )
    n = 16

    def load(i):
        noise = np.random.default_rng(i).normal(0, 2, wall.shape)
        return Frame(i / 10, (wall + noise).clip(0, 255).astype(np.uint8))

    covariance = np.tile(1e-6 * np.eye(3), (n - 1, 1, 1))
    camera, time = replace(CAMERA, baseline=0.0), np.arange(n) / 10
    truth = Trajectory(time, np.zeros((n, 3)))
    stood = Drive("stands", camera, time, np.zeros((n - 1, 3)), covariance, load, truth=truth)
    drive = stood if has_odometry else assume_speed(replace(stood, has_odometry=False))
    result = visual.run(drive)
    assert np.abs(result.trajectory.pose).max() < 0.01
    assert len(result.map) == 0
    assert has_odometry or (result.sources[1:] == StepSource.STILL).all()
    assert score_drive(result.trajectory, truth, scale_known=has_odometry).ate_m < 0.01
