"""Selection of the model of two views that matches support, by Torr's criterion.

A match is a point in the space of its four coordinates. A general motion confines it to a manifold
of three dimensions; a plane, a turn of the camera and no motion to one of two dimensions each.

Source: GRIC, the geometric robust information criterion; Torr (1998), *Geometric motion
segmentation and model selection*, Phil. Trans. R. Soc. A 356.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import exp, log
from typing import Literal, NamedTuple, TypeAlias

import cv2
import numpy as np

from saccade.io.image import quiet_opencv
from saccade.keypoints._two_view_kernels import KINDS
from saccade.keypoints._two_view_kernels import minimize as minimize_loss
from saccade.keypoints.two_view_fit import (
    CROSS,
    Residuals,
    homogeneous,
    normalization,
    project,
    residuals_of,
    robust_sigma,
    solved,
    squared_errors,
    whitening_of,
)
from saccade.types import BoolArray, FloatArray

Model: TypeAlias = Literal["general", "planar", "panoramic", "still", "watermark"]
"""Models of two views: any rigid scene, a plane, a camera that only turns, no motion, and unmoved
matches in a small part of the images."""

SPACE = 4
"""Number of coordinates of a match."""
CAP = 2.0
"""Largest squared residual of a match per free dimension, Torr's lambda 3."""
INLIER_SIGMAS = 3.0
"""Largest residual of an inlier in standard deviations."""
MIN_NOISE = 0.005
"""Smallest noise of the positions in pixels, for exact matches."""
MIN_PLANAR_FRACTION = 0.4
"""Fraction of matches near a homography below which no model with two dimensions can win: its
costs per match then exceed those of a general motion."""
NOISE_STEPS = 3
KEPT_VARIANCE = 0.9733
"""Variance of a standard normal variable that is at most `INLIER_SIGMAS`."""
DECISIVE = 10.0
"""Decrease of the criterion with which a general motion is preferred: twice the logarithm of a
Bayes factor that is very strong evidence (Kass & Raftery 1995). Few matches on a plane agree with
general motions too, and these may be far from the right one."""
DOMINANT = 0.8
"""Fraction of matches near a plane from which their residuals may raise the noise."""
MAX_FACTOR = 1.3
"""Largest ratio of that noise to the noise of the general model; with few matches, `INLIER_SIGMAS`
standard deviations of that noise."""
SEARCH_SIGMAS = 6.0
"""Tolerance of the search for a homography, in standard deviations of both positions."""
SEARCH_ITERATIONS = 300
POLISH_WIDTH = 1.2
"""Width of the Cauchy loss of a homography that is selected, in standard deviations, chosen among
.8, 1.2, 1.7 and 3 by planes with few matches."""
POLISH_STEPS = 5
"""Number of steps of least squares."""
SMALL_STEP = 1e-7
"""Change of a rotation, in radians, that ends the steps."""
SMALL_DECREASE = 1e-4
"""Relative decrease of the errors of a model that no longer matters to the selection."""
FOCAL_LENGTHS = np.geomspace(0.4, 5, 10)
"""Focal lengths from which a turn of an uncalibrated camera is fitted, in widths of the images."""
CENTER_SIGMA = 0.1
"""Standard deviation of the principal point about the middle of the keypoints, in widths."""
LOG_FOCAL_SIGMA = 0.8
"""Standard deviation of the logarithm of the focal length about the width of the images."""
PARAMETERS = {"still": 0, "turn": 3, "turn, uncalibrated": 6, "plane": 8}
"""Number of parameters of the models with two dimensions."""
GRID_CELLS = (4, 8, 16)
"""Cells per side of the grids that hold the keypoints. The finest is used that has no more cells
than there are inliers."""
MIRRORED = 0.8
"""Smallest fraction of the area of triangles that turn the other way round in a mirror."""
WATERMARK_CELLS = 0.3
"""Largest fraction of the cells with keypoints that a watermark covers."""


class Selection(NamedTuple):
    """The selected model."""

    model: Model
    homography: FloatArray | None = None
    """(3, 3) of a model with two dimensions, in the coordinates of the matches."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Matches of two views with their noise."""

    positions: FloatArray
    """(m, 4) rows x1, y1, x2, y2, in pixels or in the planes z = 1."""
    sigma: FloatArray
    """(m, 2) standard deviations of both positions."""
    pixel: FloatArray
    """(m, 2) sizes of a pixel at both positions."""

    def take(self, index: BoolArray) -> "Matches":
        """The matches of a mask."""
        return Matches(self.positions[index], self.sigma[index], self.pixel[index])

    def noisier(self, factor: float) -> "Matches":
        """The matches with all standard deviations times a factor."""
        return replace(self, sigma=self.sigma * factor)

    def squared(self, homography: FloatArray) -> FloatArray:
        """(m,) squared residuals of a homography in variances; infinite on its horizon."""
        return squared_errors(homography, self.positions, self.sigma)


