"""The robust fit of a two-view geometry, against closed forms, peers and its own covariance."""

import cv2
import numpy as np
import pytest

from saccade import Keypoints, verify
from saccade.errors import ConfigError, KeypointsError
from saccade.keypoints.two_view_fit import (
    derivative,
    local_affinities,
    project,
    refine,
    sampson_distances,
)
from saccade.keypoints.verification import position_sigma, verify_positions

HOMOGRAPHY = np.array([[0.9, -0.3, 80], [0.25, 0.95, -40], [2e-4, -1e-4, 1]])
CORNERS = np.array([[0, 0], [639, 0], [0, 479], [639, 479]], float)
CAMERA = np.array([[500, 0, 320], [0, 500, 240], [0, 0, 1]], float)


def plane(rng, count):
    """Exact matches of a plane."""
    first = rng.uniform([0, 0], [640, 480], (count, 2))
    return np.hstack([first, project(HOMOGRAPHY, first)]), HOMOGRAPHY


def space(rng, count):
    """Exact matches of points in space, and their fundamental matrix."""
    R, shift = cv2.Rodrigues(np.array([0.05, -0.2, 0.1]))[0], np.array([0.5, 0.1, 0.2])
    first = rng.uniform([0, 0], [640, 480], (count, 2))
    rays = np.c_[first, np.ones(count)] @ np.linalg.inv(CAMERA).T
    seen = (rays * rng.uniform(3, 8, (count, 1)) @ R.T + shift) @ CAMERA.T
    cross = np.cross(np.eye(3), -shift)
    matrix = np.linalg.inv(CAMERA).T @ cross @ R @ np.linalg.inv(CAMERA)
    return np.hstack([first, seen[:, :2] / seen[:, 2:]]), matrix


def observed(rng, matched, sigma, wrong):
    """Matches with noise, a fraction of them wrong by up to the tolerance of the refinement."""
    noisy = matched + rng.normal(size=matched.shape) * np.repeat(sigma, 2, axis=1)
    count = round(wrong * len(noisy))
    noisy[:count, 2:] += rng.uniform(-4, 4, (count, 2))
    return noisy


def test_sampson_distances_are_opencvs(rng):
    matched, F = space(rng, 20)
    matched += rng.normal(0, 2, matched.shape)
    ours = sampson_distances(F, matched)
    theirs = [
        cv2.sampsonDistance(np.append(row[:2], 1)[:, None], np.append(row[2:], 1)[:, None], F)
        for row in matched
    ]
    np.testing.assert_allclose(ours**2, theirs, rtol=1e-9)
    np.testing.assert_allclose(sampson_distances(F, matched, 0.5), 2 * ours)


