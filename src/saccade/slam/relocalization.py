"""Relocalization: which poses in a known map explain one or several scans.

Pairs of observed points are matched with pairs of landmarks at the same distance from each other,
as in the constraint search of Neira, Tardos & Castellanos (2003). Each match of two pairs is a
pose; those that explain most of the other points are refined and weighed against each other, and
against a robot outside of the map.
"""

from dataclasses import dataclass
from math import log, pi

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import logsumexp
from scipy.stats import chi2

from saccade.errors import require
from saccade.slam.filter.validation import check_all
from saccade.slam.models import RANGE_BEARING, Motion, compose, wrap
from saccade.types import FloatArray, IntArray

NEIGHBORS = 4
"""Landmarks around one, relative to which its error is taken."""
GATE = float(chi2.ppf(0.99, 2))
"""Squared Mahalanobis distance of an observed point from its landmark."""
ITERATIONS = 4
"""Gauss-Newton steps that refine a pose; the association settles in fewer."""


@dataclass(frozen=True)
class RelocalizationConfig:
    """Parameters of relocalization."""

    unmapped: float = 0.2
    """Prior probability that an observed point is of no landmark of the map."""
    elsewhere: float = 0.05
    """Prior probability that the robot is outside of the map."""
    base_pairs: int = 12
    """Pairs of observed points from which poses are proposed, the farthest apart first."""
    max_proposals: int = 50_000
    """Proposed poses whose support is counted."""
    max_hypotheses: int = 50
    """Proposed poses that are refined and weighed, those with the most support."""

    def __post_init__(self) -> None:
        for name in ("unmapped", "elsewhere"):
            require(0 < getattr(self, name) < 1, name, "between 0 and 1", getattr(self, name))
        for name in ("base_pairs", "max_proposals", "max_hypotheses"):
            require(getattr(self, name) >= 1, name, "at least 1", getattr(self, name))


@dataclass(frozen=True, eq=False, repr=False)
class PoseHypotheses:
    """Poses in the map that explain what was observed, the most probable first."""

    pose: FloatArray
    """(h, 3) x, y in metres, heading in radians."""
    covariance: FloatArray
    """(h, 3, 3)."""
    probability: FloatArray
    """(h,); what they leave of 1 is the probability of being outside of the map."""
    association: IntArray
    """(h, k) landmark of each of the k observed points, -1 for none."""

    def __len__(self) -> int:
        return len(self.pose)

    def __repr__(self) -> str:
        if len(self) == 0:
            return "PoseHypotheses(none)"
        x, y, theta = self.pose[0]
        return (
            f"PoseHypotheses({len(self)}, first {x:.2f} {y:.2f} m {theta:.3f} rad "
            f"with {self.probability[0]:.3f})"
        )


