"""Geometric verification of matches by a fundamental or essential matrix, or a homography."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ConfigError, ImageWarning, KeypointsError, require
from saccade.keypoints.calibrated_views import Intrinsics, View, matches_in, views_of
from saccade.keypoints.estimation import REFINED_SIGMAS, SAMPLE_SIZE, Estimator
from saccade.keypoints.relative_pose import (
    RelativePose,
    Triangulation,
    corrected_covariance,
    cross_matrix,
    planar_pose,
    pose_of,
    triangulated,
    turned_pose,
)
from saccade.keypoints.two_view_fit import (
    CROSS,
    Geometry,
    projection_derivatives,
    refine,
    sampson_distances,
)
from saccade.keypoints.two_view_models import (
    MIN_NOISE,
    Matches,
    Model,
    Selection,
    is_watermark,
    noise_of,
    seems_mirrored,
    select_model,
)
from saccade.types import BoolArray, FloatArray, IntArray, Keypoints, check_pairs

ComplexArray: TypeAlias = npt.NDArray[np.complex128]

PARAMETERS = {"fundamental": 7, "essential": 5}
"""Number of parameters of a general motion."""
MIN_INLIERS = 15
"""Smallest number of distinct inliers of an accepted geometry, COLMAP's default."""
SAME = 1.0
"""Side in pixels of the cells in which positions count as one."""
MAX_SHARED = 2
"""Largest number of distinct partners of a position whose matches take part in the estimation: at
most one of them is right, and a geometry may agree with all of them by that position alone."""
MIN_UNCERTAINTY = 1.0
"""Standard deviation of the direction of motion in degrees below which the noise of the positions
is negligible beside the parallax."""
MIN_KEYPOINT_SIGMA = 0.02
"""Smallest error of a position, in pixels."""
SCALE_ERROR = 0.064
"""Error of a position in each axis, in scales of its keypoint."""
NOISE_ERROR = 0.0028
"""Error of a position in pixels due to the noise of the image, times |D|."""
MIRROR = np.array([-1.0, 1, 1])
"""Signs of homogeneous coordinates in an image that is mirrored left and right."""


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """The geometry of two views, and the matches that are consistent with it."""

    geometry: Geometry
    """Kind of `matrix`."""
    matrix: FloatArray | None
    """(3, 3), whose properties by kind are `F`, `E` and `H`, which state its scale; None where
    there are too few inliers."""
    inliers: BoolArray
    """(m,) which matches are consistent with it; all false without a matrix."""
    covariance: FloatArray | None = None
    """(9, 9) of the entries of `matrix`, row by row, at its norm; None where the matches do not
    determine it, and in stored runs."""
    pose: RelativePose | None = None
    """Pose of the second camera, for an essential matrix."""
    model: Model | None = None
    """Model that the matches support, whatever `geometry` was asked for: "general" (a scene of any
    shape), "planar" (a plane), "panoramic" (the camera only turned), "still" (no motion), or
    "watermark" (unmoved matches in a small part of the images). None without a matrix, and where it
    was not determined."""
    homography: FloatArray | None = None
    """(3, 3) homography in pixels of a model that is not general."""
    scale: float = 1.0
    """Robust standard deviation of the residuals, in those that `position_sigma` expects."""
    min_inliers: int = MIN_INLIERS
    """Number of distinct inliers that was required."""
    mirrored: bool = False
    """Whether the homography mirrors the image."""
    views: tuple[View, View] | None = None
    """Calibration of both images, for an essential matrix."""

    @property
    def F(self) -> FloatArray | None:  # noqa: N802
        """(3, 3) fundamental matrix, x2' F x1 = 0 in homogeneous pixels (x, y, 1).

        Its norm, the root of the sum of the squared entries, is 1.
        """
        return self.matrix if self.geometry == "fundamental" else None

    @property
    def E(self) -> FloatArray | None:  # noqa: N802
        """(3, 3) essential matrix, x2' E x1 = 0 in the planes z = 1 of the cameras.

        It is [t]x R of `pose`, whose translation has length 1, where that is not 0.
        """
        return self.matrix if self.geometry == "essential" else None

    @property
    def H(self) -> FloatArray | None:  # noqa: N802
        """(3, 3) homography from (x, y, 1) in the first image to the second.

        Its last entry is 1, as OpenCV has it, unless it is 0. A model that is not general has one
        too.
        """
        return self.matrix if self.geometry == "homography" else self.homography

    def projection_covariance(self, xy: FloatArray) -> FloatArray:
        """(n, 2, 2) covariance in the second image of (n, 2) points that the homography projects.

        Raises:
            KeypointsError: there is no homography, or none with a covariance.
        """
        if self.geometry != "homography" or self.matrix is None or self.covariance is None:
            raise KeypointsError("projection_covariance: expected a homography with covariance")
        J = projection_derivatives(self.matrix, xy)  # (n, 2, 9)
        covariance: FloatArray = J @ self.covariance @ J.transpose(0, 2, 1)
        return covariance

    def __repr__(self) -> str:
        words = [self.geometry] + ([] if self.model is None else [self.model])
        agree = f"{self.inliers.sum()} of {len(self.inliers)} matches agree"
        required = f", {self.min_inliers} are required" if self.matrix is None else ""
        return f"Verification({', '.join(words)}: {agree}{required})"


