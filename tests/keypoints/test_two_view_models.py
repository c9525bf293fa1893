"""The model of two views, two calibrated cameras, and the points in space of matches."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from saccade import ImageWarning, Keypoints, match, triangulate, verify
from saccade.frames import Camera
from saccade.keypoints.relative_pose import decomposed, difference
from saccade.keypoints.two_view_models import TurningCamera, gric

K1 = np.array([[800.0, 0, 640], [0, 800, 360], [0, 0, 1]])
K2 = np.array([[500.0, 0, 330], [0, 520, 250], [0, 0, 1]])
LENS = (-0.2, 0.05, 1e-3, -5e-4)
R = cv2.Rodrigues(np.array([0.02, -0.1, 0.01]))[0]
T = np.array([0.96, 0.0, 0.28])
COUNT = 200
PAIRS = np.stack([np.arange(COUNT)] * 2, 1)


def points_in(rng, model):
    xyz = np.c_[rng.uniform(-3, 3, (COUNT, 2)) * [1, 0.6], rng.uniform(5, 10, COUNT)]
    if model == "planar":
        xyz[:, 2] = 7 + 0.3 * xyz[:, 0]
    return xyz


def pixels(xyz, camera, lens=(0, 0, 0, 0)):
    return cv2.projectPoints(xyz, np.zeros(3), np.zeros(3), camera, np.array(lens, float))[0][:, 0]


def two_views(rng, model, noise=0.3, wrong=0.0, cameras=(K1, K1), lenses=(None, None)):
    """Noisy keypoints of both images, some of them wrong, and the points in space."""
    xyz = points_in(rng, model)
    turn = np.eye(3) if model == "still" else R
    moved = xyz @ turn.T + (T if model in ("general", "planar") else 0)
    xy = [
        pixels(points, camera, lens or (0, 0, 0, 0)) + rng.normal(0, noise, (COUNT, 2))
        for points, camera, lens in zip((xyz, moved), cameras, lenses, strict=True)
    ]
    count = round(wrong * COUNT)
    xy[1][:count] = rng.uniform([0, 0], [1280, 720], (count, 2))
    return *(Keypoints.at(each, 3) for each in xy), xyz


def differences(function, count, step=1e-6):
    """(k, count) central differences of a function of a step (count,)."""
    ends = [function(step * unit) - function(-step * unit) for unit in np.eye(count)]
    return np.stack([each.ravel() for each in ends], 1) / (2 * step)


def test_derivatives_of_a_turning_camera_are_differences():
    camera = TurningCamera(np.array([0.2, 0.1, -0.05]), R, np.array([600.0, 350]), 1200)
    numeric = differences(lambda step: camera.moved(step).homography, 6)
    np.testing.assert_allclose(camera.derivatives().T, numeric, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("scale", [1.0, -2.5])
def test_derivatives_of_the_poses_of_a_plane_are_differences(scale):
    H = scale * (R + np.outer(T, [0.1, 0.3, 0.95]) / 5)

    def solutions(homography):
        middle = np.linalg.svd(homography)[1][1] * np.sign(np.linalg.det(homography))
        return decomposed(homography / middle)

    for pose in solutions(H):

        def nearest(step, pose=pose):
            gaps = [
                difference((each.R, each.direction), (pose.R, pose.direction))
                for each in solutions(H + step.reshape(3, 3))
            ]
            return min(gaps, key=np.linalg.norm)

        np.testing.assert_allclose(pose.derivatives(H), differences(nearest, 9), atol=1e-5)


@pytest.mark.parametrize("wrong", [0.0, 0.4])
@pytest.mark.parametrize("geometry", ["fundamental", "essential"])
@pytest.mark.parametrize("model", ["general", "planar", "panoramic", "still"])
def test_the_model_is_that_of_the_scene(rng, model, geometry, wrong):
    first, second, _ = two_views(rng, model, wrong=wrong)
    names = {"intrinsics": K1} if geometry == "essential" else {}
    found = verify(first, second, PAIRS, geometry, **names)
    assert found.model == model
    assert found.inliers[round(wrong * COUNT) :].mean() > 0.95
    if geometry == "fundamental":
        assert np.linalg.norm(found.F) == pytest.approx(1)
    elif model in ("general", "planar"):
        t = found.pose.translation
        cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
        np.testing.assert_allclose(found.E, cross @ found.pose.rotation, atol=1e-9)
    if (model, geometry) == ("planar", "essential"):
        assert found.inliers[: round(wrong * COUNT)].mean() < 0.05 if wrong else True
    if geometry == "essential" and model in ("panoramic", "still"):
        assert found.pose.direction_sigma == np.inf
        turn = np.eye(3) if model == "still" else R
        error = np.degrees(np.linalg.norm(cv2.Rodrigues(found.pose.rotation @ turn.T)[0]))
        assert error < 0.1


@pytest.mark.parametrize("model", ["general", "planar", "panoramic"])
def test_rotations_are_as_uncertain_as_they_say(rng, model):
    squared = []
    for _ in range(15):
        pose = verify(*two_views(rng, model)[:2], PAIRS, "essential", intrinsics=K1).pose
        error = cv2.Rodrigues(R @ pose.rotation.T)[0][:, 0]
        squared.append(error @ np.linalg.solve(pose.covariance[:3, :3], error))
    assert 0.5 < np.mean(squared) / 3 < 1.7  # .995 of chi-square with 45 degrees of freedom


def test_the_criterion_is_torrs():
    """GRIC = sum of min(e^2 / s^2, 2 (r - d)) + n d ln r + k ln (r n), by hand: r is 4."""
    squared = np.array([0.5, 1, 9])
    expected = 0.5 + 1 + 2 + 3 * 3 * np.log(4) + 7 * np.log(12)
    assert gric(squared, 3, 7) == pytest.approx(expected)
    assert gric(squared, 2, 8) == pytest.approx(5.5 + 6 * np.log(4) + 8 * np.log(12))


def test_unmoved_matches_in_a_corner_are_a_watermark(rng):
    corner, others = rng.uniform([20, 20], [160, 50], (60, 2)), rng.uniform(0, 600, (2, 300, 2))
    first, second = (Keypoints.at(np.r_[corner, each], 3) for each in others)
    found = verify(first, second, np.stack([np.arange(60)] * 2, 1))
    assert found.model == "watermark"
    # Of matches that are wrong, some agree with any fundamental matrix.
    some = [Keypoints.at(np.r_[corner[:25], each[:10], each], 3) for each in others]
    assert verify(*some, PAIRS[:35]).model == "watermark"
    along, side = rng.uniform(0, 600, (320, 2)), rng.integers(0, 2, 320)
    along[np.arange(320), side] = rng.choice([5, 595], 320) + rng.normal(0, 3, 320)
    frame = [Keypoints.at(np.r_[along, each], 3) for each in others]
    assert verify(*frame, np.stack([np.arange(320)] * 2, 1)).model == "watermark"
    spread = Keypoints.at(rng.uniform(0, 600, (100, 2)), 3)
    assert verify(spread, spread, np.stack([np.arange(100)] * 2, 1)).model == "still"


@pytest.mark.parametrize("wrong", [0, 12])
@pytest.mark.parametrize("geometry", ["fundamental", "essential"])
def test_a_plane_with_few_matches_is_a_plane(rng, geometry, wrong):
    """A general motion agrees with them too, with a direction that is certain and wrong."""
    names = {"intrinsics": K1} if geometry == "essential" else {}
    index = PAIRS[COUNT - 40 - wrong :]
    models = []
    for _ in range(10):
        first, second, _ = two_views(rng, "planar")
        second.xy[COUNT - 40 - wrong : COUNT - 40] = rng.uniform([0, 0], [1280, 720], (wrong, 2))
        models.append(verify(first, second, index, geometry, **names).model)
    assert models.count("planar") >= 9


@pytest.mark.parametrize("jitter", [0, 0.01])
@pytest.mark.parametrize("shared", [0, 1])
def test_matches_of_one_point_are_one(rng, shared, jitter):
    xy = rng.uniform(0, 1000, (2, 60, 2))
    xy[shared, :27] = [583.5, 931.5] + jitter * rng.normal(size=(27, 2))
    first, second = (Keypoints.at(each, 3) for each in xy)
    for geometry in ("fundamental", "homography"):
        assert verify(first, second, PAIRS[:60], geometry).matrix is None


def test_a_mirrored_image_is_remarked_with_any_geometry(rng):
    first, second, _ = two_views(rng, "planar")
    mirrored = Keypoints.at(second.xy * [-1, 1] + [1280, 0], 3)
    with pytest.warns(ImageWarning, match="verify: the matches are mirrored"):
        verify(first, mirrored, PAIRS)
    verify(first, mirrored, PAIRS, mirrored=False)


def test_mirrored_homographies(rng):
    """A map whose y points up: suggested, confirmed, or refused; scaled as OpenCV's."""
    H = np.array([[0.9, 0.1, 50], [0.1, -0.9, 800], [1e-5, 0, 1]])
    a = rng.uniform(0, 600, (100, 2))
    b = cv2.perspectiveTransform(a[None], H)[0]
    arguments = Keypoints.at(a, 3), Keypoints.at(b, 3), PAIRS[:100], "homography"
    with pytest.warns(ImageWarning, match="mirrored"):
        assert verify(*arguments).mirrored
    found = verify(*arguments, mirrored=True)
    assert found.inliers.all()
    np.testing.assert_allclose(found.H, cv2.findHomography(a, b)[0], rtol=1e-3, atol=1e-5)
    assert verify(*arguments, mirrored=False).matrix is None


