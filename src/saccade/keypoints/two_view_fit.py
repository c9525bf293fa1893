"""Robust least-squares fit of a two-view geometry, with its covariance."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from saccade.keypoints._two_view_kernels import (
    KINDS,
    fill_epipolar,
    fill_transfer,
    fill_whitening,
)
from saccade.keypoints._two_view_kernels import minimize as minimize_loss
from saccade.types import FloatArray

Geometry: TypeAlias = Literal["fundamental", "homography", "essential"]
Residuals: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Function of a (3, 3) matrix: (m, c) residuals and their (m, c, 9) derivatives."""

CROSS = np.cross(np.eye(3), np.eye(3)[:, None])
"""(3, 3, 3) matrices of the cross products with the unit vectors."""
CAUCHY_WIDTH = 1.0
"""Width of the Cauchy loss in robust standard deviations, chosen among 1, 2 and 3 by the
homographies of synthetic pairs."""
NORMAL_MAD = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""
MAX_CONDITION = 1e14
"""Largest condition number of the information of matches that determine a model."""
MIN_FREEDOM = 0.05
"""Lower bound of one minus the leverage in the jackknife."""
MAX_FIT_STEPS = 50
"""Largest number of Gauss-Newton steps, halved ones included."""
MIN_LOSS_DECREASE = 1e-6
"""Smallest relative decrease of the loss before the fit has converged."""


def _complement(*normals: FloatArray) -> FloatArray:
    """(k, 3, 3) orthonormal basis of the matrices that are orthogonal to n of them, k = 9 - n."""
    basis, _ = np.linalg.qr(np.reshape(normals, (-1, 9)).T, mode="complete")
    directions: FloatArray = basis[:, len(normals) :].T.reshape(-1, 3, 3)
    return directions


OFF_DIAGONAL = np.eye(9)[[1, 2, 3, 5, 6, 7]].reshape(-1, 3, 3)
"""Directions in which a fundamental matrix can move, in the bases of its singular vectors; one more
changes the ratio of its singular values."""
ESSENTIAL_DIRECTIONS = _complement(
    *(np.diag(d) for d in np.eye(3)), np.eye(3)[[1, 0, 2]] * [1, 1, 0]
)
"""Directions in which an essential matrix can move: its singular values stay equal."""


