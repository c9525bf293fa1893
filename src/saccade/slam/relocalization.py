"""Relocalization: hypotheses of the pose in a known map, from one scan or several.

Pairs of observed points are matched to pairs of landmarks at the same distance, as in the
constraint search of Neira, Tardos & Castellanos (2003). Every match of two pairs proposes a pose;
the proposals with the most support are refined, and get probabilities by their evidence, relative
to each other and to a robot outside of the map.
"""

from dataclasses import dataclass
from math import log, pi
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.special import logsumexp

from saccade.errors import require
from saccade.slam.consistency import chi_square_gate, normalized_squared
from saccade.slam.filter.validation import check_all
from saccade.slam.models import RANGE_BEARING, Motion, compose, wrap
from saccade.types import FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

NEIGHBORS = 4
"""Number of neighbors relative to which the error of a landmark is taken."""
GATE = chi_square_gate(2, 0.99)
"""Squared Mahalanobis distance within which a point is associated with its nearest landmark."""
ITERATIONS = 4
"""Gauss-Newton steps of a refinement."""
SAME_POSITION, SAME_HEADING = 0.5, 0.1
"""Metres and radians within which proposals are the same."""


@dataclass(frozen=True)
class RelocalizationConfig:
    """Parameters of relocalization."""

    unmapped: float = 0.2
    """Prior probability that an observed point is no landmark of the map."""
    elsewhere: float = 0.05
    """Prior probability that the robot is outside of the map."""
    max_pairs: int = 12
    """Pairs of observed points that propose poses, the most distant ones first."""
    max_proposals: int = 50_000
    """Proposed poses whose support is computed."""
    max_hypotheses: int = 50
    """Proposed poses that are refined, those with the most support."""

    def __post_init__(self) -> None:
        for name in ("unmapped", "elsewhere"):
            require(0 < getattr(self, name) < 1, name, "between 0 and 1", getattr(self, name))
        for name in ("max_pairs", "max_proposals", "max_hypotheses"):
            require(getattr(self, name) >= 1, name, "at least 1", getattr(self, name))


