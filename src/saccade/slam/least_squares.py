"""Sparse least squares over a chain of poses and landmarks.

Every pose and every landmark is a variable (Dellaert & Kaess 2006, "Square root SAM"). The normal
equations are sparse. The block of the poses is block tridiagonal, as they are a chain; its
factorization gives the covariances.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from scipy.linalg import cho_solve, cholesky
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from saccade.plane import relative_poses, rotations
from saccade.slam.filter.robot_models import difference, observe, wrap
from saccade.types import FloatArray, IntArray

MAX_ITERATIONS = 50
"""Largest number of iterations of Levenberg-Marquardt."""
MIN_COST_DECREASE = 1e-5
"""Minimum relative decrease of the cost in an iteration; the estimate has converged otherwise."""
MIN_DAMPING = 1e-9
"""Damping after a step that does not decrease the cost, relative to the diagonal of the normal
equations. Until then the steps are undamped (Gauss-Newton)."""
DAMPING_FACTOR = 100.0
"""Factor on the damping after a step that does not decrease the cost; its inverse after others."""
POSES_PER_STRETCH = 48
"""Number of successive poses whose covariances are computed together."""
NEGLIGIBLE_DERIVATIVE = 1e-12
"""Largest derivative of a pose by a landmark that is neglected."""
MAX_SEARCHED_POSES = 20_000
"""Largest number of poses for which the order of elimination is searched: the search takes longer
than in proportion to the poses where each landmark is observed from many."""
SEGMENT = 60
"""Number of poses of a segment of a longer log: those inside are eliminated first, in their order,
then its end, then the landmarks. A pose inside is connected with the landmarks of its segment."""
MAX_SEGMENTED_FLOPS = 2e10
"""Largest number of operations for the elimination of the ends and landmarks; beyond it, the order
is searched."""
MAX_DAMPING = 1e6
"""Largest damping of a step."""


class Estimate(NamedTuple):
    """The variables of the problem."""

    pose: FloatArray
    """(v, 3) x, y in meters, heading in radians."""
    landmark: FloatArray
    """(n, 2) meters."""
    bias: FloatArray
    """(b,) systematic errors: of the odometry (3), see `motions.SYSTEMATIC_ERRORS`, then scale
    error and offset of the ranges (2); b is 0, 2, 3 or 5."""

    @property
    def distance_scale(self) -> float:
        """True distance per measured distance of the odometry."""
        return 1.0 + float(self.bias[0]) if len(self.bias) >= 3 else 1.0

    @property
    def range_errors(self) -> FloatArray:
        """(2,) scale error and offset of the ranges; zeros where they are not estimated."""
        return self.bias[-2:] if len(self.bias) in (2, 5) else np.zeros(2)

    def moved(self, step: FloatArray) -> Self:
        """The estimate after a step (3 v + 2 n + b,) of poses, landmarks and biases."""
        v, n = len(self.pose), len(self.landmark)
        by_pose, by_landmark, by_bias = np.split(step, [3 * v, 3 * v + 2 * n])
        pose = self.pose + by_pose.reshape(v, 3)
        pose[:, 2] = wrap(pose[:, 2])
        landmark = self.landmark + by_landmark.reshape(n, 2)
        return self._replace(pose=pose, landmark=landmark, bias=self.bias + by_bias)


class Factors(NamedTuple):
    """Residuals of one kind, whitened, and their Jacobians."""

    residual: FloatArray
    """(f, r) of standard deviation 1."""
    by_first: FloatArray
    """(f, r, 3) Jacobian by the first pose of each."""
    by_second: FloatArray
    """(f, r, 3 or 2) Jacobian by the second pose, or by the landmark."""
    by_bias: FloatArray
    """(f, r, b) Jacobian by the biases."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """What is known before, steps between poses, and observations of landmarks from poses."""

    prior: Estimate
    """First pose (1, 3), the first p landmarks, and biases, as they are known before."""
    prior_root: FloatArray
    """(3 + 2 p + b,) squared: square root of the information of `prior`, in its order. W^T W is the
    inverse of the covariance."""
    step: FloatArray
    """(v - 1, 3) each pose in the frame of its predecessor."""
    step_root: FloatArray
    """(v - 1, 3, 3) square roots of their information, in the frame of the later pose."""
    step_by_bias: FloatArray
    """(v - 1, 3, b) Jacobian of the steps by the biases."""
    observer: IntArray
    """(k,) pose of each observation."""
    landmark: IntArray
    """(k,) landmark of each observation."""
    observation: FloatArray
    """(k, 2) range in meters, bearing in radians."""
    observation_root: FloatArray
    """(k, 2, 2) square roots of their information."""
    huber: float
    """Huber's threshold: norm of the largest whitened residual with full weight."""

    def before(self, at: Estimate) -> FloatArray:
        """(3 + 2 p + b,) whitened residuals of the prior."""
        prior = self.prior
        landmark = at.landmark[: len(prior.landmark)] - prior.landmark
        pose = _minus(at.pose[0], prior.pose[0])
        error = np.concatenate([pose, landmark.ravel(), at.bias - prior.bias])
        return np.asarray(self.prior_root @ error)

    def steps(self, at: Estimate) -> Factors:
        """The steps between successive poses.

        The noise is that of the measured distance, which is 1 + scale error times shorter than the
        true one. Constant noise of the true distance would make a smaller map more probable.
        """
        first, second = at.pose[:-1], at.pose[1:]
        expected = self.step + self.step_by_bias @ at.bias
        between = relative_poses(first, second)
        turned = rotations(expected[:, 2]).transpose(0, 2, 1)
        error = np.empty_like(expected)  # in the frame of the expected later pose
        error[:, :2] = (turned @ (between - expected)[:, :2, None])[:, :, 0]
        error[:, 2] = wrap(second[:, 2] - first[:, 2] - expected[:, 2])
        by_second = np.zeros((len(first), 3, 3))
        by_second[:, :2, :2] = rotations(first[:, 2] + expected[:, 2]).transpose(0, 2, 1)
        by_second[:, 2, 2] = 1.0
        by_first = -by_second
        by_first[:, :2, 2] = (turned @ _perpendicular(between[:, :2])[:, :, None])[:, :, 0]
        by_expected = np.zeros((len(first), 3, 3))
        by_expected[:, :2, :2] = -turned
        by_expected[:, :2, 2] = _perpendicular(error[:, :2])
        by_expected[:, 2, 2] = -1.0
        W, by_bias = self.step_root, by_expected @ self.step_by_bias
        if (scale := at.distance_scale) != 1:
            for each in (error, by_first, by_second, by_bias):
                each[:, :2] /= scale
        if by_bias.shape[2] >= 3:
            by_bias[:, :2, 0] -= error[:, :2] / scale
        return Factors((W @ error[:, :, None])[:, :, 0], W @ by_first, W @ by_second, W @ by_bias)

    def observations(self, at: Estimate) -> Factors:
        """The observations of landmarks (C.14)."""
        z, H = observe(at.pose[self.observer].T, at.landmark[self.landmark])
        scale, offset = at.range_errors
        by_bias = np.zeros((len(z), 2, len(at.bias)))
        if len(at.bias) in (2, 5):
            by_bias[:, 0, -2], by_bias[:, 0, -1] = z[:, 0], 1.0
        z[:, 0] = (1 + scale) * z[:, 0] + offset
        H[:, 0] *= 1 + scale
        error, W = difference(z, self.observation), self.observation_root
        whitened = (W @ error[:, :, None])[:, :, 0]
        return Factors(whitened, W @ H[:, :, :3], W @ H[:, :, 3:], W @ by_bias)

    def weights(self, observations: Factors) -> FloatArray:
        """(k,) robust weight of each observation (Huber 1964)."""
        norm = np.sqrt(np.square(observations.residual).sum(1))
        return np.asarray(np.minimum(1.0, self.huber / np.maximum(norm, 1e-300)))

    def cost(self, at: Estimate) -> float:
        """Half the sum of the squared residuals; of observations, Huber's loss."""
        norm = np.sqrt(np.square(self.observations(at).residual).sum(1))
        inside = np.minimum(norm, self.huber)
        loss = inside * (norm - inside / 2)  # norm^2 / 2 up to the threshold, linear beyond
        others = self.steps(at).residual, self.before(at)
        return float(loss.sum() + sum(np.square(each).sum() for each in others) / 2)


