"""Relocalization: hypotheses of the pose in a known map, from one scan or several.

Pairs of observed points are matched to pairs of landmarks at the same distance, as in the
constraint search of Neira, Tardos & Castellanos (2003). Every match of two pairs proposes a pose;
the proposals with the most support are refined. Their probabilities follow from their evidence,
relative to each other and to a robot outside the map. Controls move these hypotheses, and later
scans weight them.
"""

from math import log, pi
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import logsumexp

from saccade.errors import require
from saccade.plane import rotations
from saccade.slam._relocalization_kernels import Grid, add_support
from saccade.slam.consistency import chi_square_gate, difference_covariances, normalized_squared
from saccade.slam.filter.robot_models import (
    as_relative_pose,
    compose,
    inverse_observe,
    observe,
    pose_difference,
    wrap,
)
from saccade.slam.filter.validation import check_all
from saccade.slam.results import PoseHypotheses
from saccade.types import BoolArray, FloatArray, IntArray

NEIGHBORS = 4
"""Number of neighbors that define the local error of a landmark."""
POINT_GATE = chi_square_gate(2, 0.99)
"""Squared Mahalanobis distance within which a point is associated with its nearest landmark."""
MIN_PROPOSING_PAIRS = 4
"""Number of pairs of observed points that always propose poses."""
MAX_PROPOSING_PAIRS = 12
"""Largest number of pairs of observed points that propose poses; distant pairs come first."""
MAX_LAYOUT_PROPOSALS = 5000
"""Largest number of proposed transforms of a layout of points."""
MAX_LAYOUTS = 10
"""Largest number of refined transforms of a layout of points."""
MAX_POINT_AGE = 10
"""Number of scans for which an observed point counts."""
LABELED_MEMORY = 200
"""Number of scans for which an observed point with the label of a landmark counts: a camera that
sees one tag at a time must drive from one to the next."""
UNMAPPED = 0.2
"""Prior probability that an observed point is not a landmark of the map."""
WRONG_LABEL = 0.01
"""Prior probability that a label is wrong."""
ELSEWHERE = 0.05
"""Prior probability that the robot is outside of the map."""
SETTLED = 0.999
"""Minimum total probability of the hypotheses for a scan without a new search."""
NEGLIGIBLE_PROBABILITY = 1e-6
"""Least probability of a hypothesis."""
REFINEMENT_STEPS = 4
"""Number of Gauss-Newton steps of a refinement."""
SAME_PROPOSAL = 0.5
"""Largest distance of equal proposals in meters; a tenth of it for refined poses."""
SAME_HEADING = 0.1
"""Largest difference of headings of equal proposals in radians; a tenth of it for refined poses."""
SAME_REFINED_POSE = 9.0
"""Largest squared Mahalanobis distance of equal refined poses."""


