"""The camera record and its lens models, and poses in space."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from saccade.errors import ConfigError
from saccade.frames import LENSES, Camera, Poses, directions

COEFFICIENTS = {
    "pinhole": (-0.28, 0.07, 0.0002, 0.00002, 0.001),
    "fisheye": (-0.01, 0.004, -0.003, 0.0006),
}
POINTS = np.random.default_rng(3).uniform((-2, -1.5, 3), (2, 1.5, 6), (200, 3))


def camera_with(lens):
    return Camera(640, 480, 458.0, 457.0, 320.5, 239.5, lens=lens, distortion=COEFFICIENTS[lens])


def distorted(lens, x, y):
    """Normalized image coordinates by the published formula of the lens model."""
    r = np.hypot(x, y)
    if lens == "fisheye":
        k1, k2, k3, k4 = COEFFICIENTS[lens]
        theta = np.arctan(r)
        scale = theta * (1 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8) / r
        return x * scale, y * scale
    k1, k2, p1, p2, k3 = COEFFICIENTS[lens]
    radial = 1 + k1 * r**2 + k2 * r**4 + k3 * r**6
    return (
        x * radial + 2 * p1 * x * y + p2 * (r**2 + 2 * x**2),
        y * radial + p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y,
    )


@pytest.mark.parametrize("lens", LENSES)
def test_every_lens_projects_by_its_formula_and_back(lens):
    camera = camera_with(lens)
    x, y = POINTS[:, 0] / POINTS[:, 2], POINTS[:, 1] / POINTS[:, 2]
    expected = np.stack(distorted(lens, x, y), 1) * (458, 457) + (320.5, 239.5)
    xy = camera.project(POINTS)
    np.testing.assert_allclose(xy, expected, atol=1e-9)
    rays = directions(camera.undistorted, camera.undistort(xy))
    np.testing.assert_allclose(rays[:, :2], np.stack([x, y], 1), atol=1e-7)
    assert np.isnan(camera.project(-POINTS)).all()


@pytest.mark.parametrize("lens", LENSES)
def test_maps_agree_with_opencv(lens):
    camera = camera_with(lens)
    make = cv2.fisheye.initUndistortRectifyMap if lens == "fisheye" else cv2.initUndistortRectifyMap
    K, rotation = camera.matrix, Rotation.from_euler("xyz", (0.01, -0.02, 0.005)).as_matrix()
    expected = make(K, np.array(camera.distortion), rotation, K, (640, 480), cv2.CV_32FC1)
    maps = camera.maps_to(camera.undistorted, rotation.T)
    np.testing.assert_allclose(maps, expected, atol=1e-3)


def test_pixels_outside_the_field_of_a_lens_are_unknown():
    camera = Camera(640, 480, 300, 300, 320, 240, distortion=(-0.28, 0.0, 0.0, 0.0))
    xy = np.array([[320 + 300 * 0.72, 240.0], [639.0, 240.0]])  # r - 0.28 r^3 is below 0.728
    assert np.isnan(camera.undistort(xy)).tolist() == [[False, False], [True, True]]


@pytest.mark.parametrize(
    ("lens", "distortion"), [("fisheye", ()), ("pinhole", (0.1,)), ("omni", (0.1,) * 4)]
)
def test_coefficients_fit_the_lens(lens, distortion):
    with pytest.raises(ConfigError, match="pinhole" if lens == "omni" else "coefficients"):
        Camera(640, 480, 458, 457, 320, 240, lens=lens, distortion=distortion)


def test_poses_interpolate_and_compose_as_scipy_does():
    rng = np.random.default_rng(1)
    turns = Rotation.random(5, rng=rng)
    poses = Poses(np.arange(5.0), turns.as_matrix(), rng.normal(size=(5, 3)))
    time = np.array([0.0, 0.25, 3.9])
    between = poses.interpolate(time)
    np.testing.assert_allclose(
        between.rotation, Slerp(range(5), turns)(time).as_matrix(), atol=1e-12
    )
    np.testing.assert_allclose(between.position[1], poses.position[:2].T @ (0.75, 0.25))
    nothing = poses.inverse @ poses
    np.testing.assert_allclose(nothing.rotation, np.tile(np.eye(3), (5, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(nothing.position, 0, atol=1e-12)