def verify(
    first: Keypoints,
    second: Keypoints,
    pairs: IntArray,
    geometry: Geometry = "fundamental",
    tolerance: float = 2.0,
    min_inliers: int = MIN_INLIERS,
    intrinsics: Intrinsics | None = None,
    distortion: Sequence[Any] | None = None,
    mirrored: bool | None = None,
) -> Verification:
    """Estimate the geometry of two views from matches, with its covariance and inliers.

    A sampled estimate is refined by robust least squares, in which each match weighs as much as
    the positions of its keypoints are exact (see `position_sigma`). Torr's criterion GRIC then
    selects the model that the matches support: `Verification.model`.

    A fundamental matrix holds for any rigid scene, but only constrains a keypoint to a line. A
    homography constrains it to a point; it holds for a plane, or for a camera that only rotates. An
    essential matrix is the fundamental matrix of a calibrated camera, and gives its relative pose.

    Args:
        first: keypoints of the first image.
        second: of the second.
        pairs: (m, 2) indices into both, as `match` returns them.
        geometry: "fundamental", "homography" or "essential".
        tolerance: inlier threshold in pixels, over 0.
        min_inliers: smallest number of distinct inliers of an accepted geometry: positions in the
            first image or in the second, whichever are fewer; those of a cell as large as the
            tolerance are one.
        intrinsics: for "essential": a (3, 3) camera matrix or a `saccade.frames.Camera` of both
            images, or a pair of these.
        distortion: OpenCV's coefficients of a pinhole camera, for camera matrices; a pair of
            lists for a pair of cameras.
        mirrored: whether a homography may mirror the image, as a map whose y points up: True for
            mirrored ones alone, False for none; None tries them where no other is found, and
            warns. With another geometry None warns of matches that seem mirrored.

    Returns:
        The same for the same matches in any order. Keypoints that share a position and differ in
        their angle count once.

    Raises:
        ConfigError: another geometry, a tolerance that is not over 0, an essential matrix without
            intrinsics, or invalid ones.
        KeypointsError: pairs that are not indices, or positions or sizes that are not finite.

    Source: OpenCV's USAC, for homographies with the score of MAGSAC++; Barath et al. (2020).
    """
    require(geometry in SAMPLE_SIZE, "geometry", " or ".join(SAMPLE_SIZE), geometry)
    require(0 < tolerance < np.inf, "tolerance", "pixels over 0", tolerance)
    require(min_inliers >= 1, "min_inliers", "at least 1", min_inliers)
    views = None if geometry != "essential" else views_of(intrinsics, distortion)
    matched, sigma = matched_positions(first, second, pairs)
    keypoints = np.concatenate([first.xy, second.xy]).astype(np.float64)
    keypoints = keypoints[is_finite(keypoints)]
    options = (geometry, tolerance, min_inliers, views)
    if not mirrored:
        found = verify_positions(matched, sigma, *options, keypoints=keypoints)
        if mirrored is None and found.model == "general" and geometry != "homography":
            warn_of_mirror(matched[found.inliers])
        if found.matrix is not None or mirrored is False or geometry != "homography":
            return found
    require(geometry == "homography", "mirrored", "a homography", geometry)
    mirror = matched * [-1, 1, 1, 1]
    found = verify_positions(mirror, sigma, *options, keypoints=keypoints)
    if found.matrix is None:
        return found
    if mirrored is None:
        warnings.warn(
            f"verify: {found.inliers.sum()} matches agree with a mirrored homography, and with no "
            "other; mirrored=True confirms it, mirrored=False refuses it",
            ImageWarning,
            stacklevel=2,
        )
    return unmirrored(found)


