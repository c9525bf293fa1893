"""Merging: two maps of the same landmarks, in different frames, as one.

The correspondence is given by labels, or it is searched: groups of neighboring landmarks of one map
are located in the other by their mutual distances (`relocalization.locate`). The transform of a
group is an initial guess, and the correspondence grows by joint compatibility. Both maps and the
transform are then one Gaussian, under the constraint that common landmarks are equal.
"""

import copy
from dataclasses import dataclass
from math import log, pi
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.special import logsumexp

from saccade.errors import LogError
from saccade.plane import rotations
from saccade.slam.consistency import chi_square_gate, difference_covariances, normalized_squared
from saccade.slam.filter.robot_models import pose_difference, wrap
from saccade.slam.landmarks import ESTABLISHED, LabelRecord
from saccade.slam.online import Slam
from saccade.slam.relocalization import locate, pose_jacobians
from saccade.threads import SERIAL_BLAS
from saccade.types import FloatArray, IntArray

LANDMARK_GATE = chi_square_gate(2, 0.99)
"""Largest squared Mahalanobis distance of a pair of common landmarks."""
SAME_TRANSFORM = chi_square_gate(3, 0.999)
"""Largest squared Mahalanobis distance of equal transforms."""
AMBIGUOUS = 2 * log(20)
"""Minimum difference of squared distances between the second nearest landmark and the nearest, for
a likelihood ratio of twenty."""
MIN_COMMON = 5
"""Minimum number of common landmarks."""
GROUP = 8
"""Number of neighboring landmarks that are located together."""
MAX_GROUPS = 12
"""Largest number of groups, which are spread over the map."""
MIN_PROBABILITY = 0.99
"""Minimum probability of the correspondence, against others and against none."""
PASS_PROBABILITY = 0.9999
"""Probability with which consistent maps pass the test of their common landmarks."""
DISTORTION = 0.0025
"""Standard deviation that is added to landmarks in that test, as a fraction of the map's extent. It
stands for the systematic errors of right maps of recorded logs."""
MAX_STRETCH = 0.01
"""Standard deviation of the relative difference in size of right maps, beyond their covariance: the
sensors of two robots differ in scale."""
LIKELY = 0.05
"""Minimum probability of a location of a group."""
CLEAR = 20.0
"""Minimum log odds of a correspondence that makes the groups in it superfluous."""
MAX_ITERATIONS = 50
"""Largest number of Gauss-Newton steps of the transform."""


@dataclass(frozen=True, eq=False, repr=False)
class MergedMaps:
    """The result of a merging."""

    slam: Slam
    """The first map's robot and landmarks, then those landmarks of the second that are new."""
    transform: FloatArray
    """(3,) x, y in meters, heading in radians: the frame of the second map in the first."""
    covariance: FloatArray
    """(3, 3) of the transform."""
    common: IntArray
    """(m, 2) ids of the common landmarks in the first and the second map."""
    probability: float
    """Probability of the correspondence; 1 if it is by labels."""
    nis: float
    """Squared Mahalanobis distance of the two maps, chi-square with 2 m - 3 degrees of freedom."""

    def __repr__(self) -> str:
        return (
            f"MergedMaps({len(self.slam.filter)} landmarks, {len(self.common)} common, "
            f"probability {self.probability:.3f})"
        )


@SERIAL_BLAS
def merge_maps(first: Slam, second: Slam, *, anyway: bool = False) -> MergedMaps:
    """Merges two maps, in the frame of the first.

    Landmarks with the same label are the same, if both maps have `MIN_COMMON` such labels; else the
    correspondence is searched. The robot of the second map is left out.

    Args:
        first: SLAM with a map, as from `Slam.load`.
        second: SLAM with a map in any frame.
        anyway: whether to merge maps that have a warning (`Slam.warning`) or contradict each other;
            the merged map has the warnings then.

    Raises:
        LogError: the correspondence is not certain; a map has a warning; or the maps contradict
            each other: their joint NIS is too large for its chi-square distribution.
    """
    first, second = copy.deepcopy(first), copy.deepcopy(second)
    for each in (first, second):
        each.remove_candidates()
    maps = _Maps.of(first, second)
    best, probability = _correspondence(maps)
    if len(best.pairs) < MIN_COMMON or probability < MIN_PROBABILITY:
        raise LogError(
            f"merging: expected {MIN_COMMON} common landmarks with probability "
            f"{MIN_PROBABILITY:g}, found {len(best.pairs)} with {probability:.3f}"
        )
    warnings = _warnings(first, second, maps, best)
    if warnings and not anyway:
        raise LogError(f"merging: expected right maps, found {'; '.join(warnings)}")
    first_ids = first.filter.ids
    merged = _as_slam(first, second, maps, best)
    merged.warning = "; ".join(warnings)
    return MergedMaps(
        merged,
        best.transform,
        best.covariance,
        np.column_stack([first_ids[best.pairs[:, 0]], second.filter.ids[best.pairs[:, 1]]]),
        probability,
        best.nis,
    )


