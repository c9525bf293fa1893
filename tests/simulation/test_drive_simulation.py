"""Simulated camera drives: the pinhole model to the pixel, the truth, and what the dials do."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest

from saccade.keypoints.sift import Sift
from saccade.keypoints.sift_config import SiftConfig
from saccade.simulation import DriveConfig, LightConfig, OdometryConfig, simulate_drive
from saccade.simulation.drive import motion_blur, render
from saccade.simulation.scene import Ground, Walls, build_scene
from support.biased_odometry import unbiased
from support.odometry_alone import followed

TEXELS = 180.0
CELL = 36
"""Texels of a square of the checkerboard."""
STILL = LightConfig(noise_sigma=0.0, gain_sigma=0.0, gamma_sigma=0.0, vignetting=0.0)
SMALL = DriveConfig(
    size=(4.5, 4.0),
    corridor=1.4,
    wall_height=1.6,
    turning_radius=0.9,
    sway=0.06,
    frames=4,
    frames_per_lap=90,
    image_size=(64, 48),
)


@pytest.fixture(scope="module")
def board():
    """A room of 4 x 4 m about the origin whose walls are checkerboards, and the corners' places."""
    corners = np.array([[-2.0, 2], [2, 2], [2, -2], [-2, -2], [-2, 2]])
    shape = (int(2.4 * TEXELS), int(16 * TEXELS))
    y, x = np.indices(shape)
    white = ((x // CELL + y // CELL) % 2).astype(np.uint8)
    texture = np.repeat(40 + 170 * white[..., None], 3, 2)
    ground = Ground(np.array([-2.0, 2]), np.full((64, 64, 3), 128, np.uint8), 16.0)
    scene = build_scene([Walls(corners, texture)], ground, 2.4, TEXELS, color=False)
    along, up = np.meshgrid(np.arange(1, 20), np.arange(1, 12))  # the first wall, y = 2
    points = [along * CELL / TEXELS - 2, np.full(along.shape, 2.0), 2.4 - up * CELL / TEXELS]
    return scene, np.stack([each.ravel() for each in points], 1)


def project(camera, pose, points, right=False):
    """Pixels (k, 2) and depths (k,) of points (k, 3) of the world."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    robot = (points - [pose[0], pose[1], 0]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    seen = (robot - camera.position) @ camera.rotation - [camera.baseline * right, 0, 0]
    x, y, z = seen.T
    return np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], 1), z


def analytic(camera, pose, left, top, side, samples=24):
    """A square of the image of the board's first wall: many samples in each pixel."""
    x, y = ((np.arange(side * samples) + 0.5) / samples - 0.5 + first for first in (left, top))
    c, s = np.cos(pose[2]), np.sin(pose[2])
    eye = pose[:2] + np.array([[c, -s], [s, c]]) @ camera.position[:2]
    aside = (x - camera.cx) / camera.fx
    depth = (2 - eye[1]) / (s - c * aside)
    along = eye[0] + depth * (c + s * aside)
    cell = TEXELS / CELL
    up = (2.4 - camera.position[2] + np.outer((y - camera.cy) / camera.fy, depth)) * cell
    white = (np.floor((along + 2) * cell) + np.floor(up)) % 2
    return 40 + 170 * white.reshape(side, samples, side, samples).mean((1, 3))


def shift_between(image, model, near=np.s_[:]):
    """(2,) pixels right and down by which `image` is off `model`, by least squares."""
    slope = np.stack(np.gradient((image + model) / 2)[::-1], -1)[near].reshape(-1, 2)
    return np.linalg.lstsq(slope, (model - image)[near].ravel())[0]


@pytest.mark.parametrize("pose", [(0, 0, 90), (0.3, 0.4, 70), (0.9, -0.2, 131)])
def test_a_board_is_where_a_pinhole_puts_it(board, pose):
    scene, points = board
    pose = np.array([pose[0], pose[1], np.deg2rad(pose[2])])
    camera = replace(DriveConfig().camera, position=np.array([0.1, 0.05, 0.7]))
    left, top, side = 90, 60, 120
    ours = render(scene, camera, pose)[top : top + side, left : left + side].astype(float)
    exact = analytic(camera, pose, left, top, side)
    xy = project(camera, pose, points)[0] - (left, top)
    xy = xy[((xy > 8) & (xy < side - 8)).all(1)]
    assert len(xy) >= 12
    for x, y in np.rint(xy).astype(int):
        near = np.s_[y - 5 : y + 6, x - 5 : x + 6]
        assert np.abs(shift_between(ours, exact, near)).max() < 0.05


def test_two_views_agree_where_depth_and_poses_say():
    drive = simulate_drive(replace(SMALL, light=STILL, depth=True, image_size=(160, 120)))
    camera, first, second = drive.camera, drive.load(0), drive.load(1)
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    z = np.nan_to_num(first.depth, nan=1.0)
    seen = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], -1)
    robot = (
        seen.reshape(-1, 3) @ camera.rotation.T + camera.position
    )  # the first pose is the origin
    for image, pose, right in ((first.right, 0, True), (second.image, 1, False)):
        xy, _ = project(camera, drive.truth.pose[pose], robot, right)
        x, y = xy.T.reshape(2, *z.shape).astype(np.float32)
        warped = cv2.remap(image.astype(np.float32), x, y, cv2.INTER_CUBIC)
        both = np.isfinite(first.depth) & (np.abs(x - 79.5) < 76) & (np.abs(y - 59.5) < 56)
        apart = warped - first.image
        assert both.mean() > 0.6
        assert np.median(np.abs(apart[both])) < 0.1 * first.image[both].std()
        both &= np.abs(apart) < 25  # one eye sees behind a corner, the other does not
        assert np.abs(shift_between(warped, first.image.astype(float), both)).max() < 0.03


