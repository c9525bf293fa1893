"""Geometric verification of matches by a fundamental or essential matrix, or a homography."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from saccade.errors import KeypointsError, require
from saccade.io.image import quiet_opencv
from saccade.keypoints.two_view_fit import (
    Fit,
    Geometry,
    homogeneous,
    project,
    projection_derivatives,
    refine,
    residuals_of,
    sampson_distances,
)
from saccade.types import BoolArray, FloatArray, IntArray, Keypoints, check_pairs

SAMPLE_SIZE = {"fundamental": 7, "homography": 4, "essential": 5}
"""Correspondences that determine each geometry."""
CONFIDENCE = 0.9999
MAX_ITERATIONS = 10_000
REFINED_TOLERANCES = 2.0
"""Largest error of a match in the refinement, in tolerances: the Cauchy loss discounts wrong
matches, and inliers missed by the first estimate are recovered."""
REFINEMENTS = {"fundamental": 2, "homography": 1, "essential": 2}
"""Number of rounds of refinement. The second excludes matches beyond `REFINED_SIGMAS`, since wrong
matches near an epipolar line bias the estimate; a homography has few of these, and gets worse."""
REFINED_SIGMAS = 3.5
"""Largest residual of a match in the second round, in robust standard deviations."""
MIN_SIGMA = 0.02
"""Smallest error of a position, in pixels."""
SCALE_ERROR = 0.064
"""Error of a position in each axis, in scales of its keypoint."""
NOISE_ERROR = 0.0028
"""Error of a position in pixels due to the noise of the image, times |D|."""

CROSS = np.cross(np.eye(3), np.eye(3)[:, None])
"""(3, 3, 3) matrices of the cross products with the unit vectors."""


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Pose of the second camera: a point X of the first one's frame is `rotation` X + translation.

    The frames of cameras are x right, y down, z ahead.
    """

    rotation: FloatArray
    """(3, 3)."""
    translation: FloatArray
    """(3,) of length 1, since two images do not determine the distance."""
    covariance: FloatArray | None
    """(6, 6) of the rotation vector, in radians along the axes of the second camera, and of
    `translation`; None where the matches do not determine it. Errors of the calibration are not
    in it."""

    @property
    def rotation_sigma(self) -> float:
        """Standard deviation of the rotation in degrees; infinite if unknown."""
        return self._sigma(slice(3))

    @property
    def direction_sigma(self) -> float:
        """Standard deviation of the translation's direction in degrees; infinite if unknown."""
        return self._sigma(slice(3, 6))

    def _sigma(self, rows: slice) -> float:
        if self.covariance is None:
            return float("inf")
        return float(np.degrees(np.sqrt(np.trace(self.covariance[rows, rows]))))


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """The geometry of two views, and the matches that are consistent with it."""

    geometry: Geometry
    """Kind of `matrix`."""
    matrix: FloatArray | None
    """(3, 3), whose properties by kind are `F`, `E` and `H`; None where there are too few
    inliers."""
    inliers: BoolArray
    """(m,) which matches are consistent with it; all false without a matrix."""
    covariance: FloatArray | None = None
    """(9, 9) of the entries of `matrix`, row by row, at its norm; None where the matches do not
    determine it, and in stored runs."""
    pose: RelativePose | None = None
    """Pose of the second camera, for an essential matrix."""

    @property
    def F(self) -> FloatArray | None:  # noqa: N802
        """(3, 3) fundamental matrix, x2' F x1 = 0 in homogeneous pixels (x, y, 1)."""
        return self.matrix if self.geometry == "fundamental" else None

    @property
    def E(self) -> FloatArray | None:  # noqa: N802
        """(3, 3) essential matrix, x2' E x1 = 0 in the planes z = 1 of the cameras."""
        return self.matrix if self.geometry == "essential" else None

    @property
    def H(self) -> FloatArray | None:  # noqa: N802
        """(3, 3) homography from (x, y, 1) in the first image to the second."""
        return self.matrix if self.geometry == "homography" else None

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
        return (
            f"Verification({self.geometry}: "
            f"{self.inliers.sum()} of {len(self.inliers)} matches agree)"
        )