def _correspondence(maps: "_Maps") -> "tuple[_Fused, float]":
    """The most probable correspondence, by labels or by a search, and its probability."""
    _, by_label, other = np.intersect1d(*maps.labels, return_indices=True)
    labeled = maps.labels[0][by_label] >= 0
    pairs = np.column_stack([by_label, other])[labeled]
    if len(pairs) >= MIN_COMMON:
        return _grown(maps, pairs, _fitted(maps, pairs)), 1.0
    found = _search(maps)
    if len(found) == 0:
        raise LogError("merging: expected landmarks that both maps have, found none")
    evidence = np.array([each.log_odds for each in found])
    posterior = np.exp(evidence - logsumexp(np.append(evidence, 0.0)))
    return found[int(posterior.argmax())], float(posterior.max())


def _warnings(first: Slam, second: Slam, maps: "_Maps", fused: "_Fused") -> list[str]:
    """Why two maps should not be merged."""
    named = {"first": first, "second": second}
    found = [f"the {name} map: {each.warning}" for name, each in named.items() if each.warning]
    limit = chi_square_gate(2 * len(fused.pairs) - 3, PASS_PROBABILITY)
    added = (DISTORTION * float(np.ptp(maps.xy[0], axis=0).max())) ** 2
    P, Q = (C + added * np.eye(len(C)) for C in maps.P)
    nis = _fuse(maps._replace(P=(P, Q)), fused.pairs, fused.transform).nis
    if nis > limit:
        found.append(
            f"a joint NIS of {nis:.0f} of {len(fused.pairs)} common landmarks, for at most "
            f"{limit:.0f}"
        )
    stretch, variance = fused.stretch
    if stretch**2 > chi_square_gate(1, PASS_PROBABILITY) * (variance + MAX_STRETCH**2):
        sizes = [xy[rows].var(0).sum() for xy, rows in zip(maps.xy, fused.pairs.T, strict=True)]
        found.append(
            f"the second map {np.sqrt(sizes[1] / sizes[0]):.3f} times as large as the first; "
            "compare the ranges of both robots with a known length"
        )
    return found


class _Maps(NamedTuple):
    """Two maps; the first begins with the robot's r states."""

    r: int
    robot: FloatArray
    xy: tuple[FloatArray, FloatArray]
    """(N, 2) of each map."""
    P: tuple[FloatArray, FloatArray]
    """(r + 2 N, r + 2 N) of the first, (2 N, 2 N) of the second."""
    labels: tuple[IntArray, IntArray]
    """(N,) number of the label of each landmark, the same in both maps; -1 for none."""

    @classmethod
    def of(cls, first: Slam, second: Slam) -> "_Maps":
        """The maps of two robots."""
        a, b = first.filter, second.filter
        labels = [
            label
            for each in (first, second)
            for label in each.landmarks.labels_of(each.filter.ids.tolist())
        ]
        numbers = {label: i for i, label in enumerate(dict.fromkeys(labels))} | {None: -1}
        number, q = np.array([numbers[label] for label in labels], np.int64), len(b.robot_state)
        return cls(
            r=len(a.robot_state),
            robot=a.robot_state,
            xy=(a.landmarks, b.landmarks),
            P=(a.covariance, b.covariance[q:, q:]),
            labels=(number[: len(a)], number[len(a) :]),
        )


class _Fused(NamedTuple):
    """Both maps under the constraint that the landmarks of each pair are equal."""

    pairs: IntArray
    """(m, 2)."""
    transform: FloatArray
    covariance: FloatArray
    nis: float
    stretch: tuple[float, float]
    """Relative difference in size, positive if the first map is larger, and its variance."""
    scale: float
    """Factor on the covariances of both maps with which they agree, at least 1: maps may be
    overconfident."""
    log_odds: float
    """Log of the odds of the correspondence against landmarks near each other by chance."""
    mean: FloatArray
    """(n,) the robot, the landmarks of the first map, and of the second map in the same frame."""
    P: FloatArray
    """(n, n)."""


