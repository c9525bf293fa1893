"""Robust least-squares fit of a two-view geometry, with its covariance."""

from collections.abc import Callable
from typing import Literal, NamedTuple, TypeAlias

import cv2
import numpy as np

from saccade.types import FloatArray

Geometry: TypeAlias = Literal["fundamental", "homography", "essential"]
Parametrization: TypeAlias = Callable[[FloatArray], FloatArray]
"""Function from (k,) parameters, 0 at the initial model, to a (3, 3) matrix."""

CAUCHY_WIDTH = 1.0
"""Residual at which the Cauchy loss begins to level off, in robust standard deviations: chosen
among 1, 2 and 3 by the homographies of synthetic pairs."""
NORMAL_MAD = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""
MAX_CONDITION = 1e14
"""Largest condition number of the information of matches that determine a model."""
MIN_FREEDOM = 0.05
"""One minus the largest leverage: a residual of a higher one says nothing of its error."""
DERIVATIVE_STEP = 1e-6
"""Step of central differences; the parameters are of unit scale."""


class Fit(NamedTuple):
    """A refined model."""

    matrix: FloatArray
    """(3, 3), of the norm of the initial one."""
    covariance: FloatArray
    """(9, 9) of its entries, row by row."""
    scale: float
    """Robust standard deviation of the residuals, which are in units of `sigma`."""


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
    from scipy.optimize import least_squares  # half a second that detection does not need

    parametrize = _PARAMETRIZATIONS[geometry]
    model, size = parametrize(matrix, normalization(matched[:, :2]), normalization(matched[:, 2:]))
    residuals = residuals_of(geometry, matrix, matched, sigma)

    def whitened(parameters: FloatArray) -> FloatArray:
        values: FloatArray = residuals(model(parameters)).ravel()
        return values

    start, norm = np.zeros(size), float(np.linalg.norm(matrix))
    scale = NORMAL_MAD * float(np.median(np.abs(whitened(start))))
    if not scale > 0:
        return Fit(matrix, np.zeros((9, 9)), 0.0)  # exact matches
    width = CAUCHY_WIDTH * scale
    found = least_squares(whitened, start, loss="cauchy", f_scale=width, max_nfev=50)
    z = residuals(model(found.x))
    derivatives = derivative(whitened, found.x).reshape(*z.shape, size)
    covariance = _m_estimate_covariance(derivatives, z, width)
    if covariance is None or not np.isfinite(found.x).all():
        return None

    def entries(parameters: FloatArray) -> FloatArray:
        estimate = model(parameters)
        values: FloatArray = estimate.ravel() / np.linalg.norm(estimate)
        return values * norm

    J, scale = derivative(entries, found.x), NORMAL_MAD * float(np.median(np.abs(z)))
    return Fit(entries(found.x).reshape(3, 3), J @ covariance @ J.T, scale)


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
    information = np.einsum("mci,mcj->ij", J, J)
    if z.size <= k or slope <= 0 or np.linalg.cond(information) > MAX_CONDITION:
        return None
    inverse = np.linalg.inv(information)
    leverage = np.einsum("mci,ij,mcj->mc", J, inverse, J)
    influence = z / loss / np.maximum(1 - leverage, MIN_FREEDOM)
    scores = np.einsum("mc,mcj->mj", influence, J)
    covariance: FloatArray = inverse @ scores.T @ scores @ inverse / slope**2
    return covariance


def derivative(function: Parametrization, parameters: FloatArray) -> FloatArray:
    """(n, k) central differences of a function of (k,) parameters with (n,) values."""
    steps = DERIVATIVE_STEP * np.eye(len(parameters))
    columns = [function(parameters + step) - function(parameters - step) for step in steps]
    return np.stack(columns, axis=1) / (2 * DERIVATIVE_STEP)


def residuals_of(
    geometry: Geometry, matrix: FloatArray, matched: FloatArray, sigma: FloatArray
) -> Callable[[FloatArray], FloatArray]:
    """Residuals (m, c) of models near one in standard deviations; c = 2 of homographies, else 1."""
    if geometry != "homography":
        return lambda model: sampson_distances(model, matched, sigma)[:, None]
    # The errors of both positions, in the second image.
    spread = local_affinities(matrix, matched[:, :2]) * sigma[:, :1, None]  # (m, 2, 2)
    covariance = spread @ spread.transpose(0, 2, 1) + np.eye(2) * sigma[:, 1:, None] ** 2
    whitening = np.linalg.inv(np.linalg.cholesky(covariance))
    return lambda model: np.einsum(
        "mij,mj->mi", whitening, project(model, matched[:, :2]) - matched[:, 2:]
    )


