"""Egomotion: geometry against finite differences and known motions."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

from saccade import visual
from saccade.evaluation.trajectory import score_drive
from saccade.frames import AHEAD, Camera
from saccade.visual.camera import from_pixels, observe, observe_bearings, range_bearing, to_pixels
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import correspondences_of, estimate_motion
from saccade.visual.ground_scale import GroundTracker
from saccade.visual.points import TrackedPoints
from saccade.visual.robot_motion import camera_motion
from saccade.visual.single_camera import CameraTrajectory
from support.winding_drive import winding

TILTED = np.array(
    [[1.0, 0.0, 0.0], [0.0, np.cos(0.1), -np.sin(0.1)], [0.0, np.sin(0.1), np.cos(0.1)]]
)
CAMERA = Camera(640, 360, 500, 500, 320, 180, 0.5, np.array([1.1, -0.3, 1.6]), AHEAD @ TILTED)
CONTROL = np.array([1.2, 0.05, 0.08])


def scene(rng, k=80):
    """Points in view before and after `CONTROL`: pixels and depths of both."""
    xy = rng.uniform((20, 20), (620, 340), (k, 2))
    depth = rng.uniform(4, 60, k)
    R, t = camera_motion(CAMERA, CONTROL)
    before = from_pixels(CAMERA, xy, depth)
    c, s = np.cos(CONTROL[2]), np.sin(CONTROL[2])
    turned = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    now, deep = to_pixels(CAMERA, (before - np.append(CONTROL[:2], 0)) @ turned.T)
    return xy, depth, now, deep, R, t


def test_the_covariance_of_an_observation_is_that_of_many_draws():
    rng = np.random.default_rng(1)
    xy, depth = np.array([[100.0, 250.0]]), np.array([12.0])
    config = VisualConfig(pixel_sigma=0.5)
    seen = range_bearing(CAMERA, xy, depth, np.array([0.2]), config, tilt=0.0)
    drawn = from_pixels(
        CAMERA,
        xy + 0.5 * rng.standard_normal((200000, 2)),
        depth + 0.2 * rng.standard_normal(200000),
    )
    z = np.stack([np.hypot(*drawn[:, :2].T), np.arctan2(drawn[:, 1], drawn[:, 0])])
    assert_allclose(seen.covariance[0], np.cov(z), rtol=0.02, atol=2e-6)


def test_tilt_displaces_points_above_the_camera(rng):
    place, tilt = np.array([12.0, -5.0, 4.0]), 0.02
    xy, depth = to_pixels(CAMERA, place[None])
    point = TrackedPoints.zeros(1, xy=xy, depth=depth)
    level, _ = observe(CAMERA, point, VisualConfig(pixel_sigma=1e-6), tilt)
    lean = tilt * rng.standard_normal((100000, 2))
    up = place[2] - CAMERA.position[2]  # about the camera; the lever of the robot's origin is small
    moved = place + np.stack([lean[:, 0] * up, lean[:, 1] * up, 0 * lean[:, 0]], 1)
    z = np.stack([np.hypot(*moved[:, :2].T), np.arctan2(moved[:, 1], moved[:, 0])])
    assert_allclose(np.diagonal(level.covariance[0]), np.diagonal(np.cov(z)), rtol=0.02)


@pytest.mark.nightly
def test_a_rocking_robot_knows_that_its_map_is_flat():
    level, rocking = (winding(tilt=np.deg2rad(each)).until(60) for each in (0, 10))
    every = VisualConfig(detect_interval=1)
    calm, shaken = visual.run(level, every), visual.run(rocking, every)
    assert not calm.remarks
    assert len(shaken.remarks) == 1
    assert re.search(r"pitches and rolls by [67]\.\d deg, but the map is flat", shaken.remarks[0])
    assert np.median(shaken.observations.sigma[:, 1]) > 2 * np.median(calm.observations.sigma[:, 1])
    assert score_drive(shaken.trajectory, rocking.truth).inside_3sigma > 0.95


def test_a_bearing_only_observation_lies_on_the_ray():
    xy = np.array([[100.0, 250.0], [500.0, 90.0]], np.float32)
    points, ranges = TrackedPoints.zeros(2, xy=xy), np.array([8.0, 30.0])
    seen = observe_bearings(CAMERA, points, ranges, VisualConfig(), 0.01)
    place = np.stack(
        [
            seen.z[:, 0] * np.cos(seen.z[:, 1]),
            seen.z[:, 0] * np.sin(seen.z[:, 1]),
            seen.height,
        ],
        1,
    )
    assert_allclose(seen.z[:, 0], (8.0, 30.0))
    assert_allclose(to_pixels(CAMERA, place)[0], xy, atol=1e-4)


@pytest.mark.parametrize("wrong", [0, 15])
def test_a_stereo_rig_determines_the_motion(wrong):
    rng = np.random.default_rng(2)
    xy, depth, now, deep, R, _ = scene(rng)
    now[:wrong] += rng.uniform(15, 40, (wrong, 2))
    inside = np.isfinite(now).all(1)
    points = correspondences_of(
        *(a[inside] for a in (xy, now, depth, 0.01 * depth, deep, 0.01 * deep))
    )
    motion = estimate_motion(CAMERA, points, 0.3, prior=None)
    assert motion is not None
    assert_allclose(motion.control, CONTROL, atol=2e-4 if wrong else 1e-6)
    assert_allclose(motion.rotation @ R.T, np.eye(3), atol=1e-4)
    assert not motion.inliers[:wrong].any()
    assert motion.inliers[wrong:].mean() > 0.95


def test_one_camera_determines_the_turn_and_odometry_the_distance():
    rng = np.random.default_rng(3)
    xy, _, now, _, _, _ = scene(rng)
    unknown = np.full(len(xy), np.nan)
    points = correspondences_of(xy, now, unknown, unknown, unknown, unknown)
    prior = CONTROL + np.array([0.03, 0.0, 0.02]), np.diag(np.square([0.06, 0.02, 0.02]))
    motion = estimate_motion(CAMERA, points, 0.3, prior)
    assert motion is not None
    assert abs(motion.control[2] - CONTROL[2]) < 1e-3
    sigma = np.sqrt(motion.covariance[0, 0])
    assert 0.03 < sigma < 0.061
    assert abs(motion.control[0] - CONTROL[0]) < 2 * sigma


def test_the_covariance_of_a_motion_is_that_of_many_draws():
    rng = np.random.default_rng(4)
    xy, depth, now, deep, _, _ = scene(rng)
    missed, sigma = [], 0.02 * depth
    for _ in range(100):
        points = correspondences_of(
            xy + 0.3 * rng.standard_normal(xy.shape),
            now + 0.3 * rng.standard_normal(xy.shape),
            depth + sigma * rng.standard_normal(len(depth)),
            sigma,
            np.full(len(deep), np.nan),
            sigma,
        )
        motion = estimate_motion(CAMERA, points, 0.3, prior=None)
        missed.append(motion.control - CONTROL)
    ratio = np.std(missed, 0) / np.sqrt(np.diag(motion.covariance))
    assert (ratio > 0.6).all()
    assert (ratio < 1.4).all()


def test_rays_intersect_at_the_point():
    rng = np.random.default_rng(6)
    xy, _, now, deep, R, t = scene(rng)
    way = CameraTrajectory()
    way.append(R, t)
    ends = {"first_xy": xy.astype(np.float32), "xy": now.astype(np.float32)}
    points = TrackedPoints.zeros(len(xy), **ends)
    found, sigma = way.triangulate(CAMERA, points, 0.3)
    sure = sigma < 0.1 * deep
    assert sure.sum() > 20
    assert_allclose(found[sure], deep[sure], rtol=2e-3)


def test_the_ground_plane_determines_the_distance():
    rng = np.random.default_rng(7)
    camera = Camera(640, 360, 500, 500, 320, 120, position=np.array([0, 0, 1.5]))
    texture = rng.uniform(0, 255, (400, 400))
    R, t = camera_motion(camera, CONTROL)

    def seen(rotation, shift):
        """The ground of a camera that has moved: points of the first camera's frame become RX+t."""
        v, u = np.mgrid[:360, :640]
        ray = np.stack([(u - 320) / 500, (v - 120) / 500, np.ones(u.shape)], -1) @ rotation
        origin = -rotation.T @ shift
        far = (1.5 - origin[1]) / np.where(ray[..., 1] > 0.01, ray[..., 1], np.nan)
        x, z = origin[0] + far * ray[..., 0], origin[2] + far * ray[..., 2]
        rough = sum(
            np.sin(a * np.nan_to_num(x) + b * np.nan_to_num(z) + c)
            for a, b, c in zip(*texture[:3, :20] / 60, strict=True)
        )
        return (128 + 6 * rough).clip(0, 255).astype(np.uint8)

    unknown = np.full(20, np.nan)
    points = correspondences_of(np.zeros((20, 2)), np.zeros((20, 2)), *(unknown,) * 4)
    prior = CONTROL * (1.1, 1.1, 1), 1e-9 * np.eye(3)
    motion = estimate_motion(camera, points, 1e3, prior)
    assert motion is not None
    motion = motion._replace(rotation=R, translation=1.1 * t)
    distance = GroundTracker(camera).distance(seen(np.eye(3), np.zeros(3)), seen(R, t), motion)
    assert distance == pytest.approx(np.linalg.norm(t), rel=0.02)
