"""Right matches are told from wrong ones by the geometry of two views; its fit and covariance."""

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares

from saccade import Keypoints, Sift, match, read_image, verify
from saccade.errors import ConfigError, KeypointsError
from saccade.keypoints.calibrated_views import views_of
from saccade.keypoints.two_view_fit import (
    minimize,
    nearest_model,
    project,
    refine,
    residuals_of,
    sampson_distances,
    tangents,
)
from saccade.keypoints.verification import position_sigma, verify_positions

HOMOGRAPHY = np.array([[0.9, -0.3, 80], [0.25, 0.95, -40], [2e-4, -1e-4, 1]])
CORNERS = np.array([[0, 0], [639, 0], [0, 479], [639, 479]], float)
CAMERA = np.array([[500, 0, 320], [0, 500, 240], [0, 0, 1]], float)


def derivative(function, at):
    """(n, k) central differences of a function of (k,) with (n,) values."""
    steps = 1e-6 * np.eye(len(at))
    return np.stack([function(at + step) - function(at - step) for step in steps], 1) / 2e-6


def plane(rng, count):
    """Exact matches of a plane."""
    first = rng.uniform([0, 0], [640, 480], (count, 2))
    return np.hstack([first, project(HOMOGRAPHY, first)]), HOMOGRAPHY


def seen_again(first, depth, R, t):
    """Exact matches of points (n, 2) of an image, at depths (n,), after the camera has moved."""
    rays = np.c_[first, np.ones(len(first))] @ np.linalg.inv(CAMERA).T
    seen = (rays * depth[:, None] @ R.T + t) @ CAMERA.T
    return np.hstack([first, seen[:, :2] / seen[:, 2:]])


def keypoints_of(matched):
    """The keypoints of both images, and their pairs."""
    pairs = np.stack([np.arange(len(matched))] * 2, axis=1)
    return Keypoints.at(matched[:, :2], 5), Keypoints.at(matched[:, 2:], 5), pairs


def space(rng, count):
    """Exact matches of points in space, and their fundamental matrix."""
    R, shift = cv2.Rodrigues(np.array([0.05, -0.2, 0.1]))[0], np.array([0.5, 0.1, 0.2])
    first = rng.uniform([0, 0], [640, 480], (count, 2))
    cross = np.cross(np.eye(3), -shift)
    matrix = np.linalg.inv(CAMERA).T @ cross @ R @ np.linalg.inv(CAMERA)
    return seen_again(first, rng.uniform(3, 8, count), R, shift), matrix


def two_views(rng, count=120, wrong=60, view=space):
    """Matches in an order of their own, the last of them wrong, and the true relation."""
    matched, relation = view(rng, count)
    first, second = matched[:, :2], matched[:, 2:] + rng.normal(0, 0.2, (count, 2))
    second[count - wrong :] = rng.uniform([0, 0], [640, 480], (wrong, 2))
    pairs = np.stack([np.arange(count), np.arange(count)[::-1]], axis=1)
    return Keypoints.at(first, 5), Keypoints.at(second[::-1], 5), pairs, relation


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


@pytest.mark.parametrize("geometry", ["homography", "fundamental"])
def test_derivatives_of_residuals_are_differences(rng, geometry):
    matched, matrix = (plane if geometry == "homography" else space)(rng, 20)
    matched += rng.normal(0, 2, matched.shape)
    matched /= 300  # entries of the models are then of unit scale
    matrix = np.diag([300, 300, 1]) @ matrix @ np.diag([300, 300, 1])
    if geometry == "homography":
        matrix = np.diag([300.0**-2, 300.0**-2, 1]) @ matrix
    matrix /= np.linalg.norm(matrix)
    residuals = residuals_of(geometry, matrix, matched, rng.uniform(0.1, 1, (20, 2)))
    _, J = residuals(matrix)
    numeric = derivative(lambda m: residuals(m.reshape(3, 3))[0].ravel(), matrix.ravel())
    np.testing.assert_allclose(J.reshape(numeric.shape), numeric, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("geometry", "freedom"), [("homography", 8), ("fundamental", 7),
                                                   ("essential", 5)])  # fmt: skip