def gric(squared: FloatArray, dimensions: int, parameters: int) -> float:
    """Geometric robust information criterion; the model with the least value is selected.

    Args:
        squared: (m,) squared residuals of the matches in variances.
        dimensions: of the manifold of the model.
        parameters: number of parameters of the model.
    """
    robust = np.minimum(squared, CAP * (SPACE - dimensions)).sum()
    m = max(len(squared), 1)
    return float(robust + m * dimensions * log(SPACE) + parameters * log(SPACE * m))


def noise_of(z: FloatArray, parameters: int) -> float:
    """Robust standard deviation of residuals of a fit: that of the inliers, by their number.

    Args:
        z: (m,) residuals, a few of wrong matches.
        parameters: number of parameters of the fit.
    """
    scale = robust_sigma(z) if len(z) else 0.0
    for _ in range(NOISE_STEPS):
        kept = z[np.abs(z) <= INLIER_SIGMAS * scale]
        if len(kept) <= parameters:
            break
        scale = float(np.sqrt((kept**2).sum() / (len(kept) - parameters) / KEPT_VARIANCE))
    return scale


def select_model(
    matches: Matches, general: FloatArray, parameters: int, *, calibrated: bool
) -> Selection:
    """The model that matches support.

    Args:
        matches: those near the general model or a homography; wrong ones may be among them.
        general: (m,) residuals of a general model in standard deviations.
        parameters: of the general model.
        calibrated: whether positions are in the planes z = 1 of the cameras.
    """
    none = Selection("general")
    found = search_homography(matches)
    if found is None:
        return none
    near = matches.squared(found) < INLIER_SIGMAS**2 * 2
    chosen = (np.abs(general) < INLIER_SIGMAS) | near
    if near.sum() < MIN_PLANAR_FRACTION * chosen.sum():
        return none
    matches, general = matches.take(chosen), general[chosen]
    plane = polished(found, matches)
    if near.sum() >= DOMINANT * chosen.sum():
        # A general model among wrong matches on a plane underestimates the noise.
        on_plane = np.sort(matches.squared(plane))[: int(near.sum())]
        freedom = max(len(general) - parameters, 1)
        limit = max(MAX_FACTOR, 1 + INLIER_SIGMAS / np.sqrt(2 * freedom))
        factor = float(np.clip(np.sqrt(on_plane.mean() / 2), 1, limit))
        matches, general = matches.noisier(factor), general / factor
    cost = gric(general**2, 3, parameters)
    candidates: list[tuple[Model, int, Callable[[], FloatArray]]] = [
        ("still", PARAMETERS["still"], lambda: np.eye(3)),
        ("planar", PARAMETERS["plane"], lambda: plane),
    ]
    if calibrated:
        candidates.append(("panoramic", PARAMETERS["turn"], lambda: rotation_of(matches)))
    costs = []
    for name, count, fit in candidates:
        model = fit()
        squared = matches.squared(model)
        if np.count_nonzero(squared < INLIER_SIGMAS**2 * 2) >= MIN_PLANAR_FRACTION * len(squared):
            costs.append((gric(squared, 2, count), name, model))
    least, name, model = min(costs, key=lambda each: each[0], default=(np.inf, "general", plane))
    if least >= cost + DECISIVE:
        return none
    if not calibrated and name == "planar":
        turn = uncalibrated_turn(plane, matches)
        if gric(matches.squared(turn), 2, PARAMETERS["turn, uncalibrated"]) < least:
            return Selection("panoramic", turn)
    return Selection(name, model)


def search_homography(matches: Matches) -> FloatArray | None:
    """(3, 3) homography of most matches, by sampling; None without one."""
    first = np.ascontiguousarray(matches.positions[:, :2])
    second = np.ascontiguousarray(matches.positions[:, 2:])
    if len(first) < SPACE:
        return None
    tolerance = SEARCH_SIGMAS * float(np.median(np.hypot(*matches.sigma.T)))
    try:
        with quiet_opencv():
            found, _ = cv2.findHomography(
                first, second, cv2.USAC_FAST, tolerance, maxIters=SEARCH_ITERATIONS
            )
    except cv2.error:
        return None
    return None if np.shape(found) != (3, 3) else np.asarray(found, np.float64)


