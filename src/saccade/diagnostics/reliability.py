"""Reliability of a map without labels: statistics that separate wrong maps from right ones.

A wrong map contains landmarks twice: a loop is not closed, or a kidnapped robot begins its map
anew. When the robot revisits a place, it misses landmarks of the first visit every time; or the
newer part of the map is a rotated and translated copy of the older part. Where the first
observations are not used, the map is wrong relative to the start.
"""

import numpy as np
from scipy.spatial import cKDTree

from saccade.plane import in_robot_frame, rotations
from saccade.slam.filter.robot_models import wrap
from saccade.slam.relocalization import locate
from saccade.types import BoolArray, FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

MIN_EXPECTED_OBSERVATIONS = 8.0
"""Minimum number of expected observations at revisits for a landmark to be judged."""
MISSED = 0.1
"""Largest fraction of its expected observations for a landmark that is a duplicate."""
RARE = 0.75
"""Largest fraction of its expected observations for a landmark that may be a duplicate."""
MAX_RARE = 0.15
"""Largest fraction of landmarks that may be duplicates in a right map."""
MAX_FEW = 2
"""Largest number of landmarks that may be duplicates in a right map, however few are judged."""
MIN_TOGETHER = 0.1
"""Least fraction of their stretches with both of two landmarks that may be confused; a landmark
that is in the map twice is observed as one or the other."""
FIRST = 80
"""Number of observations at the beginning, most of which a right map uses."""
MAX_UNUSED = 0.4
"""Largest fraction of unused observations in a right map."""
MIN_COPIED = 0.5
"""Largest fraction of landmarks that match older landmarks by chance."""
MIN_COPIED_LANDMARKS = 8
"""Least number of landmarks of a copy."""
SAME_VIEW = 0.12
"""Distance between poses that observe the same landmarks, as a fraction of the sensor's range."""
STRETCH_LENGTH = 0.06
"""Length of a stretch, as a fraction of the sensor's range."""
SAME_TURN = 0.35
"""Largest turn in radians of the scans of a stretch."""
VIEW = 0.95
"""Fraction of the observations that define the range and the field of view."""
ALL_AROUND = 5.3
"""Least field of view in radians of a sensor that counts as omnidirectional."""
GROUP = 8
"""Number of landmarks that are located together among the older ones."""
COPY_TOLERANCE = 0.3
"""Tolerance of a copied landmark, as a fraction of the distance between neighbors."""


def map_warning(
    log: LandmarkLog, trajectory: Trajectory, found: LandmarkMap, association: IntArray
) -> str:
    """Reasons why a map without labels may be wrong; empty without any.

    Args:
        log: controls and observations.
        trajectory: (t + 1) smoothed or filtered poses.
        found: (n) landmarks.
        association: (k,) row of the landmark of each observation, -1 for none.
    """
    reasons, log = [], in_robot_frame(log)
    complete = ~np.isnan(log.observation).any(1)  # the others never add a landmark
    unused = association[complete] < 0
    for part, name in ((unused, "the"), (unused[:FIRST], "the first")):
        if len(part) > 0 and part.mean() > MAX_UNUSED:
            reasons.append(f"{part.mean():.0%} of {name} observations are not used")
    if complete.all():
        again = reobserved(log, trajectory.pose, found.xy, association)
        rare = np.sum(again <= RARE)
        many = rare > max(MAX_RARE * np.isfinite(again).sum(), MAX_FEW)
        if (again <= MISSED).any() or many:
            reasons.append(f"{rare} of {len(again)} landmarks are missing where the robot returns")
    pairs, copied = copied_landmarks(log, found.xy, association)
    if copied > MIN_COPIED and pairs >= MIN_COPIED_LANDMARKS:
        reasons.append(
            f"{pairs} landmarks are a copy of older ones elsewhere ({copied:.0%} of those that "
            "could be), as if the robot had been moved"
        )
    return f"the map may be unreliable: {'; '.join(reasons)}" if reasons else ""