def test_tangents_stay_among_the_matrices_of_a_geometry(rng, geometry, freedom):
    """To first order a step leaves norm and constraints as they are."""
    model = nearest_model(rng.normal(size=(3, 3)), geometry)
    directions = tangents(model, geometry)
    assert directions.shape == (freedom, 9)
    np.testing.assert_allclose(directions @ directions.T, np.eye(freedom), atol=1e-12)
    moved = model + 1e-4 * (rng.normal(size=freedom) @ directions).reshape(3, 3)
    np.testing.assert_allclose(nearest_model(moved, geometry), moved, atol=1e-6)


@pytest.mark.parametrize("geometry", ["homography", "fundamental", "essential"])
def test_the_minimum_of_the_loss_is_scipys(rng, geometry):
    """The same loss at its minimum along all directions in which a matrix can move."""
    matched, matrix = (plane if geometry == "homography" else space)(rng, 60)
    if geometry == "essential":
        matrix, matched = CAMERA.T @ matrix @ CAMERA, (matched - [320, 240] * 2) / 500
    noise = 1.0 if geometry != "essential" else 1 / 500
    matched = observed(rng, matched, np.full((60, 2), 0.4 * noise), 0.0)
    matched[:6] += rng.normal(0, 4 * noise, (6, 4))
    found = minimize(matrix, geometry, matched, np.full((60, 2), noise))
    before, T1 = found.back
    T2 = np.linalg.inv(before) if geometry == "homography" else before.T
    scaled = np.hstack([project(T1, matched[:, :2]), project(T2, matched[:, 2:])])
    sigma = noise * np.array([T1[0, 0], T2[0, 0]]) * np.ones((60, 2))
    first = nearest_model(np.linalg.inv(before) @ matrix @ np.linalg.inv(T1), geometry)
    residuals = residuals_of(geometry, first, scaled, sigma)
    np.testing.assert_allclose(residuals(found.model)[0], found.z, atol=1e-9)
    directions = tangents(found.model, geometry)

    def moved(step):
        return nearest_model(found.model + (step @ directions).reshape(3, 3), geometry)

    def scores(step):
        return residuals(moved(step))[0].ravel() / found.width

    theirs = least_squares(scores, np.zeros(len(directions)), loss="cauchy", x_scale=1e-3)
    ours = np.log1p(scores(np.zeros(len(directions))) ** 2).sum() / 2
    assert ours == pytest.approx(theirs.cost, rel=1e-4)
    if geometry != "homography":
        np.testing.assert_allclose(
            found.z[:, 0], sampson_distances(found.model, scaled, sigma), atol=1e-9
        )


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


def test_the_sigma_of_a_position():
    points = Keypoints.at(np.zeros((3, 2)), [4, 4, 0.1])
    points.response[1] = 0.01
    np.testing.assert_allclose(position_sigma(points), [0.128, np.hypot(0.128, 0.28), 0.02])


def test_a_verified_homography_projects_with_its_covariance(rng):
    matched, _ = plane(rng, 200)
    matched = observed(rng, matched, np.full((200, 2), 0.3), 0.1)
    first, second, pairs = keypoints_of(matched)
    found = verify(first, second, pairs, "homography")
    covariance = found.projection_covariance(CORNERS)
    J = derivative(lambda h: project(h.reshape(3, 3), CORNERS).ravel(), found.matrix.ravel())
    expected = (J @ found.covariance @ J.T).reshape(4, 2, 4, 2)[range(4), :, range(4)]
    np.testing.assert_allclose(covariance, expected, rtol=1e-4)
    gap = project(found.matrix, CORNERS) - project(HOMOGRAPHY, CORNERS)
    assert (np.abs(gap) < 5 * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))).all()
    with pytest.raises(KeypointsError, match="expected a homography"):
        verify(first, second, pairs, "fundamental").projection_covariance(CORNERS)