def warn_of_mirror(inliers: FloatArray) -> None:
    """Warns if inliers (m, 4) of an epipolar geometry seem to be mirrored."""
    if seems_mirrored(inliers):
        warnings.warn(
            "verify: the matches are mirrored; mirror one of the images, or ask for a homography "
            "with mirrored=True; mirrored=False if they are right",
            ImageWarning,
            stacklevel=3,
        )


def unmirrored(found: Verification) -> Verification:
    """The homography of the image itself, of one of its mirror image."""
    assert found.matrix is not None
    signs, covariance = np.tile(MIRROR, 3), found.covariance
    if covariance is not None:
        covariance = covariance * np.outer(signs, signs)
    matrix = found.matrix * MIRROR
    model: Model | None = "planar" if found.model == "panoramic" else found.model
    return replace(found, matrix=matrix, covariance=covariance, mirrored=True, model=model,
                   homography=matrix)  # fmt: skip


def triangulate(
    first: Keypoints, second: Keypoints, pairs: IntArray, verification: Verification
) -> Triangulation:
    """Points in space of the matches of two calibrated views, with covariances.

    Args:
        first: keypoints of the first image.
        second: of the second.
        pairs: (m, 2) indices into both, as they were verified.
        verification: by an essential matrix.

    Returns:
        (m, 3) points in the frame of the first camera, in baselines, and (m, 3, 3) covariances,
        of the errors of the positions and of the pose. NaN for matches that are no inliers, and
        for points whose rays do not meet in front of both cameras.

    Raises:
        ConfigError: the verification is not by an essential matrix, or the direction of motion is
            unknown.
        KeypointsError: pairs that are not indices, or not those that were verified.
    """
    pose, views = verification.pose, verification.views
    if pose is None or views is None or not np.isfinite(pose.direction_sigma):
        found = str(verification.model or verification.geometry)
        raise ConfigError(f"verification: expected an essential matrix with a pose, found {found}")
    if len(pairs) != len(verification.inliers):
        found = f"{len(pairs)} and {len(verification.inliers)}"
        raise KeypointsError(f"pairs: expected those that were verified, found {found}")
    matched, sigma = matched_positions(first, second, pairs)
    matches = matches_in(matched, sigma * max(verification.scale, 1e-6), views)
    points, inliers = triangulated(pose, matches), verification.inliers
    return Triangulation(
        np.where(inliers[:, None], points.xyz, np.nan),
        np.where(inliers[:, None, None], points.covariance, np.nan),
    )


def matched_positions(
    first: Keypoints, second: Keypoints, pairs: IntArray
) -> tuple[FloatArray, FloatArray]:
    """(m, 4) rows x1, y1, x2, y2 of matches, and (m, 2) standard deviations of both positions."""
    check_pairs(pairs, (len(first), len(second)), "pairs")
    matched = np.hstack([first.xy[pairs[:, 0]], second.xy[pairs[:, 1]]]).astype(np.float64)
    if not np.isfinite(matched).all():
        raise KeypointsError("keypoints: expected finite positions, found NaN or infinity")
    sigma = [
        position_sigma(each)[index] for each, index in zip((first, second), pairs.T, strict=True)
    ]
    errors = np.stack(sigma, 1)
    if not np.isfinite(errors).all():
        raise KeypointsError("keypoints: expected finite sizes, found NaN or infinity")
    return matched, errors