class Fit(NamedTuple):
    """A refined model."""

    matrix: FloatArray
    """(3, 3), of the norm of the initial one."""
    covariance: FloatArray
    """(9, 9) of its entries, row by row."""
    scale: float
    """Robust standard deviation of the residuals, which are in units of `sigma`."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """A matrix with the least Cauchy loss, in normalized coordinates."""

    matrix: FloatArray
    """(3, 3), of the norm of the initial one, in the coordinates of the matches."""
    scale: float
    """See `Fit`."""
    model: FloatArray
    """(3, 3) of unit norm."""
    back: tuple[FloatArray, FloatArray]
    """(3, 3) factors before and after `model` that undo the normalization."""
    geometry: Geometry
    width: float
    """Width of the loss."""
    z: FloatArray
    """(m, c) residuals."""
    J: FloatArray
    """(m, c, 9) their derivatives."""

    def with_covariance(self) -> Fit | None:
        """The model with its covariance; None where the matches do not determine it."""
        if self.scale == 0 or not np.isfinite(self.matrix).all():
            return Fit(self.matrix, np.zeros((9, 9)), 0.0) if self.scale == 0 else None
        directions = tangents(self.model, self.geometry)
        covariance = _m_estimate_covariance(self.J @ directions.T, self.z, self.width)
        if covariance is None:
            return None
        moves = (self.back[0] @ directions.reshape(-1, 3, 3) @ self.back[1]).reshape(-1, 9)
        length = float(np.linalg.norm(self.back[0] @ self.model @ self.back[1]))
        norm = float(np.linalg.norm(self.matrix))
        unit = self.matrix.ravel() / norm
        J = norm / length * (moves - np.outer(moves @ unit, unit)).T  # (9, k)
        return Fit(self.matrix, J @ covariance @ J.T, self.scale)


def refine(
    matrix: FloatArray, geometry: Geometry, matched: FloatArray, sigma: FloatArray
) -> Fit | None:
    """Maximum-likelihood model of matches whose errors are Gaussian, but for some wrong ones.

    The loss is Cauchy's. Its width follows the residuals, so that only the proportions of `sigma`
    matter. The covariance follows the residuals as they are found, each with its leverage: a wrong
    match that lies near its epipolar line often seems near to the camera, and turns the model.

    Args:
        matrix: (3, 3) initial model.
        geometry: its kind.
        matched: (m, 4) rows x1, y1, x2, y2, more than the model has parameters.
        sigma: (m, 2) standard deviations along each axis of both positions.

    Returns:
        The model, or None where the matches do not determine it.

    Source: Hartley & Zisserman (2004), sections 4.2 and 11.4.
    """
    found = minimize(matrix, geometry, matched, sigma)
    return None if found is None else found.with_covariance()


def minimize(
    matrix: FloatArray,
    geometry: Geometry,
    matched: FloatArray,
    sigma: FloatArray,
    min_decrease: float = MIN_LOSS_DECREASE,
) -> Minimum | None:
    """The model of `refine`, without its covariance.

    Args:
        matrix: see `refine`.
        geometry: see `refine`.
        matched: see `refine`.
        sigma: see `refine`.
        min_decrease: relative decrease of the loss that ends the steps.
    """
    T1, T2 = normalization(matched[:, :2]), normalization(matched[:, 2:])
    if geometry == "essential":  # its singular values are equal in these coordinates alone
        T1 = T2 = np.eye(3)
    inverse1, inverse2 = np.linalg.inv([T1, T2])
    forth = (T2, inverse1) if geometry == "homography" else (inverse2.T, inverse1)
    back = (inverse2, T1) if geometry == "homography" else (T2.T, T1)
    zoom = np.repeat([T1[0, 0], T2[0, 0]], 2)
    matched = matched * zoom + np.concatenate([T1[:2, 2], T2[:2, 2]])
    sigma = sigma * [T1[0, 0], T2[0, 0]]
    initial = nearest_model(forth[0] @ matrix @ forth[1], geometry)
    residuals = residuals_of(geometry, initial, matched, sigma)
    z, J = residuals(initial)
    scale = robust_sigma(z)
    if np.isnan(scale):  # a match on the horizon of a homography
        return None
    width = CAUCHY_WIDTH * scale
    if scale == 0:  # exact matches
        return Minimum(matrix, 0.0, initial, back, geometry, width, z, J)
    scales = whitening_of(initial, matched, sigma) if geometry == "homography" else sigma
    factors = factors_of(initial, geometry)
    minimize_loss(
        KINDS.index(geometry), factors, matched, scales, width, MAX_FIT_STEPS, min_decrease
    )
    model = factors[0] @ factors[1] @ factors[2].T
    z, J = residuals(model)
    refined = back[0] @ model @ back[1]
    refined *= np.linalg.norm(matrix) / np.linalg.norm(refined)
    return Minimum(refined, robust_sigma(z), model, back, geometry, width, z, J)


def factors_of(model: FloatArray, geometry: Geometry) -> FloatArray:
    """(3, 3, 3) factors U, K and V of a model U K V', as the kernel of `minimize` takes them."""
    if geometry == "homography":
        return np.stack([np.eye(3), model, np.eye(3)])
    U, (first, second, _), Vt = np.linalg.svd(model)
    left, right = U * [1, 1, np.linalg.det(U)], Vt.T * [1, 1, np.linalg.det(Vt)]
    return np.stack([left, np.diag([first, second, 0]), right])