@dataclass(frozen=True, eq=False, repr=False)
class PoseHypotheses:
    """Hypotheses of the robot's pose in a map, the most probable first."""

    pose: FloatArray
    """(h, 3) x, y in metres, heading in radians."""
    covariance: FloatArray
    """(h, 3, 3)."""
    probability: FloatArray
    """(h,) posterior probabilities; the rest to 1 is that of being outside of the map."""
    association: IntArray
    """(h, k) row of the landmark of each of the k observed points, -1 for none."""

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
    """Global localization in a map of point landmarks, scan by scan.

    Args:
        landmarks: (N, 2) metres.
        covariance: (N, 2, 2) of each landmark or, better, (2N, 2N) of all: with correlations the
            errors that neighboring landmarks share are left out.
        config: prior probabilities and limits of the search.
        motion: motion model of the controls between scans.

    Raises:
        ConfigError: the shapes do not agree.

    Examples:
        >>> import numpy as np
        >>> from saccade import slam
        >>> landmarks = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0], [6.0, 5.0], [2.0, 7.0]])
        >>> search = slam.Relocalizer(landmarks, np.tile(1e-4 * np.eye(2), (5, 1, 1)))
        >>> z, _ = slam.observe(np.array([3.0, 2.0, 0.5]), landmarks)
        >>> hypotheses = search.add(z, np.tile(np.diag([1e-4, 1e-4]), (5, 1, 1)))
        >>> hypotheses.pose[0].round(2)
        array([3. , 2. , 0.5])

    Source: Neira, Tardos & Castellanos (2003), "Linear time vehicle relocation in SLAM".
    """

    def __init__(
        self,
        landmarks: FloatArray,
        covariance: FloatArray,
        config: RelocalizationConfig = RelocalizationConfig(),
        motion: Motion = compose,
    ) -> None:
        from scipy.spatial import cKDTree

        n = len(landmarks)
        require(landmarks.shape == (n, 2), "landmarks", "(N, 2)", landmarks.shape)
        known = covariance.shape in ((n, 2, 2), (2 * n, 2 * n))
        require(known, "covariance", f"({n}, 2, 2) or ({2 * n}, {2 * n})", covariance.shape)
        self._landmarks, self._config, self._motion = landmarks, config, motion
        self._tree = cKDTree(landmarks)
        self._errors = _local_errors(self._tree, landmarks, covariance)
        self._points, self._spread = np.empty((0, 2)), np.empty((0, 2, 2))

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """Predict the motion between two scans.

        Args:
            u: (c,) control of the motion model.
            U: (c, c) its covariance.
        """
        moved, _, Fu = self._motion(np.zeros(3), u)
        Q = Fu @ U @ Fu.T  # (3, 3)
        rotation = _rotations(moved[2:])[0].T
        self._points = (self._points - moved[:2]) @ rotation.T
        J = _pose_jacobians(self._points)
        J[:, :, :2] = rotation
        self._spread = rotation @ self._spread @ rotation.T + J @ Q @ J.transpose(0, 2, 1)

    def add(self, z: FloatArray, R: FloatArray) -> PoseHypotheses:
        """Add a scan, and search for the pose at which it was made.

        Args:
            z: (k, 2) range in metres, bearing in radians.
            R: (k, 2, 2) their covariances.

        Returns:
            Hypotheses that explain all scans so far.

        Raises:
            LogError: an observation or covariance is not finite.
        """
        check_all("observation", z, R)
        xy, _, Gz = RANGE_BEARING.inverse_observe(np.zeros(3), z)
        self._points, self._spread = _fused(
            self._points, self._spread, xy, Gz @ R @ Gz.transpose(0, 2, 1)
        )
        modes: list[_Mode] = []
        for proposed in self._proposals()[: self._config.max_hypotheses]:
            mode = self._refine(proposed)
            if mode is not None and not any(_is_same(mode, other) for other in modes):
                modes.append(mode)
        return self._posterior(modes)

    def _proposals(self) -> FloatArray:
        """(h, 3) poses that map two observed points to two landmarks, by decreasing support."""
        p, pairs = self._points, self._point_pairs()
        if len(pairs) == 0 or len(self._landmarks) < 2:
            return np.empty((0, 3))
        separation = np.linalg.norm(p[pairs[:, 1]] - p[pairs[:, 0]], axis=1)
        variance = np.trace(self._errors, axis1=1, axis2=2).mean()
        ends, vector, distance = self._landmark_pairs(separation.max() * 1.1 + 3 * variance**0.5)
        limit = self._config.max_proposals // len(pairs)
        poses = []
        for (i, j), d in zip(pairs, separation, strict=True):
            along = (p[j] - p[i]) / d
            sigma = np.sqrt(along @ (self._spread[i] + self._spread[j]) @ along + variance)
            similar = np.arange(*np.searchsorted(distance, [d - 3 * sigma, d + 3 * sigma]))
            order = np.argsort(np.abs(distance[similar] - d), kind="stable")
            similar = similar[order[:limit]]
            heading = np.arctan2(vector[similar, 1], vector[similar, 0])
            heading = wrap(heading - np.arctan2(along[1], along[0]))
            center = self._landmarks[ends[similar]].mean(1)
            xy = center - _rotations(heading) @ ((p[i] + p[j]) / 2)
            poses.append(np.column_stack([xy, heading]))
        proposals = np.concatenate(poses)
        ranking = np.argsort(-self._support(proposals), kind="stable")
        return _distinct(proposals[ranking], 20 * self._config.max_hypotheses)

    def _point_pairs(self) -> IntArray:
        """(m, 2) observed points, the most distant pairs first, no point in many of them."""
        first, second = np.triu_indices(len(self._points), 1)
        separation = np.linalg.norm(self._points[first] - self._points[second], axis=1)
        order = np.argsort(-separation, kind="stable")[: np.count_nonzero(separation)]
        uses = np.zeros(len(self._points), np.int64)
        chosen: dict[int, None] = {}
        for limit in range(1, self._config.max_pairs + 1):
            for pair in order:
                ends = [first[pair], second[pair]]
                if len(chosen) < self._config.max_pairs and uses[ends].max() < limit:
                    if pair not in chosen:
                        uses[ends] += 1
                    chosen[pair] = None
        return np.column_stack([first, second])[list(chosen)]

    def _landmark_pairs(self, reach: float) -> tuple[IntArray, FloatArray, FloatArray]:
        """(m, 2) ordered pairs up to a distance, their difference (m, 2), distance (m,) sorted."""
        pairs = self._tree.query_pairs(reach, output_type="ndarray")
        pairs = np.concatenate([pairs, pairs[:, ::-1]])
        vector = self._landmarks[pairs[:, 1]] - self._landmarks[pairs[:, 0]]
        distance = np.linalg.norm(vector, axis=1)
        order = np.argsort(distance, kind="stable")
        return pairs[order], vector[order], distance[order]

    def _support(self, poses: FloatArray) -> FloatArray:
        """(h,) sum over the points of a truncated quadratic of the distance to a landmark."""
        variance = np.trace(self._spread, axis1=1, axis2=2) / 2  # (k,)
        variance = variance + np.trace(self._errors, axis1=1, axis2=2).mean() / 2
        rotations, support = _rotations(poses[:, 2]), np.zeros(len(poses))
        for point, v in zip(self._points, variance, strict=True):
            distance, _ = self._tree.query(poses[:, :2] + rotations @ point)
            # Twice the variance: the proposed pose has errors of the same size.
            support += np.maximum(0.0, 1 - distance**2 / (2 * v * GATE))
        return support

    def _refine(self, pose: FloatArray) -> "_Mode | None":
        """Refine a pose by Gauss-Newton; None with fewer than two associated points."""
        for _ in range(ITERATIONS):
            v, S, J, nearest = self._residuals(pose)
            inverse = np.linalg.inv(S)
            inside = normalized_squared(v, S) < GATE
            if inside.sum() < 2:
                return None
            weighted = J[inside].transpose(0, 2, 1) @ inverse[inside]  # (m, 3, 2)
            information = (weighted @ J[inside]).sum(0)
            pose = pose + np.linalg.solve(information, (weighted @ v[inside, :, None]).sum(0)[:, 0])
        pose[2] = float(wrap(pose[2]))
        return _Mode(pose, np.linalg.inv(information), np.where(inside, nearest, -1))

    def _residuals(self, pose: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Residuals of points and nearest landmarks, covariances, Jacobians, rows of landmarks."""
        rotation = _rotations(pose[2:])[0]
        at = self._points @ rotation.T
        near = self._nearest(pose[:2] + at)
        v = self._landmarks[near] - pose[:2] - at
        S = rotation @ self._spread @ rotation.T + self._errors[near]
        return v, S, _pose_jacobians(at), near

    def _nearest(self, xy: FloatArray) -> IntArray:
        """(k,) landmarks nearest to positions (k, 2)."""
        return np.asarray(self._tree.query(xy)[1], np.int64)

    def _log_evidence(self, mode: "_Mode") -> float:
        """Log of the density of the points for a robot near a pose (Laplace's approximation)."""
        v, S, _, _ = self._residuals(mode.pose)
        reach = self._reach
        visible = max(1, len(self._tree.query_ball_point(mode.pose[:2], reach)))
        density = np.exp(-normalized_squared(v, S) / 2) / (2 * pi * np.sqrt(np.linalg.det(S)))
        unmapped = self._config.unmapped
        mixture = unmapped / (pi * reach**2) + (1 - unmapped) / visible * density
        volume = (2 * pi) ** 1.5 * np.sqrt(np.linalg.det(mode.covariance))
        low, high = self._landmarks.min(0), self._landmarks.max(0)
        prior = 1 / (float(np.prod(high - low + 2 * reach)) * 2 * pi)
        return float(np.log(mixture).sum() + log(volume * prior))

    def _posterior(self, modes: "list[_Mode]") -> PoseHypotheses:
        k, elsewhere = len(self._points), self._config.elsewhere
        outside = log(elsewhere) - k * log(pi * self._reach**2)
        inside = np.array([self._log_evidence(mode) for mode in modes]) + log(1 - elsewhere)
        probability = np.exp(inside - logsumexp(np.append(inside, outside)))
        ordered = [modes[i] for i in np.argsort(-probability, kind="stable")]
        return PoseHypotheses(
            pose=np.array([mode.pose for mode in ordered]).reshape(-1, 3),
            covariance=np.array([mode.covariance for mode in ordered]).reshape(-1, 3, 3),
            probability=-np.sort(-probability),
            association=np.array([mode.association for mode in ordered], int).reshape(
                len(modes), k
            ),
        )

    @property
    def _reach(self) -> float:
        """Metres to the most distant point observed."""
        return float(np.linalg.norm(self._points, axis=1).max(initial=1e-6))


class _Mode(NamedTuple):
    pose: FloatArray
    covariance: FloatArray
    association: IntArray


def _rotations(angle: FloatArray) -> FloatArray:
    """(n, 2, 2) matrices that turn by angles (n,)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def _pose_jacobians(points: FloatArray) -> FloatArray:
    """(k, 2, 3) of points (k, 2) by the translation and the turn that move them."""
    J = np.tile(np.eye(2, 3), (len(points), 1, 1))
    J[:, 0, 2], J[:, 1, 2] = -points[:, 1], points[:, 0]
    return J


def _local_errors(tree: "cKDTree", xy: FloatArray, covariance: FloatArray) -> FloatArray:
    """(N, 2, 2) covariance of each landmark relative to its neighbors: half of the difference's."""
    n = len(xy)
    if covariance.shape == (n, 2, 2) or n < 2:
        return covariance.reshape(n, 2, 2) if n else np.empty((0, 2, 2))
    blocks = covariance.reshape(n, 2, n, 2).transpose(0, 2, 1, 3)
    near = np.asarray(tree.query(xy, min(NEIGHBORS, n - 1) + 1)[1], np.int64)
    i = np.arange(n)[:, None]
    j = near[:, 1:]
    cross = blocks[i, j]
    difference = blocks[i, i] + blocks[j, j] - cross - cross.transpose(0, 1, 3, 2)
    return np.asarray(difference.mean(1) / 2)


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


def _distinct(poses: FloatArray, limit: int) -> FloatArray:
    """The poses among the first `limit` that are not near a better one."""
    kept: list[FloatArray] = []
    for pose in poses[:limit]:
        near = [
            np.hypot(*(pose[:2] - other[:2])) < SAME_POSITION
            and abs(float(wrap(pose[2] - other[2]))) < SAME_HEADING
            for other in kept
        ]
        if not any(near):
            kept.append(pose)
    return np.array(kept).reshape(-1, 3)


def _is_same(mode: _Mode, other: _Mode) -> bool:
    e = mode.pose - other.pose
    e[2] = float(wrap(e[2]))
    close = bool(np.hypot(*e[:2]) < SAME_POSITION / 10 and abs(e[2]) < SAME_HEADING / 10)
    return close or float(e @ np.linalg.solve(other.covariance, e)) < 9.0