def verify_positions(
    matched: FloatArray,
    sigma: FloatArray,
    geometry: Geometry,
    tolerance: float,
    min_inliers: int,
    views: tuple[View, View] | None = None,
    *,
    keypoints: FloatArray | None = None,
) -> Verification:
    """`verify` of (m, 4) rows x1, y1, x2, y2 and (m, 2) standard deviations of both positions.

    Args:
        matched: in pixels.
        sigma: in pixels.
        geometry: see `verify`.
        tolerance: see `verify`.
        min_inliers: see `verify`.
        views: calibration, for an essential matrix.
        keypoints: (n, 2) positions of all keypoints of both images; None for no selection of a
            model.
    """
    none = Verification(geometry, None, np.zeros(len(matched), np.bool_), min_inliers=min_inliers)
    given = matches_in(matched, sigma, views)
    rows, row = np.unique(given.positions, axis=0, return_inverse=True)
    row = row.ravel()
    smallest = np.full((len(rows), 2), np.inf)
    np.minimum.at(smallest, row, given.sigma)
    pixel, pixels = np.empty((len(rows), 2)), np.empty((len(rows), 4))
    pixel[row], pixels[row] = given.pixel, matched
    matches = Matches(rows, smallest, pixel)
    usable = is_finite(rows)
    usable[usable] = is_unshared(np.floor(pixels[usable] / SAME))
    estimator = Estimator(geometry, tolerance)
    found = estimator.estimate(matches.take(usable))
    if found is None:
        return none
    matrix, fit = found
    inliers = np.zeros(len(rows), np.bool_)
    finite = is_finite(rows)
    scale = 1.0 if fit is None else fit.scale
    inliers[finite] = estimator.inliers(matrix, matches.take(finite))
    if count_distinct(np.floor(pixels[inliers] / tolerance)) < min_inliers:
        return none
    covariance = None if fit is None else fit.covariance
    if geometry == "fundamental":
        length = float(np.linalg.norm(matrix))
        matrix = matrix / length
        covariance = None if covariance is None else covariance / length**2
    if geometry == "homography":
        matrix, covariance = scaled_homography(matrix, covariance)
    verified = Verification(
        geometry,
        matrix,
        inliers[row],
        covariance,
        scale=scale,
        min_inliers=min_inliers,
        views=views,
    )
    if geometry == "essential":
        verified = with_scale_of_pose(verified, pose_of(matrix, rows[inliers], covariance))
    if keypoints is None:
        return verified
    chosen = matches.take(usable), inliers[usable], pixels[usable, :2]
    result = with_model(verified, *chosen, keypoints)
    if geometry != "essential" or result.model != "planar" or result.pose is None:
        return result
    agree = np.zeros(len(rows), np.bool_)
    agree[finite] = on_plane(
        result, matches.take(finite), replace(estimator, geometry="homography")
    )
    return replace(with_matrix_of_pose(result, result.pose), inliers=agree[row])


def on_plane(verified: Verification, matches: Matches, estimator: "Estimator") -> BoolArray:
    """(m,) which matches of calibrated views are consistent with the homography of a plane."""
    assert verified.views is not None
    assert verified.homography is not None
    K1, K2 = (view.matrix for view in verified.views)
    return estimator.inliers(np.linalg.inv(K2) @ verified.homography @ K1, matches)


def with_matrix_of_pose(verified: Verification, pose: RelativePose) -> Verification:
    """The verification with the essential matrix of a pose.

    A plane has two poses, and the matrix that most matches agree with may be that of the other one.
    """
    J = np.concatenate([cross_matrix(pose.translation) @ CROSS, CROSS]) @ pose.rotation
    covariance = None
    if pose.covariance is not None and np.isfinite(pose.covariance).all():
        covariance = J.reshape(6, 9).T @ pose.covariance @ J.reshape(6, 9)
    matrix = cross_matrix(pose.translation) @ pose.rotation
    return replace(verified, matrix=matrix, covariance=covariance)


def with_scale_of_pose(verified: Verification, pose: RelativePose) -> Verification:
    """The verification with a pose, and with its essential matrix at the scale of the pose."""
    matrix, covariance = verified.matrix, verified.covariance
    assert matrix is not None
    scale = float((cross_matrix(pose.translation) @ pose.rotation * matrix).sum()) / 2
    covariance = None if covariance is None else covariance / scale**2
    return replace(verified, matrix=matrix / scale, covariance=covariance, pose=pose)


def with_model(
    verified: Verification,
    matches: Matches,
    inliers: BoolArray,
    positions: FloatArray,
    keypoints: FloatArray,
) -> Verification:
    """The verification with the model that the matches support, and the pose of that model.

    Args:
        verified: by a geometry.
        matches: those that took part in the estimation.
        inliers: (m,) which of them agree.
        positions: (m, 2) their pixels in the first image.
        keypoints: (n, 2) positions of all keypoints.
    """
    geometry, matrix = verified.geometry, verified.matrix
    assert matrix is not None
    general: FloatArray | None = matrix
    parameters = PARAMETERS.get(geometry, PARAMETERS["fundamental"])
    scale = verified.scale
    if geometry == "homography":
        estimator = Estimator("fundamental", 2 * scale * float(np.median(matches.sigma)) + 1)
        found = estimator.estimate(matches)
        general = None if found is None else found[0]
    z = np.full(len(matches.positions), np.inf)
    if general is not None:
        z = sampson_distances(general, matches.positions, matches.sigma)
        scale = noise_of(z[inliers], parameters)
    pixel = float(np.median(matches.pixel[:, 0]))
    scale = max(scale, MIN_NOISE * pixel / float(np.median(matches.sigma)))
    scaled = matches.noisier(scale)
    selection = select_model(scaled, z / scale, parameters, calibrated=verified.views is not None)
    model: Model = selection.model
    if selection.homography is None:
        return with_covariance(replace(verified, model=model), matches.take(inliers))
    if model == "still":
        unmoved = scaled.squared(selection.homography) < REFINED_SIGMAS**2 * 2
        if is_watermark(positions[unmoved], keypoints):
            model = "watermark"
    pixels_to = selection.homography
    if verified.views is not None:
        K1, K2 = (view.matrix for view in verified.views)
        pixels_to = K2 @ selection.homography @ np.linalg.inv(K1)
    homography, _ = scaled_homography(pixels_to, None)
    result = replace(verified, model=model, homography=homography)
    if verified.views is None:
        return result
    return replace(result, pose=pose_of_selection(selection, scaled, verified))