class Relocalizer:
    """Global localization in a map of point landmarks, scan by scan.

    Args:
        landmarks: (N, 2) meters.
        covariance: (N, 2, 2) of each landmark or, better, (2N, 2N) of all: correlations remove the
            common errors of neighboring landmarks.
        max_proposals: largest number of proposed poses, except from the first
            `MIN_PROPOSING_PAIRS` pairs.
        max_hypotheses: largest number of refined poses.
        wrong_label: probability that a label of a landmark is observed elsewhere. It is 1 for
            descriptors: the most similar landmark is then the label of every observation.

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
        max_proposals: int = 50_000,
        max_hypotheses: int = 50,
        wrong_label: float = WRONG_LABEL,
    ) -> None:
        n = len(landmarks)
        require(landmarks.shape == (n, 2), "landmarks", "(N, 2)", landmarks.shape)
        known = covariance.shape in ((n, 2, 2), (2 * n, 2 * n))
        require(known, "covariance", f"({n}, 2, 2) or ({2 * n}, {2 * n})", covariance.shape)
        self._landmarks = landmarks
        self._max_proposals, self._max_hypotheses = max_proposals, max_hypotheses
        self._wrong_label, self._has_labels = wrong_label, wrong_label < 1
        self._tree = cKDTree(landmarks)
        self._errors = _local_errors(self._tree, landmarks, covariance)
        self._points, self._covariances = np.empty((0, 2)), np.empty((0, 2, 2))
        self._labeled, self._age = np.empty(0, np.int64), np.empty(0, np.int64)
        self._tracked, self._total = np.empty((0, 3)), 0.0
        self._pairs = _LandmarkPairs(0.0, np.empty((0, 2), np.int64), np.empty(0))
        self.latest = np.empty(0, np.int64)
        """(m,) column in `PoseHypotheses.association` of each observation of the last scan."""

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """Moves the robot by a control (c,), as in `EkfSlam.predict`, with covariance (c, c)."""
        moved, Q, _ = as_relative_pose(u, U)
        rotation = rotations(moved[2]).T
        self._points = (self._points - moved[:2]) @ rotation.T
        J = pose_jacobians(self._points)
        J[:, :, :2] = rotation
        self._covariances = rotation @ self._covariances @ rotation.T + J @ Q @ J.transpose(0, 2, 1)
        poses = [compose(pose, moved)[0] for pose in self._tracked]
        self._tracked = np.array(poses).reshape(-1, 3)

    def propose(self, pose: FloatArray) -> None:
        """Adds a pose (3,) to the proposals."""
        self._tracked = np.concatenate([self._tracked, pose[None]])

    def add(self, z: FloatArray, R: FloatArray, landmark: IntArray | None = None) -> PoseHypotheses:
        """Adds a scan, and searches for its pose.

        Args:
            z: (k, 2) range in meters, bearing in radians.
            R: (k, 2, 2) their covariances.
            landmark: (k,) row of the landmark of each label, -1 for none.

        Returns:
            Hypotheses that explain all scans so far.

        Raises:
            LogError: an observation or covariance is not finite.
        """
        check_all("observation", z, R.copy())
        xy, _, Gz = inverse_observe(np.zeros(3), z)
        return self.add_points(xy, Gz @ R @ Gz.transpose(0, 2, 1), landmark)

    def add_points(
        self, xy: FloatArray, covariance: FloatArray, landmark: IntArray | None = None
    ) -> PoseHypotheses:
        """`add` with points (k, 2) in the frame of the robot and covariances (k, 2, 2)."""
        none = np.full(len(xy), -1)
        self._remember(xy, covariance, none if landmark is None else landmark)
        proposals = self._tracked
        if self._total < SETTLED:
            proposals = np.concatenate([proposals, self._proposals()])
        pose, covariance, association = self._refine(proposals)
        distinct: list[int] = []
        for i in range(len(pose)):
            e = pose_difference(pose[i], pose[distinct])
            near = (np.hypot(e[:, 0], e[:, 1]) < SAME_PROPOSAL / 10) & (
                np.abs(e[:, 2]) < SAME_HEADING / 10
            )
            if not (near | (normalized_squared(e, covariance[distinct]) < SAME_REFINED_POSE)).any():
                distinct.append(i)
        found = self._posterior(pose[distinct], covariance[distinct], association[distinct])
        likely = found.probability > NEGLIGIBLE_PROBABILITY
        self._tracked, self._total = found.pose[likely], float(found.probability.sum())
        return found

    @property
    def observations(self) -> tuple[FloatArray, FloatArray]:
        """The k points observed in the last scans: (k, 2) range, bearing; (k, 2, 2) covariances."""
        z, H = observe(np.zeros(3), self._points)
        J = H[..., 3:]
        return z, J @ self._covariances @ J.swapaxes(-1, -2)

    @property
    def labeled(self) -> BoolArray:
        """(k,) whether each of the observed points has the label of a landmark."""
        return self._labeled >= 0

    def _remember(self, xy: FloatArray, C: FloatArray, labeled: IntArray) -> None:
        """Merges the points of a scan with points of earlier scans, and drops old points.

        The last position of a label replaces an earlier one.
        """
        kept = self._age < np.where(self.labeled & self._has_labels, LABELED_MEMORY, MAX_POINT_AGE)
        points, covariances = self._points[kept], self._covariances[kept]
        old, age = self._labeled[kept], self._age[kept] + 1
        differ = (labeled[:, None] != old) & (labeled[:, None] >= 0) & (old >= 0)
        same = _same_points(points, covariances, xy, C, differ)
        new = same < 0
        m, k = np.flatnonzero(~new), same[~new]
        K = covariances[k] @ np.linalg.inv(covariances[k] + C[m])
        points[k] += (K @ (xy[m] - points[k])[..., None])[..., 0]
        covariances[k] -= K @ covariances[k]
        age[k], old[k] = 0, np.maximum(labeled[m], old[k])
        left = (age == 0) | ~(self._has_labels & np.isin(old, labeled[labeled >= 0]))
        numbers = np.append(np.cumsum(left), 0) - 1  # of the points that are left
        self.latest = np.where(new, left.sum() + np.cumsum(new) - 1, numbers[same])
        self._points = np.concatenate([points[left], xy[new]])
        self._covariances = np.concatenate([covariances[left], C[new]])
        self._labeled = np.concatenate([old[left], labeled[new]])
        self._age = np.concatenate([age[left], np.zeros(new.sum(), np.int64)])

    def _proposals(self) -> FloatArray:
        """(h, 3) poses that map two observed points to two landmarks, by decreasing support."""
        p, pairs = self._points, self._point_pairs()
        if len(pairs) == 0 or len(self._landmarks) < 2:
            return np.empty((0, 3))
        separation = np.linalg.norm(p[pairs[:, 1]] - p[pairs[:, 0]], axis=1)
        variance = np.trace(self._errors, axis1=1, axis2=2).mean()
        known = self._landmark_pairs(float(separation.max()) * 1.1 + 3 * variance**0.5)
        along = (p[pairs[:, 1]] - p[pairs[:, 0]]) / separation[:, None]
        covariances = self._covariances[pairs].sum(1)
        sigma = np.sqrt(np.einsum("mi,mij,mj->m", along, covariances, along) + variance)
        first = np.searchsorted(known.distance, separation - 3 * sigma)
        last = np.searchsorted(known.distance, separation + 3 * sigma)
        poses, total = [], 0
        for number, m in enumerate(np.argsort(last - first, kind="stable")):
            i, j = pairs[m]
            ends = known.ends[first[m] : last[m]]
            if self._labeled[i] >= 0 and self._labeled[j] >= 0:
                ends = np.array([[self._labeled[i], self._labeled[j]]])
            total += len(ends)
            if number >= MIN_PROPOSING_PAIRS and total > self._max_proposals:
                break
            vector = self._landmarks[ends[:, 1]] - self._landmarks[ends[:, 0]]
            heading = np.arctan2(vector[:, 1], vector[:, 0])
            heading = wrap(heading - np.arctan2(along[m, 1], along[m, 0]))
            center = self._landmarks[ends].mean(1)
            xy = center - rotations(heading) @ ((p[i] + p[j]) / 2)
            poses.append(np.column_stack([xy, heading]))
        proposals = np.concatenate(poses)
        support = self._support(proposals)
        best = np.argsort(-support, kind="stable")[: 20 * self._max_hypotheses]
        return _distinct(proposals[best], self._max_hypotheses)

    def _point_pairs(self) -> IntArray:
        """(m, 2) pairs of observed points, the most distant first, with few uses of each point."""
        ends = np.column_stack(np.triu_indices(len(self._points), 1))
        separation = np.linalg.norm(self._points[ends[:, 0]] - self._points[ends[:, 1]], axis=1)
        order = np.argsort(-separation, kind="stable")[: np.count_nonzero(separation)]
        uses, chosen = np.zeros(len(self._points), np.int64), dict[int, None]()
        for limit in range(1, MAX_PROPOSING_PAIRS + 1):
            for pair in order.tolist():
                if len(chosen) == MAX_PROPOSING_PAIRS:
                    return ends[list(chosen)]
                if pair not in chosen and uses[ends[pair]].max() < limit:
                    uses[ends[pair]] += 1
                    chosen[pair] = None
        return ends[list(chosen)]

    def _landmark_pairs(self, reach: float) -> "_LandmarkPairs":
        """Ordered pairs of landmarks, at least all pairs up to a distance."""
        if self._pairs.reach < reach:
            reach *= 1.2  # spares a search for scans that reach a little farther
            ends = self._tree.query_pairs(reach, output_type="ndarray")
            ends = np.concatenate([ends, ends[:, ::-1]])
            vector = self._landmarks[ends[:, 1]] - self._landmarks[ends[:, 0]]
            distance = np.hypot(*vector.T)
            order = np.argsort(distance, kind="stable")
            self._pairs = _LandmarkPairs(reach, ends[order], distance[order])
        return self._pairs

    def _support(self, poses: FloatArray) -> FloatArray:
        """(h,) sum over the points of a truncated quadratic of the distance to a landmark."""
        variance = np.trace(self._covariances, axis1=1, axis2=2) / 2  # (k,)
        variance = variance + np.trace(self._errors, axis1=1, axis2=2).mean() / 2
        # Twice the variance: the proposed pose has errors of the same size.
        scale, support = 2 * variance * POINT_GATE, np.empty(len(poses))
        grid = build_grid(self._landmarks, float(scale.max()) ** 0.5)
        add_support(grid, poses, self._points, scale, support)
        return support

    def _refine(self, poses: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Poses refined by Gauss-Newton, their covariances, the landmark of each point, or -1.

        Poses (h, 3) with fewer than two matched points are dropped.
        """
        if len(poses) == 0 or len(self._landmarks) == 0:
            none = np.empty((0, len(self._points)), np.int64)
            return np.empty((0, 3)), np.empty((0, 3, 3)), none
        poses = poses.copy()
        for _ in range(REFINEMENT_STEPS):
            v, S, J, nearest = self._residuals(poses)
            inside = normalized_squared(v, S) < POINT_GATE
            matched = inside.sum(1) >= 2
            poses, v, S, J, inside, nearest = (
                each[matched] for each in (poses, v, S, J, inside, nearest)
            )
            weighted = inside[..., None, None] * (J.swapaxes(-1, -2) @ np.linalg.inv(S))
            information = (weighted @ J).sum(1)
            gradient = (weighted @ v[..., None]).sum(1)
            poses += np.linalg.solve(information, gradient)[..., 0]
        poses[:, 2] = wrap(poses[:, 2])
        return poses, np.linalg.inv(information), np.where(inside, nearest, -1)

    def _residuals(self, poses: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Residuals of points and nearest landmarks, covariances, Jacobians, rows of landmarks."""
        rotation = rotations(poses[:, 2])[:, None]  # (h, 1, 2, 2)
        at = (rotation @ self._points[..., None])[..., 0]  # (h, k, 2)
        near = np.asarray(self._tree.query(poses[:, None, :2] + at)[1], np.int64)
        near = np.where(self._labeled >= 0, self._labeled, near)
        v = self._landmarks[near] - poses[:, None, :2] - at
        S = rotation @ self._covariances @ rotation.swapaxes(-1, -2) + self._errors[near]
        return v, S, pose_jacobians(at), near

    def _log_evidence(self, pose: FloatArray, covariance: FloatArray) -> FloatArray:
        """(h,) log of the density of the points for a robot near each pose (Laplace)."""
        v, S, _, _ = self._residuals(pose)
        reach, xy = self._reach, pose[:, :2]
        around = np.maximum(self._tree.query_ball_point(xy, reach, return_length=True), 1)
        visible = np.where(self.labeled, 1, around[:, None])
        determinant = np.linalg.det(S)  # of a diverged estimate, rounding may make it negative
        area = 2 * pi * np.sqrt(np.where(determinant > 0, determinant, np.inf))
        density = np.exp(-normalized_squared(v, S) / 2) / area
        chance = np.where(self.labeled, min(UNMAPPED, self._wrong_label), UNMAPPED)
        mixture = chance / (pi * reach**2) + (1 - chance) / visible * density
        log_volume = 1.5 * log(2 * pi) + np.linalg.slogdet(covariance)[1] / 2
        low, high = self._landmarks.min(0), self._landmarks.max(0)
        prior = 1 / (float(np.prod(high - low + 2 * reach)) * 2 * pi)
        return np.asarray(np.log(mixture).sum(1) + log_volume + log(prior))

    def _posterior(
        self, pose: FloatArray, covariance: FloatArray, association: IntArray
    ) -> PoseHypotheses:
        outside = log(ELSEWHERE) - len(self._points) * log(pi * self._reach**2)
        outside += np.count_nonzero(self.labeled) * log(self._wrong_label)
        inside = self._log_evidence(pose, covariance) if len(pose) > 0 else np.empty(0)
        inside += log(1 - ELSEWHERE)
        probability = np.exp(inside - logsumexp(np.append(inside, outside)))
        order = np.argsort(-probability, kind="stable")
        return PoseHypotheses(
            pose[order], covariance[order], probability[order], association[order]
        )

    @property
    def _reach(self) -> float:
        """Meters to the most distant point observed."""
        return float(np.linalg.norm(self._points, axis=1).max(initial=1e-6))


def locate(
    points: FloatArray, errors: FloatArray, landmarks: FloatArray, covariance: FloatArray
) -> PoseHypotheses:
    """Finds a layout of points among landmarks: transforms of its frame into the map.

    Args:
        points: (k, 2) meters, in any frame.
        errors: (k, 2, 2) their covariances, or (2, 2) one for all.
        landmarks: (N, 2), as in `Relocalizer`.
        covariance: (N, 2, 2) or (2 N, 2 N).
    """
    search = Relocalizer(landmarks, covariance, MAX_LAYOUT_PROPOSALS, MAX_LAYOUTS)
    return search.add_points(points, np.broadcast_to(errors, (len(points), 2, 2)))


class _LandmarkPairs(NamedTuple):
    """Ordered pairs of landmarks (m, 2) up to a reach in meters, by their distance (m,)."""

    reach: float
    ends: IntArray
    distance: FloatArray


def pose_jacobians(points: FloatArray) -> FloatArray:
    """(..., 2, 3) of points (..., 2) by the translation and the turn that move them."""
    J = np.tile(np.eye(2, 3), (*points.shape[:-1], 1, 1))
    J[..., 0, 2], J[..., 1, 2] = -points[..., 1], points[..., 0]
    return J


def _distinct(poses: FloatArray, count: int) -> FloatArray:
    """The first poses (h, 3) that are not near an earlier one, at most `count`."""
    found: list[FloatArray] = []
    while len(poses) > 0 and len(found) < count:
        found.append(poses[0])
        e = pose_difference(poses, poses[0])
        near = (np.hypot(e[:, 0], e[:, 1]) < SAME_PROPOSAL) & (np.abs(e[:, 2]) < SAME_HEADING)
        poses = poses[~near]
    return np.array(found).reshape(-1, 3)


def _local_errors(tree: cKDTree, xy: FloatArray, covariance: FloatArray) -> FloatArray:
    """(N, 2, 2) covariance of each landmark relative to its neighbors: half of the difference's."""
    n = len(xy)
    if covariance.shape == (n, 2, 2) or n < 2:
        return covariance.reshape(n, 2, 2) if n else np.empty((0, 2, 2))
    near = np.asarray(tree.query(xy, min(NEIGHBORS, n - 1) + 1)[1], np.int64)[:, 1:]
    difference = difference_covariances(covariance, np.arange(n)[:, None], near)
    return np.asarray(difference.mean(1) / 2)


def _same_points(
    xy: FloatArray, C: FloatArray, new: FloatArray, D: FloatArray, differ: BoolArray
) -> IntArray:
    """(m,) mutually nearest of the points (k, 2) for each point of a scan (m, 2), -1 for none.

    Points with different labels are excluded by `differ` (m, k).
    """
    if len(xy) == 0 or len(new) == 0:
        return np.full(len(new), -1)
    square = normalized_squared(new[:, None] - xy, C + D[:, None])
    square[differ] = np.inf
    near = square.argmin(1)
    mutual = square.argmin(0)[near] == np.arange(len(new))
    return np.where(mutual & (square[np.arange(len(new)), near] < POINT_GATE), near, -1)


def build_grid(landmarks: FloatArray, size: float) -> Grid:
    """A grid of landmarks (N, 2), N over 0, with cells of this side or larger."""
    low, extent = landmarks.min(0), np.ptp(landmarks, axis=0)
    size = max(size, float(extent.max()) / (2 * len(landmarks) ** 0.5 + 1), 1e-6)
    nx, ny = (int(n) + 1 for n in extent / size)
    cell = np.floor((landmarks - low) / size).astype(np.int64) @ [ny, 1]
    order = np.argsort(cell, kind="stable")
    start = np.searchsorted(cell[order], np.arange(nx * ny + 1))
    return Grid(low, size, (nx, ny), start, np.array(landmarks[order], np.float64))