def test_odometry_without_errors_is_the_truth():
    exact = OdometryConfig(
        scale_percent=0, heading_drift_deg=0, distance_percent=0, heading_sigma_deg=0
    )
    drive = simulate_drive(replace(SMALL, frames=200, odometry=exact))
    np.testing.assert_allclose(followed(drive.start, drive.control), drive.truth.pose, atol=1e-9)
    np.testing.assert_array_equal(drive.truth.pose[0], 0)
    width = SMALL.size[0] - SMALL.corridor  # of the center line
    assert np.ptp(drive.truth.pose[:, 0]) == pytest.approx(width, abs=2 * SMALL.sway)
    steps = np.hypot(*np.diff(drive.truth.pose[:, :2], axis=0).T)
    assert steps.max() < 1.15 * steps.min()
    ahead, aside, _ = drive.control.T
    assert np.abs(aside).max() < 0.2 * ahead.min()  # it looks where it goes
    lap = SMALL.frames_per_lap
    again = np.hypot(*(drive.truth.pose[lap:] - drive.truth.pose[:-lap])[:, :2].T)
    assert 0.01 < again.max() < 2 * SMALL.sway  # two laps of one ring, not quite the same


def test_the_errors_of_odometry_are_those_it_tells():
    config = replace(SMALL, frames=1000)
    exact = OdometryConfig(
        scale_percent=0, heading_drift_deg=0, distance_percent=0, heading_sigma_deg=0
    )
    true = simulate_drive(replace(config, odometry=exact), 3).control
    drive = simulate_drive(
        replace(config, odometry=replace(exact, distance_percent=5, heading_sigma_deg=1)), 3
    )
    square = np.einsum(
        "ki,kij,kj->k",
        drive.control - true,
        np.linalg.inv(drive.control_covariance),
        drive.control - true,
    )
    assert square.mean() == pytest.approx(3, abs=5 * np.sqrt(6 / len(true)))
    drive = simulate_drive(
        replace(config, odometry=replace(exact, scale_percent=3, heading_drift_deg=1.5)), 3
    )
    signs = [np.array([a, b, 0]) for a in (-1, 1) for b in (-1, 1)]
    mended = [unbiased(drive.control, sign * drive.odometry_bias) for sign in signs]
    assert min(np.abs(each - true).max() for each in mended) < 1e-12


def test_frames_are_the_same_in_any_order_and_thread():
    config = replace(SMALL, light=LightConfig(flicker_sigma=0.2), color=True)
    one, same, other = (simulate_drive(config, seed) for seed in (1, 1, 2))
    with ThreadPoolExecutor(4) as pool:
        backwards = list(pool.map(same.load, reversed(range(4))))[::-1]
    for i, frame in enumerate(backwards):
        np.testing.assert_array_equal(one.load(i).image, frame.image)
        np.testing.assert_array_equal(one.load(i).right, frame.right)
        assert frame.image.shape == (48, 64, 3)
        assert frame.image.dtype == np.uint8
    assert (one.load(0).image != other.load(0).image).mean() > 0.5
    with pytest.raises(IndexError):
        one.load(4)


@pytest.mark.parametrize("blocks", [0, 1, 2])
def test_a_hall_is_blank_but_for_its_posters_and_one_group_is_in_view_at_the_start(blocks):
    hall = replace(DriveConfig.hall(), blocks=blocks, poster_groups=1, light=STILL)
    drive = simulate_drive(hall, blocks)
    points = Sift(SiftConfig(max_keypoints=30, ranking="response"))(drive.load(0).image)
    half = 1.5 * hall.poster_spacing / (hall.size[0] / 2) * drive.camera.fx
    assert np.abs(points.xy[:, 0] - drive.camera.cx).max() < half + 8
    position = np.abs(drive.truth.pose[:, :2] - [0, (hall.size[1] - hall.corridor) / 2])
    assert (position.max(0) < (np.array(hall.size) - hall.corridor) / 2 + hall.sway).all()


@pytest.mark.parametrize("width", [0.0, 3.0, 4.6])
def test_a_blurred_edge_is_a_ramp_of_the_width_of_the_motion(width):
    edge = np.where(np.arange(40) < 20, 0, 240).astype(np.uint8) * np.ones((5, 1), np.uint8)
    blurred = motion_blur(edge, width)[2].astype(float)
    x = np.arange(40) + 0.5
    expected = 240 * np.clip((x - 20) / max(width, 1e-9) + 0.5, 0, 1)
    assert np.abs(blurred - expected).max() < (24 if width else 1)
    assert blurred.sum() == pytest.approx(edge[0].sum(), abs=5)