def pose_of_selection(
    selection: Selection, matches: Matches, verified: Verification
) -> RelativePose | None:
    """The pose of a camera that is still, turned, or viewed a plane."""
    H = selection.homography
    assert H is not None
    near = matches.take(matches.squared(H) < REFINED_SIGMAS**2 * 2)
    if selection.model != "planar":
        return turned_pose(H, near)
    fit = refine(H, "homography", near.positions, near.sigma)
    if fit is None:
        return verified.pose
    return planar_pose(fit.matrix, fit.covariance, near.positions) or verified.pose


def with_covariance(verified: Verification, matches: Matches) -> Verification:
    """The verification of a general motion with the covariance of its pose."""
    matrix, covariance = verified.matrix, verified.covariance
    if verified.geometry != "essential" or matrix is None or covariance is None:
        return verified
    certain = verified.pose is not None and verified.pose.direction_sigma < MIN_UNCERTAINTY
    if certain or not verified.scale > 0:
        return verified
    corrected = corrected_covariance(matrix, covariance, matches, verified.scale)
    pose = pose_of(matrix, matches.positions, corrected)
    if verified.pose is not None and pose.direction_sigma < verified.pose.direction_sigma:
        return verified
    return replace(verified, covariance=corrected, pose=pose)


def is_finite(rows: FloatArray) -> BoolArray:
    """(m,) whether all numbers of a row are finite."""
    return np.asarray(np.isfinite(rows).all(axis=1))


def is_unshared(matched: FloatArray) -> BoolArray:
    """(m,) whether both positions of a match have at most `MAX_SHARED` partners."""
    unshared = np.ones(len(matched), np.bool_)
    for part in as_numbers(matched):
        _, index, counts = np.unique(part, return_inverse=True, return_counts=True)
        unshared &= counts[index.ravel()] <= MAX_SHARED
    return unshared


def count_distinct(matched: FloatArray) -> int:
    """Number of distinct positions of matches (m, 4), in the image that has fewer."""
    return min(len(np.unique(part)) for part in as_numbers(matched))


def as_numbers(matched: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """(m,) positions in both images of matches (m, 4), as complex numbers, which sort fast."""
    first, second = np.ascontiguousarray(matched).view(np.complex128).T
    return first, second


def scaled_homography(
    H: FloatArray, covariance: FloatArray | None
) -> tuple[FloatArray, FloatArray | None]:
    """A homography with the last entry 1, as OpenCV's, unless it is 0; and its covariance."""
    last = float(H[2, 2])
    if abs(last) < 1e-12 * float(np.linalg.norm(H)):
        return H, covariance
    scaled: FloatArray = H / last
    if covariance is None:
        return scaled, None
    J = (np.eye(9) - np.outer(scaled.ravel(), np.eye(9)[8])) / last
    return scaled, J @ covariance @ J.T


def position_sigma(keypoints: Keypoints) -> FloatArray:
    """(n,) standard deviation of the positions of keypoints, in pixels along each axis.

    One part is proportional to the scale. The other is due to noise of the image, and inversely
    proportional to the response. Both were fitted to the errors of SIFT's positions on known pairs.
    A response of 0, as of external points, means unknown, and only the scale counts.
    """
    scale, response = keypoints.size.astype(np.float64) / 2, keypoints.response.astype(np.float64)
    noise = np.divide(NOISE_ERROR, response, out=np.zeros(len(scale)), where=response > 0)
    sigma: FloatArray = np.maximum(np.hypot(SCALE_ERROR * scale, noise), MIN_KEYPOINT_SIGMA)
    return sigma
