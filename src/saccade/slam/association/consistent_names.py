"""Names that agree with an uncertain pose: a gate that is not linear in the heading.

Before a long loop is closed the heading may be uncertain by a radian, and the landmarks around the
robot lie on an arc about its estimate, far outside of the ellipse of the linearized gate. In the
right-invariant errors of SE(2) (Barrau & Bonnabel 2015) the arc is straight: for a given error of
the heading, the position of a landmark relative to the robot is linear in Gaussian errors.
"""

import numpy as np

from saccade.plane import rotations
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter._state_kernels import FilterState
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.state import marginal
from saccade.types import BoolArray, FloatArray, IntArray

HEADING_LIMITS = 6.0, 3.0
"""Standard deviations and radians up to which errors of the heading are tried."""
HEADINGS, REFINEMENTS = 41, 4
"""Errors that are tried at once, and how often, each time between the neighbors of the best."""


def consistent_names(
    ekf: EkfSlam, xy: FloatArray, covariance: FloatArray, landmark: IntArray, gate: float
) -> BoolArray:
    """The observations of a scan that may be of the landmarks that their names say.

    All of one scan must agree with one pose, as uncertain as the filter declares it and the
    landmarks. The one that agrees least is left out until they do; where leaving out any of
    several would do, and lowers the misfit half as much or more, all of these are.

    Args:
        ekf: the filter, predicted to the pose of the scan.
        xy: (k, 2) metres: the position of each observation in the map.
        covariance: (k, 2, 2) of its noise.
        landmark: (k,) number of the landmark that each names, of those in `EkfSlam.view`.
        gate: probability with which right names are accepted.

    Returns:
        (k,) whether each is accepted.
    """
    f, number = ekf.view, ekf.to_view(landmark)
    positions = f.state[f.robot_size :].reshape(-1, 2)[number]
    offset = xy - positions
    prior, kept = _relative_covariance(f, number, positions - ekf.pose[:2]), np.arange(len(xy))

    def cost(rows: IntArray) -> float:
        errors = np.append(0, 1 + np.stack([2 * rows, 2 * rows + 1], 1))
        return _least_square(offset[rows], covariance[rows], prior[np.ix_(errors, errors)])

    while len(kept) > 0:
        total = cost(kept)
        without = np.array([cost(np.delete(kept, i)) for i in range(len(kept))])
        gain = total - without.min()
        if total <= chi_square_gate(2 * len(kept), gate) and gain <= chi_square_gate(2, gate):
            break
        enough = chi_square_gate(2 * len(kept) - 2, gate) if len(kept) > 1 else 0.0
        right = (without > enough) | (total - without < gain / 2)
        kept = kept[right & (without > without.min())]
    accepted = np.zeros(len(xy), np.bool_)
    accepted[kept] = True
    return accepted


def _relative_covariance(f: FilterState, number: IntArray, relative: FloatArray) -> FloatArray:
    """(1 + 2k, 1 + 2k) of the errors of the heading and of landmarks relative to the robot.

    With e the errors along the axes of the map and J a quarter turn, those of a landmark m and
    the robot p are e_m - e_p - J (m - p) e_theta.
    """
    k = len(number)
    P = marginal(f, number)
    r = len(P) - 2 * k
    x, y = relative.T
    A = np.zeros((1 + 2 * k, len(P)))
    A[0, 2] = 1.0
    A[1:, r:] = np.eye(2 * k)
    A[1:, :2] = np.tile(-np.eye(2), (k, 1))
    A[1::2, 2], A[2::2, 2] = y, -x
    return np.asarray(A @ P @ A.T)


def _least_square(offset: FloatArray, covariance: FloatArray, prior: FloatArray) -> float:
    """Least normalized square of k observed points and of a prior, over errors of the heading.

    A heading error e moves a landmark relative to the robot, whose other errors are d, by
    M d, with M = sin(e / 2) / (e / 2) times the rotation by -e / 2. Of no points it is zero.
    """
    k, variance = len(offset), max(prior[0, 0], 1e-12)
    slope = prior[1:, 0] / variance
    given_heading = prior[1:, 1:] - np.outer(slope, prior[0, 1:])
    limit = min(HEADING_LIMITS[0] * variance**0.5, HEADING_LIMITS[1])
    center = least = 0.0
    for _ in range(REFINEMENTS):
        e = center + np.linspace(-limit, limit, HEADINGS)
        inverse = rotations(e / 2) / np.sinc(e / 2 / np.pi)[:, None, None]  # (n, 2, 2)
        v = (offset @ inverse.transpose(0, 2, 1)).reshape(len(e), 2 * k) - e[:, None] * slope
        S = np.tile(given_heading, (len(e), 1, 1))
        for i in range(k):
            block = slice(2 * i, 2 * i + 2)
            S[:, block, block] += inverse @ covariance[i] @ inverse.transpose(0, 2, 1)
        weighted = np.linalg.solve(S, v[..., None])[..., 0]
        costs = e * e / variance + (v * weighted).sum(1)
        best = int(costs.argmin())
        center, least, limit = e[best], float(costs[best]), 2 * limit / (HEADINGS - 1)
    return least