def robust_sigma(z: FloatArray) -> float:
    """Standard deviation of Gaussian residuals, from the median of their absolute values."""
    sizes = np.abs(z).ravel()
    middle = len(sizes) // 2, (len(sizes) - 1) // 2
    sizes.partition(middle)
    return NORMAL_MAD * float(sizes[middle[0]] + sizes[middle[1]]) / 2


def solved(A: FloatArray, b: FloatArray) -> FloatArray:
    """Solution of a symmetric system; the shortest of least squares where it is singular."""
    try:
        return np.asarray(np.linalg.solve(A, b), np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(A, b)[0], np.float64)


def tangents(model: FloatArray, geometry: Geometry) -> FloatArray:
    """(k, 9) orthonormal directions in which a matrix of a geometry and of unit norm can move."""
    if geometry == "homography":
        return _complement(model).reshape(-1, 9)
    U, values, Vt = np.linalg.svd(model)
    directions = ESSENTIAL_DIRECTIONS
    if geometry == "fundamental":
        along = np.diag([-values[1], values[0], 0]) / np.hypot(values[0], values[1])
        directions = np.concatenate([OFF_DIAGONAL, along[None]])
    moves: FloatArray = (U @ directions @ Vt).reshape(-1, 9)
    return moves


def nearest_model(matrix: FloatArray, geometry: Geometry) -> FloatArray:
    """(3, 3) matrix of a geometry, of unit norm, near another matrix."""
    if geometry != "homography":
        U, (first, second, _), Vt = np.linalg.svd(matrix)
        values = (1, 1) if geometry == "essential" else (first, second)
        matrix = U[:, :2] * values @ Vt[:2]
    nearest: FloatArray = matrix / np.linalg.norm(matrix)
    return nearest


def _m_estimate_covariance(J: FloatArray, z: FloatArray, width: float) -> FloatArray | None:
    """(k, k) covariance of an estimate by Cauchy's loss; None where it is singular.

    Args:
        J: (m, c, k) derivatives of the residuals.
        z: (m, c) residuals of the matches.
        width: of the loss.

    Source: White's sandwich with the residuals of a jackknife, HC3 of MacKinnon & White (1985), of
    the scores of an M-estimate; Huber & Ronchetti (2009), section 7.6.
    """
    k, loss = J.shape[-1], 1 + (z / width) ** 2
    slope = float(((2 - loss) / loss**2).mean())
    information = np.tensordot(J, J, ((0, 1), (0, 1)))
    if z.size <= k or slope <= 0 or np.linalg.cond(information) > MAX_CONDITION:
        return None
    inverse = np.linalg.inv(information)
    leverage = (J @ inverse * J).sum(axis=2)
    influence = z / loss / np.maximum(1 - leverage, MIN_FREEDOM)
    scores = np.einsum("mc,mcj->mj", influence, J)
    covariance: FloatArray = inverse @ scores.T @ scores @ inverse / slope**2
    return covariance


def residuals_of(
    geometry: Geometry, matrix: FloatArray, matched: FloatArray, sigma: FloatArray
) -> Residuals:
    """Residuals of models near one in standard deviations; c = 2 for homographies, else 1.

    Args:
        geometry: kind of the models.
        matrix: (3, 3) model that transfers the errors in the first image to the second.
        matched: (m, 4) rows x1, y1, x2, y2.
        sigma: (m, 2) standard deviations of both positions.
    """
    matched, sigma, m = np.ascontiguousarray(matched), np.ascontiguousarray(sigma), len(matched)
    if geometry != "homography":

        def distances(model: FloatArray) -> tuple[FloatArray, FloatArray]:
            z, J = np.empty((m, 1)), np.empty((m, 1, 9))
            fill_epipolar(np.ascontiguousarray(model), matched, sigma, z, J)
            return z, J

        return distances
    whitening = whitening_of(matrix, matched, sigma)

    def errors(model: FloatArray) -> tuple[FloatArray, FloatArray]:
        z, J = np.empty((m, 2)), np.empty((m, 2, 9))
        fill_transfer(np.ascontiguousarray(model), matched, whitening, z, J)
        return z, J

    return errors