def test_two_cameras_with_lenses(rng):
    """Each image by its own camera; with one for both the pose would be another."""
    lenses = (LENS, (0.1, -0.02, 0, 0))
    first, second, xyz = two_views(rng, "general", 0.2, cameras=(K1, K2), lenses=lenses)
    found = verify(first, second, PAIRS, "essential", intrinsics=(K1, K2), distortion=lenses)
    assert found.inliers.mean() > 0.95
    assert found.pose.translation @ T / np.linalg.norm(T) > np.cos(np.radians(1.5))
    points, covariance = triangulate(first, second, PAIRS, found)
    good = np.isfinite(points[:, 0])
    np.testing.assert_array_equal(good, found.inliers)
    error = points[good] * np.linalg.norm(T) - xyz[good]
    information = np.linalg.inv(covariance[good] * (T @ T))
    squared = np.einsum("ni,nij,nj->n", error, information, error)
    assert 0.3 < np.median(squared) / 2.37 < 2  # the median of chi^2 of 3 dimensions


def test_pixels_grow_towards_the_rim_of_a_wide_image(rng):
    """Right matches there are kept, and weigh as much as they are exact."""
    lens = {"lens": "fisheye", "distortion": (0.02, -0.01, 0.003, -0.001)}
    camera = Camera.from_matrix([[450, 0, 640], [0, 450, 480], [0, 0, 1]], (1280, 960), **lens)
    squared = []
    for _ in range(10):
        depth = rng.uniform(4, 12, COUNT)
        xyz = np.c_[rng.uniform(-1.5, 1.5, (COUNT, 2)), np.ones(COUNT)] * depth[:, None]
        xy = [camera.project(each) for each in (xyz, xyz @ R.T + T)]
        noisy = [Keypoints.at(each + rng.normal(0, 0.3, each.shape), 3) for each in xy]
        found = verify(*noisy, PAIRS, "essential", intrinsics=camera)
        assert found.inliers.mean() > 0.98
        error = cv2.Rodrigues(R @ found.pose.rotation.T)[0][:, 0]
        squared.append(error @ np.linalg.solve(found.pose.covariance[:3, :3], error))
    assert 0.4 < np.mean(squared) / 3 < 1.9  # .995 of chi-square with 30 degrees of freedom