def polished(homography: FloatArray, matches: Matches) -> FloatArray:
    """The homography after a few Gauss-Newton steps with the Cauchy loss."""
    T1, T2 = normalization(matches.positions[:, :2]), normalization(matches.positions[:, 2:])
    scaled = np.hstack([project(T1, matches.positions[:, :2]),
                        project(T2, matches.positions[:, 2:])])  # fmt: skip
    sigma = matches.sigma * [T1[0, 0], T2[0, 0]]
    model = T2 @ homography @ np.linalg.inv(T1)
    model /= np.linalg.norm(model)
    factors = np.stack([np.eye(3), model, np.eye(3)])
    scales = whitening_of(model, scaled, sigma)
    width, kind = POLISH_WIDTH, KINDS.index("homography")
    minimize_loss(kind, factors, scaled, scales, width, POLISH_STEPS, SMALL_DECREASE)
    model = factors[1]
    result: FloatArray = np.linalg.inv(T2) @ model @ T1
    return result


def rotation_of(matches: Matches) -> FloatArray:
    """Robust estimate of the rotation (3, 3) from rays of the first view to rays of the second.

    Args:
        matches: rays in the planes z = 1.

    Source: Kabsch (1976), with Cauchy weights.
    """
    rays = [homogeneous(matches.positions[:, part]) for part in (slice(2), slice(2, 4))]
    first, second = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in rays)
    noise = np.hypot(*matches.sigma.T)
    weight, R = 1 / noise**2, np.eye(3)
    for _ in range(POLISH_STEPS):
        before, R = R, nearest_rotation((second * weight[:, None]).T @ first)
        if np.abs(R - before).max() < SMALL_STEP:
            break
        gap = np.linalg.norm(second - first @ R.T, axis=1)
        width = max(robust_sigma(gap), 1e-12)
        weight = 1 / noise**2 / (1 + (gap / width) ** 2)
    return R


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """(..., 3, 3) rotations R with the largest trace of R' times a matrix."""
    U, _, Vt = np.linalg.svd(matrix)
    U[..., 2] *= np.linalg.det(U @ Vt)[..., None]
    R: FloatArray = U @ Vt
    return R