def covariance_of_pose(rng, wrong):
    """Normalized squared errors of poses (5 in the mean), and their errors in degrees."""
    squared, angles = [], []
    for _ in range(80):
        R, t = cv2.Rodrigues(rng.normal(0, 0.1, 3))[0], rng.normal(0, 0.4, 3)
        first = rng.uniform([0, 0], [640, 480], (200, 2))
        matched = seen_again(first, rng.uniform(3, 12, 200), R, t)
        sigma = rng.uniform(0.1, 1, (200, 2))
        matched += rng.normal(size=matched.shape) * np.repeat(sigma, 2, axis=1)
        count = round(wrong * 200)
        matched[:count, 2:] = rng.uniform([0, 0], [640, 480], (count, 2))
        pose = verify_positions(matched, sigma, "essential", 2.0, 15, views_of(CAMERA)).pose
        turn = cv2.Rodrigues(R @ pose.rotation.T)[0].ravel()
        error = np.concatenate([turn, t / np.linalg.norm(t) - pose.translation])
        values, vectors = np.linalg.eigh(pose.covariance)
        assert abs(values[0]) < 1e-9 * values[-1]  # the length of the translation is not free
        squared.append(((vectors[:, 1:].T @ error) ** 2 / values[1:]).sum())
        angles.append(np.degrees(np.linalg.norm(error[3:])))
    return np.array(squared), np.array(angles)


@pytest.mark.parametrize("wrong", [0.0, 0.1])
def test_the_covariance_of_a_pose_is_that_of_its_errors(rng, wrong):
    squared, angles = covariance_of_pose(rng, wrong)
    inside = np.mean(squared < 11.07)
    print(f"\nwrong {wrong:.0%}: normalized squared error {squared.mean():.1f} (5), inside 95 %: "
          f"{inside:.2f}, direction {np.median(angles):.2f} degrees")  # fmt: skip
    assert 3.5 < squared.mean() < 7.5
    assert inside > 0.85


def test_an_essential_matrix_needs_a_camera(rng):
    matched, F = space(rng, 60)
    first, second, pairs = keypoints_of(matched)
    found = verify(first, second, pairs, "essential", intrinsics=CAMERA)
    assert found.inliers.all()
    pixels = np.linalg.inv(CAMERA).T @ found.matrix @ np.linalg.inv(CAMERA)
    cosine = (pixels * F).sum() / np.linalg.norm(pixels) / np.linalg.norm(F)
    assert abs(cosine) > 1 - 1e-6
    with pytest.raises(ConfigError, match="intrinsics"):
        verify(first, second, pairs, "essential")


def of_unit_length(matrix):
    unit = matrix / np.linalg.norm(matrix)
    return unit * np.sign(unit.flat[np.abs(unit).argmax()])


@pytest.mark.parametrize("geometry", ["fundamental", "homography"])
def test_the_true_geometry_is_found(rng, geometry):
    first, second, pairs, relation = two_views(
        rng, view=plane if geometry == "homography" else space
    )
    found = verify(first, second, pairs, geometry)
    assert found.inliers[:60].mean() > 0.95
    assert found.inliers[60:].mean() < 0.15
    matrix = found.H if geometry == "homography" else found.F
    np.testing.assert_allclose(of_unit_length(matrix), of_unit_length(relation), atol=0.05)
    model = "planar" if geometry == "homography" else "general"
    assert found.model == model
    agree = f"{found.inliers.sum()} of 120 matches agree"
    assert str(found) == f"Verification({geometry}, {model}: {agree})"


@pytest.mark.parametrize("geometry", ["fundamental", "homography"])
def test_chance_is_told_from_geometry(rng, geometry):
    first, second = (Keypoints.at(rng.uniform(0, 500, (40, 2)), 5) for _ in range(2))
    pairs = np.repeat(np.arange(40)[:, None], 2, axis=1)
    found = verify(first, second, pairs, geometry, tolerance=1.0)
    assert found.matrix is None
    assert not found.inliers.any()
    assert found.inliers.shape == (40,)


@pytest.mark.parametrize("count", [0, 1, 3, 4, 6, 7, 8, 14])
@pytest.mark.parametrize("geometry", ["fundamental", "homography"])
@pytest.mark.parametrize("same", [False, True])
def test_few_matches_say_nothing(rng, count, geometry, same):
    xy = np.zeros((count, 2)) if same else rng.uniform(0, 100, (count, 2))
    points = Keypoints.at(xy, 5)
    pairs = np.repeat(np.arange(count)[:, None], 2, axis=1)
    found = verify(points, points, pairs, geometry)
    assert found.matrix is None
    assert found.inliers.shape == (count,)
    if not same and count in (8, 14):
        assert verify(points, points, pairs, "homography", min_inliers=4).inliers.all()