def _fuse(maps: _Maps, pairs: IntArray, transform: FloatArray) -> _Fused:
    """Conditions both maps and the transform, with an initial guess (3,), on pairs (m, 2)."""
    r, (a, b), (P, Q) = maps.r, maps.xy, maps.P
    rows = (r + 2 * pairs[:, :1] + [0, 1]).ravel()
    columns = (2 * pairs[:, 1:] + [0, 1]).ravel()
    T, moved = transform.copy(), b
    for _ in range(MAX_ITERATIONS):
        R = rotations(T[2])
        Q_turned = (R @ Q.reshape(len(b), 2, -1)).reshape(len(Q), -1, 2) @ R.T
        Q_turned = Q_turned.reshape(Q.shape)
        v = (a[pairs[:, 0]] - b[pairs[:, 1]] @ R.T - T[:2]).ravel()  # (2 m,)
        S = cho_factor(P[np.ix_(rows, rows)] + Q_turned[np.ix_(columns, columns)])
        J = pose_jacobians(moved @ R.T).reshape(-1, 3)  # (2 N, 3)
        weighted = cho_solve(S, J[columns])
        C = np.linalg.inv(J[columns].T @ weighted)
        step = C @ weighted.T @ v
        force = cho_solve(S, v - J[columns] @ step)
        T = T + step
        moved = b + (Q_turned[:, columns] @ force).reshape(-1, 2) @ R
        if np.abs(step).max() < 1e-10:
            break
    prior = block_diag(P, Q_turned)
    gain = np.concatenate([prior[:, rows][: len(P)], -prior[len(P) :, len(P) + columns]])  # C G^T
    mean = np.concatenate([maps.robot, a.ravel(), (b @ R.T + T[:2]).ravel()]) - gain @ force
    by_transform = gain @ weighted
    by_transform[len(P) :] += J
    joint = prior - gain @ cho_solve(S, gain.T) + by_transform @ C @ by_transform.T
    radial = ((common := b[pairs[:, 1]] @ R.T) - common.mean(0)).ravel()
    leverage = weighted.T @ radial
    information = float(radial @ cho_solve(S, radial) - leverage @ C @ leverage)
    stretch = float(radial @ force) / information, 1 / information
    nis, dof = float(v @ force), 2 * len(pairs) - 3
    scale = max(1.0, nis / dof)
    log_det = 2 * np.log(np.diag(S[0])).sum() - np.linalg.slogdet(C)[1]
    log_density = -(nis / scale + log_det + dof * log(2 * pi * scale)) / 2
    extent, other = np.ptp(a, axis=0), np.ptp(b, axis=0).max()
    volume = 2 * pi * float(np.prod(extent + other))  # of the transforms
    chance = log(len(a) / float(np.prod(extent + 1e-9)))
    log_odds = float(log_density) - log(volume) - len(pairs) * chance
    T[2] = wrap(T[2])
    return _Fused(pairs, T, C, nis, stretch, scale, log_odds, mean, joint)


