"""Simulated camera drives: the pinhole model to the pixel, the truth, and what the dials do."""

from dataclasses import replace

import numpy as np
import pytest

from saccade.simulation import DriveConfig, LightConfig
from saccade.simulation.rendering import render
from saccade.simulation.scene import Ground, Walls, build_scene

TEXELS = 180.0
CELL = 36
"""Texels of a square of the checkerboard."""
STILL = LightConfig(noise=0.0, gain=0.0, gamma=0.0, vignetting=0.0)
SMALL = DriveConfig(frames=4, image_size=(64, 48))


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
    seen = (robot - camera.place) @ camera.rotation - [camera.baseline * right, 0, 0]
    x, y, z = seen.T
    return np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], 1), z


def analytic(camera, pose, samples=40):
    """The image of the board's first wall, and where the wall is: many samples in each pixel."""
    x, y = (
        (np.arange(side * samples) + 0.5) / samples - 0.5 for side in (camera.width, camera.height)
    )
    c, s = np.cos(pose[2]), np.sin(pose[2])
    eye = pose[:2] + np.array([[c, -s], [s, c]]) @ camera.place[:2]
    aside = (x - camera.cx) / camera.fx
    depth = (2 - eye[1]) / (s - c * aside)
    along = eye[0] + depth * (c + s * aside)
    cell = TEXELS / CELL
    up = (2.4 - camera.place[2] + np.outer((y - camera.cy) / camera.fy, depth)) * cell
    white = (np.floor((along + 2) * cell) + np.floor(up)) % 2
    shape = (camera.height, samples, camera.width, samples)
    return 40 + 170 * white.reshape(shape).mean((1, 3))


@pytest.mark.parametrize("pose", [(0, 0, 90), (0.3, 0.4, 70), (-0.5, -1.1, 112), (0.9, -0.2, 131)])
def test_a_board_is_where_a_pinhole_puts_it(board, pose):
    scene, points = board
    pose = np.array([pose[0], pose[1], np.deg2rad(pose[2])])
    camera = replace(DriveConfig().camera, place=np.array([0.1, 0.05, 0.7]))
    xy, depth = project(camera, pose, points)
    seen = ((xy > 10) & (xy < (camera.width - 10, camera.height - 10))).all(1) & (depth > 0)
    assert seen.sum() > 30
    ours, exact = render(scene, camera, pose).astype(float), analytic(camera, pose)
    slope = np.stack(np.gradient((ours + exact) / 2)[::-1], -1)
    for x, y in np.rint(xy[seen]).astype(int):
        near = np.s_[y - 6 : y + 7, x - 6 : x + 7]
        shift = np.linalg.lstsq(slope[near].reshape(-1, 2), (exact - ours)[near].ravel())[0]
        assert np.abs(shift).max() < 0.06