def test_neither_chance_nor_order_matters(rng):
    first, second, pairs, _ = two_views(rng)
    once = verify(first, second, pairs)
    order = rng.permutation(len(pairs))
    for seed in range(3):
        cv2.setRNGSeed(seed)
        again = verify(first, second, pairs[order])
        np.testing.assert_array_equal(again.matrix, once.matrix)
        np.testing.assert_array_equal(again.inliers, once.inliers[order])


def test_points_that_share_a_place_count_once(rng):
    """A hundred orientations of six places are no geometry."""
    xy = np.repeat(rng.uniform(0, 100, (6, 2)), 17, axis=0)
    points = Keypoints.at(xy, 5)
    assert verify(points, points, np.c_[np.arange(102), np.arange(102)]).matrix is None
    first, second, pairs, _ = two_views(rng)
    plain, double = (verify(first, second, each) for each in (pairs, np.repeat(pairs, 2, axis=0)))
    np.testing.assert_array_equal(plain.matrix, double.matrix)
    np.testing.assert_array_equal(np.repeat(plain.inliers, 2), double.inliers)


@pytest.mark.shared
@pytest.mark.parametrize("scene", ["bark", "boat", "wall"])
def test_on_a_photographed_plane(shared, scene):
    """The verified matches are those that the known homography calls right."""
    folder = shared / "data/pairs/oxford" / scene
    first, second = (Sift()(read_image(folder / f"{number}.png")) for number in (1, 3))
    pairs = match(first, second, ratio=0.95)
    known = np.loadtxt(folder / "H_1_3.txt")
    moved = np.c_[first.xy[pairs[:, 0]], np.ones(len(pairs))] @ known.T
    right = np.hypot(*(moved[:, :2] / moved[:, 2:] - second.xy[pairs[:, 1]]).T) < 3
    found = verify(first, second, pairs, "homography")
    print(f"\n{scene}: right {right.mean():.3f} of {len(pairs)}, of the verified "
          f"{right[found.inliers].mean():.3f}, verified of the right "
          f"{found.inliers[right].mean():.3f}")  # fmt: skip
    assert right[found.inliers].mean() > 0.97
    assert found.inliers[right].mean() > 0.9


def test_what_cannot_be_verified(rng):
    points = Keypoints.at(rng.random((5, 2)), 3)
    with pytest.raises(ConfigError, match="geometry: expected fundamental or homography"):
        verify(points, points, np.zeros((0, 2), int), "affine")
    for tolerance in (0, -1, np.nan, np.inf):
        with pytest.raises(ConfigError, match="tolerance: expected pixels over 0"):
            verify(points, points, np.zeros((0, 2), int), tolerance=tolerance)
    with pytest.raises(KeypointsError, match=r"pairs: expected .*\(m, 2\), found .* \(3,\)"):
        verify(points, points, np.arange(3))
    for several in ([(0, 0), (1, 1)], []):
        with pytest.raises(KeypointsError, match=r"pairs: expected an array .* found a list"):
            verify(points, points, several)
    with pytest.raises(KeypointsError, match=r"pairs: expected whole numbers.*found float64"):
        verify(points, points, np.zeros((1, 2)))
    lost = Keypoints.at(np.full((5, 2), np.nan), 3)
    with pytest.raises(KeypointsError, match="keypoints: expected finite positions"):
        verify(points, lost, np.zeros((1, 2), int))
    with pytest.raises(KeypointsError, match="keypoints: expected finite sizes"):
        verify(points, Keypoints.at(points.xy, np.nan), np.zeros((1, 2), int))
    with pytest.raises(KeypointsError, match="pairs: expected indices below 5 and 5, found 0 to 5"):
        verify(points, points, np.array([[0, 5]]))


def test_matches_in_which_no_sample_gives_a_model_have_no_geometry():
    rng = np.random.default_rng(705)  # OpenCV 5.0 fails an assertion on these
    n = int(rng.integers(8, 20))
    first, _ = rng.uniform(0, 500, (2, n, 2))
    second = first + rng.normal(0, 1, (n, 2))
    found = verify(*keypoints_of(np.hstack([first, second])))
    assert found.matrix is None
    assert not found.inliers.any()