def project(homography: FloatArray, xy: FloatArray) -> FloatArray:
    """Projects (n, 2) points by a (3, 3) homography; points at infinity are not finite."""
    rows = np.c_[xy, np.ones(len(xy))] @ homography.T  # (n, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        projected: FloatArray = rows[:, :2] / rows[:, 2:]
    return projected


def local_affinities(homography: FloatArray, xy: FloatArray) -> FloatArray:
    """(n, 2, 2) derivatives of the projection of (n, 2) points by their positions."""
    w = np.c_[xy, np.ones(len(xy))] @ homography[2]
    projected = project(homography, xy)
    affinities: FloatArray = (
        homography[None, :2, :2] - projected[:, :, None] * homography[None, 2:, :2]
    ) / w[:, None, None]
    return affinities


def sampson_distances(
    matrix: FloatArray, matched: FloatArray, sigma: FloatArray | float = 1.0
) -> FloatArray:
    """Signed distances (m,) of matches from a fundamental matrix, to first order.

    Args:
        matrix: (3, 3).
        matched: (m, 4) rows x1, y1, x2, y2.
        sigma: (m, 2) of both positions, for distances in standard deviations.

    Source: Hartley & Zisserman (2004), section 11.4.3.
    """
    ones = np.ones(len(matched))
    first, second = np.c_[matched[:, :2], ones], np.c_[matched[:, 2:], ones]
    lines2, lines1 = first @ matrix.T, second @ matrix
    error = (lines2 * second).sum(axis=1)
    sigma1, sigma2 = np.broadcast_to(sigma, (len(matched), 2)).T
    variance = (sigma1[:, None] * lines1[:, :2]) ** 2 + (sigma2[:, None] * lines2[:, :2]) ** 2
    distances: FloatArray = error / np.sqrt(np.maximum(variance.sum(axis=1), 1e-300))
    return distances


def normalization(xy: FloatArray) -> FloatArray:
    """(3, 3) similarity that moves (n, 2) points to mean 0 and RMS distance sqrt(2)."""
    center = xy.mean(axis=0)
    scale = np.sqrt(2 / max(((xy - center) ** 2).sum(axis=1).mean(), 1e-12))
    return np.array([[scale, 0, -scale * center[0]], [0, scale, -scale * center[1]], [0, 0, 1.0]])


def _homographies(
    matrix: FloatArray, T1: FloatArray, T2: FloatArray
) -> tuple[Parametrization, int]:
    """Homographies about one: steps orthogonal to its entries, in normalized coordinates."""
    inverse = np.linalg.inv(T2)
    initial = T2 @ matrix @ np.linalg.inv(T1)
    initial = initial / np.linalg.norm(initial)
    tangents = np.linalg.svd(initial.reshape(1, 9))[2][1:]  # (8, 9)
    return lambda p: inverse @ (initial + (p @ tangents).reshape(3, 3)) @ T1, 8


def _fundamentals(
    matrix: FloatArray, T1: FloatArray, T2: FloatArray
) -> tuple[Parametrization, int]:
    """Fundamental matrices about one: rotations of its singular vectors, ratio of its values.

    Source: Bartoli & Sturm (2004).
    """
    U, values, Vt = np.linalg.svd(np.linalg.inv(T2).T @ matrix @ np.linalg.inv(T1))
    angle = np.arctan2(values[1], values[0])

    def model(p: FloatArray) -> FloatArray:
        diagonal = np.diag([np.cos(angle + p[6]), np.sin(angle + p[6]), 0])
        left, right = (cv2.Rodrigues(p[rows])[0] for rows in (slice(3), slice(3, 6)))
        normalized = U @ left @ diagonal @ right.T @ Vt
        fundamental: FloatArray = T2.T @ normalized @ T1
        return fundamental

    return model, 7


def _essentials(matrix: FloatArray, T1: FloatArray, T2: FloatArray) -> tuple[Parametrization, int]:
    """Essential matrices about one: rotations of its singular vectors.

    The third rotation on the right is the third on the left.
    """
    U, _, Vt = np.linalg.svd(matrix)

    def model(p: FloatArray) -> FloatArray:
        left, right = cv2.Rodrigues(p[:3])[0], cv2.Rodrigues(np.append(p[3:], 0))[0]
        essential: FloatArray = U @ left @ np.diag([1.0, 1, 0]) @ right.T @ Vt
        return essential

    return model, 5


_PARAMETRIZATIONS = {
    "homography": _homographies,
    "fundamental": _fundamentals,
    "essential": _essentials,
}