class Relocalizer:
    """Searches a map for the pose of a robot, scan by scan.

    Args:
        landmarks: (N, 2) metres.
        covariance: (N, 2, 2) of each, or better (2N, 2N) of all: errors that neighboring
            landmarks share do not count then.
        config: prior probabilities and limits of the search.
        motion: motion model of the controls between two scans.

    Raises:
        ConfigError: shapes that do not agree.
    """

    def __init__(
        self,
        landmarks: FloatArray,
        covariance: FloatArray,
        config: RelocalizationConfig = RelocalizationConfig(),
        motion: Motion = compose,
    ) -> None:
        n = len(landmarks)
        require(landmarks.shape == (n, 2), "landmarks", "(N, 2)", landmarks.shape)
        known = covariance.shape in ((n, 2, 2), (2 * n, 2 * n))
        require(known, "covariance", f"({n}, 2, 2) or ({2 * n}, {2 * n})", covariance.shape)
        self._landmarks, self._config, self._motion = landmarks, config, motion
        self._tree = cKDTree(landmarks)
        self._errors = _local_errors(self._tree, landmarks, covariance)
        self._points, self._spread = np.empty((0, 2)), np.empty((0, 2, 2))

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """Move the robot between two scans.

        Args:
            u: (c,) control of the motion model.
            U: (c, c) its covariance.
        """
        moved, _, Fu = self._motion(np.zeros(3), u)
        Q = Fu @ U @ Fu.T  # (3, 3)
        rotation = _rotations(moved[2:])[0].T
        self._points = (self._points - moved[:2]) @ rotation.T
        J = np.tile(np.eye(2, 3), (len(self._points), 1, 1))
        J[:, 0, 2], J[:, 1, 2] = -self._points[:, 1], self._points[:, 0]  # (k, 2, 3)
        J[:, :, :2] = rotation
        self._spread = rotation @ self._spread @ rotation.T + J @ Q @ J.transpose(0, 2, 1)

    def add(self, z: FloatArray, R: FloatArray) -> PoseHypotheses:
        """Add a scan, and search for the pose from which it was made.

        Args:
            z: (k, 2) range in metres, bearing in radians.
            R: (k, 2, 2) their covariances.

        Raises:
            LogError: an observation or covariance is not finite.
        """
        check_all("observation", z, R)
        xy, _, Gz = RANGE_BEARING.inverse_observe(np.zeros(3), z)
        self._points, self._spread = _fused(
            self._points, self._spread, xy, Gz @ R @ Gz.transpose(0, 2, 1)
        )
        return self.search()

    def search(self) -> PoseHypotheses:
        """The poses that explain all scans so far, the robot being where the last was made."""
        proposals = self._proposals()
        pose, covariance, score = [], [], []
        for proposed in proposals[: self._config.max_hypotheses]:
            found = self._refined(proposed)
            if found is not None and not _is_known(found[0], pose, covariance):
                pose.append(found[0])
                covariance.append(found[1])
                score.append(self._evidence(*found))
        return self._weighed(pose, covariance, score)

    def _proposals(self) -> FloatArray:
        """(h, 3) poses at which two observed points meet two landmarks, by decreasing support."""
        p, k = self._points, len(self._points)
        if k < 2 or len(self._landmarks) < 2:
            return np.empty((0, 3))
        first, second = np.triu_indices(k, 1)
        apart = np.linalg.norm(p[first] - p[second], axis=1)
        ordered = np.argsort(-apart)
        chosen = _spread_choice(first[ordered], second[ordered], self._config.base_pairs)
        chosen = ordered[chosen]
        reach = apart[chosen].max() * 1.1 + 1.0
        pairs = self._tree.query_pairs(reach, output_type="ndarray")
        pairs = np.concatenate([pairs, pairs[:, ::-1]])
        vector = self._landmarks[pairs[:, 1]] - self._landmarks[pairs[:, 0]]
        distance = np.linalg.norm(vector, axis=1)
        order = np.argsort(distance, kind="stable")
        pairs, vector, distance = pairs[order], vector[order], distance[order]
        poses, share = [], self._config.max_proposals // len(chosen)
        typical = np.trace(self._errors, axis1=1, axis2=2).mean()
        for i, j, d in zip(first[chosen], second[chosen], apart[chosen], strict=True):
            along = (p[j] - p[i]) / d
            variance = along @ (self._spread[i] + self._spread[j]) @ along + typical
            margin = 3.0 * np.sqrt(variance)
            low, high = np.searchsorted(distance, [d - margin, d + margin])
            within = np.arange(low, high)
            if len(within) > share:
                within = within[np.argsort(np.abs(distance[within] - d), kind="stable")[:share]]
            heading = np.arctan2(*vector[within, ::-1].T) - np.arctan2(*(p[j] - p[i])[::-1])
            middle = self._landmarks[pairs[within]].mean(1)
            xy = middle - _rotations(heading) @ ((p[i] + p[j]) / 2)
            poses.append(np.column_stack([xy, wrap(heading)]))
        proposals = np.concatenate(poses)
        support = self._support(proposals)
        best = np.argsort(-support, kind="stable")
        return _distinct(proposals[best], 20 * self._config.max_hypotheses)

    def _support(self, poses: FloatArray) -> FloatArray:
        """(h,) how well poses explain the observed points, each by its nearest landmark."""
        scale = np.sqrt(np.trace(self._spread, axis1=1, axis2=2) / 2)  # (k,)
        typical = np.trace(self._errors, axis1=1, axis2=2).mean() / 2
        sigma2 = 2 * (scale**2 + typical)  # the pose itself is proposed from noisy points
        support = np.zeros(len(poses))
        for k, point in enumerate(self._points):
            at = poses[:, :2] + _rotations(poses[:, 2]) @ point
            distance, _ = self._tree.query(at)
            support += np.maximum(0.0, 1 - distance**2 / (sigma2[k] * GATE))
        return support

    def _refined(self, pose: FloatArray) -> tuple[FloatArray, FloatArray, IntArray] | None:
        """A pose by Gauss-Newton steps, its covariance, and the landmark of each point."""
        which = np.full(len(self._points), -1)
        information = np.zeros((3, 3))
        for _ in range(ITERATIONS):
            v, S, J, near = self._residuals(pose)
            inverse = np.linalg.inv(S)
            square = np.einsum("ki,kij,kj->k", v, inverse, v)
            which = np.where(square < GATE, near, -1)
            use = which >= 0
            if use.sum() < 2:
                return None
            weighted = J[use].transpose(0, 2, 1) @ inverse[use]
            information = (weighted @ J[use]).sum(0)
            step = np.linalg.solve(information, (weighted @ v[use, :, None]).sum(0)[:, 0])
            pose = pose + step
        pose[2] = float(wrap(pose[2]))
        return pose, np.linalg.inv(information), which

    def _residuals(self, pose: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Of each point: landmark less point in the map, covariance, Jacobian, the landmark."""
        rotation = _rotations(pose[2:])[0]
        at = self._points @ rotation.T
        _, near = self._tree.query(pose[:2] + at)
        v = self._landmarks[near] - pose[:2] - at
        S = rotation @ self._spread @ rotation.T + self._errors[near]
        J = np.tile(np.eye(2, 3), (len(at), 1, 1))
        J[:, 0, 2], J[:, 1, 2] = -at[:, 1], at[:, 0]
        return v, S, J, near

    def _evidence(self, pose: FloatArray, covariance: FloatArray, which: IntArray) -> float:
        """Log of the density of the points for a robot near a pose (Laplace's approximation)."""
        v, S, _, _ = self._residuals(pose)
        reach = np.linalg.norm(self._points, axis=1).max()
        visible = max(1, len(self._tree.query_ball_point(pose[:2], reach)))
        square = np.einsum("ki,kij,kj->k", v, np.linalg.inv(S), v)
        density = np.exp(-square / 2) / (2 * pi * np.sqrt(np.linalg.det(S)))
        share = self._config.unmapped
        mixture = share / self._area + (1 - share) / visible * density
        volume = (2 * pi) ** 1.5 * np.sqrt(np.linalg.det(covariance))
        low, high = self._landmarks.min(0), self._landmarks.max(0)
        extent = float(np.prod(high - low + 2 * reach)) * 2 * pi
        return float(np.log(mixture).sum() + log(volume / extent))

    @property
    def _area(self) -> float:
        """Square metres in which an unmapped point may be."""
        return pi * float(np.linalg.norm(self._points, axis=1).max()) ** 2

    def _weighed(
        self, pose: list[FloatArray], covariance: list[FloatArray], score: list[float]
    ) -> PoseHypotheses:
        elsewhere = log(self._config.elsewhere) - len(self._points) * log(self._area)
        inside = np.array(score) + log(1 - self._config.elsewhere)
        weight = inside - logsumexp(np.append(inside, elsewhere))
        order = np.argsort(-weight, kind="stable")
        k = len(self._points)
        return PoseHypotheses(
            pose=np.array(pose).reshape(-1, 3)[order],
            covariance=np.array(covariance).reshape(-1, 3, 3)[order],
            probability=np.exp(weight[order]),
            association=np.full((len(order), k), -1),
        )


def _rotations(angle: FloatArray) -> FloatArray:
    """(n, 2, 2) matrices that turn by angles (n,)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def _local_errors(tree: cKDTree, xy: FloatArray, covariance: FloatArray) -> FloatArray:
    """(N, 2, 2) covariance of each landmark relative to its neighbors: half of the difference's."""
    n = len(xy)
    if covariance.shape == (n, 2, 2) or n < 2:
        return covariance.reshape(n, 2, 2) if n else np.empty((0, 2, 2))
    blocks = covariance.reshape(n, 2, n, 2).transpose(0, 2, 1, 3)
    _, near = tree.query(xy, min(NEIGHBORS, n - 1) + 1)
    i = np.arange(n)[:, None]
    j = near[:, 1:]
    cross = blocks[i, j]
    difference = blocks[i, i] + blocks[j, j] - cross - cross.transpose(0, 1, 3, 2)
    return difference.mean(1) / 2


def _fused(
    xy: FloatArray, C: FloatArray, new: FloatArray, D: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points with those of a new scan, of the same landmark where they are mutual neighbors."""
    if len(xy) == 0 or len(new) == 0:
        return np.concatenate([xy, new]), np.concatenate([C, D])
    v = new[:, None] - xy
    S = C + D[:, None]
    square = np.einsum("mki,mkij,mkj->mk", v, np.linalg.inv(S), v)
    near = square.argmin(1)
    mutual = square[:, near].argmin(0) == np.arange(len(new))
    mutual &= square.argmin(0)[near] == np.arange(len(new))
    mutual &= square[np.arange(len(new)), near] < GATE
    xy, C = xy.copy(), C.copy()
    for m in np.flatnonzero(mutual):
        k = near[m]
        K = C[k] @ np.linalg.inv(S[m, k])
        xy[k] += K @ v[m, k]
        C[k] -= K @ C[k]
    return np.concatenate([xy, new[~mutual]]), np.concatenate([C, D[~mutual]])


def _spread_choice(first: IntArray, second: IntArray, count: int) -> IntArray:
    """Indices of pairs, in their order, such that no point is in many of them."""
    uses = np.zeros(max(first.max(), second.max()) + 1, np.int64)
    chosen: list[int] = []
    for limit in range(1, count + 1):
        for n, (i, j) in enumerate(zip(first, second, strict=True)):
            if len(chosen) == count:
                return np.array(chosen)
            if n not in chosen and max(uses[i], uses[j]) < limit:
                chosen.append(n)
                uses[[i, j]] += 1
    return np.array(chosen)


def _distinct(poses: FloatArray, limit: int) -> FloatArray:
    """Of the first poses those that are not near a better one: half a metre, a tenth of a radian."""
    kept: list[FloatArray] = []
    for pose in poses[:limit]:
        near = [
            np.hypot(*(pose[:2] - other[:2])) < 0.5 and abs(float(wrap(pose[2] - other[2]))) < 0.1
            for other in kept
        ]
        if not any(near):
            kept.append(pose)
    return np.array(kept).reshape(-1, 3)


def _is_known(pose: FloatArray, known: list[FloatArray], covariance: list[FloatArray]) -> bool:
    for other, C in zip(known, covariance, strict=True):
        e = pose - other
        e[2] = float(wrap(e[2]))
        if e @ np.linalg.solve(C, e) < 9.0 or (np.hypot(*e[:2]) < 0.05 and abs(e[2]) < 0.01):
            return True
    return False