def test_triangulated_points_are_opencvs(rng):
    first, second, _ = two_views(rng, "general", noise=0)
    found = verify(first, second, PAIRS, "essential", intrinsics=K1)
    points, _ = triangulate(first, second, PAIRS, found)
    rays = [cv2.undistortPoints(each.xy.astype(float), K1, None)[:, 0] for each in (first, second)]
    pose = np.c_[found.pose.rotation, found.pose.translation]
    theirs = cv2.triangulatePoints(np.eye(3, 4), pose, rays[0].T, rays[1].T)
    np.testing.assert_allclose(points, (theirs[:3] / theirs[3]).T, rtol=1e-3, atol=1e-3)


def test_packed_bits_are_matched_by_hamming_distance():
    """As OpenCV's matcher."""
    noise = np.random.default_rng(0).random((300, 400))
    image = (255 * cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 1, 32)).astype(
        np.uint8
    )
    detector = cv2.ORB_create()
    views = [detector.detectAndCompute(each, None) for each in (image, image[5:, 7:])]
    both = [
        replace(Keypoints.at(np.array([each.pt for each in points]), 3), descriptors=bits)
        for points, bits in views
    ]
    theirs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(views[0][1], views[1][1], 2)
    expected = {m.queryIdx for m, n in theirs if m.distance < 0.8 * n.distance}
    found = match(*both, ratio=0.8, mutual=False)
    assert set(found[:, 0].tolist()) == expected