def test_affinities_are_derivatives(rng):
    points = rng.uniform(0, 500, (6, 2))
    for point, affinity in zip(points, local_affinities(HOMOGRAPHY, points), strict=True):
        numeric = derivative(lambda xy: project(HOMOGRAPHY, xy[None])[0], point)
        np.testing.assert_allclose(affinity, numeric, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("view", [plane, space])
def test_exact_matches_give_the_exact_model(rng, view):
    matched, matrix = view(rng, 40)
    geometry = "homography" if view is plane else "fundamental"
    bent = matrix * (1 + 1e-4 * rng.normal(size=(3, 3)))
    if view is space:
        U, values, Vt = np.linalg.svd(bent)
        bent = U @ np.diag([*values[:2], 0]) @ Vt
    fit = refine(bent, geometry, matched, np.full((40, 2), 0.5))
    unit = fit.matrix / np.linalg.norm(fit.matrix)
    unit = unit * np.sign((unit * matrix).sum())
    np.testing.assert_allclose(unit, matrix / np.linalg.norm(matrix), atol=1e-7)


@pytest.mark.parametrize("wrong", [0.0, 0.1])
def test_the_covariance_of_a_homography_is_that_of_its_errors(rng, wrong):
    """Normalized squared errors of corners have a mean of 2, whatever the unit of sigma."""
    squared, sizes = [], []
    for _ in range(150):
        matched, _ = plane(rng, 120)
        sigma = rng.uniform(0.1, 1, (120, 2))
        fit = refine(HOMOGRAPHY, "homography", observed(rng, matched, sigma, wrong), 7 * sigma)
        gap = project(fit.matrix, CORNERS) - project(HOMOGRAPHY, CORNERS)
        J = derivative(lambda h: project(h.reshape(3, 3), CORNERS).ravel(), fit.matrix.ravel())
        blocks = (J @ fit.covariance @ J.T).reshape(4, 2, 4, 2)[range(4), :, range(4)]
        squared.append(np.einsum("ni,nij,nj->n", gap, np.linalg.inv(blocks), gap))
        sizes.append(np.hypot(*gap.T))
    print(f"\nwrong {wrong:.0%}: normalized squared error {np.mean(squared):.2f}, "
          f"corner error {np.mean(sizes):.3f} px")  # fmt: skip
    assert 1.7 < np.mean(squared) < 2.5
    assert 0.9 < np.mean(np.array(squared) < 5.99) / 0.95 < 1.06


@pytest.mark.parametrize("wrong", [0.0, 0.1])
def test_the_covariance_of_a_fundamental_matrix_is_that_of_its_errors(rng, wrong):
    """Normalized squared distances of true matches from the epipolar lines have a mean of 1."""
    squared = []
    for _ in range(150):
        matched, F = space(rng, 120)
        sigma = rng.uniform(0.1, 1, (120, 2))
        fit = refine(F, "fundamental", observed(rng, matched, sigma, wrong), sigma)
        others, _ = space(rng, 10)

        def distances(f, others=others):
            return sampson_distances(f.reshape(3, 3), others)

        J = derivative(distances, fit.matrix.ravel() / np.linalg.norm(fit.matrix))
        covariance = fit.covariance / np.linalg.norm(fit.matrix) ** 2
        variance = np.einsum("ni,ij,nj->n", J, covariance, J)
        squared.append(distances(fit.matrix) ** 2 / variance)
    print(f"\nwrong {wrong:.0%}: normalized squared distance {np.mean(squared):.2f}")
    assert 0.85 < np.mean(squared) < 1.25


def test_exact_positions_count_more(rng):
    """Half of the positions are off by a quarter of the others: the best weights gain 2.1 times.

    Variances of 1 and 16 average 8.5; weighted by their inverses, they are worth 1.88. The robust
    loss alone gains a part of that.
    """
    errors = {"weighted": [], "equal": []}
    for _ in range(60):
        matched, _ = plane(rng, 100)
        sigma = np.where(np.arange(100) % 2, 0.2, 0.8)[:, None] * np.ones(2)
        seen = observed(rng, matched, sigma, 0)
        for name, weights in (("weighted", sigma), ("equal", np.ones((100, 2)))):
            fit = refine(HOMOGRAPHY, "homography", seen, weights)
            errors[name].append(project(fit.matrix, CORNERS) - project(HOMOGRAPHY, CORNERS))
    rms = {name: np.sqrt(np.mean(np.square(gaps))) for name, gaps in errors.items()}
    print(f"\ncorner errors: weighted {rms['weighted']:.3f}, equal {rms['equal']:.3f} px")
    assert rms["weighted"] < rms["equal"] / 1.15


def test_the_sigma_of_a_position():
    points = Keypoints.at(np.zeros((3, 2)), [4, 4, 0.1])
    points.response[1] = 0.01
    np.testing.assert_allclose(position_sigma(points), [0.128, np.hypot(0.128, 0.28), 0.02])


def test_a_verified_homography_projects_with_its_covariance(rng):
    matched, _ = plane(rng, 200)
    matched = observed(rng, matched, np.full((200, 2), 0.3), 0.1)
    first, second = Keypoints.at(matched[:, :2], 5), Keypoints.at(matched[:, 2:], 5)
    pairs = np.stack([np.arange(200)] * 2, axis=1)
    found = verify(first, second, pairs, "homography")
    covariance = found.projection_covariance(CORNERS)
    J = derivative(lambda h: project(h.reshape(3, 3), CORNERS).ravel(), found.matrix.ravel())
    expected = (J @ found.covariance @ J.T).reshape(4, 2, 4, 2)[range(4), :, range(4)]
    np.testing.assert_allclose(covariance, expected, rtol=1e-4)
    gap = project(found.matrix, CORNERS) - project(HOMOGRAPHY, CORNERS)
    assert (np.abs(gap) < 5 * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))).all()
    with pytest.raises(KeypointsError, match="expected a homography"):
        verify(first, second, pairs, "fundamental").projection_covariance(CORNERS)