def reobserved(
    log: LandmarkLog, pose: FloatArray, xy: FloatArray, association: IntArray
) -> FloatArray:
    """Re-observations of landmarks (n, 2) at revisits, relative to their expected number.

    Every observation has a range and a bearing. The scans of a short stretch count as one. A
    landmark is expected there if it is in the field of view and was observed from another stretch
    nearby, so that no wall hides it; how often, depends on its detection rate within a visit. It
    counts as observed, too, where a landmark beside it is, as close as a stretch is long, if both
    are observed together at times: the two may be confused, which moves the map by no more.

    Returns:
        (n,) along poses (t + 1, 3); NaN for a landmark that is expected too rarely.
    """
    scans = np.unique(log.observation_pose)
    if len(xy) == 0 or len(scans) < 2:
        return np.full(len(xy), np.nan)
    z = log.observation
    reach = float(np.quantile(z[:, 0], VIEW))
    right, left = np.quantile(z[:, 1], [(1 - VIEW) / 2, (1 + VIEW) / 2])
    steps = np.diff(pose, axis=0, prepend=pose[:1])
    traveled = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))
    length = max(STRETCH_LENGTH * reach, 1.5 * float(np.median(np.diff(traveled[scans]))), 1e-6)
    near = max(SAME_VIEW * reach, length)
    turned = np.cumsum(np.abs(wrap(steps[:, 2])))
    number = np.floor((traveled / length + turned / SAME_TURN)[scans])
    _, first, stretch, count = np.unique(
        number, return_index=True, return_inverse=True, return_counts=True
    )
    middle = scans[first + count // 2]
    observed = _nearest_if_unused(log, pose, xy, association, length)
    used = observed >= 0
    seen = np.zeros((len(middle), len(xy)), np.bool_)
    seen[stretch[np.searchsorted(scans, log.observation_pose[used])], observed[used]] = True
    offset = xy - pose[middle, None, :2]  # (m, n, 2)
    bearing = wrap(np.arctan2(offset[..., 1], offset[..., 0]) - pose[middle, 2:])
    in_view = np.hypot(offset[..., 0], offset[..., 1]) < reach
    in_view &= (bearing > right) & (bearing < left) | (left - right > ALL_AROUND)
    pairs = cKDTree(pose[middle, :2]).query_pairs(near, output_type="ndarray")
    distance = np.abs(np.diff(traveled[middle][pairs], axis=1)[:, 0])
    either = seen.copy()
    for i, j in cKDTree(xy).query_pairs(length):
        together = np.count_nonzero(seen[:, i] & seen[:, j])
        if together > MIN_TOGETHER * min(seen[:, i].sum(), seen[:, j].sum()):
            either[:, [i, j]] |= seen[:, [j, i]]
    within = in_view & _seen_nearby(seen, pairs[distance <= 2 * near])
    later = in_view & _seen_nearby(seen, pairs[distance > reach])
    rate = (either & within).sum(0) / np.maximum(within.sum(0), 1)  # of each landmark in a visit
    expected, again = (later * rate).sum(0), (later & either).sum(0)
    return np.where(
        expected < MIN_EXPECTED_OBSERVATIONS,
        np.nan,
        again / np.maximum(expected, MIN_EXPECTED_OBSERVATIONS),
    )


def _nearest_if_unused(
    log: LandmarkLog, pose: FloatArray, xy: FloatArray, association: IntArray, near: float
) -> IntArray:
    """(k,) landmark of each observation; for unused ones the nearest within a distance, or -1."""
    unused = np.flatnonzero(association < 0)
    z, at = log.observation[unused], pose[log.observation_pose[unused]]
    angle = at[:, 2] + z[:, 1]
    points = at[:, :2] + z[:, :1] * np.stack([np.cos(angle), np.sin(angle)], 1)
    distance, nearest = cKDTree(xy).query(points)
    observed = association.copy()
    observed[unused] = np.where(np.asarray(distance) < near, nearest, -1)
    return observed


def _seen_nearby(seen: BoolArray, pairs: IntArray) -> BoolArray:
    """(m, n) whether each landmark is seen from a stretch that is paired (p, 2) with stretch m."""
    nearby = np.zeros_like(seen)
    for i, j in (pairs.T, pairs.T[::-1]):
        np.logical_or.at(nearby, i, seen[j])
    return nearby


def copied_landmarks(log: LandmarkLog, xy: FloatArray, association: IntArray) -> tuple[int, float]:
    """Landmarks (n, 2) that are a copy of older ones, as from a kidnapped robot.

    Groups of landmarks are located among older landmarks, whose last observation precedes the
    group. In a right map of a repetitive environment, few groups are found.

    Returns:
        Number and fraction of newer landmarks that one rigid motion moves onto older ones.
    """
    used, n = association >= 0, len(xy)
    first, last = np.full(n, len(log.time)), np.full(n, -1)
    np.minimum.at(first, association[used], log.observation_pose[used])
    np.maximum.at(last, association[used], log.observation_pose[used])
    xy, first, last = (each[last >= 0] for each in (xy, first, last))
    order, best = np.argsort(first, kind="stable"), (0, 0.0)
    if len(xy) < 2 * GROUP:
        return best
    tolerance = COPY_TOLERANCE * float(np.median(np.asarray(cKDTree(xy).query(xy, 2)[0])[:, 1]))
    R_xy = (tolerance / 3) ** 2 / 2 * np.eye(2)  # covariance of each of two points
    for i in range(GROUP, len(xy) - GROUP // 2, GROUP // 2):
        group, begins = order[i : i + GROUP], first[order[i]]
        older, newer = xy[last < begins], xy[first >= begins]
        if len(older) < MIN_COPIED_LANDMARKS or len(newer) < MIN_COPIED_LANDMARKS:
            continue
        center = xy[group].mean(0)
        located = locate(xy[group] - center, R_xy, older, np.tile(R_xy, (len(older), 1, 1)))
        tree = cKDTree(older)
        for pose in located.pose[:5]:
            moved = (newer - center) @ rotations(pose[2]).T + pose[:2]
            distance, at = tree.query(moved, distance_upper_bound=tolerance)
            count = len(np.unique(np.asarray(at)[np.isfinite(distance)]))
            best = max(best, (count, count / min(len(older), len(newer))))
    return best