def verify(
    first: Keypoints,
    second: Keypoints,
    pairs: IntArray,
    geometry: Geometry = "fundamental",
    tolerance: float = 2.0,
    min_inliers: int = 15,
    intrinsics: FloatArray | None = None,
) -> Verification:
    """Estimate the geometry of two views from matches, with its covariance and inliers.

    MAGSAC's estimate is refined by robust least squares, in which each match weighs as much as
    the positions of its keypoints are exact (see `position_sigma`).

    A fundamental matrix holds for any rigid scene, but only constrains a keypoint to a line. A
    homography constrains it to a point; it holds for a plane, or for a camera that only rotates. An
    essential matrix is the fundamental matrix of a calibrated camera, and gives its relative pose.

    Args:
        first: keypoints of the first image.
        second: of the second.
        pairs: (m, 2) indices into both, as `match` returns them.
        geometry: "fundamental", "homography" or "essential".
        tolerance: inlier threshold in pixels, over 0.
        min_inliers: smallest number of distinct inliers of an accepted geometry; COLMAP's default
            is the same.
        intrinsics: (3, 3) camera matrix of both images without distortion, for "essential".

    Returns:
        The same for the same matches in any order. Keypoints that share a position and differ in
        their angle count once.

    Raises:
        ConfigError: another geometry, a tolerance that is not over 0, or an essential matrix
            without intrinsics.
        KeypointsError: pairs that are not indices, or positions that are not finite.

    Source: OpenCV's USAC with the score of MAGSAC++; Barath et al. (2020).
    """
    require(geometry in SAMPLE_SIZE, "geometry", " or ".join(SAMPLE_SIZE), geometry)
    require(0 < tolerance < np.inf, "tolerance", "pixels over 0", tolerance)
    check_pairs(pairs, (len(first), len(second)), "pairs")
    matched = np.hstack([first.xy[pairs[:, 0]], second.xy[pairs[:, 1]]]).astype(np.float64)
    if not np.isfinite(matched).all():
        raise KeypointsError("keypoints: expected finite positions, found NaN or infinity")
    sigma = np.stack([position_sigma(first)[pairs[:, 0]], position_sigma(second)[pairs[:, 1]]], 1)
    return verify_positions(matched, sigma, geometry, tolerance, min_inliers, intrinsics)


def verify_positions(
    matched: FloatArray,
    sigma: FloatArray,
    geometry: Geometry,
    tolerance: float,
    min_inliers: int,
    intrinsics: FloatArray | None = None,
) -> Verification:
    """`verify` of (m, 4) rows x1, y1, x2, y2 and (m, 2) standard deviations of both positions."""
    if geometry == "essential":  # in the planes z = 1
        K = np.zeros(0) if intrinsics is None else np.asarray(intrinsics, np.float64)
        require(K.shape == (3, 3), "intrinsics", "a (3, 3) camera matrix", intrinsics)
        focal, inverse = np.sqrt(K[0, 0] * K[1, 1]), np.asarray(np.linalg.inv(K), np.float64)
        matched = np.hstack([project(inverse, matched[:, :2]), project(inverse, matched[:, 2:])])
        sigma, tolerance = sigma / focal, tolerance / focal
    none = Verification(geometry, None, np.zeros(len(matched), np.bool_))
    matched, row = np.unique(matched, axis=0, return_inverse=True)
    smallest = np.full((len(matched), 2), np.inf)
    np.minimum.at(smallest, row.ravel(), sigma)
    matrix, inliers = sample_consensus(matched, geometry, tolerance)
    if matrix is None or inliers.sum() < min_inliers:
        return none
    fit = refine_repeatedly(matrix, geometry, matched, smallest, tolerance)
    if fit is not None:
        matrix = fit.matrix
        inliers = match_errors(matrix, geometry, matched) < tolerance
    if inliers.sum() < min_inliers:
        return none
    covariance = None if fit is None else fit.covariance
    pose = pose_of(matrix, matched[inliers], covariance) if geometry == "essential" else None
    return Verification(geometry, matrix, inliers[row.ravel()], covariance, pose)


def position_sigma(keypoints: Keypoints) -> FloatArray:
    """(n,) standard deviation of the positions of keypoints, in pixels along each axis.

    One part is proportional to the scale. The other is due to noise of the image, and inversely
    proportional to the response. Both were fitted to the errors of SIFT's positions on known pairs.
    A response of 0, as of external points, means unknown, and only the scale counts.
    """
    scale, response = keypoints.size.astype(np.float64) / 2, keypoints.response.astype(np.float64)
    noise = np.divide(NOISE_ERROR, response, out=np.zeros(len(scale)), where=response > 0)
    sigma: FloatArray = np.maximum(np.hypot(SCALE_ERROR * scale, noise), MIN_SIGMA)
    return sigma


