"""Robust least-squares fit of a two-view geometry, with its covariance."""

from collections.abc import Callable
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from saccade.types import FloatArray

Geometry: TypeAlias = Literal["fundamental", "homography", "essential"]
Residuals: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Function of a (3, 3) matrix: (m, c) residuals and their (m, c, 9) derivatives."""

CAUCHY_WIDTH = 1.0
"""Width of the Cauchy loss in robust standard deviations, chosen among 1, 2 and 3 by the
homographies of synthetic pairs."""
NORMAL_MAD = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""
MAX_CONDITION = 1e14
"""Largest condition number of the information of matches that determine a model."""
MIN_FREEDOM = 0.05
"""Lower bound of one minus the leverage in the jackknife."""
MAX_STEPS = 50
"""Largest number of Gauss-Newton steps, halved ones included."""
MIN_DECREASE = 1e-6
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
"""Those of an essential matrix, whose singular values are equal."""


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
    T1, T2 = normalization(matched[:, :2]), normalization(matched[:, 2:])
    if geometry == "essential":  # its singular values are equal in these coordinates alone
        T1 = T2 = np.eye(3)
    inverse1, inverse2 = np.linalg.inv(T1), np.linalg.inv(T2)
    forth = (T2, inverse1) if geometry == "homography" else (inverse2.T, inverse1)
    back = np.kron(np.linalg.inv(forth[0]), np.linalg.inv(forth[1]).T)  # (9, 9) by entries
    matched = np.hstack([project(T1, matched[:, :2]), project(T2, matched[:, 2:])])
    sigma = sigma * [T1[0, 0], T2[0, 0]]
    initial = nearest_model(forth[0] @ matrix @ forth[1], geometry)
    residuals = residuals_of(geometry, initial, matched, sigma)
    scale = NORMAL_MAD * float(np.median(np.abs(residuals(initial)[0])))
    if not scale > 0:
        return Fit(matrix, np.zeros((9, 9)), 0.0)  # exact matches
    width = CAUCHY_WIDTH * scale
    model = minimize(initial, geometry, residuals, width)
    z, by_entries = residuals(model)
    directions = tangents(model, geometry)
    covariance = _m_estimate_covariance(by_entries @ directions.T, z, width)
    entries, norm = back @ model.ravel(), float(np.linalg.norm(matrix))
    length = float(np.linalg.norm(entries))
    if covariance is None or not np.isfinite(entries).all():
        return None
    unit, scale = entries / length, NORMAL_MAD * float(np.median(np.abs(z)))
    J = norm / length * (np.eye(9) - np.outer(unit, unit)) @ back @ directions.T  # (9, k)
    return Fit(norm * unit.reshape(3, 3), J @ covariance @ J.T, scale)


def minimize(
    model: FloatArray, geometry: Geometry, residuals: Residuals, width: float
) -> FloatArray:
    """The (3, 3) matrix of unit norm, near a first one, with the least Cauchy loss.

    Gauss-Newton steps that take the second derivative of the loss where it is positive. A step
    that does not lower the loss is halved.
    """
    (z, J), size = residuals(model), 1.0
    cost = float(np.log1p((z / width) ** 2).sum())
    step = _gauss_newton_step(model, geometry, z, J, width)
    for _ in range(MAX_STEPS):
        trial = nearest_model(model + size * step, geometry)
        z, J = residuals(trial)
        decrease = cost - float(np.log1p((z / width) ** 2).sum())
        if decrease > 0:
            model, cost, size = trial, cost - decrease, 1.0
            step = _gauss_newton_step(model, geometry, z, J, width)
        else:
            size /= 2
        if abs(decrease) <= MIN_DECREASE * cost:
            break
    return model


def _gauss_newton_step(
    model: FloatArray, geometry: Geometry, z: FloatArray, J: FloatArray, width: float
) -> FloatArray:
    """(3, 3) change of a model with residuals (m, c), and (m, c, 9) derivatives of these."""
    directions, loss = tangents(model, geometry), 1 + (z / width) ** 2
    by_step = (J @ directions.T).reshape(z.size, -1)
    curvature = np.maximum((2 - loss) / loss**2, 0).reshape(-1, 1)
    step = np.linalg.lstsq(by_step.T @ (curvature * by_step), -by_step.T @ (z / loss).ravel())[0]
    change: FloatArray = (step @ directions).reshape(3, 3)
    return change


def tangents(model: FloatArray, geometry: Geometry) -> FloatArray:
    """(k, 9) orthonormal directions in which a matrix of a geometry and of unit norm can move."""
    U, values, Vt = np.linalg.svd(model)
    if geometry == "essential":
        directions = ESSENTIAL_DIRECTIONS
    elif geometry == "fundamental":
        along = np.diag([-values[1], values[0], 0]) / np.hypot(values[0], values[1])
        directions = np.concatenate([OFF_DIAGONAL, along[None]])
    else:
        directions = _complement(np.diag(values))
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
    """Residuals of models near one in standard deviations; c = 2 for homographies, else 1."""
    if geometry != "homography":
        views = homogeneous(matched[:, :2]), homogeneous(matched[:, 2:])
        return lambda model: epipolar_residuals(model, *views, sigma)
    whitening = np.linalg.inv(np.linalg.cholesky(transfer_covariance(matrix, matched, sigma)))

    def residuals(model: FloatArray) -> tuple[FloatArray, FloatArray]:
        gap = project(model, matched[:, :2]) - matched[:, 2:]
        J = projection_derivatives(model, matched[:, :2])
        return (whitening @ gap[:, :, None])[:, :, 0], whitening @ J

    return residuals


def transfer_covariance(
    homography: FloatArray, matched: FloatArray, sigma: FloatArray
) -> FloatArray:
    """(m, 2, 2) covariance of the errors of both positions, in the second image."""
    affinities = homogeneous_derivatives(homography, matched[:, :2]) @ homography[:, :2]
    spread = affinities * sigma[:, :1, None]
    covariance: FloatArray = spread @ spread.transpose(0, 2, 1)
    covariance += np.eye(2) * sigma[:, 1:, None] ** 2
    return covariance


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


def epipolar_residuals(
    matrix: FloatArray, first: FloatArray, second: FloatArray, sigma: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Sampson distances (m, 1) of homogeneous points (m, 3), and derivatives (m, 1, 9) by F.

    Source: Hartley & Zisserman (2004), section 11.4.3.
    """
    lines1, lines2 = second @ matrix * [1, 1, 0], first @ matrix.T * [1, 1, 0]
    weighted1, weighted2 = lines1 * sigma[:, :1] ** 2, lines2 * sigma[:, 1:] ** 2
    variance = (lines1 * weighted1 + lines2 * weighted2).sum(axis=1, keepdims=True)
    length = np.sqrt(np.maximum(variance, 1e-300))  # (m, 1)
    z = ((first @ matrix.T) * second).sum(axis=1, keepdims=True) / length
    # d (x2' F x1) = x2' dF x1, and of half the variance x2' dF weighted1 + weighted2' dF x1.
    ratio = z / length
    outer = second[:, :, None] * (first - ratio * weighted1)[:, None]
    outer -= (ratio * weighted2)[:, :, None] * first[:, None]
    return z, (outer / length[:, :, None]).reshape(-1, 1, 9)


def normalization(xy: FloatArray) -> FloatArray:
    """(3, 3) similarity that moves (n, 2) points to mean 0 and RMS distance sqrt(2)."""
    center = xy.mean(axis=0)
    scale = np.sqrt(2 / max(((xy - center) ** 2).sum(axis=1).mean(), 1e-12))
    return np.array([[scale, 0, -scale * center[0]], [0, scale, -scale * center[1]], [0, 0, 1.0]])