def whitening_of(homography: FloatArray, matched: FloatArray, sigma: FloatArray) -> FloatArray:
    """(m, 3) factors of the errors in the second image; see `fill_whitening`."""
    whitening = np.empty((len(matched), 3))
    fill_whitening(np.ascontiguousarray(homography), matched, sigma, whitening)
    return whitening


def squared_errors(homography: FloatArray, matched: FloatArray, sigma: FloatArray) -> FloatArray:
    """(m,) squared residuals of a homography in variances; infinite on its horizon."""
    matched, sigma = np.ascontiguousarray(matched), np.ascontiguousarray(sigma)
    z, J = np.empty((len(matched), 2)), np.empty((0, 2, 9))
    whitening = whitening_of(homography, matched, sigma)
    fill_transfer(np.ascontiguousarray(homography), matched, whitening, z, J)
    total: FloatArray = np.einsum("mc,mc->m", z, z)
    total[np.isnan(total)] = np.inf
    return total


def homogeneous(xy: FloatArray) -> FloatArray:
    """(n, 3) homogeneous coordinates of (n, 2) points."""
    rows = np.ones((len(xy), 3))
    rows[:, :2] = xy
    return rows


def project(homography: FloatArray, xy: FloatArray) -> FloatArray:
    """Projects (n, 2) points by a (3, 3) homography; points at infinity are not finite."""
    rows = homogeneous(xy) @ homography.T  # (n, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        projected: FloatArray = rows[:, :2] / rows[:, 2:]
    return projected


def homogeneous_derivatives(homography: FloatArray, xy: FloatArray) -> FloatArray:
    """(n, 2, 3) derivatives of the projection by its homogeneous coordinates."""
    x, y, depth = (homogeneous(xy) @ homography.T).T
    derivatives = np.zeros((len(xy), 2, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        derivatives[:, 0, 0] = derivatives[:, 1, 1] = 1 / depth
        derivatives[:, 0, 2] = -x / depth**2
        derivatives[:, 1, 2] = -y / depth**2
    return derivatives


def projection_derivatives(homography: FloatArray, xy: FloatArray) -> FloatArray:
    """(n, 2, 9) derivatives of the projection by the entries of the homography, row by row."""
    by_rows = homogeneous_derivatives(homography, xy)[:, :, :, None]
    derivatives: FloatArray = (by_rows * homogeneous(xy)[:, None, None]).reshape(len(xy), 2, 9)
    return derivatives


def sampson_distances(
    matrix: FloatArray, matched: FloatArray, sigma: FloatArray | float = 1.0
) -> FloatArray:
    """Signed distances (m,) of matches from a fundamental matrix, to first order.

    Args:
        matrix: (3, 3).
        matched: (m, 4) rows x1, y1, x2, y2.
        sigma: (m, 2) of both positions, for distances in standard deviations.
    """
    sigma = np.broadcast_to(sigma, (len(matched), 2))
    first, second = homogeneous(matched[:, :2]), homogeneous(matched[:, 2:])
    lines1, lines2 = second @ matrix[:, :2], first @ matrix[:2].T
    variance = (lines1**2).sum(axis=1) * sigma[:, 0] ** 2
    variance += (lines2**2).sum(axis=1) * sigma[:, 1] ** 2
    gap = ((first @ matrix.T) * second).sum(axis=1)
    distances: FloatArray = gap / np.sqrt(np.maximum(variance, 1e-300))
    return distances


def normalization(xy: FloatArray) -> FloatArray:
    """(3, 3) similarity that moves (n, 2) points to mean 0 and RMS distance sqrt(2)."""
    center = xy.mean(axis=0)
    scale = np.sqrt(2 / max(((xy - center) ** 2).sum(axis=1).mean(), 1e-12))
    return np.array([[scale, 0, -scale * center[0]], [0, scale, -scale * center[1]], [0, 0, 1.0]])
