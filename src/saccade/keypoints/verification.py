"""Which matches agree with one geometry: a fundamental matrix or a homography."""

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError, require
from saccade.image import quiet_opencv
from saccade.types import FloatArray, IntArray, Keypoints, check_pairs

BoolArray: TypeAlias = npt.NDArray[np.bool_]
Geometry: TypeAlias = Literal["fundamental", "homography"]

SAMPLE = {"fundamental": 7, "homography": 4}
"""Places that fix each geometry."""
CONFIDENCE = 0.9999
ITERATIONS = 10_000


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """What matches say about two views."""

    geometry: Geometry
    """Of what kind `matrix` is."""
    matrix: FloatArray | None
    """(3, 3). A homography takes homogeneous (x, y, 1) of the first image to the second; a
    fundamental matrix F holds x2' F x1 = 0. None where too few matches agree."""
    inliers: BoolArray
    """(m,) which matches agree with it; none of them where it is None."""

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
    least: int = 15,
) -> Verification:
    """Find the geometry that most matches agree with, and which do.

    A fundamental matrix holds for any rigid scene, but only binds a point to a line. A
    homography binds it to a point; it holds for a plane, or for a camera that only turns.

    Args:
        first: points of the first image.
        second: of the second.
        pairs: (m, 2) indices into both, as `match` gives them.
        geometry: "fundamental" or "homography".
        tolerance: pixels by which a match may miss; over 0.
        least: places that must agree, since the few that fix a geometry always do. COLMAP
            asks for as many.

    Returns:
        The same for the same matches, in whatever order they come. Points that share a place
        and differ in their angle count once.

    Raises:
        ConfigError: another geometry, or a tolerance that is not over 0.
        KeypointsError: pairs that are none, or places that are not finite.

    Source: OpenCV's USAC with the score of MAGSAC++; Barath et al. (2020).
    """
    require(geometry in SAMPLE, "geometry", "fundamental or homography", geometry)
    require(0 < tolerance < np.inf, "tolerance", "pixels over 0", tolerance)
    check_pairs(pairs, (len(first), len(second)), "pairs")
    matched = np.hstack([first.xy[pairs[:, 0]], second.xy[pairs[:, 1]]]).astype(np.float64)
    if not np.isfinite(matched).all():
        raise KeypointsError("keypoints: expected finite places, found NaN or infinity")
    places, row = np.unique(matched, axis=0, return_inverse=True)
    matrix, agree = estimate(places, geometry, tolerance)
    if matrix is None or agree.sum() < least:
        return Verification(geometry, None, np.zeros(len(pairs), np.bool_))
    return Verification(geometry, matrix, agree[row.ravel()])


def estimate(
    places: FloatArray, geometry: Geometry, tolerance: float
) -> tuple[FloatArray | None, BoolArray]:
    """The (3, 3) matrix of (m, 4) rows x1, y1, x2, y2, and (m,) which rows agree with it."""
    none = np.zeros(len(places), np.bool_)
    if len(places) < SAMPLE[geometry]:
        return None, none
    first, second = np.ascontiguousarray(places[:, :2]), np.ascontiguousarray(places[:, 2:])
    try:
        with quiet_opencv():
            found, mask = _robust(first, second, geometry, tolerance)
    except cv2.error:  # an assertion fails in some versions where no sample gives a model
        return None, none
    if np.shape(found) != (3, 3):  # None where every sample is degenerate
        return None, none
    return np.asarray(found, np.float64), np.asarray(mask).ravel() != 0


def _robust(
    first: FloatArray, second: FloatArray, geometry: Geometry, tolerance: float
) -> tuple[Any, Any]:
    method = cv2.USAC_MAGSAC
    if geometry == "homography":
        return cv2.findHomography(
            first, second, method, tolerance, maxIters=ITERATIONS, confidence=CONFIDENCE
        )
    return cv2.findFundamentalMat(first, second, method, tolerance, CONFIDENCE, ITERATIONS)