def refine_repeatedly(
    matrix: FloatArray,
    geometry: Geometry,
    matched: FloatArray,
    sigma: FloatArray,
    tolerance: float,
) -> Fit | None:
    """The model refined by the matches near it, and again by those near the refined one."""
    near = match_errors(matrix, geometry, matched) < REFINED_TOLERANCES * tolerance
    fit: Fit | None = None
    for _ in range(REFINEMENTS[geometry]):
        if near.sum() <= SAMPLE_SIZE[geometry]:
            break
        better = refine(matrix, geometry, matched[near], sigma[near])
        if better is None:
            break
        fit, matrix = better, better.matrix
        near = match_errors(matrix, geometry, matched) < REFINED_TOLERANCES * tolerance
        z, _ = residuals_of(geometry, matrix, matched, sigma)(matrix)
        near &= np.linalg.norm(z, axis=1) <= REFINED_SIGMAS * fit.scale
    return fit


def match_errors(matrix: FloatArray, geometry: Geometry, matched: FloatArray) -> FloatArray:
    """(m,) errors of matches: in the second image of a homography, else from epipolar lines.

    They are infinite where rays of calibrated cameras do not meet in front of both.
    """
    if geometry == "homography":
        gap = project(matrix, matched[:, :2]) - matched[:, 2:]
        errors: FloatArray = np.nan_to_num(np.hypot(*gap.T), nan=np.inf)
        return errors
    distances: FloatArray = np.abs(sampson_distances(matrix, matched))
    if geometry == "essential":
        pose = pose_of(matrix, matched)
        distances[~in_front(pose.rotation, pose.translation, matched)] = np.inf
    return distances


def sample_consensus(
    matched: FloatArray, geometry: Geometry, tolerance: float
) -> tuple[FloatArray | None, BoolArray]:
    """MAGSAC's (3, 3) matrix of (m, 4) rows x1, y1, x2, y2, and (m,) which are inliers."""
    none = np.zeros(len(matched), np.bool_)
    if len(matched) < SAMPLE_SIZE[geometry]:
        return None, none
    first, second = np.ascontiguousarray(matched[:, :2]), np.ascontiguousarray(matched[:, 2:])
    names: dict[str, Any] = {"method": cv2.USAC_MAGSAC, "maxIters": MAX_ITERATIONS}
    try:
        with quiet_opencv():
            if geometry == "essential":
                names |= {"prob": CONFIDENCE, "threshold": tolerance}
                matrix, mask = cv2.findEssentialMat(first, second, np.eye(3), **names)
            else:
                names |= {"confidence": CONFIDENCE, "ransacReprojThreshold": tolerance}
                find: Any = cv2.findHomography
                find = cv2.findFundamentalMat if geometry == "fundamental" else find
                matrix, mask = find(first, second, **names)
    except cv2.error:  # an assertion fails in some versions where no sample gives a model
        return None, none
    if np.shape(matrix) != (3, 3):  # None where every sample is degenerate
        return None, none
    return np.asarray(matrix, np.float64), np.asarray(mask).ravel() != 0


def pose_of(
    essential: FloatArray, rays: FloatArray, covariance: FloatArray | None = None
) -> RelativePose:
    """The pose of an essential matrix that has most points in front of both cameras.

    Args:
        essential: (3, 3).
        rays: (m, 4) rows x1, y1, x2, y2, points in the planes z = 1 of the cameras.
        covariance: (9, 9) of the entries of `essential`, row by row.
    """
    *rotations, t = (np.asarray(each, float) for each in cv2.decomposeEssentialMat(essential))
    poses = [(R, sign * t.ravel()) for R in rotations for sign in (1, -1)]
    R, t = max(poses, key=lambda pose: int(in_front(pose[0], pose[1], rays).sum()))
    if covariance is None:
        return RelativePose(R, t, None)
    cross = np.tensordot(t, CROSS, 1)  # E is [t]x R times a scale
    scale = (cross @ R * essential).sum() / 2
    by_rotation = cross @ CROSS @ R  # (3, 3, 3)
    by_translation = np.tensordot(np.eye(3) - np.outer(t, t), CROSS @ R, 1)
    J = np.linalg.pinv(scale * np.concatenate([by_rotation, by_translation]).reshape(6, 9).T)
    return RelativePose(R, t, J @ covariance @ J.T)


def in_front(R: FloatArray, t: FloatArray, rays: FloatArray) -> BoolArray:
    """(m,) whether the rays of matches meet in front of both cameras, in a pose (R, t)."""
    first, second = homogeneous(rays[:, :2]) @ R.T, homogeneous(rays[:, 2:])
    normal = np.cross(first, second)
    # a first + t = b second, solved by products with the two rays.
    a = -(np.cross(t, second) * normal).sum(axis=1)
    b = -(np.cross(t, first) * normal).sum(axis=1)
    ahead: BoolArray = (a > 0) & (b > 0)
    return ahead