def covariance_of_pose(rng, wrong, depths):
    """Normalized squared errors of poses (5 in the mean), and their errors in degrees."""
    squared, angles = [], []
    for _ in range(80):
        R, t = cv2.Rodrigues(rng.normal(0, 0.1, 3))[0], rng.normal(0, 0.4, 3)
        first = rng.uniform([0, 0], [640, 480], (200, 2))
        rays = np.c_[first, np.ones(200)] @ np.linalg.inv(CAMERA).T
        seen = (rays * rng.uniform(*depths, (200, 1)) @ R.T + t) @ CAMERA.T
        sigma = rng.uniform(0.1, 1, (200, 2))
        matched = np.hstack([first, seen[:, :2] / seen[:, 2:]])
        matched += rng.normal(size=matched.shape) * np.repeat(sigma, 2, axis=1)
        count = round(wrong * 200)
        matched[:count, 2:] = rng.uniform([0, 0], [640, 480], (count, 2))
        pose = verify_positions(matched, sigma, "essential", 2.0, 15, CAMERA).pose
        turn = cv2.Rodrigues(R @ pose.rotation.T)[0].ravel()
        error = np.concatenate([turn, t / np.linalg.norm(t) - pose.translation])
        values, vectors = np.linalg.eigh(pose.covariance)
        assert abs(values[0]) < 1e-9 * values[-1]  # the length of the translation is not free
        squared.append(((vectors[:, 1:].T @ error) ** 2 / values[1:]).sum())
        angles.append(np.degrees(np.linalg.norm(error[3:])))
    return np.array(squared), np.array(angles)


@pytest.mark.parametrize("wrong", [0.0, 0.1])
def test_the_covariance_of_a_pose_is_that_of_its_errors(rng, wrong):
    squared, angles = covariance_of_pose(rng, wrong, (3, 12))
    inside = np.mean(squared < 11.07)
    print(f"\nwrong {wrong:.0%}: normalized squared error {squared.mean():.1f} (5), inside 95 %: "
          f"{inside:.2f}, direction {np.median(angles):.2f} degrees")  # fmt: skip
    assert 3.5 < squared.mean() < 7.5
    assert inside > 0.85


def test_points_of_a_plane_give_the_pose_of_its_homography(rng):
    """Samples of five points on a plane have several solutions: the decomposition has two."""
    R, t = cv2.Rodrigues(np.array([0.02, 0.05, 0.01]))[0], np.array([0.3, 0, 0.1])
    normal = np.array([0.3, 0.1, -1.0])
    first = rng.uniform([0, 0], [640, 480], (300, 2))
    rays = np.c_[first, np.ones(300)] @ np.linalg.inv(CAMERA).T
    depth = -5 / (rays @ normal)
    depth[:40] = rng.uniform(2, 4, 40)  # these decide between the two
    seen = (rays * depth[:, None] @ R.T + t) @ CAMERA.T
    matched = np.hstack([first, seen[:, :2] / seen[:, 2:]]) + rng.normal(0, 0.2, (300, 4))
    pose = verify_positions(matched, np.ones((300, 2)), "essential", 2.0, 15, CAMERA).pose
    assert np.degrees(np.arccos(pose.translation @ t / np.linalg.norm(t))) < 2
    assert pose.direction_sigma < 2
    assert pose.rotation_sigma < 0.5


def test_an_essential_matrix_needs_a_camera(rng):
    matched, F = space(rng, 60)
    first, second = Keypoints.at(matched[:, :2], 5), Keypoints.at(matched[:, 2:], 5)
    pairs = np.stack([np.arange(60)] * 2, axis=1)
    found = verify(first, second, pairs, "essential", intrinsics=CAMERA)
    assert found.inliers.all()
    pixels = np.linalg.inv(CAMERA).T @ found.matrix @ np.linalg.inv(CAMERA)
    cosine = (pixels * F).sum() / np.linalg.norm(pixels) / np.linalg.norm(F)
    assert abs(cosine) > 1 - 1e-6
    with pytest.raises(ConfigError, match="intrinsics"):
        verify(first, second, pairs, "essential")