class NormalEquations:
    """The normal equations H x = -g about an estimate, poses before landmarks and biases."""

    def __init__(self, measured: Measurements, at: Estimate) -> None:
        steps, seen = measured.steps(at), measured.observations(at)
        root = np.sqrt(measured.weights(seen))[:, None]
        pose = 3 * np.arange(len(at.pose))
        landmark = pose.size * 3 + 2 * np.arange(len(at.landmark))
        bias = np.array([landmark.size * 2 + pose.size * 3])
        W, observer = root[:, None], pose[measured.observer]
        size = 3 + measured.prior.landmark.size
        known = np.split(measured.prior_root[None], [3, size], 2)
        rows = (  # of the Jacobian, by kind of measurement: blocks with their first columns
            tuple(zip(known, (pose[:1], np.array([3 * pose.size]), bias), strict=True)),
            ((steps.by_first, pose[:-1]), (steps.by_second, pose[1:]), (steps.by_bias, bias)),
            (
                (W * seen.by_first, observer),
                (W * seen.by_second, landmark[measured.landmark]),
                (W * seen.by_bias, bias),
            ),
        )
        J = _sparse(rows, pose.size * 3 + landmark.size * 2 + len(at.bias))
        J.eliminate_zeros()  # between landmarks that are independent before
        residual = measured.before(at), steps.residual, root * seen.residual
        self._H = csc_array(J.T @ J)
        self._gradient = J.T @ np.concatenate([each.ravel() for each in residual])
        self._poses = 3 * len(at.pose)
        self._sparse = J.shape[1] - len(at.bias)

    def step(self, damping: float) -> FloatArray:
        """The step of all variables, with the diagonal of H increased by the fraction `damping`.

        Biases enter every step and would fill the factors; their Schur complement gives them first.
        """
        damped = csc_array(self._H + damping * diags_array(self._H.diagonal()))
        n, g = self._sparse, -self._gradient
        others, B = csc_array(damped[:n, :n]), damped[:n, n:].toarray()
        x = self._solve(others, np.column_stack([g[:n], B]))
        S = damped[n:, n:].toarray() - B.T @ x[:, 1:]
        bias = np.linalg.solve(S, g[n:] - B.T @ x[:, 0])
        return np.concatenate([x[:, 0] - x[:, 1:] @ bias, bias])

    def _solve(self, A: csc_array, b: FloatArray) -> FloatArray:
        """Solves A x = b (n, k) of poses and landmarks."""
        symmetric = {"SymmetricMode": True}
        ends = np.arange(0, self._poses // 3, SEGMENT)
        landmarks = A.shape[0] - self._poses
        flops = (3 * len(ends) + landmarks) * landmarks**2
        if self._poses <= 3 * MAX_SEARCHED_POSES or flops > MAX_SEGMENTED_FLOPS:
            return np.asarray(splu(A, "MMD_AT_PLUS_A", 0.0, options=symmetric).solve(b))
        inside = np.delete(np.arange(self._poses // 3), ends)
        poses = 3 * np.append(inside, ends)[:, None] + np.arange(3)
        order = np.append(poses.ravel(), np.arange(self._poses, A.shape[0]))
        x = np.empty_like(b)
        permuted = csc_array(A[order][:, order])
        x[order] = splu(permuted, "NATURAL", 0.0, options=symmetric).solve(b[order])
        return x

    def covariances(self) -> tuple[FloatArray, FloatArray]:
        """Marginal covariances of poses (v, 3, 3), and of landmarks and biases (m, m) together.

        The covariance of a pose is its covariance given landmarks and biases, plus X S^-1 X^T, with
        X = H_pp^-1 H_pl and S the Schur complement of the poses.
        """
        p = self._poses
        H_pl, H_ll = self._H[:p, p:], self._H[p:, p:].toarray()
        given, X = _solve_chain(self._H[:p, :p], H_pl.toarray("C"))
        L = cholesky(H_ll - H_pl.T @ X, lower=True)
        others = cho_solve((L, True), np.eye(len(L)))
        X = X.reshape(p // 3, 3, len(L))
        for i in range(0, p // 3, POSES_PER_STRETCH):
            poses = slice(i, i + POSES_PER_STRETCH)
            # X is almost zero for landmarks far from the poses
            near = np.flatnonzero(np.abs(X[poses]).max((0, 1)) > NEGLIGIBLE_DERIVATIVE)
            x = X[poses, :, near]
            weighted = x.reshape(3 * len(x), len(near)) @ others[np.ix_(near, near)]
            given[poses] += weighted.reshape(x.shape) @ x.transpose(0, 2, 1)
        return given, others


def minimize(
    measured: Measurements, start: Estimate, min_decrease: float = MIN_COST_DECREASE
) -> tuple[Estimate, int]:
    """The least-squares estimate by Levenberg-Marquardt, and the number of iterations.

    The first step gives every observation its full weight: far from the minimum, the robust weights
    are so small that the observations hardly move the poses.
    """
    plain = NormalEquations(replace(measured, huber=np.inf), start)
    best = min(start, start.moved(plain.step(0.0)), key=measured.cost)
    cost, damping, iterations = measured.cost(best), 0.0, 1
    while iterations < MAX_ITERATIONS:
        iterations += 1
        equations, new = NormalEquations(measured, best), np.inf
        while new > cost and damping < MAX_DAMPING:
            moved = best.moved(equations.step(damping))
            new = measured.cost(moved)
            failed = max(damping * DAMPING_FACTOR, MIN_DAMPING)
            damping = failed if new > cost else damping / DAMPING_FACTOR
        if new > cost:
            break
        best, decrease, cost = moved, cost - new, new
        if decrease <= min_decrease * cost:
            break
    return best, iterations


def _sparse(rows: Sequence[Sequence[tuple[FloatArray, IntArray]]], columns: int) -> csr_array:
    """A sparse matrix of blocks (f, r, c) with the first column (f,) of each.

    Blocks of one group stand in the same rows; the groups stand one below another.
    """
    values, indices, lengths = [], [], [np.zeros(1, np.int64)]
    for group in rows:
        f, r, _ = group[0][0].shape
        value = np.concatenate([block for block, _ in group], 2)
        place = [
            np.broadcast_to(first[:, None] + np.arange(block.shape[2]), (f, block.shape[2]))
            for block, first in group
        ]
        values.append(value.ravel())
        indices.append(np.repeat(np.concatenate(place, 1), r, 0).ravel())
        lengths.append(np.full(f * r, value.shape[2]))
    starts = np.cumsum(np.concatenate(lengths))
    parts = np.concatenate(values), np.concatenate(indices), starts
    return csr_array(parts, (len(starts) - 1, columns))


def _perpendicular(v: FloatArray) -> FloatArray:
    """Derivatives (f, 2) of vectors (f, 2) by a turn of their frame."""
    return np.stack([v[:, 1], -v[:, 0]], 1)


def _minus(pose: FloatArray, other: FloatArray) -> FloatArray:
    """Difference of two poses (3,), the heading wrapped."""
    return np.append((pose - other)[:2], wrap(pose[2] - other[2]))


def _solve_chain(H: csc_array, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solves a block tridiagonal system, block by block.

    Args:
        H: (3 v, 3 v) symmetric, with blocks of 3 x 3.
        right: (3 v, m).

    Returns:
        (v, 3, 3) diagonal blocks of the inverse of H, by the recursion of Rauch, Tung and
        Striebel (1965), and (3 v, m) the solution.
    """
    v = H.shape[0] // 3
    cells = np.zeros((v, 3, 9))  # blocks before, on and after the diagonal
    row, column = H.nonzero()
    cells[row // 3, row % 3, column - 3 * (row // 3) + 3] = H[row, column]
    below, diagonal = cells[1:, :, :3], cells[:, :, 3:6]
    gain, inverse = np.empty_like(below), np.empty_like(diagonal)
    inverse[0] = np.linalg.inv(diagonal[0])
    x = right.reshape(v, 3, right.shape[1])
    for i in range(1, v):
        gain[i - 1] = below[i - 1] @ inverse[i - 1]
        inverse[i] = np.linalg.inv(diagonal[i] - gain[i - 1] @ below[i - 1].T)
        x[i] -= gain[i - 1] @ x[i - 1]
    covariance = inverse.copy()
    x[-1] = inverse[-1] @ x[-1]
    for i in range(v - 2, -1, -1):
        covariance[i] += gain[i].T @ covariance[i + 1] @ gain[i]
        x[i] = inverse[i] @ x[i] - gain[i].T @ x[i + 1]
    return covariance, x.reshape(right.shape)