@dataclass(frozen=True, eq=False)
class TurningCamera:
    """A camera with square pixels of unknown focal length and principal point, which turned."""

    parameters: FloatArray
    """(3,) logarithm of the focal length, and principal point from `center`, in `width`s."""
    rotation: FloatArray
    """(3, 3)."""
    center: FloatArray
    """(2,) middle of the keypoints."""
    width: float
    """Width of the keypoints."""

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) camera matrix."""
        f, (x, y) = self.width * exp(self.parameters[0]), self.principal_point
        return np.array([[f, 0, x], [0, f, y], [0, 0, 1]])

    @property
    def principal_point(self) -> FloatArray:
        """(2,) in pixels."""
        point: FloatArray = self.center + self.width * self.parameters[1:]
        return point

    @property
    def homography(self) -> FloatArray:
        """(3, 3) from the first view to the second."""
        K = self.matrix
        turned: FloatArray = K @ self.rotation @ np.linalg.inv(K)
        return turned

    def derivatives(self) -> FloatArray:
        """(6, 9) derivatives of the homography by the parameters and by a rotation vector."""
        (x, y), H, K = self.principal_point, self.homography, self.matrix
        inner = np.zeros((3, 3, 3))  # derivatives of K times the inverse of K
        inner[0, :2] = [[1, 0, -x], [0, 1, -y]]
        inner[1, 0, 2] = inner[2, 1, 2] = self.width
        by_rotation = K @ CROSS @ (self.rotation @ np.linalg.inv(K))
        return np.concatenate([inner @ H - H @ inner, by_rotation]).reshape(6, 9)

    def moved(self, step: FloatArray) -> "TurningCamera":
        """The camera after a change (6,) of the parameters and by a rotation vector."""
        turn = np.asarray(cv2.Rodrigues(step[3:])[0], np.float64)
        return replace(self, parameters=self.parameters + step[:3], rotation=turn @ self.rotation)


def uncalibrated_turn(plane: FloatArray, matches: Matches) -> FloatArray:
    """(3, 3) homography of a turning camera of unknown focal length and principal point.

    Both views are taken to be of one camera with square pixels. Its focal length and principal
    point are estimated with a prior: the middle of the keypoints, and their width.

    Args:
        plane: (3, 3) homography of the matches without constraints.
        matches: in pixels.
    """
    xy = matches.positions.reshape(-1, 2)
    low, high = xy.min(axis=0), xy.max(axis=0)
    near = matches.take(matches.squared(plane) < INLIER_SIGMAS**2 * 2)
    if len(near.positions) < SPACE:
        return plane
    first = first_turn(plane, near, (low + high) / 2, float((high - low).max()))
    residuals = residuals_of("homography", plane, near.positions, near.sigma)
    return least_squares(first, residuals).homography


def first_turn(
    plane: FloatArray, matches: Matches, center: FloatArray, width: float
) -> TurningCamera:
    """The camera of one of `FOCAL_LENGTHS` whose turn is nearest to a homography.

    Args:
        plane: (3, 3) homography.
        matches: its inliers, in pixels.
        center: (2,) see `TurningCamera`.
        width: the same.
    """
    start = TurningCamera(np.zeros(3), np.eye(3), center, width)
    starts = [replace(start, parameters=np.array([log(f), 0, 0])) for f in FOCAL_LENGTHS]
    K = np.array([each.matrix for each in starts])
    back = np.linalg.inv(K)
    R = nearest_rotation(back @ plane @ K)
    rows = (K @ R @ back) @ homogeneous(matches.positions[:, :2]).T  # (s, 3, m)
    with np.errstate(all="ignore"):
        gap = rows[:, :2] / rows[:, 2:] - matches.positions[:, 2:].T
    variance = (matches.sigma**2).sum(axis=1)
    best = int(np.argmin(np.nan_to_num((gap**2 / variance).sum(axis=(1, 2)), nan=np.inf)))
    return replace(starts[best], rotation=R[best])


def least_squares(camera: TurningCamera, residuals: Residuals) -> TurningCamera:
    """The camera with least squared residuals and prior, by Levenberg and Marquardt's steps."""
    by_prior = np.eye(3, 6) / [[LOG_FOCAL_SIGMA], [CENTER_SIGMA], [CENTER_SIGMA]]

    def stacked(each: TurningCamera) -> tuple[FloatArray, FloatArray]:
        """Residuals, those of the prior last, and their derivatives."""
        z, by_entries = residuals(each.homography)
        J = by_entries.reshape(-1, 9) @ each.derivatives().T
        prior = by_prior[:, :3] @ each.parameters
        return np.concatenate([z.ravel(), prior]), np.concatenate([J, by_prior])

    damping, (z, J) = 1e-3, stacked(camera)
    for _ in range(2 * POLISH_STEPS):
        A = J.T @ J
        trial = camera.moved(solved(A + damping * np.diag(np.diag(A)), -J.T @ z))
        moved, derivatives = stacked(trial)
        decrease, cost = float(z @ z - moved @ moved), float(z @ z)
        if decrease > 0:
            camera, z, J, damping = trial, moved, derivatives, damping / 10
        else:
            damping *= 10
        if 0 <= decrease <= SMALL_DECREASE * cost:
            break
    return camera


def seems_mirrored(inliers: FloatArray) -> bool:
    """Whether triangles of matches turn the other way round in the second image, by their areas.

    Args:
        inliers: (m, 4) rows x1, y1, x2, y2.
    """
    corners = inliers[: len(inliers) // 3 * 3].reshape(-1, 3, 2, 2)
    sides = corners[:, 1:] - corners[:, :1]  # (t, 2 sides, 2 images, 2)
    first, second = np.linalg.det(sides.transpose(2, 0, 1, 3))
    areas = np.sqrt(np.abs(first * second))
    return bool(areas[first * second < 0].sum() > MIRRORED * areas.sum())


def is_watermark(inliers: FloatArray, keypoints: FloatArray) -> bool:
    """Whether unmoved matches lie in a small part of the images, as of a caption or time stamp.

    Args:
        inliers: (k, 2) positions of the matches.
        keypoints: (n, 2) positions of all keypoints of both images.
    """
    low = keypoints.min(axis=0)
    span = np.maximum(keypoints.max(axis=0) - low, 1e-9)
    side = max((each for each in GRID_CELLS if each**2 <= len(inliers)), default=GRID_CELLS[0])

    def cells(xy: FloatArray) -> int:
        x, y = np.minimum((xy - low) / span * side, side - 1).astype(np.int64).T
        return len(np.unique(y * side + x))

    return cells(inliers) <= WATERMARK_CELLS * cells(keypoints)