def _grown(maps: _Maps, pairs: IntArray, transform: FloatArray) -> _Fused:
    """Adds pairs of mutually nearest landmarks, the least uncertain first."""
    r, n = maps.r, len(maps.xy[0])
    i, j = np.arange(n), n + np.arange(len(maps.xy[1]))
    fused = _fuse(maps, pairs, transform)
    while True:
        points = fused.mean[r:].reshape(-1, 2)
        S = difference_covariances(fused.P[r:, r:], i[:, None], j)  # (N, M, 2, 2)
        S = fused.scale * S + 1e-12 * np.eye(2)
        square = normalized_squared(points[:n, None] - points[None, n:], S)
        labels = maps.labels[0][:, None], maps.labels[1][None]
        square[(labels[0] != labels[1]) & (labels[0] >= 0) & (labels[1] >= 0)] = np.inf
        square[fused.pairs[:, 0]] = square[:, fused.pairs[:, 1]] = np.inf
        nearest = square.argmin(1)
        mutual = (square.argmin(0)[nearest] == i) & (square[i, nearest] < LANDMARK_GATE)
        clear = square[i, nearest] + AMBIGUOUS
        square[i, nearest] = np.inf
        mutual &= (square.min(1) > clear) & (square.min(0)[nearest] > clear)
        new = np.column_stack([i, nearest])[mutual]
        if len(new) == 0:
            return fused
        variance = np.trace(S[new[:, 0], new[:, 1]], axis1=1, axis2=2)
        best = np.argsort(variance, kind="stable")[: max(1, len(new) // 2)]
        fused = _fuse(maps, np.concatenate([fused.pairs, new[best]]), fused.transform)


def _search(maps: _Maps) -> list[_Fused]:
    """Distinct correspondences, by locating groups of landmarks of the second map in the first."""
    (a, b), (P, Q) = maps.xy, maps.P
    tried: list[_Fused] = []
    for group in [*_groups(b, GROUP), *_groups(b, 2 * GROUP)]:
        clear = [each for each in tried if each.log_odds > CLEAR]
        if any(np.isin(group, each.pairs[:, 1]).mean() > 0.5 for each in clear):
            continue
        center = b[group].mean(0)
        points = b[group] - center
        located = locate(points, _shape_errors(points, Q, group), a, P[maps.r :, maps.r :])
        for pose, p, to in zip(located.pose, located.probability, located.association, strict=True):
            pairs = np.column_stack([to, group])[to >= 0]
            pairs = pairs[np.unique(pairs[:, 0], return_index=True)[1]]
            same = ({*map(tuple, pairs)} & {*map(tuple, each.pairs)} for each in tried)
            known = any(len(each) > len(pairs) / 2 for each in same)
            if p >= LIKELY and len(pairs) >= 3 and not known:
                transform = np.append(pose[:2] - rotations(pose[2]) @ center, pose[2])
                tried.append(_grown(maps, pairs, transform))
    found: list[_Fused] = []
    for fused in sorted(tried, key=lambda each: -each.log_odds):
        for other in found:
            C = fused.scale * fused.covariance + other.scale * other.covariance
            error = pose_difference(fused.transform, other.transform)
            if normalized_squared(error, C) < SAME_TRANSFORM:
                break
        else:
            found.append(fused)
    return found


def _groups(xy: FloatArray, size: int) -> list[IntArray]:
    """Groups of neighboring landmarks, the centers as far from each other as possible."""
    groups, distance = [], np.full(len(xy), np.inf)
    center = int(np.argmin(np.hypot(*(xy - xy.mean(0)).T))) if len(xy) > 0 else 0
    for _ in range(min(MAX_GROUPS, len(xy))):
        away = np.hypot(*(xy - xy[center]).T)
        groups.append(np.argsort(away, kind="stable")[:size])
        distance = np.minimum(distance, away)
        center = int(distance.argmax())
    return groups


def _shape_errors(points: FloatArray, Q: FloatArray, group: IntArray) -> FloatArray:
    """(k, 2, 2) covariance of points without the errors that a transform of all would have."""
    rows = (2 * group[:, None] + [0, 1]).ravel()
    J = pose_jacobians(points).reshape(-1, 3)
    project = np.eye(len(rows)) - J @ np.linalg.pinv(J)
    C = project @ Q[np.ix_(rows, rows)] @ project.T
    k = np.arange(len(group))
    blocks = C.reshape(len(k), 2, len(k), 2)[k, :, k]
    return np.asarray(blocks + 1e-8 * np.eye(2))


def _fitted(maps: _Maps, pairs: IntArray) -> FloatArray:
    """Least-squares transform (3,) of the second map's points to the first map's."""
    a, b = maps.xy[0][pairs[:, 0]], maps.xy[1][pairs[:, 1]]
    p, q = a - a.mean(0), b - b.mean(0)
    heading = np.arctan2((q[:, 0] * p[:, 1] - q[:, 1] * p[:, 0]).sum(), (p * q).sum())
    return np.append(a.mean(0) - rotations(heading) @ b.mean(0), heading)


def _as_slam(first: Slam, second: Slam, maps: _Maps, fused: _Fused) -> Slam:
    """The merged map with the settings of the first."""
    n, m = len(maps.xy[0]), len(maps.xy[1])
    new, ids = np.setdiff1d(np.arange(m), fused.pairs[:, 1]), first.filter.ids
    added = first.filter.next_id + np.arange(len(new))
    rows = np.concatenate(
        [np.arange(maps.r + 2 * n), (maps.r + 2 * (n + new[:, None]) + [0, 1]).ravel()]
    )
    first.filter.set_gaussian(fused.mean[rows], fused.P[np.ix_(rows, rows)], np.append(ids, added))
    table = first.landmarks
    table.session += 1
    table.add(added, confirmed=True, observations=table.policy.confirm_after)
    labels = second.landmarks.labels_of(second.filter.ids.tolist())
    pairs = [*zip(added.tolist(), new.tolist(), strict=True)]
    pairs += [(int(ids[i]), j) for i, j in fused.pairs.tolist() if maps.labels[0][i] < 0]
    for landmark, j in pairs:
        if (label := labels[j]) is not None and table.landmarks_of([label])[0] < 0:
            table.labels[label] = LabelRecord(landmark, ESTABLISHED)
    return first
